"""Simulated matches: exact without noise, with given fractions of wrong matches and moving points."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from course.simulation.tracks import SimulatedFrame, TrackConfig, simulate_tracks
from vo_lib.data.scenes import SCENES
from vo_lib.geometry.motion import essential_from_motion, inverse, transform
from vo_lib.paper.sampson import sampson_distance
from vo_street.route import make_drive, make_route

CAMERA = SCENES["empty"].camera


@pytest.fixture(scope="module")
def poses() -> np.ndarray:
    config = SCENES["parked"]
    drive = make_drive(config, make_route(config))
    return np.asarray(inverse(drive.poses[0]) @ drive.poses)[:40]


def moved(frame: SimulatedFrame) -> np.ndarray:
    """Pixels (N, 4) in the current pair, left and right, of static points of the previous pair."""
    m = frame.matches
    X = CAMERA.back_project(m.prev_left, (m.prev_left - m.prev_right)[:, 0])
    return np.concatenate(CAMERA.project(transform(frame.T_cp, X)), axis=1)


def test_noise_free_tracks_satisfy_the_geometry(poses: np.ndarray) -> None:
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


def test_tracks_keep_id_and_position_between_frames(poses: np.ndarray) -> None:
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
