"""Loops of finished runs, for `vo run --loops` and `vo reproduce --loops`: beyond the paper."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np

from ..data.poses import write_kitti_poses
from ..data.sequence import Sequence
from ..evaluation.ate_rpe import rmse
from ..files import csv_text, write_atomic
from ..loops.find import Loops, find_loops
from ..loops.graph import Closed, close_path
from ..loops.settings import LoopConfig
from ..report.page import ReportTable, number
from ..report.paths import ComparedPaths, evaluate_paths
from ..runs.drive import Run, single_threaded
from ..runs.folder import LOOPS, LOOPS_POSES, read_run
from ..runs.jobs import Outcome
from ..settings import declared
from .console import reporting

PREFIX = "loops."
LOOP_SETTINGS = declared(LoopConfig, PREFIX)
CLOSED = "loops closed"
COLUMNS = ["first", "second", "similarity", "matches", "inliers", "residual_px", "weight", "gap_m"]


def add_loops(parser: argparse.ArgumentParser) -> None:
    """The option that closes loops."""
    text = f"beyond the paper: recognise places and close loops by a pose graph; {LOOPS_POSES} and {LOOPS}"
    parser.add_argument("--loops", action="store_true", help=text)


def close_run(folder: Path, run: Run, config: LoopConfig, loops: Loops | None = None) -> Closed:
    """Close the loops of a run, found here unless given; write poses and loops into the run's folder."""
    if loops is None:
        loops = find_with_bar(run.sequence, run, config)
    closed = close_path(run.poses, loops[loops.accepted(config)], config)
    write_kitti_poses(folder / LOOPS_POSES, closed.poses)
    write_atomic(folder / LOOPS, loops_csv(run.sequence.frames, closed))
    return closed


def find_with_bar(sequence: Sequence, run: Run, config: LoopConfig) -> Loops:
    """The compared places of a sequence, while a bar is shown."""
    with reporting(f"loops of {sequence.name}") as report, single_threaded():
        return find_loops(sequence, run.config, config, report)


def loops_csv(frames: tuple[str, ...], closed: Closed) -> str:
    """The closed loops: names of both frames, similarity, matches, inliers, residual, weight and gap."""
    loops, rows = closed.loops, list[list[object]]([list(COLUMNS)])
    for row in range(len(loops)):
        names = frames[loops.first[row]], frames[loops.second[row]]
        counts = loops.matches[row], loops.inliers[row]
        numbers = loops.residual[row], closed.weight[row], closed.gap[row]
        rows.append([*names, f"{loops.similarity[row]:.3f}", *counts, *(f"{x:.3f}" for x in numbers)])
    return csv_text(rows)


def loop_pairs(closed: Closed) -> list[tuple[int, int]]:
    """Numbers of the first and the second frame of each closed loop."""
    return list(zip(closed.loops.first.tolist(), closed.loops.second.tolist(), strict=True))


def close_outcomes(outcomes: list[Outcome], config: LoopConfig) -> list[ReportTable]:
    """Close the loops of finished runs in their folders; a table of their errors, none without truth.

    Runs whose loops depend on the same settings share them.
    """
    known: dict[Any, Loops] = {}
    errors: dict[tuple[str, str, str], list[list[float]]] = {}
    for job in (outcome.job for outcome in outcomes if outcome.error is None):
        run, own = read_run(job.folder, job.sequence), job.config
        key = job.sequence.name, own.seed, own.filter, own.buckets, own.reprojection
        if key not in known:
            known[key] = find_with_bar(job.sequence, run, config)
        closed = close_run(job.folder, run, config, known[key])
        if job.sequence.truth is not None:
            estimates = {job.method: run.poses, CLOSED: closed.poses}
            paths = ComparedPaths(job.sequence.name, job.sequence.truth, job.sequence.times, estimates)
            row = [float(len(closed.loops))]
            for system in evaluate_paths(paths).sequences:
                errors_of = rmse(system.ate.distance), system.kitti.te, system.kitti.re
                row += [np.nan if error is None else error for error in errors_of]
            errors.setdefault((job.sequence.name, own.variant, job.method), []).append(row)
    return [_table(errors)] if errors else []


def _table(errors: dict[tuple[str, str, str], list[list[float]]]) -> ReportTable:
    rows = []
    for key, of_seeds in errors.items():
        count, *means = np.mean(of_seeds, axis=0)
        changes = [f"{number(means[k])} → {number(means[k + 3])}" for k in range(3)]
        rows.append([", ".join(key), number(count, 1), *changes])
    note = "Means over the seeds, of each run before → after its loops were closed; ATE with SE3 alignment."
    columns = ["sequence, variant, method", "loops", "ATE m", "TE %", "RE deg/100 m"]
    title = "Not in the paper: loops closed by a pose graph"
    return ReportTable(title, columns, rows, [note])
