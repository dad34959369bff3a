"""`vo reproduce`: Table 1 and Figure 4 from runs of several methods, sequences and seeds."""

from __future__ import annotations

import argparse
import time
from contextlib import ExitStack
from pathlib import Path

from ..data.catalogue import parse_sequences
from ..data.label_remarks import missing_labels
from ..data.sequence import Sequence
from ..detection.models import find_model
from ..errors import DataError
from ..evaluation.kitti_errors import SubsequenceProtocol
from ..files import only_process, refuse_foreign
from ..geometry.boxes import VEHICLES
from ..loops.settings import LoopConfig
from ..paper.settings import MethodConfig
from ..report.film import FILM_ENDING, Film, film_frames
from ..report.table1 import (
    PROPOSAL,
    RUNS,
    collect,
    default_sequences,
    group_entries,
    is_own_table,
    plan_jobs,
    read_paper_table,
    split_missing,
)
from ..report.table1_page import REPORT, TABLE, layout_tables, results, table_files, write_table_files
from ..runs.folder import has_runs, read_run, run_folder
from ..runs.jobs import Job, run_jobs
from ..runs.match_cache import CachedMatches
from . import close_loops, common
from .console import print_lines, print_wrapped, reporting, show_report_table

TYPED_CLASSES = "filter.classes {} in the file of --config"


def add(parser: argparse.ArgumentParser) -> None:
    """Declare `vo reproduce`."""
    parser.epilog = (
        "example: vo reproduce --sequences 00,02-10 --methods mesvo_f,feature_selection --jobs 2. "
        "A second call with the same folder repeats no finished run. Exit code 1: a run failed."
    )
    option = parser.add_argument
    text = "KITTI numbers or ranges, names from `vo list`, or paths; default: all KITTI sequences found, or "
    option("--sequences", metavar="S,S,…", help=text + "else the drawn scenes")
    common.add_variant(parser, both=True)
    option("--methods", metavar="M,M,…", help="methods; default: all methods of the variant")
    common.add_config(parser)
    text = "sub-sequence lengths in metres, from every frame; default: KITTI's, or 20,50,100 for short paths"
    option("--lengths", metavar="L,L,…", help=text)
    option("--out", default="runs/table1", metavar="DIR", help="folder; default %(default)s")
    common.add_detector(parser, " in sequences whose images do not all have labels")
    common.add_many(parser, parser)
    text = "film of feature_selection on each sequence, first seed, shown in the report"
    option("--films", action="store_true", help=text)
    close_loops.add_loops(parser)
    parser.set_defaults(command=reproduce, others="thresholds come from the file of --config")


def reproduce(options: argparse.Namespace, *remarks: str) -> int:
    """Do the runs; write and print the table, the result and the remarks. Exit code 1 if a run failed."""
    start = time.perf_counter()
    config = None
    common.require_drawing()
    if options.config is not None:
        if options.methods is not None:
            raise DataError("--config and --methods: use only one of them, since both set the method")
        config = common.read_settings(options)
        options.methods = options.method
    methods = common.parse_methods(options.methods, options.variant)
    seeds = common.parse_whole("--seeds", options.seeds)
    common.parse_whole("--jobs", options.jobs)  # refused before the work
    measure = (
        None if options.lengths is None else SubsequenceProtocol(common.parse_lengths(options.lengths), 1)
    )
    paper = read_paper_table()
    if options.detector is not None:
        find_model(options.detector)
    candidates = default_sequences() if options.sequences is None else parse_sequences(options.sequences)
    names, missing = split_missing(candidates)
    with ExitStack() as stack:
        folder = stack.enter_context(run_folder(options.out))
        opened = [common.open_with_bar(name, options.cache) for name in names]
        own = is_own_table(folder / TABLE) or has_runs(folder / RUNS)
        # Before the lock, which marks the folder as the kit's.
        refuse_foreign(folder, table_files(methods, [sequence.name for sequence in opened]), own)
        stack.enter_context(only_process(folder))
        sequences = [_with_boxes(sequence, options, config) for sequence in opened]
        jobs = plan_jobs(sequences, methods, seeds, folder, config)
        workers = common.parse_jobs(options.jobs, len(jobs))
        runs = [(job.sequence, job.config) for job in jobs]
        remarks = (*remarks, *common.note_label_remarks(runs, TYPED_CLASSES, with_name=True))
        without_boxes = common.warn_without_boxes(runs)
        with reporting(f"{len(jobs)} runs") as report:
            outcomes = run_jobs(jobs, workers, report, options.cache, fresh=options.fresh)
        result = collect(outcomes, missing, measure)
        if not result.paths:  # an earlier table is kept
            raise DataError(" ".join(result.problems))
        if options.films:
            _draw_films([outcome.job for outcome in outcomes if outcome.error is None], options.cache)
        closed = close_loops.close_outcomes(outcomes, LoopConfig()) if options.loops else []
        groups = group_entries(result.entries)
        tables = [*(table for group in groups for table in layout_tables(group, paper)), *closed]
        conclusions = [*results(groups), *remarks]
        origin = [options.line, f"duration {time.perf_counter() - start:.0f} s, processes: {workers}"]
        write_table_files(folder, result, groups, paper, tables, [*without_boxes, *conclusions], origin)
    for table in tables:
        show_report_table(table)
    print_wrapped("", *result.problems, *conclusions)
    common.note_repeated_runs(outcomes)
    print_lines(f"Report with figures: {folder / REPORT}")
    return 1 if result.failed else 0


def _with_boxes(sequence: Sequence, options: argparse.Namespace, config: MethodConfig | None) -> Sequence:
    """The sequence with its labels if every image has a label file, else with the boxes of --detector."""
    missing = len(missing_labels(sequence))
    if options.detector is None or not missing:
        return sequence
    if sequence.labels is not None:
        print_wrapped(
            f"note: {sequence.name}: {missing} of {len(sequence)} images have no label file, so the boxes of "
            "all images are those of --detector"
        )
    classes = (VEHICLES,) if config is None else config.filter.classes
    return common.labelled(sequence, options, options.cache, classes=classes, option=TYPED_CLASSES)


def _draw_films(jobs: list[Job], cache: Path | None) -> None:
    """Draw a film of each run of the proposal with the first seed, in the folder of the run."""
    filmed = [job for job in jobs if job.method == PROPOSAL and job.config.seed == 0]
    for number, job in enumerate(filmed, start=1):
        result = read_run(job.folder, job.sequence)
        label = f"{job.sequence.name}, {job.method}, {job.config.variant}"
        film = Film(job.folder / f"film{FILM_ENDING}", result, label)
        matches = CachedMatches(job.sequence, job.config, cache)
        common.draw_with_bar(film, film_frames(result, matches), f"film {number} of {len(filmed)}")
