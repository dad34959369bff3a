"""Measure what the paper's open choices are worth.

examples:
  vo data measure_choices --sequences 00,01 --detector yolov8n.onnx --jobs 2 --out notebooks/choices.csv

A row has what another choice changes in `published`: mean and deviation over five seeds, lengths in per cent.
"""

from __future__ import annotations

import argparse
import sys
from contextlib import nullcontext
from dataclasses import replace
from typing import Any
from unittest.mock import patch

import loky
import numpy as np

from measure_results import add_inputs, open_all
from vo_lib.commands.common import parse_whole
from vo_lib.commands.console import reporting, say
from vo_lib.commands.scripts import run_script
from vo_lib.config import change, preset
from vo_lib.data.sequence import Sequence
from vo_lib.evaluation.kitti import suitable_measure, trajectory_distances
from vo_lib.files import csv_text, write_atomic
from vo_lib.geometry.types import Array
from vo_lib.paper.boxes import in_boxes
from vo_lib.paper.matching import finish
from vo_lib.paper.translation import SOLVING_ROUNDS, eliminate_points, feature_rows
from vo_lib.report.entries import measure_runs
from vo_lib.runs.drive import run_methods
from vo_lib.runs.matches import CachedMatches

BOXES = "vo_lib.paper.odometry.on_vehicles"


def in_metres(camera: Any, matches: Any, R_cp: Array, config: Any) -> Any:
    """As `solve_translation`, with the stacked rows as equation (3) has them, in metres."""
    depth = camera.triangulate(matches.prev_left, matches.prev_right)[:, 2]
    near = np.flatnonzero(depth <= config.max_depth)
    M, d = eliminate_points(*feature_rows(camera, matches[near], R_cp))
    t = np.median((np.linalg.pinv(M) @ d[..., None])[..., 0], axis=0)
    for _ in range(SOLVING_ROUNDS):
        fits = camera.f * np.linalg.norm(d - M @ t, axis=1) / depth[near] < config.agreement
        t = np.linalg.lstsq(M[fits].reshape(-1, 3), d[fits].ravel())[0]
    return t, np.isin(np.arange(len(matches)), near[fits])


def from_current(before: Any, pair: Any, matches: Any, config: Any) -> Any:
    """Sub-pixel places with the feature on its whole pixel in the current left image."""
    return backwards(finish(pair, before, backwards(matches), config))


def backwards(m: Any) -> Any:
    """Matches with the current pair as the previous one."""
    return replace(
        m, prev_left=m.cur_left, prev_right=m.cur_right, cur_left=m.prev_left, cur_right=m.prev_right
    )


# Question, a setting or a function by its full name, and other answers.
OPEN: list[tuple[str, str, dict[str, Any]]] = [
    ("as published", "seed", {"": 0}),
    ("weights of rows", "vo_lib.paper.odometry.solve_translation", {"metres": in_metres}),
    ("largest depth", "translation.max_depth", {"20 m": 20.0, "50 m": 50.0, "none": 1000.0}),
    ("agreement", "translation.agreement", {"0.5 px": 0.5, "2 px": 2.0}),
    ("rounds", "vo_lib.paper.translation.SOLVING_ROUNDS", {"1": 1, "4": 4}),
    ("sub-pixel window", "matching.finish_window", {"7 px": 7, "21 px": 21}),
    ("place kept whole", "vo_lib.paper.matching.finish", {"current left": from_current}),
    ("features a bucket", "buckets.features", {"2": 2, "6": 6}),
    ("sets n", "selection.sets", {"50": 50, "800": 800}),
    ("solutions kept k", "selection.keep", {"1": 1, "all": 10}),
    ("inlier threshold", "selection.threshold", {"0.5 px": 0.5, "2 px": 2.0}),
    ("loop tolerance", "matching.loop_tolerance", {"0.2 px": 0.2, "1 px": 1.0}),
    ("boxes of", BOXES, {"the previous image": lambda m, p, c, config: in_boxes(m.prev_left, p, config)}),
    ("boxes of", BOXES, {"the current image": lambda m, p, c, config: in_boxes(m.cur_left, c, config)}),
    ("boxes of classes", "filter.classes", {"cars": (2,), "cars and trucks": (2, 7)}),
    ("boxes of score", "filter.score", {"0.1": 0.1, "0.5": 0.5}),
]


def measured(sequence: Sequence, name: str, value: Any, cache: Any) -> Array:
    """TE, RE (NaN without truth) and length of the path, metres, of each seed, (S, 3)."""
    own, config = name.startswith("vo_lib."), preset("feature_selection", variant="published")
    config = config if own else change(config, name, value)
    kept = None if value is from_current else CachedMatches(sequence, config, cache)
    with patch(name, value) if own else nullcontext():
        seeds = {str(seed): change(config, "seed", seed) for seed in range(5)}
        runs = [*run_methods(sequence, seeds, None, kept).values()]
    entry = sequence.truth is not None and measure_runs(name, runs, suitable_measure(sequence.truth))
    errors = [entry.te, entry.re] if entry else np.full((2, 5), np.nan)
    return np.stack([*errors, [trajectory_distances(run.poses)[-1] for run in runs]], axis=1)


def add_options(parser: argparse.ArgumentParser) -> None:
    """The options."""
    add_inputs(parser)
    parser.add_argument("--out", default="runs/choices.csv", metavar="FILE", help="the table")


def run(options: argparse.Namespace) -> int:
    """Run `published` as it is and with each other choice; write the differences."""
    workers = parse_whole("--jobs", options.jobs)
    tasks = [(s, *row[:2], *way) for s in open_all(options, 0.1) for row in OPEN for way in row[2].items()]
    calls = [(s, name, value, options.cache) for s, _, name, _, value in tasks]
    rows = [["choice", "alternative", "sequence", "te", "te_sd", "re", "re_sd", "length", "length_sd"]]
    with reporting(f"{len(tasks)} runs of five seeds") as report, loky.ProcessPoolExecutor(workers) as pool:
        for found in pool.map(measured, *zip(*calls, strict=True)):
            sequence, about, name, words, _ = tasks[len(rows) - 1]
            if name == "seed":
                path, plain = sequence.truth, np.array([0.0, 0.0, 100.0])
                whole = found[:, 2].mean() if path is None else trajectory_distances(path)[-1]
            found = found * [1.0, 1.0, 100.0 / whole]
            pairs = np.stack([(found - plain).mean(axis=0), (found - plain).std(axis=0)], axis=1).ravel()
            rows.append([about, words, sequence.name, *(f"{x:.4f}" if np.isfinite(x) else "" for x in pairs)])
            plain = found if name == "seed" else plain
            report(len(rows) - 1, len(tasks))
    write_atomic(options.out, csv_text(rows))
    say(f"written to {options.out}")
    return 0


if __name__ == "__main__":
    sys.exit(run_script(sys.modules[__name__]))
