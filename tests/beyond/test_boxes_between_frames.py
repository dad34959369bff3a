"""A box holds the features of its own image: the previous one's boxes the previous points, and so on."""

from __future__ import annotations

import numpy as np
import pytest
from box_scenes import CAMERA

from vo_lib.beyond.box_filter import BoxFilter, on_vehicles_that_move, static_matches
from vo_lib.beyond.box_tracks import MOVING, PARKED, UNKNOWN, Judgement
from vo_lib.config import FilterConfig, MovingConfig
from vo_lib.core.boxes import Boxes, no_boxes
from vo_lib.core.matches import StereoMatches

ALWAYS = FilterConfig(rule="all", min_matches=0, min_share=0.0)
# A car's box goes 100 px to the right from frame to frame.
LEFT, MIDDLE, RIGHT = (100.0, 100.0, 150.0, 150.0), (200.0, 100.0, 250.0, 150.0), (300.0, 100.0, 350.0, 150.0)
IN_LEFT, IN_MIDDLE, IN_RIGHT, AWAY = (125.0, 125.0), (225.0, 125.0), (325.0, 125.0), (500.0, 125.0)
Point = tuple[float, float]


def box(*places: tuple[float, ...]) -> Boxes:
    return Boxes(np.array(places).reshape(-1, 4), np.full(len(places), 2), np.ones(len(places)))


def going(*steps: tuple[Point, Point]) -> StereoMatches:
    """Matches from one left point to another."""
    p, c = (np.array(points) for points in zip(*steps, strict=True))
    whole = np.ones(len(p), np.int64)
    return StereoMatches(p, p - (20.0, 0.0), c, c - (20.0, 0.0), whole, np.ones(len(p)), np.arange(len(p)))


# What a match from one place to another is when the box goes from LEFT to MIDDLE.
STEPS = [
    ((IN_LEFT, IN_MIDDLE), False),  # on the car
    ((IN_LEFT, AWAY), False),  # on the car's old place: it was covered then
    ((AWAY, IN_MIDDLE), False),  # on the car's new place: it is covered now
    ((IN_MIDDLE, AWAY), True),  # where the car had not come yet
    ((AWAY, IN_LEFT), True),  # where the car was and is no more
    ((AWAY, AWAY), True),
]


def test_each_point_is_asked_with_the_boxes_of_its_own_image() -> None:
    matches = going(*(step for step, _ in STEPS))
    keep, off = static_matches(matches, box(LEFT), box(MIDDLE), ALWAYS)
    assert keep.tolist() == [stays for _, stays in STEPS]
    assert not off


def test_the_filter_remembers_the_boxes_of_one_frame_only() -> None:
    rule = BoxFilter(CAMERA, ALWAYS)
    rule.start(box(LEFT))
    first = rule.step(going(*(step for step, _ in STEPS)), box(MIDDLE))
    assert first.keep.tolist() == [stays for _, stays in STEPS]
    steps = going((IN_MIDDLE, AWAY), (AWAY, IN_RIGHT), (IN_LEFT, AWAY), (IN_RIGHT, AWAY), (AWAY, IN_MIDDLE))
    assert rule.step(steps, box(RIGHT)).keep.tolist() == [False, False, True, True, True]
    assert rule.step(going((IN_RIGHT, AWAY), (AWAY, AWAY)), no_boxes()).keep.tolist() == [False, True]
    assert rule.step(going((IN_RIGHT, IN_RIGHT), (AWAY, AWAY)), no_boxes()).keep.all()


def judged(state: int, state_before: int, agrees: list[bool]) -> Judgement:
    """One box of this frame in the middle, one of the frame before to the left."""
    return Judgement(
        boxes=box(MIDDLE),
        state=np.array([state]),
        step=np.zeros((1, 3)),
        matches=np.array([5]),
        before=np.array([LEFT]),
        state_before=np.array([state_before]),
        few_background=False,
        agrees=np.array(agrees),
    )


@pytest.mark.parametrize("now", [PARKED, UNKNOWN, MOVING])
@pytest.mark.parametrize("before", [PARKED, UNKNOWN, MOVING])
@pytest.mark.parametrize("unknown", ["keep", "remove"])
def test_what_moves_is_asked_with_the_boxes_of_its_own_image_too(now: int, before: int, unknown: str) -> None:
    matches = going((IN_LEFT, AWAY), (AWAY, IN_MIDDLE), (IN_MIDDLE, AWAY), (AWAY, IN_LEFT))
    config = FilterConfig(rule="moving", moving=MovingConfig(unknown=unknown))
    gone = on_vehicles_that_move(matches, judged(now, before, [True] * 4), config)
    least = MOVING if unknown == "keep" else UNKNOWN
    assert gone.tolist() == [before >= least, now >= least, False, False]


def test_what_disagrees_with_the_background_goes_where_a_box_is_and_nowhere_else() -> None:
    matches = going((IN_LEFT, AWAY), (AWAY, IN_MIDDLE), (IN_MIDDLE, AWAY), (AWAY, IN_LEFT))
    gone = on_vehicles_that_move(
        matches, judged(PARKED, PARKED, [False] * 4), FilterConfig(rule="moving", moving=MovingConfig())
    )
    assert gone.tolist() == [True, True, False, False]
