"""Exercises of chapter 7: the average, the paper's unit and its odd row, a gain and its spread, a sweep."""

from __future__ import annotations

import functools
from pathlib import Path
from typing import Any

import numpy as np

from vo_lib.config import preset
from vo_lib.core.matches import empty_matches
from vo_lib.core.settings import replace
from vo_lib.core.types import Array
from vo_lib.data.sequence import Sequence
from vo_lib.data.tracks import TrackConfig, simulate_tracks
from vo_lib.evaluation.kitti import kitti_errors
from vo_lib.runs.runner import TimedMatches, run_methods

from ..checker import Exercise
from ..lessons import CAMERA, drive

USED, TRUE = 5555.6, 100.0 * 180.0 / np.pi  # factors from rad/m to deg/100 m
PRINTED, OF_ROWS, ROWS = 2.43, 2.10, 10  # the paper's VISO2 average, the mean of its rows, how many
FRAMES, LENGTHS, VALUES = 30, (20.0,), (8, 16, 100)
MOST_SETS, WORSE = 20, 1.05


def rows(te: dict[str, Any], without: str = "01", none: Any = None) -> list[float]:
    """The numbers of a column without a row, with something in the place of None."""
    values = [none if value is None else value for name, value in te.items() if name != without]
    return [value for value in values if value is not None]


def change(before: Array, after: Array, spread: float | None = None) -> tuple[float, float]:
    """Mean and standard deviation of the change, or another spread."""
    return float(np.mean(after - before)), float(np.std(after - before) if spread is None else spread)


@functools.cache
def simulated() -> tuple[Sequence, list[TimedMatches]]:
    """A sequence of FRAMES simulated frames, a third of its matches wrong, and these matches."""
    truth = drive(FRAMES - 1)
    tracks = TrackConfig(points=200, noise=0.3, wrong=0.3)
    matches: list[TimedMatches] = [(empty_matches(), {})]
    matches += [(frame.matches, {}) for frame in simulate_tracks(truth, CAMERA, tracks, 0)]
    frames = tuple(f"{number:06d}" for number in range(FRAMES))
    times = 0.1 * np.arange(FRAMES, dtype=np.float64)
    return Sequence("simulated", Path("simulated"), frames, CAMERA, times, truth, None), matches


@functools.cache
def errors_of_sets() -> tuple[Array, Array]:
    """TE and RE of `solution_selection` on the simulated frames by number of sets, (len(VALUES),) each."""
    sequence, matches = simulated()
    assert sequence.truth is not None
    errors = []
    for value in VALUES:
        config = replace(preset("solution_selection"), "selection.sets", value)
        poses = run_methods(sequence, {"": config}, matches=matches)[""].poses
        found = kitti_errors(sequence.truth, poses, LENGTHS, 1)
        errors.append((found.te, found.re))
    te, re = np.array(errors, np.float64).T
    return te, re


paper_average = Exercise(
    "ch07.paper_average",
    lambda te: np.mean(rows(te)),
    lambda: [({"00": 1.0, "01": 9.0, "02": 2.0, "04": None, "10": 6.0},)],
)

true_rotation_error = Exercise("ch07.true_rotation_error", TRUE / USED, atol=1e-3)

odd_row = Exercise("ch07.odd_row", ROWS * (PRINTED - OF_ROWS), atol=0.02)

gain = Exercise(
    "ch07.gain",
    change,
    lambda: [(np.array([1.0, 1.2, 1.4, 1.6, 1.9]), np.array([0.9, 1.05, 1.3, 1.5, 1.7]))],
    also=(lambda before, after: change(before, after, np.std(after - before, ddof=1)),),
    parts=("mean", "spread"),
)

sweep = Exercise(
    "ch07.sweep", lambda sequence, matches, values: errors_of_sets()[0], lambda: [(*simulated(), VALUES)]
)

fewer_sets = Exercise("ch07.fewer_sets", {"five-point sets": 20.0, "TE": 0.05, "TE of the preset": 0.049})
