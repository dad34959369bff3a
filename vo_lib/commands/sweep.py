"""`vo sweep`: runs over a grid of settings."""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

from .. import settings
from ..config import METHODS, preset
from ..data.catalogue import parse_sequences
from ..data.sequence import Sequence
from ..detection.models import find_model
from ..errors import DataError
from ..files import only_process, write_atomic
from ..paper.settings import MethodConfig
from ..report.blocks import Axes, changed, combinations, parse_axes, reasons_words
from ..report.page import records_csv
from ..report.sweep_table import (
    CELLS,
    DEFAULT_SETTINGS,
    Sweep,
    heat_map,
    planned_jobs,
    refuse_unused,
    run_sweep,
    sweep_table,
)
from ..report.table1 import is_own_table
from ..report.table1_plan import refuse_equal_names, slug
from ..runs.durations import Durations
from ..runs.folder import has_runs, refuse_foreign, run_folder, written_together
from ..runs.jobs import Job, Outcome, refuse_other_runs
from . import common, vehicle_boxes
from .console import print_notes, print_warnings, print_wrapped, reporting, show_report_table

TABLE = "sweep.csv"


def add(parser: argparse.ArgumentParser) -> None:
    """Declare `vo sweep`."""
    parser.epilog = (
        "A second call with the same folder does only the missing runs, such as runs with new values. "
        "Exit code 1: a run failed. Examples: vo sweep --sequence synthetic/traffic --jobs 2 --set "
        "selection.sets=50,200 --set filter.margin=0,0.1; vo sweep --sequences 00,01 --methods "
        "mesvo_f,feature_selection --set selection.threshold=0.25,0.5,1"
    )
    option = parser.add_argument
    text = "KITTI numbers or ranges, names from `vo list`, or folders; with several, give a single --set"
    option("--sequence", "--sequences", dest="sequences", required=True, metavar="S,S,…", help=text)
    text = (
        f"one or more of {', '.join(METHODS)}; default {common.DEFAULT_METHOD}; with several, give a single "
        "--set"
    )
    option("--method", "--methods", dest="methods", metavar="M,M,…", help=text)
    common.add_variant(parser)
    text = "config.json of a run: its settings that differ from the preset hold for all methods"
    option("--config", type=Path, metavar="FILE", help=text)
    common.add_set(parser, "the table has a row for each combination of the values", required=True)
    common.add_part(parser)
    vehicle_boxes.add_detector(parser, " in sequences whose images do not all have labels")
    common.add_many(parser)
    option("--out", default="runs/sweep", metavar="DIR", help="folder for the results; default %(default)s")
    parser.set_defaults(command=_sweep)


@dataclass(frozen=True)
class _Grid:
    """The runs that the options of `vo sweep` ask for.

    bases : by method, its complete configuration before an axis changes it. On a sequence without ground
        truth, it is run in addition, as the reference with whose path the others are compared.
    reference_words : its settings in words.
    axes : the settings that vary, with their values.
    seeds : number of runs with each combination of the values.
    names : of the sequences.
    """

    bases: dict[str, MethodConfig]
    reference_words: str
    axes: Axes
    seeds: int
    names: list[str]

    @property
    def runs(self) -> int:
        """The number of all runs, without those of the reference."""
        combinations_of_values = math.prod(len(values) for values in self.axes.values())
        return self.seeds * combinations_of_values * len(self.names) * len(self.bases)


def _read_grid(options: argparse.Namespace) -> _Grid:
    """The grid of the options, tested before any work."""
    seeds = common.parse_whole("--seeds", options.seeds)
    chosen = common.read_table_methods(options)
    variant = chosen.variant or common.DEFAULT_VARIANT
    methods = common.parse_methods(chosen.methods or common.DEFAULT_METHOD, variant)[variant]
    bases = {method: changed(preset(method, variant=variant), chosen.changes) for method in methods}
    reference_words = "the settings of --config" if chosen.changes else DEFAULT_SETTINGS
    axes = parse_axes(options.axes, bases[methods[0]])
    refuse_unused(bases, axes, chosen.must_be_used)
    _note_unused(bases, [name for name, _ in chosen.changes if name not in axes])
    if options.detector is not None:
        find_model(options.detector)
    names = common.distinct_sequences(_sequence_names(options.sequences), options.cache)
    if len(axes) > 1 and (len(names) > 1 or len(methods) > 1):
        raise DataError(
            "several sequences or methods need a single --set: for a grid of more settings, call the command "
            "once for each of them"
        )
    vehicle_boxes.check_options(options, names)
    configs = [changed(base, changes) for base in bases.values() for changes in combinations(axes)]
    vehicle_boxes.note_unused_boxes(options, configs)
    return _Grid(bases, reference_words, axes, seeds, names)


