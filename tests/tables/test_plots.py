"""Figures show what they are given."""

from __future__ import annotations

import itertools
from pathlib import Path

import cv2
import numpy as np
import pytest
from made_entries import straight
from matplotlib.colors import to_rgb

from vo_lib.config import METHODS
from vo_lib.core.boxes import Boxes
from vo_lib.core.geometry import rigid, rotation_from_vector
from vo_lib.core.matches import StereoMatches
from vo_lib.core.types import Array
from vo_lib.tables.error_plots import Curve, error_curves_figure
from vo_lib.tables.plots import (
    KEPT,
    METHOD_COLOURS,
    REMOVED,
    TRUTH_COLOUR,
    jpeg,
    match_image,
    method_colour,
    pdf,
    png,
    trajectories_figure,
)
from vo_lib.tables.table_files import write_curves


def test_kept_and_removed_matches_have_their_colours_where_they_are() -> None:
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
    decoded = cv2.imdecode(np.frombuffer(jpeg(picture), np.uint8), cv2.IMREAD_COLOR)
    assert decoded is not None
    assert np.abs(decoded.astype(int) - picture).mean() < 10


@pytest.mark.parametrize("name", ["a$b_{$c", "[/x]", "日本", "\udcff", "x" * 5000, "a\tb", "\x1b[31m"])
def test_any_name_of_a_folder_can_stand_in_a_picture(name: str) -> None:
    figure = trajectories_figure({name: (None, {f"{name} m": straight(2)})})
    assert png(figure)
    assert pdf(figure)


def test_the_truth_is_drawn_from_the_place_where_the_estimate_starts() -> None:
    start = rigid(rotation_from_vector(np.array([0.0, 0.5, 0.0])), np.array([10.0, 0.0, -4.0]))
    poses = straight(5)
    figure = trajectories_figure({"a title": (start @ poses, {"mine": poses})})
    lines = {line.get_label(): line for line in figure.axes[0].get_lines()}
    truth, mine = (np.array(lines[name].get_data(), np.float64) for name in ("ground truth", "mine"))
    np.testing.assert_allclose(truth, mine, atol=1e-12)
    assert figure.axes[0].get_aspect() == 1.0


def test_every_method_has_its_colour_and_it_is_the_papers() -> None:
    assert set(METHODS) <= set(METHOD_COLOURS)
    assert len({*METHOD_COLOURS.values(), TRUTH_COLOUR}) == len(METHOD_COLOURS) + 1
    assert np.argmax(to_rgb(TRUTH_COLOUR)) == 0
    assert METHOD_COLOURS["mesvo_f"] == "#000000"
    strongest = {"viso2": 1, "solution_selection": 2, "feature_selection": 2}  # of red, green, blue
    assert {name: np.argmax(to_rgb(METHOD_COLOURS[name])) for name in strongest} == strongest
    assert method_colour("mine", 0) != method_colour("yours", 1)


def test_of_paths_that_lie_on_each_other_every_one_is_seen() -> None:
    names = list(METHOD_COLOURS)
    figure = trajectories_figure({"street": (straight(30), {name: straight(30) for name in names})})
    widths = [line.get_linewidth() for line in figure.axes[0].get_lines() if line.get_marker() != "o"]
    assert all(before > after for before, after in itertools.pairwise(widths))
    picture = cv2.imdecode(np.frombuffer(png(figure), np.uint8), cv2.IMREAD_COLOR)
    assert picture is not None
    # A row through the middle of the drive, above the legend: the truth and every method show in it.
    row = picture[picture.shape[0] // 3].astype(int)
    for colour in (TRUTH_COLOUR, *METHOD_COLOURS.values()):
        assert (np.abs(row - 255 * np.array(to_rgb(colour)[::-1])).max(axis=1) < 60).any(), colour


def test_sequences_side_by_side_share_one_legend_and_keep_their_titles() -> None:
    panels: dict[str, tuple[Array | None, dict[str, Array]]] = {
        f"kitti/{n:02d}": (straight(5), {"viso2": straight(5)}) for n in (2, 7, 8)
    }
    panels["kitti/11"] = (None, {"viso2": straight(5), "mesvo_f": straight(5)})
    figure = trajectories_figure(panels)
    assert [axis.get_title() for axis in figure.axes if axis.get_title()] == list(panels)
    (legend,) = figure.legends
    assert [text.get_text() for text in legend.get_texts()] == ["ground truth", "viso2", "mesvo_f"]


def test_paths_that_coincide_from_above_differ_in_their_distance_from_the_truth() -> None:
    truth, strayed = straight(30), straight(30)
    strayed[:, 1, 3] += 0.01 * np.arange(30)  # upwards, which the view from above does not show
    _, drift = trajectories_figure({"street": (truth, {"viso2": truth, "mesvo_f": strayed})}).axes
    same, off = (np.array(line.get_data(), np.float64) for line in drift.get_lines())
    np.testing.assert_allclose(same, [np.arange(30.0), np.zeros(30)], atol=1e-9)
    np.testing.assert_allclose(off, [np.arange(30.0), 0.01 * np.arange(30)], atol=1e-9)


def test_error_curves_go_through_their_points_and_start_at_zero() -> None:
    points = [(100.0, 1.5, 0.5), (200.0, 1.0, 0.25)]
    figure = error_curves_figure("title", "length", {"viso2": points, "empty": []})
    for place, axis in enumerate(figure.axes, start=1):
        line = axis.get_lines()[0]
        np.testing.assert_array_equal(line.get_xydata(), [(point[0], point[place]) for point in points])
        assert axis.get_ylim()[0] == 0.0
        assert line.get_color() == METHOD_COLOURS["viso2"]
    assert "length [m]" in figure.axes[1].get_xlabel()
    assert "speed" in error_curves_figure("title", "speed", {"viso2": points}).axes[1].get_xlabel()


def test_curves_are_drawn_where_the_points_make_one(tmp_path: Path) -> None:
    """The benchmark's bins of speed overlap: a drive at one speed lies in three at the most."""
    points: list[Curve] = [[(10.0 * n, 1.0, 0.5) for n in range(1, many + 1)] for many in range(5)]
    for many, drawn in ((1, set()), (2, {"length"}), (3, {"length"}), (4, {"length", "speed"})):
        curves = {by: {"few": points[0], "more": points[many]} for by in ("length", "speed")}
        assert set(write_curves(tmp_path, "07", "title", curves)) == drawn
    assert len(list(tmp_path.glob("errors_07_by_*.p[nd][gf]"))) == 4
