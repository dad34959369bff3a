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

from ..checker import Case, Exercise, Mistake


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


angle = Exercise(
    lambda e1, e2: np.arccos(cosine(e1, e2)),
    vectors,
    task="A function (e1, e2) -> acos|e1ᵀ e2| in radians, for unit vectors of nine numbers.",
    praise="sign-free, and safe for equal vectors.",
    hint="np.arccos of the absolute dot product.",
    library=("essential_angle",),
    mistakes=(
        Mistake(
            "this is in degrees.",
            "inside the code angles are radians.",
            lambda e1, e2: np.degrees(np.arccos(cosine(e1, e2))),
        ),
        Mistake(
            "e and -e are the same essential matrix, but the angle differs.",
            "take |e1ᵀ e2|.",
            lambda e1, e2: np.arccos(np.clip(e1 @ e2, -1.0, 1.0)),
        ),
        Mistake(
            "equal vectors give NaN.",
            "rounding makes the product 1 + 1e-16: np.minimum(…, 1.0).",
            lambda e1, e2: np.arccos(abs(e1 @ e2)),
        ),
    ),
)

nearest = Exercise(
    lambda E, e_prev, k: np.argsort(angles(E, e_prev))[:k],
    candidates,
    task="A function (E, e_prev, k): one set's candidates (m, 3, 3) -> indices of the k nearest, in order.",
    praise="as the library's `nearest_to_prior` has it, set by set.",
    hint="np.argsort of the angles acos|eᵀ e_prev|, then the first k.",
    library=("nearest_to_prior", "essential_angle"),
    mistakes=(
        Mistake(
            "these are the farthest.",
            "acos falls where |eᵀ e_prev| rises: sort the angles.",
            lambda E, e_prev, k: np.argsort(-angles(E, e_prev))[:k],
            lambda E, e_prev, k: np.argsort(angles(E, e_prev))[-k:],
        ),
        Mistake(
            "the right ones, but not the nearest first.",
            "np.argsort(angles)[:k].",
            lambda E, e_prev, k: np.argsort(angles(E, e_prev))[:k][::-1],
            when=lambda got, E, e_prev, k: sorted(got) == sorted(np.argsort(angles(E, e_prev))[:k]),
        ),
        Mistake(
            "a candidate is taken for far because its sign differs: E and -E are the same.",
            "the angle is acos|eᵀ e_prev|, with the absolute value.",
            lambda E, e_prev, k: np.argsort(-(essential_vector(E) @ e_prev))[:k],
        ),
        Mistake(
            "long candidates are taken for near: E has no fixed length.",
            "`essential_vector(E)` makes nine numbers of norm 1 of each.",
            lambda E, e_prev, k: np.argsort(-np.abs(E.reshape(-1, 9) @ e_prev))[:k],
            lambda E, e_prev, k: np.argsort(
                np.arccos(np.clip(np.abs(E.reshape(-1, 9) @ e_prev), 0, 1)), kind="stable"
            )[:k],
        ),
    ),
)

truncated_error = Exercise(
    lambda d, threshold: np.mean(np.minimum((d / threshold) ** 2, 1.0)),
    lambda: [(t * np.array([0.0, 0.5, -0.5, 1.0, -3.0, 50.0]), t) for t in (1.0, 2.0)],
    task="A function (d, threshold): distances (N,) -> mean of min(d² / threshold², 1).",
    praise="a match never costs more than 1, however wrong it is.",
    hint="np.mean(np.minimum((d / threshold) ** 2, 1.0)).",
    library=("truncated_errors",),
    mistakes=(
        Mistake(
            "this is the sum.",
            "the mean: otherwise the error grows with the number of matches.",
            lambda d, threshold: np.sum(np.minimum((d / threshold) ** 2, 1.0)),
        ),
        Mistake(
            "one wrong match decides everything.",
            "truncate each term at 1: np.minimum.",
            lambda d, threshold: np.mean((d / threshold) ** 2),
        ),
        Mistake(
            "this only counts outliers; inliers say more or less, too.",
            "d² / threshold² below 1.",
            lambda d, threshold: np.mean(np.abs(d) > threshold),
        ),
        Mistake(
            "these are distances, not squares.",
            "square d first.",
            lambda d, threshold: np.mean(np.minimum(np.abs(d / threshold), 1.0)),
        ),
        Mistake(
            "the threshold is not used.",
            "divide d by it.",
            lambda d, threshold: np.mean(np.minimum(d**2, 1.0)),
        ),
        Mistake(
            "the mean is truncated, not the terms.",
            "the minimum of each term, before the mean.",
            lambda d, threshold: min(np.mean((d / threshold) ** 2), 1.0),
        ),
    ),
)

