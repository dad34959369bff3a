"""Exercises of chapter 3: the angle, the k nearest, the truncated error, the selection, how many sets."""

from __future__ import annotations

from typing import Any

import numpy as np

from vo_lib.beyond.selection import sample_sets
from vo_lib.core.geometry import essential_vector
from vo_lib.core.types import Array
from vo_lib.data.problems import random_problems
from vo_lib.method.five_point import five_point
from vo_lib.method.selection import nearest_to_prior, truncated_errors

from ..checker import Case, Exercise


def vectors() -> list[Case]:
    """Two essential vectors, one with its sign changed, and a vector whose square is 1 + 1e-16."""
    e = essential_vector(random_problems(np.random.default_rng(1), 2).E)
    unit = np.full(9, 1.0 / 3.0 + 1e-16)
    return [(e[0], e[1]), (e[0], -e[1]), (unit, unit.copy())]


def cosine(e1: Array, e2: Array) -> float:
    """|e1ᵀ e2|, at most 1."""
    return min(abs(float(e1 @ e2)), 1.0)


def candidates() -> list[Case]:
    """Candidates of any length and sign, a prior and k = 1, 2, 3, for every set with four or more."""
    rng = np.random.default_rng(2)
    given = random_problems(rng, 60, motion="forward")
    found = five_point(given.x_p, given.x_c)
    E = found.E * rng.uniform(0.5, 2.0, (len(found.E), 1, 1)) * rng.choice([-1, 1], (len(found.E), 1, 1))
    sets = [(s, E[found.set_index == s]) for s in range(60)]
    return [
        (E, essential_vector(given.E[(s + 1) % 60]), k) for s, E in sets if len(E) >= 4 for k in (1, 2, 3)
    ]


def angles(E: Array, e_prev: Array) -> Array:
    """Angles (M,) of candidates to the prior, radians."""
    return np.asarray(np.arccos(np.minimum(np.abs(essential_vector(E) @ e_prev), 1.0)))


def frames() -> list[Case]:
    """Candidates of frames with half of the matches wrong, their image errors and a rough prior, k = 1, 2."""
    cases: list[Case] = []
    for seed in range(8):
        rng = np.random.default_rng(seed)
        given = random_problems(rng, 1, 120, "forward", noise_px=0.5)
        x_p, x_c = given.x_p[0], given.x_c[0]
        x_c[:60] += rng.normal(0.0, 0.02, (60, 2))
        sets = sample_sets(rng, 120, 40)
        found = five_point(x_p[sets], x_c[sets])
        e_prev = essential_vector(given.E[0] + 0.2 * rng.normal(size=(3, 3)))
        errors = truncated_errors(found.E, x_p, x_c, 1.0 / 718.856)
        cases += [(found.E, found.set_index, errors, e_prev, k) for k in (1, 2)]
    return cases


def selected(E: Array, set_index: Any, errors: Array, e_prev: Array, k: int) -> int:
    """Solution selection: of the k nearest of each set the one with the smallest image error."""
    return int(np.argmin(np.where(nearest_to_prior(E, set_index, e_prev, k), errors, np.inf)))


def overall(E: Array, set_index: Any, errors: Array, e_prev: Array, k: int) -> int:
    """The best of the k nearest of all sets together."""
    nearest = np.argsort(angles(E, e_prev))[:k]
    return int(nearest[np.argmin(errors[nearest])])


def sets_for(good: float) -> float:
    """Sets until one has only right matches with 99 %, when all five are right with a probability `good`."""
    return float(np.log(0.01) / np.log(1.0 - good))


angle = Exercise("ch03.angle", lambda e1, e2: np.arccos(cosine(e1, e2)), vectors)

nearest = Exercise("ch03.nearest", lambda E, e_prev, k: np.argsort(angles(E, e_prev))[:k], candidates)

truncated_error = Exercise(
    "ch03.truncated_error",
    lambda d, threshold: np.mean(np.minimum((d / threshold) ** 2, 1.0)),
    lambda: [(t * np.array([0.0, 0.5, -0.5, 1.0, -3.0, 50.0]), t) for t in (1.0, 2.0)],
)

select = Exercise("ch03.select", selected, frames)

sets_needed = Exercise("ch03.sets_needed", 26.0, also=(sets_for(0.7**5),), atol=0.02)

consensus_fooled = Exercise("ch03.consensus_fooled", {"error by consensus": 2.0, "error by selection": 2.0})
