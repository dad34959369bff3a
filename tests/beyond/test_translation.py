"""Equations (2) and (3): eight rows a feature, one translation for all, and how hard each one pulls it."""

from __future__ import annotations

import numpy as np
import pytest
from box_scenes import CAMERA, match_points

from vo_lib.beyond.translation import EliminatedPoints, robust_start, solve_translation, stereo_points
from vo_lib.config import TranslationConfig
from vo_lib.core.geometry import rotation_from_vector
from vo_lib.core.matches import StereoMatches
from vo_lib.core.symmetric import FULL, invert
from vo_lib.core.types import Array
from vo_lib.method.translation import feature_rows

R_CP = rotation_from_vector(np.array([0.002, 0.01, -0.001]))
T_CP = np.array([0.01, 0.02, -1.0])
# A translation that is off: residuals are large there.
OFF = T_CP + np.array([0.1, -0.05, 0.3])


def scene(n: int, noise: float = 0.0, seed: int = 0) -> tuple[StereoMatches, Array]:
    """Matches of n points for the motion (R_CP, T_CP), and the points in the previous frame."""
    rng = np.random.default_rng(seed)
    disparity = CAMERA.f * CAMERA.baseline / rng.uniform(5, 40, n)
    X_p = CAMERA.back_project(rng.uniform([0, 0], [1241, 376], (n, 2)), disparity)
    return match_points(X_p, X_p @ R_CP.T + T_CP, noise, rng), X_p


def solved(matches: StereoMatches, R_cp: Array = R_CP, **settings: float) -> tuple[Array, Array]:
    found = solve_translation(CAMERA, matches, R_cp, TranslationConfig(**settings))  # type: ignore[arg-type]
    assert found is not None
    return found


def eliminated(matches: StereoMatches, depth: Array) -> EliminatedPoints:
    """The system as the library has it, rows divided by depth (N,)."""
    before = stereo_points(CAMERA, matches.prev_left, matches.prev_right).rotated(R_CP)
    now = stereo_points(CAMERA, matches.cur_left, matches.cur_right)
    return EliminatedPoints(before, now, depth, depth)


def test_no_disparity_leaves_the_point_finite_and_unknown_along_its_ray() -> None:
    left = np.array([[700.0, 200.0]])
    points = stereo_points(CAMERA, left, left)
    W = invert(points.covariance(np.array([10.0])))[FULL][:, :, 0]
    assert np.isfinite(points.X).all()
    along, across = points.ray[:, 0] / np.linalg.norm(points.ray[:, 0]), np.array([0.0, 1.0, 0.0])
    assert along @ W @ along < 1e-6 * (across @ W @ across)


@pytest.mark.parametrize("in_pixels", [False, True])
def test_eliminating_the_points_changes_nothing(in_pixels: bool) -> None:
    """Against the system of all features, points included, solved densely."""
    matches, X_p = scene(25, 0.5)
    depth = X_p[:, 2] if in_pixels else np.ones(25)
    A, B, c = feature_rows(CAMERA, matches, R_CP)
    whole = np.zeros((25, 8, 3 * 25 + 3))
    for i in range(25):
        whole[i, :, 3 * i : 3 * i + 3], whole[i, :, -3:] = A[i], B[i]
    whole /= depth[:, None, None]
    expected = np.linalg.lstsq(whole.reshape(8 * 25, -1), (c / depth[:, None]).ravel(), rcond=None)[0][-3:]
    system = eliminated(matches, depth)
    found = np.linalg.solve(system.W.sum(axis=1)[FULL], system.pull().sum(axis=1))
    np.testing.assert_allclose(found, expected, atol=1e-8)


def test_residuals_and_depths_are_those_of_each_features_best_point_under_the_translation() -> None:
    matches, X_p = scene(40, 0.4)
    system = eliminated(matches, X_p[:, 2])
    found = CAMERA.f * np.sqrt(system.squared_residuals(OFF)), *system.depths(OFF)
    for A, B, c, z, residual, before, now in zip(
        *feature_rows(CAMERA, matches, R_CP), X_p[:, 2], *found, strict=True
    ):
        Q = np.linalg.lstsq(A, c - B @ OFF, rcond=None)[0]
        expected = CAMERA.f * np.linalg.norm(c - B @ OFF - A @ Q) / z
        np.testing.assert_allclose(residual, expected, rtol=1e-5, atol=1e-8)
        np.testing.assert_allclose([before, now], [Q[2], (R_CP @ Q + OFF)[2]], rtol=1e-4)


