"""The rectified stereo camera: its parameters from calib.txt, projection and back-projection."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .types import Array


@dataclass(frozen=True)
class StereoCamera:
    """A rectified pinhole stereo pair; the left camera is the reference.

    Camera axes: x right, y down, z forward. Pixel centres are at integers.

    Attributes
    ----------
    f : focal length, pixels.
    cx, cy : principal point (u, v), pixels.
    baseline : distance from left to right camera along x, metres, > 0.
    width, height : image size, pixels (0 where unknown).
    """

    f: float
    cx: float
    cy: float
    baseline: float
    width: int = 0
    height: int = 0

    @property
    def size(self) -> tuple[float, float]:
        """Width and height of the image, pixels; if unknown, twice the principal point."""
        return self.width or 2 * self.cx, self.height or 2 * self.cy

    @property
    def K(self) -> Array:
        """Intrinsic matrix, (3, 3)."""
        return np.array([[self.f, 0.0, self.cx], [0.0, self.f, self.cy], [0.0, 0.0, 1.0]])

    def normalise(self, uv: Array) -> Array:
        """Normalised image points (N, 2) of pixels (N, 2): ((u - cx) / f, (v - cy) / f)."""
        return (uv - (self.cx, self.cy)) / self.f

    def project(self, X: Array) -> tuple[Array, Array]:
        """Left and right pixels, (N, 2) each, of points (N, 3) in metres in the left camera's frame.

        Points with z <= 0 have no image; their pixels are NaN.
        """
        z = np.where(X[:, 2] > 0, X[:, 2], np.nan)
        left = self.f * X[:, :2] / z[:, None] + (self.cx, self.cy)
        right = left - np.stack([self.f * self.baseline / z, np.zeros_like(z)], axis=1)
        return left, right

    def back_project(self, left: Array, disparity: Array) -> Array:
        """Points (N, 3) in metres in the left camera's frame, from left pixels (N, 2) and disparities (N,).

        Z = f b / d, with d in pixels. A disparity of zero or less belongs to no point and gives NaN.
        """
        d = np.where(disparity > 0, disparity, np.nan)
        z = self.f * self.baseline / d
        return np.concatenate([self.normalise(left) * z[:, None], z[:, None]], axis=1)

    def triangulate(self, left: Array, right: Array) -> Array:
        """Points (N, 3) from their left and right pixels (N, 2), as in `back_project`."""
        return self.back_project(left, left[:, 0] - right[:, 0])
