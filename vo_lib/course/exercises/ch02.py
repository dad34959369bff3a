"""Exercises of chapter 2: epipolar lines, the constraint matrix, null space, ten constraints, noise."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from ...core.geometry import decompose_essential, rotation_angle
from ...core.types import Array
from ...method.five_point import epipolar_rows as library_rows
from ...method.five_point import five_point
from ...synthetic.problems import random_problems
from .verdict import Wrong, as_array, as_number, differs, exercise

PROBLEMS = 500


@exercise
def epipolar_distance(function: Callable[..., Any]) -> str:
    """A function (E, x_p, x_c) -> distance of x_c from the line E x_p, normalised units, for one match."""
    given = random_problems(np.random.default_rng(7), 3, 1, noise_px=2.0)
    for E, (x_p,), (x_c,) in zip(given.E, given.x_p, given.x_c, strict=True):
        line = E @ np.append(x_p, 1.0)
        signed = float(line @ np.append(x_c, 1.0)) / float(np.linalg.norm(line[:2]))
        got = as_number(function(E.copy(), x_p.copy(), x_c.copy()))
        if abs(got - abs(signed)) < 1e-12:
            continue
        if abs(got + abs(signed)) < 1e-12:
            raise Wrong("a distance is not negative.", "take the absolute value.")
        if abs(abs(got) - abs(signed) * np.linalg.norm(line[:2])) < 1e-12:
            raise Wrong(
                "this is x_cᵀ E x_p, not yet a distance.", "divide by the length of the line's (a, b)."
            )
        other = E.T @ np.append(x_p, 1.0)
        mixed = abs(other @ np.append(x_c, 1.0)) / np.linalg.norm(other[:2])
        if abs(abs(got) - mixed) < 1e-12:
            raise Wrong("this is the line of the transposed E.", "the line in the current image is E x_p.")
        raise Wrong(f"got {got:.6f}, expected {abs(signed):.6f}.", "distance = |a x + b y + c| / √(a² + b²).")
    return "this is the distance that the panel shows, there times f in pixels."


@exercise
def epipolar_rows(function: Callable[..., Any]) -> str:
    """A function (x_p, x_c), (5, 2) each -> A (5, 9) with A vec(E) = the five x_cᵀ E x_p."""
    given = random_problems(np.random.default_rng(8), 1)
    x_p, x_c = given.x_p[0], given.x_c[0]
    expected = library_rows(x_p[None], x_c[None])[:, :, 0]
    got = as_array(function(x_p.copy(), x_c.copy()), (5, 9), "A")
    if not differs(got, expected, 1e-12):
        left = float(np.abs(got @ given.E[0].ravel()).max())
        return f"the same as the library's rows; the true E gives A vec(E) = 0 to within {left:.0e}."
    if not differs(got, library_rows(x_c[None], x_p[None])[:, :, 0], 1e-12):
        raise Wrong("previous and current points have changed places.", "row: x_c[i] times x_p[j], i first.")
    if not differs(got[:, 8], np.ones(5), 1e-12):
        raise Wrong(
            "the last column is right, others are not.",
            "np.outer(c, p).ravel() with c = (x_c, 1), p = (x_p, 1).",
        )
    raise Wrong(
        "the rows are not those of vec(E) row by row.", "x_cᵀ E x_p = Σ c_i E_ij p_j with p = (x, y, 1)."
    )


@exercise
def null_basis(function: Callable[..., Any]) -> str:
    """A function A (5, 9) -> basis (4, 9) of its null space, orthonormal."""
    given = random_problems(np.random.default_rng(9), 1)
    A = library_rows(given.x_p, given.x_c)[:, :, 0]
    got = as_array(function(A.copy()), (4, 9), "the basis")
    if differs(got @ got.T, np.eye(4), 1e-9):
        raise Wrong("the four vectors are not orthonormal.", "rows of Vᵀ from np.linalg.svd are.")
    left = float(np.abs(A @ got.T).max())
    if left > 1e-9:
        raise Wrong(
            f"A times the basis is {left:.2g}, not 0.",
            "the last four rows of Vᵀ belong to no singular value; full_matrices=True gives all nine.",
        )
    inside = np.linalg.norm(got @ given.E[0].ravel())
    return f"and the true E lies in its span: {100 * inside:.4f} % of its length."


@exercise
def essential_constraints(function: Callable[..., Any]) -> str:
    """A function E (3, 3) -> ten numbers that are all zero just for essential matrices."""
    rng = np.random.default_rng(10)
    given = random_problems(rng, 5)
    for E in given.E:
        got = as_array(function(E.copy()), (10,), "the result")
        if np.abs(got).max() > 1e-9:
            worst = int(np.argmax(np.abs(got)))
            hint = (
                "E Eᵀ E - ½ trace(E Eᵀ) E."
                if worst < 9
                else "the tenth is det E; is the order nine matrix entries, then det?"
            )
            raise Wrong(f"for a true E number {worst + 1} is {got[worst]:.3g}, not 0.", hint)
    other = rng.normal(size=(3, 3))
    got = np.sort(np.abs(as_array(function(other.copy()), (10,), "the result")))
    M = other @ other.T @ other - 0.5 * np.trace(other @ other.T) * other
    right = np.sort(np.abs(np.append(M.ravel(), np.linalg.det(other))))
    scale = got[-1] / right[-1]
    if scale == 0 or differs(got / scale, right, 1e-6 * right[-1]):
        raise Wrong(
            "they vanish for true E, but not only for them.",
            "nine entries of the matrix equation, and det E.",
        )
    return "ten cubics in the entries of E; `cubic_constraints` writes them in x, y, z, w."


@exercise
def most_frequent_count(answer: Any) -> str:
    """The number of real solutions that sets of general motion have most often."""
    value = as_number(answer)
    given = random_problems(np.random.default_rng(0), 2000)
    counts = np.bincount(five_point(given.x_p, given.x_c).set_index, minlength=2000)
    share = np.bincount(counts, minlength=11) / len(counts)
    right = int(np.argmax(share))
    if value % 2:
        raise Wrong("odd numbers hardly ever occur.", "complex roots come in pairs, and the degree is 10.")
    if value != right:
        raise Wrong(
            f"{value:.0f} solutions occur in {100 * share[min(int(value), 10)]:.0f} % of the sets.",
            "np.bincount(found.set_index) counts the solutions of each set.",
        )
    return f"{right} in {100 * share[right]:.0f} % of the sets; the mean is {counts.mean():.1f}."


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


@exercise
def noise_factor(answer: Any) -> str:
    """By what factor the median error of a set grows when the noise grows from 0.1 to 0.4 px."""
    value = as_number(answer)
    right = median_error(0.4) / median_error(0.1)
    if abs(value - 1.0 / right) < 0.1:
        raise Wrong("this is the inverse.", "the larger noise goes on top.")
    if abs(value - right) > 0.25 * right:
        raise Wrong(
            f"{value:.2g} is not it.", "median_error(0.4) / median_error(0.1) with the function given above."
        )
    return f"{right:.1f}: the error grows with the noise, nearly in proportion. Sub-pixel matches pay."


@exercise
def far_off(facts: Mapping[str, float]) -> str:
    """The panel shows five noise-free matches whose best solution is more than 2° wrong."""
    error, count = facts.get("rotation error of this solution", np.nan), facts.get("real solutions", 0)
    if not error > 2.0:
        raise Wrong(
            f"the solution shown is {error:.2f}° wrong, and there are {count:.0f}; wanted: more than 2°.",
            "press for other sets or type numbers: points close together, or on a moving car, tell little.",
        )
    return f"{error:.1f}° from five real matches. Only the vote of all other matches unmasks such a set."
