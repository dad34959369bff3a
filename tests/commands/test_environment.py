"""`vo list` and `vo check`: sequences, packages, data, caches, and commands for missing data."""

from __future__ import annotations

import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest

from course.frames import listed
from vo_lib.commands.cli import main
from vo_lib.commands.data_scripts import scripts
from vo_lib.data.catalogue import kitti_root, known_folder, open_sequence
from vo_lib.data.kitti import EXPECTED_FRAMES, PART
from vo_lib.data.scenes import SCENES
from vo_lib.report.table1_plan import split_missing


@pytest.fixture(autouse=True)
def _own_places(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """An environment without data and detectors; the cache has 2 MB of matches."""
    for name in ("KITTI_ROOT", "XDG_CACHE_HOME", "XDG_DATA_HOME"):
        monkeypatch.setenv(name, str(tmp_path / name))
    (tmp_path / "KITTI_ROOT" / "sequences").mkdir(parents=True)
    monkeypatch.chdir(tmp_path)
    matches = tmp_path / "XDG_CACHE_HOME" / "stereo-vo-kit" / "matches" / "a.npz"
    matches.parent.mkdir(parents=True)
    matches.write_bytes(bytes(2_000_000))


def test_check_lists_next_steps_and_cache_sizes(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check"]) == 0
    printed = capsys.readouterr().out
    assert f"opencv {cv2.__version__}" in printed
    assert np.__version__ in printed
    assert "matches: 2.0 MB" in printed
    assert "vo data clean_cache" in printed
    steps = {line.split()[2] for line in printed.splitlines() if line.startswith("  vo data ")}
    assert {"get_kitti", "get_detector", "clean_cache"} < steps < scripts().keys()


def test_help_of_list_names_all_that_it_lists(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["list", "--help"])
    help_text = " ".join(capsys.readouterr().out.split())
    assert "by name: KITTI's and the drawn scenes" in help_text


def test_check_lists_incomplete_sequences(
    bands: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = Path(shutil.copytree(bands, tmp_path / "KITTI_ROOT" / "sequences" / "04"))
    assert main(["check"]) == 0
    assert "incomplete: 04" in " ".join(capsys.readouterr().out.replace("│", "").split())
    (folder / PART).write_text("--sequences 04 --frames 0:6\n", encoding="utf-8")
    assert main(["check"]) == 0
    assert "incomplete: " not in capsys.readouterr().out
    (folder / PART).unlink()
    monkeypatch.setitem(EXPECTED_FRAMES, "04", 6)
    assert main(["check"]) == 0
    assert "incomplete: " not in capsys.readouterr().out


@pytest.fixture
def another(bands: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """data/kitti in the working folder, with a sequence 07, where KITTI is looked for without KITTI_ROOT."""
    monkeypatch.setattr("vo_lib.data.catalogue.KITTI_FOLDERS", (Path("data", "kitti"),))
    shutil.copytree(bands, tmp_path / "data" / "kitti" / "sequences" / "07")


@pytest.mark.usefixtures("another")
@pytest.mark.parametrize("root", ["KITTI_ROOT", "KITTI_ROOT/sequences", "archives", ""])
def test_kitti_root_is_the_only_root(
    bands: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    root: str,
) -> None:
    shutil.copytree(bands, tmp_path / "KITTI_ROOT" / "sequences" / "04")
    (tmp_path / "archives").mkdir()
    (tmp_path / "archives" / "dataset").symlink_to(tmp_path / "KITTI_ROOT")
    monkeypatch.setenv("KITTI_ROOT", root)
    for command in ("list", "check"):
        assert main([command]) == 0
    printed = "".join(capsys.readouterr().out.split())
    assert ("kitti/04" in printed, "kitti/07" in printed) == (root != "", root == "")
    assert ("(KITTI_ROOT)" in printed, "(KITTI_ROOTisnotset)" in printed) == (root != "", root == "")
    assert main(["reproduce", "--sequences", "03", "--out", "out"]) == 2
    assert "none of the sequences is on this machine" in capsys.readouterr().err


@pytest.mark.usefixtures("another")
@pytest.mark.parametrize("root", ["nowhere", "data/kitti/typo", "bands"])
def test_a_wrong_kitti_root_is_refused_where_kitti_is_needed(
    bands: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    root: str,
) -> None:
    monkeypatch.setenv("KITTI_ROOT", root)
    fault = f"KITTI_ROOT is {root}, without a folder `sequences`: correct or unset the variable"
    for line in (
        "list",
        "run kitti/07 --out out",
        "run kitti/99 --out out",
        "reproduce --out out",
        "reproduce --sequences synthetic/jam,07 --out out",
        "sweep --sequence kitti/07 --set selection.sets=5,6 --out out",
        "data check_kitti",
    ):
        assert main(line.split()) == 2
        assert capsys.readouterr().err.partition("error: ")[2] == f"{fault}\n"
    assert main(["check"]) == 1
    assert "".join(fault.split()) in "".join(capsys.readouterr().out.replace("│", "").split())
    assert kitti_root() == Path(root)  # `vo data get_kitti` may create it
    # A street by name and a sequence by its path need no KITTI.
    assert known_folder("synthetic/jam") is not None
    assert split_missing(["synthetic/jam", str(bands)]) == (["synthetic/jam", str(bands)], [])
    assert len(open_sequence(bands)) == 6
    assert listed().keys() == {f"synthetic/{name}" for name in SCENES}


def test_list_fits_80_columns(
    bands: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "nothing"))
    root = tmp_path / "KITTI_ROOT" / "sequences"
    for name in ("04", "05"):
        shutil.copytree(bands, root / name)
    (root / "05" / "times.txt").unlink()
    assert main(["list"]) == 0
    table, *text = capsys.readouterr().out.split("└")
    assert max(map(len, table.splitlines())) <= 80
    rows = [line.replace("│", "").split() for line in table.splitlines() if line.startswith("│")]
    facts = {name: cells for name, *cells in rows}
    assert facts["kitti/04"] == ["6", "2", "poses.txt", "no", "480×240", "1"]
    assert facts["kitti/05"] == ["–"] * 6
    assert "kitti/05 is not usable" in text[0]
    assert facts["synthetic/jam"] == ["296", "100", "poses.txt", "yes", "1241×376", "–"]
    assert {f"synthetic/{name}" for name in SCENES} < facts.keys()


def test_check_reports_two_opencv_packages(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    record = tmp_path / "opencv_contrib_python-5.0.dist-info" / "METADATA"
    record.parent.mkdir()
    record.write_text("Metadata-Version: 2.1\nName: opencv-contrib-python\nVersion: 5.0\n", encoding="utf-8")
    monkeypatch.syspath_prepend(str(tmp_path))
    assert main(["check"]) == 1
    assert "pip uninstall -y opencv-contrib-python opencv-python-headless" in capsys.readouterr().out