def test_the_start_is_found_though_four_matches_of_ten_are_wrong_together() -> None:
    matches, X_p = scene(300, 0.2, 1)
    wrong = np.random.default_rng(3).random(300) < 0.4
    matches.cur_left[wrong], matches.cur_right[wrong] = CAMERA.project(
        X_p[wrong] @ R_CP.T + T_CP + (3.0, 0.0, 0.0)
    )
    start = robust_start(eliminated(matches, X_p[:, 2]), 4.0 / CAMERA.f)
    assert np.linalg.norm(start - T_CP) < 0.05


@pytest.mark.parametrize("features", [1, 100])
def test_exact_features_even_one_give_the_exact_translation_and_no_residual(features: int) -> None:
    t, residual = solved(scene(features)[0])
    np.testing.assert_allclose(t, T_CP, atol=1e-6 if features == 1 else 1e-8)
    assert residual.max() < 1e-6


def test_noise_of_a_third_of_a_pixel_leaves_millimetres() -> None:
    errors = [np.linalg.norm(solved(scene(300, 0.3, seed)[0])[0] - T_CP) for seed in range(15)]
    assert np.median(errors) < 4.5e-3


def test_thirty_percent_wrong_matches_hardly_matter() -> None:
    matches, _ = scene(300, 0.2, 1)
    for uv in (matches.cur_left, matches.cur_right):
        uv[:90] += np.random.default_rng(2).uniform(-15, 15, (90, 2))
    t, residual = solved(matches)
    assert np.linalg.norm(t - T_CP) < 0.02
    assert np.median(residual[:90]) > 5 * np.median(residual[90:])


def test_far_features_are_left_out_and_none_left_is_said() -> None:
    matches, X_p = scene(50)
    far = X_p[:, 2] > 20.0
    np.testing.assert_array_equal(np.isinf(solved(matches, max_depth=20.0)[1]), far)
    assert solve_translation(CAMERA, matches[far], R_CP, TranslationConfig(max_depth=20.0)) is None


def pull(depth: float, error: tuple[float, ...], scale: float = 20.0) -> Array:
    """How far t (3,) moves, metres, when one feature straight ahead is off in the current pair.

    error : pixels, u and v on the left, u and v on the right. The camera stands, which keeps every depth,
    before 800 points mirrored about the line midway between its eyes: no axis couples with another.
    """
    x, y, z = np.random.default_rng(0).uniform([0.5, -2, 6], [6, 2, 30], (200, 3)).T
    crowd = [np.stack([a * x, b * y, z], 1) for a in (1, -1) for b in (1, -1)]
    # Half way between both eyes the feature's ray is the axis.
    X = np.array([CAMERA.baseline / 2, 0.0, 0.0]) + np.concatenate([*crowd, [[0.0, 0.0, depth]]])
    matches = match_points(X, X)
    matches.cur_left[-1] += error[:2]
    matches.cur_right[-1] += error[2:]
    return solved(matches, np.eye(3), scale=scale, iterations=50)[0]


# Off across the ray, a pixel says Z e / f and counts by 1 / Z²; of disparity, Z² e / f b by 1 / Z⁴.
@pytest.mark.parametrize("times", [2.0, 4.0])
@pytest.mark.parametrize(
    ("error", "axis", "power"), [((0.0, 0.1, 0.0, 0.1), 1, 1), ((0.05, 0.0, -0.05, 0.0), 2, 2)]
)
def test_a_pixel_pulls_by_the_inverse_of_the_depth_across_the_ray_and_by_its_square_along(
    error: tuple[float, ...], axis: int, power: int, times: float
) -> None:
    near, far = (pull(z, error)[axis] for z in (7.0, 7.0 * times))
    assert (near > 0) == (axis == 1)
    assert near / far == pytest.approx(times**power, rel=0.02 if power == 1 else 0.1)


@pytest.mark.parametrize("scale", [0.5, 2.0])
@pytest.mark.parametrize(("residual", "weight"), [(1.0, 1 / 2), (3**0.5, 1 / 4), (2.0, 1 / 5)])
def test_the_weight_is_halved_at_the_scale(scale: float, residual: float, weight: float) -> None:
    # A feature lower by e in both current images leaves e / 2 in each of its four rows along v: e in all.
    little, much = (pull(10.0, (0.0, e, 0.0, e), scale)[1] / e for e in (0.02 * scale, residual * scale))
    assert much / little == pytest.approx(weight, rel=0.02)
