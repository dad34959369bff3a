"""Constant angles between the axes of the camera and the axes of the truth, from two paths."""

from __future__ import annotations

from collections.abc import Sequence as Items
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from vo_lib.data.sequence import Sequence
from vo_lib.evaluation.kitti_errors import (
    KITTI_LENGTHS,
    KITTI_STEP,
    KittiErrors,
    SubsequenceProtocol,
    kitti_errors,
)
from vo_lib.geometry.motion import rigid, rotation_from_vector
from vo_lib.geometry.types import Array

MAX_ANGLE_DEG = 1.0
AT_LIMIT_DEG = 1e-6  # an angle that is nearer to the limit than this is at the limit
GRID_SHRINK = 0.6  # width of a grid as a share of the width of the grid before
GRIDS = 40  # the last grid is 1e-9° wide


@dataclass(frozen=True, eq=False)
class TurnedErrors:
    """KITTI errors of an estimated path after a rotation of its axes by `pitch` and `yaw`, degrees.

    In the axes of the truth, a camera with positive pitch points up, a camera with positive yaw points right.
    """

    pitch: float
    yaw: float
    kitti: KittiErrors

    @property
    def at_limit(self) -> list[str]:
        """Names of the angles that are at their limit; empty if the fit found a minimum inside the limits."""
        angles = {"pitch": self.pitch, "yaw": self.yaw}
        return [name for name, angle in angles.items() if is_at_limit(angle)]


def is_at_limit(angle: float) -> bool:
    """Whether a fitted angle, degrees, is at ± `MAX_ANGLE_DEG`."""
    return abs(angle) > MAX_ANGLE_DEG - AT_LIMIT_DEG


def axes_rotation(angles: ArrayLike) -> Array:
    """Rotations C (..., 3, 3) from camera axes to truth axes; `angles` (..., 2): pitch and yaw, degrees."""
    angles = np.radians(angles)
    return rotation_from_vector(np.concatenate([angles, np.zeros_like(angles[..., :1])], axis=-1))


def turn_axes(poses: Array, C: Array) -> Array:
    """Poses C T C⁻¹ (N, 4, 4): the same path for a camera whose axes are rotated by C (3, 3)."""
    turn = rigid(C, np.zeros(3))
    return np.asarray(turn @ poses @ turn.T)


def fit_axes(
    truth: Array, estimate: Array, lengths: Items[float] = KITTI_LENGTHS, step: int = KITTI_STEP
) -> TurnedErrors:
    """Errors after a rotation by the pitch and yaw, up to ± `MAX_ANGLE_DEG`, that minimise TE.

    The translation of inverse(C Δest C⁻¹) Δgt has the length of t_gt - C t_est. The mean length is nearly
    convex in both angles: a search with ever smaller 5×5 grids around the best point finds the minimum.
    """
    errors = kitti_errors(truth, estimate, lengths, step)
    if not len(errors):
        return TurnedErrors(0.0, 0.0, errors)
    t_gt = (np.linalg.inv(truth[errors.first]) @ truth[errors.last])[:, :3, 3]
    t_est = (np.linalg.inv(estimate[errors.first]) @ estimate[errors.last])[:, :3, 3]
    side = np.linspace(-1.0, 1.0, 5)
    grid = np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)
    grid = grid[np.argsort(np.linalg.norm(grid, axis=1), kind="stable")]  # the nearest of equally good points
    best = np.zeros(2)
    width = MAX_ANGLE_DEG
    for _ in range(GRIDS):
        tried = np.clip(best + width * grid, -MAX_ANGLE_DEG, MAX_ANGLE_DEG)
        off = np.linalg.norm(t_gt - t_est @ np.swapaxes(axes_rotation(tried), 1, 2), axis=2)
        best = tried[np.argmin((off / errors.length).mean(axis=1))]
        width *= GRID_SHRINK
    turned = turn_axes(estimate, axes_rotation(best))
    pitch, yaw = best.tolist()
    return TurnedErrors(pitch, yaw, kitti_errors(truth, turned, lengths, step))


def limit_note(where: str) -> str:
    """A sentence on angles at their limit; `where` : these angles, such as "the fitted yaw is"."""
    return (
        f"{where} at the limit of {MAX_ANGLE_DEG:g}°, so a larger angle would lower TE further: TE is not "
        "the smallest TE over all rotations."
    )


def is_raw_drive(sequence: Sequence) -> bool:
    """Whether the truth comes from KITTI's raw data, which has rotated GPS/INS axes."""
    return sequence.name.rpartition("/")[2].startswith("drive_")


def te_and_re(
    sequence: Sequence, poses: Array, measure: SubsequenceProtocol, turned: bool
) -> tuple[float, float]:
    """TE (%) and RE (deg/100 m), NaN for a short path; if `turned`, TE is computed after `fit_axes`."""
    errors = kitti_errors(sequence.true_poses, poses, measure.lengths, measure.step)
    te = errors.te
    re = errors.re
    if turned:
        te = fit_axes(sequence.true_poses, poses, measure.lengths, measure.step).kitti.te
    return np.nan if te is None else te, np.nan if re is None else re
