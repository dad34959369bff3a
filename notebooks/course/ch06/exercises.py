"""Exercises of chapter 6: pieces and their errors, a yaw error, two averages, a mean change, ATE."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from vo_lib.evaluation.kitti_errors import KITTI_LENGTHS, trajectory_distances
from vo_lib.geometry.motion import rigid, rotation_from_vector
from vo_lib.geometry.types import Array, BoolArray

from ..checker import Case, Condition, Exercise
from ..perturbed_path import block_tour, perturbed_path

YAW = 1.0  # deg/100 m, on the straight road
LENGTH = 400.0  # metres, of the straight road
ANGLE = float(np.radians(YAW * LENGTH / 100.0))  # of the heading at its end
# TE of the whole road in %. The estimate is an arc, which ends at sin(ANGLE) / ANGLE of the length ahead and at
# (1 - cos(ANGLE)) / ANGLE of it to the side; the truth ends at the length ahead.
TE = 100.0 * float(np.hypot(1.0 - np.sin(ANGLE) / ANGLE, (1.0 - np.cos(ANGLE)) / ANGLE))


def paths() -> list[Case]:
    """Cases of a path with unequal steps, a first frame and a length; the last length exceeds the path."""
    path = np.array([0.0, 1.5, 3.5, 6.0, 6.0, 7.0, 9.5, 12.0])
    starts_and_lengths = ((0, 5.0), (0, 3.5), (2, 2.5), (1, 8.0), (3, 5.0), (4, 100.0))
    return [(path, first, length) for first, length in starts_and_lengths]


def first_true(mask: BoolArray) -> int | None:
    """The first index at which a mask is true, or None."""
    return int(np.argmax(mask)) if mask.any() else None


def end(path: Array, first: int, length: float) -> int | None:
    """The first frame farther than `length` along the path from frame `first`, or None."""
    return first_true(path > path[first] + length)


def judged_pair() -> tuple[Array, Array]:
    """A truth (N, 4, 4) and an estimate (N, 4, 4) with all kinds of errors, rotations about all axes too.

    The car drives 0 to 3 m per frame, so a length in metres is not a number of frames. The camera is tilted,
    so the rotation error has components about all axes.
    """
    metres = np.cumsum(np.resize([0, 1, 2, 3, 2], 400))  # at each frame
    truth = block_tour(1)[metres]
    tilted = rigid(rotation_from_vector(np.array([0.5, 0.3, 0.6])), np.zeros(3))
    estimate = perturbed_path(truth, scale=2.0, yaw=3.0, noise=20.0, jitter=0.1, seed=3)
    # A yaw alone would have the same axis as the turns of the car.
    rolled = np.radians(0.02) * np.arange(len(truth))[:, None] * np.array([[1.0, 0.0, 0.7]])
    estimate[:, :3, :3] = estimate[:, :3, :3] @ rotation_from_vector(rolled)
    return np.linalg.inv(tilted) @ truth @ tilted, np.linalg.inv(tilted) @ estimate @ tilted


def stretches() -> list[Case]:
    """Cases of sub-sequences: poses, first and last frame, length. The last two have only rounding errors.

    In one of these two cases, the rotation error has a trace above 3, for either order of the motions.
    """
    truth, estimate = judged_pair()
    cases: list[Case] = [(truth, estimate, 20, 114, 150.0), (truth, estimate, 150, 276, 200.0)]
    for factor in (1.0 - 1e-12, 1.0 + 1e-12):
        rounded = truth.copy()
        rounded[100, :3, :3] *= factor
        cases.append((truth, rounded, 0, 100, 99.0))
    return cases


def sequences() -> list[Case]:
    """Lists of errors, an array for each sequence; some arrays are empty."""
    lists: tuple[tuple[list[float], ...], ...] = (
        ([1.0, 1.0, 1.0, 1.0], [3.0], []),
        ([2.0, 4.0], [], [1.0], [6.0, 6.0, 9.0]),
        ([], [5.0], [1.0, 2.0]),
    )
    cases: list[Case] = []
    for of_sequences in lists:
        errors = [np.array(each) for each in of_sequences]
        cases.append((errors,))
    return cases


def cosine_of(error: Array) -> float:
    """Cosine of the rotation angle of an error (4, 4)."""
    return float(np.clip((np.trace(error[:3, :3]) - 1.0) / 2.0, -1.0, 1.0))


def errors(
    truth: Array,
    estimate: Array,
    first: int,
    last: int,
    length: float,
    motion: Callable[[Array, int, int], Array] = lambda T, i, j: np.linalg.inv(T[i]) @ T[j],
    cosine: Callable[[Array], float] = cosine_of,
) -> Array:
    """TE in % and RE in deg/100 m of a sub-sequence, (2,).

    motion : function of poses, first and last frame that returns the motion (4, 4) between the frames.
    cosine : function of the error (4, 4) that returns the cosine of its angle.
    """
    error = np.linalg.inv(motion(estimate, first, last)) @ motion(truth, first, last)
    metres = np.linalg.norm(error[:3, 3])
    degrees = np.degrees(np.arccos(cosine(error)))
    return np.array([metres, degrees]) * 100.0 / length


def te_in_metres(truth: Array, estimate: Array, first: int, last: int, length: float) -> Array:
    """Wrong answer: TE is not divided by the length."""
    te, re = errors(truth, estimate, first, last, length)
    return np.array([te * length / 100, re])


def re_for_one_metre(truth: Array, estimate: Array, first: int, last: int, length: float) -> Array:
    """Wrong answer: RE is in deg/m."""
    te, re = errors(truth, estimate, first, last, length)
    return np.array([te, re / 100])


def re_as_angle(truth: Array, estimate: Array, first: int, last: int, length: float) -> Array:
    """Wrong answer: RE is not divided by the length."""
    te, re = errors(truth, estimate, first, last, length)
    return np.array([te, re * length / 100])


def re_from_two_angles(truth: Array, estimate: Array, first: int, last: int, length: float) -> Array:
    """Wrong answer: RE is the difference between the turns of the estimate and of the truth."""
    te, _ = errors(truth, estimate, first, last, length)
    return np.array([te, 100.0 * difference_of_angles(truth, estimate, first, last) / length])


def difference_of_angles(truth: Array, estimate: Array, first: int, last: int) -> float:
    """The difference between the turn of the estimate and the turn of the truth, degrees."""
    estimated_turn = np.arccos(cosine_of(np.linalg.inv(estimate[first]) @ estimate[last]))
    true_turn = np.arccos(cosine_of(np.linalg.inv(truth[first]) @ truth[last]))
    return abs(float(np.degrees(estimated_turn - true_turn)))


def path_between(poses: Array, first: int, last: int) -> float:
    """Length of the path from one frame to another, metres."""
    distances = trajectory_distances(poses)
    return float(distances[last] - distances[first])


def mean_errors(
    truth: Array,
    estimate: Array,
    lengths: Any,
    step: int,
    end: Callable[..., int | None] = end,
    mean: Callable[..., Any] = np.mean,
    along: Array | None = None,
) -> Array:
    """Mean TE and RE, (2,), of all sub-sequences; `end` returns the last frame of a sub-sequence.

    Path lengths are measured along the truth, or along the path `along`.
    """
    path = trajectory_distances(truth if along is None else along)
    of_parts = []
    for first in range(0, len(truth), step):
        for length in lengths:
            last = end(path, first, length)
            if last is not None:
                of_parts.append(errors(truth, estimate, first, last, length))
    return np.asarray(mean(of_parts, axis=0))


def mean_over_lengths(truth: Array, estimate: Array, lengths: Any, step: int) -> Any:
    """Wrong answer: the mean of the means over the sub-sequences of each length."""
    means = [mean_errors(truth, estimate, (length,), step) for length in lengths]
    return np.mean(means, axis=0)


def by_frame_number(path: Array, first: int, length: float) -> int | None:
    """Wrong answer: end of a sub-sequence if the number of the first frame is used as a length in metres."""
    return first_true(path > first + length)


def pooled(errors: list[Array]) -> float:
    """The mean of all errors."""
    return float(np.concatenate(errors).mean())


def plain(errors: list[Array]) -> float:
    """The mean of the sequences' means, without sequences that have no errors."""
    return float(np.mean([each.mean() for each in errors if len(each)]))


