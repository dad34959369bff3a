"""Equations (2) and (3): eight rows a feature, one translation for all."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from vo_lib.beyond.stereo_points import stereo_points
from vo_lib.beyond.translation import EliminatedPoints, eliminate_points, robust_start, solve_translation
from vo_lib.config import TranslationConfig
from vo_lib.core.camera import StereoCamera
from vo_lib.core.geometry import rotation_from_vector
from vo_lib.core.matches import StereoMatches
from vo_lib.core.symmetric import FULL
from vo_lib.core.types import Array
from vo_lib.method.translation import feature_rows

CAMERA = StereoCamera(f=718.856, cx=607.2, cy=185.2, baseline=0.537, width=1241, height=376)
R_CP = rotation_from_vector(np.array([0.002, 0.01, -0.001]))
T_CP = np.array([0.01, 0.02, -1.0])


def scene(n: int, noise: float = 0.0, seed: int = 0) -> tuple[StereoMatches, Array]:
    """Matches of n points for the motion (R_CP, T_CP), and the points in the previous frame."""
    rng = np.random.default_rng(seed)
    depth = rng.uniform(5, 40, n)
    uv = rng.uniform([0, 0], [1241, 376], (n, 2))
    X_p = np.concatenate([CAMERA.normalise(uv) * depth[:, None], depth[:, None]], axis=1)
    exact = [*CAMERA.project(X_p), *CAMERA.project(X_p @ R_CP.T + T_CP)]
    views = [view + rng.normal(0, noise, view.shape) for view in exact]
    ones = np.ones(n, np.int64)
    return StereoMatches(views[0], views[1], views[2], views[3], ones, np.ones(n), np.arange(n)), X_p


def test_the_eight_rows_of_a_feature_hold_for_its_point_and_the_translation() -> None:
    matches, X_p = scene(20)
    A, B, c = feature_rows(CAMERA, matches, R_CP)
    np.testing.assert_allclose(np.einsum("nij,nj->ni", A, X_p) + B @ T_CP, c, atol=1e-9)
    assert np.linalg.matrix_rank(np.concatenate([A[0], B[0]], axis=1)) == 6


def least_squares(matches: StereoMatches, depth: Array) -> Array:
    """t of the whole system of all features, points included, solved densely; rows divided by depth (N,)."""
    A, B, c = feature_rows(CAMERA, matches, R_CP)
    n = len(matches)
    whole = np.zeros((n, 8, 3 * n + 3))
    for i in range(n):
        whole[i, :, 3 * i : 3 * i + 3], whole[i, :, -3:] = A[i], B[i]
    whole /= depth[:, None, None]
    solved = np.linalg.lstsq(whole.reshape(8 * n, -1), (c / depth[:, None]).ravel(), rcond=None)[0]
    return np.asarray(solved[-3:])


def eliminated(matches: StereoMatches, depth: Array) -> EliminatedPoints:
    """The system as the library has it, rows divided by depth (N,)."""
    before = stereo_points(CAMERA, matches.prev_left, matches.prev_right).rotated(R_CP)
    now = stereo_points(CAMERA, matches.cur_left, matches.cur_right)
    return eliminate_points(before, now, depth, depth)


def stacked_once(matches: StereoMatches, depth: Array) -> Array:
    """The same by elimination of the points, as the library does it."""
    H, g = eliminated(matches, depth).normal_equations()
    return np.linalg.solve(H.sum(axis=1)[FULL], g.sum(axis=1))


def test_eliminating_the_points_changes_nothing() -> None:
    matches, X_p = scene(25, 0.5)
    for depth in (np.ones(25), X_p[:, 2]):
        np.testing.assert_allclose(stacked_once(matches, depth), least_squares(matches, depth), atol=1e-8)


def test_residuals_are_those_of_the_eight_rows_in_pixels() -> None:
    matches, X_p = scene(40, 0.4)
    depth, t = X_p[:, 2], T_CP + np.array([0.1, -0.05, 0.3])
    found = CAMERA.f * np.sqrt(eliminated(matches, depth).squared_residuals(t))
    A, B, c = feature_rows(CAMERA, matches, R_CP)
    for i in range(40):
        right = c[i] - B[i] @ t
        residual = right - A[i] @ np.linalg.lstsq(A[i], right, rcond=None)[0]
        expected = CAMERA.f * np.linalg.norm(residual) / depth[i]
        np.testing.assert_allclose(found[i], expected, rtol=1e-5, atol=1e-8)


def test_the_depth_of_a_feature_is_that_of_its_best_point_under_the_translation() -> None:
    matches, X_p = scene(30, 0.5)
    t = T_CP + np.array([0.1, -0.05, 0.3])
    system = eliminated(matches, X_p[:, 2])
    A, B, c = feature_rows(CAMERA, matches, R_CP)
    Q = np.stack([np.linalg.lstsq(A[i], c[i] - B[i] @ t, rcond=None)[0] for i in range(30)])
    before, now = system.depths(t)
    np.testing.assert_allclose(before, Q[:, 2], rtol=1e-4)
    np.testing.assert_allclose(now, (Q @ R_CP.T + t)[:, 2], rtol=1e-4)


def test_the_start_is_found_though_four_matches_of_ten_are_wrong_together() -> None:
    matches, X_p = scene(300, 0.2, 1)
    wrong = np.random.default_rng(3).random(300) < 0.4
    T_other = T_CP + np.array([3.0, 0.0, 0.0])
    other = CAMERA.project(X_p @ R_CP.T + T_other)
    current = [
        np.where(wrong[:, None], a, b)
        for a, b in zip(other, (matches.cur_left, matches.cur_right), strict=True)
    ]
    mixed = dataclasses.replace(matches, cur_left=current[0], cur_right=current[1])
    start = robust_start(eliminated(mixed, X_p[:, 2]), 4.0 / CAMERA.f)
    assert np.linalg.norm(start - T_CP) < 0.05


@pytest.mark.parametrize("features", [1, 100])
def test_exact_features_even_one_give_the_exact_translation_and_no_residual(features: int) -> None:
    matches, _ = scene(features)
    solved = solve_translation(CAMERA, matches, R_CP, TranslationConfig())
    assert solved is not None
    np.testing.assert_allclose(solved[0], T_CP, atol=1e-6 if features == 1 else 1e-8)
    assert solved[1].max() < 1e-6


def test_noise_of_a_third_of_a_pixel_leaves_millimetres() -> None:
    errors = []
    for seed in range(15):
        solved = solve_translation(CAMERA, scene(300, 0.3, seed)[0], R_CP, TranslationConfig())
        assert solved is not None
        errors.append(np.linalg.norm(solved[0] - T_CP))
    assert np.median(errors) < 4.5e-3


def test_thirty_percent_wrong_matches_hardly_matter() -> None:
    matches, _ = scene(300, 0.2, 1)
    rng = np.random.default_rng(2)
    moved = matches.cur_left.copy(), matches.cur_right.copy()
    shift = rng.uniform(-15, 15, (90, 2))
    moved[0][:90] += shift
    moved[1][:90] += shift
    wrong = dataclasses.replace(matches, cur_left=moved[0], cur_right=moved[1])
    solved = solve_translation(CAMERA, wrong, R_CP, TranslationConfig())
    assert solved is not None
    assert np.linalg.norm(solved[0] - T_CP) < 0.02
    assert np.median(solved[1][:90]) > 5 * np.median(solved[1][90:])


def test_far_features_are_left_out_and_none_left_is_said() -> None:
    matches, X_p = scene(50)
    config = TranslationConfig(max_depth=20.0)
    solved = solve_translation(CAMERA, matches, R_CP, config)
    assert solved is not None
    np.testing.assert_array_equal(np.isinf(solved[1]), X_p[:, 2] > 20.0)
    assert solve_translation(CAMERA, matches[X_p[:, 2] > 20.0], R_CP, config) is None
