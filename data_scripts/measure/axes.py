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

MAX_ANGLE_DEG = 3.0  # of a fit whose angles are well determined
NARROW_DEG = 1.0  # of every other fit: noise or drift may be the smallest TE at any angle
WELL_DETERMINED = 0.1  # relative rise of TE by one further degree, in every direction
AT_LIMIT_DEG = 1e-6  # an angle that is nearer to the limit than this is at the limit
GRID_SHRINK = 0.6  # width of a grid as a share of the width of the grid before
GRIDS = 40  # the last grid is 1e-9° wide


@dataclass(frozen=True, eq=False)
class TurnedErrors:
    """KITTI errors of an estimated path after a rotation of its axes by `pitch` and `yaw`, degrees.

    In the axes of the truth, a camera with positive pitch points up, a camera with positive yaw points right.
    `limit` : largest angle that the fit allowed, degrees.
    """

    pitch: float
    yaw: float
    kitti: KittiErrors
    limit: float = MAX_ANGLE_DEG

    @property
    def at_limit(self) -> list[str]:
        """Names of the angles that are at their limit; empty if the fit found a minimum inside the limits."""
        angles = {"pitch": self.pitch, "yaw": self.yaw}
        return [name for name, angle in angles.items() if abs(angle) > self.limit - AT_LIMIT_DEG]

    @property
    def limit_words(self) -> str:
        """A sentence on angles at their limit; empty if there are none."""
        if not self.at_limit:
            return ""
        verb = "is" if len(self.at_limit) == 1 else "are"
        angles = " and ".join(self.at_limit)
        return (
            f"the fitted {angles} {verb} at the limit of {self.limit:g}°, so TE is not the smallest TE over "
            f"all rotations. Up to {MAX_ANGLE_DEG:g}° are allowed only where one further degree raises TE by "
            f"{100 * WELL_DETERMINED:.0f} % or more in every direction."
        )


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
    """Errors after a rotation by the pitch and yaw that minimise TE.

    The angles are up to ± `MAX_ANGLE_DEG` if they are well determined: if they are inside this limit, and one
    further degree raises TE by `WELL_DETERMINED` or more in every direction. Otherwise, they are up to
    ± `NARROW_DEG`. A rotation by a constant angle per metre looks like rotated axes: see `fit_of_halves`.
    """
    errors = kitti_errors(truth, estimate, lengths, step)
    if not len(errors):
        return TurnedErrors(0.0, 0.0, errors)
    search = _Search(truth, estimate, errors)
    limit = MAX_ANGLE_DEG
    best = search.best(limit)
    if not search.is_well_determined(best, limit):
        limit = NARROW_DEG
        best = search.best(limit)
    turned = turn_axes(estimate, axes_rotation(best))
    pitch, yaw = best.tolist()
    return TurnedErrors(pitch, yaw, kitti_errors(truth, turned, lengths, step), limit)


def fit_of_halves(
    truth: Array, estimate: Array, lengths: Items[float] = KITTI_LENGTHS, step: int = KITTI_STEP
) -> list[tuple[float, float]]:
    """Pitch and yaw, degrees, of the sub-sequences that start first, and of those that start last.

    Axes that are rotated by a constant angle give equal angles. Angles that differ are partly the drift of
    the estimate or an error of the truth, which the fit of the whole path removes from TE as well. Empty for
    fewer than two sub-sequences.
    """
    errors = kitti_errors(truth, estimate, lengths, step)
    if len(errors) < 2:
        return []
    angles = []
    for half in np.array_split(np.arange(len(errors)), 2):
        pitch, yaw = _Search(truth, estimate, errors[half]).best(MAX_ANGLE_DEG).tolist()
        angles.append((pitch, yaw))
    return angles


def _grid() -> Array:
    """The points (25, 2) of a grid from -1 to 1; the first of equally good points is the nearest to 0."""
    side = np.linspace(-1.0, 1.0, 5)
    points = np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)
    return np.asarray(points[np.argsort(np.linalg.norm(points, axis=1), kind="stable")])


GRID = _grid()


class _Search:
    """The pitch and yaw that minimise TE over the sub-sequences of some errors.

    The translation of inverse(C Δest C⁻¹) Δgt has the length of t_gt - C t_est. The mean length is nearly
    convex in both angles: a search with ever smaller 5×5 grids around the best point finds the minimum.
    """

    def __init__(self, truth: Array, estimate: Array, errors: KittiErrors):
        self.length = errors.length
        self.t_gt = _translations(truth, errors)
        self.t_est = _translations(estimate, errors)

    def te(self, angles: Array) -> Array:
        """TE, as a share of the length, for pitch and yaw (A, 2) in degrees: (A,)."""
        off = self.t_gt - self.t_est @ np.swapaxes(axes_rotation(angles), 1, 2)
        return np.asarray((np.linalg.norm(off, axis=2) / self.length).mean(axis=1))

    def best(self, limit: float) -> Array:
        """The pitch and yaw (2,), up to ± `limit` degrees, with the smallest TE."""
        best = np.zeros(2)
        width = limit
        for _ in range(GRIDS):
            tried = np.clip(best + width * GRID, -limit, limit)
            best = tried[np.argmin(self.te(tried))]
            width *= GRID_SHRINK
        return best

    def is_well_determined(self, best: Array, limit: float) -> bool:
        """Whether the best angles are inside the limit, and a further degree raises TE in every direction."""
        if np.abs(best).max() > limit - AT_LIMIT_DEG:
            return False
        smallest = self.te(best[None])
        around = self.te(best + np.array([(1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0)]))
        return bool((around >= (1.0 + WELL_DETERMINED) * smallest).all())


def _translations(poses: Array, errors: KittiErrors) -> Array:
    """Translations (S, 3) of a path (N, 4, 4) over the sub-sequences of some errors."""
    motions = np.linalg.inv(poses[errors.first]) @ poses[errors.last]
    return np.asarray(motions[:, :3, 3])


def is_raw_drive(sequence: Sequence) -> bool:
    """Whether the truth comes from KITTI's raw data, which has rotated GPS/INS axes."""
    return sequence.name.rpartition("/")[2].startswith("drive_")


def te_and_re(
    sequence: Sequence, poses: Array, protocol: SubsequenceProtocol, turned: bool
) -> tuple[float, float]:
    """TE (%) and RE (deg/100 m), NaN for a short path; if `turned`, TE is computed after `fit_axes`."""
    errors = kitti_errors(sequence.true_poses, poses, protocol.lengths, protocol.step)
    te = errors.te
    if turned:
        te = fit_axes(sequence.true_poses, poses, protocol.lengths, protocol.step).kitti.te
    return number_or_nan(te), number_or_nan(errors.re)


def number_or_nan(value: float | None) -> float:
    """The value, or NaN without one."""
    return np.nan if value is None else value
