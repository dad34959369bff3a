"""Exercises of chapter 1: corner strength, stereo checks, the loop, a peak between pixels, buckets."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from ...config import BucketConfig
from ...core.types import Index
from ...method.buckets import select_by_bucket
from .verdict import Wrong, as_array, as_number, exercise


@exercise
def corner_strength(function: Callable[..., Any]) -> str:
    """A function (gx, gy): gradients of a window, (n, n) each -> root of the tensor's smaller eigenvalue."""
    rng = np.random.default_rng(0)
    corner = rng.normal(size=(2, 5, 5))
    edge = np.stack([rng.normal(size=(5, 5)), np.zeros((5, 5))])
    for what, (gx, gy) in (("a corner", corner), ("an edge", edge)):
        M = np.array([[np.sum(gx * gx), np.sum(gx * gy)], [np.sum(gx * gy), np.sum(gy * gy)]])
        small, large = np.linalg.eigvalsh(M)
        right = float(np.sqrt(max(small, 0.0)))
        with np.errstate(invalid="ignore"):
            got = as_number(function(gx.copy(), gy.copy()))
        if np.isnan(got):
            raise Wrong(
                f"NaN for {what}.", "rounding may make an eigenvalue -1e-17: max(λ, 0) before the root."
            )
        if abs(got - right) < 1e-9:
            continue
        if abs(got - np.sqrt(large)) < 1e-9:
            raise Wrong(
                "this is the larger eigenvalue: an edge has that, too.", "a corner needs the smaller one."
            )
        if abs(got - small) < 1e-9:
            raise Wrong("right, but for the root.", "np.sqrt.")
        mean = np.array([[np.mean(gx * gx), np.mean(gx * gy)], [np.mean(gx * gy), np.mean(gy * gy)]])
        if abs(got - np.sqrt(max(float(np.linalg.eigvalsh(mean)[0]), 0.0))) < 1e-9:
            raise Wrong("this takes means over the window.", "sums: Σ gx², Σ gx gy, Σ gy².")
        if abs(got - float(np.sqrt(abs(np.linalg.det(M))))) < 1e-9:
            raise Wrong("this is the determinant.", "np.linalg.eigvalsh(M)[0].")
        raise Wrong(
            f"got {got:.4f} for {what}, expected {right:.4f}.",
            "M = [[Σ gx², Σ gx gy], [Σ gx gy, Σ gy²]]; np.linalg.eigvalsh sorts from small to large.",
        )
    return "0 on an edge, large on a corner. The library has it for every pixel at once."


@exercise
def is_stereo(function: Callable[..., Any]) -> str:
    """A function (left (N, 2), right (N, 2), row_tolerance, min_disparity) -> (N,) bool."""
    left = np.array([[100.0, 50.0], [100.0, 50.0], [100.0, 50.0], [100.0, 50.0], [100.0, 50.0]])
    right = np.array([[90.0, 50.4], [90.0, 52.0], [99.8, 50.0], [110.0, 50.0], [90.0, 48.0]])
    names = (
        "good",
        "two rows lower",
        "at 0.2 px of disparity",
        "further right in the right image",
        "two rows higher",
    )
    expected = np.array([True, False, False, False, False])
    got = as_array(function(left.copy(), right.copy(), 1.0, 0.5), (5,), "the result").astype(bool)
    if np.array_equal(got, expected):
        return "rows agree, and the point lies further left in the right image, by enough."
    wrong = int(np.argmax(got != expected))
    hint = {
        0: "the row is 0.4 px off, allowed is 1 px; the disparity is 10 px.",
        1: "np.abs(left[:, 1] - right[:, 1]) <= row_tolerance.",
        2: "left[:, 0] - right[:, 0] >= min_disparity.",
        3: "the disparity is left minus right, with its sign.",
        4: "the absolute value of the row difference.",
    }[wrong]
    raise Wrong(f"the match that is {names[wrong]} is judged {'good' if got[wrong] else 'bad'}.", hint)


@exercise
def loop_closes(function: Callable[..., Any]) -> str:
    """A function (pl_pr, pr_cr, cr_cl, cl_pl): best matches as indices, -1 for none -> indices that close."""
    for seed in range(20):
        rng = np.random.default_rng(seed)
        a, b, c, d = chains = _chains(rng, 12)
        closed = _closed(*chains)
        got = _indices(function(*(chain.copy() for chain in chains)))
        if len(got) == len(a) and set(np.unique(got)) <= {0, 1} and len(closed) != len(got):
            raise Wrong("this looks like a mask.", "np.flatnonzero turns it into indices.")
        if np.array_equal(got, closed):
            continue
        ignoring = np.flatnonzero(d[c[b[a]]] == np.arange(len(a)))
        if np.array_equal(got, ignoring):
            raise Wrong(
                "a match of -1 was followed: numpy takes index -1 for the last one.",
                "keep only chains in which no step is -1.",
            )
        three = np.flatnonzero((a >= 0) & (b[a] >= 0) & (c[b[a]] >= 0))
        if np.array_equal(got, three):
            raise Wrong("these reach the current left image.", "the way back has to end where it began.")
        raise Wrong(
            f"got {got.tolist()}, expected {closed.tolist()}.",
            "start with i = 0 … N-1; then pl_pr[i], pr_cr of that, cr_cl of that, cl_pl of that.",
        )
    return "four matches, one condition, and hardly a mismatch gets through."


