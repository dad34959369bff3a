"""Features in vehicle boxes of their own image go, before bucketing, unless too few would be left."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from box_scenes import CAMERA, STEP, Vehicle, drive

from vo_lib import DataError, open_sequence, preset, run
from vo_lib.beyond.box_filter import BoxFilter, Filtered, on_vehicles_that_move, static_matches
from vo_lib.beyond.box_tracks import MOVING, PARKED, UNKNOWN, Judgement
from vo_lib.config import FilterConfig, MovingConfig
from vo_lib.core import settings
from vo_lib.core.boxes import Boxes, no_boxes
from vo_lib.core.matches import StereoMatches
from vo_lib.data.sequence import Sequence
from vo_lib.data.truth import STILL, open_truth
from vo_lib.runs.runner import FoundMatches


def box(*xyxy: float, class_id: int = 2, score: float = 1.0) -> Boxes:
    return Boxes(np.array([xyxy], float), np.array([class_id]), np.array([score]))


ALWAYS = FilterConfig(rule="all", min_matches=0, min_share=0.0)
# A car's box goes 100 px to the right from frame to frame.
LEFT, MIDDLE, RIGHT = (100.0, 100.0, 150.0, 150.0), (200.0, 100.0, 250.0, 150.0), (300.0, 100.0, 350.0, 150.0)
IN_LEFT, IN_MIDDLE, IN_RIGHT, AWAY = (125.0, 125.0), (225.0, 125.0), (325.0, 125.0), (500.0, 125.0)
Point = tuple[float, float]


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
    keep, off = static_matches(matches, box(*LEFT), box(*MIDDLE), ALWAYS)
    assert keep.tolist() == [stays for _, stays in STEPS]
    assert not off


def test_the_filter_remembers_the_boxes_of_one_frame_only() -> None:
    rule = BoxFilter(CAMERA, ALWAYS)
    rule.start(box(*LEFT))
    first = rule.step(going(*(step for step, _ in STEPS)), box(*MIDDLE))
    assert first.keep.tolist() == [stays for _, stays in STEPS]
    steps = going((IN_MIDDLE, AWAY), (AWAY, IN_RIGHT), (IN_LEFT, AWAY), (IN_RIGHT, AWAY), (AWAY, IN_MIDDLE))
    assert rule.step(steps, box(*RIGHT)).keep.tolist() == [False, False, True, True, True]
    assert rule.step(going((IN_RIGHT, AWAY), (AWAY, AWAY)), no_boxes()).keep.tolist() == [False, True]
    assert rule.step(going((IN_RIGHT, IN_RIGHT), (AWAY, AWAY)), no_boxes()).keep.all()


def judgement_of(state: int, state_before: int, agrees: list[bool]) -> Judgement:
    """One box of this frame in the middle, one of the frame before to the left."""
    return Judgement(
        boxes=box(*MIDDLE),
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
    gone = on_vehicles_that_move(matches, judgement_of(now, before, [True] * 4), config)
    least = MOVING if unknown == "keep" else UNKNOWN
    assert gone.tolist() == [before >= least, now >= least, False, False]


def test_what_disagrees_with_the_background_goes_where_a_box_is_and_nowhere_else() -> None:
    matches = going((IN_LEFT, AWAY), (AWAY, IN_MIDDLE), (IN_MIDDLE, AWAY), (AWAY, IN_LEFT))
    gone = on_vehicles_that_move(
        matches, judgement_of(PARKED, PARKED, [False] * 4), FilterConfig(rule="moving", moving=MovingConfig())
    )
    assert gone.tolist() == [True, True, False, False]


def test_with_too_few_left_the_filter_is_off_and_says_so() -> None:
    matches = going(*[((15.0, 15.0), (15.0, 15.0))] * 9, ((50.0, 50.0), (50.0, 50.0)))
    for config in (FilterConfig(min_matches=2, min_share=0.0), FilterConfig(min_matches=0, min_share=0.3)):
        keep, off = static_matches(matches, box(10, 10, 20, 20), box(10, 10, 20, 20), config)
        assert off
        assert keep.all()
    # Few matches from the start are not the filter's fault.
    assert not static_matches(matches, no_boxes(), no_boxes(), FilterConfig())[1]


def two_cars() -> tuple[Boxes, list[tuple[StereoMatches, Boxes]]]:
    """A car ahead that keeps its distance and a parked one, over six frames; features 200 on are theirs."""
    ahead = tuple((-STEP[:3, 3]).tolist())
    return drive([Vehicle((-0.5, 0.8, 14.0), ahead), Vehicle((4.0, 0.8, 22.0))], 6, noise=0.1)


def filtered(config: FilterConfig) -> list[Filtered]:
    first, frames = two_cars()
    rule = BoxFilter(CAMERA, config)
    rule.start(first)
    return [rule.step(matches, boxes) for matches, boxes in frames]


def test_the_rule_moving_removes_what_is_on_cars_that_move_and_keeps_parked_ones() -> None:
    for found in filtered(FilterConfig(rule="moving"))[1:]:
        assert not found.keep[200:220].any()
        assert found.keep[220:].mean() > 0.8
    for found in filtered(FilterConfig(rule="all")):
        assert not found.keep[200:].any()
        assert found.judgement is None


def test_features_of_parked_cars_have_to_agree_with_the_street() -> None:
    first, frames = two_cars()
    matches = frames[-1][0]
    # The last feature of the parked car jumps by three pixels, as one on an outline would.
    matches.cur_left[-1, 0] += 3.0
    matches.cur_right[-1, 0] += 3.0
    for agreement, stays in ((2.0, False), (1000.0, True)):
        rule = BoxFilter(CAMERA, FilterConfig(rule="moving", moving=MovingConfig(agreement=agreement)))
        rule.start(first)
        found = [rule.step(*frame) for frame in frames]
        assert found[-1].keep[-1] == stays


def test_the_rule_truth_removes_what_it_is_told_and_asks_to_be_told() -> None:
    first, frames = two_cars()
    rule = BoxFilter(CAMERA, FilterConfig(rule="truth"))
    rule.start(first)
    on_moving = np.arange(240) < 50
    assert (rule.step(*frames[0], on_moving).keep == ~on_moving).all()
    with pytest.raises(ValueError, match="needs to be told"):
        rule.step(*frames[1])


def test_a_frame_with_little_background_is_flagged() -> None:
    first, frames = two_cars()
    rule = BoxFilter(CAMERA, FilterConfig(rule="moving", min_matches=0, min_share=0.0))
    rule.start(first)
    matches, boxes = frames[0]
    assert rule.step(matches[np.arange(190, 240)], boxes).flags == ("few_background",)


@pytest.fixture(scope="module")
def judged(street: Sequence) -> list[tuple[float, int, bool, int]]:
    """Frames 90 … 150 of the drawn street: of each box, true speed, features, parked, state."""
    sequence, truth = street.part(90, 150), open_truth(street.folder)
    config = preset("moving_selection")
    rule = BoxFilter(sequence.camera, config.filter)
    rule.start(sequence.boxes(0))
    found = []
    for index, (matches, _) in enumerate(FoundMatches(sequence, config.features, config.matching)):
        if index == 0:
            continue
        judgement = rule.step(matches, sequence.boxes(index)).judgement
        assert judgement is not None
        frame = int(sequence.frames[index])
        ids = truth.ids(frame)
        for xyxy, state in zip(judgement.boxes.xyxy, judgement.state.tolist(), strict=True):
            x0, y0, x1, y1 = np.rint(xyxy).astype(int).tolist()
            seen = np.bincount(ids[y0 : y1 + 1, x0 : x1 + 1].ravel(), minlength=len(truth.instance) + 1)
            # The vehicle whose pixels fill the box best; those of others in it are a small part of them.
            every = np.bincount(ids.ravel(), minlength=len(seen))[: len(seen)]
            whole = np.where(seen >= 0.95 * every, seen, 0)[1 : len(truth.instance) + 1]
            vehicle = int(np.argmax(whole))
            u, v = matches.cur_left.T
            inside = int(np.count_nonzero((u >= x0) & (u <= x1) & (v >= y0) & (v <= y1)))
            way = np.linalg.norm(np.diff(truth.objects[:, vehicle, :3, 3], axis=0), axis=1)
            speed = truth.config.rate * float(way[frame])
            found.append((speed, inside, float(way.max()) < STILL, state))
    return found


def test_moving_vehicles_of_a_drawn_street_are_told_from_parked_ones(
    judged: list[tuple[float, int, bool, int]],
) -> None:
    speed, inside, still, state = (np.array(column) for column in zip(*judged, strict=True))
    moving, parked = (inside >= 6) & (speed > 1.5), (inside >= 6) & still
    assert moving.sum() > 50
    assert parked.sum() > 50
    right = np.count_nonzero(moving & (state == MOVING))
    wrong = np.count_nonzero(parked & (state == MOVING))
    assert right / (right + wrong) >= 0.9
    assert right / moving.sum() >= 0.85


def test_the_truth_of_a_drawn_street_removes_its_moving_vehicles_only(street: Sequence) -> None:
    sequence = street.part(100, 104)
    config = settings.replace(preset("solution_selection"), "filter.rule", "truth")
    removed = [motion.removed for motion in run(sequence, config).motions]
    everything = [motion.removed for motion in run(sequence, preset("feature_selection")).motions]
    assert all(0 < some < most for some, most in zip(removed, everything, strict=True))


def test_without_truth_the_rule_truth_says_what_it_needs(bands: Path) -> None:
    config = settings.replace(preset("solution_selection"), "filter.rule", "truth")
    with pytest.raises(DataError, match=r"no truth of what moves.*drawn scenes"):
        run(open_sequence(bands), config)
