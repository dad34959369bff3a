"""A sentence reports the missing parts of a sequence; a real frame is shown if it is available."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from real_images import DRIVE_0013, RealImages

from course import frames
from vo_lib.data.catalogue import open_sequence
from vo_lib.data.sequence import Sequence


def test_what_a_sequence_lacks_is_printed(bands: Path, capsys: pytest.CaptureFixture[str]) -> None:
    sequence = replace(open_sequence(bands), truth=None, labels=None)
    assert not any(frames.has_data(sequence, what) for what in frames.MISSING_DATA)
    lines = capsys.readouterr().out.splitlines()
    sentence = "bands has no ground truth: no error can be stated."
    assert lines[0] == f"{sentence} The corresponding part of this cell is skipped."
    assert len(lines) == len(frames.MISSING_DATA)


def test_a_drawn_scene_lacks_nothing(street: Sequence, capsys: pytest.CaptureFixture[str]) -> None:
    assert all(frames.has_data(street, what) for what in frames.MISSING_DATA)
    assert capsys.readouterr().out == ""


def test_without_kitti_a_sentence_says_how_to_see_a_real_frame(
    street: Sequence, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(frames, "available", lambda: {street.name: street.folder})
    assert frames.real_pair(street, 60) is None
    assert "set KITTI_ROOT" in capsys.readouterr().out


def test_a_real_frame_is_shown_beside_the_drawn_one(
    street: Sequence, real: RealImages, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("KITTI_ROOT", str(real.root(*DRIVE_0013)))
    assert frames.real_pair(street, 60, "kitti/drive_0013") is not None
    frame = frames.real_frame("kitti/drive_0013")
    assert frame is not None
    assert frame[0].name == "kitti/drive_0013"