def _sweep(options: argparse.Namespace) -> int:
    """Do the runs; write and print a table for each sequence. Exit code 1 if a run failed."""
    common.require_drawing()
    grid = _read_grid(options)
    workers = common.parse_jobs(options.jobs, grid.runs)
    durations = Durations()
    sequences = [common.open_with_bar(name, options.cache, options) for name in grid.names]
    refuse_equal_names(sequence.name for sequence in sequences)
    opener = vehicle_boxes.Opener(sequences, options, durations)
    for sequence in sequences:
        common.note_too_short(sequence, None, "the table has distances from the true path instead")
    maps = [_map_name(name, opener.names) for name in opener.names]
    with ExitStack() as stack:
        folder = stack.enter_context(run_folder(options.out))
        own = is_own_table(folder / TABLE) or has_runs(folder / CELLS)
        refuse_foreign(folder, (TABLE, *maps), own)  # before the lock, which marks the folder as the kit's
        if not options.fresh:  # another detector is refused before it detects
            undetected = planned_jobs(
                opener.names, grid.bases, grid.axes, grid.seeds, folder, opener.undetected
            )
            refuse_other_runs(undetected, opener.detector_of)
        _print_remarks_on_boxes(_detect_boxes(grid, opener))
        stack.enter_context(only_process(folder))
        with reporting(f"{', '.join(opener.names)}; {', '.join(grid.bases)}") as report:

            def run(jobs: list[Job]) -> list[Outcome]:
                return common.run_with_options(jobs, workers, report, durations, options)

            sweeps = run_sweep(
                opener.names, grid.bases, grid.axes, grid.seeds, folder, opener, run, grid.reference_words
            )
        if not any(record["seeds"] for sweep in sweeps for record in sweep.records):
            raise DataError(sweeps[0].records[0]["failed"])  # an earlier table is kept
        written = _write(folder, maps, sweeps)
    for sweep in sweeps:
        show_report_table(sweep_table(sweep))
        common.note_repeated_runs(sweep.outcomes)
    print_wrapped(f"written to {folder}: {', '.join(written)}")
    has_failed = any(record["failed"] for sweep in sweeps for record in sweep.records)
    return 1 if has_failed else 0


def _detect_boxes(grid: _Grid, opener: vehicle_boxes.Opener) -> list[tuple[str, Sequence, MethodConfig]]:
    """Detect the boxes for all combinations of the values, as --detector says, which may take minutes.

    Returns the method, the sequence and the settings of the runs, with one run for all seeds.
    """
    runs = []
    for method, base in grid.bases.items():
        for changes in combinations(grid.axes):
            config = changed(base, changes)
            runs += [(method, opener(name, config), config) for name in opener.names]
    return runs


def _print_remarks_on_boxes(runs: list[tuple[str, Sequence, MethodConfig]]) -> None:
    """Print what is doubtful about the boxes of runs; `runs` : as from `_detect_boxes`."""
    print_warnings(vehicle_boxes.warnings_without_boxes(runs))
    run_inputs = [(sequence, config) for _, sequence, config in runs]
    print_notes(vehicle_boxes.remarks_on_labels(run_inputs, vehicle_boxes.TYPED_SET_CLASSES))


def _write(folder: Path, maps: list[str], sweeps: list[Sweep]) -> list[str]:
    """Write the table and the heat maps; return the names of the files.

    maps : for each sweep, the file name of its heat map, which it gets if it has numbers.
    """
    drawn = {name: sweep for name, sweep in zip(maps, sweeps, strict=True) if sweep.has_numbers}
    with written_together(folder) as draft:
        write_atomic(draft / TABLE, records_csv(_records(sweeps)))
        for name, sweep in drawn.items():
            write_atomic(draft / name, heat_map(sweep))
        for name in maps:
            if name not in drawn:  # of an earlier table
                (folder / name).unlink(missing_ok=True)
    return [TABLE, *drawn]


def _note_unused(bases: Mapping[str, MethodConfig], names: Iterable[str]) -> None:
    """Print which settings of --config some methods do not use."""
    for name in names:
        reasons = [(method, settings.unused_because(config, name)) for method, config in bases.items()]
        unused = [(method, reason) for method, reason in reasons if reason]
        if unused:
            who = ", ".join(method for method, _ in unused)
            verb = "does" if len(unused) == 1 else "do"
            print_wrapped(f"note: {name}: {who} {verb} not use this setting, since {reasons_words(unused)}")


def _sequence_names(text: str) -> list[str]:
    """The sequences in a text; the path of a folder may have a comma."""
    return [text] if Path(text).is_dir() else parse_sequences(text)


def _map_name(sequence: str, names: list[str]) -> str:
    """The file of a sequence's heat map."""
    return "sweep.png" if len(names) == 1 else f"sweep_{slug(sequence)}.png"


def _records(sweeps: list[Sweep]) -> list[dict[str, object]]:
    """The records of all sweeps with the same fields; a field that a sequence lacks is None."""
    records = [record for sweep in sweeps for record in sweep.records]
    fields: dict[str, None] = {}  # of all records, each once
    for record in records:
        fields |= dict.fromkeys(record)
    return [{field: record.get(field) for field in fields} for record in records]
