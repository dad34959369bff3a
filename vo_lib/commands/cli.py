"""The `vo` command."""

from __future__ import annotations

import argparse
import importlib
import io
import shlex
import sys
import warnings
from collections.abc import Sequence as Items
from importlib import metadata
from typing import Any

from ..errors import DataError
from .script import ENDINGS, OneLineParser, exit_code

# Of each command its module and its line in the help. A module is imported when its command is asked for: the
# libraries behind them take two seconds.
COMMANDS = {
    "demo": ("demo", "all methods on a drawn street; nothing is downloaded"),
    "run": ("run", "one run over one sequence"),
    "reproduce": ("reproduce", "Table 1 and Figure 4: methods over sequences and seeds"),
    "sweep": ("sweep", "a grid over settings on cached matches: table, CSV, heat map"),
    "evaluate": ("evaluate", "KITTI errors, ATE and RPE of runs and trajectories"),
    "list": ("sequences", "sequences: frames, length, truth, boxes, size"),
    "check": ("environment", "packages, data and caches; the remedy for each problem"),
    "data": ("scripts", "fetch, check, draw, import, label data; train a detector; no name: the list"),
    "lab": ("lab", "open the notebooks in JupyterLab"),
}
# Commands and options of earlier versions, with their successors.
GONE = {
    "compare": "vo evaluate RUN RUN",
    "calibrate": "vo run B --variant kit --calibration A/calibration.json, where A is the folder of a run",
    "boxes": "vo run SEQUENCE --variant kit --method moving_selection --video FILE",
    "bench": "vo data measure_speed",
    "lab --html": "python -m course.pages DIR, in the folder notebooks",
    "reproduce --paper": "vo_lib/report/paper_table1.csv, the file to correct",
    "run --view": "python -m course.view3d, in the folder notebooks",
    "evaluate --estimate": "vo evaluate FILE … --truth FILE",
    "evaluate --format": "vo evaluate FILE …, which detects the format",
    "evaluate --plot": "vo evaluate RUN_OR_FILE … --out DIR",
    "evaluate --axes": "vo data measure_axes",
}


def main(words: Items[str] | None = None) -> int:
    """Run the command that the words name, by default the program's; returns the exit code.

    Bad input ends with one line and code 2, see `script.exit_code`. Warnings of libraries are printed at the
    end of a command that succeeds.
    """
    words = (sys.argv[1:] if words is None else words) or ["--help"]
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="replace")  # a terminal that lacks a letter shows "?"
    with warnings.catch_warnings(record=True) as raised:
        try:
            refuse_gone(words)
            options = make_parser(words).parse_args(
                words, argparse.Namespace(line=shlex.join(["vo", *words]))
            )
            code = int(options.command(options))
            print(end="", flush=True)  # fails here if nobody reads the output
        except ENDINGS as error:
            return exit_code("vo", error)
    for warning in raised:
        print(f"vo: warning: {warning.message} ({warning.filename}:{warning.lineno})", file=sys.stderr)
    return code


def refuse_gone(words: Items[str]) -> None:
    """`DataError` naming the successor of a command or an option that is gone."""
    given = {word.partition("=")[0] for word in words}
    for name, successor in GONE.items():
        command, *option = name.split()
        if words[:1] == [command] and given.issuperset(option):
            raise DataError(f"`vo {name}` is gone; its successor: {successor}")


def make_parser(words: Items[str]) -> argparse.ArgumentParser:
    """The parser of all commands, with the options of the command that the words name."""
    parser = OneLineParser(prog="vo", description="Stereo visual odometry without features on vehicles.")
    parser.add_argument("--version", action="version", version=f"vo {metadata.version('stereo-vo-kit')}")
    commands = parser.add_subparsers(title="commands", required=True, metavar="COMMAND")
    for name, (module, text) in COMMANDS.items():
        command: Any = commands.add_parser(name, help=text)
        if name == next((word for word in words if not word.startswith("-")), ""):
            importlib.import_module(f".{module}", __package__).add(command)
    return parser
