"""Exercises of chapter 2: epipolar lines, the constraint matrix, null space, ten constraints, noise."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

import numpy as np

from course.simulation.problems import random_problems
from vo_lib.geometry.types import Array, Index
from vo_lib.paper.five_point import epipolar_rows as library_rows
from vo_lib.paper.five_point import five_point

from ..checker import Case, Condition, Exercise
from .panel import first_of_each_set, rotation_errors

FIRST = "rotation error of solution 1"


def matches() -> list[Case]:
    """Six cases, each with an E and one noisy match."""
    given = random_problems(np.random.default_rng(7), 6, 1, noise_px=2.0)
    return list(zip(given.E, given.x_p[:, 0], given.x_c[:, 0], strict=True))


def from_line(value: Callable[[float, Array], Any]) -> Callable[..., float]:
    """Answer built from a function `value` of the number x_cᵀ E x_p and of the line E x_p (3,)."""

    def measured(E: Array, x_p: Array, x_c: Array) -> float:
        line = E @ np.append(x_p, 1.0)
        return float(value(float(line @ np.append(x_c, 1.0)), line))

    return measured


distance = from_line(lambda value, line: abs(value) / np.hypot(*line[:2]))


def rows(x_p: Array, x_c: Array) -> Array:
    """The five rows (5, 9) of the epipolar constraint."""
    return np.asarray(library_rows(x_p[None], x_c[None])[:, :, 0])


def null_space(A: Array) -> Array:
    """An orthonormal basis (4, 9) of the null space of A (5, 9)."""
    return np.asarray(np.linalg.svd(A)[2][5:])


def five_matches(seed: int) -> tuple[Array, Array]:
    """x_p and x_c (5, 2) of a random problem without noise."""
    given = random_problems(np.random.default_rng(seed), 1)
    return given.x_p[0], given.x_c[0]


def essentials() -> list[Case]:
    """Five essential matrices and two other matrices: one of rank 2, one random."""
    rng = np.random.default_rng(10)
    E = random_problems(rng, 5).E
    return [(each,) for each in (*E, np.diag([1.0, 0.5, 1.0]) @ E[0], rng.normal(size=(3, 3)))]


def ten(E: Array, times: float = 1.0, half: float = 0.5) -> Array:
    """The ten constraints; `times` scales the nine constraints of the matrix, and `half` replaces ½."""
    M = E @ E.T @ E - half * np.trace(E @ E.T) * E
    return np.append(times * M.ravel(), np.linalg.det(E))


def up_to_scale(values: Array) -> Array:
    """Ones if the values are a case's ten constraints in any order and scale; else the values."""
    for nine, last in ((values[:9], values[9]), (values[1:], values[0])):  # the determinant is last, or first
        for constraints in (ten(E) for (E,) in essentials()[5:]):
            given = np.sort(np.abs(nine))
            right = np.sort(np.abs(constraints[:9]))
            scale = given[-1] / right[-1]
            determinant = np.isclose(abs(last), abs(constraints[9]) * np.array([0.5, 1.0, 2.0, scale])).any()
            if determinant and scale > 1e-9 and np.allclose(given, scale * right) and values.min() < 0.0:
                return np.ones(10)
    return np.asarray(values)


def solutions(x_p: Array, x_c: Array) -> Array:
    """All essential matrices (M, 3, 3) that fit five matches x_p, x_c (5, 2)."""
    return five_point(x_p[None], x_c[None]).E


def in_basis(E: Array, x_p: Array, x_c: Array) -> Array:
    """x, y, z (3, M) of matrices E (M, 3, 3) in the basis of `null_space`, with w = 1."""
    xyzw = np.reshape(E, (-1, 9)) @ null_space(rows(x_p, x_c)).T
    return np.asarray((xyzw[:, :3] / xyzw[:, 3:]).T)


def only_z_is_right(E: Array, x_p: Array, x_c: Array) -> bool:
    """Whether the matrices have the same z as the solutions."""
    got, right = (np.sort(in_basis(each, x_p, x_c)[2]) for each in (E, solutions(x_p, x_c)))
    return np.allclose(got, right, rtol=1e-3)


def in_line(E: Array) -> Array:
    """Matrices as unit vectors (M, 9) with a fixed order and fixed signs, for comparison."""
    e = np.asarray(E, np.float64).reshape(-1, 9)
    e = e / np.linalg.norm(e, axis=1, keepdims=True)
    e = e * np.sign(e[np.arange(len(e)), np.abs(e).argmax(axis=1)])[:, None]
    return np.asarray(e[np.lexsort(np.round(e, 3).T)])


@functools.cache
def counts() -> Index:
    """The number of real solutions of each of 2000 sets."""
    given = random_problems(np.random.default_rng(0), 2000)
    return np.bincount(five_point(given.x_p, given.x_c).set_index, minlength=2000)


