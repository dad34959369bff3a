"""Terminal output of the `vo` command and the data scripts: progress bars, tables, sentences."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from rich.console import Console, JustifyMethod
from rich.table import Table
from rich.text import Text

from ..report.page import ReportTable

if TYPE_CHECKING:
    from ..geometry.types import Progress

LOG_PERIOD_S = 60.0  # period of the progress lines without a terminal
SPEED_PERIOD_S = 180.0  # time over which a progress bar averages the speed


@contextmanager
def reporting(label: str, in_bytes: bool = False) -> Iterator[Progress]:
    """A progress function: in a terminal, a bar that is removed at the end; elsewhere, one line a minute."""
    console = Console(stderr=True)
    if not console.is_interactive:
        printed = time.monotonic()

        def log(done: int, total: int) -> None:
            nonlocal printed
            if time.monotonic() - printed >= LOG_PERIOD_S:
                printed = time.monotonic()
                console.print(f"{label}: {done} of {total}", soft_wrap=True, highlight=False, markup=False)

        yield log
        return
    from rich import progress as rich  # this import takes 0.1 s, which --help does not need

    count = (rich.DownloadColumn(), rich.TransferSpeedColumn()) if in_bytes else (rich.MofNCompleteColumn(),)
    label_column = rich.TextColumn("{task.description}", markup=False)
    columns = label_column, rich.BarColumn(), *count, rich.TimeRemainingColumn()
    with rich.Progress(
        *columns, console=console, transient=True, speed_estimate_period=SPEED_PERIOD_S
    ) as bar:
        task = bar.add_task(label, total=None)
        yield lambda done, total: bar.update(task, completed=done, total=total)


def say(*lines: str) -> None:
    """Print lines unchanged: without colours and markup, and without breaks inside a path."""
    Console().print("\n".join(lines), soft_wrap=True, highlight=False, markup=False)


def tell(*sentences: str) -> None:
    """Print sentences, each wrapped at the terminal's width."""
    for sentence in sentences:
        Console().print(sentence, highlight=False, markup=False)


def show_table(columns: list[str], rows: list[list[str]], numbers: bool = True) -> None:
    """Print a table; the first column has the names of the rows, and numbers are aligned to the right."""
    table = Table()
    for place, name in enumerate(columns):
        justify: JustifyMethod = "right" if numbers and place else "left"
        words = name.replace(".", "\n.")  # "selection.sets" is not broken within a word
        table.add_column(Text(words), justify=justify, overflow="fold")
    for row in rows:
        table.add_row(*map(Text, row))  # `Text` has no markup: a name may contain brackets
    Console().print(table)


def show_report_table(table: ReportTable) -> None:
    """Print a table of a report with its title, introduction and notes, after a blank line."""
    tell("", table.title, *table.head)
    show_table(table.columns, table.rows)
    tell(*table.notes)
