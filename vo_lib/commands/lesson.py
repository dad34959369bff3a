"""`vo lesson`."""

from __future__ import annotations

import argparse
import json
from typing import Any

from ..course.lessons import BAD, BAD_STEP, Table, selection_table, to_dict, translation_table
from .common import parse_whole
from .console import reporting, say, show_table

SCENES_A_TABLE = 3
WHAT = {
    "selection": f"rotation error in degrees, mean ± standard deviation over seeds of the median frame "
    f"(share of frames above {BAD:g}°)",
    "translation": f"translation error in mm, mean ± standard deviation over seeds of the median frame "
    f"(share of frames above {BAD_STEP:g} mm)",
}


def add(commands: Any) -> None:
    """Declare `vo lesson`."""
    parser = commands.add_parser(
        "lesson",
        help="the tables of chapters 3 and 4, from simulated matches",
        epilog="example: vo lesson selection --seeds 5 --mode refined",
    )
    parser.add_argument("which", choices=tuple(WHAT), help="consensus against the prior, or the translations")
    parser.add_argument("--seeds", metavar="N", default="5", help="seeds 0 … N-1; default 5")
    parser.add_argument("--frames", metavar="N", default="40", help="frames of each scene; default 40")
    parser.add_argument(
        "--mode", choices=("literal", "refined"), default="literal", help="of the selections; default literal"
    )
    parser.add_argument("--json", action="store_true", help="print JSON")
    parser.set_defaults(command=_lesson)


def _lesson(options: argparse.Namespace) -> int:
    seeds, frames = parse_whole("--seeds", options.seeds), parse_whole("--frames", options.frames, 2)
    with reporting(options.which) as report:
        if options.which == "selection":
            table = selection_table(seeds, frames, options.mode, report)
        else:
            table = translation_table(seeds, frames, report)
    if options.json:
        print(json.dumps(to_dict(table), indent=2, allow_nan=False))
    else:
        _show(table, WHAT[options.which])
    return 0


def _show(table: Table, what: str) -> None:
    """Ways in rows, scenes in columns, a few to a table."""
    names = list(table)
    for first in range(0, len(names), SCENES_A_TABLE):
        part = names[first : first + SCENES_A_TABLE]
        rows = [
            [way, *(table[name][way].text.replace(" (", "\n(") for name in part)] for way in table[names[0]]
        ]
        show_table("", ["", *part], rows)
    say(what)
