"""Measure the effect of the choices that the paper leaves open.

examples:
  vo data measure_choices --detector yolov8n.onnx \\
      --sequences 00,01,kitti/drive_0013,synthetic/traffic,synthetic/jam

A row has the change of the results of variant `published` with an alternative
choice, as mean and standard deviation over five seeds; the change of the length
is in %. On real clips, TE is computed with fitted axes, as in `vo data
measure_axes`. Rows about thresholds and boxes have errors over 50 m. A second
call with the same --runs measures only what is missing.
"""

from __future__ import annotations

import argparse
import hashlib
import json
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any
from unittest.mock import patch

import loky
import numpy as np

from measure.axes import te_and_re
from measure_results import add_inputs, open_all
from vo_lib.commands.common import parse_jobs
from vo_lib.commands.console import print_wrapped, reporting
from vo_lib.config import change, preset
from vo_lib.data.catalogue import SYNTHETIC
from vo_lib.data.sequence import Sequence
from vo_lib.data.tables import csv_text
from vo_lib.evaluation.kitti_errors import SubsequenceProtocol, suitable_protocol, trajectory_distances
from vo_lib.evaluation.statistics import standard_deviation
from vo_lib.files import read_mapping, write_atomic
from vo_lib.geometry.motion import essential_vector
from vo_lib.geometry.types import Array
from vo_lib.paper.box_removal import in_boxes
from vo_lib.paper.matching import subpixel_matches
from vo_lib.paper.odometry import Winner
from vo_lib.paper.selection import candidates_near_prior, truncated_errors
from vo_lib.paper.settings import MethodConfig
from vo_lib.paper.translation import (
    SOLVING_ROUNDS,
    PairBefore,
    earlier_rows,
    eliminate_points,
    feature_rows,
)
from vo_lib.report.table1_plan import slug
from vo_lib.runs.drive import run_methods
from vo_lib.runs.folder import run_folder
from vo_lib.runs.identity import run_identity
from vo_lib.runs.match_cache import CachedMatches

SEEDS = 5
LOWEST_SCORE = 0.1  # of a detected box: an alternative has this score
COLUMNS = ["choice", "alternative", "sequence", "te", "te_sd", "re", "re_sd", "length", "length_sd", "frames"]
AS_PUBLISHED = "as published"  # in place of a setting: this row changes nothing
BOXES = "vo_lib.paper.box_removal.on_vehicles"
EARLIER = "vo_lib.paper.translation.earlier_rows"


# The functions below take the place of functions of the library, so they have the same parameters.


def in_metres(camera: Any, matches: Any, R_cp: Array, config: Any, before: Any = None) -> Any:
    """The result of `solve_translation` for two frames, with the rows of equation (3) in metres."""
    depth = camera.triangulate(matches.prev_left, matches.prev_right)[:, 2]
    near = np.flatnonzero(depth <= config.max_depth)
    M, d = eliminate_points(*feature_rows(camera, matches[near], R_cp))
    t_of_features = (np.linalg.pinv(M) @ d[..., None])[..., 0]
    t = np.median(t_of_features, axis=0)
    for _ in range(SOLVING_ROUNDS):
        residual = camera.f * np.linalg.norm(d - M @ t, axis=1) / depth[near]
        fits = residual < config.agreement
        t = np.linalg.lstsq(M[fits].reshape(-1, 3), d[fits].ravel())[0]
    return t, np.isin(np.arange(len(matches)), near[fits])


def from_current(before: Any, pair: Any, matches: Any, config: Any) -> Any:
    """The result of `subpixel_matches` with an integer position in the current left image, not the previous.

    The library's function goes from the previous to the current pair; here it goes back in time.
    """
    return backwards(subpixel_matches(pair, before, backwards(matches), config))


