"""The option --loops of `vo run` and `vo reproduce`: the closing of loops (not in the paper)."""

from __future__ import annotations

import argparse
from collections.abc import Hashable
from pathlib import Path

import numpy as np

from ..data.poses import read_kitti_poses
from ..data.sequence import Sequence
from ..evaluation.ate_rpe import rmse
from ..evaluation.kitti_errors import suitable_protocol
from ..evaluation.path_errors import evaluate
from ..geometry.types import Array
from ..loops.closure_files import write_closure
from ..loops.find import PlacePairs, comparison_key, find_loops
from ..loops.graph import LoopClosure, close_path
from ..loops.settings import LoopConfig
from ..paper.settings import MethodConfig
from ..report.page import COUNT_COLUMN, ReportTable, few_marked, format_number
from ..runs.drive import single_threaded
from ..runs.folder import LOOPS, LOOPS_POSES, POSES, written_together
from ..runs.jobs import Outcome
from ..settings import declared
from .console import reporting

PREFIX = "loops."
LOOP_SETTINGS = declared(LoopConfig, PREFIX)
CLOSED_NAME = "loops closed"  # name of the corrected path in tables and pictures


def add_loops(parser: argparse.ArgumentParser) -> None:
    """Declare --loops."""
    text = f"also close loops by a pose graph, which is not in the paper, and write {LOOPS_POSES} and {LOOPS}"
    parser.add_argument("--loops", action="store_true", help=text)


def find_loops_with_bar(sequence: Sequence, config: MethodConfig, loop_config: LoopConfig) -> PlacePairs:
    """Compare the places of a sequence, and show a progress bar."""
    with reporting(f"loops of {sequence.name}") as report, single_threaded():
        return find_loops(sequence, config, loop_config, report)


def close_run(
    folder: Path, sequence: Sequence, poses: Array, pairs: PlacePairs, loop_config: LoopConfig
) -> LoopClosure:
    """Close the loops among compared places; write them and the corrected path into the folder of a run."""
    with single_threaded():  # the last digits depend on the number of threads
        closure = close_path(poses, pairs[pairs.accepted(loop_config)], loop_config)
    with written_together(folder) as draft:
        write_closure(draft / LOOPS_POSES, draft / LOOPS, sequence.frames, closure)
    return closure


def close_outcomes(outcomes: list[Outcome], loop_config: LoopConfig) -> list[ReportTable]:
    """Close the loops of finished runs in their folders; return a table of errors, or [] without truth."""
    places_of: dict[Hashable, PlacePairs] = {}  # runs with equal keys share the comparison of places
    errors_of_row: dict[str, list[list[float]]] = {}
    for outcome in outcomes:
        if outcome.error is not None:
            continue
        job = outcome.job
        key = (job.sequence.name, comparison_key(job.config))
        if key not in places_of:
            places_of[key] = find_loops_with_bar(job.sequence, job.config, loop_config)
        before = read_kitti_poses(job.folder / POSES)
        closure = close_run(job.folder, job.sequence, before, places_of[key], loop_config)
        if job.sequence.truth is not None:
            row = f"{job.sequence.name}, {job.config.variant}, {job.system}"
            errors = _errors_before_and_after(job.sequence.truth, before, closure)
            errors_of_row.setdefault(row, []).append(errors)
    return [_errors_table(errors_of_row)] if errors_of_row else []


def _errors_before_and_after(truth: Array, before: Array, closure: LoopClosure) -> list[float]:
    """Numbers of loops and of sub-sequences, then ATE, TE and RE before the closing, and the same after it.

    ATE in metres, TE in %, RE in deg/100 m; NaN for an error that is not defined.
    """
    paths = {"before": before, "after": closure.poses}
    result = evaluate(truth, paths, suitable_protocol(truth))
    numbers: list[float] = [len(closure.loops), len(result[0].kitti)]
    for path in result:
        for error in (rmse(path.ate.distance), path.kitti.te, path.kitti.re):
            numbers.append(np.nan if error is None else error)
    return numbers


def _errors_table(errors_of_row: dict[str, list[list[float]]]) -> ReportTable:
    """The table of the means over the seeds, from the numbers of `_errors_before_and_after` of each seed."""
    rows = []
    for row, of_seeds in errors_of_row.items():
        loops, subsequences, *errors = np.mean(of_seeds, axis=0)
        before = errors[:3]  # ATE, TE, RE
        after = errors[3:]
        changes = [
            f"{format_number(old)} → {format_number(new)}" for old, new in zip(before, after, strict=True)
        ]
        rows.append([row, format_number(loops, 1), *changes, few_marked(int(subsequences))])
    return ReportTable(
        "Not in the paper: loops closed by a pose graph",
        ["sequence, variant, method", "loops", "ATE m", "TE %", "RE deg/100 m", COUNT_COLUMN],
        rows,
        ["Means over the seeds, before → after the closing of loops; ATE with SE3 alignment."],
    )
