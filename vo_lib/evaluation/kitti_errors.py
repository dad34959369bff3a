"""KITTI's trajectory errors over sub-sequences (chapter 6).

KITTI's odometry benchmark (Geiger, Lenz, Urtasun, CVPR 2012) compares motions over sub-sequences of 100 to
800 m of path. TE is the translation error in % of the length of a sub-sequence, RE the rotation error in
deg/100 m. All poses are `T_w_c`, (N, 4, 4), metres. ATE and RPE are in `ate_rpe.py`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import DataError
from ..geometry.rows import Rows
from ..geometry.types import Array, Index

KITTI_LENGTHS = (100.0, 200.0, 300.0, 400.0, 500.0, 600.0, 700.0, 800.0)  # metres
KITTI_STEP = 10  # frames from one start to the next
SHORT_LENGTHS = (20.0, 50.0, 100.0)  # metres, for paths that are too short for KITTI's lengths
KITTI_SPEEDS = (2.0, 4.0, 6.0, 8.0, 10.0, 12.0, 14.0, 16.0, 18.0, 20.0, 22.0, 24.0)  # bin centres, m/s
KITTI_SPEED_REACH = 2.0  # m/s by which a speed may differ from the centre, so that bins overlap
KITTI_FRAME_TIME = 0.1  # seconds; fixed in the devkit
KITTI_BIN_MINIMUM = 3  # smallest number of sub-sequences for a point of the devkit's curves
# With fewer sub-sequences, a single place of the path may decide the mean. KITTI's 04, the shortest, has 43.
FEW_SUBSEQUENCES = 20


@dataclass(frozen=True, eq=False)
class KittiErrors(Rows):
    """KITTI errors of S sub-sequences; empty for a path shorter than every length.

    Attributes
    ----------
    first, last : (S,) numbers of the frames at which a sub-sequence begins and ends.
    length : (S,) nominal length, metres.
    t_err : (S,) translation error divided by the nominal length, no unit. Where the right last frame is
        missing, it is divided by the length of the true path between the two frames.
    r_err : (S,) rotation error divided by the same length, rad/m.
    speed : (S,) mean speed, m/s.
    """

    first: Index
    last: Index
    length: Array
    t_err: Array
    r_err: Array
    speed: Array

    @property
    def te(self) -> float | None:
        """Mean translation error, %; None without sub-sequences."""
        return 100.0 * float(self.t_err.mean()) if len(self) else None

    @property
    def re(self) -> float | None:
        """Mean rotation error, deg/100 m; None without sub-sequences."""
        return 100.0 * math.degrees(self.r_err.mean()) if len(self) else None

    def by_length(self, lengths: Sequence[float] = KITTI_LENGTHS) -> dict[float, KittiErrors]:
        """For each nominal length in metres, the sub-sequences with this length, possibly none."""
        return {float(length): self[self.length == length] for length in lengths}

    def by_speed(self) -> dict[float, KittiErrors]:
        """For each bin centre in m/s, the sub-sequences with about this speed; bins overlap (as in KITTI)."""
        return {speed: self[np.abs(self.speed - speed) < KITTI_SPEED_REACH] for speed in KITTI_SPEEDS}

    def curve(
        self, by: str, lengths: Sequence[float] = KITTI_LENGTHS
    ) -> list[tuple[float, float | None, float | None]]:
        """Points (bin centre, TE, RE) of the devkit's curve by "length", metres, or by "speed", km/h."""
        if by == "length":
            bins = self.by_length(lengths)
        else:
            bins = {3.6 * speed: part for speed, part in self.by_speed().items()}
        return [(at, part.te, part.re) for at, part in bins.items() if len(part) >= KITTI_BIN_MINIMUM]

    def to_dict(self) -> dict[str, Any]:
        """Count and means, for JSON; None without sub-sequences."""
        return {"subsequences": len(self), "te_percent": self.te, "re_deg_per_100m": self.re}

    def to_tables(self, lengths: Sequence[float] = KITTI_LENGTHS) -> dict[str, Any]:
        """`to_dict` of all sub-sequences, of each length and of each speed, for JSON."""
        return self.to_dict() | {
            "by_length": [{"length_m": at} | part.to_dict() for at, part in self.by_length(lengths).items()],
            "by_speed": [{"speed_m_s": at} | part.to_dict() for at, part in self.by_speed().items()],
        }


def trajectory_distances(T: Array) -> Array:
    """Path length from the first pose to each of the poses (N, 4, 4): (N,), metres."""
    steps = np.linalg.norm(np.diff(T[:, :3, 3], axis=0), axis=1)
    return np.concatenate([np.zeros(1), np.cumsum(steps)])


