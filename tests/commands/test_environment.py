"""What `vo check` says of the data: where it is, what is missing, and the steps that get it."""

from __future__ import annotations

from pathlib import Path

import pytest
from conftest import write_bands

from vo_lib.commands import environment
from vo_lib.commands.data import scripts
from vo_lib.data import sequence
from vo_lib.data.kitti import EXPECTED_FRAMES


def test_a_user_without_data_is_told_the_steps(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("KITTI_ROOT", str(tmp_path))
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(environment, "available", lambda: {"synthetic/jam": None})
    monkeypatch.setattr(environment, "detector_folder", lambda: tmp_path)
    monkeypatch.setattr(environment, "known", lambda: {})
    remedies = {finding.what: finding.remedy for finding in environment.check()}
    steps = list(environment.data_steps())
    assert all(command.startswith("vo data ") for command in steps)
    told = remedies["KITTI odometry"] + remedies["fetched detectors"]
    assert all(command in told for command in steps)
    assert {command.split()[2] for command in steps} < scripts().keys()


def test_incomplete_sequences_are_noted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = write_bands(tmp_path / "sequences" / "04")
    monkeypatch.setattr(environment, "available", lambda: {"kitti/04": folder})
    finding = next(f for f in environment.check() if f.what == "KITTI odometry")
    assert finding.state == "note"
    assert "incomplete: 04" in finding.found
    monkeypatch.setitem(EXPECTED_FRAMES, "04", 6)
    finding = next(f for f in environment.check() if f.what == "KITTI odometry")
    assert finding.state == "ok"


def test_data_goes_where_the_kit_looks_for_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sequence, "kitti_roots", lambda: [])
    monkeypatch.setenv("KITTI_ROOT", str(tmp_path / "kitti"))
    assert sequence.kitti_root() == tmp_path / "kitti"
    monkeypatch.setenv("KITTI_ROOT", "")
    assert sequence.kitti_root() == sequence.PROJECT / "data" / "kitti"
