"""The command as a person uses it: files written, tables printed, one line and exit code 2 for bad input."""

from __future__ import annotations

import csv
import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

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

FILES = {"calibration.json", "config.json", "frames.csv", "metrics.json", "poses.txt", "poses_tum.txt"}
SMALL = ["--features.cell", "10"]
ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture
def done(bands: Path, capsys: pytest.CaptureFixture[str]) -> Callable[..., str]:
    """A function that runs `vo run` on the bands, to its end, and gives what it printed."""

    def run(out: str, *words: str, code: int = 0) -> str:
        assert main(["run", str(bands), "--out", str(bands.parent / out), *SMALL, *words]) == code
        return "".join(capsys.readouterr())

    return run


def read_log(out: Path) -> list[dict[str, str]]:
    with open(out / "frames.csv", encoding="utf-8", newline="") as lines:
        return list(csv.DictReader(lines))


def read_json(path: Path) -> Any:
    return json.loads(path.read_text(encoding="utf-8"))


def test_a_run_writes_its_files(bands: Path, done: Callable[..., str]) -> None:
    printed, out = done("new/out", "--method", "mesvo_f"), bands.parent / "new" / "out"
    assert {path.name for path in out.glob("[!.]*")} == FILES | {"trajectory.png"}
    poses = read_kitti_poses(out / "poses.txt")
    assert poses.shape == (6, 4, 4)
    times, tum = read_tum(out / "poses_tum.txt")
    np.testing.assert_allclose(tum, poses, atol=1e-7)
    assert times[1] == pytest.approx(0.1)
    rows = read_log(out)
    assert [row["frame"] for row in rows] == [f"{i:06d}" for i in range(1, 6)]
    assert all(float(row["matching_ms"]) > 0 and int(row["inliers"]) > 20 for row in rows)
    config = settings.from_dict(Config, read_json(out / "config.json")["settings"])
    assert config.features.cell == 10
    assert not config.selection.prior
    image = cv2.imread(str(out / "trajectory.png"))
    assert image is not None
    assert image.std() > 5
    assert "matches a frame" in printed
    assert "ATE, aligned" in printed  # though the path is too short for TE
    assert str(out) in printed
    said = read_calibration(out / "calibration.json").in_words(config.calibration)
    assert f"errors of the calibration {said}" in re.sub(r"[│\s]+", " ", printed)


def test_part_of_a_sequence_with_labels_from_elsewhere(bands: Path, done: Callable[..., str]) -> None:
    labels = bands.parent / "boxes"
    labels.mkdir()
    (labels / "000002.txt").write_text("2 0.5 0.5 0.4 0.4 0.9\n", encoding="utf-8")
    done("out", "--frames", "1:4", "--labels", str(labels), "--filter.min_matches", "5")
    rows = read_log(bands.parent / "out")
    assert [row["frame"] for row in rows] == ["000002", "000003"]
    assert int(rows[0]["removed_by_boxes"]) > 0


def test_matches_are_kept_where_it_is_asked_and_used_again(
    bands: Path, done: Callable[..., str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("vo_lib.runs.match_cache.cache_folder", lambda: bands.parent / "user" / "synthetic")
    for name, cache in (("filled", []), ("used", []), ("elsewhere", [str(bands.parent / "mine")])):
        done(name, "--cache", *cache)
    kept = {p.relative_to(bands.parent).parts[:2] for p in bands.parent.rglob("*.npz")}
    assert kept == {("user", "matches"), ("mine", "matches")}
    row = read_log(bands.parent / "used")[0]
    assert (row["matching_ms"], row["wait_images_ms"]) == ("", "")
    assert float(row["cached_matches_ms"]) >= 0


def test_a_folder_belongs_to_one_run(bands: Path, done: Callable[..., str]) -> None:
    done("out")
    other = ("--selection.sets", "50")
    assert "selection.sets is 200 there and 50 here" in done("out", *other, code=2)
    done("out", *other, "--fresh")
    assert read_json(bands.parent / "out" / "config.json")["settings"]["selection"]["sets"] == 50
    assert "finished before" in done("out", *other)


def test_a_run_without_truth_has_no_errors(bands: Path, done: Callable[..., str]) -> None:
    (bands / "poses.txt").unlink()
    said = done("out")
    wanted = {"path": {"frames_in_doubt": 0, "time_jumps": 0, "lost": False, "doubts": []}}
    assert read_json(bands.parent / "out" / "metrics.json") == wanted
    assert "no ground truth" in said
    assert "lost" not in said


def test_a_lost_path_is_said(bands: Path, done: Callable[..., str]) -> None:
    for frame in (3, 4, 5):
        cv2.imwrite(str(bands / "image_1" / f"{frame:06d}.png"), np.zeros((HEIGHT, WIDTH), np.uint8))
    said = done("out", "--vehicle.patience", "2")
    assert "The path was lost: 3 of 5 frames" in " ".join(said.split())
    found = read_json(bands.parent / "out" / "metrics.json")["path"]
    assert found == {"frames_in_doubt": 3, "time_jumps": 0, "lost": True, "doubts": []}


def test_a_run_without_matches_says_what_is_wrong_with_the_images(
    bands: Path, done: Callable[..., str]
) -> None:
    assert "warning" not in done("right")
    (bands / "image_0").rename(bands / "left")
    (bands / "image_1").rename(bands / "image_0")
    (bands / "left").rename(bands / "image_1")
    assert "warning: left and right are swapped" in done("swapped")


def test_the_model_of_drawn_streets_says_so_on_other_images(done: Callable[..., str]) -> None:
    assert "`street` was trained on drawn streets" in done("out", "--detector", "street")


def test_list_names_what_is_found(
    bands: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    root = bands.parent / "root"
    shutil.copytree(bands, root / "sequences" / "07")
    monkeypatch.setenv("KITTI_ROOT", str(root))
    assert main(["list"]) == 0
    printed = capsys.readouterr().out
    assert all(name in printed for name in ("kitti/07", *(f"synthetic/{name}" for name in SCENES)))


def test_check_finds_this_installation_healthy_and_two_opencv_packages_a_problem(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("KITTI_ROOT", "")
    assert main(["check"]) == 0
    printed = capsys.readouterr().out
    assert f"cv2 {cv2.__version__}" in printed
    assert np.__version__ in printed
    assert "problem" not in printed
    monkeypatch.setattr("vo_lib.commands.environment.installed_version", lambda name: "5.0")
    assert main(["check"]) == 1
    assert "pip uninstall -y opencv-python" in capsys.readouterr().out


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
    saved = read_json(tmp_path / "c" / "config.json")
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
