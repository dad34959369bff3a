"""Estimates with known errors have just these errors."""

from __future__ import annotations

import numpy as np
import pytest

from course.made_up import block_tour, made_up, straight_road
from vo_lib.evaluation.ate_rpe import relative_error
from vo_lib.evaluation.kitti import kitti_errors, trajectory_distances


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
