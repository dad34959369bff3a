"""Tables of `measure_results`, with errors and standard deviations in separate tables."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from vo_lib.evaluation.statistics import NO_CHANGE, one_run_shows
from vo_lib.geometry.types import Array
from vo_lib.report.page import NO_NUMBER, ReportTable, format_number

# Rows TE and RE, columns mean and standard deviation over the seeds: (2, 2); None without a number.
Cell = Array | None
MEAN = 0
DEVIATION = 1
Cells = Mapping[str, Mapping[str, Cell]]  # by row and column
KINDS = "TE, %", "RE, deg/100 m"
SAME = "="  # text of a repeated cell
LEAST_SPREAD = 0.0005  # smallest spread that is not printed as 0.000


def tables(title: str, cells: Cells, sentences: list[str], name: str = "sequence") -> list[ReportTable]:
    """Tables of TE and RE and of their standard deviations, with `sentences` above the first table.

    If `mesvo_f` has the numbers of `solution_selection`, the cell is `SAME`. Rows without spread are omitted.
    """
    columns = list(next(iter(cells.values())))
    result = []
    for statistic in (MEAN, DEVIATION):
        for kind, unit in enumerate(KINDS):
            rows = []
            for label, row in cells.items():
                numbers = {
                    column: None if cell is None else float(cell[kind, statistic])
                    for column, cell in row.items()
                }
                without_spread = all((value or 0.0) < LEAST_SPREAD for value in numbers.values())
                if statistic == DEVIATION and without_spread:
                    continue
                texts = {column: format_number(value) for column, value in numbers.items()}
                if statistic == MEAN and _repeats(row.get("mesvo_f"), row.get("solution_selection")):
                    texts["mesvo_f"] = SAME
                rows.append([label, *texts.values()])
            if not rows:
                continue
            notes = []
            if any(SAME in row for row in rows):
                notes.append(f"{SAME}: number of solution_selection.")
            words = "" if statistic == MEAN else "standard deviation over the seeds of "
            result.append(ReportTable(f"{title}: {words}{unit}", [name, *columns], rows, notes))
    result[0].head.extend(sentences)
    return result


def with_numbers(cells: Cells) -> Cells:
    """The rows with at least one number."""
    return {label: row for label, row in cells.items() if any(cell is not None for cell in row.values())}


def _repeats(cell: Cell, other: Cell) -> bool:
    """Whether two cells have nearly equal means."""
    return cell is not None and other is not None and np.allclose(cell[:, 0], other[:, 0], 2e-3, 1e-3)


def compared(cells: Cells, before: str, after: str, subject: str) -> list[str]:
    """Sentences, for TE and for RE, on the rows where one run would show that `after` is lower or higher.

    subject : what leads from `before` to `after`, as the subject of the sentence.
    """
    sentences = []
    for kind, unit in enumerate(KINDS):
        lower = list[str]()
        higher = list[str]()
        count = 0
        for label, row in cells.items():
            old = row.get(before)
            new = row.get(after)
            if old is None or new is None:
                continue
            count += 1
            was, deviation = old[kind]
            now, new_deviation = new[kind]
            if one_run_shows(was, deviation, now, new_deviation):
                change = f"{label} ({format_number(was)} → {format_number(now)})"
                if now < was:
                    lower.append(change)
                else:
                    higher.append(change)
        name = unit.split(",")[0]
        rest = count - len(lower) - len(higher)
        sentences.append(
            f"Would one run show it? {subject} lowers {name} on {'; '.join(lower) or 'no row'}. "
            f"{name} is higher on {'; '.join(higher) or 'no row'}. In {rest} of {count} rows, one run would "
            f"not show the change: it is {NO_CHANGE}."
        )
    return sentences


def plain(title: str, name: str, rows: Mapping[str, Mapping[str, float | None]], digits: int) -> ReportTable:
    """A table of numbers without standard deviations; `rows` has the numbers by row, then by column."""
    columns = list(next(iter(rows.values())))
    cells = [
        [label, *(NO_NUMBER if x is None else f"{x:.{digits}f}" for x in row.values())]
        for label, row in rows.items()
    ]
    return ReportTable(title, [name, *columns], cells, [])
