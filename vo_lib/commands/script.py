"""How `vo` and the data scripts take their options and end, and how they print commands."""

from __future__ import annotations

import argparse
import os
import shlex
import shutil
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import NoReturn

from ..errors import DataError

ENDINGS = (DataError, OSError, KeyboardInterrupt)  # exceptions that end a command without a traceback


class OneLineParser(argparse.ArgumentParser):
    """Wrong options get one line and exit code 2; the list of all options only on --help."""

    def error(self, message: str) -> NoReturn:
        self.exit(2, f"{self.prog}: error: {' '.join(message.split())} (see {self.prog} --help)\n")


def exit_code(program: str, error: BaseException) -> int:
    """The exit code of a program that one of `ENDINGS` ended; all but the last are said in one line.

    2 for bad input and for what the system refuses, 130 after Ctrl-C, 1 where nobody reads the output.
    """
    if isinstance(error, BrokenPipeError):
        # Python writes the rest of its buffer when it ends: to nowhere.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    if isinstance(error, KeyboardInterrupt):
        print(f"{program}: interrupted", file=sys.stderr)
        return 130
    text = str(error)
    if isinstance(error, OSError):
        text = ": ".join(str(part) for part in (error.filename, error.strerror or error) if part is not None)
    print(f"{program}: error: {text}", file=sys.stderr)
    return 2


def typed(command: str) -> str:
    """A command `vo …` for this shell: with the program's path where the shell would not find `vo`."""
    program = Path(sys.argv[0])
    if program.stem != "vo" or shutil.which("vo"):
        return command
    return shlex.quote(str(program)) + command.removeprefix("vo")


def steps(commands: Mapping[str, str]) -> str:
    """Commands for this shell, each above its purpose."""
    return "".join(f"\n  {typed(command)}\n      {text}" for command, text in commands.items())


def install(extra: str = "") -> str:
    """The command that installs the kit's requirements, or an extra too, in the kit's folder."""
    return f'pip install -e ".[{extra}]"' if extra else "pip install -r environment.txt"
