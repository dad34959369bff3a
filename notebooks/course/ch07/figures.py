"""Figures and tables of chapter 7: Figure 4 of the paper, errors with their spread, and verdicts."""

from __future__ import annotations

import collections
import csv
import html
import itertools
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from vo_lib.data.catalogue import KITTI
from vo_lib.data.poses import from_first
from vo_lib.evaluation.kitti_errors import trajectory_distances
from vo_lib.evaluation.statistics import prediction_half_width
from vo_lib.files import read_csv
from vo_lib.geometry.types import Array
from vo_lib.report import table1
from vo_lib.report.page import ReportTable, format_number, signed
from vo_lib.report.plots import draw_drift, draw_trajectories
from vo_lib.report.table1 import ERROR_KINDS, Entry, group_entries
from vo_lib.report.table1_page import layout_tables

from ..ch05.claim import CHOICES, THRESHOLD_AND_BOXES
from ..ch05.claim import results_table as results_table
from ..colours import CYCLE, DARK, PALE
from ..drawing import SMALL_SIZE, figure, finish, log_axis, write_instead

PATHS_HEIGHT = 340
FEWEST = 3  # seeds that a verdict needs
CELL = '<{0} style="padding:1px 10px;text-align:{1}">{2}</{0}>'


def paths_figure(title: str, truth: Array, runs: dict[str, Array], frame: int = 0, words: str = "") -> Figure:
    """Paths from above, as in the paper's Figure 4, and beside them the distances from the truth.

    truth : (N, 4, 4); runs : (N, 4, 4) by name; frame : marked frame; words : text if `runs` is empty.
    """
    made, (paths, drift) = figure(PATHS_HEIGHT, 2)
    draw_trajectories(paths, "", truth, runs)
    place = from_first(truth)[frame, [0, 2], 3]
    paths.plot(*place, "o", color=DARK, markersize=7, markerfacecolor="none")
    finish(paths, title, "x, right [m]", "z, forward [m]")
    if not runs:
        write_instead(drift, words)
        return made
    draw_drift(drift, truth, runs)
    drift.axvline(float(trajectory_distances(truth)[frame]), color=PALE, linewidth=1)
    # The colours are explained beside the paths.
    finish(drift, "distance from the truth", "along the path [m]", "distance [m]", "none")
    return made


def tables_of(entries: list[Entry]) -> list[ReportTable]:
    """TE and RE of methods, mean ± deviation over seeds; for whole sequences also the paper's numbers."""
    paper = table1.read_paper_table()
    return [table for group in group_entries(entries) for table in layout_tables(group, paper)]


def verdicts(folder: Path, paper: table1.PaperTable) -> list[ReportTable]:
    """A verdict on each printed TE and RE that has a result in a report of `vo reproduce` in `folder`.

    The paper's number counts as one more run. Let s be the standard deviation of our n seeds. The number is
    within the spread if it differs from the mean of the seeds by at most t s √(1 + 1/n), the prediction
    interval of one more run with Student's t for n - 1, plus half a unit of the last printed digit.
    """
    path = folder / "table1.csv"
    tables = []
    names, *lines = (cells for _, cells in read_csv(path)) if path.exists() else ([],)
    records = [dict(zip(names, cells, strict=True)) for cells in lines]
    published = {(r["sequence"], r["method"]): r for r in records if r["variant"] == "published"}
    for kind, (words, digits) in ERROR_KINDS.items() if published else ():
        rows = []
        counts = collections.Counter[str]()
        for row, method in itertools.product(table1.PAPER_ROWS, table1.PAPER_METHODS):
            ours = published.get((row if row == table1.AVERAGE else f"{KITTI}{row}", method), {})
            printed = paper.value(row, method)[kind == "re_deg_per_100m"]
            cells = [format_number(printed, digits), *"–––"]
            verdict = "no verdict: not run"
            if ours and not ours[f"paper_{kind}"]:
                verdict = "no verdict: part of the sequence"
            elif ours:
                n = int(ours["seeds"])
                deviation = float(ours[f"{kind}_std"] or "nan")
                less = float(ours[kind]) - float(printed or "nan")
                most = prediction_half_width(deviation, n) + 0.5 * 10**-digits
                cells[1:] = format_number(float(ours[kind])), signed(less, digits), format_number(most)
                verdict = "reproduced" if abs(less) <= most else "not reproduced"
                if n < FEWEST:
                    verdict = "no verdict: fewer than three seeds"
                elif method == table1.PROPOSAL and float(ours["removed_share"] or "nan") == 0.0:
                    verdict = "no verdict: no boxes"
            if ours:
                rows.append([f"{row} {table1.PRINTED_NAMES[method]}", *cells, verdict])
            counts[verdict] += printed is not None
        columns = ["sequence, system", "printed", "ours", "difference", "allowed", "verdict"]
        head = "; ".join(f"{verdict}: {count}" for verdict, count in counts.items() if count)
        tables.append(ReportTable(f"{words}: verdict on printed numbers", columns, rows, [], [f"{head}."]))
    return tables