def motion_error(truth: Array, estimate: Array, first: Index, last: Index) -> Array:
    """Error motions inverse(Δest) Δgt, (S, 4, 4), with Δ = inverse(T[first]) T[last].

    truth, estimate : (N, 4, 4) poses; first, last : (S,) numbers of poses.
    """
    # A general inverse: rotations in files are orthonormal only to 1e-7, so the transpose would cause
    # rotation errors of up to 0.05°.
    true_motion = np.linalg.inv(truth[first]) @ truth[last]
    estimated_motion = np.linalg.inv(estimate[first]) @ estimate[last]
    return np.asarray(np.linalg.inv(estimated_motion) @ true_motion)


def frames_of_truth(truth: Array, estimate: Array, frames: Index | None = None, where: str = "") -> Index:
    """Numbers (M,) of the true poses (N, 4, 4) to which the poses of an estimate (M, 4, 4) belong.

    frames : these numbers, or None if every true pose has an estimated pose. where : beginning of the
    message, such as the name of the path.

    Raises
    ------
    DataError : the number of poses is wrong, or a pose is not finite.
    """
    numbers = np.arange(len(truth)) if frames is None else frames
    if len(numbers) != len(estimate) or len(numbers) == 0:
        counts = f"truth has {len(numbers)} poses and the estimate {len(estimate)}"
        raise DataError(f"{where}{counts}; both need one pose for every frame")
    for name, poses in (("truth", truth[numbers]), ("estimate", estimate)):
        bad = ~np.isfinite(poses).all(axis=(1, 2))
        if bad.any():
            raise DataError(f"{where}pose {int(np.argmax(bad))} of the {name} is not finite")
    return numbers


def _devkit_distances(T: Array) -> NDArray[np.float32]:
    """`trajectory_distances` with the devkit's rounding.

    Squares, their sum and each total have single precision; the root and each addition have double precision.
    """
    totals = [0.0]
    for step in _norm(np.diff(T[:, :3, 3], axis=0).astype(np.float32)).tolist():
        totals.append(float(np.float32(totals[-1] + step)))
    return np.array(totals, np.float32)


def _norm(t: NDArray[Any]) -> Array:
    """Lengths (N,) of vectors (N, 3): squares and sum in the precision of `t`, the root in float64."""
    squares = t * t
    return np.asarray(np.sqrt((squares[:, 0] + squares[:, 1] + squares[:, 2]).astype(np.float64)))


def _errors_per_metre(error: Array, length: Array, dtype: type[np.floating[Any]]) -> tuple[Array, Array]:
    """Translation errors (S,), no unit, and rotation errors (S,), rad/m, of the error motions (S, 4, 4).

    length : (S,) metres by which they are divided.
    dtype : precision of the variables that have single precision in the devkit.
    """
    rotation = error[:, :3, :3].astype(dtype)
    trace = rotation[:, 0, 0] + rotation[:, 1, 1] + rotation[:, 2, 2]
    cosine = (0.5 * (trace.astype(np.float64) - 1.0)).astype(dtype)
    angle = np.arccos(np.clip(cosine, -1.0, 1.0).astype(np.float64)).astype(dtype)
    distance = _norm(error[:, :3, 3].astype(dtype)).astype(dtype)
    divisor = length.astype(dtype)
    return (distance / divisor).astype(np.float64), (angle / divisor).astype(np.float64)


