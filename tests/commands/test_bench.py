"""The bench runs on a tiny sequence and its figures belong together; how large they are is not tested."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from vo_lib.commands import bench
from vo_lib.commands.cli import main


def test_the_figures_of_a_tiny_sequence_are_complete_and_consistent(
    bands: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(bench, "REPEATS", 1)
    options = ["bench", "--sequence", str(bands), "--frames", "4"]
    assert main([*options, "--json"]) == 0
    data = json.loads(capsys.readouterr().out)
    assert data["sequence"]["frames"] == 4
    assert data["machine"]["numpy"] == np.__version__
    stages = data["stages_ms_a_frame"]
    assert list(stages)[:2] == ["wait_images", "matching"]
    assert {"filter", "rotation", "translation", "calibration"} <= stages.keys()
    # The first frame has no stages, and the whole run has more to do than its stages.
    assert 3 * sum(stages.values()) <= 4 * data["wall_ms_a_frame"]
    assert 0 < data["decoding_ms_a_frame"] < data["processor_ms_a_frame"]
    assert [*data["five_point_us_a_set"]][-1] == "OpenCV findEssentialMat"
    assert main(options) == 0
    printed = capsys.readouterr().out
    assert data["machine"]["processor"] in printed
    assert "times the decoding" in printed