def _indices(answer: Any) -> Index:
    """The answer as sorted whole numbers (K,)."""
    return np.sort(np.ravel(as_array(answer, np.shape(answer)))).astype(np.intp)


def _chains(rng: np.random.Generator, count: int) -> tuple[Index, Index, Index, Index]:
    """Best matches between four images of `count` features; most chains close, some are lost or go astray."""
    forward = [rng.permutation(count) for _ in range(3)]
    back = np.empty(count, np.intp)
    back[forward[2][forward[1][forward[0]]]] = np.arange(count)
    chains = [*forward, back]
    for chain in chains:
        chain[rng.integers(count, size=2)] = -1
        chain[rng.integers(count)] = rng.integers(count)
    return chains[0], chains[1], chains[2], chains[3]


def _closed(a: Index, b: Index, c: Index, d: Index) -> Index:
    closed = []
    for start in range(len(a)):
        at = start
        for chain in (a, b, c, d):
            at = int(chain[at]) if at >= 0 else -1
        if at == start:
            closed.append(start)
    return np.array(closed, np.intp)


@exercise
def peak(function: Callable[..., Any]) -> str:
    """A function (left, middle, right) -> place of a parabola's top, in pixels from the middle one."""
    for top, height, curve in ((0.3, 5.0, -2.0), (-0.45, 1.0, -0.5), (0.0, 2.0, -1.0)):
        values = [height + curve * (x - top) ** 2 for x in (-1.0, 0.0, 1.0)]
        got = as_number(function(*values))
        if abs(got - top) < 1e-9:
            continue
        if abs(got + top) < 1e-9:
            raise Wrong("the sign is wrong.", "the top lies on the side of the larger neighbour.")
        if abs(got - 2.0 * top) < 1e-9 or abs(got - top / 2.0) < 1e-9:
            raise Wrong("off by a factor of two.", "½ (left - right) / (left - 2 middle + right).")
        raise Wrong(
            f"the top is at {top}, got {got:.3f}.",
            "f(x) = f(0) + b x + a x²: b = (right - left) / 2, 2 a = left - 2 middle + right; top: -b / 2 a.",
        )
    return "three values fix a parabola, and its top lies between the pixels."


@exercise
def buckets(function: Callable[..., Any]) -> str:
    """A function (uv (N, 2), age (N,), strength (N,), size, count) -> indices of the features kept."""
    rng = np.random.default_rng(11)
    uv = rng.uniform(0, 1, (120, 2)) * (300.0, 150.0)
    age, strength = rng.integers(1, 4, 120), rng.uniform(1, 9, 120)
    for size, count in ((50, 3), (70, 1)):
        config = BucketConfig(size=size, features=count)
        right = select_by_bucket(uv, age, strength, config)
        answer = function(uv.copy(), age.copy(), strength.copy(), size, count)
        got = _indices(answer)
        if np.array_equal(got, right):
            continue
        by_strength = select_by_bucket(uv, np.ones_like(age), strength, config)
        if np.array_equal(got, by_strength):
            raise Wrong(
                "age was not asked.", "older features first; strength decides among equally old ones."
            )
        if np.array_equal(got, select_by_bucket(uv, -age, strength, config)):
            raise Wrong("the youngest come first.", "older features first: sort by -age.")
        if np.array_equal(got, select_by_bucket(uv, age, -strength, config)):
            raise Wrong("of equally old features the weakest are kept.", "sort by -strength.")
        if len(got) == count:
            raise Wrong(f"only {count} features are left in all.", f"{count} in each bucket.")
        _, number = np.unique((uv[got] // size), axis=0, return_counts=True)
        if number.max() > count:
            raise Wrong(
                f"a bucket has {number.max()} features, allowed are {count}.",
                "the bucket of a feature is (uv // size), column and row.",
            )
        raise Wrong(f"{len(got)} features are kept, expected {len(right)}.", "np.lexsort((-strength, -age)).")
    return "spread over the image, and the tried ones first."


@exercise
def too_strict(facts: Mapping[str, float]) -> str:
    """The panel shows checks that drop more than 100 matches which are right."""
    dropped, wrong = facts.get("right ones dropped", np.nan), facts.get("wrong among the kept", np.nan)
    if np.isnan(dropped):
        raise Wrong("here nobody knows what is right.", "choose a synthetic sequence.")
    if not dropped > 100:
        raise Wrong(
            f"only {dropped:.0f} right matches are dropped.",
            "make one tolerance smaller than matches are exact.",
        )
    return (
        f"{dropped:.0f} right ones are gone, and {wrong:.0f} wrong ones are still there. "
        "Strict is not the same as safe."
    )
