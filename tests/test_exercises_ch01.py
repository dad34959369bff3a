"""Chapter 1's checks: right answers pass, each foreseen mistake gets its own words."""

from __future__ import annotations

from typing import Any

import numpy as np

from vo_lib.config import BucketConfig
from vo_lib.course.exercises import Verdict, ch01
from vo_lib.method.buckets import select_by_bucket


def wrong(verdict: Verdict, words: str) -> None:
    """The verdict is "not yet" and says why."""
    assert not verdict.passed
    assert words in f"{verdict.message} {verdict.hint}"


def eigenvalues(gx: Any, gy: Any) -> Any:
    return np.linalg.eigvalsh([[np.sum(gx * gx), np.sum(gx * gy)], [np.sum(gx * gy), np.sum(gy * gy)]])


def test_corner_strength() -> None:
    assert ch01.corner_strength(lambda gx, gy: np.sqrt(max(eigenvalues(gx, gy)[0], 0.0))).passed
    wrong(ch01.corner_strength(lambda gx, gy: np.sqrt(eigenvalues(gx, gy)[1])), "larger eigenvalue")
    wrong(ch01.corner_strength(lambda gx, gy: eigenvalues(gx, gy)[0]), "root")
    mean = lambda gx, gy: np.sqrt(max(eigenvalues(gx, gy)[0] / gx.size, 0.0))  # noqa: E731
    wrong(ch01.corner_strength(mean), "means")
    wrong(ch01.corner_strength(lambda gx, gy: float("nan")), "NaN")


def test_stereo_check() -> None:
    def right(left: Any, right: Any, rows: float, least: float) -> Any:
        return (np.abs(left[:, 1] - right[:, 1]) <= rows) & (left[:, 0] - right[:, 0] >= least)

    assert ch01.is_stereo(right).passed
    wrong(ch01.is_stereo(lambda a, b, rows, least: a[:, 0] - b[:, 0] >= least), "two rows lower")
    wrong(ch01.is_stereo(lambda a, b, rows, least: np.abs(a[:, 1] - b[:, 1]) <= rows), "0.2 px of disparity")
    signless = lambda a, b, rows, least: right(a, b, rows, -99) & (np.abs(a - b)[:, 0] >= least)  # noqa: E731
    wrong(ch01.is_stereo(signless), "further right")
    one_sided = lambda a, b, rows, least: (b[:, 1] - a[:, 1] <= rows) & (a[:, 0] - b[:, 0] >= least)  # noqa: E731
    wrong(ch01.is_stereo(one_sided), "two rows higher")


def follow(chains: tuple[Any, ...]) -> tuple[Any, Any]:
    at = np.arange(len(chains[0]))
    alive = np.ones(len(at), np.bool_)
    for chain in chains:
        at = chain[at]
        alive &= at >= 0
    return at, alive


def test_the_loop() -> None:
    def closes(*chains: Any) -> Any:
        at, alive = follow(chains)
        return np.flatnonzero(alive & (at == np.arange(len(at))))

    assert ch01.loop_closes(closes).passed
    wrong(ch01.loop_closes(lambda *c: np.flatnonzero(c[3][c[2][c[1][c[0]]]] == np.arange(12))), "index -1")
    wrong(ch01.loop_closes(lambda *c: np.flatnonzero(follow(c[:3])[1])), "way back")
    wrong(ch01.loop_closes(lambda *c: np.isin(np.arange(12), closes(*c))), "mask")
    wrong(ch01.loop_closes(lambda *c: [0]), "expected")
    wrong(ch01.loop_closes(lambda *c: None), "missing")


def test_peak() -> None:
    assert ch01.peak(lambda a, b, c: (a - c) / 2 / (a - 2 * b + c)).passed
    wrong(ch01.peak(lambda a, b, c: (c - a) / 2 / (a - 2 * b + c)), "sign")
    wrong(ch01.peak(lambda a, b, c: (a - c) / (a - 2 * b + c)), "factor of two")
    wrong(ch01.peak(lambda a, b, c: 0.1), "the top is at 0.3")


def test_buckets() -> None:
    def by(age_sign: int, strength_sign: int) -> Any:
        def chosen(uv: Any, age: Any, strength: Any, size: int, count: int) -> Any:
            config = BucketConfig(size=size, features=count)
            return select_by_bucket(uv, age_sign * age, strength_sign * strength, config)

        return chosen

    assert ch01.buckets(by(1, 1)).passed
    wrong(ch01.buckets(by(0, 1)), "age was not asked")
    wrong(ch01.buckets(by(-1, 1)), "youngest")
    wrong(ch01.buckets(by(1, -1)), "weakest")
    wrong(ch01.buckets(lambda uv, age, strength, size, count: np.arange(count)), "left in all")
    wrong(ch01.buckets(lambda uv, age, strength, size, count: np.arange(len(uv))), "allowed are 3")
    wrong(ch01.buckets(lambda uv, age, strength, size, count: [0, 1, 2, 3]), "expected")


def test_too_strict() -> None:
    assert ch01.too_strict({"right ones dropped": 140.0, "wrong among the kept": 9.0}).passed
    wrong(ch01.too_strict({"right ones dropped": 40.0}), "only 40")
    wrong(ch01.too_strict({}), "synthetic")
