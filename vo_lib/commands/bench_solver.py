"""Speed and precision of the five-point solver beside OpenCV's and, where installed, PoseLib's."""

from __future__ import annotations

import importlib
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import cv2
import numpy as np

from ..core.geometry import essential_from_motion
from ..core.types import Array
from ..method.five_point import Candidates, five_point
from ..runs.runner import one_blas_thread
from ..synthetic.problems import Motion, PoseProblems, random_problems

BATCHES = (200, 1000)
ONE_BY_ONE = 100  # sets for solvers that take one at a time
PRECISION_MOTIONS: tuple[Motion, ...] = ("general", "forward", "planar_forward")
LOST = 1e-6  # a best candidate farther from the truth than this counts as imprecise

# All essential matrices that fit five matches x_p, x_c (5, 2), as (M, 3, 3).
Solver = Callable[[Array, Array], Array]


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


def poselib_solver() -> Solver | None:
    """PoseLib's solver, or None where PoseLib is not installed. It returns motions, up to ten."""
    try:
        poselib: Any = importlib.import_module("poselib")
    except ImportError:
        return None

    def solve(x_p: Array, x_c: Array) -> Array:
        ray_p, ray_c = (np.concatenate([x, np.ones((5, 1))], axis=1) for x in (x_p, x_c))
        unit_p, unit_c = (ray / np.linalg.norm(ray, axis=1, keepdims=True) for ray in (ray_p, ray_c))
        motions = poselib.relpose_5pt(unit_p, unit_c)
        return np.array([essential_from_motion(m.R, m.t) for m in motions]).reshape(-1, 3, 3)

    return solve


def microseconds_a_set(repeats: int) -> dict[str, float]:
    """Least time of several of one five-point set, one thread; by solver and batch, noise of 0.3 px."""
    times: dict[str, float] = {}
    with one_blas_thread():
        for batch in BATCHES:
            given = random_problems(np.random.default_rng(1), batch, 5, "forward", noise_px=0.3)
            seconds = least_seconds(partial(five_point, given.x_p, given.x_c), repeats)
            times[f"this kit, batch of {batch}"] = 1e6 * seconds / batch
        others = {"OpenCV findEssentialMat": solve_opencv, "PoseLib relpose_5pt": poselib_solver()}
        given = random_problems(np.random.default_rng(1), ONE_BY_ONE, 5, "forward", noise_px=0.3)
        for name, solver in others.items():
            if solver is not None:
                seconds = least_seconds(partial(_one_by_one, solver, given), max(repeats // 4, 1))
                times[name] = 1e6 * seconds / ONE_BY_ONE
    return times


def _one_by_one(solver: Solver, given: PoseProblems) -> list[Array]:
    return [solver(x_p, x_c) for x_p, x_c in zip(given.x_p, given.x_c, strict=True)]


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
    """Precision of this kit over `ours` problems of each motion, and of the others over `theirs`."""
    rows = []
    solvers: dict[str, Solver | None] = {"OpenCV": solve_opencv, "PoseLib": poselib_solver()}
    for motion in PRECISION_MOTIONS:
        rows.append(_precision("this kit", motion, _our_errors(motion, ours)))
        for name, solver in solvers.items():
            if solver is not None and theirs:
                given = random_problems(np.random.default_rng(1), theirs, 5, motion)
                pairs = zip(_one_by_one(solver, given), given.E, strict=True)
                errors = [_nearest(E, truth) for E, truth in pairs]
                rows.append(_precision(name, motion, np.array(errors)))
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
