"""The `vo` command: list of the commands, and call of a command."""

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

from ..errors import DataError, did_you_mean
from .console import ENDINGS, OneLineParser, as_shown, exit_code

# Module and help line of each command. Only the module of the command in use is imported: all imports
# together take two seconds.
COMMANDS = {
    "demo": ("demo", "the paper's claim on a drawn traffic jam; nothing is downloaded"),
    "run": ("run", "one method on one sequence"),
    "reproduce": ("reproduce", "Table 1 and Figure 4: methods over sequences and seeds"),
    "sweep": ("sweep", "a grid of settings, computed on cached matches: table, CSV, heat map"),
    "evaluate": (
        "evaluate",
        "KITTI errors, ATE and RPE of runs and trajectory files; without truth, how they differ",
    ),
    "list": ("list_sequences", "available sequences: frames, length, truth, boxes, size"),
    "check": ("check_installation", "state of packages, data and caches, with a remedy for each problem"),
    "data": (
        "data_scripts",
        "scripts that download, check, draw, import or label data, train a detector, or measure",
    ),
    "lab": ("lab", "open the notebooks in JupyterLab"),
}


def main(words: Items[str] | None = None) -> int:
    """Run the command in `words`, by default the program's arguments, and return the exit code.

    Bad input ends with one line and code 2 (`console.exit_code`). Warnings of libraries are printed at the
    end of a successful command.
    """
    words = sys.argv[1:] if words is None else words
    if not words:
        words = ["--help"]
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="replace")  # "?" for letters that the terminal lacks
    with warnings.catch_warnings(record=True) as raised:
        try:
            if words[0] not in COMMANDS and not words[0].startswith("-"):
                near = did_you_mean(words[0], COMMANDS)
                raise DataError(f"unknown command {words[0]!r}; {near}`vo --help` lists the commands")
            # A report names the command line.
            namespace = argparse.Namespace(line=shlex.join(["vo", *words]))
            options = make_parser(words).parse_args(words, namespace)
            code = int(options.command(options))
            print(end="", flush=True)  # a closed output pipe raises its error here
        except ENDINGS as error:
            return exit_code("vo", error)
    for warning in raised:
        line = f"vo: warning: {warning.message} ({warning.filename}:{warning.lineno})"
        print(as_shown(line, sys.stderr), file=sys.stderr)
    return code


def make_parser(words: Items[str]) -> argparse.ArgumentParser:
    """The parser of all commands, with the options of the command in `words`."""
    parser = OneLineParser(prog="vo", description="Stereo visual odometry that ignores features on vehicles.")
    parser.add_argument("--version", action="version", version=f"vo {metadata.version('stereo-vo-kit')}")
    commands = parser.add_subparsers(title="commands", required=True, metavar="COMMAND")
    for name, (module_name, text) in COMMANDS.items():
        # A module that says more replaces the description.
        command: Any = commands.add_parser(name, help=text, description=f"{text[0].upper()}{text[1:]}.")
        if name == words[0]:
            module = importlib.import_module(f".{module_name}", __package__)
            module.add(command)
    return parser
