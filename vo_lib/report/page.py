"""Tables as data, Markdown or CSV; the report: one page with its pictures inside, to be opened from disk."""

from __future__ import annotations

import base64
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from datetime import date
from typing import Any

from ..files import csv_text
from ..geometry.types import Array
from ..runs.identity import surroundings, versions

NO_NUMBER = "–"


@dataclass(frozen=True)
class ReportTable:
    """A table of formatted cells, some with a line break; the first column names the row.

    `head` stands above the table, `notes` below.
    """

    title: str
    columns: list[str]
    rows: list[list[str]]
    notes: list[str]
    head: list[str] = field(default_factory=list)


def finite(value: float | None) -> float | None:
    """The number, None where it is not finite."""
    return None if value is None or not math.isfinite(value) else float(value)


def number(value: float | None, digits: int = 3) -> str:
    """A number, or a dash where there is none."""
    return NO_NUMBER if finite(value) is None else f"{value:.{digits}f}"


def signed(value: float, digits: int) -> str:
    """A difference with its sign."""
    return f"{value:+.{digits}f}".replace("-", "−")


def mean_and_spread(values: Array) -> tuple[float, float]:
    """Mean and standard deviation over seeds (S,); NaN without seeds, the deviation of one seed too."""
    mean = float(values.mean()) if len(values) else math.nan
    return mean, float(values.std()) if len(values) > 1 else math.nan


def plus_minus(mean: float | None, deviation: float | None) -> str:
    """Mean ± standard deviation; the mean alone without a deviation; a dash where there is none."""
    return number(mean) + ("" if finite(deviation) is None else f" ± {number(deviation)}")


def seeds_words(count: int) -> str:
    """The statistic of a table's numbers."""
    return "one seed" if count == 1 else f"mean ± standard deviation over {count} seeds"


def markdown(table: ReportTable) -> str:
    """A table with its title and notes in Markdown."""
    lines = [table.columns, ["---", *["---:"] * (len(table.columns) - 1)], *table.rows]
    rows = "".join("| " + " | ".join(cell.replace("\n", "<br>") for cell in line) + " |\n" for line in lines)
    head = "".join(f"{line}\n\n" for line in table.head)
    return f"## {table.title}\n\n{head}{rows}" + "".join(f"\n{note}\n" for note in table.notes)


def records_csv(records: list[dict[str, Any]]) -> str:
    """Records with the same keys as CSV, empty where there is no number."""
    rows = [
        ["" if v is None else f"{v:.6f}" if isinstance(v, float) else v for v in each.values()]
        for each in records
    ]
    return csv_text([list(records[0]) if records else [], *rows])


@dataclass(frozen=True)
class Picture:
    """Bytes of a PNG, and its caption."""

    data: bytes
    caption: str

    @property
    def width(self) -> int:
        """Pixels, as the header of a PNG has them."""
        return int.from_bytes(self.data[16:20], "big")

    @property
    def address(self) -> str:
        """The whole picture as an address of a page."""
        return f"data:image/png;base64,{base64.b64encode(self.data).decode('ascii')}"


def provenance() -> list[str]:
    """Kit, its commit, Python, libraries and machine that made a report."""
    used, around = versions(), surroundings()
    libraries = f"numpy {used['numpy']}, OpenCV {used['opencv']}"
    kit = f"stereo-vo-kit {used['kit']}, commit {around['commit'] or 'unknown'}"
    return [f"{kit}, Python {around['python']}, {libraries}", str(around["system"])]


def render_report(
    results: Sequence[str],
    tables: list[ReportTable],
    folded: list[ReportTable],
    pictures: list[Picture],
    made: list[str],
    problems: Sequence[str] = (),
    films: Sequence[tuple[str, str]] = (),
) -> str:
    """The report as HTML, every text in it escaped: results, problems in a box, two pictures, then the rest.

    `films` : relative addresses and captions; films stay beside the page.
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
        made=[*made, *provenance(), date.today().isoformat()],
        films=films,
    )
