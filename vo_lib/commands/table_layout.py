"""Tables that fit into a terminal: where cells may break, and where a table is split into several.

A number is never broken, nor parted from its ±. A heading breaks only at blanks. The names of the rows break
at blanks and, if they must, behind a comma, a slash or the like. What is still too wide is split: each of
the tables then has the names of the rows and some of the other columns.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from ..report.breaking import Width, broken, glued

BORDERS = 3  # characters of a column that are not text: a line, and a blank on each side
LONGEST_NUMBER = 30  # characters; a longer cell is a text, which may break at blanks
LEAST_NAME = 24  # characters to which a name may be broken, if the table is too wide otherwise
JOINED = "settings"  # heading of the names of the rows in one column, "name=value" below each other


@dataclass(frozen=True)
class TablePart:
    """A table whose cells are broken into lines that are short enough.

    `name_columns` : number of columns, from the first one, that name the rows.
    """

    columns: list[str]
    rows: list[list[str]]
    name_columns: int

    def width(self, width_of: Width) -> int:
        """The width of the table with its borders."""
        widths = []
        for place, heading in enumerate(self.columns):
            cells = [heading, *(row[place] for row in self.rows)]
            widths.append(max(width_of(line) for cell in cells for line in cell.split("\n")))
        return _total(widths)


def fitting_parts(
    columns: list[str],
    rows: list[list[str]],
    width: int,
    width_of: Width,
    name_columns: int = 1,
    numbers: bool = True,
) -> list[TablePart]:
    """A table as one or several that have at most `width` columns of the terminal, as far as possible.

    Parameters
    ----------
    columns, rows : headings and cells; a cell may have several lines.
    name_columns : number of columns, from the first one, that name the rows.
    numbers : whether the other columns have numbers, which are not broken, or texts.
    """
    table = TablePart(
        [glued(name) for name in columns], [list(map(glued, row)) for row in rows], name_columns
    )
    candidates = [table]
    if name_columns > 1:
        candidates.append(_with_one_name(table))
    # A table whose names break at blanks only is better than one with broken names, and both are better than
    # several tables.
    for least_name in (None, LEAST_NAME):
        for candidate in candidates:
            measured = _Measured.of(candidate, width_of, numbers, least_name)
            if _total(measured.least) <= width:
                return [_broken(candidate, measured.widths(width), width_of)]
    split_tables = [_split(candidate, width, width_of, numbers) for candidate in candidates]
    return min(split_tables, key=len)


@dataclass(frozen=True)
class _Measured:
    """Widths of the columns of a table: the least ones, and those without any break."""

    least: list[int]
    whole: list[int]

    @classmethod
    def of(cls, table: TablePart, width_of: Width, numbers: bool, least_name: int | None) -> _Measured:
        """The widths of a table; with `least_name`, longer names may break within words."""
        least = []
        whole = []
        for place, heading in enumerate(table.columns):
            lines = [line for row in table.rows for line in row[place].split("\n")]
            longest_line = max(map(width_of, lines), default=0)
            words = [word for line in lines for word in line.split(" ")]
            longest_word = max(map(width_of, words), default=0)
            is_name = place < table.name_columns
            if numbers and not is_name and longest_line <= LONGEST_NUMBER:
                least_of_cells = longest_line  # a number is not broken
            elif least_name is not None and (is_name or not numbers):
                least_of_cells = min(longest_word, least_name)
            else:
                least_of_cells = longest_word
            least_of_heading = max(width_of(word) for word in heading.split(" "))
            least.append(max(least_of_cells, least_of_heading))
            whole.append(max(longest_line, width_of(heading)))
        return cls(least, whole)

    def widths(self, width: int) -> list[int]:
        """Widths from `least` to `whole` within `width`; the columns that lack least are filled first."""
        widths = list(self.least)
        lacking = [whole - least for whole, least in zip(self.whole, self.least, strict=True)]
        rest = width - _total(widths)
        for place in sorted(range(len(widths)), key=lambda place: lacking[place]):
            more = min(rest, lacking[place])
            widths[place] += more
            rest -= more
        return widths


def _total(widths: Iterable[int]) -> int:
    """The width of a table with its borders."""
    return 1 + sum(width + BORDERS for width in widths)


def _with_one_name(table: TablePart) -> TablePart:
    """The table with all names of a row in one column, a line for each."""
    headings = table.columns[: table.name_columns]
    rows = []
    for row in table.rows:
        lines = [f"{heading}={name}" for heading, name in zip(headings, row, strict=False)]
        rows.append(["\n".join(lines), *row[table.name_columns :]])
    return TablePart([JOINED, *table.columns[table.name_columns :]], rows, 1)


def _split(table: TablePart, width: int, width_of: Width, numbers: bool) -> list[TablePart]:
    """Tables with the names of the rows and as many of the other columns as there is room for."""
    measured = _Measured.of(table, width_of, numbers, LEAST_NAME)
    name_places = list(range(table.name_columns))
    groups: list[list[int]] = [[]]  # places of the other columns in each table
    for place in range(table.name_columns, len(table.columns)):
        candidate = [*name_places, *groups[-1], place]
        if groups[-1] and _total(measured.least[each] for each in candidate) > width:
            groups.append([])
        groups[-1].append(place)
    parts = []
    for group in groups:
        places = [*name_places, *group]
        columns = [table.columns[place] for place in places]
        rows = [[row[place] for place in places] for row in table.rows]
        least = [measured.least[place] for place in places]
        whole = [measured.whole[place] for place in places]
        widths = _Measured(least, whole).widths(width)
        parts.append(_broken(TablePart(columns, rows, table.name_columns), widths, width_of))
    return parts


def _broken(table: TablePart, widths: list[int], width_of: Width) -> TablePart:
    """The table with the lines of its headings and cells broken to these widths."""
    headings = [broken(name, width, width_of) for name, width in zip(table.columns, widths, strict=True)]
    rows = []
    for row in table.rows:
        rows.append([broken(cell, width, width_of) for cell, width in zip(row, widths, strict=True)])
    return TablePart(headings, rows, table.name_columns)
