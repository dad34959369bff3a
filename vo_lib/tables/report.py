"""Tables as data, Markdown or HTML; reports: one page with its pictures inside, to be opened from disk."""

from __future__ import annotations

import base64
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from ..core.types import Array
from ..evaluation.kitti import KittiErrors
from ..runs.identity import surroundings, versions

NONE = "–"  # where there is no number


@dataclass(frozen=True)
class ReportTable:
    """A table: the first column names the row, the others are values already formatted, a line break in some.

    `head` is said above the table, `notes` below it.
    """

    title: str
    columns: list[str]
    rows: list[list[str]]
    notes: list[str]
    head: list[str] = field(default_factory=list)


def number(value: float | None, digits: int = 3) -> str:
    """A number, or a dash where there is none."""
    return NONE if value is None or not math.isfinite(value) else f"{value:.{digits}f}"


def te_re(errors: KittiErrors) -> str:
    """TE in % and RE in deg/100 m."""
    return f"{number(errors.te)} / {number(errors.re)}"


def mean_and_spread(values: Array) -> tuple[float, float]:
    """Mean and standard deviation over seeds (S,); NaN where there is none."""
    return (float(values.mean()), float(values.std())) if len(values) else (math.nan, math.nan)


def spread(values: Array, digits: int = 3) -> str:
    """Mean ± standard deviation over seeds (S,); the number alone of one seed; a dash where there is none."""
    mean, deviation = (number(value, digits) for value in mean_and_spread(values))
    return mean if mean == NONE or len(values) == 1 else f"{mean} ± {deviation}"


def minus(text: str) -> str:
    """A formatted number with a minus sign in place of the hyphen."""
    return text.replace("-", "−")


def seeds_words(count: int) -> str:
    """What the numbers of a table are over."""
    return "one seed" if count == 1 else f"mean ± standard deviation over {count} seeds"


def markdown(table: ReportTable) -> str:
    """A table with its title and notes in Markdown."""
    lines = [table.columns, ["---", *["---:"] * (len(table.columns) - 1)], *table.rows]
    rows = "".join("| " + " | ".join(cell.replace("\n", "<br>") for cell in line) + " |\n" for line in lines)
    head = "".join(f"{line}\n\n" for line in table.head)
    return f"## {table.title}\n\n{head}{rows}" + "".join(f"\n{note}\n" for note in table.notes)


@dataclass(frozen=True)
class Picture:
    """Bytes of a PNG or JPEG, and what a person should see in it."""

    data: bytes
    caption: str

    @property
    def address(self) -> str:
        """The whole picture as an address of a page."""
        kind = "png" if self.data.startswith(b"\x89PNG") else "jpeg"
        return f"data:image/{kind};base64,{base64.b64encode(self.data).decode('ascii')}"


def provenance() -> list[str]:
    """What a figure was made with: kit, Python, libraries, machine."""
    used, around = versions(), surroundings()
    libraries = f"numpy {used['numpy']}, OpenCV {used['opencv']}"
    return [f"stereo-vo-kit {used['kit']}, Python {around['python']}, {libraries}", str(around["system"])]


def html_page(template: str, **content: Any) -> str:
    """A page of the folder `templates`; every text in it is escaped."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    loader = PackageLoader("vo_lib.tables")
    pages = Environment(loader=loader, autoescape=True, undefined=StrictUndefined, trim_blocks=True)
    return pages.get_template(template).render(**content)


def render_report(
    title: str,
    introduction: list[str],
    tables: list[ReportTable],
    pictures: list[Picture],
    made: list[str],
    problems: Sequence[str] = (),
) -> str:
    """The page as HTML text. `problems` are shown first, in a box."""
    return html_page(
        "report.html",
        title=title,
        introduction=introduction,
        problems=problems,
        tables=tables,
        pictures=pictures,
        made=made + provenance(),
    )
