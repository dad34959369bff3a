"""Motions beyond the limits of a vehicle are flagged; only a missing motion is replaced."""

from __future__ import annotations

import numpy as np
import pytest

from vo_lib.geometry.motion import rigid, rotation_from_vector
from vo_lib.geometry.result import Flag, FrameResult
from vo_lib.geometry.types import Array
from vo_lib.kit.settings import VehicleConfig
from vo_lib.kit.vehicle import Vehicle

FRAME_S = 0.1
SPEED, TURN, TILT = (Flag.DOUBTFUL_SPEED,), (Flag.DOUBTFUL_TURN,), (Flag.DOUBTFUL_TILT,)
MISSING = FrameResult(np.eye(4), flags=(Flag.FEW_MATCHES,))


def motion(ahead: float = 1.0, turn: Array | tuple[float, ...] = (0.0, 0.0, 0.0)) -> FrameResult:
    """Motion by `ahead` metres along z with a rotation in degrees about x, y, z."""
    return FrameResult(rigid(rotation_from_vector(np.radians(turn)), np.array([0.0, 0.0, -ahead])))


def flags(*motions: FrameResult, seconds: float = FRAME_S, check: bool = True) -> list[tuple[Flag, ...]]:
    """Flags of the last motions of a drive that begins at 10 m/s."""
    vehicle = Vehicle(VehicleConfig(check=check))
    vehicle.check_vehicle(motion(10.0 * seconds), seconds)
    return [vehicle.check_vehicle(m, seconds).flags for m in motions]


@pytest.mark.parametrize("sign", [1, -1])
def test_turn_and_tilt_limits(sign: int) -> None:
    for axis, limit, flag in ((1, 9.0, TURN), (0, 4.0, TILT), (2, 4.0, TILT)):
        for degrees, expected in ((limit - 0.1, ()), (limit + 0.1, flag), (170.0, flag)):
            assert flags(motion(turn=sign * degrees * np.eye(3)[axis])) == [expected]


def test_speed_change_limit() -> None:
    sideways = FrameResult(rigid(np.eye(3), np.array([0.31, 0.0, -1.0])))
    assert flags(motion(0.71), motion()) == [(), ()]
    assert [flags(m) for m in (motion(0.69), motion(1.31), sideways)] == [[SPEED]] * 3


def test_limits_are_per_second() -> None:
    assert flags(motion(5.0, (0, 30, 0)), seconds=0.5) == [()]
    assert flags(motion(5.0), seconds=0.0) == [()]
    assert flags(motion(9.0, (0, 0, 60)), check=False) == [()]


def test_first_motion_limit_is_63_metres_per_second() -> None:
    first = [Vehicle(VehicleConfig()).check_vehicle(motion(ahead), FRAME_S).flags for ahead in (6.2, 6.4)]
    assert first == [(), SPEED]


def test_flagged_motion_is_kept_but_not_a_reference() -> None:
    vehicle, jump = Vehicle(VehicleConfig()), motion(6.0)
    vehicle.check_vehicle(motion(), FRAME_S)
    judged = vehicle.check_vehicle(jump, FRAME_S)
    assert judged.flags == SPEED
    np.testing.assert_array_equal(judged.T_cp, jump.T_cp)
    assert vehicle.check_vehicle(motion(), FRAME_S).flags == ()


def test_new_speed_becomes_plausible_with_time() -> None:
    assert flags(*[motion(1.8)] * 4) == [SPEED, SPEED, (), ()]  # an increase of 8 m/s needs 0.27 s


def test_last_plausible_motion_replaces_missing_ones() -> None:
    vehicle = Vehicle(VehicleConfig())
    for m in (motion(1.1), motion(9.0)):
        vehicle.check_vehicle(m, FRAME_S)
    judged = [vehicle.check_vehicle(MISSING, FRAME_S) for _ in range(12)]
    assert {m.flags for m in judged} == {MISSING.flags}
    steps = [float(np.linalg.norm(m.T_cp[:3, 3])) for m in judged]
    np.testing.assert_allclose(steps, [1.1] * 12)


def test_repeated_pair_causes_no_flag() -> None:
    vehicle = Vehicle(VehicleConfig())
    vehicle.check_vehicle(motion(), FRAME_S)
    for _ in range(3):
        assert vehicle.check_vehicle(FrameResult(np.eye(4), still=True), FRAME_S).flags == ()
    assert vehicle.check_vehicle(motion(), FRAME_S).flags == ()
    np.testing.assert_array_equal(vehicle.check_vehicle(MISSING, FRAME_S).T_cp, motion().T_cp)
