"""Exercises of chapter 1: corner strength, stereo checks, the loop, a peak between pixels, buckets."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from vo_lib.config import BucketConfig
from vo_lib.core.types import Array, Index
from vo_lib.method.buckets import select_by_bucket

from ..checker import Case, Exercise, any_order


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
    "ch01.corner_strength", lambda gx, gy: np.sqrt(max(eigenvalues(gx, gy)[0], 0.0)), windows, atol=1e-6
)

is_stereo = Exercise("ch01.is_stereo", judged(np.abs, np.positive), stereo_pairs)

loop_closes = Exercise(
    "ch01.loop_closes",
    lambda pl_pr, pr_cr, cr_cl, cl_pl: np.flatnonzero(closed(pl_pr, pr_cr, cr_cl, cl_pl)),
    chains,
    form=any_order,
)

peak = Exercise(
    "ch01.peak",
    top,
    lambda: [
        tuple(height + curve * (x - top) ** 2 for x in (-1.0, 0.0, 1.0))
        for top, height, curve in ((0.3, 5.0, -2.0), (-0.45, 1.0, -0.5), (0.0, 2.0, -1.0))
    ],
)

buckets = Exercise("ch01.buckets", chosen(), crowd, form=any_order)

too_strict = Exercise("ch01.too_strict", {"right ones dropped": 140.0, "wrong among the kept": 9.0})
