"""The disparity offset shows in the motion, is found without bias, and is left alone where there is none."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from vo_lib import open_sequence, preset, run, settings
from vo_lib.calibration import DisparityOffset, estimate_offset, without_offset
from vo_lib.camera import StereoCamera
from vo_lib.config import CalibrationConfig, TranslationConfig
from vo_lib.evaluation import kitti_errors
from vo_lib.geometry import Array, rotation_from_vector
from vo_lib.matching import StereoMatches
from vo_lib.synthetic.tracks import TrackConfig, simulate_tracks
from vo_lib.translation import solve_translation

CAMERA = StereoCamera(f=718.856, cx=607.2, cy=185.2, baseline=0.537, width=1241, height=376)


def frames(number: int, offset: float, tracks: TrackConfig) -> Iterator[tuple[StereoMatches, Array]]:
    """Matches and true motions along a gently turning path; every disparity is `offset` too large."""
    poses = np.tile(np.eye(4), (number, 1, 1))
    for i in range(1, number):
        step = np.eye(4)
        step[:3, :3] = rotation_from_vector(np.array([0.0, 0.01 * np.sin(i / 10), 0.0]))
        step[2, 3] = 1.0
        poses[i] = poses[i - 1] @ step
    for frame in simulate_tracks(poses, CAMERA, tracks, seed=3):
        yield without_offset(frame.matches, -offset), frame.T_cp


@pytest.mark.parametrize("offset", [0.0, -1.2, 0.7])
def test_one_frame_tells_the_offset_without_bias(offset: float) -> None:
    found, deviations = [], []
    for matches, T_cp in frames(40, offset, TrackConfig(points=350, noise=0.2)):
        estimate = estimate_offset(CAMERA, matches, T_cp[:3, :3], T_cp[:3, 3], 0.5)
        assert estimate is not None
        found.append(estimate[0])
        deviations.append(estimate[1])
    assert np.mean(found) == pytest.approx(offset, abs=0.04)
    assert np.std(found) == pytest.approx(np.mean(deviations), rel=0.5)


@pytest.mark.parametrize(("offset", "wrong"), [(0.0, 0.0), (-1.0, 0.0), (-1.0, 0.3)])
def test_the_filter_settles_on_the_offset_and_mends_the_steps(offset: float, wrong: float) -> None:
    tracker = DisparityOffset(CalibrationConfig())
    steps = []
    for matches, T_cp in frames(60, offset, TrackConfig(points=350, noise=0.2, wrong=wrong)):
        corrected = tracker.correct(matches)
        solved = solve_translation(CAMERA, corrected, T_cp[:3, :3], TranslationConfig())
        assert solved is not None
        steps.append(np.linalg.norm(solved[0]))
        tracker.update(CAMERA, corrected, T_cp[:3, :3], solved[0])
    assert tracker.offset == pytest.approx(offset, abs=0.1)
    assert np.mean(steps[20:]) == pytest.approx(1.0, abs=0.004)


def test_a_camera_at_rest_teaches_nothing() -> None:
    matches, _ = next(frames(2, -1.0, TrackConfig(points=100, noise=0.0)))
    still = dataclasses.replace(matches, cur_left=matches.prev_left, cur_right=matches.prev_right)
    tracker = DisparityOffset(CalibrationConfig())
    tracker.update(CAMERA, still, np.eye(3), np.zeros(3))
    assert abs(tracker.offset) < 0.2


def test_too_few_matches_give_no_estimate() -> None:
    matches, T_cp = next(frames(2, 0.0, TrackConfig(points=60)))
    assert estimate_offset(CAMERA, matches[np.arange(5)], T_cp[:3, :3], T_cp[:3, 3], 0.5) is None


# libviso2 has 7.84 % / 2.70 and ORB-SLAM2's published trajectory 5.47 % / 2.54 on the same frames.
def test_the_real_highway_needs_the_offset(clips: Path) -> None:
    sequence = open_sequence(clips / "sequences" / "01")
    assert sequence.truth is not None
    te = {}
    for estimate in (True, False):
        config = settings.replace(preset("solution_selection"), "calibration.estimate", estimate)
        errors = kitti_errors(sequence.truth, run(sequence, config).poses, [20.0], 1)
        assert errors.te is not None
        assert errors.re is not None
        assert errors.re < 2.5
        te[estimate] = errors.te
    assert te[True] < 2.0 < te[False]
