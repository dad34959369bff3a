"""The clocks of two paths, compared by the turns of both."""

from __future__ import annotations

import numpy as np
import pytest
from made_entries import straight

from vo_lib.evaluation.clocks import slow_turn_agreement, turn_agreement
from vo_lib.geometry.motion import rigid, rotation_from_vector
from vo_lib.geometry.types import Array

INTERVAL = 0.1


def town(frames: int, seed: int = 0, turn_frames: int = 15) -> Array:
    """Poses (N, 4, 4), ten a second, with turns to both sides that begin at random times.

    turn_frames : duration of a turn; a longer one is gentler.
    """
    rng = np.random.default_rng(seed)
    turns = np.convolve(rng.normal(0.0, 0.75 / turn_frames, frames), np.hanning(turn_frames), "same")
    poses = np.tile(np.eye(4), (frames, 1, 1))
    for k in range(1, frames):
        turn = rotation_from_vector(np.array([0.0, turns[k], 0.0]))
        poses[k] = poses[k - 1] @ rigid(turn, np.array([0.0, 0.0, 1.0]))
    return poses


def estimated(poses: Array) -> Array:
    """The path with errors of every motion, in other units and in the axes of a robot."""
    rng = np.random.default_rng(1)
    axes = rigid(np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]), np.zeros(3))
    path = [np.eye(4)]
    for motion in np.linalg.inv(poses[:-1]) @ poses[1:]:
        error = rigid(rotation_from_vector(rng.normal(0.0, 1e-3, 3)), rng.normal(0.0, 0.02, 3))
        path.append(path[-1] @ motion @ error)
    result = axes @ np.array(path) @ np.linalg.inv(axes)
    result[:, :3, 3] *= 0.1
    return result


@pytest.mark.parametrize("ahead", [0, 1, 7, -40])
@pytest.mark.parametrize("part", [slice(None), slice(100, 260), slice(0, 400, 2)])
def test_the_lag_of_a_clock_is_found_in_the_turns(ahead: int, part: slice) -> None:
    poses = town(400)
    times = 1e9 + INTERVAL * np.arange(400.0)
    agreement = turn_agreement(times[part] + ahead * INTERVAL, estimated(poses)[part], times, poses)
    assert agreement is not None
    assert agreement.lag == pytest.approx(ahead * INTERVAL, abs=0.5 * INTERVAL * (part.step or 1) + 1e-6)
    assert agreement.with_lag > 0.9
    assert (agreement.as_given > agreement.with_lag - 0.2) is (abs(ahead) <= 1)


def test_straight_or_hardly_overlapping_paths_tell_nothing_about_clocks() -> None:
    times = INTERVAL * np.arange(200.0)
    assert turn_agreement(times, straight(200), times, straight(200)) is None
    assert turn_agreement(times, town(200), times + 15.0, town(200)) is None


def test_other_drives_agree_at_no_lag() -> None:
    times = INTERVAL * np.arange(400.0)
    agreement = turn_agreement(times, town(400), times, town(400, seed=5))
    assert agreement is not None
    assert agreement.with_lag < 0.6
    assert not agreement.is_another_clock
    assert not agreement.is_one_clock
    assert agreement.is_another_drive
    slow = slow_turn_agreement(times, town(400), times, town(400, seed=5))
    assert slow is not None
    assert slow.is_another_drive


@pytest.mark.parametrize("error", [1e-9, 1e-4, 1e-3])  # of rounding, and of odometry; radians a frame
@pytest.mark.parametrize("bend", [0.0, 5e-4])
def test_errors_of_straight_paths_are_no_turns_of_another_drive(bend: float, error: float) -> None:
    times = INTERVAL * np.arange(600.0)
    rng = np.random.default_rng(3)

    def turning(turns: Array) -> Array:
        errors = rotation_from_vector(rng.normal(0.0, error, (600, 3)))
        poses = straight(600)
        for k in range(1, 600):
            turn = rotation_from_vector(np.array([0.0, turns[k], 0.0])) @ errors[k]
            poses[k] = poses[k - 1] @ rigid(turn, np.array([0.0, 0.0, 1.0]))
        return poses

    road = bend * np.sin(times)
    path = turning(road)
    for other in (turning(road), turning(-road)):
        agreement = slow_turn_agreement(times, path, times, other)
        assert agreement is not None
        assert not agreement.is_another_drive
    # Against such a path, the turns of a town are those of another drive.
    for paths in ((path, town(600)), (town(600), path)):
        for compare in (turn_agreement, slow_turn_agreement):
            agreement = compare(times, paths[0], times, paths[1])
            assert agreement is not None
            assert agreement.is_another_drive


@pytest.mark.parametrize("turn_frames", [41, 81])
@pytest.mark.parametrize("ahead", [1, -2])
def test_a_lag_of_a_frame_is_found_in_gentle_turns(ahead: int, turn_frames: int) -> None:
    """The correlation without the lag is then nearly as high, so the highest one counts."""
    poses = town(400, turn_frames=turn_frames)
    times = INTERVAL * np.arange(400.0)
    agreement = turn_agreement(times + INTERVAL * ahead, estimated(poses), times, poses)
    assert agreement is not None
    assert agreement.lag == pytest.approx(INTERVAL * ahead)
    assert agreement.as_given > agreement.with_lag - 0.06
    assert agreement.is_another_clock


@pytest.mark.parametrize("ahead", [0, 1, -1, 2, -3])
def test_a_clock_that_is_a_few_frames_off_is_told_from_the_same_clock(ahead: int) -> None:
    """Also beyond the number of samples up to which all lags are searched, and between key frames."""
    frames = 5000
    poses = town(frames)
    times = 0.04 * np.arange(float(frames))
    estimate = estimated(poses)
    for rows in (slice(None), slice(900, 1300), slice(50, 4000, 3)):
        for swapped in (False, True):
            own = times[rows] + 0.04 * ahead
            paths = (own, estimate[rows], times, poses)
            agreement = turn_agreement(*(paths[2:] + paths[:2] if swapped else paths))
            assert agreement is not None
            assert agreement.lag == pytest.approx((-1 if swapped else 1) * 0.04 * ahead)
            assert agreement.is_another_clock is (ahead != 0)
            assert agreement.is_one_clock is (ahead == 0)
            assert not agreement.is_another_drive
