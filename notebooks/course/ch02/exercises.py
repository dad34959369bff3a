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

from ..checker import Case, Exercise, Mistake

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
    lambda E, x_p, x_c: abs(signed_distance(E, x_p, x_c)),
    matches,
    atol=1e-12,
    task="A function (E, x_p, x_c) -> distance of x_c from the line E x_p, normalised units, for one match.",
    praise="this is the distance that the panel shows, there times f in pixels.",
    hint="distance = |a x + b y + c| / √(a² + b²).",
    library=("sampson_distance", "epipolar_line"),
    mistakes=(
        Mistake(
            "divided by a² + b².",
            "divide by its root.",
            lambda E, x_p, x_c: abs(signed_distance(E, x_p, x_c, power=2)),
        ),
        Mistake(
            "a distance is not negative.",
            "take the absolute value.",
            signed_distance,
            lambda *case: -abs(signed_distance(*case)),
        ),
        Mistake(
            "this is x_cᵀ E x_p, not yet a distance.",
            "divide by the length of the line's (a, b).",
            lambda E, x_p, x_c: abs(signed_distance(E, x_p, x_c, power=0)),
            lambda E, x_p, x_c: signed_distance(E, x_p, x_c, power=0),
        ),
        Mistake(
            "this is the line of the transposed E.",
            "the line in the current image is E x_p.",
            lambda E, x_p, x_c: abs(signed_distance(E.T, x_p, x_c)),
            lambda E, x_p, x_c: signed_distance(E.T, x_p, x_c),
        ),
        Mistake(
            "nearly: divided by the length of all three, (a, b, c).",
            "only the length of (a, b) counts: c says where the line is, not which way it runs.",
            lambda E, x_p, x_c: (
                abs(signed_distance(E, x_p, x_c, power=0)) / np.linalg.norm(E @ np.append(x_p, 1.0))
            ),
        ),
    ),
)

epipolar_rows = Exercise(
    rows,
    lambda: [five_matches(8)],
    atol=1e-12,
    task="A function (x_p, x_c), (5, 2) each -> A (5, 9) with A vec(E) = the five x_cᵀ E x_p.",
    praise="the same as the library's rows; with the true E, A vec(E) is 0.",
    hint="row by row as vec(E): x_cᵀ E x_p = Σ c_i E_ij p_j with p = (x, y, 1).",
    library=("epipolar_rows",),
    mistakes=(
        Mistake(
            "previous and current points have changed places.",
            "row: x_c[i] times x_p[j], i first.",
            lambda x_p, x_c: rows(x_c, x_p),
        ),
        Mistake(
            "the last column is right, others are not.",
            "np.outer(c, p).ravel() with c = (x_c, 1), p = (x_p, 1).",
            lambda x_p, x_c: rows(x_p, x_c)[:, [7, 6, 5, 4, 3, 2, 1, 0, 8]],
            when=lambda A, *case: np.allclose(A[:, 8], 1.0, atol=1e-12),
        ),
    ),
)

null_basis = Exercise(
    lambda A: np.linalg.svd(A)[2][5:],
    lambda: [(rows(*five_matches(9)),)],
    form=lambda basis: basis.T @ basis,
    task="A function A (5, 9) -> basis (4, 9) of its null space, orthonormal.",
    praise="and the true E lies in its span.",
    hint="the last four rows of Vᵀ from np.linalg.svd.",
    library=("null_space",),
    mistakes=(
        Mistake(
            "the four vectors are not orthonormal.",
            "rows of Vᵀ from np.linalg.svd are.",
            lambda A: 2.0 * np.linalg.svd(A)[2][5:],
            when=lambda basis, A: np.abs(basis @ basis.T - np.eye(4)).max() > 1e-9,
        ),
        Mistake(
            "A times the basis is not 0.",
            "the last four rows of Vᵀ belong to no singular value; full_matrices=True gives all nine.",
            lambda A: np.linalg.svd(A)[2][:4],
            when=lambda basis, A: np.abs(A @ basis.T).max() > 1e-9,
        ),
    ),
)

