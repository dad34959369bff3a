"""Tables of `measure_results`, with errors and standard deviations in separate tables."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from vo_lib.evaluation.statistics import NO_CHANGE, change_limit
from vo_lib.geometry.types import Array
from vo_lib.report.page import NO_NUMBER, ReportTable, format_number

# Rows TE and RE, columns mean and standard deviation over the seeds: (2, 2); None without a number.
Cell = Array | None
Cells = Mapping[str, Mapping[str, Cell]]  # by row and column
KINDS = "TE, %", "RE, deg/100 m"
SAME, LEAST_SPREAD = "=", 0.0005  # text of a repeated cell; smallest spread that is not printed as 0.000


def tables(title: str, cells: Cells, sentences: list[str], name: str = "sequence") -> list[ReportTable]:
    """Tables of TE and RE and of their standard deviations, with `sentences` above the first table.

    If `mesvo_f` has the numbers of `solution_selection`, the cell is `SAME`. Rows without spread are omitted.
    """
    columns = list(next(iter(cells.values())))
    result = []
    for part, words in ((0, ""), (1, "standard deviation over the seeds of ")):
        for kind, unit in enumerate(KINDS):
            rows = []
            for label, row in cells.items():
                numbers = {
                    column: None if cell is None else float(cell[kind, part]) for column, cell in row.items()
                }
                if part and all((value or 0.0) < LEAST_SPREAD for value in numbers.values()):
                    continue
                texts = {column: format_number(value) for column, value in numbers.items()}
                if not part and _repeats(row.get("mesvo_f"), row.get("solution_selection")):
                    texts["mesvo_f"] = SAME
                rows.append([label, *texts.values()])
            notes = [f"{SAME}: number of solution_selection."] if any(SAME in row for row in rows) else []
            if rows:
                result.append(ReportTable(f"{title}: {words}{unit}", [name, *columns], rows, notes))
    result[0].head.extend(sentences)
    return result


def with_numbers(cells: Cells) -> Cells:
    """The rows with at least one number."""
    return {label: row for label, row in cells.items() if any(cell is not None for cell in row.values())}


def _repeats(cell: Cell, other: Cell) -> bool:
    return cell is not None and other is not None and np.allclose(cell[:, 0], other[:, 0], 2e-3, 1e-3)


def compared(cells: Cells, before: str, after: str, subject: str) -> list[str]:
    """Texts, for TE and for RE, that list the rows with `after` clearly below or above `before`."""
    sentences = []
    for kind, unit in enumerate(KINDS):
        sides: dict[bool, list[str]] = {True: [], False: []}
        count = 0
        for label, row in cells.items():
            old = row.get(before)
            new = row.get(after)
            if old is None or new is None:
                continue
            count += 1
            (was, deviation) = old[kind]
            (now, new_deviation) = new[kind]
            if abs(now - was) > change_limit(was, deviation, new_deviation):
                sides[bool(now < was)].append(f"{label} ({format_number(was)} → {format_number(now)})")
        lower, higher = ("; ".join(sides[side]) or "no row" for side in (True, False))
        rest = count - sum(map(len, sides.values()))
        sentences.append(
            f"{subject} lowers {unit.split(',')[0]} on {lower}. {unit.split(',')[0]} is higher on {higher}. "
            f"In {rest} of {count} rows, the change is {NO_CHANGE}."
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
