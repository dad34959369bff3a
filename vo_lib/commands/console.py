"""Output of the `vo` command and the data scripts in a terminal: progress bars, tables, sentences."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from rich.console import Console, JustifyMethod
from rich.table import Table
from rich.text import Text

from ..report.page import ReportTable

if TYPE_CHECKING:
    from ..geometry.types import Progress

SPEED_PERIOD_S = 180.0  # a bar's speed is a mean over this time


@contextmanager
def reporting(label: str, in_bytes: bool = False) -> Iterator[Progress]:
    """A progress function with a bar in a terminal, which disappears at the end."""
    console = Console(stderr=True)
    if not console.is_interactive:
        yield lambda done, total: None
        return
    from rich import progress as rich  # a tenth of a second, which --help need not wait for

    count = (rich.DownloadColumn(), rich.TransferSpeedColumn()) if in_bytes else (rich.MofNCompleteColumn(),)
    label_column = rich.TextColumn("{task.description}", markup=False)
    columns = label_column, rich.BarColumn(), *count, rich.TimeRemainingColumn()
    with rich.Progress(
        *columns, console=console, transient=True, speed_estimate_period=SPEED_PERIOD_S
    ) as bar:
        task = bar.add_task(label, total=None)
        yield lambda done, total: bar.update(task, completed=done, total=total)


def say(*lines: str) -> None:
    """Print lines as they are: no colours, no markup, no wrapping in the middle of a path."""
    Console().print("\n".join(lines), soft_wrap=True, highlight=False, markup=False)


def tell(*sentences: str) -> None:
    """Print sentences, each wrapped between words at the terminal's width."""
    for sentence in sentences:
        Console().print(sentence, highlight=False, markup=False)


def show_table(title: str, columns: list[str], rows: list[list[str]], numbers: bool = True) -> None:
    """A table: the first column names the row; numbers stand to the right."""
    if title:
        say(title)  # above the table, not within: a narrow one would break it
    table = Table()
    for place, name in enumerate(columns):
        justify: JustifyMethod = "right" if numbers and place else "left"
        table.add_column(Text(name), justify=justify, overflow="fold")
    for row in rows:
        table.add_row(*map(Text, row))  # no markup: a name may have brackets
    Console().print(table)


def show_report_table(table: ReportTable) -> None:
    """A report's table, below a blank line, with the sentences above and below it."""
    tell("", table.title, *table.head)
    show_table("", table.columns, table.rows)
    tell(*table.notes)
