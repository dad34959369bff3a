"""Verdicts of chapter 7: on each printed number of Table 1, and on the gain that the paper claims."""

from __future__ import annotations

import collections
import csv
import itertools
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from vo_lib.data.catalogue import KITTI
from vo_lib.errors import DataError
from vo_lib.evaluation.statistics import (
    CONFIDENCE,
    Interval,
    changes_needed,
    mean_and_deviation,
    means_without_each,
    paired_change,
    prediction_half_width,
    sign_flip_share,
    standard_deviation,
)
from vo_lib.files import read_csv
from vo_lib.geometry.types import Array
from vo_lib.report import table1
from vo_lib.report.page import ReportTable, format_number, signed
from vo_lib.report.paper_unit import DEVKIT_STEP, PAPERS_FACTOR, RIGHT_FACTOR, converted, in_paper_unit
from vo_lib.report.record import RECORD, RecordRow, read_record
from vo_lib.report.table1 import BENCHMARK_FRAMES, ERROR_KINDS
from vo_lib.report.table1_page import TABLE

from ..measured_results import CHOICES, THRESHOLD_AND_BOXES

FEWEST = 3  # seeds that a verdict needs

# A number counts as reproduced only if all that is allowed round ours is within this share of the printed
# number. It is about the size of the gains that the paper reports (6 to 15 %): a verdict that cannot tell 10 %
# apart could not see them.
MARGIN = 0.10

REPRODUCED = "reproduced"
SCATTERED = "too scattered to tell"
CLOSE = f"different, but within {100 * MARGIN:.0f} %"
BY_CHOICES = "within the open choices"
NOT_REPRODUCED = "not reproduced"
DIFFERENT = "different; choices not measured"
INSIDE = (REPRODUCED, SCATTERED)
OUTSIDE = (CLOSE, BY_CHOICES, NOT_REPRODUCED, DIFFERENT)

SIMULATIONS = 4000  # of a record whose printed numbers are further runs of our method
SURPRISING = 0.05  # probability below which a number of cells outside would be surprising

VERDICT_COLUMNS = [
    "sequence, system",
    "printed",
    "in the right unit",
    "ours",
    "difference",
    "difference / printed",
    "allowed ±",
    "allowed / printed",
    "open choices",
    "verdict",
]

MAKE_ONE = "run the command above, or name its folder in the first line"


@dataclass(frozen=True, eq=False)
class Ours:
    """Our errors of a method on a row of the table.

    whole : whether the sequence was run as a whole; boxes : whether the run had vehicle boxes; seeds : their
    count; values : (S,) errors of the seeds, or None if only mean and deviation (over n - 1) are known;
    seed_numbers : the seeds of the values.
    """

    whole: bool
    boxes: bool
    seeds: int
    mean: float
    deviation: float
    values: Array | None = None
    seed_numbers: tuple[int, ...] = ()


OursByCell = dict[tuple[str, str, str], Ours]  # by the row of the table, the method and the kind of error


@dataclass(frozen=True)
class Judged:
    """A printed number beside ours, both in % or in deg/100 m, and the verdict.

    printed : as in the paper; converted : in the right unit; allowed : difference within the seeds;
    choices : lowest and highest error that other readings of the paper gave on the whole sequence, or None;
    kind : of `ERROR_KINDS`; deviation, seeds : of ours.
    """

    row: str
    method: str
    printed: float
    converted: float
    ours: float
    allowed: float
    choices: tuple[float, float] | None
    outcome: str
    kind: str
    deviation: float
    seeds: int

    @property
    def allowed_share(self) -> float:
        """The allowed difference as a share of the printed number in the right unit."""
        return self.allowed / self.converted

    @property
    def difference_share(self) -> float:
        """Ours minus the printed number, as a share of the printed number in the right unit."""
        return (self.ours - self.converted) / self.converted


