"""Exercises of chapter 6: end of a sub-sequence, its errors, all of them, a yaw error, two averages, RPE."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from ...core.geometry import inverse
from ...core.types import Array
from ...evaluation.kitti import KITTI_LENGTHS, kitti_errors
from ..made_up import block_tour, made_up
from .verdict import Wrong, as_array, as_number, differs, exercise

YAW, LENGTH = 1.0, 400.0  # deg/100 m and metres, of the exercise on a straight road


def judged_pair() -> tuple[Array, Array]:
    """A truth and an estimate (N, 4, 4) that are wrong in every way at once."""
    truth = block_tour(1)
    return truth, made_up(truth, scale=2.0, yaw=3.0, noise=20.0, jitter=0.1, seed=3)


@exercise
def end_frame(function: Callable[..., Any]) -> str:
    """A function (path (N,), first, length) -> first frame beyond path[first] + length, or None."""
    path = np.array([0.0, 1.0, 2.0, 3.0, 3.0, 4.5, 6.0, 7.0])
    for first, length, right in ((0, 2.5, 3), (0, 2.0, 3), (2, 1.0, 5), (1, 5.5, 7), (3, 3.5, 7)):
        answer = function(path.copy(), first, length)
        if answer is None:
            raise Wrong(f"None for first = {first}, length = {length:g}; expected frame {right}.")
        got = as_number(answer)
        if got == right:
            continue
        if path[int(np.clip(got, 0, 7))] - path[first] == length:
            raise Wrong(
                f"frame {got:.0f} has reached {length:g} m, not exceeded it.", "KITTI asks for more than: >."
            )
        if got == int(np.argmax(path > length)):
            raise Wrong("the length is counted from frame 0.", "path[first] + length.")
        raise Wrong(
            f"got {got:.0f} for first = {first}, length = {length:g}; expected {right}.",
            f"the path lengths are {path.tolist()}.",
        )
    try:
        beyond = function(path.copy(), 4, 100.0)
    except IndexError:
        raise Wrong("a path that is too short raises IndexError.", "return None in that case.") from None
    if beyond is not None:
        raise Wrong(
            f"the path ends after 7 m, but the answer for 100 m is {beyond}.",
            "np.argmax of nothing but False is 0: ask whether there is any.",
        )
    return "the first frame beyond the length, or none. Standing still (frames 3 and 4) does no harm."


@exercise
def part_errors(function: Callable[..., Any]) -> str:
    """A function (truth, estimate, first, last, length) -> TE in %, RE in deg/100 m of one sub-sequence."""
    truth, estimate = judged_pair()
    for first, last, length in ((20, 171, 150.0), (150, 352, 200.0)):
        made = _error(truth, estimate, first, last)
        te, re = _measures(made, length)
        answer = function(truth.copy(), estimate.copy(), first, last, length)
        if np.size(answer) != 2:
            raise Wrong("expected two numbers, TE and RE.", "return te, re")
        got = as_array(np.ravel(np.asarray(answer, np.float64)), (2,), "(TE, RE)")
        if not differs(got, np.array([te, re]), 1e-6):
            continue
        if abs(got[0] - te / 100.0) < 1e-8:
            raise Wrong("TE is a fraction, not %.", "times 100.")
        if abs(got[0] - te * length / 100.0) < 1e-6:
            raise Wrong(
                "the translation error is in metres.", "divide by the nominal length, times 100 for %."
            )
        other = _measures(_moved_end(truth, estimate, first, last), length)
        if abs(got[0] - other[0]) < 1e-6:
            raise Wrong(
                "this compares end positions without making the starts equal.",
                "motions: inv(T[first]) @ T[last], once for the truth, once for the estimate.",
            )
        if abs(got[0] - te) > 1e-6:
            raise Wrong(
                f"TE is {got[0]:.4f} %, expected {te:.4f} %.", "the norm of error[:3, 3] / length, times 100."
            )
        if abs(got[1] - np.radians(re)) < 1e-6:
            raise Wrong("TE is right, RE is in radians.", "np.degrees.")
        if abs(got[1] - re / 100.0) < 1e-8:
            raise Wrong("TE is right, RE is per metre.", "deg/100 m: times 100.")
        if abs(got[1] - re * length / 100.0) < 1e-6:
            raise Wrong("TE is right, RE is in degrees.", "divide by the length, times 100.")
        raise Wrong(
            f"TE is right, but RE is {got[1]:.4f}, expected {re:.4f} deg/100 m.",
            "the angle of a rotation is acos((trace - 1) / 2).",
        )
    return "the error of one sub-sequence, as the devkit takes it."


def _error(truth: Array, estimate: Array, first: int, last: int) -> Array:
    return np.asarray(
        np.linalg.inv(inverse(estimate[first]) @ estimate[last]) @ inverse(truth[first]) @ truth[last]
    )


def _moved_end(truth: Array, estimate: Array, first: int, last: int) -> Array:
    return np.asarray(inverse(estimate[last]) @ truth[last])


def _measures(error: Array, length: float) -> tuple[float, float]:
    cosine = float(np.clip((np.trace(error[:3, :3]) - 1.0) / 2.0, -1.0, 1.0))
    te = 100.0 * float(np.linalg.norm(error[:3, 3])) / length
    return te, 100.0 * float(np.degrees(np.arccos(cosine))) / length


@exercise
def yaw_on_a_straight(answer: Any) -> str:
    """TE, %, of a 400 m straight road when the estimate turns by 1 deg/100 m and is right otherwise."""
    value = as_number(answer)
    angle = np.radians(YAW * LENGTH / 100.0)
    right = 100.0 * float(np.hypot(1.0 - np.sin(angle) / angle, (1.0 - np.cos(angle)) / angle))
    if abs(value - 100.0 * angle) < 0.2:
        raise Wrong(
            "the car has not been 4° off all the way.", "the angle grows from 0 to 4°: take the mean angle."
        )
    if abs(value - right * LENGTH / 100.0) < 0.5:
        raise Wrong(f"{value:.3g} m is the error at the end.", "in % of the 400 m?")
    if abs(value - right / 4.0) < 0.05:
        raise Wrong("this is right for 100 m.", "the error in metres grows with the square of the length.")
    if abs(value - right) > 0.1:
        raise Wrong(
            f"{value:.3g} % is not it.",
            "the path is an arc: sideways error ½ · angle · length, with the angle at its end in radians.",
        )
    return f"{right:.2f} %: ½ · 0.0698 · 400 m = 14 m to the side. For 100 m it would be 0.87 %."


@exercise
def once_round(answer: Any) -> str:
    """TE, %, of 800 m once round the block of 800 m, when every step is 1 % too long."""
    value = as_number(answer)
    if abs(value - 1.0) < 0.2:
        raise Wrong(
            "that would be so on a straight road.", "where does the estimate end when the truth is back home?"
        )
    if abs(value) > 0.02:
        raise Wrong(f"{value:.3g} % is not it.", "draw the estimate: it is a slightly larger block.")
    return "nearly nothing: a larger block closes as well. TE sees the end of a sub-sequence, not its middle."


@exercise
def all_errors(function: Callable[..., Any]) -> str:
    """A function (truth, estimate, lengths, step) -> TE, RE: means over all sub-sequences."""
    truth, estimate = judged_pair()
    lengths, step = KITTI_LENGTHS[:4], 10
    errors = kitti_errors(truth, estimate, lengths, step)
    assert errors.te is not None
    assert errors.re is not None
    answer = function(truth.copy(), estimate.copy(), lengths, step)
    if np.size(answer) != 2:
        raise Wrong("expected two numbers, TE and RE.", "return te, re")
    got = as_array(np.ravel(np.asarray(answer, np.float64)), (2,), "(TE, RE)")
    # The library sums the path in single precision, as the devkit does: an end may be one frame later.
    if not differs(got, np.array([errors.te, errors.re]), 5e-3):
        numbers = f"TE {got[0]:.3f} %, RE {got[1]:.3f} deg/100 m"
        return f"{len(errors)} sub-sequences: {numbers}, as `kitti_errors` has it."
    rms = 100.0 * float(np.sqrt(np.mean(errors.t_err**2)))
    if abs(got[0] - rms) < 5e-3:
        raise Wrong("this is the root of the mean square.", "KITTI takes the plain mean.")
    means = [100.0 * float(each.t_err.mean()) for each in errors.by_length(lengths).values()]
    if abs(got[0] - float(np.mean(means))) < 5e-3:
        raise Wrong(
            "this is the mean of the means of each length.",
            "one mean over all sub-sequences: short ones are more frequent and count more.",
        )
    every = kitti_errors(truth, estimate, lengths, 1)
    assert every.te is not None
    if abs(got[0] - every.te) < 5e-3:
        raise Wrong("this starts at every frame.", "range(0, len(truth), step).")
    raise Wrong(
        f"got ({got[0]:.3f}, {got[1]:.3f}), expected ({errors.te:.3f}, {errors.re:.3f}).",
        f"there are {len(errors)} sub-sequences; those beyond the end of the path are left out.",
    )


@exercise
def averages(function: Callable[..., Any]) -> str:
    """A function (list of arrays, one a sequence) -> pooled mean, mean of the sequences' means."""
    given = [np.array([1.0, 1.0, 1.0, 1.0]), np.array([3.0]), np.array([])]
    answer = function([values.copy() for values in given])
    if np.size(answer) != 2:
        raise Wrong("expected two numbers: pooled, plain.", "return pooled, plain")
    numbers = np.ravel(np.asarray(answer, np.float64))
    if np.isnan(numbers).any():
        raise Wrong(
            "a sequence without sub-sequences makes it NaN.", "leave empty ones out of the plain mean."
        )
    if not differs(numbers, np.array([1.4, 2.0]), 1e-9):
        return "1.4 and 2.0 of the same errors. A table has to say which it means."
    if not differs(numbers, np.array([2.0, 1.4]), 1e-9):
        raise Wrong("the two have changed places.", "pooled first.")
    if abs(numbers[0] - 1.4) > 1e-9:
        raise Wrong(f"pooled is {numbers[0]:.3g}, expected 1.4.", "np.concatenate(errors).mean().")
    if abs(numbers[1] - 4.0 / 3.0) < 1e-9:
        raise Wrong("an empty sequence counts as zero.", "it has no error: leave it out.")
    raise Wrong(
        f"the plain mean is {numbers[1]:.3g}, expected 2.", "the mean of each sequence, then their mean."
    )


@exercise
def blind_rpe(facts: Mapping[str, float]) -> str:
    """The panel shows an estimate with RPE under 1 mm a frame, but TE above 2 %."""
    rpe, te = facts.get("RPE", np.nan), facts.get("TE", np.nan)
    if not te > 2.0:
        raise Wrong(f"TE is only {te:.2f} %.", "which made-up error grows from frame to frame?")
    if not rpe < 1.0:
        raise Wrong(
            f"RPE is {rpe:.1f} mm a frame.",
            "scale and noise are in every step: set both to 0. What is left that spoils the path?",
        )
    return (
        f"TE {te:.1f} %, RPE {rpe:.2f} mm: every step is as long as it should be, only its direction is off. "
        "RPE has a second number for that, the rotation. Look at both, or at TE."
    )
