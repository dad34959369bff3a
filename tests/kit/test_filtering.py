"""Box rules: features in vehicle boxes are removed, unless too few features would remain."""

from __future__ import annotations

import numpy as np
import pytest
from box_scenes import CAMERA, STEP, Vehicle, drive

from vo_lib import preset, run, settings
from vo_lib.data.sequence import Sequence
from vo_lib.data.truth import matches_on_moving
from vo_lib.geometry.boxes import MOVING, Boxes, no_boxes
from vo_lib.geometry.matches import StereoMatches
from vo_lib.geometry.result import Flag
from vo_lib.kit.box_rules import KitBoxFilter
from vo_lib.kit.settings import KitFilterConfig, MovingConfig
from vo_lib.paper.box_removal import Removal, inside
from vo_lib.runs.front_end import find_matches


def box(*xyxy: float) -> Boxes:
    return Boxes(np.array([xyxy]), np.array([2]), np.ones(1))


# A car's box moves 100 px to the right per frame.
LEFT, MIDDLE, RIGHT = (100.0, 100.0, 150.0, 150.0), (200.0, 100.0, 250.0, 150.0), (300.0, 100.0, 350.0, 150.0)
IN_LEFT, IN_MIDDLE, IN_RIGHT, AWAY = (125.0, 125.0), (225.0, 125.0), (325.0, 125.0), (500.0, 125.0)
Point = tuple[float, float]


def going(*steps: tuple[Point, Point]) -> StereoMatches:
    """Matches with given points in the previous and in the current left image."""
    p, c = (np.array(points) for points in zip(*steps, strict=True))
    whole = np.ones(len(p), np.int64)
    return StereoMatches(p, p - (20.0, 0.0), c, c - (20.0, 0.0), whole, np.ones(len(p)), np.arange(len(p)))


# Whether a match is kept when the box moves from LEFT to MIDDLE.
STEPS = {
    (IN_LEFT, IN_MIDDLE): False,  # on the car
    (IN_LEFT, AWAY): False,  # previous point in the previous box
    (AWAY, IN_MIDDLE): False,  # current point in the current box
    (IN_MIDDLE, AWAY): True,  # previous point in the current box
    (AWAY, IN_LEFT): True,  # current point in the previous box
    (AWAY, AWAY): True,
}


def test_points_are_tested_with_the_boxes_of_their_image() -> None:
    rule = KitBoxFilter(CAMERA, KitFilterConfig(rule="all", min_matches=0))
    rule.start(box(*LEFT))
    first = rule.step(going(*STEPS), box(*MIDDLE))
    assert (first.kept.tolist(), first.flags) == ([*STEPS.values()], ())
    steps = going((IN_MIDDLE, AWAY), (AWAY, IN_RIGHT), (IN_LEFT, AWAY), (IN_RIGHT, AWAY), (AWAY, IN_MIDDLE))
    assert rule.step(steps, box(*RIGHT)).kept.tolist() == [False, False, True, True, True]
    assert rule.step(going((IN_RIGHT, AWAY), (AWAY, AWAY)), no_boxes()).kept.tolist() == [False, True]
    assert rule.step(going((IN_RIGHT, IN_RIGHT), (AWAY, AWAY)), no_boxes()).kept.all()


def test_filter_is_off_with_too_few_matches() -> None:
    matches = going(*[(IN_LEFT, IN_LEFT)] * 9, (AWAY, AWAY))
    for min_matches, flags in ((2, (Flag.FILTER_OFF,)), (1, ())):
        rule = KitBoxFilter(CAMERA, KitFilterConfig(min_matches=min_matches))
        rule.start(box(*LEFT))
        filtered = rule.step(matches, box(*LEFT))
        assert filtered.flags == flags
        assert filtered.kept.sum() == (10 if flags else 1)
    # No flag if the matches were few before the filter.
    assert KitBoxFilter(CAMERA, KitFilterConfig()).step(matches, no_boxes()).flags == ()


def filtered(config: KitFilterConfig, kept: slice = slice(None), jump: float = 0.0) -> list[Removal]:
    """The results of a rule for 200 static features, 20 on a car at constant distance, 20 on a parked car.

    kept : indices of the input features. jump : displacement of the last feature in the sixth frame, pixels.
    """
    ahead = tuple((-STEP[:3, 3]).tolist())
    first, frames = drive([Vehicle((-0.5, 0.8, 14.0), ahead), Vehicle((4.0, 0.8, 22.0))], 6, noise=0.1)
    for uv in (frames[-1][0].cur_left, frames[-1][0].cur_right):
        uv[-1, 0] += jump
    rule = KitBoxFilter(CAMERA, config)
    rule.start(first)
    return [rule.step(matches[np.arange(240)[kept]], boxes) for matches, boxes in frames]


@pytest.mark.parametrize(("agreement", "stays"), [(2.0, False), (1000.0, True)])
def test_features_of_parked_cars_must_agree_with_the_street(agreement: float, stays: bool) -> None:
    config = KitFilterConfig(rule="moving", moving=MovingConfig(agreement=agreement))
    assert filtered(config, jump=3.0)[-1].kept[-1] == stays


def test_moving_vehicles_of_a_drawn_street_are_detected(street: Sequence) -> None:
    sequence, config = street.part(90, 150), preset("moving_selection", variant="kit")
    rule = KitBoxFilter(sequence.camera, config.filter)
    rule.start(sequence.boxes(0))
    text: dict[bool, list[bool]] = {True: [], False: []}  # by true motion: was the box judged as moving?
    for index, (matches, _) in enumerate(find_matches(sequence, config)):
        if index == 0:
            continue
        removal = rule.step(matches, sequence.boxes(index))
        on_moving = matches_on_moving(sequence, index, matches)
        assert removal.state is not None
        members = inside(matches.cur_left, removal.boxes.xyxy).T
        for held, state in zip(members, removal.state, strict=True):
            share = np.mean(on_moving[held]) if np.count_nonzero(held) >= 6 else np.nan
            if share == 0.0 or share > 0.5:
                text[share > 0.0].append(state == MOVING)
    assert min(map(len, text.values())) > 50
    right, wrong = sum(text[True]), sum(text[False])
    assert right / (right + wrong) >= 0.9
    assert right / len(text[True]) >= 0.85


def test_rule_truth_removes_moving_vehicles_only(street: Sequence) -> None:
    sequence = street.part(100, 104)
    config = settings.replace(preset("solution_selection", variant="kit"), "filter.rule", "truth")
    removed = [motion.removed for motion in run(sequence, config).motions]
    everything = [
        motion.removed for motion in run(sequence, preset("feature_selection", variant="kit")).motions
    ]
    assert all(0 < some < most for some, most in zip(removed, everything, strict=True))