def backwards(matches: Any) -> Any:
    """The matches after an exchange of the previous and the current pair."""
    return replace(
        matches,
        prev_left=matches.cur_left,
        prev_right=matches.cur_right,
        cur_left=matches.prev_left,
        cur_right=matches.prev_right,
    )


def in_previous_boxes(matches: Any, boxes_p: Any, boxes_c: Any, config: Any) -> Any:
    """The result of `on_vehicles` with the boxes of the previous image alone."""
    return in_boxes(matches.prev_left, boxes_p, config)


def in_current_boxes(matches: Any, boxes_p: Any, boxes_c: Any, config: Any) -> Any:
    """The result of `on_vehicles` with the boxes of the current image alone."""
    return in_boxes(matches.cur_left, boxes_c, config)


def with_shifted_places(camera: Any, matches: Any, before: Any) -> Any:
    """The result of `earlier_rows` after a shift of each earlier match to the later match's integer pixel."""
    _, here, there = np.intersect1d(matches.id, before.matches.id, return_indices=True)
    now = matches[here]
    then = before.matches[there]
    shift = now.prev_left - then.cur_left
    shifted = replace(then, prev_left=then.prev_left + shift, prev_right=then.prev_right + shift)
    return earlier_rows(camera, matches, PairBefore(shifted, before.T_cp))


