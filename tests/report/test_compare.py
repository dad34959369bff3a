"""`vo evaluate`: runs and pose files of other systems, with and without truth."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import winding_road, write_bands
from made_entries import straight

from vo_lib import preset, run
from vo_lib.commands.cli import main
from vo_lib.data.catalogue import open_sequence
from vo_lib.data.poses import format_tum, read_kitti_poses, write_kitti_poses
from vo_lib.evaluation.ate_rpe import Alignment
from vo_lib.evaluation.kitti_errors import kitti_errors
from vo_lib.geometry.motion import rigid, rotation_from_vector
from vo_lib.geometry.types import Array
from vo_lib.runs.folder import write_run
from vo_lib.runs.identity import run_identity

TURNED = rigid(rotation_from_vector(np.array([0.3, -1.0, 2.0])), np.array([4.0, -2.0, 1.0]))
Capture = pytest.CaptureFixture[str]


def scaled(poses: Array, factor: float) -> Array:
    """The path with all steps multiplied by a factor."""
    longer = poses.copy()
    longer[:, :3, 3] *= factor
    return longer


def evaluated(capsys: Capture, *words: Path | str) -> dict[str, Any]:
    """The JSON of `vo evaluate`."""
    capsys.readouterr()
    assert main(["evaluate", *map(str, words), "--json"]) == 0
    result: dict[str, Any] = json.loads(capsys.readouterr().out)
    return result


def printed(capsys: Capture, *words: Path | str) -> str:
    """What `vo evaluate` prints, with single blanks."""
    capsys.readouterr()
    assert main(["evaluate", *map(str, words)]) == 0
    return " ".join(capsys.readouterr().out.split())


def refused(capsys: Capture, *words: Path | str) -> str:
    """The message of a refused `vo evaluate`."""
    capsys.readouterr()
    assert main(["evaluate", *map(str, words)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    return line


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Run folders: two methods, a part of the frames, another sequence, and one without truth."""
    base = tmp_path_factory.mktemp("runs")
    sequence, other, bare = (open_sequence(write_bands(base / name)) for name in ("bands", "street", "bare"))
    (base / "bare" / "poses.txt").unlink()
    bare = open_sequence(base / "bare")
    jobs = {"a": (sequence, "viso2"), "b": (sequence, "mesvo_f"), "part": (sequence.part(1, 5), "viso2")}
    jobs |= {"else": (other, "viso2"), "untrue": (bare, "viso2"), "untrue_b": (bare, "mesvo_f")}
    for name, (data, method) in jobs.items():
        (base / name).mkdir()
        config = preset(method)
        write_run(base / name, run(data, config), run_identity(data, config, method))
    return base


def test_runs_and_files_are_compared_at_common_frames(runs: Path, tmp_path: Path, capsys: Capture) -> None:
    shutil.copytree(runs / "a", tmp_path / "a")
    truth = read_kitti_poses(runs / "bands" / "poses.txt")
    write_kitti_poses(tmp_path / "a" / "poses.txt", scaled(truth, 1.1))
    write_kitti_poses(tmp_path / "orb.txt", TURNED @ scaled(truth, 1.2))
    np.save(tmp_path / "orb.npy", scaled(truth, 1.25))
    (tmp_path / "timed.txt").write_text(format_tum(np.arange(0.102, 0.6, 0.1), scaled(truth, 1.3)[1:]))
    sources = [tmp_path / name for name in ("a", "orb.txt", "orb.npy", "timed.txt")]
    result = evaluated(capsys, *sources)
    assert result["frames"] == 5
    assert result["notes"] == [f"truth: {runs / 'bands' / 'poses.txt'}", "Compared: 5 of 6 poses of bands."]
    assert [each["name"] for each in result["systems"]] == [str(source) for source in sources]
    for each, percent in zip(result["systems"], (10, 20, 25, 30), strict=True):
        assert each["rpe"]["translation"]["rmse_m"] == pytest.approx(0.5 * percent / 100)
    # A run of a part has its own times, and so the frames that both have.
    assert evaluated(capsys, runs / "a", runs / "part")["frames"] == 4


