"""Robust motion from points and their pixels in a stereo pair."""

from __future__ import annotations

import numpy as np

from vo_lib.geometry.camera import StereoCamera
from vo_lib.geometry.matches import StereoMatches
from vo_lib.geometry.motion import rigid, rotation_from_vector, transform
from vo_lib.geometry.reprojection import fit_motion, linearise
from vo_lib.geometry.types import Array

CAMERA = StereoCamera(f=700.0, cx=600.0, cy=180.0, baseline=0.54, width=1241, height=376)
R_CP, T_CP = rotation_from_vector(np.array([0.02, -0.15, 0.05])), np.array([0.1, -0.05, -1.2])


TRUE = rigid(R_CP, T_CP)


def observations(n: int = 60) -> StereoMatches:
    """Matches of n points that are at rest."""
    return match_points_at(np.random.default_rng(3).uniform([-8, -2, 6], [8, 2, 40], (n, 3)))


def match_points_at(X_p: Array) -> StereoMatches:
    """Matches of points (N, 3) of the previous frame that are at rest."""
    numbers = np.arange(len(X_p))
    before = CAMERA.project(X_p)
    now = CAMERA.project(transform(TRUE, X_p))
    return StereoMatches(*before, *now, np.ones_like(numbers), np.ones(len(X_p)), numbers)


def test_fit_motion_tolerates_outliers() -> None:
    matches = observations()
    matches.cur_left[:20] += np.random.default_rng(4).uniform(30, 90, (20, 2))
    T_cp, residual = fit_motion(CAMERA, matches, np.eye(4), scale=0.5)
    np.testing.assert_allclose(T_cp[:3, :3], R_CP, atol=2e-4)
    np.testing.assert_allclose(T_cp[:3, 3], T_CP, atol=5e-3)
    assert residual[20:].max() < 0.3
    assert residual[:20].min() > 20.0


def test_residual_is_the_norm_of_four_coordinates() -> None:
    matches = observations()
    matches.cur_left[:, 0] += 3.0
    matches.cur_right[:, 1] -= 4.0
    residual = fit_motion(CAMERA, matches, TRUE, scale=1e6, iterations=0).residual
    np.testing.assert_allclose(residual, 5.0, rtol=1e-9)


def test_points_behind_the_camera_have_infinite_residuals() -> None:
    # Exchanged images of the previous pair: the disparity is negative, so the point is behind the camera.
    matches = observations()
    matches.prev_left[0], matches.prev_right[0] = matches.prev_right[0].copy(), matches.prev_left[0].copy()
    residual = fit_motion(CAMERA, matches, TRUE, scale=1.0, iterations=0).residual
    assert residual[0] == np.inf
    assert residual[1:].max() < 1e-6


def test_points_without_depth_do_not_move_the_fit() -> None:
    matches = observations()
    matches.prev_right[:3] = matches.prev_left[:3]
    T_cp, residual = fit_motion(CAMERA, matches, np.eye(4))
    np.testing.assert_allclose(T_cp, TRUE, atol=1e-6)
    np.testing.assert_array_equal(residual[:3], np.inf)
    assert residual[3:].max() < 1e-3


def test_batched_linearisation_equals_single_ones() -> None:
    rng = np.random.default_rng(2)
    rotated = rng.uniform([-5, -2, 6], [5, 2, 30], (3, 4, 3))
    t, measured = rng.normal(size=(3, 1, 3)), rng.uniform(-300, 300, (3, 4, 4))
    batch = linearise(CAMERA, rotated, t, measured)
    for k in range(3):
        single = linearise(CAMERA, rotated[k], t[k, 0], measured[k])
        for a, b in zip(batch, single, strict=True):
            np.testing.assert_array_equal(a[k], b)
