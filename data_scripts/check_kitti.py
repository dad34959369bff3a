"""Check a KITTI tree: what is missing, and what gets it.

The exit code is 0 where all is complete, 1 where something is missing or damaged, 2 for wrong input.

examples:
  vo data check_kitti
  vo data check_kitti --root /data/kitti --sequences 00-10 --deep
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from rich.console import Console
from rich.text import Text
from rich.tree import Tree

from fetch.kitti_check import SequenceReport, check_tree, parse_numbers
from vo_lib.commands.console import reporting, say
from vo_lib.commands.script import typed
from vo_lib.commands.scripts import run_script
from vo_lib.data.catalogue import kitti_root
from vo_lib.errors import DataError

PROBLEMS_SHOWN = 8  # of a sequence


def add_options(parser: argparse.ArgumentParser) -> None:
    """Options of the script."""
    parser.add_argument("--root", type=Path, metavar="DIR", help=f"the tree; default {kitti_root()}")
    parser.add_argument("--sequences", metavar="S,S-S,…", help="only these; default: all that are there")
    parser.add_argument("--deep", action="store_true", help="decode every image, on all cores")


def run(options: argparse.Namespace) -> int:
    """Look, show, and say what to do."""
    root: Path = options.root or kitti_root()
    get = typed(f"vo data get_kitti --root {root}")
    names = None if options.sequences is None else parse_numbers(options.sequences)
    if names is None and not root.is_dir():
        raise DataError(f"the folder is missing; {get} --sequences 07,04 makes it", root)
    with reporting("looking at the sequences") as report:
        reports = check_tree(root, names, options.deep, report)
    if not reports:
        raise DataError(f"no sequences in it; {get} --sequences 07,04 gets some", root / "sequences")
    show_sequences(root, reports)
    short = [report for report in reports if report.problems and report.expected is not None]
    ways = [report.part for report in short if report.part]
    if whole := [report.name for report in short if not report.part]:
        ways.append(f"--sequences {','.join(whole)}")
    for way in ways:
        say(f"What is missing comes with: {get} {way}")
    return 1 if any(found.problems for found in reports) else 0


def show_sequences(root: Path, reports: list[SequenceReport]) -> None:
    """A tree of sequences and their parts; what is wrong in red, at most a few lines a sequence."""
    tree = Tree(Text(str(root), style="bold"))
    for report in reports:
        of = "" if report.expected is None else f" of {report.expected}"
        state = "complete" if not report.problems else "incomplete"
        style = "green" if not report.problems else "red"
        branch = tree.add(Text(f"{report.name}: {report.pairs}{of} pairs, {state}", style=style))
        for part, found in report.parts:
            branch.add(Text(f"{part}: {found}"))
        for problem in report.problems[:PROBLEMS_SHOWN]:
            branch.add(Text(problem, style="red"))
        if (more := len(report.problems) - PROBLEMS_SHOWN) > 0:
            branch.add(Text(f"and {more} more", style="red"))
    Console().print(tree, soft_wrap=True)


if __name__ == "__main__":
    sys.exit(run_script(sys.modules[__name__]))
