"""Option parsing, exit codes and printed commands of `vo` and the data scripts."""

from __future__ import annotations

import argparse
import itertools
import os
import shlex
import shutil
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NoReturn

from ..errors import DataError, did_you_mean

SETTINGS_PAGE = "--help-settings"  # the option that lists a command's settings
ENDINGS = (DataError, OSError, KeyboardInterrupt)  # exceptions that end a command without a traceback


class OneLineParser(argparse.ArgumentParser):
    """A parser that reports a wrong option in one line, with the nearest valid option, and exit code 2."""

    _words: Sequence[str] = ()

    def __init__(self, **parameters: Any):
        super().__init__(allow_abbrev=False, **parameters)  # an abbreviation may be a misspelt option

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Parse the arguments as the base class does; an unknown argument is an error."""
        self._words = sys.argv[1:] if args is None else list(args)
        options, unknown = super().parse_known_args(args, namespace)
        if unknown:
            self.error(f"unrecognized arguments: {' '.join(unknown)}")
        return options, unknown

    def error(self, message: str) -> NoReturn:
        """Print the message in one line, with the nearest option, and exit."""
        options, page, hint = self._option_string_actions, "--help", ""
        for word in itertools.takewhile("--".__ne__, self._words):
            name = word.partition("=")[0]
            if name.startswith("--") and name not in options:
                hint = f"; {did_you_mean(name, options) or self.get_default('others') or ''}".rstrip("; ")
                page = SETTINGS_PAGE if "." in name and SETTINGS_PAGE in options else page
                break
        text = " ".join(message.split())
        self.exit(2, f"{self.prog}: error: {text}{hint} (see {self.prog} {page})\n")


def exit_code(program: str, error: BaseException) -> int:
    """Print the message of an exception of `ENDINGS` to stderr, and return the exit code.

    Code 2: bad input, or an error of the system; 130: Ctrl-C; 1, without a message: a closed output pipe.
    """
    if isinstance(error, BrokenPipeError):
        # At its end, Python writes the rest of its buffer, here to the null device.
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
    """A command `vo …` for this shell, with the program's path if `vo` is not on the search path."""
    program = Path(sys.argv[0])
    if program.stem != "vo" or shutil.which("vo"):
        return command
    return shlex.quote(str(program)) + command.removeprefix("vo")


def steps(commands: Mapping[str, str]) -> str:
    """Commands for this shell, each followed by a line with its purpose."""
    return "".join(f"\n  {typed(command)}\n      {text}" for command, text in commands.items())


def install(extra: str = "") -> str:
    """The command that installs the kit's requirements, or an extra, from the kit's folder."""
    return f'pip install -e ".[{extra}]"' if extra else "pip install -r environment.txt"