select = Exercise(
    selected,
    frames,
    task="A function (E, set_index, errors, e_prev, k) -> index of the winner by solution selection.",
    praise="the paper's section 2.2: k of each set by angle, then the smallest image error of all kept.",
    hint="is the index one into all candidates?",
    library=("nearest_to_prior", "choose"),
    mistakes=(
        Mistake(
            "this counts among the kept candidates.",
            "an index into all: kept[np.argmin(errors[kept])].",
            lambda E, set_index, errors, e_prev, k: np.argmin(
                errors[nearest_to_prior(E, set_index, e_prev, k)]
            ),
        ),
        Mistake(
            "this is the candidate nearest to e_prev.",
            "the image error has the last word.",
            lambda E, set_index, errors, e_prev, k: np.argmin(angles(E, e_prev)),
        ),
        Mistake(
            "this is consensus: the prior was not asked.",
            "only the k nearest of each set compete.",
            lambda E, set_index, errors, e_prev, k: np.argmin(errors),
        ),
        Mistake("only k candidates of all sets competed.", "keep the k nearest of each set.", overall),
    ),
)

sets_needed = Exercise(
    26.0,
    also=(sets_for(0.7**5),),
    atol=0.02,
    task="Sets to draw so that with 99 % one has only right matches, when 30 % of the matches are wrong.",
    praise="(1 - 0.7⁵)ⁿ = 0.01 gives n = 25.03, so 26 sets. n = 200 is for accuracy, not for safety alone.",
    hint="(1 - 0.7⁵)ⁿ = 0.01, solved for n, and rounded up.",
    mistakes=(
        Mistake("25 sets give 98.995 %, a hair less than wanted.", "round up.", 25),
        Mistake(
            "this is for 30 % right matches.",
            "a match is right with probability 0.7.",
            lambda *_: sets_for(0.3**5),
            lambda *_: np.ceil(sets_for(0.3**5)),
        ),
        Mistake(
            "one match is not enough.",
            "all five must be right: 0.7⁵.",
            lambda *_: sets_for(0.7),
            lambda *_: np.ceil(sets_for(0.7)),
        ),
        Mistake(
            "this is as if the sets shared their luck.",
            "all n sets fail with probability (1 - 0.7⁵)ⁿ.",
            0.99 / 0.7**5,
            1 / 0.7**5,
            lambda *_: np.ceil(1 / 0.7**5),
        ),
    ),
)

consensus_fooled = Exercise(
    {"error by consensus": 2.0, "error by selection": 2.0},
    task="The panel shows a winner by consensus that is more than 0.5° wrong.",
    praise=(
        "consensus is {error by consensus:.2f}° wrong, selection {error by selection:.2f}°. What moves "
        "together votes as one. That is why chapter 5 takes it out before the vote."
    ),
    hint="",
    mistakes=(
        Mistake(
            "consensus is still only {error by consensus:.3f}° wrong.",
            (
                "raise the moving share: things that move together agree among themselves, wrong matches "
                "do not."
            ),
            {"error by consensus": 0.01},
            when=lambda facts: not facts["error by consensus"] > 0.5,
        ),
    ),
)
