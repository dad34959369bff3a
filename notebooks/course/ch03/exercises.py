"""Exercises of chapter 3: the angle, the k nearest, the truncated error, the selection, the number of sets."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from vo_lib.geometry.motion import essential_angle, essential_vector
from vo_lib.geometry.types import Array, BoolArray, IntArray
from vo_lib.paper.five_point import five_point
from vo_lib.paper.selection import draw_sets, nearest_to_prior, truncated_errors

from ..candidates import first_of_each_set
from ..checker import Case, Exercise
from ..simulation.problems import random_problems


def vectors() -> list[Case]:
    """Pairs of vectors: different; of opposite sign; equal, with a squared norm above 1."""
    e = essential_vector(random_problems(np.random.default_rng(1), 2).E)
    unit = np.full(9, 1.0 / 3.0 + 1e-16)
    return [(e[0], e[1]), (e[0], -e[1]), (unit, unit.copy())]


def of_any_length(E: Array, rng: np.random.Generator) -> Array:
    """The same essential matrices (M, 3, 3), each multiplied by a random factor."""
    return np.asarray(E * rng.uniform(0.25, 1.0, (len(E), 1, 1)) * rng.choice([-1, 1], (len(E), 1, 1)))


def candidates() -> list[Case]:
    """Cases with candidates of any norm and sign (four or more, of one set), a prior, and k = 2, 3 or 1."""
    rng = np.random.default_rng(2)
    given = random_problems(rng, 60, motion="forward")
    solutions = five_point(given.x_p, given.x_c)
    E = of_any_length(solutions.E, rng)
    cases: list[Case] = []
    for s in range(60):
        of_set = E[solutions.set_index == s]
        if len(of_set) >= 4:
            e_prev = essential_vector(given.E[(s + 1) % 60])
            cases += [(of_set, e_prev, k) for k in (2, 3, 1)]
    return cases


def angles(E: Array, e_prev: Array) -> Array:
    """Angles (M,) of candidates to the prior, radians."""
    return essential_angle(essential_vector(E), e_prev)


# Wrong measures of (E, e_prev) in place of the angle, by message.
WRONG_ANGLES: dict[str, Callable[[Array, Array], Array]] = {
    "candidates with a large norm seem near: E has no fixed norm, an essential vector has norm 1.": (
        lambda E, e_prev: np.arccos(np.abs(E.reshape(-1, 9) @ e_prev))
    ),
    "a candidate seems far because its sign differs: E and -E are the same.": (
        lambda E, e_prev: -(essential_vector(E) @ e_prev)
    ),
}


def first_by(measure: Callable[[Array, Array], Array]) -> Callable[..., Any]:
    """Answer: the indices of the k candidates with the smallest `measure(E, e_prev)`."""
    return lambda E, e_prev, k: np.argsort(measure(E, e_prev), kind="stable")[:k]


def frames() -> list[Case]:
    """Cases from frames with half of the matches wrong: candidates, sets, image errors, a rough prior, and k.

    Candidates have any norm and sign. The winner is alternately in the first and in the last set.
    """
    cases: list[Case] = []
    for seed in range(8):
        rng = np.random.default_rng(seed)
        given = random_problems(rng, 1, 120, "forward", noise_px=0.5)
        x_p = given.x_p[0]
        x_c = given.x_c[0]
        x_c[:60] += rng.normal(0.0, 0.02, (60, 2))
        sets = draw_sets(rng, 120, 40)
        E, set_index = five_point(x_p[sets], x_c[sets])
        E = of_any_length(E, rng)
        e_prev = essential_vector(given.E[0] + 0.2 * rng.normal(size=(3, 3)))
        errors = truncated_errors(E, x_p, x_c, 1.0 / 718.856)
        for k in (1, 2):
            winners_set = set_index[selected(E, set_index, errors, e_prev, k)]
            # New numbers of the sets: the winner's has 0 or, for an odd seed, 39.
            renumbered = (set_index - winners_set - seed % 2) % 40
            order = np.argsort(renumbered, kind="stable")
            cases.append((E[order], renumbered[order], errors[order], e_prev, k))
    return cases


def index_of_smallest(values: Array, allowed: BoolArray) -> int:
    """Index of the smallest of the allowed values."""
    return int(np.argmin(np.where(allowed, values, np.inf)))


def selected(E: Array, set_index: Any, errors: Array, e_prev: Array, k: int) -> int:
    """Solution selection: the candidate with the smallest image error among the k nearest of each set."""
    return index_of_smallest(errors, nearest_to_prior(E, set_index, e_prev, k))


def of_winners(E: Array, set_index: Any, errors: Array, e_prev: Array, k: int) -> int:
    """Wrong answer: among the winners of the sets, the winner nearest to e_prev."""
    competing = np.where(nearest_to_prior(E, set_index, e_prev, k), errors, np.inf)
    return index_of_smallest(angles(E, e_prev), first_of_each_set(competing, set_index, 1))


def in_list(E: Array, set_index: Any, errors: Array, e_prev: Array, k: int) -> int:
    """Wrong answer: the winner's place in the list of kept candidates, set by set, nearest first."""
    order = np.lexsort((angles(E, e_prev), set_index))
    is_kept = nearest_to_prior(E, set_index, e_prev, k)
    kept = order[is_kept[order]]
    return int(np.argmin(errors[kept]))


