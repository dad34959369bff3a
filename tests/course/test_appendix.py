"""The appendix on calibration: estimates of the faults of a rig."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from course.appendix.ablation_figure import ablation_figure, ablation_ratios
from course.appendix.panel import KITTI_01, learn, rig
from course.made_up import block_tour
from course.simulation.tracks import SimulatedFrame, TrackConfig, simulate_tracks
from vo_lib.geometry.camera import StereoCamera
from vo_lib.kit.rig import DISPARITY_TERMS, ERROR_NAMES

CAMERA = StereoCamera(f=700.0, cx=600.0, cy=180.0, baseline=0.5, width=1200, height=360)


def tracks(frames: int) -> list[SimulatedFrame]:
    """Simulated matches on the first side of a block."""
    poses = block_tour(1)[: frames + 1]
    return list(simulate_tracks(poses, CAMERA, TrackConfig(points=200, noise=0.1), seed=0))


def test_steps_get_their_length_where_all_terms_are_learnt() -> None:
    _, lengths = learn(CAMERA, tracks(60), rig(KITTI_01))
    assert np.mean(lengths["as measured"][-20:]) > 1.02
    assert np.mean(lengths["corrected"][-20:]) == pytest.approx(1.0, abs=0.002)


def test_only_the_terms_asked_for_are_learnt() -> None:
    known, _ = learn(CAMERA, tracks(20), rig(KITTI_01), ("1", "x²"))
    large = np.abs(known.errors[: len(DISPARITY_TERMS)]) > 1e-3
    assert [term for term, found in zip(DISPARITY_TERMS, large, strict=True) if found] == ["1", "x²"]
    assert known.errors[ERROR_NAMES.index("row xy")] < -3.0


def test_the_picture_of_the_ideas_has_the_ratio_of_errors_without_and_with_each(tmp_path: Path) -> None:
    path = tmp_path / "ablation.csv"
    head = "idea,method,sequence,lines,seeds,te,te_sd,re,re_sd,length,length_sd,ms"
    lines = [head, ",m,a,,2,2.0,0,4.0,0,0,0,9", ",m,b,,2,1.0,0,1.0,0,0,0,9", "x,m,b,7,2,0.5,0,-0.1,0,0,0,1"]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    ideas, sequences, ratios = ablation_ratios(path)
    assert (ideas, sequences) == (["x"], ["b"])
    np.testing.assert_allclose(ratios[:, 0, 0], [1.5, 0.9])
    assert len(ablation_figure().axes) == 2
