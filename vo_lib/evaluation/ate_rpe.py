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


class Alignment(Enum):
    """Transformation of the estimate before the comparison of positions."""

    NONE = "none"
    ORIGIN = "origin"  # equal first poses
    SE3 = "se3"  # best rotation and translation
    SIM3 = "sim3"  # best rotation, translation and scale

    @property
    def words(self) -> str:
        """Text for the note of a table."""
        return "without alignment" if self is Alignment.NONE else f"with {self.name} alignment"


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
        is_positive = 0 < self.size < math.inf  # not so for NaN
        if self.unit == "frames" and not (is_positive and self.size == int(self.size)):
            raise DataError(f"an interval of {self.size:g} frames: expected 1 frame, 2 frames, …")
        if not is_positive:
            raise DataError(f"an interval of {self.size:g} m: expected a positive number of metres")

    @property
    def words(self) -> str:
        """Text for the note of a table."""
        return "from frame to frame" if self == ONE_FRAME else f"over {self.size:g} {self.unit}"


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
    empty = len(errors) == 0
    return {
        f"rmse_{unit}": rmse(errors),
        f"mean_{unit}": None if empty else float(np.mean(errors)),
        f"median_{unit}": None if empty else float(np.median(errors)),
        f"max_{unit}": None if empty else float(np.max(errors)),
    }


def motion_error(truth: Array, estimate: Array, first: Index, last: Index) -> Array:
    """Error motions inverse(Δest) Δgt, (S, 4, 4), with Δ = inverse(T[first]) T[last].

    truth, estimate : (N, 4, 4) poses; first, last : (S,) numbers of poses.
    """
    # A general inverse: rotations in files are orthonormal only to 1e-7, so the transpose would cause
    # rotation errors of up to 0.05°.
    true_motion = np.linalg.inv(truth[first]) @ truth[last]
    estimated_motion = np.linalg.inv(estimate[first]) @ estimate[last]
    return np.asarray(np.linalg.inv(estimated_motion) @ true_motion)


def align(truth: Array, estimate: Array, alignment: Alignment) -> tuple[Array, float]:
    """The estimate aligned with the truth.

    SE3 and SIM3 minimise the squared distances of positions (Umeyama 1991, equations 38-43). On a straight
    path the rotation about the path is undetermined: distances are minimal, but orientations are arbitrary.

    Returns
    -------
    (N, 4, 4) aligned poses, and the scale applied to the estimate's positions (1 except for SIM3).

    Raises
    ------
    DataError : as `check_pair`.
    """
    check_pair(truth, estimate)
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
    truth: Array,
    estimate: Array,
    delta: Delta = ONE_FRAME,
    path: Array | None = None,
    frames: Index | None = None,
) -> RelativeError:
    """RPE over consecutive intervals, each a pair of poses, without an alignment.

    For an interval of n frames, the pairs are the frames 0 and n, n and 2n, … (evo's default). For metres, a
    pair ends at the first pose at least so far ahead along the true path, and the next pair starts at this
    pose (evo: `--pairs_from_reference`).

    Parameters
    ----------
    truth : (N, 4, 4) poses. estimate : (M, 4, 4) poses.
    path : (N,) metres from the first true pose to each pose; only an interval in metres needs it.
    frames : (M,) increasing numbers of the true poses to which the estimated poses belong; None: all. Both
        frames of a pair have an estimate.

    Raises
    ------
    DataError : truth and estimate do not fit (`frames_of_truth`).
    ValueError : an interval in metres without `path`.
    """
    frames = frames_of_truth(truth, estimate, frames)
    if delta.unit == "frames":
        starts, ends = _pairs_by_frames(frames, int(delta.size))
    elif path is None:
        raise ValueError("an interval in metres needs the path")
    else:
        starts, ends = pairs_by_length(path[frames], delta.size)
    error = motion_error(truth[frames], estimate, starts, ends)
    translation = np.linalg.norm(error[:, :3, 3], axis=1)
    return RelativeError(delta, translation, rotation_angle(error[:, :3, :3]))


def _pairs_by_frames(frames: Index, delta: int) -> tuple[Index, Index]:
    """First and last places in `frames` (M,) of pairs that are exactly `delta` frames apart.

    A pair starts where the previous one ends. If no frame is exactly `delta` ahead of that, it starts at the
    next frame for which one is.
    """
    ends = np.searchsorted(frames, frames + delta)
    starts = list[int]()
    place = 0
    while place < len(frames):
        end = int(ends[place])
        if end < len(frames) and frames[end] == frames[place] + delta:
            starts.append(place)
            place = end
        else:
            place += 1
    chosen = np.array(starts, np.intp)
    return chosen, ends[chosen]


def pairs_by_length(path: Array, delta: float) -> tuple[Index, Index]:
    """First and last places of pairs that are at least `delta` metres apart; a pair starts where one ends.

    path : (M,) metres from the first pose to each pose.
    """
    chain = list[int]()
    end = 0
    while end < len(path):
        chain.append(end)
        # An interval may be too small to change the sum, but a pair always ends farther on than it starts.
        least = max(path[end] + delta, np.nextafter(path[end], np.inf))
        end = int(np.searchsorted(path, least))
    places = np.array(chain, np.intp)
    return places[:-1], places[1:]


def frames_of_truth(truth: Array, estimate: Array, frames: Index | None) -> Index:
    """Numbers (M,) of the true poses (N, 4, 4) to which the poses of an estimate (M, 4, 4) belong.

    frames : these numbers, or None if every true pose has an estimated pose.

    Raises
    ------
    DataError : the number of poses is wrong, or a pose is not finite.
    """
    if frames is None:
        check_pair(truth, estimate)
        return np.arange(len(truth))
    check_pair(truth[frames], estimate)
    return frames


def check_pair(truth: Array, estimate: Array, where: str = "") -> None:
    """Raise `DataError` unless both paths (N, 4, 4) have the same number of poses, all finite.

    where : beginning of the message, such as the name of the path.
    """
    if len(truth) != len(estimate) or len(truth) == 0:
        raise DataError(
            f"{where}truth has {len(truth)} poses and the estimate {len(estimate)}; "
            "both need one pose for every frame"
        )
    for name, poses in (("truth", truth), ("estimate", estimate)):
        bad = ~np.isfinite(poses).all(axis=(1, 2))
        if bad.any():
            raise DataError(f"{where}pose {int(np.argmax(bad))} of the {name} is not finite")
