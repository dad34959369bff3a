"""What every command of `vo` and every data script shares: options, exit codes and terminal output.

In three parts: the parser, with its exit codes and the commands that messages name; options made from
declared settings; progress bars, tables and sentences in the terminal.
"""

from __future__ import annotations

import argparse
import os
import sys
import textwrap
import time
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, NoReturn, TextIO, TypeVar

from ..checkout import checkout_folder, kit_folder_text
from ..errors import DataError, did_you_mean
from ..report.breaking import GLUE, glued
from ..settings import Setting, as_typed, declared
from .table_layout import fitting_parts

# Rich is imported where something is printed: its import takes 0.1 s, which `vo --help` does not need.
if TYPE_CHECKING:
    from rich.console import Console, JustifyMethod

    from ..geometry.types import Progress
    from ..report.page import ReportTable

# Exceptions that end a command without a traceback.
ENDINGS = (DataError, OSError, MemoryError, KeyboardInterrupt)
LOG_PERIOD_S = 60.0  # period of the progress lines without a terminal
SPEED_PERIOD_S = 180.0  # time over which a progress bar averages the speed
USUAL_WIDTH = 80  # characters of a line where there is no terminal
INDENT = "  "  # of the second and further lines of a wrapped sentence

Config = TypeVar("Config")
OptionGroup = argparse._ActionsContainer  # a parser, or a group of its options


