"""Exercises of chapter 3: the angle, the k nearest, the truncated error, the selection, how many sets."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from ...beyond.selection import sample_sets
from ...core.geometry import essential_vector
from ...core.types import Array
from ...method.five_point import five_point
from ...method.selection import nearest_to_prior, truncated_errors
from ...synthetic.problems import random_problems
from .verdict import Wrong, as_array, as_number, exercise


@exercise
def angle(function: Callable[..., Any]) -> str:
    """A function (e1, e2) -> acos|e1ᵀ e2| in radians, for unit vectors of nine numbers."""
    e = essential_vector(random_problems(np.random.default_rng(1), 2).E)
    expected = float(np.arccos(abs(e[0] @ e[1])))
    got = as_number(function(e[0].copy(), e[1].copy()))
    if abs(np.radians(got) - expected) < 1e-9 or abs(got - np.degrees(expected)) < 1e-9:
        raise Wrong("this is in degrees.", "inside the code angles are radians.")
    if abs(got - expected) > 1e-9:
        raise Wrong(f"got {got:.4f}, expected {expected:.4f} rad.", "np.arccos of the absolute dot product.")
    flipped = as_number(function(e[0].copy(), -e[1]))
    if abs(flipped - expected) > 1e-9:
        raise Wrong("e and -e are the same essential matrix, but the angle differs.", "take |e1ᵀ e2|.")
    unit = np.full(9, 1.0 / 3.0 + 1e-16)
    with np.errstate(invalid="ignore"):
        same = as_number(function(unit, unit.copy()))
    if np.isnan(same):
        raise Wrong("equal vectors give NaN.", "rounding makes the product 1 + 1e-16: np.minimum(…, 1.0).")
    return "sign-free, and safe for equal vectors."


@exercise
def nearest(function: Callable[..., Any]) -> str:
    """A function (E, e_prev, k): one set's candidates (m, 3, 3) -> indices of the k nearest, in order."""
    given = random_problems(np.random.default_rng(2), 60, motion="forward")
    found = five_point(given.x_p, given.x_c)
    for s in range(60):
        E = found.E[found.set_index == s]
        if len(E) < 4:
            continue
        e_prev = essential_vector(given.E[(s + 1) % 60])
        angles = np.arccos(np.abs(essential_vector(E) @ e_prev))
        for k in (1, 2, 3):
            answer = function(E.copy(), e_prev.copy(), k)
            got = as_array(answer, (k,), f"the result for m = {len(E)}, k = {k}").astype(int)
            if np.array_equal(got, np.argsort(angles)[:k]):
                continue
            if np.array_equal(np.sort(got), np.sort(np.argsort(angles)[-k:])):
                raise Wrong("these are the farthest.", "acos falls where |eᵀ e_prev| rises: sort the angles.")
            if sorted(got) == sorted(np.argsort(angles)[:k]):
                raise Wrong("the right ones, but not the nearest first.", "np.argsort(angles)[:k].")
            raise Wrong(
                f"got {got.tolist()}, expected {np.argsort(angles)[:k].tolist()}.",
                "essential vectors have norm 1: is E made a unit vector of nine numbers first?",
            )
    return "as the library's `nearest_to_prior` has it, set by set."


@exercise
def truncated_error(function: Callable[..., Any]) -> str:
    """A function (d, threshold): distances (N,) -> mean of min(d² / threshold², 1)."""
    d = np.array([0.0, 0.5, -0.5, 1.0, -3.0, 50.0])
    expected = float(np.mean(np.minimum(d**2, 1.0)))
    got = as_number(function(d.copy(), 1.0))
    if abs(got - np.mean(d**2)) < 1e-9:
        raise Wrong("one wrong match decides everything.", "truncate each term at 1: np.minimum.")
    if abs(got - np.mean(np.abs(d) > 1.0)) < 1e-9:
        raise Wrong("this only counts outliers; inliers say more or less, too.", "d² / threshold² below 1.")
    if abs(got - np.mean(np.minimum(np.abs(d), 1.0))) < 1e-9:
        raise Wrong("these are distances, not squares.", "square d first.")
    if abs(got - expected) > 1e-9:
        raise Wrong(
            f"got {got:.4f}, expected {expected:.4f}.", "np.mean(np.minimum((d / threshold) ** 2, 1.0))."
        )
    if abs(as_number(function(2.0 * d, 2.0)) - expected) > 1e-9:
        raise Wrong("the threshold is not used.", "divide d by it.")
    return "a match never costs more than 1, however wrong it is."


