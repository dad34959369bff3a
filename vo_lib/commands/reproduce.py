"""`vo reproduce`."""

from __future__ import annotations

import argparse
from typing import Any

from ..config import METHODS
from ..console import reporting, say, show_report_table
from ..files import write_text_atomic
from ..report import ReportTable
from ..reproduce import COLUMNS, compare_methods, markdown, parse_sequences, table_rows
from ..results import run_folder
from ..sequence import SYNTHETIC
from ..synthetic import SCENES
from .common import add_cache, open_with_bar, parse_methods, parse_whole


def add(commands: Any) -> None:
    """Declare `vo reproduce`."""
    parser = commands.add_parser(
        "reproduce",
        help="methods over sequences and seeds, as a table",
        epilog="example: vo reproduce --sequences 00,02-10 --methods mesvo_f,feature_selection",
    )
    parser.add_argument(
        "--sequences",
        metavar="S,S,…",
        default=",".join(f"{SYNTHETIC}{name}" for name in SCENES),
        help="KITTI numbers and ranges, names from `vo list`, paths; default: the synthetic scenes",
    )
    parser.add_argument("--methods", metavar="M,M,…", default=",".join(METHODS), help="default: all")
    parser.add_argument("--seeds", metavar="N", default="5", help="seeds 0 … N-1; default 5")
    parser.add_argument("--out", default="runs/table", metavar="DIR", help="folder for table.md")
    add_cache(parser)
    parser.set_defaults(command=_reproduce)


def _reproduce(options: argparse.Namespace) -> int:
    names = parse_sequences(options.sequences)
    methods = parse_methods(options.methods)
    seeds = parse_whole("--seeds", options.seeds)
    everything: list[list[str]] = []
    with run_folder(options.out) as folder:
        for name in names:
            sequence = open_with_bar(name, options.cache)
            with reporting(sequence.name) as report:
                errors, lengths = compare_methods(sequence, methods, seeds, report)
            rows = table_rows(errors)
            everything += [[sequence.name, lengths, *row] for row in rows]
            title = f"{sequence.name}, {lengths}; mean ± standard deviation over {seeds} seeds"
            show_report_table(ReportTable(title, COLUMNS, rows, []))
        write_text_atomic(folder / "table.md", markdown(["sequence", "lengths", *COLUMNS], everything))
    say(f"written to {folder / 'table.md'}")
    return 0
