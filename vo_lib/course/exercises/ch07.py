"""Exercises of chapter 7: the average, the paper's unit and its odd row, a gain and its spread, a sweep."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ...config import preset
from ...core.matches import empty_matches
from ...core.settings import replace
from ...core.types import Array
from ...data.sequence import Sequence
from ...evaluation.kitti import kitti_errors
from ...runs.runner import TimedMatches, run_methods
from ...synthetic.tracks import TrackConfig, simulate_tracks
from ..lessons import CAMERA, drive
from .verdict import Wrong, as_array, as_number, differs, exercise

USED, TRUE = 5555.6, 100.0 * 180.0 / np.pi  # factors from rad/m to deg/100 m
PRINTED, OF_ROWS, ROWS = 2.43, 2.10, 10  # the paper's VISO2 average, the mean of its rows, how many
FRAMES, LENGTHS, VALUES = 30, (20.0,), (1, 4, 100)
MOST_SETS, WORSE = 20, 1.05


@exercise
def paper_average(function: Callable[..., Any]) -> str:
    """A function (te, a dict of numbers or None by sequence) -> the mean as the paper's Avg row has it."""
    te: dict[str, float | None] = {"00": 1.0, "01": 9.0, "02": 2.0, "04": None, "10": 6.0}
    try:
        got = as_number(function(dict(te)))
    except TypeError:
        raise Wrong(
            "a sequence without any sub-sequence has None, which cannot be added.", "leave None out."
        ) from None
    if abs(got - 3.0) < 1e-9:
        return "the plain mean of the rows there are, without 01."
    if abs(got - 4.5) < 1e-9:
        raise Wrong("01 is in it.", 'the paper\'s table has no row 01: leave out the name "01".')
    if abs(got - 2.25) < 1e-9 or abs(got - 3.6) < 1e-9:
        raise Wrong("None was counted as 0.", "divide by the number of rows that have a number.")
    if abs(got - 9.0) < 1e-9 or abs(got - 18.0) < 1e-9:
        raise Wrong("this is the sum.", "divide by how many rows there are.")
    raise Wrong(f"got {got:.4g} for {te}, expected 3.", "three rows are left: 1, 2 and 6.")


@exercise
def true_rotation_error(answer: Any) -> str:
    """The RE in deg/100 m of a row that the paper prints as 1.000, if it took 5555.6."""
    got, right = as_number(answer), TRUE / USED
    if abs(got - right) < 1e-3:
        return f"{right:.4f}: what is printed reads 3 % low."
    if abs(got - USED / TRUE) < 1e-3:
        raise Wrong("this is the other way round.", "printed / 5555.6 is in rad/m; times 100 · 180/π.")
    if abs(got - (right - 1.0)) < 1e-3 or abs(got - 100.0 * (right - 1.0)) < 0.1:
        raise Wrong("this is the difference, not the RE.", "add it to what is printed.")
    raise Wrong(f"{got:.4g} is not it.", "back to rad/m with the factor used, then on with 100 · 180/π.")


@exercise
def odd_row(answer: Any) -> str:
    """By how much one of ten rows must change for their mean to become what is printed, %."""
    got, right = as_number(answer), ROWS * (PRINTED - OF_ROWS)
    if abs(got - right) < 0.02:
        return (
            f"{right:.1f} %, more than the mean itself. So it is no misprint of one digit: another set of "
            "sequences, or another run."
        )
    if abs(got - right / ROWS) < 0.02:
        raise Wrong("this is how far the means are apart.", "a row enters the mean with a weight of 1/10.")
    if abs(got + right) < 0.02:
        raise Wrong("the sign: the printed mean is the larger one.", "2.43 - 2.10.")
    raise Wrong(f"{got:.4g} is not it.", "the sum of the ten rows changes by 10 times what the mean changes.")


@exercise
def gain(function: Callable[..., Any]) -> str:
    """A function (before (S,), after (S,)) -> mean and standard deviation of the change, seed by seed."""
    before, after = np.array([1.0, 1.2, 1.4, 1.6, 1.9]), np.array([0.9, 1.05, 1.3, 1.5, 1.7])
    change = after - before
    answer = function(before.copy(), after.copy())
    if np.size(answer) != 2:
        raise Wrong("expected two numbers, the mean and the standard deviation.", "return mean, spread")
    got = as_array(np.ravel(np.asarray(answer, np.float64)), (2,), "(mean, spread)")
    if abs(got[0] - change.mean()) > 1e-9:
        if abs(got[0] + change.mean()) < 1e-9:
            raise Wrong("the sign: an error that fell should give a negative change.", "after - before.")
        raise Wrong(f"the mean is {got[0]:.4g}, expected {change.mean():.4g}.", "np.mean(after - before).")
    if abs(got[1] - change.std()) < 1e-9 or abs(got[1] - change.std(ddof=1)) < 1e-9:
        return (
            f"{change.mean():+.2f} ± {got[1]:.2f}, each alone ± {before.std():.2f}: what chance "
            "does to both alike has cancelled."
        )
    if min(abs(got[1] - one.std()) for one in (before, after)) < 1e-9:
        raise Wrong("the spread is that of one method alone.", "the standard deviation of after - before.")
    apart = (float(np.hypot(before.std(), after.std())), abs(float(after.std() - before.std())))
    if min(abs(got[1] - value) for value in apart) < 1e-9:
        raise Wrong(
            "the spread comes from the two methods' own spreads.",
            "subtract seed by seed first; then the standard deviation.",
        )
    if abs(got[1] - change.var()) < 1e-9:
        raise Wrong("this is the variance.", "its root: np.std.")
    raise Wrong(f"the spread is {got[1]:.4g}, expected {change.std():.4g}.", "np.std(after - before).")


