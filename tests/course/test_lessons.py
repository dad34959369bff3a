"""The simulated drives of chapters 3 and 4, and the order of chapter 4's weightings."""

from __future__ import annotations

import numpy as np
import pytest

from course.ch04.weightings import MEAN, MEDIAN, METRES, PIXELS, PUBLISHED, ROBUST, weighting_errors
from course.lessons import drive
from vo_lib.data.tracks import TrackConfig


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
