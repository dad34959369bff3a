"""Run folders: what was written is read back, and what is broken is named."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from conftest import write_bands

from vo_lib import DataError, Run, open_sequence, preset, run
from vo_lib.core import settings
from vo_lib.runs.results import read_run, run_folder, timing, write_run

EXACT = ("matches", "removed", "used", "inliers", "flags")


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """A run over six frames."""
    bands = write_bands(tmp_path_factory.mktemp("results") / "bands")
    return run(open_sequence(bands), settings.replace(preset("mesvo_f"), "features.cell", 10))


def test_a_run_is_read_back_to_the_digits_written(result: Run, tmp_path: Path) -> None:
    write_run(tmp_path, result, "m")
    back = read_run(tmp_path, result.sequence)
    assert back.config == result.config
    np.testing.assert_allclose(back.poses, result.poses, atol=1e-9)
    for one, other in zip(back.motions, result.motions, strict=True):
        np.testing.assert_allclose(one.T_cp, other.T_cp, atol=1e-8)
        assert all(getattr(one, name) == getattr(other, name) for name in EXACT)
        np.testing.assert_allclose(one.prior_angle, other.prior_angle, atol=1e-4)
    assert back.ms_per_frame == pytest.approx(result.ms_per_frame, abs=0.05)
    with pytest.raises(DataError, match="expected a row for each of the 5 frames of bands"):
        read_run(tmp_path, result.sequence.part(0, 5))


def test_the_time_of_all_stages_adds_up(result: Run) -> None:
    told = timing(result)
    assert sum(told["ms_per_frame_of"].values()) == pytest.approx(told["ms_per_frame"])
    assert told["ms_per_frame_of"]["matching"] > 0


@pytest.mark.parametrize("name", ["frames.csv", "poses.txt", "calibration.json", "metrics.json"])
def test_a_file_cut_inside_its_last_number_is_noticed(result: Run, tmp_path: Path, name: str) -> None:
    write_run(tmp_path, result, "m")
    path = tmp_path / name
    path.write_bytes(path.read_bytes()[:-2])
    with pytest.raises(DataError, match=rf"{name}: was cut or changed since the run wrote it"):
        read_run(tmp_path, result.sequence)


def test_a_calibration_of_an_older_run_does_not_stay(result: Run, tmp_path: Path) -> None:
    (tmp_path / "calibration.json").write_text("{}", encoding="utf-8")
    write_run(tmp_path, dataclasses.replace(result, calibration=None), "m")
    assert not (tmp_path / "calibration.json").exists()


def test_a_sequence_keeps_its_truth(bands: Path) -> None:
    with pytest.raises(DataError, match="holds a sequence's images"), run_folder(bands):
        pass


@pytest.mark.parametrize(("name", "words"), [("", "empty"), ("x" * 300, "File name too long")])
def test_a_name_that_no_folder_can_have_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, words: str
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(DataError, match=words), run_folder(name):
        pass
    assert list(tmp_path.iterdir()) == []


def test_a_folder_made_for_work_that_fails_is_taken_away(tmp_path: Path) -> None:
    with pytest.raises(RuntimeError), run_folder(tmp_path / "a" / "b"):
        raise RuntimeError
    assert list(tmp_path.iterdir()) == []
    with run_folder(tmp_path / "a" / "b") as folder:
        (folder / "x").write_text("", encoding="utf-8")
    assert (tmp_path / "a" / "b" / "x").exists()
