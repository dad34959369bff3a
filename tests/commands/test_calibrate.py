"""`vo calibrate`, and runs that start from what it learnt."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from vo_lib.beyond.calibration import read_calibration
from vo_lib.commands.cli import main

SMALL = ["--features.cell", "10"]
HELD = ["--calibration.estimate", "off"]


@pytest.fixture
def learnt(bands: Path) -> Path:
    """The calibration file of the bands, learnt in two drives that are the same."""
    path = bands.parent / "camera.json"
    assert main(["calibrate", str(bands), str(bands), "--out", str(path)]) == 0
    return path


def test_a_camera_is_learnt_from_several_drives(
    bands: Path, capsys: pytest.CaptureFixture[str], learnt: Path
) -> None:
    printed = capsys.readouterr().out
    assert "warning" not in printed
    assert printed.count("after bands: ") == 2
    assert str(learnt) in printed
    file = bands.parent / "once.json"
    assert main(["calibrate", str(bands), "--out", str(file)]) == 0
    once, twice = read_calibration(file), read_calibration(learnt)
    # The second drive adds to what the rows, which no jolt shifts, say.
    assert (np.diag(twice.covariance)[9:15] < np.diag(once.covariance)[9:15]).all()


def test_a_drive_that_teaches_nothing_is_said(bands: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (bands / "image_0").rename(bands / "other")
    (bands / "image_1").rename(bands / "image_0")
    (bands / "other").rename(bands / "image_1")
    assert main(["calibrate", str(bands), "--out", str(bands.parent / "swapped.json")]) == 0
    assert "warning: bands: left and right are swapped" in capsys.readouterr().out


def test_a_run_keeps_what_it_learnt_and_another_holds_it(bands: Path) -> None:
    first, second = bands.parent / "first", bands.parent / "second"
    assert main(["run", str(bands), "--out", str(first), *SMALL]) == 0
    known = first / "calibration.json"
    words = ["run", str(bands), "--out", str(second), *SMALL, *HELD, "--calibration", str(known)]
    assert main(words) == 0
    given, held = (read_calibration(folder / "calibration.json") for folder in (first, second))
    np.testing.assert_array_equal(held.estimate, given.estimate)
    assert np.any(given.estimate)


def test_a_run_that_starts_from_a_file_goes_on_learning(bands: Path, learnt: Path) -> None:
    out = bands.parent / "out"
    assert main(["run", str(bands), "--out", str(out), *SMALL, "--calibration", str(learnt)]) == 0
    given, then = read_calibration(learnt), read_calibration(out / "calibration.json")
    assert not np.array_equal(given.estimate, then.estimate)
    assert (np.diag(then.covariance)[9:15] < np.diag(given.covariance)[9:15]).all()


def test_a_finished_run_from_another_calibration_is_refused(
    bands: Path, learnt: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["run", str(bands), "--out", str(bands.parent / "out"), *SMALL]
    assert main(words) == 0
    capsys.readouterr()
    assert main([*words, "--calibration", str(learnt)]) == 2
    assert "another calibration" in capsys.readouterr().err


def test_another_cameras_calibration_is_refused(
    bands: Path, learnt: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    other, out = bands.parent / "other", bands.parent / "out"
    shutil.copytree(bands, other)
    calib = other / "calib.txt"
    calib.write_text(calib.read_text(encoding="utf-8").replace("-150.0", "-160.0"), encoding="utf-8")
    for words in (["run", str(other), "--calibration", str(learnt)], ["calibrate", str(bands), str(other)]):
        assert main([*words, "--out", str(out.with_suffix(".json"))]) == 2
        *_, line = capsys.readouterr().err.splitlines()  # the bar of the first drive may stand above
        assert "another camera: baseline is 0.5 and" in line
    assert not out.with_suffix(".json").exists()
