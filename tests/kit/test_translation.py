"""Equations (2) and (3): eight rows per feature, one translation, and the weight of each feature."""

from __future__ import annotations

import numpy as np
import pytest
from box_scenes import CAMERA, match_points

from vo_lib.geometry.matches import StereoMatches
from vo_lib.geometry.motion import rotation_from_vector
from vo_lib.geometry.symmetric import FULL
from vo_lib.geometry.types import Array
from vo_lib.kit.settings import KitTranslationConfig
from vo_lib.kit.weighted_translation import EliminatedPoints, robust_start, robust_translation, stereo_points
from vo_lib.paper.translation import feature_rows

R_CP = rotation_from_vector(np.array([0.002, 0.01, -0.001]))
T_CP = np.array([0.01, 0.02, -1.0])


def scene(n: int, noise: float = 0.0, seed: int = 0) -> tuple[StereoMatches, Array]:
    """Matches of n points for the motion (R_CP, T_CP), and the points in the previous frame."""
    rng = np.random.default_rng(seed)
    disparity = CAMERA.f * CAMERA.baseline / rng.uniform(5, 40, n)
    X_p = CAMERA.back_project(rng.uniform([0, 0], [1241, 376], (n, 2)), disparity)
    return match_points(X_p, X_p @ R_CP.T + T_CP, noise, rng), X_p


def solved(matches: StereoMatches, R_cp: Array = R_CP, **settings: float) -> tuple[Array, Array]:
    result = robust_translation(CAMERA, matches, R_cp, KitTranslationConfig(**settings))  # type: ignore[arg-type]
    assert result is not None
    return result


def eliminated(matches: StereoMatches, depth: Array) -> EliminatedPoints:
    """The library's linear system, with the rows of each feature divided by its depth (N,)."""
    before = stereo_points(CAMERA, matches.prev_left, matches.prev_right).rotated(R_CP)
    now = stereo_points(CAMERA, matches.cur_left, matches.cur_right)
    return EliminatedPoints(before, now, depth, depth)


@pytest.mark.parametrize("in_pixels", [False, True])
def test_elimination_equals_the_dense_solution(in_pixels: bool) -> None:
    """Comparison with the solution of one system, in which t and the points of all features are unknown."""
    matches, X_p = scene(25, 0.5)
    depth = X_p[:, 2] if in_pixels else np.ones(25)
    A, B, c = feature_rows(CAMERA, matches, R_CP)
    whole = np.zeros((25, 8, 3 * 25 + 3))
    for i in range(25):
        whole[i, :, 3 * i : 3 * i + 3], whole[i, :, -3:] = A[i], B[i]
    whole /= depth[:, None, None]
    expected = np.linalg.lstsq(whole.reshape(8 * 25, -1), (c / depth[:, None]).ravel(), rcond=None)[0][-3:]
    system = eliminated(matches, depth)
    result = np.linalg.solve(system.W.sum(axis=1)[FULL], system.right_sides().sum(axis=1))
    np.testing.assert_allclose(result, expected, atol=1e-8)


def test_robust_start_tolerates_consistent_outliers() -> None:
    matches, X_p = scene(300, 0.2, 1)
    wrong = np.random.default_rng(3).random(300) < 0.4
    matches.cur_left[wrong], matches.cur_right[wrong] = CAMERA.project(
        X_p[wrong] @ R_CP.T + T_CP + (3.0, 0.0, 0.0)
    )
    start = robust_start(eliminated(matches, X_p[:, 2]), 4.0 / CAMERA.f)
    assert np.linalg.norm(start - T_CP) < 0.05


@pytest.mark.parametrize("features", [1, 100])
def test_exact_features_give_the_exact_translation(features: int) -> None:
    t, residual = solved(scene(features)[0])
    np.testing.assert_allclose(t, T_CP, atol=1e-6 if features == 1 else 1e-8)
    assert residual.max() < 1e-6


def test_translation_noise_is_millimetres() -> None:
    errors = [np.linalg.norm(solved(scene(300, 0.3, seed)[0])[0] - T_CP) for seed in range(15)]
    assert np.median(errors) < 4.5e-3


def test_far_features_are_excluded() -> None:
    matches, X_p = scene(50)
    far = X_p[:, 2] > 20.0
    np.testing.assert_array_equal(np.isinf(solved(matches, max_depth=20.0)[1]), far)
    assert robust_translation(CAMERA, matches[far], R_CP, KitTranslationConfig(max_depth=20.0)) is None


def pull(depth: float, error: tuple[float, ...], scale: float = 20.0) -> Array:
    """Change of t (3,), metres, due to the pixel error of one feature straight ahead in the current pair.

    error : (u, v) in the left and in the right image, pixels. The camera does not move, so every depth stays
    the same. The other 800 points are symmetric about the line midway between the cameras, so the axes are
    not coupled.
    """
    x, y, z = np.random.default_rng(0).uniform([0.5, -2, 6], [6, 2, 30], (200, 3)).T
    crowd = [np.stack([a * x, b * y, z], 1) for a in (1, -1) for b in (1, -1)]
    # At half of the baseline, the mean ray of the feature is the optical axis.
    X = np.array([CAMERA.baseline / 2, 0.0, 0.0]) + np.concatenate([*crowd, [[0.0, 0.0, depth]]])
    matches = match_points(X, X)
    matches.cur_left[-1] += error[:2]
    matches.cur_right[-1] += error[2:]
    return solved(matches, np.eye(3), scale=scale, iterations=50)[0]


@pytest.mark.parametrize("scale", [0.5, 2.0])
@pytest.mark.parametrize(("residual", "weight"), [(1.0, 1 / 2), (3**0.5, 1 / 4), (2.0, 1 / 5)])
def test_weight_is_halved_at_the_scale(scale: float, residual: float, weight: float) -> None:
    # A feature lower by e in both current images has four residuals of e / 2 along v: their norm is e.
    little, much = (pull(10.0, (0.0, e, 0.0, e), scale)[1] / e for e in (0.02 * scale, residual * scale))
    assert much / little == pytest.approx(weight, rel=0.02)