def pairs() -> list[Case]:
    """Errors of the same seeds before and after, and Student's factor for 95 %."""
    before = np.array([1.0, 1.2, 0.9, 1.1, 1.3])
    better = np.array([0.9, 1.15, 0.8, 1.05, 1.2])
    old = np.array([2.0, 2.5, 2.2])
    worse = np.array([2.6, 2.4, 2.9])
    return [(before, better, 2.776), (old, worse, 4.303), (better[:4], before[:4], 3.182)]


def change_and_half(before: Array, after: Array, t: float, over: int = 1, root: bool = True) -> Array:
    """Mean change and half width t s / √n of its interval, (2,); s over n - `over`, without √n if not `root`."""
    change = after - before
    half = t * np.std(change, ddof=over)
    if root:
        half = half / np.sqrt(len(change))
    return np.array([change.mean(), half])


def ends_of_interval(before: Array, after: Array, t: float) -> Array:
    """Wrong answer: the ends of the interval, (2,)."""
    mean, half = change_and_half(before, after, t)
    return np.array([mean - half, mean + half])


def unpaired(before: Array, after: Array, t: float) -> Array:
    """Wrong answer: as `change_and_half`, with the spreads of the errors in place of the spread of the changes."""
    spread = np.hypot(np.std(before, ddof=1), np.std(after, ddof=1))
    return np.array([np.mean(after) - np.mean(before), t * spread / np.sqrt(len(before))])


