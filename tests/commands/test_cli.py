"""The command as a person uses it: files written, tables printed, one line and exit code 2 for bad input."""

from __future__ import annotations

import csv
import io
import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
from conftest import HEIGHT, WIDTH

from vo_lib.beyond.calibration import read_calibration
from vo_lib.commands.cli import main
from vo_lib.commands.script import typed
from vo_lib.config import Config
from vo_lib.core import settings
from vo_lib.core.poses import read_kitti_poses, read_tum
from vo_lib.data.scenes import SCENES

FILES = [
    "calibration.json",
    "config.json",
    "frames.csv",
    "metrics.json",
    "poses.txt",
    "poses_tum.txt",
    "trajectory.png",
]
SMALL = ["--features.cell", "10"]
ROOT = Path(__file__).resolve().parents[2]


def test_a_run_writes_its_files(bands: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = bands.parent / "new" / "out"
    assert main(["run", str(bands), "--method", "mesvo_f", "--out", str(out), *SMALL]) == 0
    assert sorted(p.name for p in out.glob("[!.]*")) == FILES
    poses = read_kitti_poses(out / "poses.txt")
    assert poses.shape == (6, 4, 4)
    np.testing.assert_array_equal(poses[0], np.eye(4))
    times, tum = read_tum(out / "poses_tum.txt")
    np.testing.assert_allclose(tum, poses, atol=1e-7)
    assert times[1] == pytest.approx(0.1)
    rows = read_log(out)
    assert [row["frame"] for row in rows] == [f"{i:06d}" for i in range(1, 6)]
    assert all(float(row["matching_ms"]) > 0 and int(row["inliers"]) > 20 for row in rows)
    saved = json.loads((out / "config.json").read_text(encoding="utf-8"))
    config = settings.from_dict(Config, saved["settings"])
    assert config.features.cell == 10
    assert not config.selection.prior
    image = cv2.imread(str(out / "trajectory.png"))
    assert image is not None
    assert image.std() > 5
    printed = capsys.readouterr().out
    assert "matches a frame" in printed
    assert "ATE, aligned" in printed  # though the path is too short for TE
    assert str(out) in printed
    said = read_calibration(out / "calibration.json").in_words(config.calibration)
    assert f"errors of the calibration {said}" in re.sub(r"[│\s]+", " ", printed)


def test_part_of_a_sequence_with_labels_from_elsewhere(bands: Path) -> None:
    labels = bands.parent / "boxes"
    labels.mkdir()
    (labels / "000002.txt").write_text("2 0.5 0.5 0.4 0.4 0.9\n", encoding="utf-8")
    out = bands.parent / "out"
    options = ["--frames", "1:4", "--labels", str(labels), "--filter.min_matches", "5", "--seed", "3", *SMALL]
    assert main(["run", str(bands), "--out", str(out), *options]) == 0
    rows = read_log(out)
    assert [row["frame"] for row in rows] == ["000002", "000003"]
    assert int(rows[0]["removed_by_boxes"]) > 0


def test_matches_are_kept_where_it_is_asked_and_used_again(
    bands: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("vo_lib.runs.match_cache.cache_folder", lambda: bands.parent / "user" / "synthetic")
    for name, cache in (("filled", []), ("used", []), ("elsewhere", [str(bands.parent / "mine")])):
        assert main(["run", str(bands), "--out", str(bands.parent / name), *SMALL, "--cache", *cache]) == 0
    kept = {p.relative_to(bands.parent).parts[:2] for p in bands.parent.rglob("*.npz")}
    assert kept == {("user", "matches"), ("mine", "matches")}
    row = read_log(bands.parent / "used")[0]
    assert (row["matching_ms"], row["wait_images_ms"]) == ("", "")
    assert float(row["cached_matches_ms"]) >= 0


def test_a_folder_belongs_to_one_run(bands: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["run", str(bands), "--out", str(bands.parent / "out"), *SMALL]
    assert main(words) == 0
    assert main([*words, "--selection.sets", "50"]) == 2
    assert "selection.sets is 200 there and 50 here" in capsys.readouterr().err
    assert main([*words, "--selection.sets", "50", "--fresh"]) == 0
    saved = json.loads((bands.parent / "out" / "config.json").read_text(encoding="utf-8"))
    assert saved["settings"]["selection"]["sets"] == 50
    assert saved["made_with"]["numpy"] == np.__version__
    assert saved["timing"]["ms_per_frame"] > 0
    capsys.readouterr()
    assert main([*words, "--selection.sets", "50"]) == 0
    assert "finished before" in capsys.readouterr().out


def test_a_run_without_truth_has_no_errors(bands: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (bands / "poses.txt").unlink()
    out = bands.parent / "out"
    assert main(["run", str(bands), "--out", str(out), *SMALL]) == 0
    wanted = {"path": {"frames_in_doubt": 0, "time_jumps": 0, "lost": False, "doubts": []}}
    assert json.loads((out / "metrics.json").read_text(encoding="utf-8")) == wanted
    said = capsys.readouterr().out
    assert "no ground truth" in said
    assert "lost" not in said


def test_a_lost_path_is_said(bands: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for frame in (3, 4, 5):
        cv2.imwrite(str(bands / "image_1" / f"{frame:06d}.png"), np.zeros((HEIGHT, WIDTH), np.uint8))
    out = bands.parent / "out"
    assert main(["run", str(bands), "--out", str(out), "--vehicle.patience", "2", *SMALL]) == 0
    assert "The path was lost: 3 of 5 frames" in " ".join(capsys.readouterr().out.split())
    found = json.loads((out / "metrics.json").read_text(encoding="utf-8"))["path"]
    assert found == {"frames_in_doubt": 3, "time_jumps": 0, "lost": True, "doubts": []}


def read_log(out: Path) -> list[dict[str, str]]:
    text = (out / "frames.csv").read_text(encoding="utf-8")
    return list(csv.DictReader(io.StringIO(text)))


def test_a_run_without_matches_says_what_is_wrong_with_the_images(
    bands: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ["run", str(bands), "--features.cell", "10", "--out"]
    assert main([*arguments, str(bands.parent / "right")]) == 0
    assert "warning" not in capsys.readouterr().out
    (bands / "image_0").rename(bands / "left")
    (bands / "image_1").rename(bands / "image_0")
    (bands / "left").rename(bands / "image_1")
    assert main([*arguments, str(bands.parent / "swapped")]) == 0
    assert "warning: left and right are swapped" in capsys.readouterr().out


def test_list_names_what_is_found(
    bands: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    root = bands.parent / "root"
    shutil.copytree(bands, root / "sequences" / "07")
    monkeypatch.setenv("KITTI_ROOT", str(root))
    assert main(["list"]) == 0
    printed = capsys.readouterr().out
    assert all(name in printed for name in ("kitti/07", *(f"synthetic/{name}" for name in SCENES)))


def test_check_finds_this_installation_healthy(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("KITTI_ROOT", "")
    assert main(["check"]) == 0
    printed = capsys.readouterr().out
    assert f"cv2 {cv2.__version__}" in printed
    assert np.__version__ in printed
    assert "problem" not in printed


def test_two_opencv_packages_are_a_problem(monkeypatch: pytest.MonkeyPatch) -> None:
    import vo_lib.commands.environment as environment

    monkeypatch.setattr(environment, "installed_version", lambda name: "5.0")
    broken = [f for f in environment.check() if f.state == "problem"]
    assert [f.what for f in broken] == ["one OpenCV only"]
    assert "pip uninstall" in broken[0].remedy
    assert main(["check"]) == 1


@pytest.mark.parametrize("word", ["--help", "--help-settings"])
def test_the_short_help_leaves_thresholds_out_and_a_longer_one_has_them(
    capsys: pytest.CaptureFixture[str], word: str
) -> None:
    with pytest.raises(SystemExit) as stop:
        main(["run", word])
    assert stop.value.code == 0
    text = capsys.readouterr().out
    shown = [f"--{item.name} X" in text for item in settings.declared(Config)]
    assert all(shown) if word == "--help-settings" else not any(shown)
    assert word == "--help-settings" or len(text.splitlines()) < 60


def test_the_version_is_that_of_the_package(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["--version"])
    assert re.fullmatch(r"vo \d+\.\d+\.\d+\n", capsys.readouterr().out)


def test_a_shell_completes_commands_sequences_and_thresholds(tmp_path: Path) -> None:
    answer = tmp_path / "found"
    for line, expected in (
        ("vo re", "reproduce"),
        ("vo run synthetic/t", "synthetic/traffic"),
        ("vo run x --selection.se", "--selection.sets"),
        ("vo sweep --method vi", "viso2"),
    ):
        asked = {"_ARGCOMPLETE": "1", "COMP_LINE": line, "COMP_POINT": str(len(line)), "COMP_TYPE": "9"}
        asked |= {"_ARGCOMPLETE_STDOUT_FILENAME": str(answer), "IFS": "\n", "COMP_WORDBREAKS": " "}
        subprocess.run([sys.executable, "-m", "vo_lib"], env={**os.environ, **asked}, cwd=ROOT, check=True)
        assert answer.read_text(encoding="utf-8").split() == [expected]


def test_printed_commands_name_the_program_where_the_shell_would_not_find_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert typed("vo list") == "vo list"
    monkeypatch.setattr(sys, "argv", [str(tmp_path / "bin" / "vo"), "demo"])
    monkeypatch.setenv("PATH", str(tmp_path))
    assert typed("vo list") == f"{tmp_path / 'bin' / 'vo'} list"


def test_a_config_gives_the_same_run_again_and_options_go_before_it(bands: Path, tmp_path: Path) -> None:
    words = ["run", str(bands), "--method", "mesvo_f", "--variant", "published", "--features.blob_cell", "9"]
    assert main([*words, "--out", str(tmp_path / "a")]) == 0
    stored = ["run", str(bands), "--config", str(tmp_path / "a" / "config.json")]
    assert main([*stored, "--out", str(tmp_path / "b")]) == 0
    a, b = ((tmp_path / name / "poses.txt").read_bytes() for name in "ab")
    assert a == b
    assert main([*stored, "--seed", "3", "--out", str(tmp_path / "c")]) == 0
    saved = json.loads((tmp_path / "c" / "config.json").read_text(encoding="utf-8"))
    assert (saved["method"], saved["variant"], saved["settings"]["seed"]) == ("mesvo_f", "published", 3)
    assert saved["settings"]["features"]["blob_cell"] == 9
    # A table and a grid take it as well.
    config = ["--config", str(tmp_path / "a" / "config.json"), "--seeds", "1", "--cache", str(tmp_path / "c")]
    assert main(["reproduce", "--sequences", str(bands), *config, "--out", str(tmp_path / "d")]) == 0
    (run,) = (tmp_path / "d").rglob("seed_0/poses.txt")
    assert run.read_bytes() == a
    grid = ["--sequence", str(bands), "--set", "selection.sets=200", "--out", str(tmp_path / "e")]
    assert main(["sweep", *grid, *config]) == 0
    (run,) = (tmp_path / "e").rglob("seed0/poses.txt")
    assert run.read_bytes() == a


def test_the_model_of_drawn_streets_says_so_on_other_images(
    bands: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["run", str(bands), "--detector", "street", "--out", str(tmp_path / "a"), *SMALL]) == 0
    assert "`street` was trained on drawn streets" in capsys.readouterr().out
