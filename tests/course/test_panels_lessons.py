"""Special functions of single panels: steps that reject a feature, pose files of a user, run of a method."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import write_bands

from course.ch02 import panel as ch02_panel
from course.ch03 import SelectionPanel
from course.ch03 import exercises as ch03
from course.ch03.panel import _candidates, previous_vector
from course.ch05 import LorryPanel
from course.ch06.panel import EvaluationPanel
from course.memory import Memory
from course.panel import Panel
from vo_lib.config import change, preset
from vo_lib.data.poses import format_tum, read_kitti_poses
from vo_lib.data.sequence import Sequence

NOTEBOOKS = Path(__file__).parents[2] / "notebooks"
LONG = 300.0  # seconds; a safeguard


def test_a_method_is_run_and_judged(bands: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    panel = EvaluationPanel(str(bands), frame=1, view__lengths="1,2", view__estimate="mesvo_f")
    panel.wait(LONG)
    assert "press <i>Run the method</i>" in panel._text.value
    panel.run()
    assert panel.error == ""
    panel.wait(LONG)
    assert panel.error == ""
    assert 0 < panel.facts["TE"] < 20
    panel.set(view__estimate="made-up errors")
    panel.run()
    panel.wait(LONG)
    assert panel.error == "choose a method under *estimate*, and leave *a file of your own* empty"


def test_a_pose_file_is_compared_at_the_times_of_its_poses(bands: Path, tmp_path: Path) -> None:
    truth = read_kitti_poses(bands / "poses.txt")
    times = 0.05 * np.arange(-1.0, 12.0)
    poses = np.concatenate([truth[:1], np.repeat(truth, 2, axis=0)])
    (tmp_path / "fast.tum").write_text(format_tum(times, poses), encoding="utf-8")
    panel = EvaluationPanel(str(bands), view__lengths="1,2", view__file=str(tmp_path / "fast.tum"))
    panel.wait(LONG)
    assert panel.error == ""
    assert panel.facts["ATE"] == pytest.approx(0.0, abs=1e-6)
    (tmp_path / "other.tum").write_text(format_tum(1e9 * times[1::2], truth), encoding="utf-8")
    panel = EvaluationPanel(str(bands), view__file=str(tmp_path / "other.tum"))
    panel.wait(LONG)
    assert "fewer than two poses at times of the sequence: 0 to 500000000 s and 0 to 0.5 s" in panel.error


def test_without_truth_no_error_of_a_rotation_is_stated(bands: Path) -> None:
    (bands / "poses.txt").unlink()
    panel = SelectionPanel(str(bands), frame=3)
    panel.wait(LONG)
    assert panel.error == ""
    assert np.isnan([panel.facts["error by consensus"], panel.facts["error by selection"]]).all()
    assert "no ground truth" in panel._text.value
    assert "no ground truth" in ch03.consensus_fooled(panel.facts).message


def test_the_number_of_sets_does_not_change_the_vector_of_the_frame_before(street: Sequence) -> None:
    """It is estimated once, else each move of the slider would take a third longer."""
    vectors = [
        previous_vector(street, 45, change(preset("solution_selection"), name, value))
        for name, value in (("selection.sets", 1000), ("selection.sets", 10), ("selection.top_k", 7))
    ]
    assert vectors[0] is vectors[1] is vectors[2]
    other = previous_vector(street, 45, change(preset("solution_selection"), "selection.threshold", 3.0))
    assert other is not vectors[0]


@pytest.mark.parametrize(
    ("made", "memory"), [(ch02_panel.FivePointPanel, ch02_panel._errors), (SelectionPanel, _candidates)]
)
def test_the_sets_of_another_front_end_have_their_own_solutions(
    made: type[Panel], memory: Memory[Any], street: Sequence
) -> None:
    panel = made(street, 60)
    panel.wait(LONG)
    usual = panel.state()
    other = replace(usual, config=change(usual.config, "matching.row_tolerance", 0.2))
    remembered = panel.draw(other).numbers
    assert remembered != panel.draw(usual).numbers
    memory.clear()
    assert panel.draw(other).numbers == remembered


@pytest.mark.parametrize("variant", ["published", "kit"])
def test_the_inliers_of_a_winner_that_stereo_contradicts_are_shown(variant: str, street: Sequence) -> None:
    """As chapter 5 says of a share of 0.5; the kit does not store such a winner."""
    panel = LorryPanel(street, 60, view__share=0.5)
    panel.wait(LONG)
    panel.set(variant=variant)
    assert panel.error == ""
    found = re.search(
        r"fits (\d+) of (\d+) matches on the street and (\d+) of (\d+) on the", panel._text.value
    )
    assert found is not None
    street_fits, on_street, lorry_fits, on_lorry = map(int, found.groups())
    assert lorry_fits > 0.9 * on_lorry
    assert street_fits < 0.2 * on_street
    assert ("contradicts_stereo" in panel._text.value) == (variant == "kit")


def test_a_frame_without_a_winner_is_reported(tmp_path: Path) -> None:
    panel = LorryPanel(str(write_bands(tmp_path / "still", standing=True)), 3, view__share=0.0)
    panel.wait(LONG)
    assert panel.error == ""
    assert "There is no winner: the camera stands still" in panel._text.value