def within_its_set(E: Array, set_index: IntArray, *case: Any) -> Any:
    """Wrong answer: the right candidate, as an index into the candidates of its set."""
    winner = selected(E, set_index, *case)
    return winner - np.searchsorted(set_index, set_index[winner])


def within_sets(E: Array, set_index: Any, errors: Array, e_prev: Array, k: int) -> int:
    """Wrong answer: indices within a set are used as indices into all candidates."""
    within = []
    for s in np.unique(set_index):
        of_set = angles(E[set_index == s], e_prev)
        within.append(np.argsort(of_set, kind="stable")[:k])
    kept = np.concatenate(within)
    return int(kept[np.argmin(errors[kept])])


def selected_by(measure: Callable[[Array, Array], Array]) -> Callable[..., int]:
    """Solution selection with another measure of (E, e_prev) in place of the angle."""
    return lambda E, s, errors, e_prev, k: index_of_smallest(
        errors, first_of_each_set(measure(E, e_prev), s, k)
    )


def k_in_all(E: Array, set_index: Any, errors: Array, e_prev: Array, k: int) -> int:
    """Wrong answer: only the k candidates nearest to e_prev compete, whatever their sets."""
    one_set = np.zeros_like(set_index)
    return index_of_smallest(errors, first_of_each_set(angles(E, e_prev), one_set, k))


def sets_for(good: float) -> float:
    """Number of sets for at least one correct set at 99 % probability; `good`: share of correct sets."""
    return float(np.log(0.01) / np.log(1.0 - good))


def truncated(
    cost: Callable[[Array, float], Any] = lambda d, tau: np.minimum((d / tau) ** 2, 1.0),
    mean: Callable[..., Any] = np.mean,
) -> Callable[[Array, float], Any]:
    """Answer: the `mean` of `cost(distances, threshold)`."""
    return lambda d, threshold: mean(cost(d, threshold))


angle = Exercise(
    lambda e1, e2: float(essential_angle(e1, e2)),
    vectors,
    praise="the sign does not matter, and equal vectors have the angle 0.",
    hint="dot product, absolute value, no more than 1, arc cosine, in this order.",
    line="np.arccos(min(abs(e1 @ e2), 1))",
    library=("essential_angle",),
    slips={"degrees": "this is in degrees; in the code, angles are in radians."},
    mistakes={
        "this is the cosine, not yet the angle.": lambda a, b: abs(a @ b),
        "e and -e are the same essential matrix, but the angle differs.": lambda a, b: np.arccos(
            min(a @ b, 1)
        ),
        "NaN for equal vectors: rounding makes the product 1 + 1e-16.": lambda a, b: np.arccos(abs(a @ b)),
    },
)

