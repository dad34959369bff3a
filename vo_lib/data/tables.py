"""CSV tables: of the frames of a run, and of many runs."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Sequence
from pathlib import Path

from ..errors import DataError
from ..files import read_text


def read_csv(path: str | Path) -> list[tuple[int, list[str]]]:
    """Rows of a CSV file, each with the number of its last line; empty rows and comments (#) are skipped.

    Raises `DataError` with file and line if the file is not CSV.
    """
    reader = csv.reader(io.StringIO(read_text(path)))
    try:
        return [(reader.line_num, cells) for cells in reader if cells and not cells[0].startswith("#")]
    except csv.Error as error:
        raise DataError(f"is not CSV: {error}", path, reader.line_num) from None


def csv_text(rows: Iterable[Sequence[object]]) -> str:
    """CSV text of rows, the first of which is the heading; the line ending is \\n."""
    buffer = io.StringIO()
    csv.writer(buffer, lineterminator="\n").writerows(rows)
    return buffer.getvalue()
