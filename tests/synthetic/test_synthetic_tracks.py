"""Simulated matches: exact without noise, and as wrong and as moving as asked."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from street.drive import make_drive, make_route
from vo_lib.core.camera import StereoCamera
from vo_lib.core.errors import DataError
from vo_lib.core.geometry import essential_from_motion, inverse, rigid, rotation_from_vector, transform
from vo_lib.core.sampson import sampson_distance
from vo_lib.data.scenes import SCENES
from vo_lib.data.tracks import SimulatedFrame, TrackConfig, simulate_tracks

CAMERA = SCENES["empty"].camera


@pytest.fixture(scope="module")
def poses() -> np.ndarray:
    config = SCENES["parked"]
    drive = make_drive(config, make_route(config))
    return np.asarray(inverse(drive.poses[0]) @ drive.poses)[:40]


def moved(frame: SimulatedFrame) -> np.ndarray:
    """Where the previous pair's points would be if all stood still, (N, 4) left and right pixels."""
    m = frame.matches
    X = CAMERA.back_project(m.prev_left, (m.prev_left - m.prev_right)[:, 0])
    return np.concatenate(CAMERA.project(transform(frame.T_cp, X)), axis=1)


def test_without_noise_right_matches_satisfy_the_geometry_exactly(poses: np.ndarray) -> None:
    config = TrackConfig(points=300, noise=0.0, wrong=0.15, moving=0.4)
    for frame in simulate_tracks(poses, CAMERA, config, seed=1):
        assert (len(frame.matches), frame.wrong.sum(), frame.moving.sum()) == (300, 45, 120)
        assert not (frame.wrong & frame.moving).any()
        right = ~frame.wrong & ~frame.moving
        m = frame.matches[right]
        E = essential_from_motion(frame.T_cp[:3, :3], frame.T_cp[:3, 3])
        x_p, x_c = CAMERA.normalise(m.prev_left), CAMERA.normalise(m.cur_left)
        assert np.abs(sampson_distance(E, x_p, x_c)).max() < 1e-9
        current = np.concatenate([frame.matches.cur_left, frame.matches.cur_right], axis=1)
        assert np.abs(moved(frame) - current)[right].max() < 1e-6
        np.testing.assert_allclose(m.prev_left[:, 1], m.prev_right[:, 1], atol=1e-9)
        assert np.all(m.cur_left[:, 0] > m.cur_right[:, 0])
        assert np.linalg.norm(moved(frame) - current, axis=1)[frame.wrong].min() > 1.0


def test_points_stand_as_far_as_asked_and_half_of_those_seen_on_the_ground(poses: np.ndarray) -> None:
    first = next(iter(simulate_tracks(poses, CAMERA, TrackConfig(noise=0.0, points=2000), seed=1))).matches
    X = CAMERA.back_project(first.prev_left, (first.prev_left - first.prev_right)[:, 0])
    assert 60.0 < X[:, 2].max() < 71.0
    on_ground = np.abs(X[:, 1] - SCENES["parked"].camera_height) < 0.15
    assert 0.4 < np.mean(on_ground) < 0.6


def test_points_of_moving_objects_leave_the_still_prediction_together(poses: np.ndarray) -> None:
    config = TrackConfig(noise=0.0, moving=0.5, objects=1)
    for frame in simulate_tracks(poses, CAMERA, config, seed=3):
        m = frame.matches[frame.moving]
        P = CAMERA.back_project(m.prev_left, (m.prev_left - m.prev_right)[:, 0])
        C = CAMERA.back_project(m.cur_left, (m.cur_left - m.cur_right)[:, 0])
        step = C - transform(frame.T_cp, P)
        assert np.linalg.norm(step, axis=1) == pytest.approx(0.8, abs=1e-6)
        assert np.ptp(step, axis=0).max() < 1e-6


def test_noise_has_the_deviation_asked_for(poses: np.ndarray) -> None:
    noisy = list(simulate_tracks(poses, CAMERA, TrackConfig(noise=0.3, survival=0.0), seed=4))
    for left, right in (("prev_left", "prev_right"), ("cur_left", "cur_right")):
        rows = [(getattr(f.matches, left) - getattr(f.matches, right))[:, 1] for f in noisy]
        assert np.std(np.concatenate(rows)) == pytest.approx(0.3 * np.sqrt(2), rel=0.05)


def test_a_feature_keeps_its_number_and_its_measurement(poses: np.ndarray) -> None:
    frames = list(simulate_tracks(poses, CAMERA, TrackConfig(wrong=0.1, moving=0.1), seed=5))
    for before, now in itertools.pairwise(frames):
        _, i, j = np.intersect1d(before.matches.id, now.matches.id, return_indices=True)
        assert len(i) > 100
        np.testing.assert_array_equal(before.matches.cur_left[i], now.matches.prev_left[j])
        np.testing.assert_array_equal(before.matches.cur_right[i], now.matches.prev_right[j])
        np.testing.assert_array_equal(before.matches.age[i] + 1, now.matches.age[j])
        assert not before.wrong[i].any()
    assert all(len(np.unique(f.matches.id)) == len(f.matches) for f in frames)
    assert max(f.matches.age.max() for f in frames) > 5


def test_same_seed_same_matches(poses: np.ndarray) -> None:
    config = TrackConfig(wrong=0.1, moving=0.2)
    one, two, other = (
        np.concatenate([f.matches.cur_right for f in simulate_tracks(poses, CAMERA, config, seed=seed)])
        for seed in (6, 6, 7)
    )
    np.testing.assert_array_equal(one, two)
    assert one.shape != other.shape or not np.array_equal(one, other)


def test_any_trajectory_will_do() -> None:
    """Standing still, turning on the spot, driving backwards."""
    for step in (np.zeros(3), np.array([0.0, 0.0, -0.5])):
        T = rigid(rotation_from_vector(np.array([0.0, 0.05, 0.0])), step)
        poses = np.stack([np.linalg.matrix_power(T, k) for k in range(10)])
        sizes = [len(f.matches) for f in simulate_tracks(poses, CAMERA, TrackConfig(moving=0.2), seed=8)]
        assert len(sizes) == 9
        assert min(sizes) > 200


def test_a_camera_without_size_is_refused(poses: np.ndarray) -> None:
    with pytest.raises(DataError, match="size of the image"):
        simulate_tracks(poses, StereoCamera(700.0, 600.0, 180.0, 0.5))
