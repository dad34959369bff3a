"""`vo reproduce`."""

from __future__ import annotations

import argparse
import time

from ..data.catalogue import parse_sequences
from ..detection.models import find_model
from ..detection.settings import DetectorConfig
from ..errors import DataError
from ..evaluation.kitti import Measure
from ..files import only_process
from ..report.entries import group_entries
from ..report.printed import read_paper_table
from ..report.reproduce import collect, default_sequences, plan_jobs, split_missing, write_table_files
from ..report.table1 import layout_tables, results
from ..runs.folder import run_folder
from ..runs.jobs import run_jobs
from . import common
from .console import reporting, say, show_report_table, tell


def add(parser: argparse.ArgumentParser) -> None:
    """Declare `vo reproduce`."""
    parser.epilog = (
        "example: vo reproduce --sequences 00,02-10 --methods mesvo_f,feature_selection --jobs 2. "
        "Started again with the same folder, it does not do finished runs again. Exit code 1: a run failed."
    )
    option = parser.add_argument
    text = "KITTI numbers and ranges, names from `vo list`, paths; default: all of KITTI that is found, else "
    option("--sequences", metavar="S,S,…", help=text + "the synthetic scenes")
    common.add_variant(parser, both=True)
    option("--methods", metavar="M,M,…", help="default: all that a variant has")
    common.add_config(parser)
    text = "sub-sequence lengths, metres, from every frame; default: as KITTI, on short paths 20,50,100"
    option("--lengths", metavar="L,L,…", help=text)
    option("--out", default="runs/table1", metavar="DIR", help="folder; default %(default)s")
    common.add_detector(parser, " of sequences without labels")
    common.add_many(parser, parser)
    parser.set_defaults(command=reproduce)


def reproduce(options: argparse.Namespace, before: str = "", after: str = "") -> int:
    """Do the runs, write the table, say the result between two texts; the exit code, 1 where a run failed."""
    start, config = time.perf_counter(), None
    if options.config is not None:
        if options.methods is not None:
            raise DataError("--config and --methods: expected one of them, both name the method")
        config = common.read_settings(options)
        options.methods = options.method
    methods = common.parse_methods(options.methods, options.variant)
    seeds, workers = common.parse_whole("--seeds", options.seeds), common.parse_whole("--jobs", options.jobs)
    measure = None if options.lengths is None else Measure(common.parse_lengths(options.lengths), 1)
    paper = read_paper_table()
    if options.detector is not None:
        find_model(options.detector)
    candidates = default_sequences() if options.sequences is None else parse_sequences(options.sequences)
    names, missing = split_missing(candidates)
    with run_folder(options.out) as folder, only_process(folder):
        opened = [common.open_with_bar(name, options.cache) for name in names]
        sequences = [
            each if each.labels else common.labelled(each, options, DetectorConfig(), options.cache)
            for each in opened
        ]
        jobs = plan_jobs(sequences, methods, seeds, folder, config)
        common.warn_without_boxes((job.sequence, job.config) for job in jobs)
        with reporting(f"{len(jobs)} runs") as report:
            outcomes = run_jobs(jobs, workers, report, options.cache, fresh=options.fresh)
        result = collect(outcomes, missing, measure)
        if not result.paths:  # an earlier table stays
            raise DataError(" ".join(result.problems))
        groups = group_entries(result.entries)
        said = [*results(groups), *filter(None, [after])]
        made = [options.line, f"duration {time.perf_counter() - start:.0f} s, processes: {workers}"]
        write_table_files(folder, result, paper, said, made)
    for table in (table for group in groups for table in layout_tables(group, paper)):
        show_report_table(table)
    tell("", *result.problems)
    say(*filter(None, [before]), f"Report with figures: {folder / 'report.html'}")
    tell(*said)
    return 1 if result.failed else 0
