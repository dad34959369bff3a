"""Points of a pair by linear least squares, and the covariance that comes with them."""

from __future__ import annotations

import numpy as np

from vo_lib.beyond.stereo_points import stereo_points
from vo_lib.core.camera import StereoCamera
from vo_lib.core.geometry import rotation_from_vector
from vo_lib.core.symmetric import FULL, invert
from vo_lib.core.types import Array

CAMERA = StereoCamera(f=718.856, cx=607.2, cy=185.2, baseline=0.537, width=1241, height=376)


def pair(n: int, noise: float, seed: int = 0) -> tuple[Array, Array, Array]:
    rng = np.random.default_rng(seed)
    depth = rng.uniform(5, 60, n)
    uv = rng.uniform([0, 0], [1241, 376], (n, 2))
    X = np.concatenate([CAMERA.normalise(uv) * depth[:, None], depth[:, None]], axis=1)
    left, right = CAMERA.project(X)
    return X, left + rng.normal(0, noise, (n, 2)), right + rng.normal(0, noise, (n, 2))


def rows(left: Array, right: Array) -> tuple[Array, Array]:
    """Equation (2) of one pair: A P = c of one feature."""
    (x, y), (x_r, y_r) = CAMERA.normalise(left), CAMERA.normalise(right)
    return np.array([[-1, 0, x], [0, -1, y], [-1, 0, x_r], [0, -1, y_r]]), np.array(
        [0, 0, -CAMERA.baseline, 0]
    )


def test_points_covariances_and_rests_are_those_of_the_four_rows() -> None:
    _, left, right = pair(20, 0.5)
    points = stereo_points(CAMERA, left, right)
    depth = np.linspace(3.0, 30.0, 20)
    covariance = points.covariance(depth)[FULL]
    for i in range(20):
        A, c = rows(left[i], right[i])
        X, floor = np.linalg.lstsq(A, c, rcond=None)[:2]
        np.testing.assert_allclose(points.X[:, i], X, rtol=1e-8)
        np.testing.assert_allclose(points.residual_floor[i], floor[0], rtol=1e-5, atol=1e-14)
        expected = depth[i] ** 2 * np.linalg.inv(A.T @ A)
        np.testing.assert_allclose(covariance[:, :, i], expected, rtol=1e-6, atol=1e-9)


def test_turned_points_are_points_in_turned_axes() -> None:
    _, left, right = pair(5, 0.3)
    points = stereo_points(CAMERA, left, right)
    R = rotation_from_vector(np.array([0.1, -0.4, 0.2]))
    depth = np.full(5, 10.0)
    expected = np.einsum("ij,jkn,lk->iln", R, points.covariance(depth)[FULL], R)
    np.testing.assert_allclose(points.rotated(R).covariance(depth)[FULL], expected, atol=1e-9)


def test_exact_pixels_give_the_point() -> None:
    X, left, right = pair(30, 0.0)
    np.testing.assert_allclose(stereo_points(CAMERA, left, right).X, X.T, rtol=1e-9, atol=1e-9)


def test_no_disparity_leaves_the_point_finite_and_unknown_along_its_ray() -> None:
    left = np.array([[700.0, 200.0]])
    points = stereo_points(CAMERA, left, left)
    assert np.isfinite(points.X).all()
    W = invert(points.covariance(np.array([10.0])))
    assert np.isfinite(W).all()
    along, across = points.ray[:, 0] / np.linalg.norm(points.ray[:, 0]), np.array([0.0, 1.0, 0.0])
    assert along @ W[FULL][:, :, 0] @ along < 1e-6 * (across @ W[FULL][:, :, 0] @ across)
