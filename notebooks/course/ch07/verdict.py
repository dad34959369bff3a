"""Verdicts of chapter 7: on each printed number of Table 1, and on the gain that the paper claims."""

from __future__ import annotations

import collections
import csv
import itertools
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from vo_lib.data.catalogue import KITTI
from vo_lib.errors import DataError
from vo_lib.evaluation.statistics import (
    CONFIDENCE,
    Interval,
    mean_and_deviation,
    means_without_each,
    paired_change,
    prediction_half_width,
    sign_flip_share,
)
from vo_lib.files import read_csv, read_mapping
from vo_lib.geometry.types import Array
from vo_lib.report import table1
from vo_lib.report.page import ReportTable, format_number, signed
from vo_lib.report.record import RECORD
from vo_lib.report.table1 import BENCHMARK_FRAMES, ERROR_KINDS

from ..ch05.claim import CHOICES, THRESHOLD_AND_BOXES
from ..ch06.figures import PAPERS_OWN

FEWEST = 3  # seeds that a verdict needs
# The paper's own RE were converted with 10⁶ / 180 in place of 100 · 180/π (chapter 6).
PAPERS_FACTOR = 1e6 / 180.0
RIGHT_FACTOR = 100.0 * 180.0 / math.pi
DEVKIT_STEP = 1e-6  # rad/m: the devkit writes six decimals

REPRODUCED = "reproduced"
BY_CHOICES = "within the open choices"
NOT_REPRODUCED = "not reproduced"
DIFFERENT = "different; choices not measured"
JUDGED = (REPRODUCED, BY_CHOICES, NOT_REPRODUCED, DIFFERENT)


@dataclass(frozen=True, eq=False)
class Ours:
    """Our errors of a method on a row of the table.

    values : (S,) errors of the seeds, or None if only the next two are known; mean and deviation over n - 1.
    """

    whole: bool
    boxes: bool
    seeds: int
    mean: float
    deviation: float
    values: Array | None = None


@dataclass(frozen=True)
class Judged:
    """A printed number beside ours, both in % or in deg/100 m, and the verdict.

    printed : as in the paper; converted : in the right unit; allowed : difference within the seeds;
    choices : lowest and highest error that other readings of the paper gave on the whole sequence, or None.
    """

    row: str
    method: str
    printed: float
    converted: float
    ours: float
    allowed: float
    choices: tuple[float, float] | None
    outcome: str


def converted(printed: float, method: str, kind: str) -> float:
    """A printed number in the right unit: RE of the paper's own columns is 3 % larger than it reads."""
    if kind == "re_deg_per_100m" and method in PAPERS_OWN:
        return printed * RIGHT_FACTOR / PAPERS_FACTOR
    return printed


def judge(
    printed: float, method: str, kind: str, row: str, ours: Ours, choices: tuple[float, float] | None = None
) -> Judged:
    """The verdict on a printed number.

    The paper's number counts as one more run of our method. It is reproduced if it differs from the mean of
    our n seeds by at most t s √(1 + 1/n), with Student's t for n - 1 and 95 %, plus half a unit of the last
    printed digit and, for RE in the paper's unit, half of the devkit's step of 10⁻⁶ rad/m. Beyond that, it may
    be within the range of the readings that the paper leaves open.
    """
    digits = ERROR_KINDS[kind][1]
    right = converted(printed, method, kind)
    rounded = 0.5 * 10.0**-digits
    if right != printed:
        rounded = rounded * RIGHT_FACTOR / PAPERS_FACTOR + 0.5 * DEVKIT_STEP * RIGHT_FACTOR
    allowed = prediction_half_width(ours.deviation, ours.seeds) + rounded
    if not ours.whole:
        outcome = "no verdict: part of the sequence"
    elif not np.isfinite(ours.mean):
        outcome = "no verdict: a seed without errors"
    elif (row, method) == (table1.AVERAGE, "viso2"):
        outcome = "no verdict: the printed average is not the mean of its rows"
    elif ours.seeds < FEWEST:
        outcome = f"no verdict: fewer than {FEWEST} seeds"
    elif method == table1.PROPOSAL and not ours.boxes:
        outcome = "no verdict: no boxes"
    elif abs(ours.mean - right) <= allowed:
        outcome = REPRODUCED
    elif choices is None:
        outcome = DIFFERENT
    elif choices[0] - allowed <= right <= choices[1] + allowed:
        outcome = BY_CHOICES
    else:
        outcome = NOT_REPRODUCED
    return Judged(row, method, printed, right, ours.mean, allowed, choices, outcome)


