"""The appendix on calibration: estimates of the faults of a rig."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from course.appendix import CalibrationPanel
from course.appendix.panel import FRAMES, _learnt, tracks_of
from course.appendix.rig_estimate import KITTI_01, errors_of_rig, learn
from course.perturbed_path import block_tour
from course.simulation.tracks import SimulatedFrame, TrackConfig, simulate_tracks
from vo_lib.data.sequence import Sequence
from vo_lib.geometry.camera import StereoCamera
from vo_lib.kit.rig import DISPARITY_TERMS, ERROR_NAMES

CAMERA = StereoCamera(f=700.0, cx=600.0, cy=180.0, baseline=0.5, width=1200, height=360)


def tracks(frames: int) -> list[SimulatedFrame]:
    """Simulated matches of a drive along the first side of a block."""
    poses = block_tour(1)[: frames + 1]
    return list(simulate_tracks(poses, CAMERA, TrackConfig(points=200, noise=0.1), seed=0))


def test_steps_get_their_length_where_all_terms_are_learnt() -> None:
    _, ratios = learn(CAMERA, tracks(60), errors_of_rig(KITTI_01))
    assert np.mean(ratios["as measured"][-20:]) > 1.02
    assert np.mean(ratios["corrected"][-20:]) == pytest.approx(1.0, abs=0.002)


def test_only_the_terms_asked_for_are_learnt() -> None:
    estimate, _ = learn(CAMERA, tracks(20), errors_of_rig(KITTI_01), ("1", "x²"))
    large = np.abs(estimate.errors[: len(DISPARITY_TERMS)]) > 1e-3
    assert [term for term, is_large in zip(DISPARITY_TERMS, large, strict=True) if is_large] == ["1", "x²"]
    assert estimate.errors[ERROR_NAMES.index("row xy")] < -3.0


def test_a_drive_is_not_taken_for_its_first_frames(street: Sequence) -> None:
    part = street.part(0, 12)
    assert len(tracks_of(part, 1)) == 11
    assert len(tracks_of(street, 1)) == FRAMES
    panel = CalibrationPanel(part, frame=1)
    state = panel.state()
    of_part = panel.draw(state)
    whole = replace(state, sequence=street)
    of_whole = panel.draw(whole)
    assert "in 11 frames" in of_part.sentence
    assert f"in {FRAMES} frames" in of_whole.sentence
    _learnt.clear()
    assert panel.draw(whole).numbers == of_whole.numbers != of_part.numbers
