"""Windows on slanted surfaces: their warp, and the accuracy of their matches."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from conftest import texture

from vo_lib.geometry.camera import StereoCamera
from vo_lib.geometry.motion import rotation_from_vector
from vo_lib.geometry.types import Array, Image
from vo_lib.kit.alignment import track_warped
from vo_lib.kit.surface import fit_surface, motion_warp, right_slope, stereo_warp

CAMERA = StereoCamera(f=700.0, cx=300.0, cy=100.0, baseline=0.5, width=600, height=200)
R = rotation_from_vector(np.array([0.01, 0.03, -0.02]))
T = np.array([0.1, -0.05, -1.2])
# Disparity 20 px at (350, 120), changing along u and v: a slanted wall.
SLOPE = np.array([0.1, 0.3])
WALL = texture(np.random.default_rng(0), 200, 600, 2.5)


def disparity_at(uv: Array) -> Array:
    return np.asarray(20.0 + (uv - (350.0, 120.0)) @ SLOPE)


def test_surface_of_a_plane_has_its_slope() -> None:
    v, u = np.mgrid[0:200:2, 0:600:2].astype(float)
    coarse = disparity_at(np.stack([u, v], axis=-1)).astype(np.float32)
    uv = np.array([[350.0, 120.0], [330.0, 110.0]])
    surface = fit_surface(coarse, uv, disparity_at(uv))
    np.testing.assert_allclose(surface.slope, [SLOPE, SLOPE], atol=0.01)
    np.testing.assert_allclose(surface.disparity, disparity_at(uv), atol=0.1)
    np.testing.assert_allclose(surface.share, 1.0)


@pytest.mark.parametrize(
    ("beside", "column", "share"), [(14.5, 178, (0.6, 1.0)), (40.0, 175, (0.3, 0.6)), (-1.0, 0, (0.0, 0.0))]
)
def test_other_depths_lower_the_share_of_a_surface(
    beside: float, column: int, share: tuple[float, float]
) -> None:
    """The disparities beside the feature are 4.5 px larger, 30 px larger (an outline), or missing."""
    coarse = np.full((100, 300), 10.0, np.float32)
    coarse[:, column:] = beside
    surface = fit_surface(coarse, np.array([[350.0, 120.0]]), np.array([10.0]))
    np.testing.assert_allclose(surface.slope, 0.0, atol=0.005)
    np.testing.assert_allclose(surface.disparity, 10.0 if beside > 0 else np.nan, atol=0.05)
    assert share[0] <= surface.share[0] <= share[1]


@pytest.mark.parametrize("right", [False, True])
def test_warp_is_the_derivative_of_the_motion(right: bool) -> None:
    """The right camera views the same wall from a position one baseline to the right."""
    slope, t = SLOPE, T
    place = np.array([350.0, 120.0])
    if right:
        slope = right_slope(SLOPE[None])[0]
        t = T + CAMERA.baseline * (R[:, 0] - (1.0, 0.0, 0.0))
        place = place - (20.0, 0.0)

    def moved(uv: Array) -> Array:
        X = CAMERA.back_project(uv, 20.0 + (uv - place) @ slope)
        return CAMERA.project(X @ R.T + t)[0]

    step = 0.5 * np.eye(2)
    numeric = np.stack([(moved(place + d[None]) - moved(place - d[None]))[0] for d in step], axis=1)
    A = motion_warp(CAMERA, place[None], np.array([20.0]), slope[None], R, t)
    np.testing.assert_allclose(A[0], numeric, atol=1e-4)


def test_warped_windows_are_more_accurate_on_slopes() -> None:
    left = WALL
    v, u = np.mgrid[0:200, 0:600].astype(np.float32)
    # The right image: a pixel u_r shows the left pixel u with u - d(u, v) = u_r.
    source = (u + 20.0 - 350.0 * SLOPE[0] + (v - 120.0) * SLOPE[1]) / (1.0 - SLOPE[0])
    right = np.asarray(cv2.remap(left, source.astype(np.float32), v, cv2.INTER_CUBIC), np.uint8)
    rng = np.random.default_rng(1)
    uv = rng.uniform([200, 40], [450, 160], (200, 2))
    true = uv - disparity_at(uv)[:, None] * (1.0, 0.0)
    start = true + rng.uniform(-0.7, 0.7, true.shape)
    square, bent = (error_of(left, right, uv, start, slope, true) for slope in (0.0 * SLOPE, SLOPE))
    assert bent < 0.03
    assert bent < 0.3 * square


def error_of(left: Image, right: Image, uv: Array, start: Array, slope: Array, true: Array) -> float:
    """Median error of the matched positions, pixels, with windows warped by a slope (2,)."""
    result, difference = track_warped(left, right, uv, start, stereo_warp(np.tile(slope, (len(uv), 1))), 11)
    good = np.isfinite(difference)
    assert good.mean() > 0.9
    return float(np.median(np.linalg.norm(result - true, axis=1)[good]))
