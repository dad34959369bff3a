"""Tables as data, Markdown or CSV, and the report, an HTML page with embedded pictures."""

from __future__ import annotations

import base64
import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from datetime import date
from typing import Any

from ..data.tables import csv_text
from ..evaluation.kitti_errors import FEW_SUBSEQUENCES
from ..runs.identity import library_versions, machine_info

NO_NUMBER = "–"
COUNT_COLUMN = "sub-seqs"  # number of sub-sequences from which a row's errors come
FEW_NOTE = f"few: fewer than {FEW_SUBSEQUENCES} sub-sequences, so a single place of the path may decide."


@dataclass(frozen=True)
class ReportTable:
    """A table of formatted cells, some with a line break.

    head : sentences above the table.
    notes : sentences below the table.
    name_columns : number of columns, from the first one, that name the rows.
    """

    title: str
    columns: list[str]
    rows: list[list[str]]
    notes: list[str]
    head: list[str] = field(default_factory=list)
    name_columns: int = 1


def without_empty_columns(table: ReportTable) -> ReportTable:
    """The table without columns that contain only dashes."""
    filled = []
    for place in range(len(table.columns)):
        if any(row[place] != NO_NUMBER for row in table.rows):
            filled.append(place)
    columns = [table.columns[place] for place in filled]
    rows = [[row[place] for place in filled] for row in table.rows]
    return replace(table, columns=columns, rows=rows)


def finite_or_none(value: float | None) -> float | None:
    """The number, or None if it is not finite."""
    return None if value is None or not math.isfinite(value) else float(value)


def format_number(value: float | None, digits: int = 3) -> str:
    """A number as text; a dash for None and for numbers that are not finite."""
    return NO_NUMBER if finite_or_none(value) is None else f"{value:.{digits}f}"


def signed(value: float, digits: int) -> str:
    """A difference as text, with its sign."""
    return f"{value:+.{digits}f}".replace("-", "−")


def few_marked(subsequences: int) -> str:
    """A number of sub-sequences as a cell, with "few" beside a small number."""
    return f"{subsequences} (few)" if subsequences < FEW_SUBSEQUENCES else str(subsequences)


def plus_minus(mean: float | None, deviation: float | None) -> str:
    """The text "mean ± deviation"; without a deviation, only the mean; without a mean, a dash."""
    if finite_or_none(deviation) is None:
        return format_number(mean)
    return f"{format_number(mean)} ± {format_number(deviation)}"


def seeds_text(count: int) -> str:
    """Description of a table's numbers: means with standard deviations, or single runs."""
    return "one seed" if count == 1 else f"mean ± standard deviation over {count} seeds"


def markdown(table: ReportTable) -> str:
    """A table in Markdown, with its title and the sentences above and below it."""
    right_aligned = ["---:"] * (len(table.columns) - 1)
    text = f"## {table.title}\n\n"
    for sentence in table.head:
        text += f"{sentence}\n\n"
    for row in [table.columns, ["---", *right_aligned], *table.rows]:
        cells = [cell.replace("\n", "<br>") for cell in row]
        text += f"| {' | '.join(cells)} |\n"
    for note in table.notes:
        text += f"\n{note}\n"
    return text


def records_csv(records: list[dict[str, Any]]) -> str:
    """Records with equal keys as CSV; None is an empty cell."""
    heading = list(records[0]) if records else []
    rows = [[_csv_cell(value) for value in record.values()] for record in records]
    return csv_text([heading, *rows])


def _csv_cell(value: Any) -> Any:
    """A value of a record as a cell of a CSV table: six decimals for a float, nothing for None."""
    if value is None:
        return ""
    return f"{value:.6f}" if isinstance(value, float) else value


PNG_START = b"\x89PNG"


@dataclass(frozen=True)
class ShownFilm:
    """A film: its address relative to the report, a caption, and a JPEG that is shown until it plays."""

    address: str
    caption: str
    poster: bytes

    @property
    def poster_address(self) -> str:
        """The poster as a data URL."""
        return data_url("jpeg", self.poster)


@dataclass(frozen=True)
class Picture:
    """The bytes of a PNG or JPEG, and a caption.

    place : its size in the columns of a report: "" for one column and one row; "tall" for one column and two
        rows; "wide" for two columns; "two" for two columns as well, of which a telephone shows one at a time,
        since the picture has two panels.
    """

    data: bytes
    caption: str
    place: str = ""

    @property
    def address(self) -> str:
        """The picture as a data URL."""
        kind = "png" if self.data.startswith(PNG_START) else "jpeg"
        return data_url(kind, self.data)


def data_url(kind: str, data: bytes) -> str:
    """The bytes of a picture as an address that contains them."""
    return f"data:image/{kind};base64,{base64.b64encode(data).decode('ascii')}"


def provenance() -> list[str]:
    """Lines for a report with the versions of the kit, Python and libraries, the commit and the machine."""
    version_of = library_versions()
    machine = machine_info()
    kit = f"stereo-vo-kit {version_of['kit']}, commit {machine['commit'] or 'unknown'}"
    libraries = f"numpy {version_of['numpy']}, OpenCV {version_of['opencv']}"
    return [
        f"{kit}, Python {machine['python']}, {libraries}",
        f"{machine['system']}, {machine['processor']}",
    ]


def render_report(
    results: Sequence[str],
    tables: list[ReportTable],
    folded: list[ReportTable],
    pictures: list[Picture],
    origin: list[str],
    problems: Sequence[str] = (),
    films: Sequence[ShownFilm] = (),
) -> str:
    """The report as HTML, with all text escaped.

    Parameters
    ----------
    results : sentences at the top; without them, the first problem is there.
    tables : shown one below the other; folded : tables after them that the reader has to open.
    pictures : the first two or three are above the tables, the others below.
    origin : command and duration.
    problems : sentences in a box of their own.
    films : shown after the last picture.
    """
    from jinja2 import Environment, PackageLoader, StrictUndefined

    loader = PackageLoader("vo_lib.report")
    environment = Environment(loader=loader, autoescape=True, undefined=StrictUndefined, trim_blocks=True)
    return environment.get_template("report.html").render(
        results=results,
        problems=problems,
        tables=tables,
        folded=folded,
        pictures=pictures,
        origin=[*origin, *provenance(), date.today().isoformat()],
        films=films,
    )
