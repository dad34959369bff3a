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
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import NoReturn

from ..core.errors import DataError


class OneLineParser(argparse.ArgumentParser):
    """Wrong options get one line and exit code 2; the list of all options only on --help."""

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


def install(extra: str = "") -> str:
    """The command that installs what the kit needs, or an extra too, in the kit's folder."""
    return f'pip install -e ".[{extra}]"' if extra else "pip install -r environment.txt"


def guarded(program: str, work: Callable[[], int]) -> int:
    """The exit code of `work`; 2 and one line for bad input and for what the system refuses.

    130 when interrupted or told to end by SIGTERM, 1 when nobody reads the output any more.
    """
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="replace")  # a terminal that cannot show a letter shows "?"
    with suppress(ValueError):  # not the main thread, which alone hears signals
        signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        try:
            return work()
        finally:
            sys.stdout.flush()  # here it is said whether somebody still reads
    except DataError as error:
        print(f"{program}: error: {brief(str(error))}", file=sys.stderr)
        return 2
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
