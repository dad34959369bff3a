"""Simulated drives and estimates, and the order of chapter 4's weightings."""

from __future__ import annotations

import numpy as np
import pytest

from course.ch04.weightings import MEAN, MEDIAN, METRES, PIXELS, PUBLISHED, ROBUST, weighting_errors
from course.perturbed_path import block_tour, perturbed_path
from course.simulation.drives import drive
from course.simulation.tracks import TrackConfig
from vo_lib.evaluation.kitti_errors import trajectory_distances


def test_the_drive_has_steps_of_a_metre_on_gentle_bends() -> None:
    steps = np.linalg.inv(drive(40)[:-1]) @ drive(40)[1:]
    np.testing.assert_allclose(np.linalg.norm(steps[:, :3, 3], axis=1), 1.0)
    assert np.degrees(np.abs(np.arcsin(steps[:, 0, 2]))).max() == pytest.approx(0.4, rel=0.01)


def test_robust_rows_beat_the_other_weightings_with_and_without_wrong_matches() -> None:
    for wrong, promised in ((0.0, 4.5), (0.3, 8.0)):
        tracks = TrackConfig(points=300, noise=0.3, wrong=wrong)
        runs = [weighting_errors(tracks, 12, seed) for seed in range(2)]
        median = {name: np.median(np.concatenate([run[name] for run in runs])) for name in runs[0]}
        assert median[ROBUST] <= promised
        assert median[ROBUST] < 0.75 * median[METRES]
        assert median[MEDIAN] < median[MEAN]
        if wrong:
            assert median[PUBLISHED] < 0.1 * median[PIXELS]
        else:
            assert median[PIXELS] < 0.5 * median[MEDIAN]


def test_the_block_tour_is_closed_and_no_perturbation_leaves_the_truth() -> None:
    tour = block_tour(rounds=1)
    np.testing.assert_allclose(tour[-1], np.eye(4), atol=1e-9)
    assert trajectory_distances(tour)[-1] == pytest.approx(800.0)
    np.testing.assert_allclose(perturbed_path(tour), tour, atol=1e-9)
