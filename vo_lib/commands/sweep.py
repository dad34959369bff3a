"""`vo sweep`."""

from __future__ import annotations

import argparse
from functools import partial

from ..config import preset
from ..core.files import write_result
from ..runs.jobs import run_jobs
from ..runs.results import run_folder
from ..tables.sweep import heat_map, parse_axis, run_sweep, sweep_csv, sweep_table
from . import common
from .console import reporting, say, show_report_table


def add(parser: argparse.ArgumentParser) -> None:
    """Declare `vo sweep`."""
    parser.epilog = (
        "example: vo sweep --sequence synthetic/traffic --variant published --jobs 2 "
        "--set selection.sets=50,200 --set filter.margin=0,0.1. Started again it does not do "
        "finished runs again; with more values or seeds it adds them. Exit code 1: a run failed."
    )
    common.add_sequence(parser, "--sequence", "a name from `vo list`, or a path", required=True, metavar="S")
    common.add_method(parser)
    common.add_variant(parser, "kit")
    common.add_config(parser, "what --set names goes before its own")
    parser.add_argument(
        "--set",
        dest="axes",
        action="append",
        required=True,
        metavar="SETTING=V,V,…",
        help="values of a setting that `vo run --help-settings` lists; once for each setting. Values that "
        "are lists are parted by semicolons: filter.classes='2;2,5,7'",
    )
    common.add_part(parser)
    where = parser.add_mutually_exclusive_group()
    common.add_many(parser, where)
    where.add_argument(
        "--dask",
        metavar="ADDRESS",
        help="scheduler of a Dask cluster, tcp://host:port, whose workers see the same files; needs the "
        "extra [cluster]",
    )
    parser.add_argument("--out", default="runs/sweep", metavar="DIR", help="folder; default runs/sweep")
    parser.set_defaults(command=_sweep)


def _sweep(options: argparse.Namespace) -> int:
    axes = tuple(parse_axis(text) for text in options.axes)
    seeds, workers = common.parse_whole("--seeds", options.seeds), common.parse_whole("--jobs", options.jobs)
    base = common.read_settings(options) or preset(options.method, variant=options.variant)
    sequence = common.open_part(options, options.cache)
    with run_folder(options.out, "sweep.csv", "sweep.png") as folder:
        with reporting(f"{sequence.name}, {options.method}") as report:
            run = partial(
                run_jobs,
                workers=workers,
                progress=report,
                cache=options.cache,
                scheduler=options.dask,
                fresh=options.fresh,
            )
            sweep = run_sweep(sequence, options.method, axes, seeds, folder, run, base)
        write_result(folder / "sweep.csv", sweep_csv(sweep))
        if len(axes) == 2:
            write_result(folder / "sweep.png", heat_map(sweep))
    show_report_table(sweep_table(sweep))
    say(f"written to {folder / 'sweep.csv'}" + (f" and {folder / 'sweep.png'}" if len(axes) == 2 else ""))
    return int(any(cell.failed for cell in sweep.cells))
