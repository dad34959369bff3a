"""`vo reproduce`."""

from __future__ import annotations

import argparse
import shlex
from pathlib import Path

from ..core.errors import DataError
from ..data.sequence import Sequence, parse_sequences
from ..detection.detectors import find_model
from ..detection.label_cache import labelled_sequence
from ..evaluation.kitti import Measure
from ..runs.jobs import run_jobs
from ..runs.results import run_folder
from ..tables.entries import group_entries
from ..tables.paper import read_paper_table
from ..tables.reproduce import collect, default_sequences, plan_jobs, split_missing
from ..tables.table1 import layout_tables
from ..tables.table_files import TABLE_FILES, write_table_files
from . import common
from .console import reporting, say, show_report_table, tell


def add(parser: argparse.ArgumentParser) -> None:
    """Declare `vo reproduce`."""
    parser.epilog = (
        "example: vo reproduce --sequences 00,02-10 --methods mesvo_f,feature_selection --jobs 2. "
        "Started again with the same folder, it does not do finished runs again. Exit code 1: a run failed."
    )
    parser.add_argument(
        "--sequences",
        metavar="S,S,…",
        help="KITTI numbers and ranges, names from `vo list`, paths; default: all of KITTI that is found, "
        "without any the synthetic scenes",
    )
    common.add_variant(parser, common.BOTH)
    parser.add_argument("--methods", metavar="M,M,…", help="default: all that a variant has")
    common.add_config(parser, "the table then has this method alone")
    parser.add_argument(
        "--lengths",
        metavar="L,L,…",
        help="sub-sequence lengths, metres, from every frame; default: as KITTI, on short paths 20,50,100",
    )
    parser.add_argument("--out", default="runs/table1", metavar="DIR", help="folder for runs and tables")
    parser.add_argument(
        "--paper", type=Path, metavar="CSV", help="the paper's numbers; default: the kit's own"
    )
    common.add_detector(
        parser, "find the vehicles of sequences that have no labels: a model by name or an ONNX file"
    )
    common.add_many(parser, parser)
    parser.set_defaults(command=_reproduce)


def _reproduce(options: argparse.Namespace) -> int:
    config = common.read_settings(options)
    if config is not None and options.methods is not None:
        raise DataError("--config and --methods: expected one of them, both name the method")
    methods = common.parse_methods(options.methods if config is None else options.method, options.variant)
    seeds, workers = common.parse_whole("--seeds", options.seeds), common.parse_whole("--jobs", options.jobs)
    measure = None if options.lengths is None else Measure(common.parse_lengths(options.lengths), 1)
    paper = read_paper_table(options.paper)
    if options.detector is not None:
        find_model(options.detector)
    asked = default_sequences() if options.sequences is None else parse_sequences(options.sequences)
    names, missing = split_missing(asked)
    with run_folder(options.out, *TABLE_FILES) as folder:
        opened = [common.open_with_bar(name, options.cache) for name in names]
        common.warn_of_street(options.detector, *(each for each in opened if each.labels is None))
        sequences = [_labelled(each, options) for each in opened]
        jobs = plan_jobs(sequences, methods, seeds, folder, config)
        with reporting(f"{len(jobs)} runs") as report:
            outcomes = run_jobs(jobs, workers, report, options.cache, fresh=options.fresh)
        result = collect(outcomes, missing, seeds, measure)
        write_table_files(folder, result, paper, _command(options, names))
    for group in group_entries(result.entries):
        for table in layout_tables(group, paper, narrow=True):
            show_report_table(table)
    tell("", *result.problems)
    say(f"Spread, differences, gains and figures: {folder / 'report.html'}")
    return 1 if result.failed else 0


def _labelled(sequence: Sequence, options: argparse.Namespace) -> Sequence:
    """The sequence with vehicle boxes: its own labels, else the detector's, which are kept and resumed."""
    if options.detector is None or sequence.labels is not None:
        return sequence
    with reporting(f"vehicles of {sequence.name}") as report:
        return labelled_sequence(
            sequence, options.detector, provider=options.provider, cache=options.cache, progress=report
        )


def _command(options: argparse.Namespace, names: list[str]) -> str:
    """The command line that makes the same table, for the report."""
    words = ["vo", "reproduce", "--sequences", ",".join(names), "--seeds", options.seeds]
    words += ["--variant", options.variant] if options.variant != common.BOTH else []
    for name in ("methods", "config", "lengths", "detector", "paper"):
        value = getattr(options, name)
        words += [] if value is None else [f"--{name}", str(value)]
    return shlex.join(words)