def read_report(folder: Path) -> dict[tuple[str, str, str], Ours]:
    """Our errors by (row, method, kind) of variant `published`, from a folder of `vo reproduce`; maybe none.

    `reproduction.json` has the numbers of each seed. An older folder has only `table1.csv`, with means and
    deviations. Raises `DataError` if the file is damaged.
    """
    if (folder / RECORD).is_file():
        return _from_record(folder / RECORD)
    if (folder / "table1.csv").is_file():
        return _from_table(folder / "table1.csv")
    return {}


def _from_record(path: Path) -> dict[tuple[str, str, str], Ours]:
    record = read_mapping(path, "a record of vo reproduce")
    found: dict[tuple[str, str, str], Ours] = {}
    try:
        rows = [row for row in record["rows"] if row["variant"] == "published" and not row["settings"]]
        for row, kind in itertools.product(rows, ERROR_KINDS):
            values = np.array([math.nan if value is None else value for value in row[kind]], float)
            name = str(row["sequence"]).removeprefix(KITTI)
            boxes = bool(row["removed_share"])
            ours = Ours(row["whole"], boxes, len(values), *mean_and_deviation(values), values)
            found[name, row["method"], kind] = ours
    except (KeyError, TypeError, ValueError) as error:
        raise DataError(f"is not a record of vo reproduce: {type(error).__name__} {error}", path) from None
    return found | _averages(found)


def _averages(found: Mapping[tuple[str, str, str], Ours]) -> dict[tuple[str, str, str], Ours]:
    """The row Avg, the plain mean of the ten whole sequences seed by seed, where all are there."""
    averages = {}
    for method, kind in itertools.product(table1.PAPER_METHODS, ERROR_KINDS):
        rows = [found.get((name, method, kind)) for name in table1.SUB_SEQUENCES]
        complete = [ours for ours in rows if ours is not None and ours.whole and ours.values is not None]
        seeds = min((ours.seeds for ours in complete), default=0)
        if len(complete) < len(rows) or seeds == 0:
            continue
        values = np.mean([ours.values[:seeds] for ours in complete if ours.values is not None], axis=0)
        boxes = all(ours.boxes for ours in complete)
        ours = Ours(True, boxes, seeds, *mean_and_deviation(values), values)
        averages[table1.AVERAGE, method, kind] = ours
    return averages


def _from_table(path: Path) -> dict[tuple[str, str, str], Ours]:
    found = {}
    try:
        (_, columns), *lines = read_csv(path)
        records = [dict(zip(columns, cells, strict=True)) for _, cells in lines]
        rows = [row for row in records if row["variant"] == "published" and not row.get("settings")]
        for row, kind in itertools.product(rows, ERROR_KINDS):
            if not row[kind]:
                continue
            name = row["sequence"].removeprefix(KITTI)
            whole = bool(row[f"paper_{kind}"])
            # The row of averages has no share of its own: its sequences were judged by theirs.
            boxes = row["removed_share"] == "" or float(row["removed_share"]) > 0
            deviation = float(row[f"{kind}_std"] or "nan")
            ours = Ours(whole, boxes, int(row["seeds"]), float(row[kind]), deviation)
            found[name, row["method"], kind] = ours
    except (KeyError, ValueError) as error:
        raise DataError(f"is not a table of vo reproduce: {type(error).__name__} {error}", path) from None
    return found


def choice_ranges(path: Path = CHOICES) -> dict[tuple[str, str], tuple[float, float]]:
    """Lowest and highest error by (row, kind) of Feature selection, over all readings of the paper.

    Only sequences on which the readings were measured over all frames: the range of a clip says nothing
    about the whole drive.
    """
    with path.open(encoding="utf-8", newline="") as lines:
        rows = [row for row in csv.DictReader(lines) if row["choice"] != THRESHOLD_AND_BOXES]
    columns = {"te_percent": "te", "re_deg_per_100m": "re"}
    ranges = {}
    for sequence, frames in BENCHMARK_FRAMES.items():
        whole = [row for row in rows if row["sequence"] == sequence and row.get("frames") == str(frames)]
        for kind, column in columns.items():
            plain = [float(row[column]) for row in whole if not row["alternative"] and row[column]]
            changes = [float(row[column]) for row in whole if row["alternative"] and row[column]]
            if plain:
                values = [plain[0] + change for change in (0.0, *changes)]
                ranges[sequence.removeprefix(KITTI), kind] = (min(values), max(values))
    return ranges


