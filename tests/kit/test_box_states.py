"""States of vehicle boxes: moving, parked or unknown."""

from __future__ import annotations

import numpy as np
from box_scenes import CAMERA, STEP, Vehicle, drive
from real_images import labelled_drive_0005

from vo_lib import preset
from vo_lib.geometry.boxes import MOVING, PARKED, UNKNOWN, Boxes
from vo_lib.geometry.matches import StereoMatches, empty_matches
from vo_lib.geometry.motion import skew
from vo_lib.kit.box_states import BoxMotionClassifier, BoxStates
from vo_lib.kit.settings import KitFilterConfig
from vo_lib.paper.box_removal import inside
from vo_lib.paper.sampson import sampson_distance
from vo_lib.runs.front_end import find_matches

AHEAD = tuple((STEP[:3, 3] * -1.0).tolist())  # the step of a car ahead at constant distance
STANDS = (0.0, 0.0, 0.0)
Frames = list[tuple[StereoMatches, Boxes]]


def classified(first: Boxes, frames: Frames, config: KitFilterConfig | None = None) -> list[BoxStates]:
    classifier = BoxMotionClassifier(CAMERA, config or KitFilterConfig())
    return [classifier.step(*frame) for frame in [(empty_matches(), first), *frames]][1:]


def states(result: list[BoxStates]) -> list[list[int]]:
    return [frame.state.tolist() for frame in result]


def test_car_ahead_at_constant_distance_moves() -> None:
    first, frames = drive([Vehicle((0.3, 0.8, 14.0), AHEAD)], 5)
    E = skew(STEP[:3, 3]) @ STEP[:3, :3]
    for frame, (matches, _) in zip(classified(first, frames), frames, strict=True):
        assert frame.state.tolist() == [MOVING]
        assert np.linalg.norm(frame.step[0] - AHEAD) < 0.1
        x_p, x_c = (CAMERA.normalise(uv[200:]) for uv in (matches.prev_left, matches.cur_left))
        assert np.median(CAMERA.f * sampson_distance(E, x_p, x_c)) < 1.0


def test_features_of_moving_boxes_are_removed() -> None:
    """A car crosses at 3 m per frame, so some features of the street are in only one of the two boxes."""
    before, frames = drive([Vehicle((-6.0, 0.8, 14.0), (3.0, 0.0, 0.0))], 3)
    for number, frame in enumerate(classified(before, frames)):
        matches, boxes = frames[number]
        was = inside(matches.prev_left, before.xyxy).any(axis=1)
        now = inside(matches.cur_left, boxes.xyxy).any(axis=1)
        assert min(np.count_nonzero(now & ~was), np.count_nonzero(was & ~now)) >= 3
        assert frame.state.tolist() == [MOVING]
        # The box in the first frame has no state.
        assert not frame.kept[now | (was & (number > 0))].any()
        assert frame.kept[~(was | now)].all()
        before = boxes


def test_oncoming_car_moves_and_parked_car_does_not() -> None:
    cars = [Vehicle((-3.0, 0.8, 30.0), (0.0, 0.0, -1.0)), Vehicle((4.0, 0.8, 20.0))]
    result = classified(*drive(cars, 9))
    assert [state[0] for state in states(result)] == [MOVING] * 9
    assert MOVING not in [state[1] for state in states(result)]


def test_the_state_of_a_box_without_features_is_unknown() -> None:
    first, frames = drive([Vehicle((0.3, 0.8, 14.0), AHEAD)], 2)
    bare = [
        (matches[np.asarray(~inside(matches.cur_left, boxes.xyxy).any(axis=1))], boxes)
        for matches, boxes in frames
    ]
    for frame in classified(first, bare):
        assert frame.state.tolist() == [UNKNOWN]
        assert np.isnan(frame.step).all()


def test_stopped_car_becomes_parked() -> None:
    car = Vehicle((1.0, 0.8, 25.0), AHEAD)
    first, driving = drive([car], 4)
    car.step = STANDS
    result = states(classified(first, driving + drive([car], 10)[1]))
    assert result[:4] == [[MOVING]] * 4
    assert result[-1] == [PARKED]


def test_the_van_of_drive_0005_moves_and_the_truck_is_parked() -> None:
    sequence = labelled_drive_0005().part(0, 24)
    config = preset("moving_selection", variant="kit")
    classifier = BoxMotionClassifier(sequence.camera, config.filter)
    van, truck = [], []
    for index, (matches, _) in enumerate(find_matches(sequence, config)):
        frame = classifier.step(matches, sequence.boxes(index))
        x0, _, x1, _ = frame.boxes.xyxy.T
        # The van drives from u = 890 to u = 540; the truck is at the right border for 15 frames.
        expected = np.interp(index, [1, 12, 23], [888, 707, 541])
        van.append(frame.state[np.argmin(np.abs((x0 + x1) / 2 - expected))])
        truck.append(frame.state[np.argmax(x1)])
    assert van[9:] == [MOVING] * 15
    assert PARKED not in van
    assert truck[1:13] == [PARKED] * 12