def kitti_errors(
    truth: Array,
    estimate: Array,
    lengths: Sequence[float] = KITTI_LENGTHS,
    step: int = KITTI_STEP,
    times: Array | None = None,
    frames: Index | None = None,
) -> KittiErrors:
    """Errors of all sub-sequences of a sequence, equal to the errors of KITTI's development kit.

    For each length, sub-sequences start at every `step`-th frame and end at the first frame that is more than
    this length ahead. Both errors of inverse(Δest) Δgt are divided by the nominal length.

    If some frames have no estimate, the next frame that has one takes the place of a missing end. It also
    takes the place of a missing start, but only if it comes before the following start. A sub-sequence may
    then end later than it should; if so, its errors are divided by its true length.

    For KITTI's lengths, errors have the devkit's single precision and agree with the devkit in all digits.
    That would be too coarse for shorter lengths, 0.02° for angles, so all others have double precision.

    Parameters
    ----------
    truth : (N, 4, 4) poses. estimate : (M, 4, 4) poses.
    lengths : nominal lengths, metres.
    step : frames of the truth between starts.
    times : (N,) seconds of the frames, for the speed; None: ten frames per second, as in the devkit.
    frames : (M,) increasing numbers of the true poses to which the estimated poses belong; None: all.

    Returns
    -------
    KittiErrors, sorted by the first frame, then in the order of `lengths`; frames are those of the truth.

    Raises
    ------
    DataError : a length or the step is not positive, or truth and estimate do not fit (`frames_of_truth`).
    """
    frames = frames_of_truth(truth, estimate, frames)
    if len(lengths) == 0 or not all(0 < length < math.inf for length in lengths):
        raise DataError(f"lengths: expected positive numbers of metres, got {list(lengths)}")
    if step < 1:
        raise DataError(f"step: expected 1 frame or more, got {step}")
    path = _devkit_distances(truth)
    starts = _places_of_starts(frames, np.arange(0, len(truth), step), step)
    # For each start and each length: the distance to exceed, and the place of the first estimate beyond it.
    limits = path[frames[starts], None] + np.asarray(lengths, dtype=np.float32)
    ends = np.searchsorted(path[frames], limits, side="right")
    # A sub-sequence is one of these pairs that ends inside the path.
    which_start, which_length = np.nonzero(ends < len(frames))
    start = starts[which_start]
    end = ends[which_start, which_length]
    length = np.asarray(lengths, dtype=np.float64)[which_length]
    first = frames[start]
    last = frames[end]
    proper_last = np.searchsorted(path, limits, side="right")[which_start, which_length]
    covered = np.where(last == proper_last, length, path[last].astype(np.float64) - path[first])
    error = motion_error(truth[frames], estimate, start, end)
    single_t, single_r = _errors_per_metre(error, covered, np.float32)
    double_t, double_r = _errors_per_metre(error, covered, np.float64)
    as_devkit = np.isin(length, KITTI_LENGTHS)
    t_err = np.where(as_devkit, single_t, double_t)
    r_err = np.where(as_devkit, single_r, double_r)
    # The devkit counts frames, not intervals: without times, a speed is slightly too low, as in the devkit.
    seconds = KITTI_FRAME_TIME * (last - first + 1) if times is None else times[last] - times[first]
    speed = covered / np.maximum(seconds, 1e-9)  # all times may be equal
    # The devkit's rounding, so that a speed on the edge of a bin falls on the same side.
    return KittiErrors(first, last, length, t_err, r_err, speed.astype(np.float32).astype(np.float64))


def _places_of_starts(frames: Index, starts: Index, step: int) -> Index:
    """For each start, the place in `frames` of the first frame from it on, if before the following start.

    frames : (M,) increasing numbers; starts : frame numbers at intervals of `step`.
    """
    places = np.searchsorted(frames, starts)
    inside = places < len(frames)
    places = places[inside]
    return np.asarray(places[frames[places] < starts[inside] + step])


@dataclass(frozen=True)
class SubsequenceProtocol:
    """The sub-sequences of TE and RE: lengths, metres, and frames between starts."""

    lengths: tuple[float, ...]
    step: int

    @property
    def words(self) -> str:
        """The lengths and starts as text for a table: "100, 200, … 800 m, every 10 frames"."""
        numbers = [f"{length:g}" for length in self.lengths]
        if len(numbers) > 4:
            numbers = [*numbers[:2], f"… {numbers[-1]}"]
        every = "every frame" if self.step == 1 else f"every {self.step} frames"
        return ", ".join(numbers) + f" m, {every}"

    def to_dict(self) -> dict[str, Any]:
        """Lengths and step for JSON."""
        return {"lengths_m": list(self.lengths), "step_frames": self.step}

    def words_with(self, as_kitti: bool) -> str:
        """`words`, and whether errors are computed as in KITTI's benchmark."""
        return self.words + (" (as KITTI)" if as_kitti else "")


KITTI_PROTOCOL = SubsequenceProtocol(KITTI_LENGTHS, KITTI_STEP)
SHORT_PROTOCOL = SubsequenceProtocol(SHORT_LENGTHS, 1)


def suitable_protocol(truth: Array, frames: Index | None = None) -> SubsequenceProtocol:
    """KITTI's sub-sequences if the true path (N, 4, 4) has at least one, otherwise those of short paths.

    frames : (M,) numbers of the true poses that are compared; None: all.
    """
    compared = truth if frames is None else truth[frames]
    # The truth compared with itself: only the number of sub-sequences counts.
    subsequences = kitti_errors(truth, compared, frames=frames)
    return KITTI_PROTOCOL if len(subsequences) else SHORT_PROTOCOL


def is_as_kitti(protocol: SubsequenceProtocol, subsequences: int, whole_truth: bool) -> bool:
    """Whether errors may be called those of KITTI's benchmark.

    They are if they follow its rule on a whole path with at least `FEW_SUBSEQUENCES` sub-sequences.

    subsequences : number of them.
    whole_truth : whether every frame of a whole sequence has an estimate.
    """
    return protocol == KITTI_PROTOCOL and whole_truth and subsequences >= FEW_SUBSEQUENCES


def subsequences_text(subsequences: int) -> str:
    """A number of sub-sequences as text, with a warning beside a small number: "5 sub-sequences (few)"."""
    noun = "sub-sequence" if subsequences == 1 else "sub-sequences"
    return f"{subsequences} {noun}" + (" (few)" if subsequences < FEW_SUBSEQUENCES else "")
