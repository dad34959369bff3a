"""Measure the effect of each idea of variant `kit` by turning the idea off.

examples:
  vo data measure_ablation --sequences 00,01,kitti/drive_0013 \\
      --detector yolov8n.onnx
  vo data measure_ablation --jobs 2 --out notebooks/ablation.csv

A row has the change of the results when one idea is turned off, as mean and
standard deviation over five seeds. A row without the name of an idea has the
results with all ideas: the errors, the excess length of the path in %, and the
processor time in milliseconds per frame. Other rows of the file are kept.
"""

from __future__ import annotations

import argparse
import time
from contextlib import ExitStack
from pathlib import Path
from typing import Any
from unittest.mock import patch

import loky
import numpy as np

from measure.ablation import COLUMNS, IDEAS, KEY, WHOLE, Idea, tables
from measure.axes import is_raw_drive, te_and_re
from measure_results import add_inputs, open_all
from vo_lib.commands.common import parse_whole
from vo_lib.commands.console import print_lines, reporting
from vo_lib.config import change, preset
from vo_lib.data.catalogue import SYNTHETIC
from vo_lib.data.sequence import Sequence
from vo_lib.evaluation.kitti_errors import SHORT_PROTOCOL, trajectory_distances
from vo_lib.files import csv_text, read_csv, write_atomic
from vo_lib.geometry.types import Array
from vo_lib.report.page import markdown
from vo_lib.runs.drive import Run, run_methods, single_threaded
from vo_lib.runs.front_end import find_matches
from vo_lib.runs.match_cache import CachedMatches

SEEDS = range(5)
DRAWN_FRAMES = 100  # the first frames of a drawn scene; all frames would take a night


def measured(sequence: Sequence, idea: Idea, cache: Any) -> Array:
    """TE, RE, excess length and ms per frame for each seed, (S, 4).

    The time includes the matching if the idea changes the matches.
    """
    config = preset(idea.method, variant="kit")
    with ExitStack() as patches:
        patches.enter_context(single_threaded())
        for name, value in idea.off.items():
            if name.startswith("vo_lib."):
                patches.enter_context(patch(name, value))
            else:
                config = change(config, name, value)
        clock = [time.process_time()]
        matches = [
            *(
                find_matches(sequence, config)
                if idea.finds_matches
                else CachedMatches(sequence, config, cache)
            )
        ]
        clock.append(time.process_time())
        runs = run_methods(sequence, {str(s): change(config, "seed", s) for s in SEEDS}, None, matches)
        clock.append(time.process_time())
    matching, of_seeds = np.diff(clock) * 1e3 / len(sequence)
    ms = of_seeds / len(SEEDS) + (matching if idea.finds_matches else 0.0)
    return np.array([[*figures(run), ms] for run in runs.values()])


def figures(run: Run) -> tuple[float, float, float]:
    """TE (%), RE (deg/100 m) and the excess length of the path (%)."""
    assert run.sequence.truth is not None
    te, re = te_and_re(run.sequence, run.poses, SHORT_PROTOCOL, is_raw_drive(run.sequence))
    true, length = (trajectory_distances(T)[-1] for T in (run.sequence.truth, run.poses))
    return te, re, 100.0 * (length / true - 1.0)


def add_options(parser: argparse.ArgumentParser) -> None:
    """The options."""
    add_inputs(parser)
    parser.add_argument("--out", default="runs/ablation.csv", metavar="FILE", help="CSV file of the table")


def run(options: argparse.Namespace) -> int:
    """Run variant `kit` with and without each idea; write the differences and print them as tables."""
    workers, out = parse_whole("--jobs", options.jobs), Path(options.out)
    sequences = [s.part(0, DRAWN_FRAMES) if s.name.startswith(SYNTHETIC) else s for s in open_all(options)]
    tasks = [(sequence, idea) for sequence in sequences for idea in (*WHOLE, *IDEAS)]
    rows: list[list[str]] = []
    whole: dict[tuple[str, str, bool], Array] = {}
    with (
        reporting(f"{len(tasks)} runs of {len(SEEDS)} seeds") as report,
        loky.ProcessPoolExecutor(workers) as pool,
    ):
        for results in pool.map(measured, *zip(*tasks, strict=True), [options.cache] * len(tasks)):
            sequence, idea = tasks[len(rows)]
            base = whole.setdefault((sequence.name, idea.method, idea.finds_matches), results)
            errors = results - base if idea.lines else results
            numbers = np.stack([errors.mean(axis=0), errors.std(axis=0)], axis=1).ravel()[:-1]
            key = idea.name, idea.method, sequence.name, str(idea.lines or ""), str(len(results))
            rows.append([*key, *(f"{x:.6f}" for x in numbers)])
            report(len(rows), len(tasks))
    new = {tuple(row[: len(KEY)]) for row in rows}
    old = [cells for _, cells in read_csv(out)[1:]] if out.exists() else []
    rows += [cells for cells in old if tuple(cells[: len(KEY)]) not in new]
    write_atomic(out, csv_text([COLUMNS, *rows]))
    print_lines("\n\n".join(map(markdown, tables(rows))))
    print_lines(f"written to {out}")
    return 0
