"""Chapter 5, part one: runs with and without the features in boxes, and measured results."""

from __future__ import annotations

import csv
from collections import defaultdict
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from vo_lib.data.poses import from_first
from vo_lib.data.sequence import Sequence
from vo_lib.evaluation.ate_rpe import relative_error
from vo_lib.evaluation.statistics import one_run_shows, standard_deviation
from vo_lib.geometry.camera import StereoCamera
from vo_lib.geometry.matches import StereoMatches
from vo_lib.geometry.motion import transform
from vo_lib.geometry.types import Array

from ..colours import BAD, DARK, GOOD, PALE, THIRD
from ..drawing import empty, figure, finish, room, round_limits
from ..measured_results import CHOICES, THRESHOLD_AND_BOXES, whole_drive_errors

LINES = ((BAD, 1.5), (GOOD, 3.0), (THIRD, 1.2))  # colour and width, visible where lines coincide


def true_path(sequence: Sequence) -> Array:
    """True positions (N, 3) in the first camera, metres."""
    return np.asarray(from_first(sequence.true_poses)[:, :3, 3])


def step_errors(sequence: Sequence, poses: Array) -> tuple[Array, Array]:
    """Rotation error, degrees, and translation error, millimetres, of each step, both (N - 1,).

    poses : (N, 4, 4) of the first N frames of the sequence.
    """
    errors = relative_error(sequence.true_poses[: len(poses)], poses)
    return np.degrees(errors.rotation), 1e3 * errors.translation


def _mean_errors(sequence: Sequence, poses: Array) -> tuple[float, float, float]:
    """Mean rotation error of a step, degrees; its mean translation error, mm; distance from the true end, cm."""
    turns, steps = step_errors(sequence, poses)
    off = 100 * float(np.linalg.norm(poses[-1, :3, 3] - true_path(sequence)[-1]))
    return float(turns.mean()), float(steps.mean()), off


def claim_lines(sequence: Sequence, *runs_of_seeds: Mapping[str, Array]) -> str:
    """A line for each run: mean errors of a step, and the distance of the end of the path from the true end.

    For several seeds, the line has the mean and the standard deviation over the seeds: what one run may show.

    runs_of_seeds : for each seed, the poses (N, 4, 4) of each run by its name.
    """
    lines = []
    for name in runs_of_seeds[0]:
        rows = [_mean_errors(sequence, runs[name]) for runs in runs_of_seeds]
        turn, step, off = np.mean(rows, axis=0)
        lines.append(f"{name:13}: error per step {turn:.4f}° and {step:5.2f} mm, at the end {off:5.2f} cm")
        if len(runs_of_seeds) > 1:
            lines[-1] += "; seeds ± {:.4f}°, {:.2f} mm, {:.2f} cm".format(*standard_deviation(rows))
    return "\n".join(lines)


def whole_drive_line(section: str, row: str) -> str:
    """What the removal of features in boxes changes on a whole drive, and whether one run would show it.

    section : as in the titles of results.md, "Variant kit".
    row : a whole drive, "kitti/drive_0013, 50 m, axes removed".
    """
    errors = whole_drive_errors(section, row)
    kept = errors["solution_selection"]
    removed = errors["feature_selection"]
    parts = []
    for name, error, deviation in (("TE", 0, 2), ("RE", 1, 3)):  # places in the arrays
        word = "not shown"
        if one_run_shows(kept[error], kept[deviation], removed[error], removed[deviation]):
            word = "better" if removed[error] < kept[error] else "worse"
        parts.append(f"{name} {kept[error]:.3f} → {removed[error]:.3f} ({word})")
    return f"{section.rpartition(' ')[2]:9} {row:17}: {', '.join(parts)}"


def errors_by_seed(
    sequence: Sequence, runs_of_seeds: list[dict[str, Array]]
) -> list[tuple[str, str, dict[str, Array]]]:
    """Mean errors of a step and the error of the end: name, unit, and the values over the seeds by run.

    runs_of_seeds : for each seed, the poses (N, 4, 4) of each run by its name.
    """
    kinds = (("rotation", "°"), ("translation", "mm"), ("end", "cm"))
    values: dict[str, list[tuple[float, float, float]]] = defaultdict(list)
    for runs in runs_of_seeds:
        for name, poses in runs.items():
            values[name].append(_mean_errors(sequence, poses))
    tables = {name: np.array(rows) for name, rows in values.items()}  # (seeds, kinds)
    errors = []
    for n, (kind, unit) in enumerate(kinds):
        errors.append((kind, unit, {name: table[:, n] for name, table in tables.items()}))
    return errors


def seeds_figure(sequence: Sequence, runs_of_seeds: list[dict[str, Array]], height: int = 230) -> Figure:
    """The errors of each run as dots, for each seed joined by a line, so that one sees how far runs overlap.

    runs_of_seeds : for each seed, the poses (N, 4, 4) of each run by its name.
    """
    kinds = errors_by_seed(sequence, runs_of_seeds)
    made, axes = figure(height, len(kinds))
    for axis, (kind, unit, errors) in zip(axes, kinds, strict=True):
        names = list(errors)
        values = np.array([errors[name] for name in names])
        axis.plot(range(len(names)), values, color=PALE, linewidth=1)
        for place, colour in zip(range(len(names)), (BAD, GOOD, THIRD), strict=False):
            axis.plot(np.full(values.shape[1], place), values[place], "o", color=colour)
        axis.set(xlim=(-0.5, len(names) - 0.5), ylim=(0, room(1.1 * float(values.max()))))
        axis.set_xticks(range(len(names)), names)
        what = "error of the end" if kind == "end" else f"{kind} error of a step"
        finish(axis, f"{what} [{unit}]")
    return made