nearest = Exercise(
    first_by(angles),
    candidates,
    praise="the same candidates as `nearest_to_prior` keeps in each set.",
    hint="compute the angle of each candidate to e_prev, sort the candidates by it, return the first k indices.",
    line="np.argsort(np.arccos(np.minimum(np.abs(essential_vector(E) @ e_prev), 1)))[:k]",
    library=("nearest_to_prior", "essential_angle"),
    mistakes={says: first_by(measure) for says, measure in WRONG_ANGLES.items()}
    | {
        "these are the farthest: the angle falls as |eᵀ e_prev| rises.": (
            first_by(lambda E, e: -angles(E, e)),
            lambda E, e, k: np.argsort(angles(E, e))[-k:],
        ),
        "these are all candidates in the right order; return only the first k.": lambda E, e, k: np.argsort(
            angles(E, e)
        ),
    },
    slips={"order": "these are the right candidates, but not with the nearest first."},
)

truncated_error = Exercise(
    truncated(),
    lambda: [(t * np.array([0.0, 0.5, -0.5, 0.9, -3.0, 50.0]), t) for t in (1.0, 2.0)],
    praise="a match never costs more than 1, however wrong it is.",
    hint="compute one cost between 0 and 1 for each match, then the mean of the costs.",
    line="np.mean(np.minimum((d / threshold) ** 2, 1))",
    library=("truncated_errors", "truncated_mean"),
    mistakes={
        "this is the sum, which grows with the number of matches.": truncated(mean=np.sum),
        "one wrong match decides everything: a term must not exceed 1.": truncated(lambda d, t: (d / t) ** 2),
        "outliers cost nothing here; each should cost 1.": (
            truncated(lambda d, t: (d[np.abs(d) <= t] / t) ** 2),
            truncated(lambda d, t: np.where(np.abs(d) <= t, (d / t) ** 2, 0.0)),
        ),
        "this only counts inliers or outliers; inliers have different costs, too.": (
            truncated(lambda d, t: np.abs(d) > t),
            truncated(lambda d, t: np.abs(d) <= t),
        ),
        "the terms are not (d / threshold)²: divide by the threshold first, then square.": (
            truncated(lambda d, t: np.minimum(np.abs(d / t), 1.0)),
            truncated(lambda d, t: np.minimum(d**2, t**2)),
            truncated(lambda d, t: np.minimum(d**2, 1.0)),
            truncated(lambda d, t: np.minimum(d**2 / t, 1.0)),
        ),
        "the minimum is taken before the square, so a large negative distance is not limited.": truncated(
            lambda d, t: np.minimum(d / t, 1.0) ** 2
        ),
        "this takes the larger of (d / threshold)² and 1: a match must cost 1 at most, so take the smaller.": (
            truncated(lambda d, t: np.maximum((d / t) ** 2, 1.0))
        ),
        "this is the root of the mean; the task asks for the mean of the costs itself.": lambda d, t: np.sqrt(
            np.mean(np.minimum((d / t) ** 2, 1.0))
        ),
        "the mean is truncated here, not each of its terms.": lambda d, t: min(np.mean((d / t) ** 2), 1),
    },
)


