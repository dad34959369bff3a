"""A stereo camera with given faults, computed only from the pinhole equations.

The matches are independent of the library: a point (X, Y, Z) has the image u = f X / Z + cx, v = f Y / Z + cy
plus the faults.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from vo_lib.geometry.camera import StereoCamera
from vo_lib.geometry.matches import StereoMatches
from vo_lib.geometry.types import Array

F, CX, CY, B = 700.0, 600.0, 180.0, 0.5
CAMERA = StereoCamera(f=F, cx=CX, cy=CY, baseline=B, width=1200, height=360)
Field = Callable[[Array, Array], Array]


def none(x: Array, y: Array) -> Array:
    return np.zeros_like(x)


@dataclass(frozen=True)
class Faults:
    """Calibration errors of both cameras, pixels: functions of (x, y) for disparity and row difference."""

    disparities: Field = none
    rows: Field = none
    p1: float = 0.0
    p2: float = 0.0
    k1: float = 0.0


# The approximate errors of sequences 00 and 01 of KITTI.
KITTI = Faults(
    lambda x, y: -0.6 + 0.5 * x**2 + 6.3 * y**2 + 0.3 * x * y - 3.5 * x**4 - 0.4 * x - 0.3 * y,
    lambda x, y: 0.1 + 0.3 * x - 0.4 * y - 5.8 * x * y + 0.2 * x**2 + 0.5 * y**2,
)


def yaw_matrix(angle: float) -> Array:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])


def pair(X: Array, faults: Faults, noise: float, rng: np.random.Generator) -> tuple[Array, Array]:
    """Left and right pixels (N, 2) of points (N, 3)."""

    def distorted(x: Array, y: Array, half: float) -> tuple[Array, Array]:
        r2 = x * x + y * y
        radial = faults.k1 * r2
        u = F * x + CX + faults.p1 * 2 * x * y + faults.p2 * (r2 + 2 * x * x) + radial * x
        v = F * y + CY + faults.p1 * (r2 + 2 * y * y) + faults.p2 * 2 * x * y + radial * y
        return u + half * faults.disparities(x, y), v + half * faults.rows(x, y)

    from_right = X - (B, 0.0, 0.0)
    (x, y, _), (x_r, y_r, _) = (place.T / place[:, 2] for place in (X, from_right))
    left, right = np.stack(distorted(x, y, 0.5), axis=1), np.stack(distorted(x_r, y_r, -0.5), axis=1)
    return left + rng.normal(0, noise, left.shape), right + rng.normal(0, noise, right.shape)


def drive(
    frames: int, faults: Faults, noise: float = 0.2, points: int = 300, step: float = 1.0
) -> Iterator[tuple[StereoMatches, Array, Array]]:
    """Matches, R_cp and t_cp of a camera that turns and moves `step` metres forward per frame."""
    rng = np.random.default_rng(11)
    for i in range(frames):
        R_cp, t_cp = yaw_matrix(0.01 * np.sin(i / 5)), np.array([0.0, 0.0, -step])
        z = rng.uniform(5.0, 45.0, points)
        x, y = rng.uniform(-0.8, 0.8, points), rng.uniform(-0.25, 0.25, points)
        X_p = np.stack([x * z, y * z, z], axis=1)
        before, now = (pair(X, faults, noise, rng) for X in (X_p, X_p @ R_cp.T + t_cp))
        whole = np.arange(points)
        yield StereoMatches(*before, *now, whole * 0 + 1, np.ones(points), whole), R_cp, t_cp
