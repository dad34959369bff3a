"""Exercises of chapter 1: corner strength, the stereo check, the loop, a peak between pixels, buckets."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from vo_lib.geometry.types import Array, BoolArray, Index
from vo_lib.paper.buckets import select_by_bucket
from vo_lib.paper.settings import BucketConfig

from ..checker import Case, Condition, Exercise, in_order

E = 1e-9  # distance from a limit, in cases just outside of it


def windows() -> list[Case]:
    """Gradients of a corner and of edges in many directions; rounding makes some eigenvalues negative."""
    rng = np.random.default_rng(0)
    edges = [
        (a * g, b * g) for a, b, g in zip(*rng.normal(size=(2, 20)), rng.normal(size=(20, 5, 5)), strict=True)
    ]
    return [tuple(rng.normal(size=(2, 5, 5))), (rng.normal(size=(5, 5)), np.zeros((5, 5))), *edges]


def eigenvalues(gx: Array, gy: Array, total: Callable[..., Any] = np.sum) -> Array:
    """Eigenvalues (2,) of the structure tensor, the smaller eigenvalue first."""
    return np.linalg.eigvalsh([[total(gx * gx), total(gx * gy)], [total(gx * gy), total(gy * gy)]])


def strength(gx: Array, gy: Array, total: Callable[..., Any] = np.sum) -> Any:
    """The square root of the smaller eigenvalue."""
    return np.sqrt(max(eigenvalues(gx, gy, total)[0], 0.0))


def unsorted(gx: Array, gy: Array) -> Any:
    """The square root of the first eigenvalue of `np.linalg.eig`, not always the smaller eigenvalue."""
    M = [[np.sum(gx * gx), np.sum(gx * gy)], [np.sum(gx * gy), np.sum(gy * gy)]]
    return np.sqrt(max(np.linalg.eig(M)[0][0], 0.0))


def stereo_pairs() -> list[Case]:
    """Cases of three matches, two of them equal and good; then cases of six matches, with several limits."""
    left = np.tile([100.0, 50.0], (6, 1))
    right = np.array([[90.0, 50.4], [99.5, 51.0], [90.0, 52.0], [99.8, 50.0], [110.0, 50.0], [90.0, 48.0]])
    some = [(left[[0, 0, i]], right[[0, 0, i]], 1.0, 0.5) for i in (0, 2, 3, 4, 5)]
    return [*some, (left, right, 1.0, 0.5), (left, right, 2.5, 0.1), (left, right, 0.25, 9.0)]


def chains() -> list[Case]:
    """Cases of best matches of 12 features in four images; some chains are closed, others open or wrong."""
    cases = []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        forward = [rng.permutation(12) for _ in range(3)]
        back = np.empty(12, np.intp)
        back[forward[2][forward[1][forward[0]]]] = np.arange(12)
        for chain in (*forward, back):
            chain[rng.integers(12, size=2)] = -1
            chain[rng.integers(12)] = rng.integers(12)
        cases.append((*forward, back))
    return cases


def follow(*steps: Index) -> tuple[Index, Any]:
    """The end of each feature's chain of matches, and whether the chain is complete."""
    at = np.arange(len(steps[0]))
    complete = np.ones(len(steps[0]), np.bool_)
    for step in steps:
        at = step[at]
        complete &= at >= 0
    return at, complete


def which(*steps: Index) -> Index:
    """Indices of the features whose chain returns to its start."""
    at, complete = follow(*steps)
    return np.flatnonzero(complete & returns(at))


def returns(end: Index) -> BoolArray:
    """Whether each feature's chain ends where it began."""
    return np.asarray(end == np.arange(len(end)))


def crowd() -> list[Case]:
    """80 features with ages and strengths, and two grids of buckets; some squares have few features."""
    rng = np.random.default_rng(11)
    features = rng.uniform(0, 1, (80, 2)) * (300.0, 150.0), rng.integers(1, 4, 80), rng.uniform(1, 9, 80)
    return [(*features, 50, 3), (*features, 70, 1)]


def judged(
    row: Callable[..., Any] = np.abs,
    disparity: Callable[..., Any] = np.positive,
    limits: Callable[..., tuple[float, float]] = lambda *limits: limits,
) -> Callable[..., Any]:
    """Answer for the stereo check from functions of the row difference, the disparity and the limits."""

    def check(left: Array, right: Array, row_tolerance: float, min_disparity: float) -> Any:
        most, least = limits(row_tolerance, min_disparity)
        return (row((left - right)[:, 1]) <= most) & (disparity((left - right)[:, 0]) >= least)

    return check


good = judged()


def top(left: float, middle: float, right: float) -> float:
    """The position of the maximum of the parabola through three values."""
    return (left - right) / 2 / (left - 2 * middle + right)


