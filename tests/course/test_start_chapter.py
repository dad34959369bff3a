"""Chapter 0: its statements about the jam and the drawn street, and its pictures."""

from __future__ import annotations

import itertools
import re
from dataclasses import replace
from pathlib import Path

import nbformat
import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg

from course.ch00 import figures as draw
from course.ch05.claim import step_errors
from course.frames import frame_matches, load_part, scene_truth
from course.simulation.true_matches import depth
from vo_lib import preset, run
from vo_lib.data.poses import from_first
from vo_lib.data.sequence import Sequence
from vo_lib.errors import DataError
from vo_lib.geometry.motion import DEVIATION_OVER_MEDIAN, inverse

NOTEBOOKS = Path(__file__).resolve().parents[2] / "notebooks"
CELLS = nbformat.read(NOTEBOOKS / "00_start_here.ipynb", as_version=4).cells  # type: ignore[no-untyped-call]
TEXT = "\n".join(cell.source for cell in CELLS)
TEACHING = (NOTEBOOKS / "teaching.md").read_text(encoding="utf-8")


@pytest.mark.slow
def test_the_jam_drifts_less_with_each_vehicle_removed() -> None:
    jam = load_part("synthetic/jam", 60, 89)
    kinds = {"all": (), "truck": (1,), "van": (4,)}
    sequences = {name: draw.with_boxes_of_vehicles(jam, *vehicles) for name, vehicles in kinds.items()}
    poses = {name: run(each, preset("feature_selection")).poses for name, each in sequences.items()}
    poses["boxes"] = run(jam, preset("feature_selection")).poses
    assert jam.truth is not None
    true = from_first(jam.truth)[-1, :3, 3]
    ends = {name: path[-1, :3, 3] - true for name, path in poses.items()}
    off = {name: 100 * float(np.linalg.norm(end)) for name, end in ends.items()}
    assert "With all points, the estimated path drifts to the right" in TEXT
    assert ends["all"][0] > 0.2
    assert off["all"] > off["truck"] > off["van"] > 2 * off["boxes"]
    words = (
        r"is (\d+) cm off at the end; without the features on the truck (\d+) cm, .* (\d+) cm, .* (\d+) cm\."
    )
    told = re.search(words, TEACHING)
    assert told is not None
    assert [round(off[name]) for name in ("all", "truck", "van", "boxes")] == [int(n) for n in told.groups()]
    assert "without the boxes removed, the rotation error per step was larger than that" in TEXT
    turns = {name: step_errors(jam, poses[name])[0].mean() for name in ("all", "boxes")}
    assert turns["all"] > 0.02 > turns["boxes"]
    made = draw.jam_figure(jam, poses)
    assert made.axes[0].get_title("left") == "paths from above"
    FigureCanvasAgg(made).draw()  # type: ignore[no-untyped-call]
    name = made.axes[0].yaxis.label
    assert name.get_text() == "x, right [m]"
    assert name.get_window_extent().x0 >= 0  # not cut off at the edge


def test_the_orders_of_three_turns_are_counted() -> None:
    assert "in six orders (in twelve, if the first axis may come again as the last" in TEXT
    orders = [axes for axes in itertools.product("xyz", repeat=3) if axes[0] != axes[1] != axes[2]]
    assert len(orders) == 12
    assert len([axes for axes in orders if len(set(axes)) == 3]) == 6


def test_columns_are_measured_a_little_less_exactly_than_rows(street: Sequence) -> None:
    assert "it is of the same size, but somewhat larger" in TEXT
    matches = frame_matches(street, 60, preset("feature_selection"))
    rows = DEVIATION_OVER_MEDIAN * np.median(np.abs(matches.cur_left[:, 1] - matches.cur_right[:, 1]))
    scene = scene_truth(street)
    assert scene is not None
    u, v = np.rint(matches.cur_left).astype(int).T
    true = depth(scene, 60)[v, u]
    camera = street.camera
    Z = camera.triangulate(matches.cur_left, matches.cur_right)[:, 2]
    good = np.isfinite(true) & np.isfinite(Z)
    wrong = camera.f * camera.baseline * (1 / Z[good] - 1 / true[good])
    columns = DEVIATION_OVER_MEDIAN * np.median(np.abs(wrong))
    assert rows < columns < 1.7 * rows
    label = draw.depth_figure(camera, Z, true).axes[0].get_legend_handles_labels()[1][1]
    assert f"{columns:.2f} px" in label


def test_motions_are_true_or_estimated(street: Sequence) -> None:
    part = street.part(0, 4)
    assert part.truth is not None
    motions, words = draw.motions_of(part)
    assert words == "true motions"
    np.testing.assert_allclose(motions[0], inverse(part.truth[1]) @ part.truth[0])
    estimated, words = draw.motions_of(replace(part, truth=None))
    assert "no truth" in words
    assert len(estimated) == len(motions) == 3
    for one, other in zip(motions, estimated, strict=True):
        assert np.linalg.norm(one[:3, 3] - other[:3, 3]) < 0.1


def test_the_stages_have_a_picture_each(street: Sequence) -> None:
    stages = draw.stage_pictures(street, 60)
    assert list(stages) == ["matches", "five", "winner", "translation"]
    pictures = [stages[name] for name in ("matches", "five", "winner")]
    assert len({np.asarray(each).tobytes() for each in pictures}) == 3


def test_points_that_differ_from_the_librarys_are_marked() -> None:
    points = np.array([[0.0, 0.0, 10.0], [1.0, 0.0, 20.0]])
    own = np.array([[0.0, 0.0, 10.0], [1.5, 0.0, 20.0]])
    drawn = draw.above_figure(own, points, np.full(2, 0.1)).axes[0].lines
    places = [np.column_stack(line.get_data()) for line in drawn]  # (z, x)
    for drawn_places, expected in zip(places, (points, own[:1], own[1:]), strict=True):
        np.testing.assert_allclose(drawn_places, expected[:, [2, 0]])


def test_boxes_of_vehicles_need_a_drawn_scene(street: Sequence) -> None:
    with pytest.raises(DataError, match="it has no truth of vehicles"):
        draw.with_boxes_of_vehicles(replace(street, folder=Path("nowhere")), 1)
