"""What a vehicle can do: motions beyond it are flagged, and how long one is doubted."""

from __future__ import annotations

import numpy as np
import pytest

from vo_lib.core.camera import StereoCamera
from vo_lib.core.frame import TIME_JUMP, FrameResult
from vo_lib.core.geometry import rigid, rotation_from_vector, transform
from vo_lib.core.matches import StereoMatches, empty_matches
from vo_lib.core.types import Array
from vo_lib.core.vehicle import Vehicle, VehicleConfig

TENTH = 0.1
CAMERA = StereoCamera(f=700.0, cx=600.0, cy=180.0, baseline=0.5, width=1200, height=360)
JUMP = (TIME_JUMP,)


def motion(ahead: float = 1.0, turn: Array | tuple[float, ...] = (0.0, 0.0, 0.0)) -> FrameResult:
    """`ahead` metres along z, and degrees about x, y, z."""
    return FrameResult(rigid(rotation_from_vector(np.radians(turn)), np.array([0.0, 0.0, -ahead])))


def vehicle() -> Vehicle:
    return Vehicle(VehicleConfig(), CAMERA)


def flags(judge: Vehicle, *motions: FrameResult, seconds: float = TENTH) -> list[tuple[str, ...]]:
    """Of motions that no match supports."""
    return [judge.judge(m, empty_matches, seconds).flags for m in motions]


def supported(judge: Vehicle, moved: FrameResult, agree: int, number: int = 100) -> tuple[str, ...]:
    """Flags of a motion that `agree` of `number` matches show in both current images, all in the left one."""
    rng = np.random.default_rng(3)
    z = rng.uniform(12.0, 40.0, number)
    X = np.stack([rng.uniform(-0.4, 0.4, number) * z, rng.uniform(-0.2, 0.1, number) * z, z], axis=1)
    (left, right), (cur_left, cur_right) = CAMERA.project(X), CAMERA.project(transform(moved.T_cp, X))
    cur_right[agree:, 0] += 5.0
    whole = np.arange(number)
    seen = StereoMatches(left, right, cur_left, cur_right, whole, np.ones(number), whole)
    return judge.judge(moved, lambda: seen, TENTH).flags


@pytest.mark.parametrize("sign", [1, -1])
def test_a_turn_of_90_and_a_tilt_of_40_degrees_a_second_are_the_limits(sign: int) -> None:
    for axis, limit, flag in (
        (1, 9.0, "doubtful_turn"),
        (0, 4.0, "doubtful_tilt"),
        (2, 4.0, "doubtful_tilt"),
    ):
        for degrees, expected in ((limit - 0.1, ()), (limit + 0.1, (flag,)), (170.0, (flag,))):
            turn = sign * degrees * np.eye(3)[axis]
            assert flags(vehicle(), motion(turn=turn)) == [expected]


def test_the_velocity_may_change_by_three_metres_a_second_in_a_tenth_of_one() -> None:
    slower, sideways = motion(0.71), FrameResult(rigid(np.eye(3), np.array([0.31, 0.0, -1.0])))
    assert flags(vehicle(), motion(), slower, motion()) == [(), (), ()]
    assert flags(vehicle(), motion(), motion(0.69)) == [(), ("doubtful_speed",)]
    assert flags(vehicle(), motion(), motion(1.31)) == [(), ("doubtful_speed",)]
    assert flags(vehicle(), motion(), sideways) == [(), ("doubtful_speed",)]


def test_the_limits_are_of_seconds_not_of_frames() -> None:
    assert flags(vehicle(), motion(4.0), motion(4.0, (0, 30, 0)), seconds=0.5) == [(), ()]
    assert flags(vehicle(), motion(), motion(5.0), seconds=0.0) == [(), ()]  # time not known
    off = VehicleConfig(check=False)
    assert flags(Vehicle(off, CAMERA), motion(), motion(9.0, (0, 0, 60))) == [(), ()]


def test_a_doubtful_motion_is_compared_with_no_other() -> None:
    jump = motion(6.0)
    assert flags(vehicle(), motion(), jump, motion(), jump)[2:] == [(), ("doubtful_speed",)]


