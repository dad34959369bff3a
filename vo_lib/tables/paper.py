"""The paper's Table 1 as printed: its numbers, and what has to be said about them."""

from __future__ import annotations

import csv
import math
from dataclasses import dataclass
from importlib import resources
from pathlib import Path

from ..core.errors import DataError
from ..core.files import read_text

PAPER_METHODS = ("viso2", "mesvo_f", "solution_selection", "feature_selection")
AVERAGE = "Avg"
LEFT_OUT = "01"  # the highway, which the paper's table does not have
PAPER_ROWS = ("00", "02", "03", "04", "05", "06", "07", "08", "09", "10", AVERAGE)
COLUMNS = ("sequence", *(f"{method}_{kind}" for method in PAPER_METHODS for kind in ("te", "re")))

REMARKS = (
    "The paper's average is the plain mean of its ten rows: 01 is left out.",
    "The paper's VISO2 average is shown as printed, 2.43 / 1.106; the mean of its rows is 2.10 / 1.247.",
    "The RE of the paper's other three columns is shown as printed. All its values are multiples of 1/180: "
    "radians seem to have become degrees with 5555.6 in place of 5729.6, so it reads about 3 % low.",
)


@dataclass(frozen=True)
class PaperTable:
    """Printed numbers by (row, method): TE in % and RE in deg/100 m, None where this table has none."""

    te: dict[tuple[str, str], float | None]
    re: dict[tuple[str, str], float | None]

    def value(self, row: str, method: str) -> tuple[float | None, float | None]:
        """TE and RE of a row ("00" … "10" or "Avg") and a method."""
        return self.te.get((row, method)), self.re.get((row, method))

    @property
    def missing(self) -> int:
        """How many of the table's numbers are not there."""
        return sum(number is None for number in (*self.te.values(), *self.re.values()))


def shipped_table() -> Path:
    """The kit's own copy of the table."""
    return Path(str(resources.files("vo_lib") / "tables" / "paper_table1.csv"))


def read_paper_table(path: str | Path | None = None) -> PaperTable:
    """The table from a CSV file like the kit's own, which is the default; `DataError` names file and line."""
    path = shipped_table() if path is None else Path(path)
    lines = [
        (number, line)
        for number, line in enumerate(read_text(path).split("\n"), start=1)
        if line.strip() and not line.startswith("#")
    ]
    rows = [(number, [cell.strip() for cell in next(csv.reader([line]))]) for number, line in lines]
    if not rows or tuple(rows[0][1]) != COLUMNS:
        raise DataError(f"expected the heading {','.join(COLUMNS)}", path, rows[0][0] if rows else 1)
    table = PaperTable({}, {})
    for number, (name, *cells) in rows[1:]:
        if name not in PAPER_ROWS or (name, PAPER_METHODS[0]) in table.te:
            raise DataError(f"{name!r}: expected each of {', '.join(PAPER_ROWS)} once", path, number)
        if len(cells) != len(COLUMNS) - 1:
            raise DataError(f"{len(cells) + 1} cells, expected {len(COLUMNS)}", path, number)
        numbers = [_number(cell, path, number) for cell in cells]
        for method, te, re in zip(PAPER_METHODS, numbers[::2], numbers[1::2], strict=True):
            table.te[name, method], table.re[name, method] = te, re
    return table


def _number(cell: str, path: Path, line: int) -> float | None:
    if not cell:
        return None
    try:
        value = float(cell)
    except ValueError:
        value = math.nan
    if not 0 <= value < 1000:
        raise DataError(f"{cell!r}: expected a number of 0 or more, or nothing", path, line)
    return value
