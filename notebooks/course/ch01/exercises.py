"""Exercises of chapter 1: corner strength, stereo checks, the loop, a peak between pixels, buckets."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from vo_lib.config import BucketConfig
from vo_lib.core.types import Array, Index
from vo_lib.method.buckets import select_by_bucket

from ..checker import Case, Exercise, Mistake, any_order, times


def windows() -> list[Case]:
    """Gradients of a corner and of edges in many directions; rounding makes some eigenvalues negative."""
    rng = np.random.default_rng(0)
    edges = [
        (a * g, b * g) for a, b, g in zip(*rng.normal(size=(2, 20)), rng.normal(size=(20, 5, 5)), strict=True)
    ]
    return [tuple(rng.normal(size=(2, 5, 5))), (rng.normal(size=(5, 5)), np.zeros((5, 5))), *edges]


def eigenvalues(gx: Array, gy: Array, total: Callable[..., Any] = np.sum) -> Array:
    """Eigenvalues (2,) of the structure tensor, the smaller one first."""
    return np.linalg.eigvalsh([[total(gx * gx), total(gx * gy)], [total(gx * gy), total(gy * gy)]])


def stereo_pairs() -> list[Case]:
    """A good match, one two rows lower, one at 0.2 px, one with a negative disparity, one higher; and all."""
    left = np.tile([100.0, 50.0], (5, 1))
    right = np.array([[90.0, 50.4], [90.0, 52.0], [99.8, 50.0], [110.0, 50.0], [90.0, 48.0]])
    ones = [(left[[i]], right[[i]], 1.0, 0.5) for i in range(5)]
    return [*ones, (left, right, 1.0, 0.5)]


def chains() -> list[Case]:
    """Best matches between four images of 12 features; most chains close, some are lost or go astray."""
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
    """Where each feature's matches lead, and whether none of them is missing."""
    at, found = np.arange(len(steps[0])), np.ones(len(steps[0]), np.bool_)
    for step in steps:
        at = step[at]
        found &= at >= 0
    return at, found


def closed(*steps: Index) -> Any:
    """Mask of the features whose chain ends where it began."""
    at, found = follow(*steps)
    return found & (at == np.arange(len(at)))


def crowd() -> list[Case]:
    """120 features with ages and strengths, and two grids of buckets."""
    rng = np.random.default_rng(11)
    features = rng.uniform(0, 1, (120, 2)) * (300.0, 150.0), rng.integers(1, 4, 120), rng.uniform(1, 9, 120)
    return [(*features, 50, 3), (*features, 70, 1)]


def judged(row: Callable[..., Any], disparity: Callable[..., Any]) -> Callable[..., Any]:
    """The stereo check, of functions of the differences in row and in column."""
    return lambda left, right, row_tolerance, min_disparity: (
        (row((left - right)[:, 1]) <= row_tolerance) & (disparity((left - right)[:, 0]) >= min_disparity)
    )


def top(left: float, middle: float, right: float) -> float:
    """Where the parabola through three values has its top."""
    return (left - right) / 2 / (left - 2 * middle + right)


def chosen(by_age: int = 1, by_strength: int = 1) -> Callable[..., Index]:
    """The choice of features by bucket, with the signs that ages and strengths count with."""
    return lambda uv, age, strength, size, count: select_by_bucket(
        uv, by_age * age, by_strength * strength, BucketConfig(size=size, features=count)
    )