def three_features(camera: StereoCamera, T_cp: Array) -> StereoMatches:
    """Matches of three features of things 10 m ahead that moved since the previous frame, without noise.

    Two moved 2 cm to the right, one above the epipole and one beside it; the third one moved 20 cm ahead.
    T_cp : motion of the camera.
    """
    X_p = np.array([[0.0, -2.0, 10.0], [3.0, 0.0, 10.0], [3.0, 1.0, 10.0]])
    steps = np.array([[0.02, 0.0, 0.0], [0.02, 0.0, 0.0], [0.0, 0.0, 0.2]])
    X_c = transform(T_cp, X_p) + steps
    prev_left, prev_right = camera.project(X_p)
    cur_left, cur_right = camera.project(X_c)
    count = len(X_p)
    return StereoMatches(
        prev_left, prev_right, cur_left, cur_right, np.ones(count, np.int64), np.ones(count), np.arange(count)
    )


class ClaimChart:
    """Errors of each step by run, and paths from above with unequal axis scales.

    The axes serve for one picture after the other: to make them takes half of the time of a picture.
    """

    def __init__(self, height: int = 250):
        self.figure, self.axes = figure(height, 3, (1.0, 1.0, 0.8))

    def draw(self, sequence: Sequence, runs: Mapping[str, Array], frame: int | None = None) -> Figure:
        """The chart of some runs, with a mark at `frame`; it is valid until the next call.

        A run may have only the first frames of the sequence.
        """
        for axis in self.axes:
            empty(axis)
        turns, lengths, path = self.axes
        true = true_path(sequence)
        frames = int(sequence.frames[0]) + np.arange(1, len(true))
        for (name, poses), (colour, width) in zip(runs.items(), LINES, strict=False):
            turn, step = step_errors(sequence, poses)
            look: Any = {
                "color": colour,
                "linewidth": width,
                "zorder": 6 - width,
            }  # thin lines above wide ones
            turns.plot(frames[: len(turn)], turn, label=name, **look)
            lengths.plot(frames[: len(step)], step, **look)
            path.plot(*poses[:, [0, 2], 3].T, **look)
        path.plot(true[:, 0], true[:, 2], color=DARK, linewidth=1, label="truth", zorder=7)
        for axis in (turns, lengths):
            highest = max(float(np.asarray(line.get_ydata(), np.float64).max()) for line in axis.get_lines())
            axis.set_ylim(0, room(1.35 * highest))  # room for the legend above the lines
            if frame is not None:
                axis.axvline(frames[frame - 1], ymax=0.7, color=PALE, linewidth=1)
        sideways = [true[:, 0], *(poses[:, 0, 3] for poses in runs.values())]
        reach = max(float(np.abs(places).max()) for places in sideways)
        round_limits(path.yaxis)
        path.set_xlim(-room(1.2 * reach, least=0.5), room(1.2 * reach, least=0.5))
        finish(turns, "rotation error of each step [deg]", "frame", "", "upper left")
        finish(lengths, "translation error of each step [mm]", "frame")
        finish(path, "estimated path", "x, right [m]", "z, forward [m]", "above")
        return self.figure


def claim_figure(
    sequence: Sequence, runs: Mapping[str, Array], height: int = 250, frame: int | None = None
) -> Figure:
    """The chart of `ClaimChart` for some runs."""
    return ClaimChart(height).draw(sequence, runs, frame)


def by_threshold(path: Path = CHOICES) -> dict[tuple[str, str], Array]:
    """RE by inlier threshold, for each key (sequence, "all features" or "boxes removed").

    Returns
    -------
    Arrays (K, 3): threshold, pixels; mean RE and standard deviation of RE over the seeds, deg/100 m.
    """
    measured = defaultdict(list)
    with path.open(encoding="utf-8", newline="") as lines:
        for row in csv.DictReader(lines):
            if row["choice"] == THRESHOLD_AND_BOXES:
                threshold, _, boxes = row["alternative"].partition(" px, ")
                numbers = (float(threshold), float(row["re"]), float(row["re_sd"]))
                measured[row["sequence"], boxes].append(numbers)
    return {key: np.array(sorted(rows)) for key, rows in measured.items()}


def threshold_figure(measured: Mapping[tuple[str, str], Array]) -> Figure:
    """RE by inlier threshold, one chart per sequence; bars are one standard deviation."""
    names = list(dict.fromkeys(name for name, _ in measured))
    made, axes = figure(260, len(names))
    for (name, boxes), rows in measured.items():
        axis = axes[names.index(name)]
        colour = GOOD if boxes == "boxes removed" else BAD
        threshold, re, deviation = rows.T
        axis.errorbar(range(len(rows)), re, deviation, color=colour, marker="o", capsize=3, label=boxes)
        axis.set_xticks(range(len(rows)), [f"{each:g}" for each in threshold])
        axis.set_ylim(0)
        finish(axis, f"rotation error, {name}", "inlier threshold [px]", "RE [deg/100 m]", "upper left")
    return made
