"""Figures and tables of chapter 7: Figure 4 of the paper, errors with their spread, choices, gains."""

from __future__ import annotations

import csv
import html
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from vo_lib.data.catalogue import KITTI
from vo_lib.data.poses import from_first
from vo_lib.detection.models import list_detectors as list_detectors  # for the notebook
from vo_lib.evaluation.kitti_errors import trajectory_distances
from vo_lib.geometry.types import Array
from vo_lib.report import table1
from vo_lib.report.page import ReportTable
from vo_lib.report.plots import TRUTH, draw_drift, draw_trajectories
from vo_lib.report.table1 import Entry, group_entries
from vo_lib.report.table1_page import layout_tables

from ..ch06.figures import changes_chart
from ..colours import CYCLE, DARK, MANY, PALE
from ..drawing import SMALL_SIZE, figure, log_axis, write_instead
from ..drawing import finish as finish  # for the notebook, too
from ..measured_results import CHOICES, RESULTS, THRESHOLD_AND_BOXES, results_table
from .claimed_gain import Gain

PATHS_HEIGHT = 340
TITLES = {"te_percent": "TE, %", "re_deg_per_100m": "RE, deg/100 m"}  # of columns of `results.md`
SHAPES = "os^vDP*Xh"
NAME_HEIGHT = 20  # pixels of a line of a legend, with its margin
CELL = '<{0} style="padding:1px 10px;text-align:{1}">{2}</{0}>'


def paths_figure(
    title: str,
    truth: Array,
    runs: dict[str, Array],
    frame: int = 0,
    words: str = "",
    reference: str = TRUTH,
) -> Figure:
    """Paths from above, as in the paper's Figure 4, and beside them the distances from the truth.

    truth : (N, 4, 4); runs : (N, 4, 4) by name; frame : marked frame; words : text if `runs` is empty.
    reference : what `truth` is, if it is another path in place of a truth, such as "the kit's path".
    """
    made, (paths, drift) = figure(PATHS_HEIGHT, 2)
    draw_trajectories(paths, "", truth, runs)
    for line in paths.get_lines():
        if line.get_label() == TRUTH:
            line.set_label(reference)
    place = from_first(truth)[frame, [0, 2], 3]
    paths.plot(*place, "o", color=DARK, markersize=7, markerfacecolor="none")
    _leave_room_above(paths, 1 + len(runs))
    finish(paths, title, "x, right [m]", "z, forward [m]", "upper right")
    if not runs:
        write_instead(drift, words)
        return made
    draw_drift(drift, truth, runs)
    drift.axvline(float(trajectory_distances(truth)[frame]), color=PALE, linewidth=1)
    # The colours are explained beside the paths.
    whole = "the truth" if reference == TRUTH else reference
    finish(drift, f"distance from {whole}", "along the path [m]", "distance [m]", "none")
    return made


def _leave_room_above(axis: Axes, names: int) -> None:
    """Leave room for a legend of some names above the paths of an axis with equal scales."""
    box = axis.get_window_extent()
    needed = min(names * NAME_HEIGHT, 0.5 * box.height)
    left, right = axis.xaxis.get_data_interval()
    low, high = axis.yaxis.get_data_interval()
    per_pixel = max((right - left) / box.width, (high - low) / (box.height - needed))  # metres
    axis.update_datalim([(0.5 * (left + right), high + per_pixel * needed)])
    axis.autoscale_view()


def tables_of(entries: list[Entry]) -> list[ReportTable]:
    """TE and RE of methods, mean ± deviation over seeds; for whole sequences also the paper's numbers."""
    paper = table1.read_paper_table()
    tables = []
    for group in group_entries(entries):
        tables += layout_tables(group, paper)
    return tables


