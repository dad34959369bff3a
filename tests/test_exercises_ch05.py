"""The checks of chapter 5: right answers pass, each foreseen mistake gets its own words."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from vo_lib.beyond.box_tracks import overlap
from vo_lib.core.types import Array
from vo_lib.course.exercises import Verdict, ch05


def wrong(verdict: Verdict, words: str) -> None:
    """The verdict is "not yet" and says why."""
    assert not verdict.passed
    assert words in f"{verdict.message} {verdict.hint}"


def inverse(xyxy: Array, scale: float, left: int, top: int, width: int, height: int) -> Array:
    return np.asarray(np.clip((xyxy - (left, top) * 2) / scale, 0, (width, height) * 2) - 0.5)


def iou(a: Array, b: Array) -> float:
    return float(overlap(a[None], b[None])[0, 0])


def common(a: Array, b: Array) -> float:
    return float(np.prod(np.maximum(np.minimum(a[2:], b[2:]) - np.maximum(a[:2], b[:2]), 0)))


def area(a: Array) -> float:
    return float(np.prod(a[2:] - a[:2]))


def suppress(corners: Array, scores: Array, most: float) -> list[int]:
    shared = overlap(corners, corners)
    kept: list[int] = []
    for k in np.argsort(-scores).tolist():
        if all(shared[k, better] <= most for better in kept):
            kept.append(k)
    return kept


def inside(uv: Array, boxes: Array) -> Any:
    u, v = uv[:, :1], uv[:, 1:]
    within = (u >= boxes[:, 0]) & (u <= boxes[:, 2]) & (v >= boxes[:, 1]) & (v <= boxes[:, 3])
    return np.asarray(within).any(axis=1)


def keep_outside(uv_p: Array, uv_c: Array, boxes_p: Array, boxes_c: Array) -> Any:
    return ~(inside(uv_p, boxes_p) | inside(uv_c, boxes_c))


def test_the_right_answers_pass() -> None:
    assert ch05.to_image(inverse).passed
    assert ch05.cells(4200).passed
    assert ch05.iou(iou).passed
    assert ch05.suppress(suppress).passed
    assert ch05.keep_outside(keep_outside).passed


@pytest.mark.parametrize(
    ("answer", "words"),
    [
        (lambda b, s, x, y, w, h: (b - (x, y) * 2) / s - 0.5, "hangs over the edge"),
        (lambda b, s, x, y, w, h: np.clip((b - (x, y) * 2) / s - 0.5, 0, (w - 1, h - 1) * 2), "too early"),
        (lambda b, s, x, y, w, h: inverse(b, s, x, y, w, h) + 0.5, "half a pixel too far to the right"),
        (lambda b, s, x, y, w, h: inverse(b, s, x, y, w, h) + 1.0, "the other way"),
        (lambda b, s, x, y, w, h: b / s - 0.5, "border is forgotten"),
        (lambda b, s, x, y, w, h: b / s - (x, y) * 2 - 0.5, "wrong order"),
        (lambda b, s, x, y, w, h: (b - (y, x) * 2) / s - 0.5, "exchanged"),
        (lambda b, s, x, y, w, h: (b - (x, y) * 2) * s - 0.5, "multiplied"),
        (lambda b, s, x, y, w, h: b[:, :2], "shape"),
        (lambda b, s, x, y, w, h: b * 0.0, "solve u_net"),
    ],
)
def test_mistakes_in_the_letterbox_inverse(answer: Callable[..., Any], words: str) -> None:
    wrong(ch05.to_image(answer), words)


def test_mistakes_in_the_number_of_cells() -> None:
    for answer, words in (
        (3200, "stride 8 alone"),
        (175, "one row"),
        (204_800, "pixels"),
        (4201, "is not it"),
    ):
        wrong(ch05.cells(answer), words)


@pytest.mark.parametrize(
    ("answer", "words"),
    [
        (common, "common area"),
        (lambda a, b: common(a, b) / (area(a) + area(b)), "counted twice"),
        (lambda a, b: common(a, b) / area(a), "area of one box"),
        (lambda a, b: common(a, b) / min(area(a), area(b)), "area of one box"),
        (lambda a, b: iou(a, b) or 0.1, "do not touch"),
        (lambda a, b: 0.5 * iou(a, b), "got 0."),
        (lambda a, b: 0.0 if (a == b).all() else iou(a, b), "with itself"),
    ],
)
def test_mistakes_in_the_overlap(answer: Callable[..., Any], words: str) -> None:
    wrong(ch05.iou(answer), words)


def test_an_overlap_of_two_negative_sides_is_found() -> None:
    def careless(a: Array, b: Array) -> float:
        shared = float(np.prod(np.minimum(a[2:], b[2:]) - np.maximum(a[:2], b[:2])))
        return shared / (area(a) + area(b) - shared)

    wrong(ch05.iou(careless), "do not touch")


@pytest.mark.parametrize(
    ("answer", "words"),
    [
        (lambda c, s, m: list(range(len(s))), "nothing is suppressed"),
        (lambda c, s, m: suppress(c, -s, m), "the worse of two"),
        (lambda c, s, m: suppress(c, s, 0.0), "only a little"),
        (lambda c, s, m: sorted(suppress(c, s, m)), "another order"),
        (lambda c, s, m: suppress(c, s, 0.5), "for other boxes"),
        (lambda c, s, m: [1], "only a little"),
        (lambda c, s, m: None, "gives back nothing"),
    ],
)
def test_mistakes_in_the_suppression(answer: Callable[..., Any], words: str) -> None:
    wrong(ch05.suppress(answer), words)


@pytest.mark.parametrize(
    ("answer", "words"),
    [
        (lambda p, c, bp, bc: ~keep_outside(p, c, bp, bc), "upside down"),
        (lambda p, c, bp, bc: ~inside(p, bp), "current image is not asked"),
        (lambda p, c, bp, bc: ~inside(c, bc), "previous image is not asked"),
        (lambda p, c, bp, bc: ~(inside(p, bp) & inside(c, bc)), "only when both"),
        (lambda p, c, bp, bc: keep_outside(p, c, bc, bp), "exchanged"),
        (lambda p, c, bp, bc: np.ones(len(p), np.bool_), "judged differently"),
        (lambda p, c, bp, bc: keep_outside(p, c, bp, bc) & bool(len(bp)), "without any box"),
    ],
)
def test_mistakes_in_the_rule(answer: Callable[..., Any], words: str) -> None:
    wrong(ch05.keep_outside(answer), words)


def test_the_panel_must_spare_standing_things() -> None:
    def facts(kept: float, lost: float) -> dict[str, float]:
        return {"removed": 40.0, "on moving things, kept": kept, "on standing things, removed": lost}

    assert ch05.sparing_rule(facts(1, 15)).passed
    wrong(ch05.sparing_rule(facts(4, 15)), "on moving things stay")
    wrong(ch05.sparing_rule(facts(1, 50)), "on standing things go")
    wrong(ch05.sparing_rule(facts(26, 0) | {"removed": 0.0}), "nothing is removed")
    wrong(ch05.sparing_rule({"removed": 3.0}), "nobody knows")