def chosen(by_age: int = 1, by_strength: int = 1) -> Callable[..., Index]:
    """Answer for the buckets; the factors `by_age` and `by_strength` set the signs of ages and strengths."""
    return lambda uv, age, strength, size, count: select_by_bucket(
        uv, by_age * age, by_strength * strength, BucketConfig(size=size, features=count)
    )


kept = chosen()


def in_sorted_list(uv: Array, age: Array, strength: Array, *more: int) -> Index:
    """Wrong answer: positions of the selected features in the sorted list, not their indices."""
    order = np.lexsort((-strength, -age))
    return np.flatnonzero(np.isin(order, kept(uv, age, strength, *more)))


def in_full_squares(uv: Array, age: Array, strength: Array, size: int, count: int) -> Index:
    """Wrong answer: squares with fewer than `count` features keep none."""
    index = kept(uv, age, strength, size, count)
    squares = uv[index] // size
    return index[[np.sum(np.all(squares == each, axis=1)) == count for each in squares]]


def overfull(kept: Array, uv: Array, age: Array, strength: Array, size: int, count: int) -> bool:
    """Whether a bucket keeps more than `count` features."""
    return bool(np.unique(uv[kept.astype(int)] // size, axis=0, return_counts=True)[1].max() > count)


corner_strength = Exercise(
    strength,
    windows,
    atol=1e-6,
    praise="0 on an edge, large on a corner. The library computes this strength for all pixels at once.",
    hint="M is 2×2: sum gx², gx gy and gy² over the window; then take the root of the smaller eigenvalue.",
    line="M = [[np.sum(gx * gx), np.sum(gx * gy)], [np.sum(gx * gy), np.sum(gy * gy)]]; np.linalg.eigvalsh(M)",
    library=("corner_strength",),
    slips={"square": "this is correct except for the square root."},
    mistakes={
        "this is the larger eigenvalue; it is large on an edge.": lambda *g: np.sqrt(eigenvalues(*g)[1]),
        "`np.linalg.eig` gives the eigenvalues in no order, and the first is not always the smaller; "
        "`np.linalg.eigvalsh` sorts them.": unsorted,
        "both eigenvalues are returned; return only the smaller one.": eigenvalues,
        "this takes means over the window; M is a sum.": lambda gx, gy: strength(gx, gy, np.mean),
        "without Σ gx gy, a slanting edge looks like a corner.": lambda gx, gy: np.sqrt(
            min(np.sum(gx * gx), np.sum(gy * gy))
        ),
        "this is a matrix product of the windows; multiply each pixel's gx by its own gy: `gx * gy`.": (
            lambda gx, gy: np.sqrt(max(np.linalg.eigvalsh(gx @ gy.T)[0], 0.0)),
            lambda gx, gy: strength(gx, gy, lambda products: products),
        ),
        "NaN on an edge: rounding can make an eigenvalue -1e-17, and the root of a negative number is NaN.": Condition(
            lambda got, *case: np.isnan(got) and eigenvalues(*case)[0] < 1e-9
        ),
    },
)

is_stereo = Exercise(
    good,
    stereo_pairs,
    praise="every good match has equal rows and a sufficient disparity.",
    hint="each match has two conditions, one on its rows and one on its columns; the mask is True where both hold.",
    line="(np.abs(left[:, 1] - right[:, 1]) <= row_tolerance) & (left[:, 0] - right[:, 0] >= min_disparity)",
    mistakes={
        "rows and columns are exchanged: a point is (u, v), its column first.": (
            lambda left, right, *limits: good(left[:, ::-1], right[:, ::-1], *limits)
        ),
        "one of the two conditions is enough here; join both masks by `&`.": lambda left, right, *limits: (
            judged(disparity=lambda d: d + np.inf)(left, right, *limits)
            | judged(row=np.zeros_like)(left, right, *limits)
        ),
        "the two limits are exchanged.": judged(limits=lambda most, least: (least, most)),
        "1 and 0.5 are hard-coded: use the limits given.": judged(limits=lambda *_: (1.0, 0.5)),
        "a match exactly at a limit is good: use <= and >=.": (
            *(judged(limits=lambda m, n, a=a, b=b: (m - a, n + b)) for a, b in ((E, E), (E, 0), (0, E))),
        ),
        "the match whose rows differ by two is judged good.": (
            judged(row=np.zeros_like),
            judged(row=np.zeros_like, disparity=np.abs),
        ),
        "a disparity of 0.2 px is judged good.": judged(limits=lambda most, least: (most, -99.0)),
        "the match with a negative disparity is judged good.": judged(disparity=np.abs),
        "the row difference needs an absolute value.": (*map(judged, (np.positive, np.negative)),),
        "the disparity is left column minus right column.": judged(disparity=np.negative),
        "matches with a small disparity are judged good, and matches with a sufficient disparity bad.": judged(
            disparity=np.negative, limits=lambda most, least: (most, -least)
        ),
    },
)

loop_closes = Exercise(
    lambda pl_pr, pr_cr, cr_cl, cl_pl: which(pl_pr, pr_cr, cr_cl, cl_pl),
    chains,
    form=in_order,
    praise="the loop has four matches and one condition, and few wrong matches pass.",
    hint="follow feature i: pl_pr[i] is its number in the next image, and its index in the next list.",
    line="at = step[at]; alive &= at >= 0",
    mistakes={
        "a match of -1 was followed: to numpy, index -1 is the last element.": Condition(
            lambda got, *chain: set(which(*chain)) < set(got) and len(got) < len(chain[0])
        ),
        "these reach the current left image; the loop has to end at its first feature.": lambda *chain: (
            np.flatnonzero(follow(*chain[:3])[1])
        ),
        "this tests for -1 at i in each list, but the feature's number changes with every step.": (
            lambda *chain: [i for i in which(*chain) if min(step[i] for step in chain) >= 0],
            lambda *chain: np.flatnonzero(np.min(chain, axis=0) >= 0),
            lambda *chain: np.flatnonzero((np.min(chain, axis=0) >= 0) & returns(follow(*chain)[0])),
        ),
        "the four lists are applied in the reverse order.": lambda *chain: which(*chain[::-1]),
        "feature 0 is missing: 0 is the number of a feature; the number -1 marks a missing match.": Condition(
            lambda got, *chain: 0 in which(*chain) and 0 not in got and set(got) < set(which(*chain))
        ),
        "these are indices into the previous right image.": lambda *chain: chain[0][which(*chain)],
    },
)

peak = Exercise(
    top,
    lambda: [
        tuple(height + curve * (x - top) ** 2 for x in (-1.0, 0.0, 1.0))
        for top, height, curve in ((0.3, 5.0, -2.0), (-0.45, 1.0, -0.5), (0.0, 2.0, -1.0))
    ],
    praise="three values determine a parabola; its top is between the pixels.",
    hint="put x = -1 and x = 1 into f(x) = middle + b x + a x² and solve for a and b; the slope is 0 at x = -b / (2a).",
    line="(left - right) / 2 / (left - 2 * middle + right)",
    mistakes={
        "this is the height of the top, not its position.": lambda a, b, c: b - (a - c) / 4 * top(a, b, c),
    },
    slips={
        "sign": "the sign is wrong: the top is on the side of the larger neighbour.",
        "one more": "this is counted from the left value; count from the middle value.",
    },
)

buckets = Exercise(
    chosen(),
    crowd,
    form=in_order,
    praise="the features are spread over the image, and the oldest come first.",
    hint="sort all features, the best first; keep each feature whose square is not yet full.",
    line="for i in np.lexsort((-strength, -age)): square = tuple(uv[i] // size)",
    library=("select_by_bucket",),
    mistakes={
        "age comes first; strength decides among features of the same age.": chosen(by_age=0),
        "the youngest and weakest are kept: in `np.lexsort`, both keys need a minus.": chosen(-1, -1),
        "the youngest are kept; the oldest come first.": chosen(by_age=-1),
        "of features of the same age the weakest are kept.": chosen(by_strength=-1),
        "`size` is hard-coded: use the argument.": lambda *case: kept(*case[:3], 50, case[4]),
        "`count` is hard-coded: use the argument.": lambda *case: kept(*case[:4], 3),
        "these are ranks in the sorted list; return the indices of the features, `order[rank]`.": in_sorted_list,
        "a square is overfull; the square of a feature is `uv // size`, column and row.": Condition(overfull),
        "the ages are right, but among features of the same age strength is not used.": Condition(
            lambda got, uv, age, *more: sorted(age[got]) == sorted(age[kept(uv, age, *more)])
        ),
        "neither age nor strength is used.": chosen(0, 0),
        "only `count` features in all are kept; keep `count` in each square.": (
            lambda uv, age, strength, size, count: np.lexsort((-strength, -age))[:count],
        ),
        "squares with fewer than `count` features are empty; such a square keeps all its features.": (
            in_full_squares
        ),
        "a square keeps one feature more than `count`.": lambda *case: kept(*case[:4], case[4] + 1),
        "the image is cut into strips, not squares: a square is a column and a row of the grid.": (
            lambda uv, *case: kept(uv * [1, 0], *case),
            lambda uv, *case: kept(uv * [0, 1], *case),
        ),
    },
)

too_strict = Exercise(
    {"right ones dropped": 140.0, "wrong among the kept": 9.0},
    praise="{right ones dropped:.0f} correct matches are dropped, and {wrong among the kept:.0f} wrong matches are "
    "still kept. A strict check is not a safe check.",
    mistakes={
        "this sequence has no truth for single matches: choose a drawn sequence.": lambda now: np.isnan(
            now["right ones dropped"]
        ),
        "only {right ones dropped:.0f} correct matches are dropped. Set one tolerance below the accuracy of the "
        "matches.": lambda now: not now["right ones dropped"] > 100,
    },
)
