"""Chapter 7, drawn: Figure 4 and what it hides, Table 1 as dots with their spread, and steps."""

from __future__ import annotations

import csv
import html
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from vo_lib.core.types import Array
from vo_lib.data.sequence import KITTI
from vo_lib.evaluation.ate_rpe import RelativeError
from vo_lib.evaluation.kitti import trajectory_distances
from vo_lib.tables.entries import Entry, group_entries
from vo_lib.tables.paper import PaperTable, read_paper_table
from vo_lib.tables.plots import METHOD_MARKERS, TRUTH_COLOUR, draw_drift, draw_trajectories, method_colour
from vo_lib.tables.report import ReportTable
from vo_lib.tables.table1 import layout_tables, method_table

from ..drawing import CYCLE, DARK, FONT_SIZE, PALE, figure, finish, log_axis, room

CHOICES = Path(__file__).parents[2] / "choices.csv"  # written by `vo data measure_choices`
HALF = 0.36  # of the distance between two sequences: the methods stand side by side within it


def draw_paths(axis: Axes, title: str, truth: Array, estimates: dict[str, Array], frame: int) -> None:
    """As the paper's Figure 4, with the place of a frame."""
    draw_trajectories(axis, "", truth, estimates)
    place = (np.linalg.inv(truth[0]) @ truth[frame])[[0, 2], 3]
    axis.plot(*place, "o", color=DARK, markersize=7, markerfacecolor="none")
    finish(axis, title, "x, right [m]", "z, forward [m]")


def draw_errors(axis: Axes, entries: list[Entry], rotation: bool, paper: PaperTable | None = None) -> None:
    """TE or RE of each sequence: a dot a method, a bar for one standard deviation, the paper's as a dash."""
    sequences = list(dict.fromkeys(entry.sequence for entry in entries))
    methods = list(dict.fromkeys(entry.method for entry in entries))
    places = np.linspace(-HALF, HALF, len(methods)) if len(methods) > 1 else np.zeros(1)
    for entry in entries:
        number = methods.index(entry.method)
        x = sequences.index(entry.sequence) + places[number]
        draw_dot(axis, x, entry.re if rotation else entry.te, entry.method, number)
        if paper is not None:
            printed = paper.value(entry.sequence.removeprefix(KITTI), entry.method)[int(rotation)]
            if printed is not None:
                axis.plot(x, printed, "_", color=DARK, markersize=14)
    axis.set_xticks(range(len(sequences)), [name.removeprefix(KITTI) for name in sequences])
    axis.set_xlim(-0.6, len(sequences) - 0.4)
    finish_dots(axis, "rotation error" if rotation else "translation error", rotation)


def draw_dot(axis: Axes, x: float, values: Array, name: str, number: int, hollow: bool = False) -> None:
    """Mean over seeds as the method's marker, a bar from a standard deviation below to one above."""
    if len(values) == 0 or not np.isfinite(values).all():
        return
    colour = PALE if hollow else method_colour(name, number)
    mean, spread = float(values.mean()), float(values.std())
    axis.plot([x, x], [mean - spread, mean + spread], color=colour, linewidth=2)
    axis.plot(x, mean, METHOD_MARKERS.get(name, "o"), color=colour, markersize=7)


def finish_dots(axis: Axes, title: str, rotation: bool) -> None:
    """From 0 to a little above the highest dot."""
    axis.set_ylim(0, 1.08 * axis.get_ylim()[1])
    finish(axis, title, "", _unit(rotation))


def _unit(rotation: bool) -> str:
    return "RE [deg/100 m]" if rotation else "TE [%]"


def errors_figure(entries: list[Entry], height: int, paper: PaperTable | None = None) -> Figure:
    """TE and RE side by side, as `draw_errors`."""
    made, axes = figure(height, 2)
    for axis, rotation in zip(axes, (False, True), strict=True):
        draw_errors(axis, entries, rotation, paper)
    return made


