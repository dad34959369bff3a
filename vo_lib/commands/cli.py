"""The `vo` command."""

from __future__ import annotations

import argparse
import importlib
import os
import sys
from collections.abc import Sequence as Items
from importlib import metadata
from typing import Any

from .script import OneLineParser, guarded

# Of each command its module and its line in the help. A module is read when its command is asked for: what
# all of them need takes two seconds to import.
COMMANDS = {
    "demo": ("demo", "the main job with nothing downloaded: all methods on a street"),
    "run": ("run", "one run over one sequence"),
    "reproduce": ("reproduce", "Table 1 and Figure 4: methods over sequences and seeds"),
    "sweep": ("sweep", "a grid over settings on cached matches: table, CSV, heat map"),
    "compare": ("compare", "finished runs side by side: errors, trajectories, curves"),
    "evaluate": ("evaluate", "KITTI errors, ATE and RPE of trajectories"),
    "calibrate": ("calibrate", "learn what calib.txt leaves of a camera's errors from its drives"),
    "boxes": ("boxes", "which vehicle boxes move: a line for each, and pictures"),
    "list": ("environment", "sequences found and where"),
    "check": ("environment", "packages and data: what is there, what is missing"),
    "data": ("data", "fetch, check, draw, import and label data, train a detector; without a name: the list"),
    "lab": ("lab", "open the notebooks in JupyterLab"),
    "bench": ("bench", "how fast the method is on this machine"),
}


def main(arguments: Items[str] | None = None) -> int:
    """Entry point of `vo`; returns the exit code, as `script.guarded` gives it."""
    return guarded("vo", lambda: _start(arguments))


def _start(arguments: Items[str] | None) -> int:
    completing = "_ARGCOMPLETE" in os.environ  # the shell asks how a word may go on
    typed = os.environ.get("COMP_LINE", "").split()[1:] if completing else arguments
    parser = make_parser(sys.argv[1:] if typed is None else typed)
    if completing:
        import argcomplete

        argcomplete.autocomplete(parser, print_suppressed=True)
    options = parser.parse_args(arguments)
    return int(options.command(options))


def make_parser(words: Items[str]) -> argparse.ArgumentParser:
    """The parser of all commands, with the options of the one that the words name."""
    parser = OneLineParser(
        prog="vo",
        description="Stereo visual odometry without features on vehicles.",
        epilog='In bash and zsh, eval "$(register-python-argcomplete vo)" lets Tab complete commands, '
        "options, sequences and methods.",
    )
    parser.add_argument("--version", action="version", version=f"vo {metadata.version('stereo-vo-kit')}")
    commands = parser.add_subparsers(
        title="commands", required=True, metavar="COMMAND", parser_class=OneLineParser
    )
    wanted = next((word for word in words if not word.startswith("-")), "")
    for name, (module, text) in COMMANDS.items():
        command: Any = commands.add_parser(name, help=text)
        if name == wanted:
            importlib.import_module(f".{module}", __package__).add(command)
    return parser
