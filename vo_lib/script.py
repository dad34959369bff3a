"""What the data scripts share: one way to end, to ask, to show bytes coming in."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, DownloadColumn, Progress, TextColumn, TimeRemainingColumn
from rich.progress import TransferSpeedColumn as SpeedColumn
from rich.text import Text
from rich.tree import Tree

from .errors import DataError
from .kitti_check import SequenceReport
from .sequence import Progress as Report

PROBLEMS_SHOWN = 8


def guarded(program: str, work: Callable[[], int]) -> int:
    """The exit code of `work`; 2 and one line for bad input, 130 when interrupted, as `vo` has it."""
    try:
        return work()
    except DataError as error:
        print(f"{program}: error: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print(f"{program}: interrupted", file=sys.stderr)
        return 130


def confirm(question: str, yes: bool) -> bool:
    """Whether a person agrees; `yes` answers for them.

    Raises `DataError` where nobody can be asked.
    """
    if yes:
        return True
    if not sys.stdin.isatty():
        raise DataError("nobody is there to answer: say --yes to start without a question")
    try:
        answer = input(f"{question} [y/N] ")
    except EOFError:
        return False
    return answer.strip().lower() in ("y", "yes")


@contextmanager
def transferring(label: str) -> Iterator[Report]:
    """A progress function for bytes: how many of how many, speed, time left; on standard error."""
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        DownloadColumn(),
        SpeedColumn(),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=Console(stderr=True)) as bar:
        task = bar.add_task(label, total=None)
        yield lambda done, total: bar.update(task, completed=done, total=total)


def show_sequences(root: Path, reports: list[SequenceReport]) -> None:
    """A tree of sequences and their parts; what is wrong in red, at most a few lines a sequence."""
    tree = Tree(Text(str(root), style="bold"))
    for report in reports:
        of = "" if report.expected is None else f" of {report.expected}"
        state = "complete" if not report.problems else "incomplete"
        style = "green" if not report.problems else "red"
        branch = tree.add(Text(f"{report.name}: {report.pairs}{of} pairs, {state}", style=style))
        for part, found in report.parts:
            branch.add(Text(f"{part}: {found}"))
        for problem in report.problems[:PROBLEMS_SHOWN]:
            branch.add(Text(problem, style="red"))
        if len(report.problems) > PROBLEMS_SHOWN:
            branch.add(
                Text(f"and {len(report.problems) - PROBLEMS_SHOWN} more (--json has all)", style="red")
            )
    Console().print(tree, soft_wrap=True)
