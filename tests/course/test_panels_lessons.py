"""Special functions of single panels: steps that reject a feature, pose files of a user, run of a method."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from course.ch03 import SelectionPanel
from course.ch03 import exercises as ch03
from course.ch06.panel import EvaluationPanel

NOTEBOOKS = Path(__file__).parents[2] / "notebooks"
LONG = 300.0  # seconds; a safeguard


def test_a_method_is_run_and_judged(bands: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    panel = EvaluationPanel(str(bands), frame=1, view__lengths="1,2", view__estimate="mesvo_f")
    panel.wait(LONG)
    assert "press Run" in panel._text.value
    panel.run()
    panel.wait(LONG)
    assert panel.error == ""
    assert 0 < panel.facts["TE"] < 20


def test_without_truth_no_error_of_a_rotation_is_stated(bands: Path) -> None:
    (bands / "poses.txt").unlink()
    panel = SelectionPanel(str(bands), frame=3)
    panel.wait(LONG)
    assert panel.error == ""
    assert np.isnan([panel.facts["error by consensus"], panel.facts["error by selection"]]).all()
    assert "no ground truth" in panel._text.value
    assert "no ground truth" in ch03.consensus_fooled(panel.facts).message