def printed_gains(paper: table1.PaperTable, other: str) -> list[Array]:
    """Gains of Feature selection over another method, (TE, RE) in %, from printed numbers.

    Three gains: from the row Avg, from the plain mean of the ten rows, and from the benchmark's weighted
    mean.
    """
    numbers = np.array(
        [[paper.value(row, name) for row in table1.PAPER_ROWS] for name in (other, table1.PROPOSAL)], float
    )
    averages = numbers[:, 0]
    rows = numbers[:, 1:]
    weights = list(table1.SUB_SEQUENCES.values())
    return [table1.gain(*means) for means in (averages, rows.mean(axis=1), np.average(rows, 1, weights))]


def table_html(table: ReportTable) -> str:
    """A table with its notes, for a notebook."""

    def row(words: list[str], tag: str) -> str:
        cells = [CELL.format(tag, ("left", "right")[k > 0], html.escape(w)) for k, w in enumerate(words)]
        return f"<tr>{''.join(cells)}</tr>".replace("\n", "<br>")

    rows = row(table.columns, "th") + "".join(row(words, "td") for words in table.rows)
    head, notes = ("".join(f"<div>{html.escape(s)}</div>" for s in x) for x in (table.head, table.notes))
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
        if row["alternative"]:
            cells = ratios.setdefault(row["choice"], {}).setdefault(row["alternative"], {})
            cells[row["sequence"]] = 1 + float(row["te"]) / plain[row["sequence"]]

    def size(name: str) -> float:
        return max(float(np.abs(np.log([*cells.values()])).mean()) for cells in ratios[name].values())

    return {name: ratios[name] for name in sorted(ratios, key=size, reverse=True)}


def choices_figure(ratios: Mapping[str, Mapping[str, Mapping[str, float]]]) -> Figure:
    """A line per alternative, a dot per sequence: the alternative is better left of 1, worse right of 1."""
    made, (axis,) = figure(380)
    box = axis.get_position()
    axis.set_position((0.27, box.y0, 0.57, box.height))  # room for names and for the legend
    lines = [(f"{name}: {words}", cells) for name, each in ratios.items() for words, cells in each.items()]
    sequences = list(dict.fromkeys(name for _, cells in lines for name in cells))
    for place, (sequence, marker) in enumerate(zip(sequences, "os^vDP*Xh", strict=False)):
        x = [cells[sequence] for _, cells in lines]
        colour = CYCLE[place % len(CYCLE)]
        axis.plot(x, np.arange(len(lines)), marker, label=sequence, color=colour, markersize=7, alpha=0.9)
    axis.axvline(1.0, color=DARK, linewidth=0.8)
    axis.set_yticks(range(len(lines)), [words for words, _ in lines])
    axis.set_ylim(len(lines) - 0.5, -0.5)
    axis.grid(axis="y", color=PALE, linewidth=0.5)
    values = [value for _, cells in lines for value in cells.values()]
    log_axis(axis.xaxis, 0.9 * min(values), 1.1 * max(values), (1.0, 2.0, 3.0, 5.0, 7.0))
    finish(axis, "translation error with another choice", "TE with this choice / TE as published")
    axis.legend(loc="center left", bbox_to_anchor=(1.01, 0.5), fontsize=SMALL_SIZE, frameon=False)
    return made
