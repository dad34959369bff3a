"""Figures: colours of matches, and alignment of paths."""

from __future__ import annotations

import cv2
import numpy as np
from made_entries import straight

from vo_lib.geometry.boxes import Boxes
from vo_lib.geometry.matches import StereoMatches
from vo_lib.geometry.motion import rigid, rotation_from_vector
from vo_lib.geometry.types import Array
from vo_lib.report.plots import (
    KEPT,
    REMOVED,
    is_straight,
    match_image,
    png,
    sideways_from_truth,
    trajectories_figure,
)


def test_match_image_shows_kept_and_removed_matches_in_two_colours() -> None:
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


def bent(count: int) -> Array:
    """A drive that turns to the right along a quarter of a circle."""
    angles = np.linspace(0.0, np.pi / 2, count)
    poses = np.tile(np.eye(4), (count, 1, 1))
    for pose, angle in zip(poses, angles, strict=True):
        pose[:3, :3] = rotation_from_vector(np.array([0.0, angle, 0.0]))
        pose[:3, 3] = 20 * (1 - np.cos(angle)), 0.0, 20 * np.sin(angle)
    return poses


def test_truth_and_estimate_start_at_one_point() -> None:
    start = rigid(rotation_from_vector(np.array([0.0, 0.5, 0.0])), np.array([10.0, 0.0, -4.0]))
    poses = bent(5)
    figure = trajectories_figure({"a title": (start @ poses, {"mine": poses})})
    lines = {line.get_label(): line for line in figure.axes[0].get_lines()}
    truth, mine = (np.array(lines[name].get_data(), np.float64) for name in ("ground truth", "mine"))
    np.testing.assert_allclose(truth, mine, atol=1e-12)
    assert figure.axes[0].get_aspect() == 1.0


def test_straight_drive_shows_the_error_to_the_side() -> None:
    """The true drive heads for 30° to the right; the estimate leaves it by a metre to the right, and lags."""
    start = rigid(rotation_from_vector(np.array([0.0, np.pi / 6, 0.0])), np.array([10.0, 0.0, -4.0]))
    truth = straight(50)
    mine = truth.copy()
    mine[:, 0, 3] += np.linspace(0.0, 1.0, 50)
    mine[:, 2, 3] *= 0.99
    assert is_straight(start @ truth, {"mine": mine})
    assert not is_straight(bent(50), {"mine": mine})
    assert not is_straight(truth, {"mine": bent(50)})
    figure = trajectories_figure({"a title": (start @ truth, {"feature_selection": mine})})
    lines = {line.get_label(): np.array(line.get_data(), np.float64) for line in figure.axes[0].get_lines()}
    np.testing.assert_allclose(lines["feature_selection"][1], np.linspace(0.0, 1.0, 50), atol=1e-9)
    np.testing.assert_allclose(lines["ground truth"][1], 0.0, atol=1e-9)
    np.testing.assert_allclose(sideways_from_truth(mine, start @ truth), np.linspace(0.0, 1.0, 50), atol=1e-9)
    assert "sideways is magnified" in figure.axes[0].get_xlabel()


def test_straight_drive_without_truth_is_seen_from_the_side_of_its_own_line() -> None:
    turn = rotation_from_vector(np.array([0.0, np.pi / 6, 0.0]))
    first = rigid(turn, np.zeros(3)) @ straight(50)
    second = first.copy()
    second[:, :3, 3] += turn[:, 0] * np.linspace(0.0, 2.0, 50)[:, None]  # to the right of the first
    figure = trajectories_figure({"a title": (None, {"a": first, "b": second})})
    lines = {line.get_label(): np.array(line.get_data(), np.float64) for line in figure.axes[0].get_lines()}
    length = float(np.linalg.norm(first[-1, :3, 3]))
    np.testing.assert_allclose(lines["a"], [np.linspace(0.0, length, 50), np.zeros(50)], atol=1e-9)
    np.testing.assert_allclose(lines["b"][1], np.linspace(0.0, 2.0, 50), atol=1e-9)
    # Its frame is no path's own: it is named, and so are the scales.
    axis = figure.axes[0]
    assert "along the line from the start to the end of a [m]" in axis.get_xlabel()
    assert "the axes have different scales" in axis.get_xlabel()
    assert axis.get_ylabel() == "to the right of this line [m]"


def test_long_titles_stay_inside_the_figure() -> None:
    name = "a sequence with a long name, frames 100-1100"
    lines = [name, "no ground truth; all paths begin at the same pose", f"and once more {name}"]
    for poses in (bent(50), straight(50)):
        figure = trajectories_figure({"\n".join(lines): (None, {"a": poses})})
        png(figure)
        extent = figure.axes[0].title.get_window_extent()
        assert 0 <= extent.x0 < extent.x1 <= figure.bbox.width


def test_truth_is_seen_on_an_estimate_that_covers_it() -> None:
    """A white edge separates the thin black line from the wide line below it."""
    poses = bent(50)
    figure = trajectories_figure({"a title": (poses, {"feature_selection": poses})})
    image = cv2.imdecode(np.frombuffer(png(figure), np.uint8), cv2.IMREAD_COLOR)
    assert image is not None
    row = image[image.shape[0] // 3, 80 : image.shape[1] // 2 - 20].astype(int)  # crosses the path once
    blue = np.nonzero(row[:, 0] > row[:, 2] + 60)[0]
    across = row[blue[0] : blue[-1], 2]  # red, of which the path has hardly any
    truth = int(np.argmin(across[5:-5])) + 5
    assert across[truth - 4 : truth].max() > 120
    assert across[truth + 1 : truth + 5].max() > 120