def test_after_ten_frames_in_doubt_the_path_is_lost_and_then_the_speed_may_be_another() -> None:
    none = FrameResult(np.eye(4), flags=("few_matches",))
    judge = vehicle()
    seen = flags(judge, motion(), *[none] * 12)
    assert seen == [(), *[("few_matches",)] * 10, *[("few_matches", "lost")] * 2]
    assert flags(judge, motion(2.5)) == [("doubtful_speed", "lost")]  # 15 m/s more after 0.2 s
    assert flags(judge, motion(1.8), motion(1.8)) == [(), ()]  # 8 m/s more after 0.3 s
    assert flags(judge, none) == [("few_matches",)]


def test_the_first_motion_is_judged_by_the_limits_themselves() -> None:
    assert flags(vehicle(), motion(5.9)) == [()]  # 59 m/s
    assert flags(vehicle(), motion(6.1)) == [("doubtful_speed",)]
    assert flags(vehicle(), motion(1.0, (0, 9.1, 0))) == [("doubtful_turn",)]


def test_a_jump_that_most_matches_agree_on_is_believed_and_what_goes_on_as_before_it_is_none() -> None:
    judge = vehicle()
    assert flags(judge, motion()) == [()]
    assert supported(judge, motion(6.0), agree=60) == JUMP  # a gap of half a second
    assert flags(judge, motion()) == [()]
    assert supported(judge, motion(-1.0), agree=60) == JUMP  # the film runs back
    assert flags(judge, motion(-1.0), motion(1.0)) == [(), ("doubtful_speed",)]
    assert supported(judge, motion(1.0, (0, 20, 0)), agree=60) == JUMP
    assert supported(judge, motion(1.0, (0, 0, 10)), agree=100) == ("doubtful_tilt",)  # no gap rolls a camera


@pytest.mark.parametrize(("agree", "number"), [(33, 100), (9, 20), (18, 60), (0, 5)])
def test_what_few_matches_agree_on_in_both_images_is_in_doubt(agree: int, number: int) -> None:
    judge = vehicle()
    assert flags(judge, motion()) == [()]
    assert supported(judge, motion(6.0), agree, number) == ("doubtful_speed",)
    assert judge.waiting == ()


@pytest.mark.parametrize(("agree", "number"), [(40, 100), (25, 40), (10, 30)])
def test_a_jump_with_some_support_waits_for_the_next_frame(agree: int, number: int) -> None:
    doubtful = ("doubtful_speed",)
    # The next goes on as before the jump, or as it, or not.
    for after, seen, taken_back in ((1.0, (), ()), (6.0, (), ()), (-4.0, doubtful, doubtful)):
        judge = vehicle()
        assert flags(judge, motion()) == [()]
        assert supported(judge, motion(6.0), agree, number) == JUMP
        assert judge.waiting == doubtful
        assert flags(judge, motion(after)) == [seen]
        assert judge.taken_back == taken_back
        assert flags(judge, motion(after if after > 0 else 1.0)) == [()]
        assert judge.taken_back == ()


def test_what_comes_nearer_may_be_off_by_as_many_times_more() -> None:
    """From 12 m, half a pixel of disparity is 20 cm: after 6 m of way four half pixels."""
    left = np.stack([np.linspace(100.0, 1100.0, 40), np.full(40, 100.0)], axis=1)
    right = left - [CAMERA.f * CAMERA.baseline / 12.0, 0.0]
    moved, whole = motion(6.0), np.arange(40)
    seen_l, seen_r = CAMERA.project(transform(moved.T_cp, CAMERA.triangulate(left, right)))
    for off, agree in ((1.9, 40), (2.1, 0)):  # of 2 px, twice as large as before
        pixels = np.array([0.0, off * 2.0 / np.sqrt(2.0)])
        matches = StereoMatches(left, right, seen_l + pixels, seen_r + pixels, whole, np.ones(40), whole)
        assert vehicle()._agreeing(moved.T_cp, matches) == agree


def test_what_is_taken_back_does_not_renew_the_patience() -> None:
    judge = Vehicle(VehicleConfig(patience=3), CAMERA)
    assert flags(judge, motion(), motion(9.0), motion(9.0)) == [(), *[("doubtful_speed",)] * 2]
    assert supported(judge, motion(6.0), agree=40) == JUMP
    assert flags(judge, motion(9.5)) == [("doubtful_speed", "lost")]
