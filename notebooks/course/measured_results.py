"""Results that were measured once and are kept beside the notebooks: the tables of `results.md` and `choices.csv`."""

from __future__ import annotations

import numpy as np

from vo_lib.geometry.types import Array
from vo_lib.report.page import ReportTable

from .notebook_folder import NOTEBOOKS

RESULTS = NOTEBOOKS / "results.md"  # written by `vo data measure_results`
CHOICES = NOTEBOOKS / "choices.csv"  # written by `vo data measure_choices`
THRESHOLD_AND_BOXES = "threshold and boxes"  # rows of this choice have absolute errors
SPREAD_OF = "standard deviation over the seeds of "  # in the heads of tables of `results.md`


def results_table(title: str, only: str = "") -> ReportTable:
    """A table of `results.md`, with the rows whose name begins with `only`."""
    _, _, after_title = RESULTS.read_text(encoding="utf-8").partition(f"## {title}\n")
    section, _, _ = after_title.partition("\n## ")
    lines = section.splitlines()
    cells = []
    for line in lines:
        if line.startswith("|"):
            cells.append([cell.strip() for cell in line.strip("|").split("|")])
    columns, _, *rows = cells  # the second line is that of the dashes
    return ReportTable(title, columns, [row for row in rows if row[0].startswith(only)], [])


def whole_drive_errors(section: str, row: str) -> dict[str, Array]:
    """Of a whole drive by method, from `results.md`: TE (%), RE (deg/100 m), and their deviations, (4,).

    The deviations are standard deviations over the seeds. A method with the numbers of `solution_selection` is left
    out.
    """

    def cells(title: str) -> dict[str, str]:
        table = results_table(f"{section}: {title}", row)
        for cells_of_row in table.rows:
            if cells_of_row[0] == row:
                return dict(zip(table.columns, cells_of_row, strict=False))
        return {}  # the tables omit rows without a spread

    te = cells("TE, %")
    re = cells("RE, deg/100 m")
    te_sd = cells(SPREAD_OF + "TE, %")
    re_sd = cells(SPREAD_OF + "RE, deg/100 m")
    numbers = {}
    for method in list(te)[1:]:
        words = (te[method], re[method], te_sd.get(method, "0"), re_sd.get(method, "0"))
        # The sign = stands for the number of `solution_selection`.
        if "=" not in words:
            numbers[method] = np.array([float(word) for word in words])
    return numbers
