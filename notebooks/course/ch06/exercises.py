"""Exercises of chapter 6: end of a sub-sequence, its errors, all of them, a yaw error, two averages, RPE."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from vo_lib.evaluation.kitti import KITTI_LENGTHS, kitti_errors
from vo_lib.geometry.types import Array

from ..checker import Case, Exercise, When
from ..made_up import block_tour, made_up

YAW, LENGTH = 1.0, 400.0  # deg/100 m and metres, of the straight road
ANGLE = float(np.radians(YAW * LENGTH / 100.0))
TE = 100.0 * float(np.hypot(1.0 - np.sin(ANGLE) / ANGLE, (1.0 - np.cos(ANGLE)) / ANGLE))


def paths() -> list[Case]:
    """A path that stands still once, with starts and lengths; the last length is not reached."""
    path = np.array([0.0, 1.0, 2.0, 3.0, 3.0, 4.5, 6.0, 7.0])
    return [(path, *case) for case in ((0, 2.5), (0, 2.0), (2, 1.0), (1, 5.5), (3, 3.5), (4, 100.0))]


def end(path: Array, first: int, length: float) -> int | None:
    """The first frame farther than `length` from frame `first`, if there is one."""
    beyond = np.flatnonzero(path > path[first] + length)
    return int(beyond[0]) if len(beyond) else None


def judged_pair() -> tuple[Array, Array]:
    """A truth and an estimate (N, 4, 4) that are wrong in every way at once."""
    truth = block_tour(1)
    return truth, made_up(truth, scale=2.0, yaw=3.0, noise=20.0, jitter=0.1, seed=3)


def stretches() -> list[Case]:
    """Two sub-sequences of the pair: first and last frame, length; and one that is right but for rounding.

    A rotation in a printed file has few digits: the trace of the last error comes out above 3.
    """
    truth, estimate = judged_pair()
    rounded = truth.copy()
    rounded[100, :3, :3] *= 1.0 - 1e-9
    return [
        (truth, estimate, 20, 171, 150.0),
        (truth, estimate, 150, 352, 200.0),
        (truth, rounded, 0, 100, 99.0),
    ]


def measured(error: Array, length: float, cosine: Callable[[Array], float] | None = None) -> Array:
    """TE in % and RE in deg/100 m (2,) of an error of motion (4, 4); `cosine` of its angle, where another."""
    rotation = (np.trace(error[:3, :3]) - 1.0) / 2.0
    angle = np.arccos(np.clip(rotation, -1.0, 1.0) if cosine is None else cosine(error))
    return np.array([np.linalg.norm(error[:3, 3]), np.degrees(angle)]) * 100.0 / length


def errors(
    truth: Array,
    estimate: Array,
    first: int,
    last: int,
    length: float,
    motion: Callable[[Array, int, int], Array] = lambda T, i, j: np.linalg.inv(T[i]) @ T[j],
    cosine: Callable[[Array], float] | None = None,
) -> Array:
    """TE in % and RE in deg/100 m of a sub-sequence, (2,)."""
    error = np.linalg.inv(motion(estimate, first, last)) @ motion(truth, first, last)
    return measured(error, length, cosine)


def te_re(mean: Callable[[Array, Array], Any], every: int | None = None) -> Callable[..., Any]:
    """TE and RE over all sub-sequences by a mean of (errors, lengths), from every so many frames."""

    def both(truth: Array, estimate: Array, lengths: Any, step: int) -> tuple[Any, Any]:
        found = kitti_errors(truth, estimate, lengths, every or step)
        return 100.0 * mean(found.t_err, found.length), 100.0 * np.degrees(mean(found.r_err, found.length))

    return both


def pooled(errors: list[Array]) -> float:
    """The mean of all errors."""
    return float(np.concatenate(errors).mean())


def plain(errors: list[Array]) -> float:
    """The mean of the sequences' means; one without errors has none."""
    return float(np.mean([each.mean() for each in errors if len(each)]))


end_frame = Exercise(
    end,
    paths,
    task="A function (path (N,), first, length) -> first frame beyond path[first] + length, or None.",
    praise="the first frame beyond the length, or none. Standing still (frames 3 and 4) does no harm.",
    hint="the path lengths are 0, 1, 2, 3, 3, 4.5, 6, 7.",
    line="beyond = np.flatnonzero(path > path[first] + length)",
    mistakes={
        "frame {got:.0f} is counted from the first one, not from the start of the path.": lambda path, i, far: (
            (last := end(path, i, far)) and last - i
        ),
        "frame {got:.0f} has reached the length; KITTI asks for more.": lambda path, i, far: np.argmax(
            path >= path[i] + far
        ),
        "the length is counted from frame 0: where is the car at frame `first`?": lambda path, i, far: (
            np.argmax(path > far)
        ),
        "the path ends after 7 m, but for 100 m this says {got:.0f}: argmax of nothing but False is 0.": (
            lambda path, i, far: np.argmax(path > path[i] + far)
        ),
        "a path that is too short raises IndexError; return None then.": lambda path, i, far: np.flatnonzero(
            path > path[i] + far
        )[0],
    },
)

