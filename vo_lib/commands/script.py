"""What `vo` and the data scripts share: one way to end, to ask, to show bytes coming in."""

from __future__ import annotations

import io
import os
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import current_thread, main_thread

from rich.console import Console
from rich.progress import BarColumn, DownloadColumn, Progress, TextColumn, TimeRemainingColumn
from rich.progress import TransferSpeedColumn as SpeedColumn
from rich.text import Text
from rich.tree import Tree

from ..core.errors import DataError
from ..core.types import Progress as Report
from ..data.kitti_check import SequenceReport

PROBLEMS_SHOWN = 8


class Ended(KeyboardInterrupt):
    """SIGTERM: another program asks this one to end. It stops as for Ctrl-C, with all its processes."""


def guarded(program: str, work: Callable[[], int]) -> int:
    """The exit code of `work`; 2 and one line for bad input and for what the system refuses.

    130 when interrupted, 143 when ended by SIGTERM, 1 when nobody reads the output any more.
    """
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="replace")  # a terminal that cannot show a letter shows "?"
    try:
        with _on_sigterm(_end):
            code = work()
            sys.stdout.flush()
            return code
    except DataError as error:
        print(f"{program}: error: {error}", file=sys.stderr)
        return 2
    except Ended:
        print(f"{program}: ended", file=sys.stderr)
        return 143
    except KeyboardInterrupt:
        print(f"{program}: interrupted", file=sys.stderr)
        return 130
    except BrokenPipeError:
        # Python writes out what is left when it ends: to nowhere.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except OSError as error:
        place = "" if error.filename is None else f"{error.filename}: "
        print(f"{program}: error: {place}{error.strerror or error}", file=sys.stderr)
        return 2


@contextmanager
def _on_sigterm(handler: Callable[..., None]) -> Iterator[None]:
    """A context with a handler of SIGTERM; only the main thread may say so, others change nothing."""
    if current_thread() is not main_thread():
        yield
        return
    before = signal.signal(signal.SIGTERM, handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def _end(*details: object) -> None:
    raise Ended


@contextmanager
def unbroken() -> Iterator[None]:
    """A context that SIGTERM does not leave half done: `Ended` is raised at its end."""
    came: list[object] = []
    with _on_sigterm(lambda *details: came.append(details)):
        yield
    if came:
        raise Ended


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