select = Exercise(
    selected,
    frames,
    praise="the paper's section 2.2: k of each set by angle, then the smallest image error of all kept candidates.",
    hint="for each set, find its k candidates nearest to e_prev; then compare the errors of all kept candidates.",
    line="members = np.flatnonzero(set_index == s); kept += [*members[nearest(E[members], e_prev, k)]]",
    library=("nearest_to_prior", "choose"),
    mistakes={says: selected_by(measure) for says, measure in WRONG_ANGLES.items()}
    | {
        "this is an index into the kept candidates or into one set; return the index into all candidates.": (
            lambda E, s, errors, e, k: np.argmin(errors[nearest_to_prior(E, s, e, k)]),
            in_list,
            within_its_set,
        ),
        "`nearest` gives indices within its set; the errors need indices into all candidates.": within_sets,
        "this is the candidate nearest to e_prev; the image error decides in the end.": lambda E, s, errors, e, k: (
            np.argmin(angles(E, e))
        ),
        "this is consensus: the prior does not limit the candidates.": lambda E, s, errors, e, k: np.argmin(
            errors
        ),
        "`k` is not used: it is not always 2.": (
            lambda E, s, errors, e, k: selected(E, s, errors, e, 2),
            lambda E, s, errors, e, k: selected(E, s, errors, e, 1),
        ),
        "prior and image error are exchanged: the angle selects candidates, the error selects the winner.": (
            lambda E, s, errors, e, k: index_of_smallest(angles(E, e), first_of_each_set(errors, s, k))
        ),
        "this is the nearest of the winners of the sets; the image error also decides between sets.": of_winners,
        "this is the number of the winner's set; return the index of the winner.": lambda E, s, *case: s[
            selected(E, s, *case)
        ],
        "only the first set is used; the winner may be in any set.": lambda E, s, errors, e, k: (
            index_of_smallest(errors, nearest_to_prior(E, s, e, k) & (s == s[0]))
        ),
        "the first or the last set is left out: range(n) runs from 0 to n - 1.": (
            lambda E, s, errors, e, k: index_of_smallest(
                errors, nearest_to_prior(E, s, e, k) & (s < s.max())
            ),
            lambda E, s, errors, e, k: index_of_smallest(
                errors, nearest_to_prior(E, s, e, k) & (s > s.min())
            ),
        ),
        "this is the image error of the winner; return its index.": lambda E, s, errors, *more: errors[
            selected(E, s, errors, *more)
        ],
        "only k candidates compete in all; k candidates of each set may compete.": k_in_all,
    },
)

sets_needed = Exercise(
    26.0,
    also=(sets_for(0.7**5),),
    atol=0.02,
    praise="(1 - 0.7⁵)ⁿ = 0.01 gives n = 25.03, so 26 sets.",
    hint="write down the probability that one set is good, that it is not, and that all n sets are not.",
    line="np.log(0.01) / np.log(1 - 0.7**5)",
    mistakes={
        "25 sets give 98.995 %, slightly less than required.": 25,
        "this is the number for 30 % correct matches.": np.ceil(sets_for(0.3**5)),
        "all five matches of a set must be right, not one.": (sets_for(0.7), np.ceil(sets_for(0.7))),
        "this is the number for sets of eight; here a set has five matches.": (
            sets_for(0.7**8),
            np.ceil(sets_for(0.7**8)),
        ),
        "two different logarithms: take the same in the numerator and in the denominator.": (
            sets_for(0.7**5) * np.log(10),
            sets_for(0.7**5) / np.log(10),
            np.ceil(sets_for(0.7**5) * np.log(10)),
            np.ceil(sets_for(0.7**5) / np.log(10)),
        ),
        "0.7⁵ is the probability that a set is good; the n sets that fail have 1 - 0.7⁵.": (
            sets_for(1 - 0.7**5),
            np.ceil(sets_for(1 - 0.7**5)),
        ),
        "this divides by the success probability. The sets are drawn independently: all n fail with probability (1 - p)ⁿ.": (
            0.99 / 0.7**5,
            1 / 0.7**5,
        ),
    },
)

consensus_fooled = Exercise(
    {"error by consensus": 2.0, "error by selection": 2.0, "disturbed": 170.0},
    praise="consensus is {error by consensus:.2f}° wrong, selection {error by selection:.2f}°. Matches that move "
    "together agree on one false motion. Chapter 5 removes them before the vote.",
    mistakes={
        "this sequence has no ground truth, so the error of consensus is unknown. Choose the drawn street.": (
            lambda now: np.isnan(now["error by consensus"])
        ),
        "consensus is only {error by consensus:.3f}° wrong. Which matches agree among themselves: wrong matches, or "
        "matches on one moving object?": lambda now: not now["error by consensus"] > 0.5,
        "no match is disturbed: noise decided between the two solutions of a plane. Untick `one plane` and "
        "disturb matches instead.": lambda now: not now["disturbed"] > 0,
    },
)
