"""Chapter 7, drawn: Figure 4 and what it hides, Table 1 as dots with their spread, and steps."""

from __future__ import annotations

import csv
import html
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from vo_lib.core.poses import from_first
from vo_lib.core.types import Array
from vo_lib.data.sequence import KITTI
from vo_lib.evaluation.ate_rpe import RelativeError
from vo_lib.evaluation.kitti import trajectory_distances
from vo_lib.tables.entries import Entry, group_entries
from vo_lib.tables.paper import PRINTED_NAMES, PROPOSAL, PaperTable, read_paper_table
from vo_lib.tables.plots import METHOD_MARKERS, TRUTH_COLOUR, draw_drift, draw_trajectories, method_colour
from vo_lib.tables.report import ReportTable, number
from vo_lib.tables.table1 import DIGITS, layout_tables, method_table

from ..drawing import CYCLE, DARK, FONT_SIZE, PALE, figure, finish, log_axis, room, say

CHOICES = Path(__file__).parents[2] / "choices.csv"  # written by `vo data measure_choices`
UNITS = "TE [%]", "RE [deg/100 m]"
CELL = '<{0} style="padding:1px 10px;text-align:{1}">{2}</{0}>'
HALF = 0.36  # of the distance between two sequences: the methods stand side by side within it


def draw_dot(axis: Axes, x: float, values: Array, name: str, number: int) -> None:
    """Mean over seeds as the method's marker, a bar from a standard deviation below to one above."""
    if len(values) == 0 or not np.isfinite(values).all():
        return
    colour = method_colour(name, number)
    mean, spread = float(values.mean()), float(values.std())
    axis.plot([x, x], [mean - spread, mean + spread], color=colour, linewidth=2)
    axis.plot(x, mean, METHOD_MARKERS.get(name, "o"), color=colour, markersize=7)


def errors_figure(entries: list[Entry], height: int, paper: PaperTable | None = None) -> Figure:
    """TE and RE of each sequence: a dot a method, a bar for one standard deviation, the paper's as a dash."""
    made, axes = figure(height, 2)
    sequences = list(dict.fromkeys(entry.sequence for entry in entries))
    methods = list(dict.fromkeys(entry.method for entry in entries))
    places = np.linspace(-HALF, HALF, len(methods)) if len(methods) > 1 else np.zeros(1)
    for axis, rotation in zip(axes, (False, True), strict=True):
        for entry in entries:
            k = methods.index(entry.method)
            x = sequences.index(entry.sequence) + places[k]
            draw_dot(axis, x, entry.re if rotation else entry.te, entry.method, k)
            row = entry.sequence.removeprefix(KITTI)
            printed = None if paper is None else paper.value(row, entry.method)[rotation]
            if printed is not None:
                axis.plot(x, printed, "_", color=DARK, markersize=14)
        axis.set_xticks(range(len(sequences)), [name.removeprefix(KITTI) for name in sequences])
        axis.set_xlim(-0.6, len(sequences) - 0.4)
        axis.set_ylim(0, 1.08 * axis.get_ylim()[1])
        finish(axis, "rotation error" if rotation else "translation error", "", UNITS[rotation])
    return made


def paths_figure(
    title: str,
    truth: Array | None,
    estimates: dict[str, Array],
    height: int = 340,
    frame: int | None = None,
    words: str = "",
) -> Figure:
    """Paths from above, as the paper's Figure 4, and beside them how far they are from the truth.

    truth : (N, 4, 4); estimates : (N, 4, 4) by name; frame : marked on both; words : in place of the distances.
    """
    made, (paths, drift) = figure(height, 2)
    draw_trajectories(paths, "", truth, estimates)
    if frame is not None and truth is not None:
        paths.plot(
            *from_first(truth)[frame, [0, 2], 3], "o", color=DARK, markersize=7, markerfacecolor="none"
        )
        drift.axvline(float(trajectory_distances(truth)[frame]), color=PALE, linewidth=1)
    finish(paths, title, "x, right [m]", "z, forward [m]")
    if truth is None or words:
        say(drift, words or "without truth nobody knows how far they stray")
        return made
    draw_drift(drift, truth, estimates)
    finish(drift, "distance from the truth", "along the path [m]", "distance [m]")
    return made