class OneLineParser(argparse.ArgumentParser):
    """A parser that reports a wrong option in one line, with the nearest valid option, and exit code 2."""

    def __init__(self, **parameters: Any):
        super().__init__(allow_abbrev=False, **parameters)  # an abbreviation may be a misspelt option

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Parse the arguments as the base class does; an unknown argument is an error."""
        options, unknown = super().parse_known_args(args, namespace)
        if unknown:
            near = did_you_mean(unknown[0].partition("=")[0], self._option_string_actions)
            hint = f"; {near.rstrip()}" if near else ""
            self.error(f"unrecognized arguments: {' '.join(unknown)}{hint}")
        return options, unknown

    def error(self, message: str) -> NoReturn:
        """Print the message in one line, and exit."""
        line = f"{self.prog}: error: {DataError(message)} (see {self.prog} --help)"
        self.exit(2, f"{as_shown(line, sys.stderr)}\n")


def exit_code(program: str, error: BaseException) -> int:
    """Print the message of an exception of `ENDINGS` to stderr, and return the exit code.

    Code 2: bad input, or an error of the system; 130: Ctrl-C; 1, without a message: a closed output pipe.
    """
    if isinstance(error, BrokenPipeError):
        # At its end, Python writes the rest of its buffer, here to the null device.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    if isinstance(error, KeyboardInterrupt):
        text = "; ".join(["interrupted", *error.args])
        print(as_shown(f"{program}: {text}", sys.stderr), file=sys.stderr)
        return 130
    if isinstance(error, OSError):
        error = DataError(str(error.strerror or error), error.filename)
    text = "out of memory" if isinstance(error, MemoryError) else str(error)
    print(as_shown(f"{program}: error: {text}", sys.stderr), file=sys.stderr)
    return 2


@contextmanager
def continues_when_repeated() -> Iterator[None]:
    """Work whose finished parts are kept: after Ctrl-C, the message says that a repetition continues."""
    try:
        yield
    except KeyboardInterrupt:
        raise KeyboardInterrupt("repeat the command to continue") from None


def steps(commands: Mapping[str, str]) -> str:
    """Commands, each followed by a line with its purpose."""
    return "".join(f"\n  {command}\n      {text}" for command, text in commands.items())


def install(extra: str = "") -> str:
    """The command that installs the kit's requirements, or an extra, from the kit's folder."""
    command = f'pip install -e ".[{extra}]"' if extra else "pip install -r environment.txt"
    return command if checkout_folder() else f"{command} in {kit_folder_text()}"


def add_option(
    group: OptionGroup, item: Setting, name: str, default: bool = True, shown: bool = True
) -> None:
    """Add the option `--name` for a setting.

    default : whether its help text has the default, beside meaning and range.
    shown : whether the help has the option at all.
    """
    text = f"{item.text.removesuffix('.')}; {item.describe()}"
    if default:
        text += f"; default {as_typed(item.default)}"
    text = text.replace("%", "%%") if shown else argparse.SUPPRESS
    group.add_argument(f"--{name}", metavar="X", dest=item.name, help=text)


def option_values(options: argparse.Namespace, items: Iterable[Setting]) -> dict[str, Any]:
    """Values, by name, of the settings given as options; an invalid value raises `DataError`."""
    values: dict[str, Any] = {}
    for item in items:
        text = getattr(options, item.name)
        if text is not None:
            values[item.name] = item.parse(text)
    return values


def add_settings(group: OptionGroup, cls: type, defaults: bool = True) -> None:
    """Add an option for every setting of a class: `--min-height` for min_height."""
    for item in declared(cls):
        add_option(group, item, item.name.replace("_", "-"), defaults)


def from_options(options: argparse.Namespace, cls: type[Config], prefix: str = "") -> Config:
    """Settings of a class, with the values given as options; an invalid value raises `DataError`.

    prefix : beginning of the option names, such as "detector.".
    """
    values = option_values(options, declared(cls, prefix))
    return cls(**{name.removeprefix(prefix): value for name, value in values.items()})


def _console(stderr: bool = False, width: int | None = None) -> Console:
    """A console of Rich; `width` : characters of a line, by default those of the terminal."""
    from rich.console import Console

    return Console(stderr=stderr, width=width)


@contextmanager
def reporting(label: str, in_bytes: bool = False) -> Iterator[Progress]:
    """A progress function: in a terminal, a bar that is removed at the end; elsewhere, one line a minute.

    in_bytes : whether the steps are bytes, so that the bar shows them in MB with their speed.
    """
    console = _console(stderr=True)
    if not console.is_interactive:
        last_line_at = time.monotonic()

        def log(done: int, total: int) -> None:
            nonlocal last_line_at
            if time.monotonic() - last_line_at >= LOG_PERIOD_S:
                last_line_at = time.monotonic()
                console.print(f"{label}: {done} of {total}", soft_wrap=True, highlight=False, markup=False)

        yield log
        return
    from rich import progress as rich

    columns: list[rich.ProgressColumn] = [
        rich.TextColumn("{task.description}", markup=False),
        rich.BarColumn(),
    ]
    if in_bytes:
        columns += [rich.DownloadColumn(), rich.TransferSpeedColumn()]
    else:
        columns.append(rich.MofNCompleteColumn())
    columns.append(rich.TimeRemainingColumn())
    with rich.Progress(
        *columns, console=console, transient=True, speed_estimate_period=SPEED_PERIOD_S
    ) as bar:
        task = bar.add_task(label, total=None)
        yield lambda done, total: bar.update(task, completed=done, total=total)


def print_lines(*lines: str) -> None:
    """Print lines unchanged, for what is copied: a path or a command is not broken."""
    print("\n".join(lines))


def print_wrapped(*sentences: str) -> None:
    """Print sentences as `as_shown` breaks them."""
    for sentence in sentences:
        print(as_shown(sentence, sys.stdout))


def print_warnings(sentences: Iterable[str]) -> None:
    """Print warnings among the results of a command."""
    print_wrapped(*(f"warning: {sentence}" for sentence in sentences))


def print_notes(sentences: Iterable[str]) -> None:
    """Print notes: what a person may not expect, but need not mend."""
    print_wrapped(*(f"note: {sentence}" for sentence in sentences))


def print_above_bar(sentence: str) -> None:
    """Print a sentence while a progress bar may be shown: above the bar, not behind it."""
    print_wrapped(sentence)  # Rich replaces sys.stdout while it shows a bar


def warn(sentence: str) -> None:
    """Print a warning to stderr, where it does not disturb an output for programs."""
    print(as_shown(f"warning: {sentence}", sys.stderr), file=sys.stderr)


def as_shown(sentence: str, stream: TextIO) -> str:
    """A sentence as it is printed: wrapped in a terminal, one line in a file or a pipe, where grep finds it.

    It is wrapped at blanks, but not between a number and its unit, nor in a short command (`glued`), and has
    an indent from the second line on. A longer word, such as a path, is not broken.
    """
    if not stream.isatty():
        return sentence
    width = terminal_width(stream)
    lines = []
    for line in glued(sentence).split("\n"):
        own_indent = line[: len(line) - len(line.lstrip(" "))]
        wrapped = textwrap.wrap(
            line,
            width,
            subsequent_indent=own_indent + INDENT,
            break_long_words=False,
            break_on_hyphens=False,
        )
        lines += wrapped or [""]  # an empty line stays one
    return "\n".join(lines).replace(GLUE, " ")


def terminal_width(stream: TextIO) -> int:
    """The width of the terminal that shows a stream, in characters; `USUAL_WIDTH` elsewhere.

    The environment variable COLUMNS goes before, as with other programs.
    """
    columns = os.environ.get("COLUMNS", "")
    if columns.isdecimal() and int(columns):
        return int(columns)
    try:
        return os.get_terminal_size(stream.fileno()).columns or USUAL_WIDTH
    except (OSError, ValueError):  # no terminal, or no file at all
        return USUAL_WIDTH


def show_table(
    columns: list[str], rows: list[list[str]], numbers: bool = True, name_columns: int = 1
) -> None:
    """Print a table, or several if it is too wide (`table_layout`); numbers are aligned to the right.

    name_columns : number of columns, from the first one, that name the rows.
    """
    from rich.cells import cell_len
    from rich.table import Table
    from rich.text import Text

    width = terminal_width(sys.stdout)
    for part in fitting_parts(columns, rows, width, cell_len, name_columns, numbers):
        # If a name has several lines, there are lines between the rows: they show where a row begins.
        several_lines = any("\n" in name for row in part.rows for name in row[: part.name_columns])
        table = Table(show_lines=several_lines)
        for place, name in enumerate(part.columns):
            justify: JustifyMethod = "right" if numbers and place >= part.name_columns else "left"
            table.add_column(Text(name), justify=justify, no_wrap=True)
        for row in part.rows:
            table.add_row(*map(Text, row))  # `Text` has no markup: a name may contain brackets
        # The layout has broken the lines: Rich must not break them again.
        _console(width=max(width, part.width(cell_len))).print(table, soft_wrap=True)


def show_report_table(table: ReportTable) -> None:
    """Print a table of a report with its title, introduction and notes, after a blank line."""
    print_wrapped("", table.title, *table.head)
    show_table(table.columns, table.rows, name_columns=table.name_columns)
    print_wrapped(*table.notes)
