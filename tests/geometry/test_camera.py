"""Back-projection is the inverse of projection."""

from __future__ import annotations

import numpy as np

from vo_lib.geometry.camera import StereoCamera

CAMERA = StereoCamera(f=700.0, cx=600.0, cy=180.0, baseline=0.54, width=1241, height=376)


def test_back_projection_undoes_projection() -> None:
    X = np.random.default_rng(0).uniform([-10, -2, 3], [10, 2, 60], (100, 3))
    left, right = CAMERA.project(X)
    np.testing.assert_allclose(CAMERA.back_project(left, left[:, 0] - right[:, 0]), X, rtol=1e-9)
    np.testing.assert_array_equal(
        CAMERA.triangulate(left, right), CAMERA.back_project(left, left[:, 0] - right[:, 0])
    )
    np.testing.assert_allclose(left[:, 1], right[:, 1])


def test_normalised_points_are_rays_of_unit_depth() -> None:
    X = np.array([[1.0, -0.5, 10.0]])
    np.testing.assert_allclose(CAMERA.normalise(CAMERA.project(X)[0]), [[0.1, -0.05]])
    np.testing.assert_allclose(CAMERA.K @ [0.1, -0.05, 1.0], [*CAMERA.project(X)[0][0], 1.0])


def test_points_behind_the_camera_are_nan() -> None:
    left, right = CAMERA.project(np.array([[0.0, 0.0, -1.0]]))
    assert np.isnan(left).all()
    assert np.isnan(right).all()
    assert np.isnan(CAMERA.back_project(np.array([[600.0, 180.0]]), np.array([0.0]))).all()


def test_unknown_image_size_is_twice_the_principal_point() -> None:
    sizes = [CAMERA.size, StereoCamera(f=700.0, cx=600.0, cy=180.0, baseline=0.54).size]
    assert sizes == [(1241, 376), (1200, 360)]