def printed_gains(paper: table1.PaperTable, other: str) -> list[Array]:
    """Gains of Feature selection over another method, (TE, RE) in %, from printed numbers.

    Three gains: from the row Avg, from the plain mean of the ten rows, and from the benchmark's weighted
    mean.
    """
    weights = list(table1.SUB_SEQUENCES.values())
    means = []  # three for each method
    for method in (other, table1.PROPOSAL):
        numbers = np.array([paper.value(row, method) for row in table1.PAPER_ROWS], float)
        average = numbers[0]
        rows = numbers[1:]
        means.append((average, rows.mean(axis=0), np.average(rows, 0, weights)))
    before, after = means
    return [table1.gain(old, new) for old, new in zip(before, after, strict=True)]


def table_html(table: ReportTable) -> str:
    """A table with its notes, for a notebook."""

    def row(words: list[str], tag: str) -> str:
        cells = []
        for place, text in enumerate(words):
            side = "left" if place == 0 else "right"
            cells.append(CELL.format(tag, side, html.escape(text)))
        return f"<tr>{''.join(cells)}</tr>".replace("\n", "<br>")

    rows = row(table.columns, "th") + "".join(row(words, "td") for words in table.rows)
    head = "".join(f"<div>{html.escape(sentence)}</div>" for sentence in table.head)
    notes = "".join(f"<div>{html.escape(sentence)}</div>" for sentence in table.notes)
    return (
        f'<div style="margin:8px 0;overflow-x:auto"><b>{html.escape(table.title)}</b>{head}'
        f'<table style="border-collapse:collapse;font-size:12px;margin:4px 0">{rows}</table>{notes}</div>'
    )


def choice_ratios(path: Path = CHOICES) -> dict[str, dict[str, dict[str, float]]]:
    """Ratio of TE with another choice to TE of variant `published`: by choice, alternative and sequence.

    The choices are sorted by their largest mean |log ratio| over the sequences.
    """
    with path.open(encoding="utf-8", newline="") as lines:
        rows = [row for row in csv.DictReader(lines) if row["te"] and row["choice"] != THRESHOLD_AND_BOXES]
    plain = {row["sequence"]: float(row["te"]) for row in rows if not row["alternative"]}
    ratios: dict[str, dict[str, dict[str, float]]] = {}
    for row in rows:
        if row["alternative"]:  # the row has the change of the error
            cells = ratios.setdefault(row["choice"], {}).setdefault(row["alternative"], {})
            cells[row["sequence"]] = 1 + float(row["te"]) / plain[row["sequence"]]

    def size(name: str) -> float:
        means = []
        for of_sequences in ratios[name].values():
            logarithms = np.log(list(of_sequences.values()))
            means.append(float(np.abs(logarithms).mean()))
        return max(means)

    return {name: ratios[name] for name in sorted(ratios, key=size, reverse=True)}


def choices_figure(ratios: Mapping[str, Mapping[str, Mapping[str, float]]]) -> Figure:
    """A line per alternative, a dot per sequence: the alternative is better left of 1, worse right of 1."""
    made, (axis,) = figure(380)
    box = axis.get_position()
    axis.set_position((0.28, box.y0, 0.53, box.height))  # room for names and for the legend
    lines = []
    for choice, alternatives in ratios.items():
        for alternative, cells in alternatives.items():
            lines.append((f"{choice}: {alternative}", cells))
    values: list[float] = []
    sequences: list[str] = []
    for _, cells in lines:
        values += cells.values()
        sequences += [name for name in cells if name not in sequences]
    for place, sequence in enumerate(sequences):
        x = [cells.get(sequence, np.nan) for _, cells in lines]
        axis.plot(
            x,
            np.arange(len(lines)),
            SHAPES[place % len(SHAPES)],
            label=sequence.removeprefix("synthetic/"),
            color=MANY[place % len(MANY)],
            markersize=7,
            alpha=0.9,
        )
    axis.axvline(1.0, color=DARK, linewidth=0.8)
    axis.set_yticks(range(len(lines)), [name for name, _ in lines])
    axis.set_ylim(len(lines) - 0.5, -0.5)
    axis.grid(axis="y", color=PALE, linewidth=0.5)
    log_axis(axis.xaxis, 0.9 * min(values), 1.1 * max(values), (1.0, 2.0, 3.0, 5.0, 7.0))
    finish(axis, "translation error with another choice", "TE with this choice / TE as published")
    axis.legend(loc="center left", bbox_to_anchor=(1.01, 0.5), fontsize=SMALL_SIZE, frameon=False)
    return made


