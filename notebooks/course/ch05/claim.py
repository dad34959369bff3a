"""Chapter 5's opening: the same frames with features in boxes kept and removed, and when that matters."""

from __future__ import annotations

import csv
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from vo_lib.data.poses import from_first
from vo_lib.data.sequence import Sequence
from vo_lib.evaluation.ate_rpe import relative_error
from vo_lib.geometry.types import Array
from vo_lib.report.page import ReportTable

from ..colours import BAD, DARK, GOOD, PALE, THIRD
from ..drawing import figure, finish, room, say
from ..frames import true_poses

RESULTS = Path(__file__).parents[2] / "results.md"  # written by `vo data measure_results`
CHOICES = Path(__file__).parents[2] / "choices.csv"  # written by `vo data measure_choices`
THRESHOLD_AND_BOXES = "threshold and boxes"  # its choice whose rows are no differences
SPREAD_OF = "standard deviation over the seeds of "  # in the heads of tables of `results.md`
MEASURED = "kitti/drive_0013", "synthetic/jam"
LINES = ((BAD, 1.5), (GOOD, 3.0), (THIRD, 1.2))  # colour and width: all are seen where they coincide


def true_path(sequence: Sequence) -> Array:
    """True places (N, 3), metres, seen from the first camera."""
    return np.asarray(from_first(true_poses(sequence))[:, :3, 3])


def step_errors(sequence: Sequence, poses: Array) -> tuple[Array, Array]:
    """Error of each step, (N - 1,): of the rotation in degrees, of the translation in millimetres."""
    errors = relative_error(true_poses(sequence), poses)
    return np.degrees(errors.rotation), 1e3 * errors.translation


def claim_lines(sequence: Sequence, *seeds: Mapping[str, Array]) -> str:
    """A line per run: mean errors of a step, and the error of the last position.

    Mean ± standard deviation over the seeds.
    """
    lines, end = [], true_path(sequence)[-1]
    for name in seeds[0]:
        rows = []
        for runs in seeds:
            turn, step = (errors.mean() for errors in step_errors(sequence, runs[name]))
            rows.append((turn, step, 100 * np.linalg.norm(runs[name][-1, :3, 3] - end)))
        turn, step, off = np.mean(rows, axis=0)
        lines.append(f"{name:13}: a step {turn:.4f}° and {step:5.2f} mm wrong; {off:5.2f} cm off at the end")
        if len(seeds) > 1:
            lines[-1] += "; seeds ± {:.4f}°, {:.2f} mm, {:.2f} cm".format(*np.std(rows, axis=0))
    return "\n".join(lines)


def results_table(title: str, only: str = "") -> ReportTable:
    """A table of the page of results, `results.md`; the rows whose name begins with `only`."""
    lines = RESULTS.read_text(encoding="utf-8").split(f"## {title}\n")[1].split("\n## ")[0].splitlines()
    columns, _, *rows = ([c.strip() for c in line.strip("|").split("|")] for line in lines if line[:1] == "|")
    return ReportTable(title, columns, [row for row in rows if row[0].startswith(only)], [])


def whole_drive(section: str, row: str) -> dict[str, str]:
    """TE in % and RE in deg/100 m of a whole drive by method, ± deviation over the seeds, from `results.md`."""

    def numbers(title: str) -> dict[str, str]:
        table = results_table(f"{section}: {title}", row)
        cells = next((line for line in table.rows if line[0] == row), [row])
        return dict(zip(table.columns[1:], cells[1:], strict=False))

    kinds = "TE, %", "RE, deg/100 m"
    means, spreads = ([numbers(of + kind) for kind in kinds] for of in ("", SPREAD_OF))
    # Rows without a spread are left out of its tables.
    return {
        method: " / ".join(
            f"{m[method]} ± {d.get(method, '0.000')}" for m, d in zip(means, spreads, strict=True)
        )
        for method in means[0]
    }


