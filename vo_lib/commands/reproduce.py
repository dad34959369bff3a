"""`vo reproduce`."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

from ..config import METHODS
from ..data.sequence import parse_sequences
from ..evaluation.kitti import Measure
from ..runs.jobs import run_jobs
from ..runs.results import run_folder
from ..tables.entries import group_entries
from ..tables.paper import read_paper_table
from ..tables.reproduce import collect, default_sequences, plan_jobs, split_missing
from ..tables.table1 import short_layouts
from ..tables.table_files import write_table_files
from .common import add_cache, open_with_bar, parse_lengths, parse_methods, parse_whole
from .console import reporting, say, show_report_table


def add(commands: Any) -> None:
    """Declare `vo reproduce`."""
    parser = commands.add_parser(
        "reproduce",
        help="Table 1 and Figure 4: methods over sequences and seeds",
        epilog="example: vo reproduce --sequences 00,02-10 --methods mesvo_f,feature_selection --jobs 2. "
        "Started again with the same folder, it does not do finished runs again. Exit code 1: a run failed.",
    )
    parser.add_argument(
        "--sequences",
        metavar="S,S,…",
        help="KITTI numbers and ranges, names from `vo list`, paths; default: all of KITTI that is found, "
        "without any the synthetic scenes",
    )
    parser.add_argument("--methods", metavar="M,M,…", default=",".join(METHODS), help="default: all")
    parser.add_argument("--seeds", metavar="N", default="5", help="seeds 0 … N-1; default 5")
    parser.add_argument(
        "--lengths",
        metavar="L,L,…",
        help="sub-sequence lengths, metres, from every frame; default: as KITTI, on short paths 20,50,100",
    )
    parser.add_argument("--jobs", metavar="N", default="1", help="processes; default 1")
    parser.add_argument("--out", default="runs/table1", metavar="DIR", help="folder for runs and tables")
    parser.add_argument(
        "--paper", type=Path, metavar="CSV", help="the paper's numbers; default: the kit's own"
    )
    parser.add_argument("--fresh", action="store_true", help="do runs again that are finished")
    parser.add_argument("--json", action="store_true", help="print JSON")
    add_cache(parser)
    parser.set_defaults(command=_reproduce)


def _reproduce(options: argparse.Namespace) -> int:
    methods = parse_methods(options.methods)
    seeds, workers = parse_whole("--seeds", options.seeds), parse_whole("--jobs", options.jobs)
    measure = None if options.lengths is None else Measure(parse_lengths(options.lengths), 1)
    paper = read_paper_table(options.paper)
    asked = default_sequences() if options.sequences is None else parse_sequences(options.sequences)
    names, missing = split_missing(asked)
    with run_folder(options.out) as folder:
        sequences = [open_with_bar(name, options.cache) for name in names]
        jobs = plan_jobs(sequences, methods, seeds, folder)
        with reporting(f"{len(jobs)} runs") as report:
            outcomes = run_jobs(jobs, workers, report, options.cache, fresh=options.fresh)
        result = collect(outcomes, missing, seeds, measure)
        _, metrics = write_table_files(folder, result, paper, _command(options, names))
    if options.json:
        print(json.dumps(metrics, indent=2, allow_nan=False))
    else:
        for group in group_entries(result.entries):
            for table in short_layouts(group):
                show_report_table(table)
        say(*result.problems, f"Spread, the paper's numbers and figures: {folder / 'report.html'}")
    return 1 if result.failed else 0


def _command(options: argparse.Namespace, names: list[str]) -> str:
    """The command line that makes the same table, for the report."""
    words = ["vo reproduce", f"--sequences {','.join(names)}", f"--methods {options.methods}"]
    words += [f"--seeds {options.seeds}"] + ([f"--lengths {options.lengths}"] if options.lengths else [])
    return " ".join(words)
