"""Chapter 7, drawn: Figure 4 and what it hides, Table 1 as dots with their spread, and steps."""

from __future__ import annotations

import csv
import html
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from vo_lib.data.catalogue import KITTI
from vo_lib.data.poses import from_first
from vo_lib.evaluation.kitti import KITTI_MEASURE, trajectory_distances
from vo_lib.geometry.types import Array
from vo_lib.report.entries import Entry
from vo_lib.report.page import ReportTable, number, seeds_words
from vo_lib.report.plots import METHOD_MARKERS, draw_drift, draw_trajectories, method_colour
from vo_lib.report.printed import PRINTED_NAMES, PROPOSAL, read_paper_table
from vo_lib.report.table1 import VARIANT_WORDS

from ..ch05.claim import CHOICES, THRESHOLD_AND_BOXES
from ..colours import CYCLE, DARK, PALE
from ..drawing import FONT_SIZE, figure, finish, log_axis, say

UNITS = "TE [%]", "RE [deg/100 m]"
PRINTED_DIGITS = 2, 3  # of the TE and RE that the paper prints
CELL = '<{0} style="padding:1px 10px;text-align:{1}">{2}</{0}>'


def errors_figure(entries: list[Entry], height: int) -> Figure:
    """TE and RE of methods: a dot a method, a bar for one standard deviation, the paper's as a dash."""
    made, axes = figure(height, 2)
    paper, beside = read_paper_table(), comparable(entries)
    for axis, rotation in zip(axes, (False, True), strict=True):
        for x, entry in enumerate(entries):
            values, colour = entry.re if rotation else entry.te, method_colour(entry.method, x)
            mean, spread = float(values.mean()), float(values.std())
            axis.plot([x, x], [mean - spread, mean + spread], color=colour, linewidth=2)
            axis.plot(x, mean, METHOD_MARKERS.get(entry.method, "o"), color=colour, markersize=7)
            printed = paper.value(entry.sequence.removeprefix(KITTI), entry.method)[rotation]
            if printed is not None and beside:
                axis.plot(x, printed, "_", color=DARK, markersize=14)
        names = [entry.method.replace("_selection", "\nselection") for entry in entries]
        axis.set_xticks(range(len(names)), names)
        axis.set_xlim(-0.6, len(names) - 0.4)
        axis.set_ylim(0, 1.08 * axis.get_ylim()[1])
        kind = "rotation" if rotation else "translation"
        finish(axis, f"{kind} error{', dashes: as printed' if beside else ''}", "", UNITS[rotation])
    return made


def paths_figure(
    title: str, truth: Array, estimates: dict[str, Array], height: int = 340, frame: int = 0, words: str = ""
) -> Figure:
    """Paths from above, as the paper's Figure 4, and beside them how far they are from the truth.

    truth : (N, 4, 4); estimates : (N, 4, 4) by name; frame : marked on both; words : in place of the distances.
    """
    made, (paths, drift) = figure(height, 2)
    draw_trajectories(paths, "", truth, estimates)
    place = from_first(truth)[frame, [0, 2], 3]
    paths.plot(*place, "o", color=DARK, markersize=7, markerfacecolor="none")
    finish(paths, title, "x, right [m]", "z, forward [m]")
    if words:
        say(drift, words)
        return made
    draw_drift(drift, truth, estimates)
    drift.axvline(float(trajectory_distances(truth)[frame]), color=PALE, linewidth=1)
    finish(drift, "distance from the truth", "along the path [m]", "distance [m]")
    return made


def table_tables(entries: list[Entry]) -> list[ReportTable]:
    """The methods on one sequence, a row each; and beside the paper's row where the sub-sequences are KITTI's."""
    first, columns = entries[0], ["method", "TE %", "RE deg/100 m", "removed", "back end ms"]
    rows = [
        [e.method, spread(e.te), spread(e.re), f"{100 * e.removed_share:.1f} %", f"{e.back_end_ms:.1f}"]
        for e in entries
    ]
    over = f"TE and RE over sub-sequences of {first.measure.words}, as far as the path goes"
    notes = [*without_boxes(entries), f"{over}; {seeds_words(len(first.seeds))}."]
    tables = [ReportTable(f"{first.sequence}, {VARIANT_WORDS[first.variant]}", columns, rows, notes)]
    if comparable(entries):
        errors = {entry.method: (float(entry.te.mean()), float(entry.re.mean())) for entry in entries}
        tables.append(row_table(entries[0].sequence, errors, [f"{len(entries[0].truth)} frames."]))
    return tables


def spread(values: Array) -> str:
    """Mean ± standard deviation over seeds (S,); the number alone of one seed."""
    mean = number(float(values.mean()))
    return mean if len(values) == 1 else f"{mean} ± {number(float(values.std()))}"


def comparable(entries: list[Entry]) -> bool:
    """Whether errors of a sequence may stand beside the paper's: KITTI's, over its sub-sequences."""
    return entries[0].sequence.startswith(KITTI) and entries[0].measure == KITTI_MEASURE


def without_boxes(entries: list[Entry]) -> list[str]:
    """What has to be said below errors of sequences that had no boxes."""
    bare = all(not entry.labels and entry.removed_share == 0 for entry in entries)
    return ["No boxes: nothing was removed, so feature_selection is solution_selection here."] if bare else []


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
        cells = [
            number(x, digits) for pair in (ours, theirs, less) for x, digits in zip(pair, PRINTED_DIGITS)
        ]
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
        rows = [row for row in csv.DictReader(lines) if row["te"] and row["choice"] != THRESHOLD_AND_BOXES]
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