def judge(
    printed: float, method: str, kind: str, row: str, ours: Ours, choices: tuple[float, float] | None = None
) -> Judged:
    """The verdict on a printed number.

    The paper's number counts as one more run of our method. It is different if it is farther from the mean of
    our n seeds than t s √(1 + 1/n), with Student's t for n - 1 and 95 %, plus half a unit of the last printed
    digit and, for RE in the paper's unit, half of the devkit's step of 10⁻⁶ rad/m.

    That no difference was found does not show that there is none, and a difference that was found may be
    small. So both are asked for their size: is the whole allowed interval within `MARGIN` of the printed
    number? A number inside is then reproduced, else our runs are too scattered to tell. A number outside is
    then different, but within `MARGIN`; else it may be within the range of the readings that the paper leaves
    open.

    A method that is off by `MARGIN` has one of the two verdicts "within `MARGIN`" in at most 2.5 % of the
    cases under two assumptions: the printed number is one run, or a mean of runs, of the paper's method, not
    the best of several; and the paper's runs scatter at most about as much as ours. If they scatter three
    times as much (3 % beside 1 %), it is nearly one case in five.
    """
    right = converted(printed, method, kind)
    allowed = prediction_half_width(ours.deviation, ours.seeds) + rounding(method, kind)
    margin = MARGIN * right
    difference = abs(ours.mean - right)
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
    elif difference <= allowed:
        outcome = REPRODUCED if difference + allowed <= margin else SCATTERED
    elif difference + allowed <= margin:
        outcome = CLOSE
    else:
        # Runs that scatter widely must not make the range of the readings wide.
        outcome = _outside(right, choices, min(allowed, margin))
    return Judged(
        row=row,
        method=method,
        printed=printed,
        converted=right,
        ours=ours.mean,
        allowed=allowed,
        choices=choices,
        outcome=outcome,
        kind=kind,
        deviation=ours.deviation,
        seeds=ours.seeds,
    )


def _outside(right: float, choices: tuple[float, float] | None, allowed: float) -> str:
    """The outcome of a number outside the seeds, from the range of the other readings."""
    if choices is None:
        return DIFFERENT
    if choices[0] - allowed <= right <= choices[1] + allowed:
        return BY_CHOICES
    return NOT_REPRODUCED


def rounding(method: str, kind: str) -> float:
    """How far a printed number in the right unit may be from the number before it was rounded."""
    _, digits = ERROR_KINDS[kind]
    half_digit = converted(0.5 * 10.0**-digits, method, kind)
    if not in_paper_unit(method, kind):
        return half_digit
    return half_digit + 0.5 * DEVKIT_STEP * RIGHT_FACTOR


def printed_and_back(errors: Array, method: str, kind: str) -> Array:
    """Errors as the paper would print them, in the right unit again."""
    _, digits = ERROR_KINDS[kind]
    if not in_paper_unit(method, kind):
        return np.round(errors, digits)
    by_devkit = DEVKIT_STEP * np.round(errors / RIGHT_FACTOR / DEVKIT_STEP)
    return np.round(by_devkit * PAPERS_FACTOR, digits) * RIGHT_FACTOR / PAPERS_FACTOR


def read_report(folder: Path) -> OursByCell:
    """Our errors by (row, method, kind) of variant `published`, from a folder of `vo reproduce`; maybe none.

    `reproduction.json` has the numbers of each seed. An older folder has only `table1.csv`, with means and
    deviations. Raises `DataError` if the file is damaged.
    """
    if (folder / RECORD).is_file():
        _, record_rows = read_record(folder / RECORD)
        return _from_record(record_rows)
    if (folder / TABLE).is_file():
        return _from_table(folder / TABLE)
    return {}


def open_report(folder: Path) -> tuple[OursByCell, list[str]]:
    """The errors of `read_report`, and sentences on the report; without errors, they say why."""
    record_path = folder / RECORD
    record: dict[str, Any] = {}
    try:
        if record_path.is_file():
            record, record_rows = read_record(record_path)
            found = _from_record(record_rows)
        else:
            found = read_report(folder)
    except DataError as error:
        return {}, [f"The report cannot be used: {error}."]
    if record:
        sentence = _about(record, folder) if found else _why_empty(record_rows, record_path)
    elif not (folder / TABLE).is_file():
        sentence = f"There is no report in {folder}: {MAKE_ONE}."
    elif found:
        sentence = f"{folder} has a table without a record: no number of a single seed."
    else:
        sentence = f"{folder / TABLE} has no row of variant published with its presets and with errors."
    sentences = [sentence]
    if found and not set(table1.PAPER_ROWS) & {row for row, _, _ in found}:
        sentences.append(f"{folder} has no row of the printed table: it was made from other sequences.")
    return found, sentences


