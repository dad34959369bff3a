"""Chapter 5: boxes of real drives, distances to epipolar lines, box rules."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from conftest import with_box
from real_images import DRIVE_0013, RealImages, labelled_drive_0005

from course.ch05 import FilteringPanel, real_drives
from course.frames import frame_matches, true_motion
from course.simulation.drives import CAMERA, drive
from course.simulation.tracks import TrackConfig, simulate_tracks
from vo_lib.config import preset
from vo_lib.data.catalogue import open_sequence
from vo_lib.data.sequence import Sequence
from vo_lib.data.truth import matches_on_moving
from vo_lib.geometry.matches import StereoMatches
from vo_lib.paper.box_removal import inside


def test_a_drive_that_is_missing_is_named_with_the_command_that_fetches_it(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    (tmp_path / "sequences").mkdir()
    monkeypatch.setenv("KITTI_ROOT", str(tmp_path))
    assert real_drives.with_boxes("kitti/drive_0013", "") is None
    assert "`vo data get_kitti --raw 2011_09_26_drive_0013 --frames 0:80`" in capsys.readouterr().out
    assert real_drives.find_detector("nothing-like-it") == ""
    assert "nothing-like-it is not on this machine" in capsys.readouterr().out


def test_a_drive_has_the_boxes_of_its_folder(monkeypatch: pytest.MonkeyPatch) -> None:
    folder = labelled_drive_0005().folder
    monkeypatch.setenv("KITTI_ROOT", str(folder.parents[1]))
    labelled = real_drives.with_boxes("kitti/drive_0005", "")
    assert labelled is not None
    assert len(labelled.boxes(40)) > 5


def test_a_drive_without_boxes_needs_a_detector(
    real: RealImages, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("KITTI_ROOT", str(real.root(*DRIVE_0013)))
    assert real_drives.with_boxes("kitti/drive_0013", "") is None
    assert "needs a detector" in capsys.readouterr().out


def test_only_standing_points_lie_on_their_epipolar_lines() -> None:
    sequence = Sequence("made", Path("made"), (), CAMERA, np.zeros(0), None, None)
    tracks = TrackConfig(points=300, noise=0.0, moving=0.3, object_heading=60.0)
    for frame in simulate_tracks(drive(3), CAMERA, tracks):
        distances = real_drives.line_distances(sequence, frame.matches, frame.T_cp)
        assert distances[~frame.moving].max() < 1e-9
        assert np.median(distances[frame.moving]) > 1.0


def test_the_box_whose_features_are_farthest_off_is_named_by_its_number(bands: Path) -> None:
    sequence = open_sequence(with_box(bands, 6))
    box = sequence.boxes(1).xyxy[0]
    inner = box[:2] + (box[2:] - box[:2]) * np.linspace(0.2, 0.8, 4)[:, None]
    uv = np.concatenate([inner, [[1.0, 1.0]]])
    lengths = np.ones(len(uv), np.int64)
    matches = StereoMatches(uv, uv, uv, uv, lengths, np.ones(len(uv)), np.arange(len(uv)))
    rows = real_drives.distances_by_box(sequence, 1, matches, np.array([0.5, 0.6, 0.7, 0.8, 0.1]))
    assert [(each.row, each.count) for each in rows] == [(-1, 1), (0, 4)]
    far = real_drives.farthest_box(rows)
    assert far is not None
    assert far.median == pytest.approx(0.65)
    lines = real_drives.distance_lines(rows).splitlines()
    assert lines[0].startswith("outside boxes: features:   1, median 0.10 px")
    assert lines[1].endswith("black in the picture")
    few = real_drives.distances_by_box(sequence, 1, matches[np.array([0, 1])], np.array([0.5, 0.6]))
    assert real_drives.farthest_box(few) is None


def test_the_line_distance_is_small_for_a_moving_car_and_large_for_a_parked_one(street: Sequence) -> None:
    # What chapter 5 says of frame 65: box 7 drives ahead, and the black box, number 11, is parked.
    config = preset("feature_selection")
    matches = frame_matches(street, 65, config)
    T_cp = true_motion(street, 65)
    assert T_cp is not None
    distances = real_drives.line_distances(street, matches, T_cp)
    rows = real_drives.distances_by_box(street, 65, matches, distances)
    ahead = rows[7]
    black = rows[11]
    assert real_drives.farthest_box(rows) is black
    assert (ahead.count, black.count) == (6, 36)
    assert ahead.median < min(0.25, black.median)
    moving = matches_on_moving(street, 65, matches)
    within = inside(matches.cur_left, street.boxes(65).xyxy)
    assert moving[within[:, ahead.row]].mean() > 0.5
    assert not moving[within[:, black.row]].any()


def test_the_panel_offers_the_rules_of_its_method(bands: Path) -> None:
    panel = FilteringPanel(str(with_box(bands, 6)), frame=2, view__model="labels")
    panel.wait()
    rule = panel.knobs["filter.rule"].widget
    assert rule.options == ("none", "all")
    panel.set(variant="kit", filter__rule="moving")
    assert panel.error == ""
    panel.set(variant="published")
    assert (panel.error, rule.value) == ("", "all")
    panel.reset()
    assert (panel.error, rule.value) == ("", "all")
