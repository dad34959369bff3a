"""Figures: colours of matches, and alignment of paths."""

from __future__ import annotations

import numpy as np
from made_entries import straight

from vo_lib.geometry.boxes import Boxes
from vo_lib.geometry.matches import StereoMatches
from vo_lib.geometry.motion import rigid, rotation_from_vector
from vo_lib.report.plots import KEPT, REMOVED, match_image, trajectories_figure


def test_match_image_colours() -> None:
    prev = np.array([[20.0, 30.0], [70.0, 30.0]])
    cur = np.array([[30.0, 30.0], [80.0, 30.0]])
    one = np.ones(2, np.int64)
    matches = StereoMatches(prev, prev, cur, cur, one, np.ones(2), one)
    boxes = Boxes(np.array([[60.0, 20.0, 95.0, 45.0]]), np.array([2]), np.ones(1))
    picture = match_image(np.full((60, 100), 128, np.uint8), matches, np.array([True, False]), boxes)
    assert picture.shape == (60, 100, 3)
    assert tuple(picture[30, 30]) == KEPT
    assert tuple(picture[30, 80]) == REMOVED
    assert (picture[20, 60:96] > 200).all()
    assert (picture[5, 5] == 128).all()


def test_truth_and_estimate_start_at_one_point() -> None:
    start = rigid(rotation_from_vector(np.array([0.0, 0.5, 0.0])), np.array([10.0, 0.0, -4.0]))
    poses = straight(5)
    figure = trajectories_figure({"a title": (start @ poses, {"mine": poses})})
    lines = {line.get_label(): line for line in figure.axes[0].get_lines()}
    truth, mine = (np.array(lines[name].get_data(), np.float64) for name in ("ground truth", "mine"))
    np.testing.assert_allclose(truth, mine, atol=1e-12)
    assert figure.axes[0].get_aspect() == 1.0