def paths_figure(entries: list[Entry], frame: int, height: int) -> Figure:
    """One sequence: paths of all methods' first seeds from above, and their distances from the truth."""
    truth, estimates = entries[0].truth, {entry.method: entry.poses for entry in entries}
    made, (paths, drift) = figure(height, 2)
    frame = min(frame, len(truth) - 1)
    draw_paths(paths, f"{entries[0].sequence}, {len(truth)} frames", truth, estimates, frame)
    draw_drift(drift, truth, estimates)
    drift.axvline(float(trajectory_distances(truth)[frame]), color=PALE, linewidth=1)
    finish(drift, "distance from the truth", "along the path [m]", "distance [m]")
    return made


def plan_figure(truth: Array, frame: int, title: str, words: str, height: int) -> Figure:
    """The path to be run, and words beside it."""
    made, (paths, text) = figure(height, 2)
    draw_paths(paths, title, truth, {}, frame)
    text.text(0.0, 0.5, words, fontsize=FONT_SIZE + 1, color=DARK, va="center", transform=text.transAxes)
    text.set_axis_off()
    return made


def steps_figure(errors: Mapping[str, RelativeError], frame: int, method: str, height: int = 240) -> Figure:
    """Rotation and translation error of each step of several runs of a method, by name."""
    made, (left, right) = figure(height, 2)
    turns = {name: 1e3 * np.degrees(each.rotation) for name, each in errors.items()}
    millimetres = {name: 1e3 * each.translation for name, each in errors.items()}
    steps_chart(left, turns, frame, f"rotation error of each step, {method}", "0.001 deg")
    steps_chart(right, millimetres, frame, f"translation error of each step, {method}", "mm")
    return made


def steps_chart(axis: Axes, errors: Mapping[str, Array], frame: int, title: str, y: str) -> None:
    """Errors of each step, (N - 1,), by name; those of "preset" in grey, below the others."""
    for name, values in errors.items():
        colour, width = (PALE, 3.0) if name == "preset" else (TRUTH_COLOUR, 1.2)
        axis.plot(np.arange(1, len(values) + 1), values, color=colour, linewidth=width, label=name)
    axis.axvline(frame, ymax=0.8, color=DARK, linewidth=0.8)  # below the legend
    axis.set_xlim(0, max(map(len, errors.values())) + 1)
    # The legend stands above the highest value.
    axis.set_ylim(0, room(1.25 * max(float(values.max()) for values in errors.values()), least=1e-3))
    finish(axis, title, "frame", y)
    axis.legend(loc="upper left", fontsize=FONT_SIZE - 1, frameon=False, ncols=len(errors))


def methods_chart(axis: Axes, errors: Mapping[str, tuple[Array, Array]], rotation: bool) -> None:
    """TE or RE (S,) over seeds by method, each with the preset, grey, and with changed settings."""
    for number, (method, (preset, changed)) in enumerate(errors.items()):
        draw_dot(axis, number - 0.15, preset, method, number, hollow=True)
        draw_dot(axis, number + 0.15, changed, method, number)
    axis.set_xticks(range(len(errors)), [name.replace("_selection", "\nselection") for name in errors])
    axis.set_xlim(-0.5, len(errors) - 0.5)
    known = np.concatenate([values for pair in errors.values() for values in pair])
    highest = float(np.max(known, initial=0.0, where=np.isfinite(known)))
    axis.set_ylim(0, room(1.08 * highest, least=1e-3))
    finish(axis, "", "", _unit(rotation))


def table_tables(entries: list[Entry], paper: PaperTable | None = None) -> list[ReportTable]:
    """One sequence's methods, a row each; several in the paper's layout, KITTI's with its numbers."""
    paper = read_paper_table() if paper is None else paper
    tables = []
    for group in group_entries(entries):
        if len(group.sequences) == 1:
            tables.append(method_table(list(group.entries.values())))
        if len(group.sequences) > 1 or group.kitti:
            tables += layout_tables(group, paper)
    return tables