def test_the_truth_may_be_a_file(runs: Path, tmp_path: Path, capsys: Capture) -> None:
    expected = evaluated(capsys, runs / "a")["systems"][0]["ate"]["rmse_m"]
    truth = read_kitti_poses(runs / "bands" / "poses.txt")
    write_kitti_poses(tmp_path / "kitti.txt", truth)
    (tmp_path / "tum.txt").write_text(format_tum(np.arange(0.0, 0.6, 0.1), truth))
    np.save(tmp_path / "array.npy", truth)
    for name in ("kitti.txt", "tum.txt", "array.npy"):
        result = evaluated(capsys, runs / "a", "--truth", tmp_path / name)
        assert result["systems"][0]["ate"]["rmse_m"] == pytest.approx(expected, abs=1e-6)
        assert result["frames"] == 6


def test_paths_that_do_not_correspond_are_refused(runs: Path, tmp_path: Path, capsys: Capture) -> None:
    truth = straight(150)
    write_kitti_poses(tmp_path / "truth.txt", truth)
    write_kitti_poses(tmp_path / "tenth.txt", truth[::10])
    times = np.linspace(0.0, 14.9, 150)
    (tmp_path / "timed.txt").write_text(format_tum(times, truth))
    (tmp_path / "ns.txt").write_text(format_tum(1e9 * times, truth))
    (tmp_path / "later.txt").write_text(format_tum(times + 100.0, truth))
    (tmp_path / "few.txt").write_text(format_tum(times + 11.4, truth))
    for path, given, words in (
        (
            "tenth.txt",
            "truth.txt",
            "has 15 poses, and truth has 150: without times, both need a pose for every",
        ),
        (
            "ns.txt",
            "timed.txt",
            "0 to 14900000000 s and 0 to 14.9 s; expected seconds of one clock",
        ),
        ("later.txt", "timed.txt", "only 0 times of"),
        ("few.txt", "timed.txt", "only 36 times of"),
        ("ns.txt", "ns.txt", "the median interval of the times is 1e+08 s: expected 0.001 to 10 s"),
    ):
        assert words in refused(capsys, tmp_path / path, "--truth", tmp_path / given)
    assert "the runs are of several sequences (bands, street)" in refused(capsys, runs / "a", runs / "else")
    assert "is not the folder of a finished run" in refused(capsys, runs)
    assert "the file is missing" in refused(capsys, tmp_path / "none.txt")


def test_a_quarter_of_equal_times_is_enough(tmp_path: Path, capsys: Capture) -> None:
    truth, times = straight(100), np.linspace(0.0, 9.9, 100)
    (tmp_path / "truth.txt").write_text(format_tum(times, truth))
    for equal, is_enough in ((25, True), (24, False)):
        shifted = np.where(np.arange(100) < equal, times, times + 0.05)
        (tmp_path / "path.txt").write_text(format_tum(shifted, truth))
        words = ["evaluate", str(tmp_path / "path.txt"), "--truth", str(tmp_path / "truth.txt")]
        assert main(words) == (0 if is_enough else 2)


def test_a_path_in_another_unit_or_other_axes_is_warned_of(tmp_path: Path, capsys: Capture) -> None:
    truth = winding_road(300, 0.03, 1.07)
    robot = truth @ np.array([[0, -1, 0, 0], [0, 0, -1, 0], [1, 0, 0, 0], [0, 0, 0, 1]])
    paths = {"truth": truth, "good": scaled(truth, 1.02), "mm": scaled(truth, 1000.0), "robot": robot}
    for name, poses in paths.items():
        write_kitti_poses(tmp_path / f"{name}.txt", poses)
    words = [tmp_path / f"{name}.txt" for name in ("good", "mm", "robot")]
    text = printed(capsys, *words, "--truth", tmp_path / "truth.txt")
    assert "mm.txt is 1e+03 times as long as the truth: other frames, another unit, or no scale" in text
    assert "robot.txt does not move along its own +z axis as the truth does" in text
    assert "good.txt is" not in text
    assert "mm.txt is 980 times as long as the first path" in printed(capsys, *words)


