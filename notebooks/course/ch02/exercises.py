"""Exercises of chapter 2: epipolar lines, the constraint matrix, null space, ten constraints, noise."""

from __future__ import annotations

import functools
from typing import Any

import numpy as np

from vo_lib.core.geometry import decompose_essential, rotation_angle
from vo_lib.core.types import Array
from vo_lib.data.problems import random_problems
from vo_lib.method.five_point import epipolar_rows as library_rows
from vo_lib.method.five_point import five_point

from ..checker import Case, Exercise

PROBLEMS = 500


def matches() -> list[Case]:
    """Six times E and one noisy match."""
    given = random_problems(np.random.default_rng(7), 6, 1, noise_px=2.0)
    return list(zip(given.E, given.x_p[:, 0], given.x_c[:, 0], strict=True))


def signed_distance(E: Array, x_p: Array, x_c: Array, power: int = 1) -> float:
    """Distance of x_c from the line E x_p with its side as the sign; undivided with power 0."""
    line = E @ np.append(x_p, 1.0)
    return float(line @ np.append(x_c, 1.0) / np.linalg.norm(line[:2]) ** power)


def rows(x_p: Array, x_c: Array) -> Array:
    """The five rows (5, 9) of the epipolar constraint."""
    return np.asarray(library_rows(x_p[None], x_c[None])[:, :, 0])


def five_matches(seed: int) -> tuple[Array, Array]:
    """x_p and x_c (5, 2) of a random problem without noise."""
    given = random_problems(np.random.default_rng(seed), 1)
    return given.x_p[0], given.x_c[0]


def essentials() -> list[Case]:
    """Five essential matrices, and one that is none."""
    rng = np.random.default_rng(10)
    return [(E,) for E in (*random_problems(rng, 5).E, rng.normal(size=(3, 3)))]


def ten(E: Array, times: float = 1.0, half: float = 0.5) -> Array:
    """The ten constraints, the nine of the matrix `times` as large."""
    M = E @ E.T @ E - half * np.trace(E @ E.T) * E
    return np.append(times * M.ravel(), np.linalg.det(E))


def singular(E: Array) -> bool:
    """Whether E is one of the essential matrices of the cases."""
    return abs(float(np.linalg.det(E))) < 1e-9


def solutions(x_p: Array, x_c: Array) -> Array:
    """All essential matrices (M, 3, 3) through five matches, (5, 2) each."""
    return five_point(x_p[None], x_c[None]).E


def in_line(E: Array) -> Array:
    """Matrices as unit vectors (M, 9) in an order and with signs of their own, to be compared."""
    e = np.asarray(E, np.float64).reshape(-1, 9)
    e = e / np.linalg.norm(e, axis=1, keepdims=True)
    e = e * np.sign(e[np.arange(len(e)), np.abs(e).argmax(axis=1)])[:, None]
    return np.asarray(e[np.lexsort(np.round(e, 3).T)])


@functools.cache
def most_frequent() -> int:
    """The number of real solutions that most of 2000 sets have."""
    given = random_problems(np.random.default_rng(0), 2000)
    counts = np.bincount(five_point(given.x_p, given.x_c).set_index, minlength=2000)
    return int(np.argmax(np.bincount(counts)))


def median_error(noise_px: float) -> float:
    """Median over sets of the rotation error of the best candidate, degrees, at this noise."""
    given = random_problems(np.random.default_rng(0), PROBLEMS, motion="forward", noise_px=noise_px)
    found = five_point(given.x_p, given.x_c)
    return float(np.median(best_errors(found.E, found.set_index, given.E, given.R_cp)))


def best_errors(E: Array, set_index: Any, E_true: Array, R_true: Array) -> Array:
    """Rotation error, degrees, of the candidate nearest to the true E in each set that has one."""
    distance = 1.0 - np.abs(np.sum(E * E_true[set_index], axis=(1, 2)))
    order = np.lexsort((distance, set_index))
    sets, first = np.unique(set_index[order], return_index=True)
    R, _ = decompose_essential(E[order[first]])
    angles = rotation_angle(np.swapaxes(R, -1, -2) @ R_true[sets][:, None])
    return np.asarray(np.degrees(angles.min(axis=-1)))


@functools.cache
def growth() -> float:
    """The median error at 0.4 px divided by that at 0.1 px."""
    return median_error(0.4) / median_error(0.1)


epipolar_distance = Exercise(
    "ch02.epipolar_distance", lambda E, x_p, x_c: abs(signed_distance(E, x_p, x_c)), matches, atol=1e-12
)

epipolar_rows = Exercise("ch02.epipolar_rows", rows, lambda: [five_matches(8)], atol=1e-12)

null_basis = Exercise(
    "ch02.null_basis",
    lambda A: np.linalg.svd(A)[2][5:],
    lambda: [(rows(*five_matches(9)),)],
    form=lambda basis: basis.T @ basis,
)

essential_constraints = Exercise(
    "ch02.essential_constraints",
    ten,
    essentials,
    also=(lambda E: ten(E, times=2.0),),
    form=lambda values: np.sort(np.abs(values)),
)

solve_five = Exercise(
    "ch02.solve_five", solutions, lambda: [five_matches(seed) for seed in range(8)], form=in_line, atol=1e-4
)

most_frequent_count = Exercise("ch02.most_frequent_count", most_frequent)

noise_factor = Exercise("ch02.noise_factor", growth, rtol=0.25)

far_off = Exercise("ch02.far_off", {"rotation error of solution 1": 2.5, "solution": 1.0, "noise added": 0.0})