@functools.lru_cache(maxsize=1)
def simulated() -> tuple[Sequence, list[TimedMatches]]:
    """A sequence of FRAMES simulated frames, a third of its matches wrong, and these matches."""
    truth = drive(FRAMES - 1)
    tracks = TrackConfig(points=200, noise=0.3, wrong=0.3)
    matches: list[TimedMatches] = [(empty_matches(), {})]
    matches += [(frame.matches, {}) for frame in simulate_tracks(truth, CAMERA, tracks, 0)]
    frames = tuple(f"{number:06d}" for number in range(FRAMES))
    times = 0.1 * np.arange(FRAMES, dtype=np.float64)
    return Sequence("simulated", Path("simulated"), frames, CAMERA, times, truth, None), matches


def errors_of_sets(seed: int = 0) -> tuple[Array, Array]:
    """TE and RE of `solution_selection` on the simulated frames by number of sets, (len(VALUES),) each."""
    sequence, matches = simulated()
    assert sequence.truth is not None
    errors = []
    for value in VALUES:
        config = replace(preset("solution_selection", seed=seed), "selection.sets", value)
        poses = run_methods(sequence, {"": config}, matches=matches)[""].poses
        found = kitti_errors(sequence.truth, poses, LENGTHS, 1)
        errors.append((found.te, found.re))
    te, re = np.array(errors, np.float64).T
    return te, re


@exercise
def sweep(function: Callable[..., Any]) -> str:
    """A function (sequence, matches, values) -> TE in % over 20 m, for each number of five-point sets."""
    sequence, matches = simulated()
    answer = function(sequence, list(matches), VALUES)
    if answer is not None and any(value is None for value in np.ravel(np.asarray(answer, dtype=object))):
        raise Wrong(
            "a TE is None: no sub-sequence fits.",
            "the path has 29 m; lengths=(20,), and a start every frame.",
        )
    got = as_array(answer, (len(VALUES),), "the result")
    te, re = errors_of_sets()
    if not differs(got, te, 1e-9):
        words = ", ".join(f"{value}: {error:.2f} %" for value, error in zip(VALUES, te, strict=True))
        return f"TE by sets: {words}. The matches were found once, only the back end ran again."
    if not differs(got, np.full(len(VALUES), got[0]), 1e-12):
        raise Wrong(
            "all values give the same TE: the setting has not changed.",
            '`replace` gives a new configuration: config = replace(preset(…), "selection.sets", value).',
        )
    if not differs(got, re, 1e-9):
        raise Wrong("this is RE.", "`.te` of what kitti_errors gives.")
    if not differs(100.0 * got, te, 1e-9):
        raise Wrong("TE is a fraction, not %.", "`.te` is in % already.")
    raise Wrong(
        f"got {got.round(4)}, expected {te.round(4)}.",
        'preset("solution_selection"), seed 0, lengths=(20,), step=1.',
    )


@exercise
def fewer_sets(facts: Mapping[str, float]) -> str:
    """The panel shows a run with 20 sets or fewer whose TE is at most 5 % above the preset's."""
    sets, te = facts.get("five-point sets", np.nan), facts.get("TE", np.nan)
    preset_te = facts.get("TE of the preset", np.nan)
    if not np.isfinite(te):
        raise Wrong("the panel shows no TE yet.", "wait until its bar is gone, then run this cell again.")
    if not sets <= MOST_SETS:
        raise Wrong(
            f"{sets:.0f} five-point sets are more than {MOST_SETS}.", "move the slider of five-point sets."
        )
    if te > WORSE * preset_te:
        raise Wrong(
            f"TE is {te:.4f} %, more than 5 % above the preset's {preset_te:.4f} %.",
            "a few sets more, or `refined`.",
        )
    return f"{sets:.0f} sets, TE {te:.4f} % against {preset_te:.4f} %: on this part of this street."
