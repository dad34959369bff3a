"""Chapter 5: boxes of real drives, distances to epipolar lines, precision and recall, box rules."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import with_box
from real_images import DRIVE_0013, RealImages, labelled_drive_0005

from course.ch05 import FilteringPanel, real_drives
from course.ch05.panel import precision_recall
from course.lessons import CAMERA, drive
from course.simulation.tracks import TrackConfig, simulate_tracks
from vo_lib.data.catalogue import open_sequence
from vo_lib.data.sequence import Sequence
from vo_lib.geometry.boxes import Boxes, no_boxes


def test_a_drive_that_is_missing_is_named_with_the_command_that_fetches_it(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
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


class Detector:
    """A detector with two boxes on the labelled vehicle (the low-scored box is exact) and a false box."""

    path = Path("made.onnx")

    def __init__(self, true: Any):
        self.true = true

    def candidates(self, image: Any) -> None:
        pass

    def select_boxes(self, output: None, score: float, nms: float) -> Boxes:
        to_the_right = np.array([[2.0], [0.0], [300.0]]) * [1, 0, 1, 0]
        return Boxes(self.true + to_the_right, np.full(3, 2), np.array([0.9, 0.8, 0.3]))


def test_of_two_boxes_on_one_vehicle_the_better_scored_is_right(bands: Path) -> None:
    sequence = open_sequence(with_box(bands, 6))
    detector: Any = Detector(sequence.boxes(1).xyxy[0])
    score, precision, recall = precision_recall(sequence, range(1, 3), detector)
    np.testing.assert_allclose(score, [0.9, 0.9, 0.8, 0.8, 0.3, 0.3])
    np.testing.assert_allclose(precision, [1, 1, 2 / 3, 1 / 2, 2 / 5, 1 / 3])
    np.testing.assert_allclose(recall, [1 / 2, 1, 1, 1, 1, 1])
    detector.select_boxes = lambda *_: no_boxes()
    assert [len(each) for each in precision_recall(sequence, range(1, 3), detector)] == [0, 0, 0]


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
