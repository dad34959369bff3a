"""The paper's Table 1 as printed, with remarks on its numbers."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from ..files import read_csv
from ..geometry.types import Array
from .page import ReportTable

PAPER_METHODS = ("viso2", "mesvo_f", "solution_selection", "feature_selection")
PRINTED_NAMES = dict(
    zip(PAPER_METHODS, ("VISO2", "MESVO_F", "Solution selection", "Feature selection"), strict=True)
)
PROPOSAL = "feature_selection"
AVERAGE = "Avg"
LEFT_OUT = "01"  # the highway, which has dashes in the paper's table
# Numbers of sub-sequences of 00, 02 … 10 in the benchmark, the weights of its pooled mean.
_NUMBERS = (3283, 3453, 184, 43, 1806, 570, 317, 2813, 958, 464)
SUB_SEQUENCES = dict(zip([f"{k:02d}" for k in range(11) if k != 1], _NUMBERS, strict=True))
PAPER_ROWS = (AVERAGE, *SUB_SEQUENCES)
# Section 4 of the paper: gains of Feature selection, (TE, RE) in %.
CLAIMS = {"solution_selection": (8.0, 7.0), "mesvo_f": (6.0, 15.0)}

REMARKS = (
    "The paper calls its numbers RMSE of 11 sequences. The numbers are means; Avg is the mean of ten rows.",
    "The paper's VISO2 average is shown as printed, 2.43 / 1.106; the mean of its rows is 2.10 / 1.247.",
    "The RE of the paper's other three columns is shown as printed. All these values are multiples of 1/180: "
    "radians were probably converted with 5555.6 instead of 5729.6, so the RE is about 3 % too low.",
    "The paper names MESVO_F but does not describe it. In our interpretation, MESVO_F is RANSAC: no prior, "
    "and the candidate with the most inliers wins.",
)


@dataclass(frozen=True)
class PaperTable:
    """Printed TE in % and RE in deg/100 m by (row, method); None for a dash."""

    numbers: dict[tuple[str, str], tuple[float | None, float | None]]

    def value(self, row: str, method: str) -> tuple[float | None, float | None]:
        """TE and RE of a row ("00" … "10" or "Avg") and a method."""
        return self.numbers.get((row, method), (None, None))


def gain(before: ArrayLike, after: ArrayLike) -> Array:
    """Relative improvement in %; not finite if the old error is 0."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(100.0 * (1.0 - np.asarray(after, float) / np.asarray(before, float)))


def read_paper_table() -> PaperTable:
    """The paper's table, read from paper_table1.csv."""
    table = PaperTable({})
    for name, *cells in _cells():
        numbers = [None if cell == "-" else float(cell) for cell in cells]
        for method, pair in zip(PAPER_METHODS, zip(numbers[::2], numbers[1::2], strict=True), strict=True):
            table.numbers[name, method] = pair
    return table


def printed_table() -> ReportTable:
    """The paper's table as printed, with remarks."""
    columns = [f"{name} {kind}" for name in PRINTED_NAMES.values() for kind in ("TE %", "RE deg/100 m")]
    return ReportTable("The paper's Table 1, as printed", ["sequence", *columns], _cells(), list(REMARKS))


def _cells() -> list[list[str]]:
    """The rows of paper_table1.csv, without the heading."""
    (_, _), *rows = read_csv(Path(__file__).with_name("paper_table1.csv"))
    return [cells for _, cells in rows]
