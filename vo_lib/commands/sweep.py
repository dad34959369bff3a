"""`vo sweep`: runs over a grid of settings."""

from __future__ import annotations

import argparse
import math
from contextlib import ExitStack

from ..errors import DataError
from ..files import only_process, refuse_foreign, write_atomic, written_together
from ..report.page import records_csv
from ..report.sweep_table import (
    CELLS,
    grid_of,
    heat_map,
    parse_axis,
    refuse_unused,
    run_sweep,
    sweep_table,
)
from ..report.table1 import is_own_table
from ..runs.folder import has_runs, run_folder
from ..runs.jobs import Job, Outcome, run_jobs
from . import common
from .console import print_lines, reporting, show_report_table

TABLE = "sweep.csv"
HEAT_MAP = "sweep.png"


def add(parser: argparse.ArgumentParser) -> None:
    """Declare `vo sweep`."""
    parser.epilog = (
        "A second call with the same folder does only the missing runs, such as runs with new values. "
        "Exit code 1: a run failed. Example: vo sweep --sequence synthetic/traffic --variant published "
        "--jobs 2 --set selection.sets=50,200 --set filter.margin=0,0.1"
    )
    option = parser.add_argument
    option("--sequence", required=True, metavar="S", help="a name from `vo list`, or a folder")
    common.add_method(parser)
    text = "values of a setting of `vo run --help-settings`; repeat the option for more settings. "
    text += "Semicolons separate values that are lists: filter.classes='car;car,truck'"
    option("--set", dest="axes", action="append", required=True, metavar="SETTING=V,V,…", help=text)
    common.add_part(parser)
    where = parser.add_mutually_exclusive_group()
    common.add_many(parser, where)
    text = "Dask scheduler, tcp://host:port; its workers need the same file paths (extra [cluster])"
    where.add_argument("--dask", metavar="ADDRESS", help=text)
    option("--out", default="runs/sweep", metavar="DIR", help="folder; default %(default)s")
    parser.set_defaults(command=_sweep, others="--set gives the values of a threshold")


def _sweep(options: argparse.Namespace) -> int:
    common.require_drawing()
    seeds = common.parse_whole("--seeds", options.seeds)
    base = common.read_settings(options)
    axes = dict(parse_axis(text, base) for text in options.axes)
    if len(axes) < len(options.axes):
        raise DataError("--set: a setting is repeated")
    refuse_unused(options.method, base, axes)
    workers = common.parse_jobs(options.jobs, seeds * math.prod(map(len, axes.values())))
    sequence = common.open_with_bar(options.sequence, options.cache, options)
    remedy = "For boxes, call `vo data write_labels`, then add `--labels DIR`."
    runs = [(sequence, config) for _, config in grid_of(base, axes)]
    common.warn_without_boxes(runs, remedy)
    common.note_label_remarks(runs, "--set filter.classes={}")
    with ExitStack() as stack:
        folder = stack.enter_context(run_folder(options.out))
        own = is_own_table(folder / TABLE) or has_runs(folder / CELLS)
        refuse_foreign(folder, (TABLE, HEAT_MAP), own)  # before the lock, which marks the folder as the kit's
        stack.enter_context(only_process(folder))
        with reporting(f"{sequence.name}, {options.method}") as report:

            def run(jobs: list[Job]) -> list[Outcome]:
                return run_jobs(jobs, workers, report, options.cache, options.dask, options.fresh)

            sweep = run_sweep(sequence, options.method, base, axes, seeds, folder, run)
        if not any(record["seeds"] for record in sweep.records):  # an earlier table is kept
            raise DataError(sweep.records[0]["failed"])
        with written_together(folder, stale=() if sweep.has_errors else (HEAT_MAP,)) as draft:
            write_atomic(draft / TABLE, records_csv(sweep.records))
            if sweep.has_errors:
                write_atomic(draft / HEAT_MAP, heat_map(sweep))
    show_report_table(sweep_table(sweep))
    common.note_repeated_runs(sweep.outcomes)
    print_lines(f"written to {folder}: {TABLE}{f', {HEAT_MAP}' if sweep.has_errors else ''}")
    return int(any(record["failed"] for record in sweep.records))
