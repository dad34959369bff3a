"""Check a KITTI folder: list missing and damaged files, and the commands that
fetch them.

The exit code is 0 for a complete folder, 1 for missing or damaged files, 2 for
wrong input.

examples:
  vo data check_kitti
  vo data check_kitti --root /data/kitti --sequences 00-10 --deep
"""

from __future__ import annotations

import argparse
from pathlib import Path

from fetch.kitti_check import SequenceReport, check_tree, parse_numbers
from vo_lib.commands.console import print_lines, print_wrapped, reporting
from vo_lib.data.catalogue import kitti_root, kitti_roots
from vo_lib.errors import DataError

MAX_PROBLEMS_SHOWN = 8  # per sequence


def add_options(parser: argparse.ArgumentParser) -> None:
    """Options of the script."""
    parser.add_argument("--root", type=Path, metavar="DIR", help=f"KITTI folder; default {kitti_root()}")
    text = "sequence numbers; default: all sequences in the folder"
    parser.add_argument("--sequences", metavar="S,S-S,…", help=text)
    parser.add_argument("--deep", action="store_true", help="also decode every image, on all cores")


def run(options: argparse.Namespace) -> int:
    """Check the sequences; print the result and the commands that fetch missing files."""
    root: Path = options.root or next(iter(kitti_roots()), kitti_root())
    get = f"vo data get_kitti --root {root}"
    names = None if options.sequences is None else parse_numbers(options.sequences)
    if names is None and not root.is_dir():
        raise DataError(f"the folder is missing; create it with {get} --sequences 07,04", root)
    with reporting("checking the sequences") as report:
        reports = check_tree(root, names, options.deep, report)
    if not reports:
        raise DataError(f"contains no sequences; fetch some with {get} --sequences 07,04", root / "sequences")
    show_sequences(root, reports)
    # A part has options of its own; all whole sequences are fetched by one command. Own sequences cannot be.
    incomplete = [report for report in reports if report.problems and report.expected is not None]
    choices = [report.part for report in incomplete if report.part]
    whole = [report.name for report in incomplete if not report.part]
    if whole:
        choices.append(f"--sequences {','.join(whole)}")
    for choice in choices:
        print_lines(f"Fetch the missing files with: {get} {choice}")
    return 1 if any(report.problems for report in reports) else 0


def show_sequences(root: Path, reports: list[SequenceReport]) -> None:
    """Print the sequences with their complete files and their first problems."""
    print_wrapped(str(root))
    for report in reports:
        total = "" if report.expected is None else f" of {report.expected}"
        state = "incomplete" if report.problems else "complete"
        lines = [*report.complete, *report.problems[:MAX_PROBLEMS_SHOWN]]
        not_shown = len(report.problems) - MAX_PROBLEMS_SHOWN
        if not_shown > 0:
            lines.append(f"and {not_shown} more")
        print_wrapped(f"  {report.name}: {report.pairs}{total} pairs, {state}")
        for line in lines:
            print_wrapped(f"    {line}")