def test_evaluate_writes_the_same_bytes(tmp_path: Path, capsys: Capture) -> None:
    truth = winding_road(300, 0.03, 1.07)
    for name, factor in (("07", 1.0), ("ours", 1.02), ("theirs", 1.05)):
        write_kitti_poses(tmp_path / f"{name}.txt", scaled(truth, factor))
    words: list[Path | str] = [tmp_path / "ours.txt", tmp_path / "theirs.txt"]
    words += ["--truth", tmp_path / "07.txt"]
    for folder in ("one", "two"):
        text = printed(capsys, *words, "--out", tmp_path / folder)
    assert "Not comparable with the benchmark" not in text
    # The speed is constant, so there is no curve over speed.
    names = {path.name for path in (tmp_path / "one").iterdir()}
    assert names == {"trajectory_07.png", "errors_07_by_length.png", "evaluation.json"}
    for path in (tmp_path / "one").iterdir():
        assert path.read_bytes() == (tmp_path / "two" / path.name).read_bytes()
    # A sub-sequence is up to one step longer than its length.
    errors = evaluated(capsys, *words)["systems"]
    assert [each["te_percent"] for each in errors] == pytest.approx([2.0, 5.0], rel=0.02)
    for length in (100, 200):
        part = kitti_errors(truth, scaled(truth, 1.02), (length,))
        assert f"{part.te:.3f} / {part.re:.3f}" in text
    for alignment in Alignment:
        options = ["--alignment", alignment.value, "--lengths", "20", "--step", "7", "--delta", "3.2m"]
        result = evaluated(capsys, *words, *options)["systems"][0]
        assert result["ate"]["alignment"] == alignment.value
        assert [each["length_m"] for each in result["by_length"]] == [20.0]
        assert result["rpe"]["delta_m"] == 3.2


def test_without_truth_lengths_ends_and_distances_are_told(
    runs: Path, tmp_path: Path, capsys: Capture
) -> None:
    folders = [runs / "untrue", runs / "untrue_b"]
    text = printed(capsys, *folders, "--out", tmp_path / "out")
    assert "has none for the frames of the run" in text
    assert "For errors, give its ground truth with --truth FILE." in text
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"trajectory_bare.png", "evaluation.json"}
    result = evaluated(capsys, *folders)
    assert result["ground_truth"] is False
    assert result["systems"] == []
    assert [each["length_m"] for each in result["paths"]] == pytest.approx([2.5, 2.5], abs=0.1)
    assert result["paths"][0]["end_m"] == pytest.approx([2.5, 0, 0], abs=0.1)
    assert result["differences"][0]["rmse_m"] < 0.05
    assert "--step: no effect without ground truth" in refused(capsys, runs / "untrue", "--step", "5")
    truth = runs / "bands" / "poses.txt"
    assert evaluated(capsys, *folders, "--truth", truth)["ground_truth"] is True


@pytest.mark.parametrize("gone", ["/gone", None])
def test_a_sequence_that_is_gone_has_no_truth(
    runs: Path, tmp_path: Path, capsys: Capture, gone: str | None
) -> None:
    shutil.copytree(runs / "a", tmp_path / "a")
    config = json.loads((tmp_path / "a" / "config.json").read_text(encoding="utf-8"))
    (tmp_path / "a" / "config.json").write_text(json.dumps(config | {"folder": gone}), encoding="utf-8")
    assert f"No ground truth: the sequence of the run is no longer at {gone}" in printed(
        capsys, tmp_path / "a"
    )


@pytest.mark.parametrize("name", ["evaluation.json", "trajectory_bands.png"])
def test_files_of_somebody_else_are_kept(runs: Path, tmp_path: Path, capsys: Capture, name: str) -> None:
    (tmp_path / name).write_text("mine")
    assert f"{name}: is not the kit's file" in refused(capsys, runs / "a", "--out", tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == [name]
    assert (tmp_path / name).read_text() == "mine"


def test_evaluate_warns_of_poses_that_changed_since_the_run(
    runs: Path, tmp_path: Path, capsys: Capture
) -> None:
    shutil.copytree(runs / "a", tmp_path / "a")
    write_kitti_poses(tmp_path / "a" / "poses.txt", straight(6, 0.4))
    capsys.readouterr()
    assert main(["evaluate", str(tmp_path / "a")]) == 0
    assert "poses.txt was missing or changed" in " ".join(capsys.readouterr().err.split())
