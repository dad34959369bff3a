"""Check a KITTI odometry tree: what is complete, what is missing, and the command that gets it.

The exit code is 0 where all is complete, 1 where something is missing or damaged, 2 for wrong input.

examples:
  python check_kitti.py
  python check_kitti.py --root /data/kitti --sequences 00-10 --deep
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from vo_lib.commands.console import OneLineParser, reporting, say
from vo_lib.commands.script import guarded, show_sequences
from vo_lib.core.errors import DataError
from vo_lib.data.kitti_check import check_tree, parse_numbers
from vo_lib.data.places import kitti_root, script_command


def parser() -> argparse.ArgumentParser:
    """Options of the script."""
    made = OneLineParser(
        prog="check_kitti.py", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    made.add_argument("--root", type=Path, metavar="DIR", help=f"the tree; default {kitti_root()}")
    made.add_argument("--sequences", metavar="S,S-S,…", help="only these; default: all that are there")
    made.add_argument("--deep", action="store_true", help="decode every image, on all cores")
    made.add_argument("--json", action="store_true", help="print JSON")
    return made


def main(words: list[str] | None = None) -> int:
    """Run the script."""
    options = parser().parse_args(words)
    return guarded("check_kitti.py", lambda: check(options))


def check(options: argparse.Namespace) -> int:
    """Look, show, and say what to do."""
    root: Path = options.root or kitti_root()
    get = f"{script_command('get_kitti.py')} --root {root} --sequences"
    names = None if options.sequences is None else parse_numbers(options.sequences)
    if names is None and not root.is_dir():
        raise DataError(f"the folder is missing; {get} 07,04 makes it", root)
    with reporting("looking at the images") as report:
        reports = check_tree(root, names, options.deep, report)
    if not reports:
        raise DataError(f"no sequences in it; {get} 07,04 gets some", root / "sequences")
    if options.json:
        print(json.dumps([found.to_dict() for found in reports], indent=2))
    else:
        show_sequences(root, reports)
        fetchable = [r.name for r in reports if r.problems and r.expected is not None]
        if fetchable:
            say(f"What is missing comes with: {get} {','.join(fetchable)}")
    return 1 if any(found.problems for found in reports) else 0


if __name__ == "__main__":
    sys.exit(main())
