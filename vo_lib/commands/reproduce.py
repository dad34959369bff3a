"""`vo reproduce`: Table 1 and Figure 4 from runs of several methods, sequences and seeds.

The words block, cell, entry and group are those of `report`.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ..config import CONFIG_CLASSES
from ..data.catalogue import parse_sequences
from ..data.sequence import Sequence
from ..detection.models import find_model
from ..errors import DataError
from ..evaluation.kitti_errors import SubsequenceProtocol
from ..files import only_process
from ..loops.settings import LoopConfig
from ..paper.settings import MethodConfig
from ..report.blocks import Axes, Block, make_blocks, parse_axes
from ..report.compare import Compared, tables_without_truth
from ..report.film import FILM_ENDING, Film, film_frames, refuse_foreign_film
from ..report.page import ReportTable
from ..report.record import RECORD, Call, earlier_calls, reproduction_record, this_call
from ..report.table1 import (
    PROPOSAL,
    Group,
    PaperTable,
    Reproduction,
    collect,
    group_entries,
    is_own_table,
    read_paper_table,
    stands_still,
)
from ..report.table1_durations import kitti_duration
from ..report.table1_page import (
    REPORT,
    TABLE,
    block_words,
    layout_tables,
    removal_pictures,
    sentences_on_proposal,
    settings_tables_without_truth,
    short_path_tables,
    table_files,
    tables_by_settings,
    write_table_files,
)
from ..report.table1_plan import RUNS, Cell, default_sequences, jobs_of, plan_cells, split_missing
from ..runs.durations import Durations
from ..runs.folder import has_runs, read_run, refuse_foreign, run_folder
from ..runs.jobs import Job, Outcome, refuse_other_runs
from ..runs.match_cache import CachedMatches
from . import close_loops, common, vehicle_boxes
from .console import print_notes, print_warnings, print_wrapped, reporting, show_report_table


def add(parser: argparse.ArgumentParser) -> None:
    """Declare `vo reproduce`."""
    parser.epilog = (
        "example: vo reproduce --sequences 00,02-10 --methods mesvo_f,feature_selection --jobs 2 "
        "--set selection.threshold=0.5,1. A second call with the same folder repeats no finished run. "
        "Exit code 1: a run failed, or a sequence is missing."
    )
    option = parser.add_argument
    text = (
        "KITTI numbers or ranges, names from `vo list`, or paths; default: all KITTI sequences found, or "
        "else the drawn scenes except synthetic/block"
    )
    option("--sequences", metavar="S,S,…", help=text)
    option(
        "--missing", choices=["ok"], help="with ok, a missing KITTI sequence does not make the exit code 1"
    )
    common.add_variant(parser, both=True)
    option("--methods", metavar="M,M,…", help="methods to run; by default all methods of the variant")
    common.add_set(parser, "each value makes a block of the table with all methods")
    text = (
        "config.json of a run: the table takes its variant from there, and the settings that differ from the "
        "preset hold for all methods; without --methods, the table has only the method of that run"
    )
    option("--config", type=Path, metavar="FILE", help=text)
    text = (
        "lengths of the sub-sequences in metres, which then start at every frame; default KITTI's, or "
        "20,50,100 for short paths"
    )
    option("--lengths", metavar="L,L,…", help=text)
    option("--out", default="runs/table1", metavar="DIR", help="folder for the results; default %(default)s")
    common.add_part(parser)
    vehicle_boxes.add_detector(parser, " in sequences whose images do not all have labels")
    common.add_many(parser)
    text = "draw a film of feature_selection on each sequence, with the first seed, for the report"
    option("--films", action="store_true", help=text)
    close_loops.add_loops(parser)
    parser.set_defaults(command=reproduce)


@dataclass(frozen=True)
class _Table:
    """The table that the options of `vo reproduce` ask for.

    blocks : its parts.
    methods : names by variant.
    seeds : number of runs of each method.
    protocol : the sub-sequences of --lengths, or None.
    names : sequences on this machine, or folders.
    missing : KITTI sequences that are not on this machine.
    """

    blocks: list[Block]
    methods: dict[str, list[str]]
    seeds: int
    protocol: SubsequenceProtocol | None
    names: list[str]
    missing: list[str]


def _read_table(options: argparse.Namespace) -> _Table:
    """The table of the options, tested before any work; a warning names the missing sequences."""
    chosen = common.read_table_methods(options)
    methods = common.parse_methods(chosen.methods, chosen.variant)
    axes: Axes = {}
    for variant, of_variant in methods.items():
        if of_variant:  # every variant tests the values, which are the same for all
            axes = parse_axes(options.axes, CONFIG_CLASSES[variant]())
    blocks = make_blocks(methods, chosen.changes, axes, options.loops, chosen.must_be_used)
    seeds = common.parse_whole("--seeds", options.seeds)
    common.parse_whole("--jobs", options.jobs)  # refused before the work
    protocol = None
    if options.lengths is not None:
        protocol = SubsequenceProtocol(common.parse_lengths(options.lengths), 1)
    if options.films and not any(PROPOSAL in of_variant for of_variant in methods.values()):
        raise DataError(f"--films: films show {PROPOSAL}: add it to --methods, or omit --films")
    if options.detector is not None:
        find_model(options.detector)
    candidates = default_sequences() if options.sequences is None else parse_sequences(options.sequences)
    names, missing = split_missing(common.distinct_sequences(candidates, options.cache))
    vehicle_boxes.check_options(options, names)
    configs = [block.config(method) for block in blocks for method in methods[block.variant]]
    vehicle_boxes.note_unused_boxes(options, configs)
    common.warn_missing(missing, len(names) + len(missing), accepted=options.missing == "ok")
    return _Table(blocks, methods, seeds, protocol, names, missing)


@dataclass(frozen=True)
class _Done:
    """The runs of a table, and what is said of them.

    jobs : of all cells; outcomes : of these jobs.
    result : the errors and paths.
    without_boxes : a warning on sequences without boxes, if there are any.
    remarks : sentences for the report on options and labels.
    """

    cells: list[Cell]
    jobs: list[Job]
    outcomes: list[Outcome]
    result: Reproduction
    without_boxes: list[str]
    remarks: list[str]


def reproduce(options: argparse.Namespace, *remarks: str) -> int:
    """Do the runs; write and print the table, the result and the remarks.

    Exit code 1 if a run failed or, without --missing ok, if a sequence is missing.
    """
    start = time.perf_counter()
    common.require_drawing()
    table = _read_table(options)
    durations = Durations()
    with ExitStack() as stack:
        folder = stack.enter_context(run_folder(options.out))
        sequences = [common.open_with_bar(name, options.cache, options) for name in table.names]
        # Before the lock, which marks the folder as the kit's.
        own = is_own_table(folder / TABLE) or has_runs(folder / RUNS)
        refuse_foreign(folder, table_files(table.blocks, [sequence.name for sequence in sequences]), own)
        stack.enter_context(only_process(folder))
        done = _do_runs(options, table, folder, sequences, durations)
        result = done.result
        if not result.paths and not result.entries:  # an earlier table is kept
            raise DataError(" ".join(result.problems))
        if options.films:
            succeeded = [outcome.job for outcome in done.outcomes if outcome.error is None]
            _draw_films(succeeded, options.cache)
        closed = close_loops.close_outcomes(done.outcomes, LoopConfig()) if options.loops else []
        groups = group_entries(result.entries)
        conclusions = [*sentences_on_proposal(groups), *remarks, *done.remarks]
        call = this_call(options.line, time.perf_counter() - start, durations.workers)
        report_tables = _write(options, table, folder, done, groups, closed, conclusions, call)
    for report_table in report_tables:
        show_report_table(report_table)
    print_wrapped("", *result.problems, *conclusions)
    common.note_repeated_runs(done.outcomes)
    print_wrapped(*kitti_duration(done.jobs, durations, detects=options.detector is not None))
    print_wrapped(f"Report with figures: {folder / REPORT}")
    if any(entry.is_whole for entry in result.entries):
        print_wrapped(f"Record for chapter 7 and for others: {folder / RECORD}")
    is_incomplete = bool(table.missing) and options.missing != "ok"
    return 1 if result.failed or is_incomplete else 0


def _do_runs(
    options: argparse.Namespace,
    table: _Table,
    folder: Path,
    sequences: list[Sequence],
    durations: Durations,
) -> _Done:
    """Detect the boxes, as --detector says, and do the runs of a table in its folder.

    Before the runs, print what is doubtful or has no effect.

    Raises `DataError` for finished runs with other inputs, and for films that the kit did not write.
    """
    opener = vehicle_boxes.Opener(sequences, options, durations)
    if not options.fresh:  # another detector is refused before it detects
        undetected = _plan(table, folder, opener.names, opener.undetected)
        refuse_other_runs(jobs_of(undetected), opener.detector_of)
    cells = _plan(table, folder, opener.names, opener)  # detects all boxes, which may take minutes
    jobs = jobs_of(cells)
    if options.films:
        for job in _filmed(jobs):
            refuse_foreign_film(_film_file(job))
    for sequence in sequences:
        still = sequence.truth is not None and stands_still(sequence.truth)
        common.note_too_short(sequence, table.protocol, "" if still else "--lengths chooses shorter ones")
    of_lengths = _remarks_on_lengths(sequences, table.protocol)
    print_notes(of_lengths)
    workers = common.parse_jobs(options.jobs, len(jobs))
    run_inputs = [(job.sequence, job.config) for job in jobs]
    typed = vehicle_boxes.TYPED_SET_CLASSES
    of_labels = vehicle_boxes.remarks_on_labels(run_inputs, typed, with_name=True)
    print_notes(of_labels)
    without_boxes = vehicle_boxes.warnings_without_boxes(
        (job.method, job.sequence, job.config) for job in jobs
    )
    print_warnings(without_boxes)
    with reporting(f"{len(jobs)} runs") as report:
        outcomes = common.run_with_options(jobs, workers, report, durations, options)
    result = collect(cells, outcomes, table.missing, table.protocol)
    remarks = [*(f"{remark}." for remark in of_lengths), *of_labels]
    return _Done(cells, jobs, outcomes, result, without_boxes, remarks)


def _write(
    options: argparse.Namespace,
    table: _Table,
    folder: Path,
    done: _Done,
    groups: list[Group],
    closed: list[ReportTable],
    conclusions: list[str],
    call: Call,
) -> list[ReportTable]:
    """Write the files of a table; return the tables of its report.

    groups : of the result's entries; closed : tables on the closing of loops.
    conclusions : sentences at the top of the report, behind a warning on missing boxes.
    call : the command and its duration.
    """
    paper = read_paper_table()
    differs = {block: block.described(table.methods[block.variant]) for block in table.blocks}
    report_tables = _tables_with_truth(groups, paper, differs) + closed
    report_tables += short_path_tables(done.result) + settings_tables_without_truth(done.result)
    report_tables += _tables_without_truth(done.result)
    write_table_files(
        folder,
        done.result,
        groups,
        paper,
        tables=report_tables,
        conclusions=[*done.without_boxes, *conclusions],
        origin=[call.command, f"duration {call.seconds:.0f} s, processes: {call.processes}"],
        removals=removal_pictures(done.outcomes, options.cache),
        record=reproduction_record(
            entries=done.result.entries,
            paper=paper,
            missing=table.missing,
            detector=None if options.detector is None else find_model(options.detector),
            call=call,
            earlier=[] if options.fresh else earlier_calls(folder),
            jobs=done.jobs,
            cache=options.cache,
            differs=differs,
        ),
    )
    return report_tables


def _plan(
    table: _Table, folder: Path, names: list[str], opened: Callable[[str, MethodConfig], Sequence]
) -> list[Cell]:
    """The cells of a table on the sequences of these names; `opened` : as in `plan_cells`."""
    return plan_cells(table.blocks, table.methods, names, table.seeds, folder, opened)


def _tables_with_truth(
    groups: list[Group], paper: PaperTable, differs: Mapping[Block, list[str]]
) -> list[ReportTable]:
    """The tables of errors: each method by its settings, then each group by itself.

    differs : for each block, sentences on what differs from the presets.
    """
    sentences_of = {block.key: sentences for block, sentences in differs.items()}
    tables = tables_by_settings(groups)
    for group in groups:
        tables += layout_tables(group, paper, sentences_of[group.block_key])
    return tables


def _remarks_on_lengths(sequences: list[Sequence], protocol: SubsequenceProtocol | None) -> list[str]:
    """On which sequences --lengths has no effect; `protocol` : its sub-sequences, or None."""
    without = [sequence.name for sequence in sequences if sequence.truth is None]
    if protocol is None or not without:
        return []
    which = "which has" if len(without) == 1 else "which have"
    return [f"--lengths has no effect on {' and '.join(without)}, {which} no ground truth"]


def _tables_without_truth(result: Reproduction) -> list[ReportTable]:
    """For each block and each sequence without truth, the lengths of the paths and their distances."""
    tables = []
    for (block, name), (truth, paths) in result.paths.items():
        if truth is None:
            title = f"{name}, {block_words(block.variant, block.words)}, first seed"
            frames = np.arange(len(next(iter(paths.values()))))
            compared = Compared(title, None, None, paths, frames, is_part=False, notes=[])
            facts, *distances = tables_without_truth(compared)
            tables.append(facts)
            # In a report, the tables of several sequences and blocks need different names.
            for table in distances:
                what = f"{table.title[0].lower()}{table.title[1:]}"
                tables.append(replace(table, title=f"{title}, {what}"))
    return tables


def _filmed(jobs: list[Job]) -> list[Job]:
    """The jobs of which --films draws a film: those of the proposal with the first seed."""
    return [job for job in jobs if job.method == PROPOSAL and job.config.seed == 0]


def _film_file(job: Job) -> Path:
    """The file of a job's film."""
    return job.folder / f"film{FILM_ENDING}"


def _draw_films(jobs: list[Job], cache: Path | None) -> None:
    """Draw a film of each run of the proposal with the first seed, in the folder of the run."""
    filmed = _filmed(jobs)
    for number, job in enumerate(filmed, start=1):
        result = read_run(job.folder, job.sequence)
        label = f"{job.sequence.name}, {job.system}, {job.config.variant}"
        film = Film(_film_file(job), result, label)
        matches = CachedMatches(job.sequence, job.config, cache)
        common.draw_with_bar(film, film_frames(result, matches), f"film {number} of {len(filmed)}")