def coverage_figure(shares: Mapping[str, Mapping[int, float]]) -> Figure:
    """Share of further runs inside the interval, by number of seeds, for each rule; the line is 95 %."""
    made, (axis,) = figure(220)
    for (name, by_seeds), colour in zip(shares.items(), (CYCLE[0], PALE), strict=False):
        axis.plot([*by_seeds], [100 * share for share in by_seeds.values()], "-o", color=colour, label=name)
    axis.axhline(95.0, color=DARK, linewidth=1, linestyle=":", label="the level that is claimed")
    axis.set_xticks([*next(iter(shares.values()))])
    finish(axis, "further runs inside the interval [%]", "number of seeds")
    return made


def short_sequence_name(sequence: str) -> str:
    """The name of a sequence without its folder, for an axis."""
    return sequence.split("/")[-1].removeprefix("drive_")


def gains_figure(gains: Mapping[str, Gain]) -> Figure:
    """The change of an error on each sequence, with the mean change and its interval, a chart for each gain."""
    made, axes = figure(240, len(gains))
    for axis, (title, gain) in zip(axes, gains.items(), strict=True):
        names = [short_sequence_name(name) for name in gain.names]
        changes_chart(axis, gain.changes, names, gain.interval.mean, gain.half_width)
        axis.set_xlim(-0.6, len(names) - 0.4)
        finish(axis, title, "sequence")
    return made


def measured_columns(methods: Sequence[str], kind: str) -> tuple[str, list[dict[str, float]]]:
    """TE or RE of the clips of KITTI, variant `published`, from `results.md`: a column for each method.

    kind : a key of `table1.ERROR_KINDS`.

    A clip has a row for each length of sub-sequences, and errors over different lengths cannot be averaged:
    the columns have the largest length that every clip has. The words before them name it, and the clips
    whose axes are removed: the axes of the truth of a raw drive are turned against the camera's, so its TE is
    computed after the constant turn that makes it least.
    """
    title = TITLES[kind]
    table = results_table(f"Variant published: {title}", KITTI)
    rows: dict[str, dict[str, list[str]]] = {}  # by length and clip
    for row in table.rows:
        parts = [part.strip() for part in row[0].split(",")]  # as of "kitti/00, 50 m, axes removed"
        name = parts[0]
        length = parts[1] if len(parts) > 1 else ""
        rows.setdefault(length, {})[name] = row
    clips = set[str]().union(*rows.values())
    common = [length for length, of_length in rows.items() if length and set(of_length) == clips]
    if not common:
        return "over no length that all of them have", [{} for _ in methods]
    longest = max(common, key=lambda length: float(length.split()[0]))
    removed = [short_sequence_name(name) for name, row in rows[longest].items() if "axes removed" in row[0]]
    words = f"over {longest}"
    if removed:
        words += f", axes removed on {', '.join(removed)}"
    columns = []
    same = table.columns.index("solution_selection")  # what "=" stands for
    for method in methods:
        place = table.columns.index(method)
        numbers = {}
        for name, row in rows[longest].items():
            cell = row[same] if row[place] == "=" else row[place]
            numbers[name] = float(cell)
        columns.append(numbers)
    return words, columns


def removal_sentences(path: Path = RESULTS) -> list[str]:
    """The sentences of `results.md` on what the removal changes, for each variant, TE first."""
    text = path.read_text(encoding="utf-8")
    sentences = []
    for part in text.split("\n## ")[1:]:
        title, *lines = part.splitlines()
        found = [line for line in lines if "Removal of the features" in line]
        sentences += [f"{title.partition(':')[0]}. {line}" for line in found if title.startswith("Variant")]
    # The sentences of a variant stand above the table of TE.
    return list(dict.fromkeys(sentences))
