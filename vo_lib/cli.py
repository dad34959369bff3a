"""The `vo` command."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence as Items

from .commands import bench, boxes, compare, demo, evaluate, inspect, lab, lesson, reproduce, run, sweep
from .console import OneLineParser
from .errors import DataError

COMMANDS = (demo, run, reproduce, sweep, compare, evaluate, boxes, inspect, lab, bench, lesson)


def main(arguments: Items[str] | None = None) -> int:
    """Entry point of `vo`; returns the exit code: 0, or 2 for bad input, or 130 when interrupted."""
    options = _parser().parse_args(arguments)
    try:
        return int(options.command(options))
    except DataError as error:
        print(f"vo: error: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("vo: interrupted", file=sys.stderr)
        return 130


def _parser() -> argparse.ArgumentParser:
    parser = OneLineParser(prog="vo", description="Stereo visual odometry without features on vehicles.")
    commands = parser.add_subparsers(
        title="commands", required=True, metavar="COMMAND", parser_class=OneLineParser
    )
    for module in COMMANDS:
        module.add(commands)
    return parser