def sub_sequence_cases() -> list[Case]:
    """Cases with truth and estimate, the lengths of the sub-sequences, and the frames between their starts."""
    truth, estimate = judged_pair()
    return [(truth, estimate, KITTI_LENGTHS[:4], 10), (truth, estimate, (150.0,), 25)]


def moved_back(last: int | None, frames: int) -> int | None:
    """An end frame that is too early by a number of frames; None stays."""
    return None if last is None else last - frames


end_frame = Exercise(
    end,
    paths,
    praise="the first frame beyond the length, or None. The standstill (frames 3 and 4) has no effect.",
    hint="the path is 0, 1.5, 3.5, 6, 6, 7, 9.5, 12 m.",
    line="beyond = np.flatnonzero(path > path[first] + length)",
    mistakes={
        "frame {got:.0f} is counted from frame `first`; the result is a frame of the whole path.": (
            lambda path, i, far: moved_back(end(path, i, far), i)
        ),
        "`first` is the number of a frame, not a distance: the sub-sequence begins at `path[first]` metres.": (
            by_frame_number
        ),
        "the path to frame {got:.0f} equals the length; KITTI takes the first frame beyond it.": (
            lambda path, i, far: first_true(path >= path[i] + far),
            lambda path, i, far: np.argmax(path >= path[i] + far),
        ),
        "the length is counted from frame 0: where is the car at frame `first`?": (
            lambda path, i, far: first_true(path > far),
            lambda path, i, far: np.argmax(path > far),
        ),
        "the path ends after 12 m, but for 100 m the result is {got:.0f}: argmax of an array of False is 0.": (
            lambda path, i, far: np.argmax(path > path[i] + far)
        ),
        "this is the last frame inside the length; KITTI takes the first frame beyond it.": (
            lambda path, i, far: moved_back(end(path, i, far), 1)
        ),
        "frame `first` plus a length in metres is no frame: look for the place in `path`.": lambda path, i, far: (
            i + int(far)
        ),
        "a path that is too short raises IndexError; return None there.": lambda path, i, far: np.flatnonzero(
            path > path[i] + far
        )[0],
    },
)

