"""Simulated drives, estimates with known errors, and the order of chapter 4's weightings."""

from __future__ import annotations

import numpy as np
import pytest

from course.ch04.weightings import MEAN, MEDIAN, METRES, PIXELS, PUBLISHED, ROBUST, weighting_errors
from course.lessons import drive
from course.made_up import block_tour, made_up, straight_road
from vo_lib.data.tracks import TrackConfig
from vo_lib.evaluation.ate_rpe import relative_error
from vo_lib.evaluation.kitti import kitti_errors, trajectory_distances


def test_the_drive_has_steps_of_a_metre_and_turns_where_it_is_sharp() -> None:
    for sharp, largest in ((False, 0.4), (True, 4.0)):
        poses = drive(40, sharp)
        steps = np.linalg.inv(poses[:-1]) @ poses[1:]
        np.testing.assert_allclose(np.linalg.norm(steps[:, :3, 3], axis=1), 1.0)
        angle = np.degrees(np.abs(np.arcsin(steps[:, 0, 2])))
        assert angle.max() == pytest.approx(largest, rel=0.01)


def test_robust_rows_beat_the_other_weightings_and_bear_wrong_matches() -> None:
    for wrong, promised in ((0.0, 4.5), (0.3, 8.0)):
        tracks = TrackConfig(points=300, noise=0.3, wrong=wrong)
        found = [weighting_errors(tracks, 12, seed) for seed in range(2)]
        median = {name: np.median(np.concatenate([run[name] for run in found])) for name in found[0]}
        assert median[ROBUST] <= promised
        assert median[ROBUST] < 0.75 * median[METRES]
        assert median[MEDIAN] < median[MEAN]
        if wrong:
            assert median[PUBLISHED] < 0.1 * median[PIXELS]
        else:
            assert median[PIXELS] < 0.5 * median[MEDIAN]


def test_the_tour_comes_home() -> None:
    tour = block_tour(rounds=1)
    np.testing.assert_allclose(tour[-1], np.eye(4), atol=1e-9)
    assert trajectory_distances(tour)[-1] == pytest.approx(800.0)


def test_nothing_made_up_is_the_truth() -> None:
    road = straight_road(300)
    np.testing.assert_allclose(made_up(road), road, atol=1e-9)


def test_a_scale_error_is_the_translation_error_of_a_straight_road() -> None:
    road = straight_road()
    errors = kitti_errors(road, made_up(road, scale=2.0))
    # The piece ends a little beyond its nominal length.
    np.testing.assert_allclose(errors.t_err, 0.02, rtol=0.03)
    assert errors.r_err.max() < 1e-7


def test_a_yaw_error_is_the_rotation_error_and_turns_to_the_right() -> None:
    road = straight_road()
    estimate = made_up(road, yaw=1.0)
    errors = kitti_errors(road, estimate)
    np.testing.assert_allclose(100 * np.degrees(errors.r_err), 1.0, rtol=0.03)
    assert estimate[-1, 0, 3] > 0
    assert relative_error(road, estimate).translation.max() < 1e-9


def test_noise_and_jitter_have_their_size() -> None:
    tour = block_tour()
    noisy = relative_error(tour, made_up(tour, noise=20.0))
    assert np.sqrt(np.mean(noisy.translation**2)) == pytest.approx(0.02 * np.sqrt(3), rel=0.05)
    assert noisy.rotation.max() < 1e-9
    turned = relative_error(tour, made_up(tour, jitter=0.1))
    assert np.degrees(np.sqrt(np.mean(turned.rotation**2))) == pytest.approx(0.1, rel=0.05)
