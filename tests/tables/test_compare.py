"""Finished runs read back and put side by side."""

from __future__ import annotations

import dataclasses
import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import write_bands
from made_entries import straight

from vo_lib import preset, run
from vo_lib.commands.cli import main
from vo_lib.commands.compare import with_truth
from vo_lib.core.poses import read_kitti_poses, write_kitti_poses
from vo_lib.data.sequence import open_sequence
from vo_lib.evaluation.evaluate import evaluate
from vo_lib.evaluation.kitti import SHORT_LENGTHS
from vo_lib.runs.results import write_run
from vo_lib.tables.comparison import (
    StoredRun,
    common_kind,
    comparison_table,
    curve,
    distinct,
    read_stored_run,
    read_stored_runs,
)


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folders a, b (another method), c (another seed of a), part (other frames), else (other sequence)."""
    base = tmp_path_factory.mktemp("compare")
    sequence = open_sequence(write_bands(base / "kitti" / "sequences" / "07"))
    other = open_sequence(write_bands(base / "street"))
    jobs = {"a": (sequence, "viso2", 0), "b": (sequence, "mesvo_f", 0), "c": (sequence, "viso2", 1)}
    jobs |= {"part": (sequence.part(1, 5), "viso2", 0), "else": (other, "viso2", 0)}
    for name, (what, method, seed) in jobs.items():
        (base / name).mkdir()
        write_run(base / name, run(what, preset(method, seed=seed)), method)
    return base


def long_run(runs: Path, folder: Path, method: str, error: float, n: int, *kinds: str) -> Path:
    """A copy of a run folder with the errors of n frames a metre apart, the steps too long by `error`."""
    shutil.copytree(runs / "a", folder)
    pairs = [("drive", straight(n, 1.0), straight(n, 1.0 + error))]
    errors = {"kitti": evaluate(pairs), "short": evaluate(pairs, SHORT_LENGTHS, 1)}
    metrics = {kind: errors[kind].to_dict() for kind in kinds}
    (folder / "metrics.json").write_text(json.dumps(metrics), encoding="utf-8")
    change_config(folder, method=method, files={})
    return folder


def change_config(folder: Path, **changes: Any) -> None:
    config = json.loads((folder / "config.json").read_text(encoding="utf-8"))
    (folder / "config.json").write_text(json.dumps(config | changes), encoding="utf-8")


def read(*folders: Path) -> dict[str, list[StoredRun]]:
    return read_stored_runs(list(map(str, folders)))


def compare(out: Path, *folders: Path) -> int:
    return main(["compare", *map(str, folders), "--out", str(out)])


def test_a_folder_gives_back_what_was_written(runs: Path) -> None:
    stored = read_stored_run(runs / "b")
    assert (stored.method, stored.seed, stored.frames) == ("mesvo_f", 0, ("000000", "000005"))
    assert stored.poses.shape == (6, 4, 4)
    assert stored.ms_per_frame > 0
    assert set(stored.metrics) == {"kitti", "short"}


def test_labels_are_as_short_as_they_may_be(runs: Path) -> None:
    wanted = {"a b": ["viso2", "mesvo_f"], "a c": ["viso2, seed 0", "viso2, seed 1"]}
    wanted["a a"] = [f"viso2, {runs / 'a'}"] * 2
    for folders, labels in wanted.items():
        (pair,) = read(*(runs / name for name in folders.split())).values()
        assert [one.label for one in pair] == labels
    both = [dataclasses.replace(read_stored_run(runs / "a"), variant=each) for each in ("kit", "published")]
    assert [one.label for one in distinct(both)] == ["viso2", "viso2, published"]


def test_runs_over_different_sequences_or_frames_are_kept_apart(runs: Path) -> None:
    groups = read(*(runs / name for name in ("a", "else", "part", "b")))
    assert [len(group) for group in groups.values()] == [2, 1, 1]
    assert list(groups) == ["07, frames 000000-000005", "street", "07, frames 000001-000004"]


def test_the_command_prints_and_draws_them_together(
    runs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert compare(tmp_path / "out", runs / "a", runs / "b", runs / "else") == 0
    printed = capsys.readouterr().out
    assert all(word in printed for word in ("viso2", "mesvo_f", "street", "ATE"))
    # No sub-sequence fits, but there is truth.
    (row,) = (line for line in printed.splitlines() if "mesvo_f" in line)
    te, re, *others = (cell.strip() for cell in row.split("│")[2:-1])
    assert te == re == "–"
    assert 0 <= float(others[0]) < 0.05  # ATE in m
    assert all(float(cell) >= 0 for cell in others)
    drawn = sorted(p.name for p in (tmp_path / "out").glob("[!.]*"))
    # 2.5 m hold no sub-sequence, so there are no curves.
    assert drawn == [f"trajectory_{name}.{kind}" for name in ("07", "street") for kind in ("pdf", "png")]


def test_errors_are_compared_over_the_sub_sequences_that_all_runs_have(runs: Path, tmp_path: Path) -> None:
    first = long_run(runs, tmp_path / "x", "viso2", 0.01, 301, "kitti", "short")
    second = long_run(runs, tmp_path / "y", "mesvo_f", 0.02, 301, "kitti", "short")
    (pair,) = read(first, second).values()
    assert common_kind(pair) == "kitti"
    table = comparison_table("drive", pair)
    assert [float(row[1]) for row in table.rows] == pytest.approx([1.0, 2.0], rel=0.011)
    assert "se3" in table.notes[0]
    third = long_run(runs, tmp_path / "z", "feature_selection", 0.03, 301, "short")
    (three,) = read(first, second, third).values()
    assert common_kind(three) == "short"
    points = curve(three[2], "short", "length")
    assert [at for at, _, _ in points] == [20.0, 50.0, 100.0]
    assert points[2][1] == pytest.approx(3.0, rel=0.02)
    # 36 km/h, a little less by the frame that the benchmark counts on top; bins overlap.
    assert [at for at, _, _ in curve(pair[0], "kitti", "speed")] == pytest.approx([28.8, 36.0])
    assert compare(tmp_path / "out", first, second, third) == 0
    # Driven at one speed, there is no curve over it.
    drawn = {p.name for p in (tmp_path / "out").glob("errors_*")}
    assert drawn == {f"errors_07_by_length.{kind}" for kind in ("pdf", "png")}


def test_a_path_of_little_more_than_100_m_is_compared_over_shorter_ones(runs: Path, tmp_path: Path) -> None:
    stored = read_stored_run(long_run(runs, tmp_path / "x", "viso2", 0.01, 131, "kitti", "short"))
    assert stored.metrics["kitti"]["pooled"]["subsequences"] == 3
    assert common_kind([stored]) == "short"


def test_another_systems_poses_stand_beside_the_runs(
    runs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("KITTI_ROOT", str(runs / "kitti"))
    shutil.copytree(runs / "a", tmp_path / "a")
    change_config(tmp_path / "a", sequence="kitti/07")
    poses = read_kitti_poses(runs / "kitti" / "sequences" / "07" / "poses.txt")
    poses[:, 0, 3] = 7.0 + 1.1 * poses[:, 0, 3]
    write_kitti_poses(tmp_path / "theirs.txt", poses)
    assert compare(tmp_path / "out", tmp_path / "a", tmp_path / "theirs.txt") == 0
    (row,) = (line for line in capsys.readouterr().out.splitlines() if "theirs" in line)
    *_, rpe, _, ms = (cell.strip() for cell in row.split("│")[1:-1])
    assert float(rpe) == pytest.approx(0.05)  # a tenth of the steps of 0.5 m
    assert ms == "–"
    write_kitti_poses(tmp_path / "theirs.txt", poses[:-1])
    assert compare(tmp_path / "out", tmp_path / "a", tmp_path / "theirs.txt") == 2
    assert "theirs.txt: has 5 rows; the runs have 6 frames" in capsys.readouterr().err


def test_without_truth_there_are_no_errors_but_a_picture(
    runs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copytree(runs / "a", tmp_path / "a")
    (tmp_path / "a" / "metrics.json").unlink()
    assert compare(tmp_path / "out", tmp_path / "a", runs / "b") == 0
    assert "No ground truth" in capsys.readouterr().out
    assert (tmp_path / "out" / "trajectory_07.png").exists()


def test_the_truth_is_found_by_the_sequences_name(runs: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("KITTI_ROOT", str(runs / "kitti"))
    part = dataclasses.replace(read_stored_run(runs / "part"), sequence="kitti/07")
    found = with_truth(part, None)
    truth = None if found is None else found.truth
    assert truth is not None
    np.testing.assert_allclose(truth[:, 0, 3], [0.5, 1.0, 1.5, 2.0])
    assert with_truth(dataclasses.replace(part, sequence="kitti/08"), None) is None
    assert with_truth(dataclasses.replace(part, frames=("000001", "000099")), None) is None
    assert with_truth(dataclasses.replace(part, sequence="synthetic/jam"), runs / "empty") is None


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("metrics.json", '{"kitti": {"sequences": []}}'),
        ("config.json", "[]"),
        ("config.json", '{"settings": {}, "method": "viso2", "sequence": "07", "frames": ["0", "5"]}'),
        ("poses.txt", "1 2 3"),
    ],
)
def test_a_broken_folder_gives_one_line_that_names_the_file(
    runs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str, text: str
) -> None:
    folder = tmp_path / "broken"
    shutil.copytree(runs / "a", folder)
    (folder / name).write_text(text, encoding="utf-8")
    assert compare(tmp_path / "out", runs / "b", folder) == 2
    error = capsys.readouterr().err
    assert str(folder / name) in error
    assert len(error.splitlines()) == 1
    assert not (tmp_path / "out").exists()
