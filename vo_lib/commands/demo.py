"""`vo demo`."""

from __future__ import annotations

import argparse
from typing import Any

from ..runs.results import run_folder
from ..tables.demo import SCENE, run_demo
from .common import BOTH, add_cache, add_variant, chosen_variants, open_with_bar
from .console import reporting, say, show_report_table
from .script import typed

NEXT = {
    "vo list": "the other scenes and any KITTI sequences found",
    "vo run synthetic/jam --out runs/jam": "one method on another scene",
    "vo run PATH --out runs/mine": "a KITTI-layout folder of your own",
    "vo check": "what is missing for KITTI, and how to get it",
}


def add(commands: Any) -> None:
    """Declare `vo demo`."""
    parser = commands.add_parser("demo", help="the main job with nothing downloaded: all methods on a street")
    parser.add_argument("--out", default="runs/demo", metavar="DIR", help="folder for the report")
    add_variant(parser, BOTH)
    add_cache(parser)
    parser.set_defaults(command=_demo)


def _demo(options: argparse.Namespace) -> int:
    with run_folder(options.out) as folder:
        sequence = open_with_bar(SCENE, options.cache)
        with reporting("all methods") as report:
            tables = run_demo(sequence, folder, chosen_variants(options.variant), report)
    for table in tables:
        show_report_table(table)
    commands = {typed(command): text for command, text in NEXT.items()}
    width = max(map(len, commands)) + 4
    say(
        f"Look at {folder / 'report.html'} in a browser. What next:",
        *(f"  {command:<{width}}{text}" for command, text in commands.items()),
    )
    return 0
