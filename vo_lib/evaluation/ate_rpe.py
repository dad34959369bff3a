"""Absolute (ATE) and relative (RPE) trajectory error, and the alignment of trajectories.

Definitions: Sturm et al., IROS 2012. All poses are `T_w_c`, (N, 4, 4), metres.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum
from typing import Any, Literal

import numpy as np

from ..errors import DataError
from ..geometry.motion import rotation_angle
from ..geometry.types import Array, Index
from .kitti_errors import frames_of_truth, motion_error, trajectory_distances


class Alignment(Enum):
    """Transformation of the estimate before the comparison of positions."""

    NONE = "none"
    ORIGIN = "origin"  # equal first poses
    SE3 = "se3"  # best rotation and translation
    SIM3 = "sim3"  # best rotation, translation and scale


@dataclass(frozen=True, eq=False)
class AbsoluteError:
    """ATE: distances (N,), metres, between true and estimated positions after the `alignment`.

    scale : factor by which the alignment has multiplied the estimated positions.
    """

    alignment: Alignment
    scale: float
    distance: Array

    def to_dict(self) -> dict[str, Any]:
        """Alignment, scale and statistics, for JSON."""
        return {"alignment": self.alignment.value, "scale": self.scale} | _statistics(self.distance, "m")


@dataclass(frozen=True)
class Delta:
    """Interval of the relative error: its size in the unit "frames", or "m" along the true path.

    Raises `DataError` unless the size is a positive number, and a whole one for frames.
    """

    size: float = 1
    unit: Literal["frames", "m"] = "frames"

    def __post_init__(self) -> None:
        if self.unit not in ("frames", "m"):
            raise DataError(f"unit {self.unit!r} of an interval: expected frames or m")
        is_whole = self.unit == "m" or float(self.size).is_integer()
        if not (0 < self.size < math.inf and is_whole):  # also refuses NaN
            raise DataError(
                f"an interval of {self.size:g} {self.unit}: expected 1, 2, … frames, or metres > 0"
            )


ONE_FRAME = Delta()


@dataclass(frozen=True, eq=False)
class RelativeError:
    """RPE over S intervals `delta`: translation errors (S,), metres, and rotation errors (S,), radians."""

    delta: Delta
    translation: Array
    rotation: Array

    def to_dict(self) -> dict[str, Any]:
        """Interval and statistics, for JSON; the statistics of a path shorter than the interval are None."""
        return {
            f"delta_{self.delta.unit}": self.delta.size,
            "translation": _statistics(self.translation, "m"),
            "rotation": _statistics(np.degrees(self.rotation), "deg"),
        }


def rmse(errors: Array) -> float | None:
    """Root of the mean square of errors (N,); None without errors."""
    return float(np.sqrt(np.mean(np.square(errors)))) if len(errors) else None


def _statistics(errors: Array, unit: str) -> dict[str, float | None]:
    """Root of the mean square, mean, median and maximum of errors (N,), for JSON; None without errors."""
    kinds: dict[str, Any] = {"rmse": rmse, "mean": np.mean, "median": np.median, "max": np.max}
    return {f"{name}_{unit}": float(kind(errors)) if len(errors) else None for name, kind in kinds.items()}


def align(truth: Array, estimate: Array, alignment: Alignment) -> tuple[Array, float]:
    """The estimate aligned with the truth.

    SE3 and SIM3 minimise the squared distances of positions (Umeyama 1991, equations 38-43). On a straight
    path the rotation about the path is undetermined: distances are minimal, but orientations are arbitrary.

    Returns
    -------
    (N, 4, 4) aligned poses, and the scale applied to the estimate's positions (1 except for SIM3).

    Raises
    ------
    DataError : as `frames_of_truth`.
    """
    frames_of_truth(truth, estimate)
    if alignment is Alignment.NONE:
        return estimate, 1.0
    if alignment is Alignment.ORIGIN:
        return np.asarray(truth[0] @ np.linalg.inv(estimate[0]) @ estimate), 1.0
    # Umeyama's names: x is moved onto y, their covariance is U diag(D) Vᵀ, and S keeps R from mirroring.
    y = truth[:, :3, 3]
    x = estimate[:, :3, 3]
    y_mean = y.mean(axis=0)
    x_mean = x.mean(axis=0)
    U, D, Vt = np.linalg.svd((y - y_mean).T @ (x - x_mean) / len(x))
    S = np.array([1.0, 1.0, np.linalg.det(U) * np.linalg.det(Vt)])
    R = (U * S) @ Vt
    spread = float(np.mean(np.sum((x - x_mean) ** 2, axis=1)))
    scale = float(D @ S) / spread if alignment is Alignment.SIM3 and spread > 0 else 1.0
    aligned = estimate.copy()
    aligned[:, :3, :3] = R @ estimate[:, :3, :3]
    aligned[:, :3, 3] = scale * (x - x_mean) @ R.T + y_mean
    return aligned, scale


def absolute_error(truth: Array, estimate: Array, alignment: Alignment = Alignment.SE3) -> AbsoluteError:
    """ATE: distances between the positions of two paths (N, 4, 4) after an alignment; raises as `align`."""
    aligned, scale = align(truth, estimate, alignment)
    return AbsoluteError(alignment, scale, np.linalg.norm(aligned[:, :3, 3] - truth[:, :3, 3], axis=1))


def relative_error(
    truth: Array, estimate: Array, delta: Delta = ONE_FRAME, frames: Index | None = None
) -> RelativeError:
    """RPE over consecutive intervals, each a pair of poses, without an alignment.

    For an interval of n frames, the pairs are the frames 0 and n, n and 2n, … (evo's default). For metres, a
    pair ends at the first pose at least so far ahead along the true path, and the next pair starts at this
    pose (evo: `--pairs_from_reference`).

    Parameters
    ----------
    truth : (N, 4, 4) poses. estimate : (M, 4, 4) poses.
    frames : (M,) increasing numbers of the true poses to which the estimated poses belong; None: all. Both
        frames of a pair have an estimate.

    Raises
    ------
    DataError : truth and estimate do not fit (`frames_of_truth`).
    """
    frames = frames_of_truth(truth, estimate, frames)
    by_frames = delta.unit == "frames"
    at = frames.astype(np.float64) if by_frames else trajectory_distances(truth)[frames]
    starts, ends = interval_pairs(at, delta.size, exact=by_frames)
    error = motion_error(truth[frames], estimate, starts, ends)
    return RelativeError(delta, np.linalg.norm(error[:, :3, 3], axis=1), rotation_angle(error[:, :3, :3]))


def interval_pairs(at: Array, delta: float, exact: bool) -> tuple[Index, Index]:
    """First and last places of pairs that are at least `delta` apart; a pair starts where one ends.

    at : (M,) frame number of each pose, or metres from the first pose to it along the path. exact : whether
    pairs are exactly `delta` apart; where no pose is, a pair starts at the next pose for which one is.
    """
    pairs = list[tuple[int, int]]()
    start = 0
    while start < len(at):
        # An interval may be too small to change the sum, but a pair always ends farther on than it starts.
        least = max(at[start] + delta, np.nextafter(at[start], np.inf))
        end = int(np.searchsorted(at, least))
        if end < len(at) and (not exact or at[end] == least):
            pairs.append((start, end))
            start = end
        else:
            start += 1
    starts, ends = np.array(pairs, np.intp).reshape(-1, 2).T
    return starts, ends