def _about(record: Mapping[str, Any], folder: Path) -> str:
    """Where a record comes from, and the detector, which is another one than the paper's."""
    facts = [str(record[name]) for name in ("date", "commit", "processor") if record.get(name)]
    origin = f"The report in {folder}"
    if facts:
        origin += f" ({', '.join(facts)})"
    detector = record.get("detector")
    boxes = "labels of the sequences, if any"
    if isinstance(detector, dict) and detector.get("file"):
        boxes = str(detector["file"])
    return f"{origin}. Boxes: {boxes}; the paper trained a YOLOv8 of its own, a known deviation."


def _why_empty(record_rows: list[RecordRow], path: Path) -> str:
    """Why no row of a record can be compared with the paper."""
    if not record_rows:
        return f"{path} has no row: no run has errors."
    published = [record_row for record_row in record_rows if record_row.variant == "published"]
    if not published:
        return (
            f"{path} has only rows of variant kit; the paper's numbers are compared with variant published: "
            "repeat the command without --variant kit."
        )
    settings = ", ".join(dict.fromkeys(record_row.settings for record_row in published))
    return (
        f"{path} has variant published only with changed settings ({settings}): repeat the command without "
        "--set and --config."
    )


def _from_record(record_rows: list[RecordRow]) -> OursByCell:
    """Our errors from the rows of a record, which have those of each seed, and their averages."""
    found: OursByCell = {}
    for record_row in record_rows:
        if record_row.variant != "published" or record_row.settings:
            continue
        row = record_row.sequence.removeprefix(KITTI)
        boxes = record_row.removed_share > 0
        for kind in ERROR_KINDS:
            values = record_row.errors[kind]
            found[row, record_row.method, kind] = _of_seeds(record_row.whole, boxes, values, record_row.seeds)
    return found | _averages(found)


def _of_seeds(whole: bool, boxes: bool, values: Array, seed_numbers: tuple[int, ...]) -> Ours:
    """Our errors (S,) of the seeds with these numbers."""
    mean, deviation = mean_and_deviation(values)
    return Ours(whole, boxes, len(values), mean, deviation, values, seed_numbers)


def _averages(found: OursByCell) -> OursByCell:
    """The row Avg, the plain mean of the ten whole sequences, for each seed that all of them have."""
    averages = {}
    for method, kind in itertools.product(table1.PAPER_METHODS, ERROR_KINDS):
        complete = []
        errors_of_seeds = []  # the errors of each complete sequence by the number of the seed
        for row in table1.SUB_SEQUENCES:
            ours = found.get((row, method, kind))
            if ours is not None and ours.whole and ours.values is not None:
                complete.append(ours)
                errors_of_seeds.append(dict(zip(ours.seed_numbers, ours.values, strict=True)))
        if len(complete) < len(table1.SUB_SEQUENCES):
            continue
        common = sorted(set.intersection(*map(set, errors_of_seeds)))
        if not common:
            continue
        by_sequence = [[errors[seed] for seed in common] for errors in errors_of_seeds]
        means = np.mean(by_sequence, axis=0)
        boxes = all(ours.boxes for ours in complete)
        averages[table1.AVERAGE, method, kind] = _of_seeds(True, boxes, means, tuple(common))
    return averages


def _from_table(path: Path) -> OursByCell:
    """Our errors from a table without the errors of each seed."""
    found: OursByCell = {}
    place = None
    try:
        (_, columns), *lines = read_csv(path)
        for line, cells in lines:
            place = line
            cell_of = dict(zip(columns, cells, strict=True))
            if cell_of["variant"] != "published" or cell_of.get("settings"):
                continue
            for kind in ERROR_KINDS:
                if not cell_of[kind]:
                    continue
                key = (cell_of["sequence"].removeprefix(KITTI), cell_of["method"], kind)
                if key in found:
                    raise ValueError("this sequence and method have a row already")
                found[key] = _of_cells(cell_of, kind)
    except (KeyError, ValueError) as error:
        raise DataError(
            f"is not a table of vo reproduce: {type(error).__name__} {error}", path, place
        ) from None
    return found


def _of_cells(cell_of: Mapping[str, str], kind: str) -> Ours:
    """Our errors from the cells of a row of table1.csv, by column; ValueError for a number that is none."""
    mean = float(cell_of[kind])
    deviation = float(cell_of[f"{kind}_std"] or "nan")
    seeds = int(cell_of["seeds"])
    # The row of averages has no share of its own: its sequences were judged by theirs.
    share = float(cell_of["removed_share"] or "1")
    known = (mean, deviation if seeds > 1 else 0.0, share)  # one seed has no deviation
    if seeds < 1 or not all(math.isfinite(value) and value >= 0 for value in known):
        raise ValueError(f"expected seeds from 1 and finite numbers from 0, found {seeds}, {known}")
    return Ours(bool(cell_of[f"paper_{kind}"]), share > 0, seeds, mean, deviation)


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


