"""Tables as data, Markdown or CSV, and the report, an HTML page with embedded pictures."""

from __future__ import annotations

import base64
import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from datetime import date
from typing import Any

from ..evaluation.kitti_errors import FEW_SUBSEQUENCES
from ..files import csv_text
from ..runs.identity import library_versions, machine_info

NO_NUMBER = "–"
COUNT_COLUMN = "sub-seqs"  # number of sub-sequences from which a row's errors come
FEW_NOTE = f"few: fewer than {FEW_SUBSEQUENCES} sub-sequences, so a single place of the path may decide."


@dataclass(frozen=True)
class ReportTable:
    """A table of formatted cells, some with a line break; the first `names` columns name the rows.

    `head` : sentences above the table; `notes` : sentences below the table.
    """

    title: str
    columns: list[str]
    rows: list[list[str]]
    notes: list[str]
    head: list[str] = field(default_factory=list)
    names: int = 1


def without_empty_columns(table: ReportTable) -> ReportTable:
    """The table without columns that contain only dashes."""
    filled = [k for k in range(len(table.columns)) if any(row[k] != NO_NUMBER for row in table.rows)]
    rows = [[row[k] for k in filled] for row in table.rows]
    return replace(table, columns=[table.columns[k] for k in filled], rows=rows)


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
    return str(subsequences) + (" (few)" if subsequences < FEW_SUBSEQUENCES else "")


def plus_minus(mean: float | None, deviation: float | None) -> str:
    """The text "mean ± deviation"; without a deviation, only the mean; without a mean, a dash."""
    return format_number(mean) + (
        "" if finite_or_none(deviation) is None else f" ± {format_number(deviation)}"
    )


def seeds_text(count: int) -> str:
    """Description of a table's numbers: means with standard deviations, or single runs."""
    return "one seed" if count == 1 else f"mean ± standard deviation over {count} seeds"


def markdown(table: ReportTable) -> str:
    """A table with its title and notes in Markdown."""
    lines = [table.columns, ["---", *["---:"] * (len(table.columns) - 1)], *table.rows]
    rows = "".join("| " + " | ".join(cell.replace("\n", "<br>") for cell in line) + " |\n" for line in lines)
    head = "".join(f"{line}\n\n" for line in table.head)
    return f"## {table.title}\n\n{head}{rows}" + "".join(f"\n{note}\n" for note in table.notes)


def records_csv(records: list[dict[str, Any]]) -> str:
    """Records with equal keys as CSV; None is an empty cell."""
    rows = [[_csv_cell(value) for value in record.values()] for record in records]
    return csv_text([list(records[0]) if records else [], *rows])


def _csv_cell(value: Any) -> Any:
    """A value of a record as a cell of a CSV table."""
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

    place : where it is in a report: "" in one column; "tall" in one column, beside two rows; "wide" in two
    columns; "two" in two columns as well, but a telephone shows only one of its two panels at a time.
    """

    data: bytes
    caption: str
    place: str = ""

    @property
    def address(self) -> str:
        """The picture as a data URL."""
        return data_url("png" if self.data.startswith(PNG_START) else "jpeg", self.data)


def data_url(kind: str, data: bytes) -> str:
    """The bytes of a picture as an address that contains them."""
    return f"data:image/{kind};base64,{base64.b64encode(data).decode('ascii')}"


def provenance() -> list[str]:
    """Lines for a report with the versions of the kit, Python and libraries, the commit and the machine."""
    version = library_versions()
    system = machine_info()
    libraries = f"numpy {version['numpy']}, OpenCV {version['opencv']}"
    kit = f"stereo-vo-kit {version['kit']}, commit {system['commit'] or 'unknown'}"
    return [f"{kit}, Python {system['python']}, {libraries}", f"{system['system']}, {system['processor']}"]


def render_report(
    results: Sequence[str],
    tables: list[ReportTable],
    folded: list[ReportTable],
    pictures: list[Picture],
    origin: list[str],
    problems: Sequence[str] = (),
    films: Sequence[ShownFilm] = (),
) -> str:
    """The report as HTML, with all text escaped: results, problems, two pictures, tables, more pictures.

    `origin` : command and duration.
    """
    from jinja2 import Environment, PackageLoader, StrictUndefined

    loader = PackageLoader("vo_lib.report")
    pages = Environment(loader=loader, autoescape=True, undefined=StrictUndefined, trim_blocks=True)
    return pages.get_template("report.html").render(
        results=results,
        problems=problems,
        tables=tables,
        folded=folded,
        pictures=pictures,
        origin=[*origin, *provenance(), date.today().isoformat()],
        films=films,
    )