part_errors = Exercise(
    errors,
    stretches,
    parts=("te", "re"),
    atol=1e-3,
    praise="the error of one sub-sequence, as KITTI's development kit computes it.",
    hint="compute the true and the estimated motion, then the motion between them. The length of its translation "
    "gives TE, its angle acos((trace - 1) / 2) gives RE.",
    line="error = inv(inv(estimate[first]) @ estimate[last]) @ inv(truth[first]) @ truth[last]",
    library=("kitti_errors",),
    mistakes={
        "TE is in metres, not in % of the length.": te_in_metres,
        "divide by the nominal length, the argument `length`, not by the length of the path.": (
            lambda truth, estimate, first, last, length: errors(
                truth, estimate, first, last, path_between(truth, first, last)
            )
        ),
        "this compares end positions without equal starts.": partial(errors, motion=lambda T, i, j: T[j]),
        "these are motions in the world: the inverse of the first pose belongs on the left.": partial(
            errors, motion=lambda T, i, j: T[j] @ np.linalg.inv(T[i])
        ),
        "RE is in deg/m; in deg/100 m the number is a hundred times as large.": re_for_one_metre,
        "RE is the angle in degrees, not divided by the length.": re_as_angle,
        "TE is right; RE is the difference of two angles: take the angle of the motion between the ends.": (
            re_from_two_angles
        ),
        "TE is right; RE has the yaw alone, and this rotation is about all three axes.": partial(
            errors, cosine=lambda error: np.cos(np.arctan2(error[0, 2], error[2, 2]))
        ),
        "TE is right; for RE, the trace of the rotation (3, 3) minus 1 is needed. The fourth row adds 1.": (
            partial(errors, cosine=lambda error: (np.trace(error) - 1) / 2),
            partial(errors, cosine=lambda error: min((np.trace(error) - 1) / 2, 1)),
        ),
        "an estimate that is right to 12 digits gives NaN: rounding makes the argument of acos larger than 1.": (
            partial(errors, cosine=lambda error: (np.trace(error[:3, :3]) - 1) / 2)
        ),
    },
)


yaw_on_a_straight = Exercise(
    TE,
    rtol=0.03,
    praise="{right:.2f} %: ½ · 0.0698 · 400 m = 14 m to the side. For 100 m it would be 0.87 %.",
    hint="the estimate is an arc. How far to the side is its end, with the angle there in radians?",
    slips={"share": "this is a fraction: multiply by 100."},
    line="100 * 0.5 * np.radians(4)",
    mistakes={
        "the heading is not 4° wrong all the way: its error grows from 0 to 4°.": 100.0 * ANGLE,
        "{got:.3g} m is the error at the end; which percentage of the 400 m is that?": TE * LENGTH / 100.0,
        "this is right for 100 m; the error in metres grows with the square of the length.": TE / 4.0,
        "{got:.3g} is an angle in degrees, and TE is a length in per cent: the arc ends to the side of the road.": (
            YAW * LENGTH / 100.0,
            0.5 * YAW * LENGTH / 100.0,
        ),
    },
)

once_round = Exercise(
    0.0,
    atol=5e-3,
    praise="almost zero: a larger block is closed too. TE depends on the end of a sub-sequence, not on its middle.",
    hint="draw the estimate: it is a slightly larger block.",
    line="kitti_errors(tour, perturbed_path(tour, scale=1.0), lengths=(800,)).te",
    mistakes={
        "this is right on a straight road. Where does the estimate end when the truth is back at its start?": Condition(
            lambda te: abs(te - 1.0) < 0.2
        )
    },
)

