"""Constant angles between the camera's axes and those the truth was given in, found from two paths.

KITTI's truth is that of an inertial unit brought to the camera by a calibration; what is wrong there turns
every motion. This is a look at the truth, not KITTI's measure.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..core.geometry import rigid, rotation_from_vector
from ..core.types import Array
from .kitti import KITTI_LENGTHS, KITTI_STEP, KittiErrors, kitti_errors

LARGEST = 1.0  # degrees, of each angle
SHRINK, ROUNDS = 0.6, 40  # the last grid is 1e-9° wide


@dataclass(frozen=True)
class TurnedErrors:
    """KITTI errors of an estimate whose axes are turned by `pitch` and `yaw`, degrees.

    In the truth's axes the camera looks up by a positive pitch (y is down), right by a positive yaw.
    """

    pitch: float
    yaw: float
    kitti: KittiErrors

    def to_dict(self) -> dict[str, Any]:
        """Angles and means, for JSON."""
        return {"pitch_deg": self.pitch, "yaw_deg": self.yaw} | self.kitti.to_dict()


def axes_rotation(angles: ArrayLike) -> Array:
    """C (..., 3, 3), camera to truth, of rotation vectors (pitch, yaw, 0): angles (..., 2), degrees."""
    angles = np.radians(angles)
    return rotation_from_vector(np.concatenate([angles, np.zeros_like(angles[..., :1])], axis=-1))


def turn_axes(poses: Array, C: Array) -> Array:
    """Poses C T C⁻¹ (N, 4, 4): the same path as a camera with axes turned by C (3, 3) would write it."""
    turn = rigid(C, np.zeros(3))
    return np.asarray(turn @ poses @ turn.T)


def fit_axes(
    truth: Array, estimate: Array, lengths: Sequence[float] = KITTI_LENGTHS, step: int = KITTI_STEP
) -> TurnedErrors:
    """Errors with the one pitch and yaw that make TE smallest, at most `LARGEST`; 0° without sub-sequences.

    The translation error of inverse(C Δest C⁻¹) Δgt is as long as t_gt - C t_est. Its mean is nearly convex
    in the two angles: a grid of 5×5 around the best so far, each time smaller, finds the least.
    """
    errors = kitti_errors(truth, estimate, lengths, step)
    if not len(errors):
        return TurnedErrors(0.0, 0.0, errors)
    motions = (np.linalg.inv(poses[errors.first]) @ poses[errors.last] for poses in (truth, estimate))
    t_gt, t_est = (motion[:, :3, 3] for motion in motions)
    grid = np.stack(np.meshgrid(*2 * [np.linspace(-1.0, 1.0, 5)]), axis=-1).reshape(-1, 2)
    grid = grid[np.argsort(np.linalg.norm(grid, axis=1), kind="stable")]  # of equals, the nearest is kept
    best, width = np.zeros(2), LARGEST
    for _ in range(ROUNDS):
        tried = np.clip(best + width * grid, -LARGEST, LARGEST)
        off = np.linalg.norm(t_gt - t_est @ np.swapaxes(axes_rotation(tried), 1, 2), axis=2)
        best = tried[np.argmin((off / errors.length).mean(axis=1))]
        width *= SHRINK
    turned = turn_axes(estimate, axes_rotation(best))
    pitch, yaw = best.tolist()
    return TurnedErrors(pitch, yaw, kitti_errors(truth, turned, lengths, step))