def judged_cells(
    folder: Path, paper: table1.PaperTable, ranges: Mapping[tuple[str, str], tuple[float, float]]
) -> dict[str, list[Judged]]:
    """The verdicts by kind of error on all printed numbers that have a result in the folder."""
    ours = read_report(folder)
    cells: dict[str, list[Judged]] = {kind: [] for kind in ERROR_KINDS}
    for place, kind in enumerate(ERROR_KINDS):
        for row, method in itertools.product(table1.PAPER_ROWS, table1.PAPER_METHODS):
            printed = paper.value(row, method)[place]
            found = ours.get((row, method, kind))
            if printed is None or found is None:
                continue
            # The readings were tried with Feature selection.
            choices = ranges.get((row, kind)) if method == table1.PROPOSAL else None
            cells[kind].append(judge(printed, method, kind, row, found, choices))
    return cells


def verdict_tables(cells: Mapping[str, Iterable[Judged]]) -> list[ReportTable]:
    """Tables of the verdicts, and above them what chance alone would do; none without a cell."""
    tables = []
    for kind, of_kind in cells.items():
        judged = [*of_kind]
        if not judged:
            continue
        words, digits = ERROR_KINDS[kind]
        rows = []
        for cell in judged:
            shown = "not measured"
            if cell.choices is not None:
                shown = " to ".join(format_number(value, digits) for value in cell.choices)
            less = format_number(cell.ours), signed(cell.ours - cell.converted, digits)
            name = f"{cell.row} {table1.PRINTED_NAMES[cell.method]}"
            right = format_number(cell.converted, digits)
            rows.append(
                [
                    name,
                    format_number(cell.printed, digits),
                    right,
                    *less,
                    format_number(cell.allowed),
                    shown,
                    cell.outcome,
                ]
            )
        columns = [
            "sequence, system",
            "printed",
            "in the right unit",
            "ours",
            "difference",
            "allowed",
            "open choices",
            "verdict",
        ]
        tables.append(
            ReportTable(f"{words}: verdict on printed numbers", columns, rows, [], [summary(judged)])
        )
    return tables


def summary(cells: Iterable[Judged]) -> str:
    """How many cells have each verdict, and how many of them chance alone would call different."""
    counts = collections.Counter(cell.outcome for cell in cells)
    words = "; ".join(f"{outcome}: {count}" for outcome, count in counts.items())
    number = sum(counts[outcome] for outcome in JUDGED)
    outside = number - counts[REPRODUCED]
    expected = round((1.0 - CONFIDENCE) * number, 3)
    return (
        f"{words}. Outside the seeds: {outside} of {number}; if every printed number were one more run of our "
        f"method, about {expected:.1f} would be."
    )


@dataclass(frozen=True, eq=False)
class Gain:
    """The change of an error from one method to another over sequences.

    names : the sequences; changes : (N,); interval : of the mean change over sequences; share : of the sign
    choices that give a mean at least as far from 0; without : (N,) means without each sequence.
    """

    names: tuple[str, ...]
    changes: Array
    interval: Interval
    share: float
    without: Array

    @property
    def half_width(self) -> float:
        """Half the width of the interval."""
        return self.interval.high - self.interval.mean

    @property
    def words(self) -> str:
        """The verdict on the question whether the change is general."""
        if self.interval.excludes(0.0):
            return "the mean change over sequences is hardly chance"
        return "another set of sequences could show no gain"


def gain_over_sequences(before: Mapping[str, float], after: Mapping[str, float]) -> Gain:
    """The gain paired over the sequences that both have, with interval, sign flips and leave-one-out.

    Raises `DataError` with fewer than two sequences.
    """
    names = tuple(name for name in before if name in after)
    if len(names) < 2:
        raise DataError(f"a gain over sequences needs two sequences or more, here {len(names)}")
    old = np.array([before[name] for name in names])
    new = np.array([after[name] for name in names])
    change = new - old
    return Gain(names, change, paired_change(old, new), sign_flip_share(change), means_without_each(change))


def printed_column(paper: table1.PaperTable, method: str, kind: str) -> dict[str, float]:
    """The printed numbers of a method on the ten sequences, in the right unit."""
    place = [*ERROR_KINDS].index(kind)
    column = {}
    for row in table1.SUB_SEQUENCES:
        printed = paper.value(row, method)[place]
        if printed is not None:
            column[row] = converted(printed, method, kind)
    return column


def our_column(found: Mapping[tuple[str, str, str], Ours], method: str, kind: str) -> dict[str, float]:
    """Our means of a method on the whole sequences of the table."""
    rows = {row: found.get((row, method, kind)) for row in table1.SUB_SEQUENCES}
    return {row: ours.mean for row, ours in rows.items() if ours is not None and ours.whole}
