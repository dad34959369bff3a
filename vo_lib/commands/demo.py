"""`vo demo`."""

from __future__ import annotations

import argparse
from typing import Any

from ..runs.jobs import run_jobs
from ..runs.results import run_folder
from ..tables.demo import example_frame
from ..tables.entries import group_entries
from ..tables.paper import read_paper_table
from ..tables.reproduce import collect, plan_jobs
from ..tables.table1 import method_table
from ..tables.table_files import write_table_files
from .common import BOTH, add_cache, add_variant, open_with_bar, parse_methods
from .console import reporting, say, show_report_table

SCENE = "synthetic/traffic"


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
        jobs = plan_jobs([sequence], parse_methods(None, options.variant), 1, folder)
        with reporting("all methods") as report:
            outcomes = run_jobs(jobs, 1, report, options.cache, fresh=True)
        result = collect(outcomes, [], 1)
        write_table_files(folder, result, read_paper_table(), "vo demo", (example_frame(sequence),))
    for group in group_entries(result.entries):
        show_report_table(method_table(list(group.entries.values())))
    say(
        f"Look at {folder / 'report.html'} in a browser. What next:",
        "  vo list                                    the other scenes and any KITTI sequences found",
        "  vo run synthetic/jam --out runs/jam        one method on another scene",
        "  vo run PATH --out runs/mine                a KITTI-layout folder of your own",
        "  vo check                                   what is missing for KITTI, and how to get it",
    )
    for problem in result.problems:
        say(problem)
    return 1 if result.failed else 0