def mean_of_best_tenth(odometry: Any, E: Array, set_index: Any, x_p: Array, x_c: Array) -> Winner:
    """The result of `Odometry.select` if a mean wins: the principal vector of the best tenth of the sets.

    Of each set, its best candidate counts. The mean takes the place of the best candidate in E (M, 3, 3),
    since a winner is named by its index.
    """
    errors = truncated_errors(E, x_p, x_c, odometry.threshold)
    compete = candidates_near_prior(E, set_index, odometry.e_prev, odometry.config.selection)
    order = np.argsort(np.where(compete, errors, np.inf), kind="stable")
    _, first_of_set = np.unique(set_index[order], return_index=True)
    tenth = max(len(first_of_set) // 10, 1)
    best = order[np.sort(first_of_set)[:tenth]]
    principal = np.linalg.svd(essential_vector(E[best]), full_matrices=False)[2][0]
    # The nearest essential matrix has two equal singular values and a zero.
    U, _, Vt = np.linalg.svd(principal.reshape(3, 3))
    E[best[0]] = U[:, :2] @ Vt[:2] / np.sqrt(2)
    return Winner(int(best[0]))


# What is chosen, the name of its setting (or the full name of a function), and the alternatives: for each,
# its words in the table, and its value (or the function that takes the place of the named one).
OPEN: list[tuple[str, str, dict[str, Any]]] = [
    ("as published", AS_PUBLISHED, {"": None}),
    ("weights of rows", "vo_lib.paper.odometry.solve_translation", {"metres": in_metres}),
    ("largest depth", "translation.max_depth", {"20 m": 20.0, "50 m": 50.0, "none": 1000.0}),
    ("agreement", "translation.agreement", {"0.5 px": 0.5, "2 px": 2.0}),
    ("rounds", "vo_lib.paper.translation.SOLVING_ROUNDS", {"1": 1, "4": 4}),
    ("sub-pixel window", "matching.subpixel_window", {"7 px": 7, "21 px": 21}),
    ("pairs in the translation", "translation.pairs", {"2": 2}),
    ("positions of the previous pair", EARLIER, {"shifted to the whole pixel": with_shifted_places}),
    ("integer position", "vo_lib.paper.matching.subpixel_matches", {"current left": from_current}),
    ("features a bucket", "buckets.features", {"2": 2, "6": 6}),
    ("sets n", "selection.sets", {"50": 50, "800": 800}),
    ("solutions kept k", "selection.top_k", {"1": 1, "all": 10}),
    ("inlier threshold", "selection.threshold", {"0.25 px": 0.25, "1 px": 1.0, "2 px": 2.0}),
    ("measure of a candidate", "selection.winner", {"number of inliers": "inliers"}),
    ("basis vector", "vo_lib.paper.odometry.Odometry.select", {"mean of the best tenth": mean_of_best_tenth}),
    ("loop tolerance", "matching.loop_tolerance", {"0.2 px": 0.2, "1 px": 1.0}),
    ("boxes of", BOXES, {"the previous image": in_previous_boxes, "the current image": in_current_boxes}),
    ("boxes of classes", "filter.classes", {"cars": ("car",), "cars and trucks": ("car", "truck")}),
    ("boxes of score", "filter.score", {"0.1": 0.1, "0.5": 0.5}),
]
# Rows for a figure of chapter 5: errors, not differences, with all features and without features in boxes.
THRESHOLDS_PX = (0.25, 0.5, 1.0, 2.0)
RULES = {"all features": "none", "boxes removed": "all"}
ABSOLUTE = "threshold and boxes"
LENGTH_M = 50.0
ABSOLUTE_SEQUENCES = ("kitti/drive_0013", "synthetic/jam")


@dataclass(frozen=True, eq=False)
class Alternative:
    """An alternative to one of the choices, on one sequence.

    Attributes
    ----------
    choice : what is chosen, as in the table.
    name : the setting (dotted), or the full name of a function of vo_lib.
    words : the alternative, as in the table; empty for the method as published.
    value : the value of the setting, or the function that replaces the one of vo_lib.
    """

    sequence: Sequence
    choice: str
    name: str
    words: str
    value: Any

    @property
    def replaces_function(self) -> bool:
        """Whether the alternative is a function and not a value of a setting."""
        return self.name.startswith("vo_lib.")

    def config(self, seed: int) -> MethodConfig:
        """The settings of the runs."""
        config = preset("feature_selection", variant="published", seed=seed)
        if self.name == ABSOLUTE:
            threshold, rule = self.value
            return change(change(config, "selection.threshold", threshold), "filter.rule", rule)
        if self.name == AS_PUBLISHED or self.replaces_function:
            return config
        return change(config, self.name, self.value)

    @property
    def measure(self) -> SubsequenceProtocol:
        """The sub-sequences of the errors."""
        if self.name == ABSOLUTE:
            return SubsequenceProtocol((LENGTH_M,), 1)
        return suitable_protocol(self.sequence.true_poses)

    def in_place(self) -> AbstractContextManager[Any]:
        """While this is open, the alternative's function is in the place of the library's."""
        if self.replaces_function:
            return patch(self.name, self.value)
        return nullcontext()

    def stored_in(self, folder: Path) -> Path:
        """The file of the results in a folder for runs."""
        name = f"{self.choice} {self.words}".strip()
        return folder / slug(self.sequence.name) / f"{slug(name)}.json"

    def identity(self) -> dict[str, Any]:
        """All that determines the results: the run, the alternatives' code and the sub-sequences."""
        code = hashlib.sha256(Path(__file__).read_bytes()).hexdigest()
        identity = run_identity(self.sequence, self.config(0), "feature_selection")
        return identity | {"choice": [self.choice, self.name, self.words], "seeds": SEEDS, "choices": code}


def measured(alternative: Alternative, cache: Any) -> Array:
    """TE (%), RE (deg/100 m) and path length (metres) for each seed, (S, 3); errors are NaN without truth."""
    sequence = alternative.sequence
    configs = {str(seed): alternative.config(seed) for seed in range(SEEDS)}
    # A cache knows the settings of the matches, but not that a function of the front end is another one.
    match_cache = None
    if alternative.value is not from_current:
        match_cache = CachedMatches(sequence, alternative.config(0), cache)
    with alternative.in_place():
        runs = list(run_methods(sequence, configs, None, match_cache).values())
    lengths = [trajectory_distances(run.poses)[-1] for run in runs]
    errors = np.full((SEEDS, 2), np.nan)
    if sequence.truth is not None:
        turned = not sequence.name.startswith(SYNTHETIC)
        measure = alternative.measure
        errors = np.array([te_and_re(sequence, run.poses, measure, turned) for run in runs])
    return np.column_stack([errors, lengths])


def stored_or_measured(alternative: Alternative, cache: Any, folder: Path) -> Array:
    """The results of `measured`, read from `folder` if they were measured with the same inputs."""
    path = alternative.stored_in(folder)
    identity = alternative.identity()
    stored = read_mapping(path, "results of a choice") if path.exists() else {}
    if stored.get("identity") == identity:
        return np.array(stored["results"], dtype=float)  # None becomes NaN
    results = measured(alternative, cache)
    numbers = [[x if np.isfinite(x) else None for x in row] for row in results.tolist()]
    path.parent.mkdir(parents=True, exist_ok=True)
    write_atomic(path, json.dumps({"identity": identity, "results": numbers}, indent=1))
    return results


def alternatives_on(sequence: Sequence) -> list[Alternative]:
    """All alternatives on a sequence, the method as published first."""
    found = []
    for choice, name, values in OPEN:
        for words, value in values.items():
            found.append(Alternative(sequence, choice, name, words, value))
    if sequence.name in ABSOLUTE_SEQUENCES:
        for px in THRESHOLDS_PX:
            for words, rule in RULES.items():
                both = f"{px:g} px, {words}"
                found.append(Alternative(sequence, ABSOLUTE, ABSOLUTE, both, (px, rule)))
    return found


def row_of(alternative: Alternative, results: Array, published: Array) -> list[str]:
    """The row of the table: the changes of the results against those as published, both from `measured`.

    The first row of a sequence has the errors as published, and the excess length; rows about thresholds and
    boxes have errors, not changes.
    """
    sequence = alternative.sequence
    if sequence.truth is None:
        whole_length = published[:, 2].mean()
    else:
        whole_length = trajectory_distances(sequence.truth)[-1]
    percent = np.array([1.0, 1.0, 100.0 / whole_length])  # lengths in % of the whole length
    values = results * percent
    if alternative.name == ABSOLUTE:
        values[:, 2] = np.nan
    elif alternative.name == AS_PUBLISHED:
        values[:, 2] -= 100.0
    else:
        values -= published * percent
    pairs = np.stack([values.mean(axis=0), standard_deviation(values)], axis=1).ravel()
    numbers = [f"{x:.4f}" if np.isfinite(x) else "" for x in pairs]
    return [alternative.choice, alternative.words, sequence.name, *numbers, str(len(sequence))]


def add_options(parser: argparse.ArgumentParser) -> None:
    """The options."""
    add_inputs(parser)
    parser.add_argument("--runs", default="runs/choices", metavar="DIR", help="folder for the results")
    parser.add_argument("--out", default="runs/choices.csv", metavar="FILE", help="CSV file of the table")


def run(options: argparse.Namespace) -> int:
    """Run variant `published` unchanged and with each alternative choice; write the differences."""
    alternatives = []
    for sequence in open_all(options, LOWEST_SCORE):
        alternatives += alternatives_on(sequence)
    workers = parse_jobs(options.jobs)
    rows = [COLUMNS]
    with (
        run_folder(options.runs) as folder,
        reporting(f"{len(alternatives)} runs of five seeds") as report,
        loky.ProcessPoolExecutor(workers) as pool,
    ):
        measure = partial(stored_or_measured, cache=options.cache, folder=folder)
        published = np.empty((SEEDS, 3))
        for alternative, results in zip(alternatives, pool.map(measure, alternatives), strict=True):
            if alternative.name == AS_PUBLISHED:
                published = results
            rows.append(row_of(alternative, results, published))
            report(len(rows) - 1, len(alternatives))
    write_atomic(options.out, csv_text(rows))
    print_wrapped(f"written to {options.out}")
    return 0
