"""Missing parts of a sequence, real frames, matches of a frame, and a rotation that is kept in memory."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from conftest import write_bands
from real_images import DRIVE_0013, RealImages

from course import frames
from course.candidates import consensus_rotation
from course.ch00 import StartPanel
from course.memory import Memory
from course.rotation_errors import reference_rotation
from vo_lib.config import preset
from vo_lib.data.catalogue import open_sequence
from vo_lib.data.sequence import Sequence

LONG = 300.0  # seconds; a safeguard


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


def test_points_of_another_configuration_have_their_own_rotation(street: Sequence) -> None:
    count = 150
    rotations = []
    for variant in ("published", "kit"):
        all_points = frames.frame_points(street, 60, preset("solution_selection", variant=variant))
        points = replace(
            all_points,
            x_p=all_points.x_p[:count],
            x_c=all_points.x_c[:count],
            X_p=all_points.X_p[:count],
            T_cp=None,
        )
        assert len(points.x_p) == count
        R_cp = reference_rotation(street, 60, points)
        expected = consensus_rotation(points, np.random.default_rng(0), street.camera.f)
        np.testing.assert_array_equal(R_cp, expected)
        rotations.append(R_cp)
    assert not np.array_equal(rotations[0], rotations[1])


def test_sequences_of_the_same_name_are_remembered_side_by_side(tmp_path: Path) -> None:
    """A panel of the second one used to show the first one."""
    first = frames.load(str(write_bands(tmp_path / "first" / "run")))
    second = frames.load(str(write_bands(tmp_path / "second" / "run")))
    assert first.name == second.name
    given = [first, second, second.part(0, 3), second.part(1, 4), replace(second, truth=None)]
    names = [frames.remember_sequence(each) for each in given]
    assert len(set(names)) == len(given)
    assert [frames.opened(name) for name in names] == given
    assert [frames.remember_sequence(each) for each in given] == names  # a cell that is run again
    same = open_sequence(tmp_path / "second" / "run")
    assert frames.remember_sequence(same) == names[1]


def test_a_part_leaves_the_name_of_a_known_sequence_to_the_whole(
    street: Sequence, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(frames, "_sequences", Memory(8))
    part = street.part(30, 40)
    name = frames.remember_sequence(part)
    assert frames.opened(name) is part
    assert len(frames.load(street.name)) == len(street)
    assert frames.remember_sequence(replace(part, name="a part of it")) == "a part of it"


def test_a_panel_shows_the_part_that_it_was_given(street: Sequence) -> None:
    frames.load(street.name)
    panel = StartPanel(street.part(30, 40), frame=3)
    assert panel.error == ""
    assert panel.state().sequence.frames == street.frames[30:40]
    assert "Only the panel" not in panel._text.value
    panel.chooser.value = street.name  # the cells still use the part
    panel.wait(LONG)
    assert "Only the panel shows" in panel._text.value
    assert "000000 to" in panel._text.value
    assert "000030 to 000039" in panel._text.value


def test_the_name_of_the_catalogue_is_left_to_its_sequence(
    street: Sequence, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A cell that opened the scene by name used to get the sequence without its truth."""
    monkeypatch.setattr(frames, "_sequences", Memory(8))
    without = replace(street, truth=None)
    name = frames.remember_sequence(without)
    assert frames.opened(name) is without
    assert frames.load(street.name).truth is not None
    monkeypatch.setattr(frames, "_sequences", Memory(8))
    assert frames.remember_sequence(street) == street.name


def test_a_sequence_that_was_given_can_be_chosen_again_after_many_others(
    street: Sequence, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It used to be lost: its name is no folder that could be opened again."""
    monkeypatch.setattr(frames, "_sequences", Memory(1))
    part = street.part(30, 40)
    panel = StartPanel(part, frame=3)
    name = panel.chooser.value
    panel.chooser.value = street.name
    panel.wait(LONG)
    assert not frames.is_open(name)
    panel.chooser.value = name
    panel.wait(LONG)
    assert panel.error == ""
    assert panel.state().sequence == part


def test_panels_of_two_sequences_of_the_same_name_go_back_to_their_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, street: Sequence
) -> None:
    monkeypatch.setattr(frames, "_sequences", Memory(1))
    panels = []
    given = []
    for folder in ("first", "second"):
        sequence = open_sequence(write_bands(tmp_path / folder / "run"))
        given.append(sequence)
        panels.append(StartPanel(sequence, frame=1))
        frames.opened(street.name)  # the name of the first one is free again
    for panel, sequence in zip(panels, given, strict=True):
        name = panel.chooser.value
        assert name == "run"
        panel.chooser.value = street.name
        panel.wait(LONG)
        panel.chooser.value = name
        panel.wait(LONG)
        assert panel.state().sequence == sequence


def test_a_part_and_the_whole_keep_places_of_their_own(street: Sequence) -> None:
    """They have the same name, but not in the list."""
    frames.load(street.name)
    panel = StartPanel(street.part(30, 40), frame=3)
    name = panel.chooser.value
    panel.chooser.value = street.name
    panel.wait(LONG)
    panel.frame.value = 7
    panel.chooser.value = name
    panel.wait(LONG)
    assert panel.state().frame == 3
    panel.chooser.value = street.name
    panel.wait(LONG)
    assert panel.state().frame == 7


@pytest.mark.parametrize(("frame", "ages"), [(1, [1]), (2, [1, 2]), (60, [1, 2])])
def test_the_matches_of_a_frame_are_one_or_two_frames_old(
    frame: int, ages: list[int], street: Sequence
) -> None:
    matches = frames.frame_matches(street, frame, preset("solution_selection"))
    assert np.unique(matches.age).tolist() == ages
