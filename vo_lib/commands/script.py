"""How `vo` and the data scripts take their options and end."""

from __future__ import annotations

import argparse
import importlib.metadata as metadata
import io
import os
import re
import shlex
import shutil
import signal
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from threading import current_thread, main_thread
from typing import Any, NoReturn

from ..core.errors import DataError


class OneLineParser(argparse.ArgumentParser):
    """Wrong options get one line and exit code 2; the list of all options only on --help."""

    def parse_args(self, args: Any = None, namespace: Any = None) -> Any:
        """As `argparse` does it; a NUL character, which no option and no file can hold, is refused."""
        if any("\0" in word for word in (sys.argv[1:] if args is None else args)):
            self.error("an option holds a NUL character")
        return super().parse_args(args, namespace)

    def error(self, message: str) -> NoReturn:
        self.exit(2, f"{self.prog}: error: {brief(message)} (see {self.prog} --help)\n")


def brief(message: str) -> str:
    """A message without the rest of what is longer than any name of a file: nobody reads 5000 digits."""
    return re.sub(r"[^\s/]{256,}", lambda found: f"{found[0][:40]}…", message)


def typed(command: str) -> str:
    """A command `vo …` as this shell takes it: with the program's path where it would not find `vo`."""
    program = Path(sys.argv[0])
    if program.stem != "vo" or shutil.which("vo"):
        return command
    return shlex.quote(str(program)) + command.removeprefix("vo")


def steps(commands: Mapping[str, str]) -> str:
    """Commands as this shell takes them, each above what it does."""
    return "".join(f"\n  {typed(command)}\n      {text}" for command, text in commands.items())


def installed_version(name: str) -> str | None:
    """Version of an installed package, or None."""
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return None


def version() -> str:
    """The kit's version."""
    return installed_version("stereo-vo-kit") or "of a folder that is not installed"


def install(extra: str = "") -> str:
    """The command that installs what the kit needs, or an extra too, in the kit's folder."""
    return f'pip install -e ".[{extra}]"' if extra else "pip install -r environment.txt"


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
            try:
                return work()
            finally:
                sys.stdout.flush()  # here it is said whether somebody still reads
    except DataError as error:
        print(f"{program}: error: {brief(str(error))}", file=sys.stderr)
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
