"""`vo compare`."""

from __future__ import annotations

import argparse
from pathlib import Path

from ..core.errors import DataError
from ..data.drawn import cache_folder, scene_key
from ..data.scenes import SCENES
from ..data.sequence import SYNTHETIC, Sequence, available, open_sequence
from ..runs.results import run_folder
from ..tables.comparison import (
    StoredRun,
    common_kind,
    comparison_table,
    curve,
    distinct,
    foreign_run,
    read_stored_runs,
)
from ..tables.plots import trajectories_figure
from ..tables.reproduce import slug
from ..tables.table_files import AXES, write_curves, write_figure
from .common import add_cache
from .console import say, show_report_table


def add(parser: argparse.ArgumentParser) -> None:
    """Declare `vo compare`."""
    parser.epilog = "example: vo compare runs/a runs/b --out runs/compared"
    parser.add_argument(
        "runs",
        nargs="+",
        metavar="RUN",
        help="run folders, of one sequence or of several; of one, also other systems' poses for the same "
        "frames, files in KITTI's format",
    )
    parser.add_argument("--out", default="runs/compared", metavar="DIR", help="folder for the figures")
    add_cache(parser)
    parser.set_defaults(command=_compare)


def _compare(options: argparse.Namespace) -> int:
    files = [run for run in options.runs if Path(run).is_file()]
    groups = read_stored_runs([run for run in options.runs if run not in files])
    if files:
        if len(groups) != 1:
            raise DataError(f"{files[0]}: expected runs of one sequence beside a file of poses")
        ((name, runs),) = groups.items()
        known = with_truth(runs[0], options.cache)
        groups = {name: distinct([*runs, *(foreign_run(file, runs[0], known) for file in files)])}
    with run_folder(options.out) as folder:
        for name, runs in groups.items():
            known, kind = with_truth(runs[0], options.cache), common_kind(runs)
            paths = {run.label: run.poses for run in runs}
            figure = trajectories_figure({name: (None if known is None else known.truth, paths)})
            write_figure(folder, f"trajectory_{slug(name)}", figure)
            curves = {by: {run.label: curve(run, kind, by) for run in runs} for by in AXES if kind}
            write_curves(folder, slug(name), name, curves)
    for name, runs in groups.items():
        show_report_table(comparison_table(name, runs))
    say(f"figures in {options.out}")
    return 0


def with_truth(run: StoredRun, cache: Path | None) -> Sequence | None:
    """A run's frames with their truth, where its sequence is found without drawing anything."""
    folder = available().get(run.sequence)
    scene = run.sequence.removeprefix(SYNTHETIC)
    if run.sequence.startswith(SYNTHETIC) and scene in SCENES:
        folder = (cache or cache_folder()) / scene_key(SCENES[scene])
    if folder is None or not folder.is_dir():
        return None
    try:
        sequence = open_sequence(folder)
        first, last = (sequence.frames.index(frame) for frame in run.frames)
        part = sequence.part(first, last + 1)
    except (DataError, ValueError):
        return None
    return part if part.truth is not None and len(part) == len(run.poses) else None