def steps_figure(errors: Mapping[str, RelativeError], frame: int, method: str, height: int = 240) -> Figure:
    """Rotation and translation error of each step of several runs, by name; "preset" in grey, below the others."""
    made, axes = figure(height, 2)
    kinds = {
        "rotation": ("0.001 deg", {name: 1e3 * np.degrees(each.rotation) for name, each in errors.items()}),
        "translation": ("mm", {name: 1e3 * each.translation for name, each in errors.items()}),
    }
    for axis, (kind, (unit, lines)) in zip(axes, kinds.items(), strict=True):
        for name, values in lines.items():
            colour, width = (PALE, 3.0) if name == "preset" else (TRUTH_COLOUR, 1.2)
            axis.plot(np.arange(1, len(values) + 1), values, color=colour, linewidth=width, label=name)
        axis.axvline(frame, ymax=0.8, color=DARK, linewidth=0.8)  # below the legend
        axis.set_xlim(0, max(map(len, lines.values())) + 1)
        # The legend stands above the highest value.
        axis.set_ylim(0, room(1.25 * max(float(values.max()) for values in lines.values()), least=1e-3))
        finish(axis, f"{kind} error of each step, {method}", "frame", unit, "upper left")
    return made


def table_tables(entries: list[Entry], paper: PaperTable | None = None) -> list[ReportTable]:
    """One sequence's methods, a row each; several in the paper's layout, KITTI's with its numbers."""
    paper = read_paper_table() if paper is None else paper
    tables = []
    for group in group_entries(entries):
        if len(group.sequences) == 1:
            table = method_table([*group.entries.values()])
            tables.append(replace(table, notes=[*without_boxes(entries), *table.notes]))
        if len(group.sequences) > 1 or group.kitti:
            tables += layout_tables(group, paper)
    return tables


def without_boxes(entries: list[Entry]) -> list[str]:
    """What has to be said below errors of sequences that had no boxes."""
    bare = all(not entry.labels and entry.removed_share == 0 for entry in entries)
    return ["No boxes: nothing was removed, so Feature selection is Solution selection here."] if bare else []


def row_table(sequence: str, errors: Mapping[str, Sequence[float]], notes: list[str]) -> ReportTable:
    """(TE, RE) of systems on a sequence beside the paper's row: 00 for a sequence that has none.

    Systems that are not the paper's stand beside its proposal.
    """
    paper = read_paper_table()
    row = sequence.removeprefix(KITTI) if (sequence.removeprefix(KITTI), PROPOSAL) in paper.te else "00"
    rows = []
    for name, ours in errors.items():
        theirs = paper.value(row, name if name in PRINTED_NAMES else PROPOSAL)
        less = [None if t is None else o - t for o, t in zip(ours, theirs, strict=True)]
        cells = [number(x, digits) for pair in (ours, theirs, less) for x, digits in zip(pair, DIGITS)]
        rows.append([PRINTED_NAMES.get(name, name), *cells])
    kinds = "here", "printed", "difference"
    columns = ["system", *(f"{unit}\n{kind}" for kind in kinds for unit in ("TE", "RE"))]
    return ReportTable(f"A row of Table 1: {sequence} here, {row} printed", columns, rows, notes)


def table_html(table: ReportTable) -> str:
    """A table with its notes, for a notebook."""

    def row(words: list[str], tag: str) -> str:
        cells = [CELL.format(tag, ("left", "right")[k > 0], html.escape(w)) for k, w in enumerate(words)]
        return f"<tr>{''.join(cells)}</tr>".replace("\n", "<br>")

    rows = row(table.columns, "th") + "".join(row(words, "td") for words in table.rows)
    head = "".join(f"<div>{html.escape(line)}</div>" for line in table.head)
    notes = "".join(
        f'<div style="font-size:11px;opacity:.75">{html.escape(note)}</div>' for note in table.notes
    )
    return (
        f'<div style="margin:8px 0;overflow-x:auto"><b>{html.escape(table.title)}</b>{head}'
        f'<table style="border-collapse:collapse;font-size:12px;margin:4px 0">{rows}</table>{notes}</div>'
    )


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
    for place, (sequence, marker) in enumerate(zip(sequences, "os^vDP*X", strict=False)):
        x = [cells[sequence] for _, cells in lines]
        colour = CYCLE[place % len(CYCLE)]
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
