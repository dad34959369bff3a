"""The surface around a feature as a plane of disparity, and the warp of a window on it (chapter 1).

A window on a slanted surface, such as the street, looks different in each image. On a plane, disparity is
linear in u and v, so three numbers determine the warp: the disparity at the feature and its two slopes.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from ..geometry.camera import StereoCamera
from ..geometry.symmetric import COLUMN, ROW, invert, times
from ..geometry.types import Array

# (H / 2, W / 2), pixels of the full image; not positive where unknown.
CoarseDisparity = NDArray[np.float32]

# Largest slope, pixels per pixel; steeper surfaces are viewed too obliquely for an estimate.
MAX_SLOPE = 0.6
# Offsets of the pixels, at half size, to which a plane is fitted; neighbouring pixels are nearly redundant.
# The middle is excluded, so that a feature on an outline has half of its square on either side.
SURROUNDING_OFFSETS = np.array([-4, -2, -1, 1, 2, 4])
# Largest residual of a disparity on the plane, pixels of the full image; larger in the first round.
SURFACE_RESIDUAL_PX = 0.75
FIRST_SURFACE_RESIDUAL_PX = 3.0
# Smallest share of pixels on the plane for an estimate of its slope.
MIN_KNOWN_SHARE = 0.3
# Added to the normal matrix of a plane (disparity, two slopes), as xx, yy, zz, xy, xz, yz: so the slopes of a
# square with few known pixels stay small.
PLANE_DAMPING = np.array([1e-3, 4.0, 4.0, 0.0, 0.0, 0.0])


class Surface(NamedTuple):
    """Planes of disparity around N features of a left image.

    Attributes
    ----------
    slope : (N, 2) change of the disparity along u and v, pixels per pixel; 0 where unknown.
    disparity : (N,) disparity of the plane at the feature, pixels; NaN if unknown.
    share : (N,) share of the neighbourhood on the plane, in [0, 1].
    """

    slope: Array
    disparity: Array
    share: Array


def coarse_disparity(left: NDArray[np.uint8], right: NDArray[np.uint8], largest: int) -> CoarseDisparity:
    """Disparity (H / 2, W / 2) by block matching at half size, pixels of the full image.

    It is not positive where it is unknown.

    left, right : (H, W) images; largest : largest disparity that is searched, pixels of the full image.
    """
    # At half size, in steps of 16, as the matcher requires.
    searched = 16 * math.ceil(largest / 32)
    # Unlike the half image of `corners`, cv2.pyrDown has its pixel k at pixel 2 k of the full image. Block
    # matching has no result in its first columns, as many as are searched, so the images are padded.
    small_left = cv2.copyMakeBorder(cv2.pyrDown(left), 0, 0, searched, 0, cv2.BORDER_REPLICATE)
    small_right = cv2.copyMakeBorder(cv2.pyrDown(right), 0, 0, searched, 0, cv2.BORDER_REPLICATE)
    matcher = cv2.StereoBM.create(numDisparities=searched, blockSize=9)
    # A uniqueness test would take half of the time; the loop check rejects wrong disparities anyway.
    matcher.setUniquenessRatio(0)
    # The matcher's unit is a sixteenth of a pixel at half size, so an eighth of a pixel of the full image.
    return np.asarray(matcher.compute(small_left, small_right)[:, searched:] / np.float32(8.0))


def fit_surface(coarse: CoarseDisparity, uv: Array, disparity: Array) -> Surface:
    """The plane around each feature, from a coarse disparity map.

    Parameters
    ----------
    coarse : (H / 2, W / 2) disparity in pixels of the full image; not positive where unknown.
    uv : (N, 2) pixels of the full left image. disparity : (N,) disparities of the features, pixels.

    The fit is by least squares: first over the pixels with a disparity near the feature's, then over the
    pixels with a disparity near the plane's.
    """
    du = np.tile(SURROUNDING_OFFSETS, len(SURROUNDING_OFFSETS))
    dv = np.repeat(SURROUNDING_OFFSETS, len(SURROUNDING_OFFSETS))
    column = np.clip(np.rint(uv[:, :1] / 2).astype(np.intp) + du, 0, coarse.shape[1] - 1)
    row = np.clip(np.rint(uv[:, 1:] / 2).astype(np.intp) + dv, 0, coarse.shape[0] - 1)
    around = np.take(coarse, row * coarse.shape[1] + column)
    valid = around > 0
    # Relative to the feature's disparity, so that single precision is sufficient.
    d = (around - disparity[:, None]).astype(np.float32)
    basis = np.stack([np.ones(len(du)), 2.0 * du, 2.0 * dv], axis=1).astype(np.float32)
    products = basis[:, ROW] * basis[:, COLUMN]  # of the normal matrix, xx, yy, zz, xy, xz, yz
    near = valid & (np.abs(d) < FIRST_SURFACE_RESIDUAL_PX)
    for _ in range(2):
        weight = near.astype(np.float32)
        normal = (weight @ products).T + PLANE_DAMPING[:, None]
        right_side = np.asarray(((weight * d) @ basis).T, np.float64)
        plane = times(invert(normal), right_side)  # (3, N): disparity less the feature's, and both slopes
        near = valid & (np.abs(d - plane.T.astype(np.float32) @ basis.T) < SURFACE_RESIDUAL_PX)
    share = near.mean(axis=1)
    at_feature = np.where(near.any(axis=1), plane[0] + disparity, np.nan)
    slope = plane[1:].T
    unknown = (share < MIN_KNOWN_SHARE) | (np.abs(slope).max(axis=1, initial=0) > MAX_SLOPE)
    return Surface(np.where(unknown[:, None], 0.0, slope), at_feature, share)


def stereo_warp(slope: Array) -> Array:
    """Warps du_r/du_l (N, 2, 2) of small windows from the left to the right image."""
    # u_r = u - d(u, v), and the rows are equal.
    warp = np.tile(np.eye(2), (len(slope), 1, 1))
    warp[:, 0] -= slope
    return warp


def right_slope(slope: Array) -> Array:
    """The slope (N, 2) of the disparity in the right image, pixels per pixel of the right image."""
    # Since u_r = u - d, 1 px along u in the left image is 1 - slope_u px in the right one. A step along v at
    # a fixed u_r changes u, too, and this divides slope_v by the same number.
    return slope / np.maximum(1.0 - slope[:, :1], 1.0 - MAX_SLOPE)


def motion_warp(
    camera: StereoCamera, uv: Array, disparity: Array, slope: Array, R_cp: Array, t_cp: Array
) -> Array:
    """Warps du_c/du_p (N, 2, 2) of small windows on surfaces, due to a motion of the camera.

    Parameters
    ----------
    uv, disparity, slope : (N, 2), (N,), (N, 2), of features of the previous image, pixels.
    R_cp, t_cp : motion of the image's camera, (3, 3), and (3,) metres.

    With x = (u, v, 1) normalised and the inverse depth ρ = d / (f b), the point has the direction R x + ρ t
    in the current frame. The warp is the derivative of this direction along the image, with ρ linear on the
    plane.
    """
    fb = camera.f * camera.baseline
    x = np.concatenate([camera.normalise(uv), np.ones((len(uv), 1))], axis=1)
    P = x @ R_cp.T + (disparity / fb)[:, None] * t_cp
    # (N, 3, 2): derivative of the direction along u and v, pixels.
    dP = R_cp[:, :2] / camera.f + t_cp[:, None] * slope[:, None, :] / fb
    with np.errstate(divide="ignore", invalid="ignore"):
        # The derivative of the quotient (P_x, P_y) / P_z.
        warp = camera.f * (dP[:, :2] * P[:, 2:, None] - P[:, :2, None] * dP[:, 2:]) / P[:, 2, None, None] ** 2
        # An implausible warp, or NaN for a point behind the camera, becomes the identity.
        deviation = np.abs(warp - np.eye(2)).max(axis=(1, 2), initial=0)
        return np.where((deviation < MAX_SLOPE)[:, None, None], warp, np.eye(2))
