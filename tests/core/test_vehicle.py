"""What a vehicle can do: motions beyond it are flagged, and how long one is doubted."""

from __future__ import annotations

import numpy as np
import pytest

from vo_lib.core.frame import FrameResult
from vo_lib.core.geometry import rigid, rotation_from_vector
from vo_lib.core.types import Array
from vo_lib.core.vehicle import Vehicle, VehicleConfig

TENTH = 0.1


def motion(ahead: float = 1.0, turn: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> FrameResult:
    """`ahead` metres along z, and degrees about x, y, z."""
    return FrameResult(rigid(rotation_from_vector(np.radians(turn)), np.array([0.0, 0.0, -ahead])))


def flags(vehicle: Vehicle, *motions: FrameResult, seconds: float = TENTH) -> list[tuple[str, ...]]:
    return [vehicle.judge(m, seconds).flags for m in motions]


@pytest.mark.parametrize(
    ("turn", "expected"),
    [
        ((0, 8.9, 0), ()),
        ((0, -8.9, 0), ()),
        ((0, 9.1, 0), ("doubtful_turn",)),
        ((0, -9.1, 0), ("doubtful_turn",)),
        ((3.9, 0, 0), ()),
        ((4.1, 0, 0), ("doubtful_tilt",)),
        ((0, 0, 3.9), ()),
        ((0, 0, -4.1), ("doubtful_tilt",)),
        ((0, 0, 170), ("doubtful_tilt",)),
    ],
)
def test_a_turn_of_90_and_a_tilt_of_40_degrees_a_second_are_the_limits(
    turn: tuple[float, float, float], expected: tuple[str, ...]
) -> None:
    assert flags(Vehicle(VehicleConfig()), motion(turn=turn)) == [expected]


def test_the_velocity_may_change_by_three_metres_a_second_in_a_tenth_of_one() -> None:
    slower, sideways = motion(0.71), FrameResult(rigid(np.eye(3), np.array([0.31, 0.0, -1.0])))
    assert flags(Vehicle(VehicleConfig()), motion(), slower, motion()) == [(), (), ()]
    assert flags(Vehicle(VehicleConfig()), motion(), motion(0.69)) == [(), ("doubtful_speed",)]
    assert flags(Vehicle(VehicleConfig()), motion(), motion(1.31)) == [(), ("doubtful_speed",)]
    assert flags(Vehicle(VehicleConfig()), motion(), sideways) == [(), ("doubtful_speed",)]


def test_the_limits_are_of_seconds_not_of_frames() -> None:
    assert flags(Vehicle(VehicleConfig()), motion(4.0), motion(4.0, (0, 30, 0)), seconds=0.5) == [(), ()]
    assert flags(Vehicle(VehicleConfig()), motion(), motion(5.0), seconds=0.0) == [(), ()]  # time not known
    off = VehicleConfig(check=False)
    assert flags(Vehicle(off), motion(), motion(9.0, (0, 0, 60))) == [(), ()]


def test_a_doubtful_motion_is_compared_with_no_other() -> None:
    jump = motion(6.0)
    assert flags(Vehicle(VehicleConfig()), motion(), jump, motion(), jump)[2:] == [(), ("doubtful_speed",)]


def test_after_ten_frames_in_doubt_the_path_is_lost_and_then_the_speed_may_be_another() -> None:
    none = FrameResult(np.eye(4), flags=("few_matches",))
    vehicle = Vehicle(VehicleConfig())
    seen = flags(vehicle, motion(), *[none] * 12)
    assert seen == [(), *[("few_matches",)] * 10, *[("few_matches", "lost")] * 2]
    assert flags(vehicle, motion(2.5)) == [("doubtful_speed", "lost")]  # 15 m/s more after 0.2 s
    assert flags(vehicle, motion(1.8), motion(1.8)) == [(), ()]  # 8 m/s more after 0.3 s
    assert flags(vehicle, none) == [("few_matches",)]


def path(ahead: Array) -> list[FrameResult]:
    return [motion(float(z)) for z in ahead]


def test_five_frozen_frames_and_the_jump_after_them_are_doubtful() -> None:
    seen = flags(Vehicle(VehicleConfig()), *path(np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 6.0, 1.0])))
    assert seen == [(), *[("doubtful_speed",)] * 6, ()]
