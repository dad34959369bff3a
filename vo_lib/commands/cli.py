"""The `vo` command."""

from __future__ import annotations

import argparse
import os
from collections.abc import Sequence as Items

from . import (
    bench,
    boxes,
    calibrate,
    compare,
    data,
    demo,
    environment,
    evaluate,
    lab,
    reproduce,
    run,
    sweep,
)
from .environment import version
from .script import OneLineParser, guarded

COMMANDS = (
    demo,
    run,
    reproduce,
    sweep,
    compare,
    evaluate,
    calibrate,
    boxes,
    environment,
    data,
    lab,
    bench,
)


def main(arguments: Items[str] | None = None) -> int:
    """Entry point of `vo`; returns the exit code, as `script.guarded` gives it."""
    return guarded("vo", lambda: _start(arguments))


def _start(arguments: Items[str] | None) -> int:
    parser = make_parser()
    if "_ARGCOMPLETE" in os.environ:  # the shell asks how a word may go on
        import argcomplete

        argcomplete.autocomplete(parser, print_suppressed=True)
    options = parser.parse_args(arguments)
    return int(options.command(options))


def make_parser() -> argparse.ArgumentParser:
    """The parser of all commands and their options."""
    parser = OneLineParser(
        prog="vo",
        description="Stereo visual odometry without features on vehicles.",
        epilog='In bash and zsh, eval "$(register-python-argcomplete vo)" lets Tab complete commands, '
        "options, sequences and methods.",
    )
    parser.add_argument("--version", action="version", version=f"vo {version()}")
    commands = parser.add_subparsers(
        title="commands", required=True, metavar="COMMAND", parser_class=OneLineParser
    )
    for module in COMMANDS:
        module.add(commands)
    return parser