part_errors = Exercise(
    errors,
    stretches,
    parts=("te", "re"),
    atol=1e-6,
    task="A function (truth, estimate, first, last, length) -> TE in %, RE in deg/100 m of one sub-sequence.",
    praise="the error of one sub-sequence, as the devkit takes it.",
    hint="two motions first, then what is between them: its length for TE, its angle acos((trace - 1) / 2) for RE.",
    line="error = inv(inv(estimate[first]) @ estimate[last]) @ inv(truth[first]) @ truth[last]",
    library=("kitti_errors",),
    mistakes={
        "the translation error is in metres, not in % of the length.": lambda *x: (
            errors(*x) * [x[4] / 100, 1]
        ),
        "this compares end positions without making the starts equal.": lambda T, S, first, last, length: (
            measured(np.linalg.inv(S[last]) @ T[last], length)
        ),
        "these are motions in the world: the inverse of the first pose stands on the left.": partial(
            errors, motion=lambda T, i, j: T[j] @ np.linalg.inv(T[i])
        ),
        "TE is right, RE is in degrees, not by length.": lambda *x: errors(*x) * [1, x[4] / 100],
        "TE is right; the trace is that of all four rows, and a rotation has three.": (
            partial(errors, cosine=lambda error: (np.trace(error) - 1) / 2),
            partial(errors, cosine=lambda error: min((np.trace(error) - 1) / 2, 1)),
        ),
        "a right estimate with few digits gives NaN: rounding takes the argument of acos above 1.": partial(
            errors, cosine=lambda error: (np.trace(error[:3, :3]) - 1) / 2
        ),
    },
)

yaw_on_a_straight = Exercise(
    TE,
    rtol=0.03,
    task="TE, %, of a 400 m straight road when the estimate turns by 1 deg/100 m and is right otherwise.",
    praise="{right:.2f} %: ½ · 0.0698 · 400 m = 14 m to the side. For 100 m it would be 0.87 %.",
    hint="the path is an arc; how far to the side does it end, with the angle at its end in radians?",
    line="100 * 0.5 * np.radians(4)",
    mistakes={
        "the car has not been 4° off all the way: the angle grows from 0 to 4°.": 100.0 * ANGLE,
        "{got:.3g} m is the error at the end; how much of the 400 m is that?": TE * LENGTH / 100.0,
        "this is right for 100 m; the error in metres grows with the square of the length.": TE / 4.0,
    },
)

once_round = Exercise(
    0.0,
    atol=0.02,
    task="TE, %, of 800 m once round the block of 800 m, when every step is 1 % too long.",
    praise="nearly nothing: a larger block closes as well. TE sees the end of a sub-sequence, not its middle.",
    hint="draw the estimate: it is a slightly larger block.",
    line="kitti_errors(tour, made_up(tour, scale=1.0), lengths=(800,)).te",
    mistakes={
        "that would be so on a straight road; where does the estimate end when the truth is back home?": When(
            lambda te: abs(te - 1.0) < 0.2
        )
    },
)

all_errors = Exercise(
    te_re(lambda each, length: each.mean()),
    lambda: [(*judged_pair(), KITTI_LENGTHS[:4], 10)],
    parts=("te", "re"),
    atol=5e-3,
    task="A function (truth, estimate, lengths, step) -> TE, RE: means over all sub-sequences.",
    praise="TE {got[0]:.3f} %, RE {got[1]:.3f} deg/100 m over all sub-sequences, as `kitti_errors` has it.",
    hint="sub-sequences that end beyond the path are left out; one mean over all the others.",
    line="if (last := end_frame(path, first, length)) is not None: found.append(part_errors(…))",
    library=("kitti_errors",),
    mistakes={
        "this is the root of the mean square; KITTI takes the plain mean.": te_re(
            lambda each, length: np.sqrt(np.mean(each**2))
        ),
        "this is the mean of the means of each length; short ones are more frequent and count more.": te_re(
            lambda each, length: np.mean([each[length == L].mean() for L in np.unique(length)])
        ),
        "this is the sum or the median; TE and RE are means.": (
            te_re(lambda each, length: each.sum()),
            te_re(lambda each, length: np.median(each)),
        ),
        "this starts at every frame, not at every `step`.": te_re(lambda each, length: each.mean(), every=1),
    },
)

averages = Exercise(
    lambda errors: (pooled(errors), plain(errors)),
    lambda: [([np.ones(4), np.array([3.0]), np.array([])],)],
    parts=("pooled", "plain"),
    task="A function (list of arrays, one a sequence) -> pooled mean, mean of the sequences' means.",
    praise="1.4 and 2.0 of the same errors. A table has to say which it means.",
    hint="once over all errors, once over the sequences' own means.",
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
        "a sequence without sub-sequences makes it NaN; leave empty ones out of the plain mean.": When(
            lambda got, errors: np.isnan(got)
        ),
    },
)

blind_rpe = Exercise(
    {"RPE": 0.1, "TE": 3.0},
    task="The panel shows an estimate with RPE under 1 mm a frame, but TE above 2 %.",
    praise="TE {TE:.1f} %, RPE {RPE:.2f} mm: every step is as long as it should be, only its direction is "
    "off. RPE has a second number for that, the rotation. Look at both, or at TE.",
    mistakes={
        "TE is only {TE:.2f} %: which made-up error grows from frame to frame?": lambda now: (
            not now["TE"] > 2
        ),
        "RPE is {RPE:.1f} mm: which made-up errors are in the length of a step?": lambda now: (
            not now["RPE"] < 1
        ),
    },
)