def claim_figure(
    sequence: Sequence, runs: Mapping[str, Array], height: int = 250, frame: int | None = None
) -> Figure:
    """Errors of each step by run, one `frame` marked, and the paths from above; x and z have their own scales."""
    made, (turns, lengths, path) = figure(height, 3, (1.0, 1.0, 0.8))
    true = true_path(sequence)
    frames = int(sequence.frames[0]) + np.arange(1, len(true))
    path.plot(true[:, 0], true[:, 2], color=DARK, linewidth=3, label="truth")
    for (name, poses), (colour, width) in zip(runs.items(), LINES, strict=False):
        turn, step = step_errors(sequence, poses)
        style: dict[str, Any] = {
            "color": colour,
            "linewidth": width,
            "zorder": 6 - width,
        }  # thin lines above wide ones
        turns.plot(frames, turn, label=name, **style)
        lengths.plot(frames, step, **style)
        path.plot(poses[:, 0, 3], poses[:, 2, 3], **style)
    for axis in (turns, lengths):
        highest = max(float(np.asarray(line.get_ydata(), np.float64).max()) for line in axis.get_lines())
        axis.set_ylim(0, room(1.35 * highest))  # room for the legend above the lines
        if frame is not None:
            axis.axvline(frames[frame - 1], ymax=0.7, color=PALE, linewidth=1)
    reach = max(float(np.abs(places[:, 0, 3]).max()) for places in runs.values())
    path.set_xlim(-room(1.2 * reach, least=0.5), room(1.2 * reach, least=0.5))
    finish(turns, "rotation error of each step [deg]", "frame", "", "upper left")
    finish(lengths, "translation error of each step [mm]", "frame")
    finish(path, "estimated path", "x, right [m]", "z, forward [m]", "lower left")
    return made


def by_threshold(path: Path = CHOICES) -> dict[str, dict[str, Array]]:
    """RE over the inlier threshold, by sequence, with all features and with boxes removed.

    Returns
    -------
    (K, 3) each, by threshold: threshold in pixels, mean RE and its deviation over seeds, deg/100 m.
    """
    measured: dict[str, dict[str, list[list[float]]]] = {}
    with path.open(encoding="utf-8", newline="") as lines:
        for row in csv.DictReader(lines):
            if row["choice"] == THRESHOLD_AND_BOXES:
                threshold, _, boxes = row["alternative"].partition(" px, ")
                numbers = [float(each) for each in (threshold, row["re"], row["re_sd"])]
                measured.setdefault(row["sequence"], {}).setdefault(boxes, []).append(numbers)
    return {
        name: {boxes: np.array(sorted(rows)) for boxes, rows in each.items()}
        for name, each in measured.items()
    }


def threshold_lines(measured: Mapping[str, Mapping[str, Array]]) -> str:
    """A line for each sequence and threshold: RE with all features and without those in boxes."""
    return "\n".join(
        f"{name:13}, {rows[0][0]:4g} px: RE "
        + ", ".join(f"{re:5.2f} ± {spread:.2f} {boxes}" for boxes, (_, re, spread) in zip(each, rows))
        for name, each in measured.items()
        for rows in zip(*each.values(), strict=True)
    )


def threshold_figure(measured: Mapping[str, Mapping[str, Array]], height: int = 260) -> Figure:
    """RE over the inlier threshold, with all features and with boxes removed; bars are one deviation."""
    made, axes = figure(height, len(MEASURED))
    for axis, name in zip(axes, MEASURED, strict=True):
        if name not in measured:
            say(axis, f"{CHOICES.name} has no rows '{THRESHOLD_AND_BOXES}'\nof {name}")
            continue
        for (boxes, rows), (colour, _) in zip(measured[name].items(), LINES, strict=False):
            threshold, re, deviation = rows.T
            axis.errorbar(range(len(rows)), re, deviation, color=colour, marker="o", capsize=3, label=boxes)
        axis.set_xticks(range(len(rows)), [f"{each:g}" for each in threshold])
        axis.set_ylim(0)
        finish(axis, f"rotation error, {name}", "inlier threshold [px]", "RE [deg/100 m]", "upper left")
    return made