@functools.cache
def median_error(noise_px: float) -> float:
    """Median rotation error of the best candidate of a set, degrees, with a noise of `noise_px` pixels."""
    given = random_problems(np.random.default_rng(0), 500, motion="forward", noise_px=noise_px)
    candidates = five_point(given.x_p, given.x_c)
    agreement = np.abs(np.sum(candidates.E * given.E[candidates.set_index], axis=(1, 2)))
    best = np.flatnonzero(first_of_each_set(-agreement, candidates.set_index))
    return float(np.median(rotation_errors(candidates.E[best], given.R_cp[candidates.set_index[best], None])))


epipolar_distance = Exercise(
    distance,
    matches,
    atol=1e-12,
    praise="multiplied by f, this is the distance in pixels that the panel shows.",
    hint="a, b and c are the three entries of E x_p, with x_p as (x, y, 1).",
    line="a, b, c = E @ [*x_p, 1]; abs(a * x_c[0] + b * x_c[1] + c) / np.hypot(a, b)",
    library=("sampson_distance", "epipolar_line"),
    mistakes={
        "a distance is not negative.": from_line(lambda value, line: value / np.hypot(*line[:2])),
        "this is x_cᵀ E x_p, not yet a distance: divide it by the length of (a, b).": (
            *map(from_line, (lambda value, line: abs(value), lambda value, line: value)),
        ),
        "the points are exchanged: x_p gives the line.": lambda E, x_p, x_c: distance(E, x_c, x_p),
        "this is the line of the transposed E.": lambda E, x_p, x_c: distance(E.T, x_p, x_c),
        "c is left out.": from_line(lambda value, line: abs(value - line[2]) / np.hypot(*line[:2])),
        "this is divided by the length of (a, b, c); the normal of the line is (a, b) alone.": from_line(
            lambda value, line: abs(value) / np.linalg.norm(line)
        ),
    },
)

epipolar_rows = Exercise(
    rows,
    lambda: [five_matches(8)],
    also=(lambda x_p, x_c: -rows(x_p, x_c),),
    atol=1e-12,
    praise="these are the library's rows; with the true E, A vec(E) is 0.",
    hint="x_cᵀ E x_p = Σ c_i E_ij p_j with c = (x_c, 1) and p = (x_p, 1): the factor of E_ij is c_i p_j.",
    line="np.outer(np.append(x_c[k], 1), np.append(x_p[k], 1)).ravel()",
    library=("epipolar_rows",),
    mistakes={
        "previous and current points have changed places.": lambda x_p, x_c: rows(x_c, x_p),
        "x and y are exchanged in both images.": lambda x_p, x_c: rows(x_p[:, ::-1], x_c[:, ::-1]),
        "`ravel` makes a row of nine numbers of each 3×3 matrix.": lambda *x: rows(*x).reshape(5, 3, 3),
        "the last column is right, others are not: look at the order of E's nine entries.": Condition(
            lambda A, *case: np.allclose(A[:, 8], 1.0, atol=1e-12)
        ),
    },
)

null_basis = Exercise(
    null_space,
    lambda: [(rows(*five_matches(9)),)],
    form=lambda basis: basis.T @ basis,
    praise="the true E is a combination of the four.",
    hint="A = U S Vᵀ has nine rows in Vᵀ but only five singular values; A maps the other four rows to 0.",
    line="np.linalg.svd(A)[2][5:]",
    library=("null_space",),
    mistakes={
        "these are columns of Vᵀ; its rows are the vectors.": lambda A: np.linalg.svd(A)[2][:, 5:],
        "these are the first four rows of Vᵀ, not the last four.": lambda A: np.linalg.svd(A)[2][:4],
        "A times the basis is not 0.": Condition(lambda basis, A: np.abs(A @ basis.T).max() > 1e-9),
        "the four vectors are not orthonormal.": Condition(lambda V, A: not np.allclose(V @ V.T, np.eye(4))),
    },
)

essential_constraints = Exercise(
    ten,
    essentials,
    also=(lambda E: ten(E, times=-3.0),),
    form=up_to_scale,
    praise="ten cubics in the entries of E; `cubic_constraints` writes them in x, y, z, w.",
    hint="the matrix equation gives nine numbers, one for each entry; the determinant is the tenth.",
    line="np.append((E @ E.T @ E - 0.5 * np.trace(E @ E.T) * E).ravel(), np.linalg.det(E))",
    mistakes={
        "the factor of the trace is not ½: the singular values (1, 1, 0) should give 0.": (
            *(lambda E, half=half: ten(E, half=half) for half in (0.25, 1.0, 2.0, -0.5)),
        ),
        "return the values of the equations themselves, with their signs.": lambda E: np.abs(ten(E)),
        "for an essential matrix the first nine numbers are not all 0: check the transposes and the trace.": Condition(
            lambda got, E: np.abs(ten(E)).max() < 1e-9 < np.abs(got[:9]).max()
        ),
        "for an essential matrix the tenth number is {got[9]:.3g}, not 0: the determinant of a matrix of rank 2 "
        "is 0.": Condition(lambda got, E: np.abs(ten(E)).max() < 1e-9 < abs(got[9])),
        "these ten numbers are 0 for every essential matrix, but for other matrices of rank 2, too.": Condition(
            lambda got, E: np.abs(got).max() < 1e-9 < np.abs(ten(E)).max()
        ),
    },
)

