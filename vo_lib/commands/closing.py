"""The option --loops of `vo run` and `vo reproduce`: the closing of loops (not in the paper)."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np

from ..data.poses import read_kitti_poses, write_kitti_poses
from ..data.sequence import Sequence
from ..evaluation.ate_rpe import rmse
from ..evaluation.evaluate import evaluate
from ..evaluation.kitti import suitable_measure
from ..files import csv_text, write_atomic
from ..geometry.types import Array
from ..loops.find import Loops, find_loops
from ..loops.graph import Closed, close_path
from ..loops.settings import LoopConfig
from ..paper.settings import MethodConfig
from ..report.page import ReportTable, number
from ..runs.drive import single_threaded
from ..runs.folder import LOOPS, LOOPS_POSES, POSES
from ..runs.jobs import Outcome
from ..settings import declared
from .console import reporting

PREFIX = "loops."
LOOP_SETTINGS = declared(LoopConfig, PREFIX)
CLOSED = "loops closed"
COLUMNS = ["first", "second", "similarity", "matches", "inliers", "residual_px", "weight", "gap_m"]


def add_loops(parser: argparse.ArgumentParser) -> None:
    """Declare --loops."""
    text = f"close loops by a pose graph (not in the paper); adds {LOOPS_POSES} and {LOOPS}"
    parser.add_argument("--loops", action="store_true", help=text)


def loops_with_bar(sequence: Sequence, method: MethodConfig, config: LoopConfig) -> Loops:
    """Compare the places of a sequence, and show a progress bar."""
    with reporting(f"loops of {sequence.name}") as report, single_threaded():
        return find_loops(sequence, method, config, report)


def close_run(folder: Path, sequence: Sequence, poses: Array, loops: Loops, config: LoopConfig) -> Closed:
    """Close the accepted loops; write the poses and the closed loops into the folder of the run."""
    with single_threaded():  # the last digits depend on the number of threads
        closed = close_path(poses, loops[loops.accepted(config)], config)
    write_kitti_poses(folder / LOOPS_POSES, closed.poses)
    loops, frames, rows = closed.loops, sequence.frames, list[list[object]]([list(COLUMNS)])
    numbers = loops.similarity, loops.matches, loops.inliers, loops.residual, closed.weight, closed.gap
    for first, second, *row in zip(loops.first, loops.second, *numbers, strict=True):
        cells = [f"{x:.3f}" if isinstance(x, np.floating) else x for x in row]
        rows.append([frames[first], frames[second], *cells])
    write_atomic(folder / LOOPS, csv_text(rows))
    return closed


def close_outcomes(outcomes: list[Outcome], config: LoopConfig) -> list[ReportTable]:
    """Close the loops of finished runs in their folders; return a table of errors, or [] without truth.

    Places are compared once for all runs of a sequence with equal seed, box rule, buckets and reprojection
    settings.
    """
    shared: dict[Any, Loops] = {}
    errors: dict[str, list[Array]] = {}
    for job in (outcome.job for outcome in outcomes if outcome.error is None):
        sequence, method, poses = job.sequence, job.config, read_kitti_poses(job.folder / POSES)
        key = sequence.name, method.seed, method.filter, method.buckets, method.reprojection
        if key not in shared:
            shared[key] = loops_with_bar(sequence, method, config)
        closed = close_run(job.folder, sequence, poses, shared[key], config)
        if sequence.truth is not None:
            measure, numbers = suitable_measure(sequence.truth), list[float | None]([len(closed.loops)])
            for path in evaluate(sequence.truth, {"before": poses, "after": closed.poses}, measure).paths:
                numbers += [rmse(path.ate.distance), path.kitti.te, path.kitti.re]
            row = f"{sequence.name}, {method.variant}, {job.method}"
            errors.setdefault(row, []).append(np.array(numbers, float))
    rows = []
    for row, of_seeds in errors.items():
        count, *means = np.mean(of_seeds, axis=0)
        changes = [f"{number(means[k])} → {number(means[k + 3])}" for k in range(3)]
        rows.append([row, number(count, 1), *changes])
    note = "Means over the seeds, before → after the closing of loops; ATE with SE3 alignment."
    columns = ["sequence, variant, method", "loops", "ATE m", "TE %", "RE deg/100 m"]
    title = "Not in the paper: loops closed by a pose graph"
    return [ReportTable(title, columns, rows, [note])] if rows else []
