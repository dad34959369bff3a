"""The `vo` command."""

from __future__ import annotations

import argparse
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
    lesson,
    reproduce,
    run,
    sweep,
)
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
    lesson,
)


def main(arguments: Items[str] | None = None) -> int:
    """Entry point of `vo`; returns the exit code, as `script.guarded` gives it."""
    return guarded("vo", lambda: _start(arguments))


def _start(arguments: Items[str] | None) -> int:
    options = _parser().parse_args(arguments)
    return int(options.command(options))


def _parser() -> argparse.ArgumentParser:
    parser = OneLineParser(prog="vo", description="Stereo visual odometry without features on vehicles.")
    commands = parser.add_subparsers(
        title="commands", required=True, metavar="COMMAND", parser_class=OneLineParser
    )
    for module in COMMANDS:
        module.add(commands)
    return parser