solve_five = Exercise(
    solutions,
    lambda: [five_matches(seed) for seed in range(8)],
    form=in_line,
    atol=1e-4,
    praise="these are the library's solutions; the library solves hundreds of sets at once.",
    hint="each real root z gives one solution: compute x and y from the null vector of C(z).",
    line="v = np.linalg.svd(C(z))[2][-1]; E = np.tensordot([v[3] / v[5], v[4] / v[5], z, 1], basis, axes=1)",
    library=("five_point", "findEssentialMat", "real_roots", "eliminate", "determinant", "back_substitute"),
    slips={"transposed": "these are the transposes: vec(E) runs row by row, and a row of A has x_c first."},
    mistakes={
        "this is one of several solutions; return all real solutions: chapter 3 selects one of them.": (
            *(lambda *x, some=some: solutions(*x)[some] for some in (slice(1), slice(-1, None), 0)),
        ),
        "every z is right, x and y are not. Either x and y are exchanged (the columns of C are those of x², y², xy, x, "
        "y, 1), or the null vector of C(z) is not divided by its last entry.": Condition(only_z_is_right),
        "these matrices do not fit the five matches: x_cᵀ E x_p is not 0. Is vec(E) read row by row, and are x_p and "
        "x_c in their places?": Condition(lambda E, *x: np.abs(rows(*x) @ in_line(E).T).max() > 1e-4),
        "these matrices fit the five matches, but some are not essential: the ten constraints do not hold.": Condition(
            lambda E, x_p, x_c: max(np.abs(ten(each.reshape(3, 3))).max() for each in in_line(E)) > 1e-4
        ),
    },
)

most_frequent_count = Exercise(
    lambda: np.argmax(np.bincount(counts())),
    praise="{right} real solutions are the most frequent number of 0, 2, 4, 6, 8 and 10.",
    hint="count the solutions of each set, then the sets with 0, 1, 2 … solutions.",
    line="np.argmax(np.bincount(np.bincount(solutions.set_index)))",
    mistakes={
        "this is the mean number; the task is the most frequent number.": lambda: counts().mean(),
        "this is the index of the set with the most solutions.": lambda: np.argmax(counts()),
        "this is a number of sets, not of solutions.": lambda: np.bincount(counts()).max(),
        "this is a share of the sets; the task is the number of solutions.": Condition(
            lambda got: 0 < got < 1
        ),
        "odd numbers hardly ever occur: complex roots come in pairs.": Condition(lambda got: got % 2 == 1),
    },
)

noise_factor = Exercise(
    lambda: median_error(0.4) / median_error(0.1),
    rtol=0.02,
    praise="{right:.2f}: the rotation error grows nearly in proportion to the noise.",
    hint="compute the median error at both noises and divide.",
    line="ch02.median_error(0.4) / ch02.median_error(0.1)",
    mistakes={
        "a factor is the larger error divided by the smaller, not the inverse and not the difference.": (
            Condition(lambda got: 0 < got < 1),
            lambda: median_error(0.4) - median_error(0.1),
        ),
        "this is the error at one noise.": (lambda: median_error(0.4), lambda: median_error(0.1)),
        "this is no measurement: measure the factor of the error.": Condition(lambda got: got in (3, 4)),
    },
)

far_off = Exercise(
    {FIRST: 2.5, "noise added": 0.0, "outliers among the five": 0.0, "closest two of the five": 50.0},
    praise="{rotation error of solution 1:.1f}° from five correct matches: small errors of their places become large "
    "errors of the rotation. Only the other matches show that this set is bad.",
    mistakes={
        "there is no ground truth: choose another sequence.": lambda now: np.isnan(now[FIRST]),
        "{noise added:.2f} px of noise are added: set the noise to 0.": lambda now: now["noise added"] != 0,
        "solution 1 of these five matches is only {rotation error of solution 1:.2f}° wrong; the task is more than 2°. "
        "The slider `solution` does not help: choose five other matches. Which matches determine the rotation "
        "badly?": lambda now: not now[FIRST] > 2.0,
        "outliers among the five: {outliers among the five:.0f}. One outlier makes a set bad; find five correct "
        "matches with a similar error.": lambda now: now["outliers among the five"] > 0,
        "two of the five are only {closest two of the five:.1f} px apart. Neighbours give nearly the same equation; find "
        "five matches at least 40 px apart.": lambda now: now["closest two of the five"] < 40,
    },
)