def judge_all(
    ours: OursByCell,
    paper: table1.PaperTable,
    ranges: Mapping[tuple[str, str], tuple[float, float]],
) -> dict[str, list[Judged]]:
    """The verdicts by kind of error on all printed numbers that have a result of ours."""
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
    """Tables of the verdicts, and above each how often they occur; none without a cell."""
    tables = []
    for kind, of_kind in cells.items():
        judged = list(of_kind)
        if judged:
            words, digits = ERROR_KINDS[kind]
            title = f"{words}: verdict on printed numbers"
            rows = [_verdict_row(cell, digits) for cell in judged]
            tables.append(ReportTable(title, VERDICT_COLUMNS, rows, [], [summary(judged)]))
    return tables


def _verdict_row(cell: Judged, digits: int) -> list[str]:
    """A row of the table, with one text for each of `VERDICT_COLUMNS`; `digits` are the printed decimals."""
    choices = "not measured"
    if cell.choices is not None:
        lowest, highest = cell.choices
        choices = f"{format_number(lowest, digits)} to {format_number(highest, digits)}"
    compared = ["-", "-", "-", "-"]  # what has no verdict is not compared
    if cell.outcome in INSIDE + OUTSIDE:
        compared = [
            signed(cell.ours - cell.converted, digits),
            f"{signed(100 * cell.difference_share, 1)} %",
            format_number(cell.allowed),
            f"{100 * cell.allowed_share:.1f} %",
        ]
    return [
        f"{cell.row} {table1.PRINTED_NAMES[cell.method]}",
        format_number(cell.printed, digits),
        format_number(cell.converted, digits),
        format_number(cell.ours),
        *compared,
        choices,
        cell.outcome,
    ]


def summary(cells: Iterable[Judged]) -> str:
    """How many cells have each verdict, and how many are outside the seeds.

    The averages have their verdicts, but they are made of the same runs as the rows, so they are not counted.
    """
    counted = [cell for cell in cells if cell.row != table1.AVERAGE]
    outcomes = collections.Counter(cell.outcome for cell in counted)
    words = "; ".join(f"{outcome}: {count}" for outcome, count in outcomes.items())
    compared = _compared(counted)
    if not compared:
        return f"{words}. So none of these numbers can be compared with the paper's."
    outside = sum(cell.outcome in OUTSIDE for cell in compared)
    return f"{words}. Outside the seeds: {outside} of {len(compared)} (averages not counted)."


def chance_alone(cells: Iterable[Judged]) -> str:
    """How many of all cells chance alone would put outside the seeds; "" if no cell was compared."""
    compared = _compared(cells)
    if not compared:
        return ""
    outside = sum(cell.outcome in OUTSIDE for cell in compared)
    counts = simulated_outside(compared)
    level = 1.0 - CONFIDENCE
    most = round(level * len(compared), 3)
    return (
        f"TE and RE together: {outside} of {len(compared)} numbers are outside the seeds (averages not "
        f"counted).\nIf every printed number were one more run of our method, chance alone would put on average "
        f"at most {most:.1f} outside ({100 * level:.0f} %);\nwith the scatter and the rounding of these cells it "
        f"is {counts.mean():.1f} on average (simulated, cells independent).\n{surprising_number(counts)} or more "
        f"would be surprising: chance alone gives as many in at most {100 * SURPRISING:.0f} % of such tables."
    )


def _compared(cells: Iterable[Judged]) -> list[Judged]:
    """The cells with a verdict, without the averages."""
    return [cell for cell in cells if cell.row != table1.AVERAGE and cell.outcome in INSIDE + OUTSIDE]


