"""Exercises of chapter 3: the angle, the k nearest, the truncated error, the selection, how many sets."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from course.simulation.problems import random_problems
from vo_lib.geometry.motion import essential_vector
from vo_lib.geometry.types import Array, BoolArray
from vo_lib.kit.selection import sample_sets
from vo_lib.paper.five_point import five_point
from vo_lib.paper.selection import nearest_to_prior, truncated_errors

from ..ch02.panel import first_of_each_set
from ..checker import Case, Exercise


def vectors() -> list[Case]:
    """Two essential vectors, one with its sign changed, and a vector whose square is 1 + 1e-16."""
    e = essential_vector(random_problems(np.random.default_rng(1), 2).E)
    unit = np.full(9, 1.0 / 3.0 + 1e-16)
    return [(e[0], e[1]), (e[0], -e[1]), (unit, unit.copy())]


def arc(e1: Array, e2: Array) -> float:
    """The angle of two essential vectors, radians."""
    return float(np.arccos(min(abs(float(e1 @ e2)), 1.0)))


def candidates() -> list[Case]:
    """Candidates of any length and sign, a prior and k = 2, 3, 1, for every set with four or more."""
    rng = np.random.default_rng(2)
    given = random_problems(rng, 60, motion="forward")
    found = five_point(given.x_p, given.x_c)
    E = found.E * rng.uniform(0.5, 2.0, (len(found.E), 1, 1)) * rng.choice([-1, 1], (len(found.E), 1, 1))
    sets = [(s, E[found.set_index == s]) for s in range(60)]
    return [
        (E, essential_vector(given.E[(s + 1) % 60]), k) for s, E in sets if len(E) >= 4 for k in (2, 3, 1)
    ]


def angles(E: Array, e_prev: Array) -> Array:
    """Angles (M,) of candidates to the prior, radians."""
    return np.asarray(np.arccos(np.minimum(np.abs(essential_vector(E) @ e_prev), 1.0)))


def first_by(measure: Callable[[Array, Array], Array]) -> Callable[..., Any]:
    """The k candidates that come first by a measure of (E, e_prev)."""
    return lambda E, e_prev, k: np.argsort(measure(E, e_prev), kind="stable")[:k]


def frames() -> list[Case]:
    """Candidates of frames with half of the matches wrong, their image errors and a rough prior, k = 1, 2.

    The winner is in the first set or in the last one, frame by frame.
    """
    cases: list[Case] = []
    for seed in range(8):
        rng = np.random.default_rng(seed)
        given = random_problems(rng, 1, 120, "forward", noise_px=0.5)
        x_p, x_c = given.x_p[0], given.x_c[0]
        x_c[:60] += rng.normal(0.0, 0.02, (60, 2))
        sets = sample_sets(rng, 120, 40)
        E, set_index = five_point(x_p[sets], x_c[sets])
        e_prev = essential_vector(given.E[0] + 0.2 * rng.normal(size=(3, 3)))
        errors = truncated_errors(E, x_p, x_c, 1.0 / 718.856)
        for k in (1, 2):
            won = set_index[selected(E, set_index, errors, e_prev, k)]
            turned = (set_index - won - seed % 2) % 40
            order = np.argsort(turned, kind="stable")
            cases.append((E[order], turned[order], errors[order], e_prev, k))
    return cases


def least(values: Array, allowed: BoolArray) -> int:
    """Index of the smallest value that is allowed."""
    return int(np.argmin(np.where(allowed, values, np.inf)))


def selected(E: Array, set_index: Any, errors: Array, e_prev: Array, k: int) -> int:
    """Solution selection: of the k nearest of each set the one with the smallest image error."""
    return least(errors, nearest_to_prior(E, set_index, e_prev, k))


def of_winners(E: Array, set_index: Any, errors: Array, e_prev: Array, k: int) -> int:
    """Of the right winners of the sets the one nearest to e_prev."""
    competing = np.where(nearest_to_prior(E, set_index, e_prev, k), errors, np.inf)
    return least(angles(E, e_prev), first_of_each_set(competing, set_index, 1))


def sets_for(good: float) -> float:
    """Sets until one has only right matches with 99 %, when all five are right with a probability `good`."""
    return float(np.log(0.01) / np.log(1.0 - good))


def truncated(
    cost: Callable[[Array, float], Any] = lambda d, tau: np.minimum((d / tau) ** 2, 1.0),
    mean: Callable[..., Any] = np.mean,
) -> Callable[[Array, float], Any]:
    """The mean of a cost of (distances, threshold)."""
    return lambda d, threshold: mean(cost(d, threshold))


angle = Exercise(
    arc,
    vectors,
    task="A function (e1, e2) -> acos|e1ᵀ e2| in radians, for unit vectors of nine numbers.",
    praise="sign-free, and safe for equal vectors.",
    hint="the formula above: the dot product, its absolute value, the arc cosine.",
    line="np.arccos(min(abs(e1 @ e2), 1))",
    library=("essential_angle",),
    slips={"degrees": "this is in degrees; inside the code angles are radians."},
    mistakes={
        "this is the cosine, not yet the angle.": lambda e1, e2: abs(e1 @ e2),
        "e and -e are the same essential matrix, but the angle differs.": lambda a, b: np.arccos(
            min(a @ b, 1)
        ),
        "NaN for equal vectors: rounding makes the product 1 + 1e-16.": lambda a, b: np.arccos(abs(a @ b)),
    },
)

nearest = Exercise(
    first_by(angles),
    candidates,
    task="A function (E, e_prev, k): one set's candidates (m, 3, 3) -> indices of the k nearest, in order.",
    praise="as the library's `nearest_to_prior` has it, set by set.",
    hint="one angle for each candidate; the order of the angles is the order of the candidates.",
    line="np.argsort(np.arccos(np.minimum(np.abs(essential_vector(E) @ e_prev), 1)))[:k]",
    library=("nearest_to_prior", "essential_angle"),
    mistakes={
        "these are the farthest: acos falls where |eᵀ e_prev| rises.": (
            first_by(lambda E, e: -angles(E, e)),
            lambda E, e_prev, k: np.argsort(angles(E, e_prev))[-k:],
        ),
        "all candidates in the right order; only the first k are wanted.": lambda E, e, k: np.argsort(
            angles(E, e)
        ),
        "a candidate is taken for far because its sign differs: E and -E are the same.": first_by(
            lambda E, e: -(essential_vector(E) @ e)
        ),
        "long candidates are taken for near: E has no fixed length, an essential vector has norm 1.": (
            first_by(lambda E, e: -np.abs(E.reshape(-1, 9) @ e)),
            first_by(lambda E, e: np.arccos(np.clip(np.abs(E.reshape(-1, 9) @ e), 0, 1))),
        ),
    },
    slips={"order": "the right ones, but not the nearest first."},
)

truncated_error = Exercise(
    truncated(),
    lambda: [(t * np.array([0.0, 0.5, -0.5, 0.9, -3.0, 50.0]), t) for t in (1.0, 2.0)],
    task="A function (d, threshold): distances (N,) -> mean of min(d² / threshold², 1).",
    praise="a match never costs more than 1, however wrong it is.",
    hint="each match has a cost of its own, from 0 to 1; the error is their mean.",
    line="np.mean(np.minimum((d / threshold) ** 2, 1))",
    library=("truncated_errors",),
    mistakes={
        "this is the sum, which grows with the number of matches.": truncated(mean=np.sum),
        "one wrong match decides everything: no term may exceed 1.": truncated(lambda d, tau: (d / tau) ** 2),
        "wrong matches are left out here; they should cost 1 each.": (
            truncated(lambda d, tau: (d[np.abs(d) <= tau] / tau) ** 2),
            truncated(lambda d, tau: (d / tau * (np.abs(d) <= tau)) ** 2),
        ),
        "this only counts outliers; inliers differ as well.": truncated(lambda d, tau: np.abs(d) > tau),
        "the terms are not d² / threshold²: how many thresholds is a match away, and that squared?": (
            truncated(lambda d, tau: np.minimum(np.abs(d / tau), 1.0)),
            truncated(lambda d, tau: np.minimum(d**2, tau**2)),
            truncated(lambda d, tau: np.minimum(d**2, 1.0)),
            truncated(lambda d, tau: np.minimum(d**2 / tau, 1.0)),
        ),
        "the mean is truncated here, not each of its terms.": lambda d, tau: min(np.mean((d / tau) ** 2), 1),
    },
)

select = Exercise(
    selected,
    frames,
    task="A function (E, set_index, errors, e_prev, k) -> index of the winner by solution selection.",
    praise="the paper's section 2.2: k of each set by angle, then the smallest image error of all kept.",
    hint="set by set: which candidates are its members, and which k of these are nearest to e_prev?",
    line="members = np.flatnonzero(set_index == s); kept += [*members[nearest(E[members], e_prev, k)]]",
    library=("nearest_to_prior", "choose"),
    mistakes={
        "this counts among the kept candidates, or within a set; the index is one into all candidates.": (
            lambda E, s, errors, e, k: np.argmin(errors[nearest_to_prior(E, s, e, k)]),
            lambda E, s, *case: (i := selected(E, s, *case)) - np.searchsorted(s, s[i]),
        ),
        "this is the nearest to e_prev; the image error has the last word.": lambda E, s, error, e, k: (
            np.argmin(angles(E, e))
        ),
        "this is consensus: the prior was not asked who may compete.": lambda E, s, error, *_: np.argmin(
            error
        ),
        "`k` is not used: it is not always 2.": (
            lambda E, s, error, e, k: selected(E, s, error, e, 2),
            lambda E, s, error, e, k: selected(E, s, error, e, 1),
        ),
        "prior and image error have changed places: the angle decides who may compete, the error who wins.": (
            lambda E, s, errors, e, k: least(angles(E, e), first_of_each_set(errors, s, k))
        ),
        "among the winners of the sets the nearest was taken; the image error decides there, too.": of_winners,
        "the last set is left out: range(n) ends with n - 1.": lambda E, s, errors, e, k: least(
            errors, nearest_to_prior(E, s, e, k) & (s < s.max())
        ),
        "only k candidates of all sets competed; k of each set may.": lambda E, s, errors, e, k: least(
            errors, first_of_each_set(angles(E, e), 0 * s, k)
        ),
    },
)

sets_needed = Exercise(
    26.0,
    also=(sets_for(0.7**5),),
    atol=0.02,
    task="Sets to draw so that with 99 % one has only right matches, when 30 % of the matches are wrong.",
    praise="(1 - 0.7⁵)ⁿ = 0.01 gives n = 25.03, so 26 sets. n = 200 is for accuracy, not for safety alone.",
    hint="how probable is it that one set is good, that it is not, and that n sets in a row are not?",
    line="np.log(0.01) / np.log(1 - 0.7**5)",
    mistakes={
        "25 sets give 98.995 %, a hair less than wanted.": 25,
        "this is for 30 % right matches.": np.ceil(sets_for(0.3**5)),
        "one match is not enough: all five must be right.": (sets_for(0.7), np.ceil(sets_for(0.7))),
        "this is as if the sets shared their luck: they fail, each by itself, all n of them.": (
            0.99 / 0.7**5,
            1 / 0.7**5,
        ),
    },
)

consensus_fooled = Exercise(
    {"error by consensus": 2.0, "error by selection": 2.0, "disturbed": 170.0},
    task="The panel shows a winner by consensus that is more than 0.5° wrong, by matches that were disturbed.",
    praise="consensus is {error by consensus:.2f}° wrong, selection {error by selection:.2f}°. What moves "
    "together votes as one. That is why chapter 5 takes it out before the vote.",
    mistakes={
        "consensus is still only {error by consensus:.3f}° wrong. Which matches agree among themselves: wrong "
        "ones, or those on one thing that moves?": lambda now: not now["error by consensus"] > 0.5,
        "no match is disturbed: here the noise chose between the two solutions of a plane. Untick it, and fool "
        "the vote with matches that agree among themselves.": lambda now: not now["disturbed"] > 0,
    },
)
