"""The appendix on calibration: faults of a rig as shapes, what is learnt of them, what lenses show."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import write_bands

from course.appendix import CalibrationPanel
from course.appendix.panel import KITTI_01, image_grid, learn, lens_figure, rig
from course.made_up import block_tour
from vo_lib.beyond.rig import COLUMNS, NAMES
from vo_lib.core.camera import StereoCamera
from vo_lib.data.tracks import SimulatedFrame, TrackConfig, simulate_tracks

CAMERA = StereoCamera(f=700.0, cx=600.0, cy=180.0, baseline=0.5, width=1200, height=360)
LONG = 300.0  # seconds; a safeguard


def tracks(first: int, frames: int) -> list[SimulatedFrame]:
    """Simulated matches on a tour round a block; its corner is at frames 180 to 200."""
    poses = block_tour(1)[first : first + frames + 1]
    return list(simulate_tracks(poses, CAMERA, TrackConfig(points=200, noise=0.1), seed=0))


def test_faults_add_up_in_columns_and_rows() -> None:
    coefficients = dict(zip(NAMES, rig({"roll": 2.0, "focal length": 3.0}), strict=True))
    there = {term: value for term, value in coefficients.items() if value}
    assert there == {"disparity x": 3.0, "disparity y": 2.0, "row x": -2.0, "row y": 3.0}


def test_steps_get_their_length_where_all_terms_are_learnt() -> None:
    _, lengths = learn(CAMERA, tracks(0, 60), rig(KITTI_01))
    assert np.mean(lengths["as measured"][-20:]) > 1.02
    assert np.mean(lengths["corrected"][-20:]) == pytest.approx(1.0, abs=0.002)


def test_only_the_terms_asked_for_are_learnt() -> None:
    known, _ = learn(CAMERA, tracks(0, 20), rig(KITTI_01), ("1", "x²"))
    large = np.abs(known.errors[: len(COLUMNS)]) > 1e-3
    assert [term for term, found in zip(COLUMNS, large, strict=True) if found] == ["1", "x²"]
    assert known.errors[NAMES.index("row xy")] < -3.0


def test_a_lens_that_is_decentered_moves_points_across_epipolar_lines_and_a_radial_one_does_not() -> None:
    points = image_grid(CAMERA)
    arrows: list[Any] = [axis.collections[-1] for axis in lens_figure(CAMERA).axes]
    p1, p2, *radial = (np.hypot(each.U, each.V).max() for each in arrows)
    assert len(arrows[0].U) == len(points)
    assert p1 > 2 * p2 > 1e6 * max(radial)


def test_a_camera_at_rest_has_no_steps_to_judge(tmp_path: Path) -> None:
    panel = CalibrationPanel(str(write_bands(tmp_path / "bands", standing=True)), frame=1)
    panel.wait(LONG)
    assert panel.error == ""
    assert np.isnan(panel.facts["steps too long, corrected"])
    assert "rows differ" in panel._text.value  # these need no motion