def overfull(kept: Array, uv: Array, age: Array, strength: Array, size: int, count: int) -> bool:
    """Whether a bucket keeps more features than it may."""
    return bool(np.unique(uv[kept.astype(int)] // size, axis=0, return_counts=True)[1].max() > count)


corner_strength = Exercise(
    lambda gx, gy: np.sqrt(max(eigenvalues(gx, gy)[0], 0.0)),
    windows,
    atol=1e-6,
    task=(
        "A function (gx, gy): gradients of a window, (n, n) each -> root of the tensor's smaller eigenvalue."
    ),
    praise="0 on an edge, large on a corner. The library has it for every pixel at once.",
    hint="M = [[Σ gx², Σ gx gy], [Σ gx gy, Σ gy²]]; np.linalg.eigvalsh sorts from small to large.",
    library=("corner_strength",),
    mistakes=(
        Mistake(
            "this is the larger eigenvalue: an edge has that, too.",
            "a corner needs the smaller one.",
            lambda gx, gy: np.sqrt(eigenvalues(gx, gy)[1]),
        ),
        Mistake("right, but for the root.", "np.sqrt.", lambda gx, gy: eigenvalues(gx, gy)[0]),
        Mistake(
            "this takes means over the window.",
            "sums: Σ gx², Σ gx gy, Σ gy².",
            lambda gx, gy: np.sqrt(max(eigenvalues(gx, gy, np.mean)[0], 0.0)),
        ),
        Mistake(
            "this is the determinant.",
            "np.linalg.eigvalsh(M)[0].",
            lambda gx, gy: np.sqrt(abs(np.prod(eigenvalues(gx, gy)))),
        ),
        Mistake(
            "NaN for an edge.",
            "rounding may make an eigenvalue -1e-17: max(λ, 0) before the root.",
            lambda gx, gy: np.sqrt(eigenvalues(gx, gy)[0]),
            when=lambda got, *case: np.isnan(got),
        ),
    ),
)

is_stereo = Exercise(
    judged(np.abs, np.positive),
    stereo_pairs,
    task="A function (left (N, 2), right (N, 2), row_tolerance, min_disparity) -> (N,) bool.",
    praise="rows agree, and the point lies further left in the right image, by enough.",
    hint=(
        "rows: np.abs(left[:, 1] - right[:, 1]) <= row_tolerance; disparity: left[:, 0] - right[:, 0] >= "
        "min_disparity."
    ),
    mistakes=(
        Mistake(
            "rows and columns are exchanged.",
            "a point is (u, v): [:, 0] is its column, [:, 1] its row.",
            lambda left, right, rows, least: judged(np.abs, np.positive)(
                left[:, ::-1], right[:, ::-1], rows, least
            ),
        ),
        Mistake(
            "the match that is two rows lower is judged good.",
            "np.abs(left[:, 1] - right[:, 1]) <= row_tolerance.",
            judged(np.zeros_like, np.positive),
        ),
        Mistake(
            "the match that is at 0.2 px of disparity is judged good.",
            "left[:, 0] - right[:, 0] >= min_disparity.",
            judged(np.abs, lambda disparity: disparity + 99.0),
        ),
        Mistake(
            "the match that is further right in the right image is judged good.",
            "the disparity is left minus right, with its sign.",
            judged(np.abs, np.abs),
        ),
        Mistake(
            "a match that is two rows off to one side is judged good.",
            "the absolute value of the row difference.",
            judged(np.positive, np.positive),
            judged(np.negative, np.positive),
        ),
        Mistake(
            "a good match is judged bad, and one further right in the right image good.",
            "the disparity is left minus right.",
            judged(np.abs, np.negative),
        ),
        Mistake(
            "matches with too small a disparity are judged good, and those with enough bad.",
            "at least `min_disparity`: >=, not <=.",
            lambda left, right, rows, least: (
                judged(np.abs, np.positive)(left, right, rows, -99.0) & ((left - right)[:, 0] <= least)
            ),
            lambda left, right, rows, least: (
                judged(np.abs, np.positive)(left, right, rows, -99.0) & ((left - right)[:, 0] < least)
            ),
        ),
    ),
)

loop_closes = Exercise(
    lambda pl_pr, pr_cr, cr_cl, cl_pl: np.flatnonzero(closed(pl_pr, pr_cr, cr_cl, cl_pl)),
    chains,
    form=any_order,
    task=(
        "A function (pl_pr, pr_cr, cr_cl, cl_pl): best matches as indices, -1 for none -> indices that close."
    ),
    praise="four matches, one condition, and hardly a mismatch gets through.",
    hint="start with i = 0 … N-1; then pl_pr[i], pr_cr of that, cr_cl of that, cl_pl of that.",
    mistakes=(
        Mistake(
            "a match of -1 was followed: numpy takes index -1 for the last one.",
            "keep only chains in which no step is -1.",
            lambda a, b, c, d: np.flatnonzero(d[c[b[a]]] == np.arange(len(a))),
        ),
        Mistake(
            "these reach the current left image.",
            "the way back has to end where it began.",
            lambda a, b, c, d: np.flatnonzero(follow(a, b, c)[1]),
        ),
        Mistake(
            "this looks like a mask.",
            "np.flatnonzero turns it into indices.",
            closed,
            when=lambda got, a, *case: len(got) == len(a) and set(np.unique(got)) <= {0, 1},
        ),
    ),
)

peak = Exercise(
    top,
    lambda: [
        tuple(height + curve * (x - top) ** 2 for x in (-1.0, 0.0, 1.0))
        for top, height, curve in ((0.3, 5.0, -2.0), (-0.45, 1.0, -0.5), (0.0, 2.0, -1.0))
    ],
    task="A function (left, middle, right) -> place of a parabola's top, in pixels from the middle one.",
    praise="three values fix a parabola, and its top lies between the pixels.",
    hint="f(x) = f(0) + b x + a x²: b = (right - left) / 2, 2 a = left - 2 middle + right; top: -b / 2 a.",
    mistakes=(
        Mistake(
            "this is the height of the top.",
            "its place is asked: how far from the middle, in pixels.",
            lambda left, middle, right: middle - (left - right) ** 2 / (8 * (left - 2 * middle + right)),
        ),
        Mistake("the sign is wrong.", "the top lies on the side of the larger neighbour.", times(top, -1.0)),
        Mistake(
            "off by a factor of two.",
            "½ (left - right) / (left - 2 middle + right).",
            times(top, 2.0),
            times(top, 0.5),
        ),
    ),
)

buckets = Exercise(
    chosen(),
    crowd,
    form=any_order,
    task="A function (uv (N, 2), age (N,), strength (N,), size, count) -> indices of the features kept.",
    praise="spread over the image, and the tried ones first.",
    hint="np.lexsort((-strength, -age)).",
    library=("select_by_bucket",),
    mistakes=(
        Mistake(
            "age was not asked.",
            "older features first; strength decides among equally old ones.",
            chosen(by_age=0),
        ),
        Mistake("the youngest come first.", "older features first: sort by -age.", chosen(by_age=-1)),
        Mistake(
            "the ages are right, but among equally old features strength was not asked.",
            "sort by -age, then by -strength: np.lexsort((-strength, -age)).",
            chosen(by_strength=0),
            when=lambda got, uv, age, strength, size, count: (
                len(got) == len(chosen()(uv, age, strength, size, count))
                and sorted(age[got]) == sorted(age[chosen()(uv, age, strength, size, count)])
                and not overfull(got, uv, age, strength, size, count)
            ),
        ),
        Mistake(
            "of equally old features the weakest are kept.", "sort by -strength.", chosen(by_strength=-1)
        ),
        Mistake(
            "only `count` features are left in all.",
            "`count` in each bucket.",
            lambda uv, age, strength, size, count: np.arange(count),
            when=lambda got, *case: len(got) == case[4],
        ),
        Mistake(
            "a bucket has more features than `count` allows.",
            "the bucket of a feature is (uv // size), column and row.",
            lambda uv, *case: np.arange(len(uv)),
            when=overfull,
        ),
    ),
)

too_strict = Exercise(
    {"right ones dropped": 140.0, "wrong among the kept": 9.0},
    task="The panel shows checks that drop more than 100 matches which are right.",
    praise=(
        "{right ones dropped:.0f} right ones are gone, and {wrong among the kept:.0f} wrong ones are still "
        "there. Strict is not the same as safe."
    ),
    hint="",
    mistakes=(
        Mistake(
            "here nobody knows what is right.",
            "choose a synthetic sequence.",
            {"right ones dropped": np.nan},
            when=lambda facts: np.isnan(facts["right ones dropped"]),
        ),
        Mistake(
            "only {right ones dropped:.0f} right matches are dropped.",
            "make one tolerance smaller than matches are exact.",
            {"right ones dropped": 40.0},
            when=lambda facts: not facts["right ones dropped"] > 100,
        ),
    ),
)