@exercise
def select(function: Callable[..., Any]) -> str:
    """A function (E, set_index, errors, e_prev, k) -> index of the winner by solution selection."""
    for seed in range(8):
        E, set_index, errors, e_prev = _frame(seed)
        for k in (1, 2):
            kept = nearest_to_prior(E, set_index, e_prev, k)
            right = int(np.argmin(np.where(kept, errors, np.inf)))
            got = as_number(function(E.copy(), set_index.copy(), errors.copy(), e_prev.copy(), k))
            if got == right:
                continue
            angles = np.arccos(np.minimum(np.abs(essential_vector(E) @ e_prev), 1.0))
            if got == int(np.argmin(angles)):
                raise Wrong("this is the candidate nearest to e_prev.", "the image error has the last word.")
            if got == int(np.argmin(errors)):
                raise Wrong(
                    "this is consensus: the prior was not asked.", "only the k nearest of each set compete."
                )
            overall = np.argsort(angles)[:k]
            if got == int(overall[np.argmin(errors[overall])]):
                raise Wrong("only k candidates of all sets competed.", "keep the k nearest of each set.")
            raise Wrong(
                f"got {got:.0f}, expected {right} (k = {k}).", "is the index one into all candidates?"
            )
    return "the paper's section 2.2: k of each set by angle, then the smallest image error of all kept."


def _frame(seed: int) -> tuple[Array, Any, Array, Array]:
    """Candidates of a frame with half of the matches wrong, their image errors, and a rough prior."""
    rng = np.random.default_rng(seed)
    given = random_problems(rng, 1, 120, "forward", noise_px=0.5)
    x_p, x_c = given.x_p[0], given.x_c[0]
    x_c[:60] += rng.normal(0.0, 0.02, (60, 2))
    sets = sample_sets(rng, 120, 40)
    found = five_point(x_p[sets], x_c[sets])
    e_prev = essential_vector(given.E[0] + 0.2 * rng.normal(size=(3, 3)))
    return found.E, found.set_index, truncated_errors(found.E, x_p, x_c, 1.0 / 718.856), e_prev


@exercise
def sets_needed(answer: Any) -> str:
    """Sets to draw so that with 99 % one has only right matches, when 30 % of the matches are wrong."""
    value = as_number(answer)
    right = np.log(0.01) / np.log(1.0 - 0.7**5)
    if abs(value - np.log(0.01) / np.log(1.0 - 0.3**5)) < 2:
        raise Wrong("this is for 30 % right matches.", "a match is right with probability 0.7.")
    if abs(value - np.log(0.01) / np.log(0.3)) < 1.5:
        raise Wrong("one match is not enough.", "all five must be right: 0.7⁵.")
    if abs(value - right) > 1.0:
        raise Wrong(f"{value:.4g} is not it.", "(1 - 0.7⁵)ⁿ = 0.01, solved for n.")
    return f"{right:.1f}, so {int(np.ceil(right))} sets. n = 200 is for accuracy, not for safety alone."


@exercise
def consensus_fooled(facts: Mapping[str, float]) -> str:
    """The panel shows a winner by consensus that is more than 0.5° wrong."""
    error = facts.get("error by consensus", np.nan)
    if not error > 0.5:
        raise Wrong(
            f"consensus is still only {error:.3f}° wrong.",
            "raise the moving share: things that move together agree among themselves, wrong matches do not.",
        )
    selected = facts.get("error by selection", np.nan)
    return (
        f"consensus is {error:.2f}° wrong, selection {selected:.2f}°. What moves together votes as one. "
        "That is why chapter 5 takes it out before the vote."
    )
