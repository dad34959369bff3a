"""Robust motion from points and their pixels in a stereo pair."""

from __future__ import annotations

import numpy as np

from vo_lib.geometry.camera import StereoCamera
from vo_lib.geometry.motion import rotation_from_vector
from vo_lib.geometry.reprojection import fit_motion, linearise
from vo_lib.geometry.types import Array

CAMERA = StereoCamera(f=700.0, cx=600.0, cy=180.0, baseline=0.54, width=1241, height=376)
R_CP, T_CP = rotation_from_vector(np.array([0.02, -0.15, 0.05])), np.array([0.1, -0.05, -1.2])


def observations(n: int = 60) -> tuple[Array, Array, Array]:
    """Points (n, 3) of the previous frame, and their pixels (n, 2) in the current pair."""
    X_p = np.random.default_rng(3).uniform([-8, -2, 6], [8, 2, 40], (n, 3))
    return X_p, *CAMERA.project(X_p @ R_CP.T + T_CP)


def test_fit_motion_tolerates_outliers() -> None:
    X_p, left, right = observations()
    left[:20] += np.random.default_rng(4).uniform(30, 90, (20, 2))
    R, t, residual = fit_motion(CAMERA, X_p, left, right, np.eye(3), np.zeros(3), scale=0.5)
    np.testing.assert_allclose(R, R_CP, atol=2e-4)
    np.testing.assert_allclose(t, T_CP, atol=5e-3)
    assert residual[20:].max() < 0.3
    assert residual[:20].min() > 20.0


def test_residual_is_the_norm_of_four_coordinates() -> None:
    X_p, left, right = observations()
    left[:, 0] += 3.0
    right[:, 1] -= 4.0
    _, _, residual = fit_motion(CAMERA, X_p, left, right, R_CP, T_CP, scale=1e6, iterations=0)
    np.testing.assert_allclose(residual, 5.0, rtol=1e-9)


def test_points_behind_the_camera_have_infinite_residuals() -> None:
    X_p, left, right = observations()
    X_p[0] = [0.0, 0.0, -5.0]
    _, _, residual = fit_motion(CAMERA, X_p, left, right, R_CP, T_CP, scale=1.0, iterations=0)
    assert residual[0] == np.inf
    assert residual[1:].max() < 1e-6


def test_batched_linearisation_equals_single_ones() -> None:
    rng = np.random.default_rng(2)
    rotated = rng.uniform([-5, -2, 6], [5, 2, 30], (3, 4, 3))
    t, measured = rng.normal(size=(3, 1, 3)), rng.uniform(-300, 300, (3, 4, 4))
    batch = linearise(CAMERA, rotated, t, measured)
    for k in range(3):
        single = linearise(CAMERA, rotated[k], t[k, 0], measured[k])
        for a, b in zip(batch, single, strict=True):
            np.testing.assert_array_equal(a[k], b)
