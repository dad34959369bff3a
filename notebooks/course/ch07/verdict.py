"""Verdicts of chapter 7 on each printed number of Table 1, and how many of them chance alone would give."""

from __future__ import annotations

import collections
import csv
import itertools
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from vo_lib.data.catalogue import KITTI
from vo_lib.evaluation.statistics import standard_deviation
from vo_lib.geometry.types import Array
from vo_lib.report import table1
from vo_lib.report.page import ReportTable, format_number, signed
from vo_lib.report.paper_unit import DEVKIT_STEP, PAPERS_FACTOR, RIGHT_FACTOR, converted, in_paper_unit
from vo_lib.report.table1 import BENCHMARK_FRAMES, ERROR_KINDS

from ..intervals import CONFIDENCE, prediction_half_width
from ..measured_results import CHOICES, THRESHOLD_AND_BOXES
from .our_errors import Ours, OursByCell

FEWEST = 3  # seeds that a verdict needs

# A number counts as reproduced only if the whole interval ours ± allowed is within this share of the printed
# number. The share is about the size of the gains that the paper reports (6 to 15 %): a verdict that cannot
# tell 10 % apart could not see them.
MARGIN = 0.10

# The outcomes. INSIDE: no farther from the mean of our seeds than one more run may be (`Judged.allowed`); the number is
# REPRODUCED if the whole allowed interval is also within `MARGIN` of it. OUTSIDE: farther; then it is asked whether the
# difference is small (CLOSE), or whether another reading of the paper (`choice_ranges`) explains it (BY_CHOICES).
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


@dataclass(frozen=True)
class Judged:
    """A printed number beside ours, both in % or in deg/100 m, and the verdict.

    printed : as in the paper; converted : in the right unit (`paper_unit.converted`).
    allowed : the largest difference that one more run of our method, and rounding, explain.
    choices : lowest and highest error that other readings of the paper gave on the whole sequence, or None.
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

    A method that is off by `MARGIN` gets `REPRODUCED` or `CLOSE` in at most 2.5 % of the cases under two
    assumptions: the printed number is one run, or a mean of runs, of the paper's method, not the best of
    several; and the paper's runs scatter at most about as much as ours. If they scatter three times as much
    (3 % beside 1 %), it is one case in eight with three seeds, nearly one in five with five, and more with ten.
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
        outcome = _by_readings(right, choices, min(allowed, margin))
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


def _by_readings(right: float, choices: tuple[float, float] | None, beyond: float) -> str:
    """The outcome of a number outside the seeds that is not close, from the range of the other readings.

    beyond : how far the number may lie beyond the ends of the range.
    """
    if choices is None:
        return DIFFERENT
    if choices[0] - beyond <= right <= choices[1] + beyond:
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
            # The row without an alternative has the errors; a row with one has the change of the errors.
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