all_errors = Exercise(
    mean_errors,
    sub_sequence_cases,
    parts=("te", "re"),
    atol=1e-6,
    praise="TE {got[0]:.3f} %, RE {got[1]:.3f} deg/100 m over all sub-sequences, as in `kitti_errors`.",
    hint="leave out the sub-sequences for which `end_frame` returns None; take one mean over all the others.",
    line="if (last := end_frame(path, first, length)) is not None: "
    "errors.append(part_errors(truth, estimate, first, last, length))",
    library=("kitti_errors",),
    mistakes={
        "this is the root of the mean square; KITTI takes the plain mean.": partial(
            mean_errors, mean=lambda errors, axis: np.sqrt(np.mean(np.square(errors), axis))
        ),
        "this is the sum or the median; TE and RE are means.": (
            partial(mean_errors, mean=np.sum),
            partial(mean_errors, mean=np.median),
        ),
        "this is a mean over the lengths; take one mean over all sub-sequences.": mean_over_lengths,
        "the starts are at every frame, not at every `step`-th.": lambda truth, estimate, lengths, step: (
            mean_errors(truth, estimate, lengths, 1)
        ),
        "the sub-sequences end at wrong frames: `first` is the number of a frame, `path[first]` are metres.": (
            partial(mean_errors, end=by_frame_number)
        ),
        "the length of a sub-sequence is measured along the estimate; KITTI measures it along the truth.": (
            lambda truth, estimate, lengths, step: mean_errors(truth, estimate, lengths, step, along=estimate)
        ),
    },
)

averages = Exercise(
    lambda errors: (pooled(errors), plain(errors)),
    sequences,
    parts=("pooled", "plain"),
    praise="the same errors have the means 1.4 and 2.0. A table must name its kind of mean.",
    hint="one mean is over all errors, the other over the sequences' own means.",
    line="np.concatenate(errors).mean(), np.mean([each.mean() for each in errors if len(each)])",
    mistakes={
        "both are the same mean: once over all errors, once over the sequences' means.": (
            lambda errors: (plain(errors), plain(errors)),
            lambda errors: (pooled(errors), pooled(errors)),
        ),
        "an empty sequence counts as zero; it has no error, so leave it out.": lambda errors: (
            pooled(errors),
            np.mean([each.sum() / max(len(each), 1) for each in errors]),
        ),
        "the last sequence is missing.": lambda errors: (pooled(errors[:-1]), plain(errors[:-1])),
        "a sequence without sub-sequences makes the plain mean NaN; leave out empty sequences.": Condition(
            lambda got, errors: np.isnan(got)
        ),
    },
)

mean_change = Exercise(
    change_and_half,
    pairs,
    parts=("mean", "half"),
    praise="the mean change is {got[0]:.3f} ± {got[1]:.3f}: it does not contain 0.",
    hint="take the changes after - before first; then their mean, and t times their standard deviation over √n.",
    line="change = after - before; change.mean(), t * np.std(change, ddof=1) / np.sqrt(len(change))",
    library=("paired_change", "mean_interval"),
    mistakes={
        "the standard deviation is over n; a sample has n - 1 (`ddof=1`).": partial(change_and_half, over=0),
        "this is the interval of one more run; the mean of n changes scatters less, by √n.": (
            partial(change_and_half, root=False),
            partial(change_and_half, root=False, over=0),
        ),
        "the half width has the spread of the errors. The pairs are the point: take the spread of the changes.": (
            unpaired
        ),
        "this is before - after: a change is the new value minus the old one.": lambda before, after, t: (
            change_and_half(after, before, t)
        ),
        "the half width lacks Student's factor `t`.": lambda before, after, t: change_and_half(
            before, after, 1.0
        ),
        "these are the two ends of the interval; return the mean and the half width.": ends_of_interval,
    },
)

blind_ate = Exercise(
    {"TE": 4.0, "RE": 0.0, "ATE": 0.05},
    praise="TE {TE:.1f} %, RE {RE:.2f} deg/100 m, ATE {ATE:.2f} m. Every step is wrong by the same share. The "
    "alignment sim3 scales the estimate before ATE is computed, so ATE does not contain this error.",
    mistakes={
        "the panel shows no TE: choose a sequence with a ground truth, and press Run for a method.": (
            lambda now: np.isnan(now["TE"])
        ),
        "TE is only {TE:.2f} %: which made-up error lengthens every step?": lambda now: not now["TE"] > 3,
        "RE is {RE:.2f} deg/100 m: which made-up errors turn the car?": lambda now: not now["RE"] < 0.5,
        "ATE is {ATE:.2f} m: which alignment removes an error of scale before ATE is computed?": lambda now: (
            not now["ATE"] < 0.2
        ),
    },
)
