"""Speed and precision of the five-point solver beside OpenCV's."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import cv2
import numpy as np

from ..core.types import Array
from ..data.problems import Motion, PoseProblems, random_problems
from ..method.five_point import Candidates, five_point
from ..runs.runner import single_threaded

BATCHES = (200, 1000)
ONE_BY_ONE = 100  # sets for OpenCV, which takes one at a time
PRECISION_MOTIONS: tuple[Motion, ...] = ("general", "forward", "planar_forward")
LOST = 1e-6  # a best candidate farther from the truth than this counts as imprecise


@dataclass(frozen=True)
class Precision:
    """Distance of the best candidate to the truth, ‖E - E*‖ of unit matrices, over noise-free problems."""

    solver: str
    motion: str
    problems: int
    median: float
    percentile_95: float
    share_imprecise: float


def solve_opencv(x_p: Array, x_c: Array) -> Array:
    """OpenCV's candidates; with five matches `findEssentialMat` returns them all."""
    stacked, _ = cv2.findEssentialMat(x_p, x_c, np.eye(3))
    return np.empty((0, 3, 3)) if stacked is None else np.asarray(stacked, np.float64).reshape(-1, 3, 3)


def microseconds_a_set(repeats: int) -> dict[str, float]:
    """Least time of several of one five-point set, one thread; by solver and batch, noise of 0.3 px."""
    times: dict[str, float] = {}
    with single_threaded():
        for batch in BATCHES:
            given = random_problems(np.random.default_rng(1), batch, 5, "forward", noise_px=0.3)
            seconds = least_seconds(partial(five_point, given.x_p, given.x_c), repeats)
            times[f"this kit, batch of {batch}"] = 1e6 * seconds / batch
        given = random_problems(np.random.default_rng(1), ONE_BY_ONE, 5, "forward", noise_px=0.3)
        seconds = least_seconds(partial(_by_opencv, given), max(repeats // 4, 1))
        times["OpenCV findEssentialMat"] = 1e6 * seconds / ONE_BY_ONE
    return times


def _by_opencv(given: PoseProblems) -> list[Array]:
    return [solve_opencv(x_p, x_c) for x_p, x_c in zip(given.x_p, given.x_c, strict=True)]


def least_seconds(function: Callable[[], Any], repeats: int) -> float:
    """The shortest of several runs, after one that is not counted: the least disturbed by other work."""
    function()
    best = np.inf
    for _ in range(repeats):
        start = time.perf_counter()
        function()
        best = min(best, time.perf_counter() - start)
    return best


def precision(ours: int, theirs: int) -> list[Precision]:
    """Precision of this kit over `ours` problems of each motion, and of OpenCV over `theirs`."""
    rows = []
    for motion in PRECISION_MOTIONS:
        rows.append(_precision("this kit", motion, _our_errors(motion, ours)))
        given = random_problems(np.random.default_rng(1), theirs, 5, motion)
        errors = [_nearest(E, truth) for E, truth in zip(_by_opencv(given), given.E, strict=True)]
        rows.append(_precision("OpenCV", motion, np.array(errors)))
    return rows


def _our_errors(motion: Motion, count: int, chunk: int = 1000) -> Array:
    errors = []
    for first in range(0, count, chunk):
        number = min(chunk, count - first)
        given = random_problems(np.random.default_rng([7, first]), number, 5, motion)
        errors.append(error_of_best(five_point(given.x_p, given.x_c), given.E))
    return np.concatenate(errors)


def error_of_best(found: Candidates, truth: Array) -> Array:
    """Distance of the nearest candidate to the truth (S, 3, 3) in each set, (S,); infinite without any."""
    error = np.full(len(truth), np.inf)
    np.minimum.at(error, found.set_index, distance(found.E, truth[found.set_index]))
    return error


def distance(E: Array, F: Array) -> Array:
    """‖E - F‖ of unit matrices (..., 3, 3), whatever their signs."""
    gaps = [np.linalg.norm(E + sign * F, axis=(-2, -1)) for sign in (-1.0, 1.0)]
    return np.asarray(np.minimum(*gaps))


def _nearest(E: Array, truth: Array) -> float:
    unit = E / np.linalg.norm(E, axis=(1, 2), keepdims=True)
    return float(np.min(distance(unit, truth[None]), initial=np.inf))


def _precision(solver: str, motion: str, errors: Array) -> Precision:
    # A set without any candidate counts as imprecise; it must not make the percentiles infinite in JSON.
    finite = np.minimum(errors, 2.0)
    return Precision(
        solver,
        motion,
        len(errors),
        float(np.median(finite)),
        float(np.percentile(finite, 95)),
        float(np.mean(errors > LOST)),
    )