def simulated_outside(cells: Sequence[Judged]) -> Array:
    """How many cells would be outside the seeds if the printed numbers were further runs, (SIMULATIONS,).

    Each cell gets n + 1 runs with our mean and deviation. The last one is printed as the paper prints, and
    judged by the others.
    """
    random = np.random.default_rng(0)
    outside = np.zeros(SIMULATIONS)
    for cell in cells:
        runs = random.normal(cell.ours, cell.deviation, (SIMULATIONS, cell.seeds + 1))
        seeds = runs[:, :-1]
        printed = printed_and_back(runs[:, -1], cell.method, cell.kind)
        factor = prediction_half_width(1.0, cell.seeds)
        allowed = factor * standard_deviation(seeds.T) + rounding(cell.method, cell.kind)
        outside += np.abs(seeds.mean(axis=1) - printed) > allowed
    return outside


def surprising_number(counts: Array) -> int:
    """The least number that at most a share `SURPRISING` of the counts reaches."""
    number = 1
    while np.mean(counts >= number) > SURPRISING:
        number += 1
    return number


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
        """The verdict on the question whether the change is general: a gain lowers the error."""
        mean = self.interval.mean
        if not np.any(self.changes):
            return "no change on any sequence"
        if mean == 0.0:
            return "gains and losses that cancel"
        kind = "gain" if mean < 0 else "loss"
        if self.interval.excludes(0.0):
            return f"a {kind} that is hardly chance"
        other = "loss" if mean < 0 else "gain"
        return f"a {kind}, but another set of sequences could show none or a {other}"

    @property
    def sequences_needed(self) -> int | None:
        """Sequences with which a t test would find this mean change in 80 % of the sets, or None."""
        return changes_needed(self.interval.mean, self.interval.deviation)


def gain_over_sequences(before: Mapping[str, float], after: Mapping[str, float]) -> Gain:
    """The gain paired over the sequences that both have, with interval, sign flips and leave-one-out.

    Raises `DataError` with fewer than two sequences, and for an error that is not a number.
    """
    names = tuple(name for name in before if name in after)
    if len(names) < 2:
        raise DataError(f"a gain over sequences needs two sequences or more, here {len(names)}")
    old = np.array([before[name] for name in names])
    new = np.array([after[name] for name in names])
    change = new - old
    if not np.isfinite(change).all():
        missing = [name for name, value in zip(names, change, strict=True) if not math.isfinite(value)]
        raise DataError(f"a gain over sequences needs errors on each sequence: none on {', '.join(missing)}")
    return Gain(names, change, paired_change(old, new), sign_flip_share(change), means_without_each(change))


def printed_column(paper: table1.PaperTable, method: str, kind: str) -> dict[str, float]:
    """The printed numbers of a method on the ten sequences, in the right unit."""
    place = list(ERROR_KINDS).index(kind)
    column = {}
    for row in table1.SUB_SEQUENCES:
        printed = paper.value(row, method)[place]
        if printed is not None:
            column[row] = converted(printed, method, kind)
    return column


def our_column(found: OursByCell, method: str, kind: str) -> dict[str, float]:
    """Our means of a method on the whole sequences of the table that `left_out` does not name."""
    out = left_out(found, method, kind)
    return {row: found[row, method, kind].mean for row in table1.SUB_SEQUENCES if row not in out}


def left_out(found: OursByCell, method: str, kind: str) -> dict[str, str]:
    """The sequences of the table whose errors say nothing about a gain, with the reason."""
    out = {}
    for row in table1.SUB_SEQUENCES:
        ours = found.get((row, method, kind))
        name = table1.PRINTED_NAMES[method]
        if ours is None:
            out[row] = f"no run of {name}"
        elif not ours.whole:
            out[row] = "part of the sequence"
        elif not math.isfinite(ours.mean):
            out[row] = f"a seed of {name} without errors"
        elif method == table1.PROPOSAL and not ours.boxes:
            out[row] = "no boxes"
    return out


def why_no_gain(found: OursByCell, methods: Sequence[str], kind: str) -> str:
    """Why our sequences give no gain from one method to another; "" if two or more of them give one."""
    reasons: dict[str, list[str]] = {}
    for row in table1.SUB_SEQUENCES:
        for method in methods:
            reason = left_out(found, method, kind).get(row)
            if reason:
                reasons.setdefault(reason, []).append(row)
                break  # the first reason is enough
    left = len(table1.SUB_SEQUENCES) - sum(map(len, reasons.values()))
    if left >= 2:
        return ""
    if not found:
        return "not measured"
    words = "; ".join(f"{reason}: {', '.join(rows)}" for reason, rows in reasons.items())
    return f"no answer, since it takes two whole sequences of both systems, and there are {left} ({words})"