def table_html(table: ReportTable) -> str:
    """A table with its notes, for a notebook."""
    cell = 'style="padding:1px 10px;text-align:{}"'

    def row(words: list[str], tag: str) -> str:
        sides = ["left", *["right"] * (len(words) - 1)]
        cells = [
            f"<{tag} {cell.format(side)}>{_lines(word)}</{tag}>"
            for side, word in zip(sides, words, strict=True)
        ]
        return f"<tr>{''.join(cells)}</tr>"

    rows = row(table.columns, "th") + "".join(row(words, "td") for words in table.rows)
    head = "".join(f"<div>{html.escape(line)}</div>" for line in table.head)
    notes = "".join(
        f'<div style="font-size:11px;opacity:.75">{html.escape(note)}</div>' for note in table.notes
    )
    return (
        f'<div style="margin:8px 0;overflow-x:auto"><b>{html.escape(table.title)}</b>{head}'
        f'<table style="border-collapse:collapse;font-size:12px;margin:4px 0">{rows}</table>{notes}</div>'
    )


def _lines(word: str) -> str:
    return html.escape(word).replace("\n", "<br>")


def choice_ratios(path: Path = CHOICES) -> dict[str, dict[str, dict[str, float]]]:
    """TE with another choice over TE as published: by choice, alternative and sequence.

    The choices come in the order of their largest mean |log ratio| over the sequences.
    """
    with path.open(encoding="utf-8", newline="") as lines:
        rows = [row for row in csv.DictReader(lines) if row["te"]]
    plain = {row["sequence"]: float(row["te"]) for row in rows if not row["alternative"]}
    ratios: dict[str, dict[str, dict[str, float]]] = {}
    for row in rows:
        if row["alternative"]:
            cells = ratios.setdefault(row["choice"], {}).setdefault(row["alternative"], {})
            cells[row["sequence"]] = 1 + float(row["te"]) / plain[row["sequence"]]

    def size(name: str) -> float:
        return max(float(np.abs(np.log([*cells.values()])).mean()) for cells in ratios[name].values())

    return {name: ratios[name] for name in sorted(ratios, key=size, reverse=True)}


def choices_figure(ratios: Mapping[str, Mapping[str, Mapping[str, float]]], height: int = 380) -> Figure:
    """A line an alternative, a dot a sequence: left of 1 the other choice is better, right of it worse."""
    made, (axis,) = figure(height)
    box = axis.get_position()
    axis.set_position((0.22, box.y0, 0.6, box.height))  # room for names and for the legend
    lines = [(f"{name}: {words}", cells) for name, each in ratios.items() for words, cells in each.items()]
    sequences = list(dict.fromkeys(name for _, cells in lines for name in cells))
    for number, (sequence, marker) in enumerate(zip(sequences, "os^vDP*X", strict=False)):
        x = [cells[sequence] for _, cells in lines]
        colour = CYCLE[number % len(CYCLE)]
        axis.plot(x, np.arange(len(lines)), marker, label=sequence, color=colour, markersize=7, alpha=0.9)
    axis.axvline(1.0, color=DARK, linewidth=0.8)
    axis.hlines(range(len(lines)), 0.1, 10, color=PALE, linewidth=0.5, zorder=0)
    axis.set_yticks(range(len(lines)), [words for words, _ in lines])
    axis.set_ylim(len(lines) - 0.5, -0.5)
    values = [value for _, cells in lines for value in cells.values()]
    log_axis(axis.xaxis, 0.9 * min(values), 1.1 * max(values), (0.2, 0.3, 0.5, 0.7, 1.0))
    finish(axis, "what another choice does to the translation error", "TE with it / TE as published")
    axis.legend(loc="center left", bbox_to_anchor=(1.01, 0.5), fontsize=FONT_SIZE - 1, frameon=False)
    return made