essential_constraints = Exercise(
    ten,
    essentials,
    also=(lambda E: ten(E, times=2.0),),
    form=lambda values: np.sort(np.abs(values)),
    task="A function E (3, 3) -> ten numbers that are all zero just for essential matrices.",
    praise="ten cubics in the entries of E; `cubic_constraints` writes them in x, y, z, w.",
    hint="nine entries of E Eᵀ E - ½ trace(E Eᵀ) E, and det E.",
    mistakes=(
        Mistake(
            "for a true E the first nine numbers are not all 0.",
            "E Eᵀ E - ½ trace(E Eᵀ) E.",
            lambda E: ten(E, half=1.0),
            when=lambda got, E: singular(E) and np.abs(got[:9]).max() > 1e-9,
        ),
        Mistake(
            "for a true E the tenth number is {got[9]:.3g}, not 0.",
            "the tenth is det E; is the order nine matrix entries, then det?",
            lambda E: np.append(ten(E)[:9], np.trace(E)),
            when=lambda got, E: singular(E) and abs(got[9]) > 1e-9,
        ),
        Mistake(
            "they vanish for true E, but not only for them.",
            "nine entries of the matrix equation, and det E.",
            lambda E: np.full(10, np.linalg.det(E)),
            when=lambda got, E: not singular(E),
        ),
    ),
)

solve_five = Exercise(
    solutions,
    lambda: [five_matches(seed) for seed in range(8)],
    form=in_line,
    atol=1e-4,
    task="A function (x_p, x_c), (5, 2) each -> all essential matrices through the five matches, (M, 3, 3).",
    praise=(
        "the same solutions as the library's, in any order, of any length and sign. Yours solves one set "
        "at a time, the library's hundreds at once."
    ),
    hint="are all real roots used, and does each give x and y from the null vector of C(z)?",
    library=("five_point", "findEssentialMat", "real_roots", "eliminate", "determinant", "back_substitute"),
    mistakes=(
        Mistake(
            "this is one of several solutions.",
            "give back all real ones: chapter 3 chooses.",
            lambda x_p, x_c: solutions(x_p, x_c)[:1],
            lambda x_p, x_c: solutions(x_p, x_c)[-1:],
            lambda x_p, x_c: solutions(x_p, x_c)[0],
        ),
        Mistake(
            "these are the transposes.",
            "vec(E) runs row by row: reshape(4, 3, 3), and the rows hold x_c[i] times x_p[j].",
            lambda x_p, x_c: solutions(x_p, x_c).swapaxes(1, 2),
            lambda x_p, x_c: solutions(x_c, x_p),
        ),
    ),
)

most_frequent_count = Exercise(
    most_frequent,
    task="The number of real solutions that sets of general motion have most often.",
    praise="{right} real solutions are the most frequent of 0, 2, 4, 6, 8 and 10.",
    hint="np.bincount(found.set_index) counts the solutions of each set.",
    mistakes=(
        Mistake(
            "odd numbers hardly ever occur.",
            "complex roots come in pairs, and the degree is 10.",
            3,
            when=lambda got: got % 2 != 0,
        ),
    ),
)

noise_factor = Exercise(
    growth,
    rtol=0.25,
    task="By what factor the median error of a set grows when the noise grows from 0.1 to 0.4 px.",
    praise="{right:.1f}: the error grows with the noise, nearly in proportion. Sub-pixel matches pay.",
    hint="median_error(0.4) / median_error(0.1) with the function given above.",
    mistakes=(Mistake("this is the inverse.", "the larger noise goes on top.", lambda: 1.0 / growth()),),
)

far_off = Exercise(
    {"rotation error of solution 1": 2.5, "solution": 1.0, "noise added": 0.0},
    task="The panel shows five noise-free matches whose best solution, number 1, is more than 2° wrong.",
    praise=(
        "{rotation error of solution 1:.1f}° from five real matches. Only the vote of all other matches "
        "unmasks such a set."
    ),
    hint="",
    mistakes=(
        Mistake(
            "there are {noise added:.2f} px of noise on the matches.",
            "noise 0: the five themselves shall be to blame.",
            {"noise added": 0.5},
            when=lambda facts: facts["noise added"] != 0,
        ),
        Mistake(
            (
                "solution {solution:.0f} is {rotation error of this solution:.1f}° wrong, but solution 1 "
                "of the same five only {rotation error of solution 1:.2f}°."
            ),
            "moving `solution` shows worse answers of the same five. Look for other five matches.",
            {"rotation error of solution 1": 0.1, "rotation error of this solution": 9.0, "solution": 2.0},
            when=lambda facts: facts["solution"] != 1 and not facts["rotation error of solution 1"] > 2.0,
        ),
        Mistake(
            (
                "the best solution of these five is {rotation error of solution 1:.2f}° wrong; wanted: "
                "more than 2°."
            ),
            ("press for other sets or type numbers: points close together, or on a moving car, tell little."),
            {"rotation error of solution 1": 0.1},
            when=lambda facts: not facts["rotation error of solution 1"] > 2.0,
        ),
    ),
)
