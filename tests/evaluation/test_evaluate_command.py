"""`vo evaluate`: several systems, what it writes and draws, and EuRoC's files."""

from __future__ import annotations

import csv
import json
import re
from pathlib import Path

import numpy as np
import pytest
from conftest import winding_road

from vo_lib.commands.cli import main
from vo_lib.core.errors import DataError
from vo_lib.core.geometry import quaternion_from_rotation, rigid, rotation_from_vector
from vo_lib.core.poses import read_euroc, write_kitti_poses, write_tum
from vo_lib.core.types import Array

SHORT = ["--lengths", "20,50", "--step", "1"]


def scaled(poses: Array, factor: float) -> Array:
    found = poses.copy()
    found[:, :3, 3] *= factor
    return found


@pytest.fixture
def files(tmp_path: Path) -> Path:
    """Truths of 07 and 09, and estimates of `ours` (2 % too long) and `theirs` (5 %)."""
    for name, turn in (("07", 0.03), ("09", 0.05)):
        truth = winding_road(150, turn, 1.07)
        for folder, factor in (("truth", 1.0), ("ours", 1.02), ("theirs", 1.05)):
            (tmp_path / folder).mkdir(exist_ok=True)
            write_kitti_poses(tmp_path / folder / f"{name}.txt", scaled(truth, factor))
    return tmp_path


def words(base: Path, truth: list[str], estimates: list[str]) -> list[str]:
    both = ["--truth", *(str(base / name) for name in truth)]
    return ["evaluate", *both, "--estimate", *(str(base / name) for name in estimates), *SHORT]


def test_systems_stand_side_by_side_in_json_csv_and_tables(
    files: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    estimates = ["ours/07.txt", "ours/09.txt", "theirs/07.txt", "theirs/09.txt"]
    command = words(files, ["truth/07.txt", "truth/09.txt"], estimates)
    assert main([*command, "--out", str(files / "out")]) == 0
    printed = capsys.readouterr().out
    assert "ours 07" in printed
    assert "theirs pooled" in printed
    assert re.search(r"│ ours 07 ATE m +│( +\d\.\d{4} │){4}", printed)  # rmse, mean, median, max
    assert re.search(r"│ ours 07 +│ +150 │ +\d+ │ +\d\.\d{3} / \d\.\d{3} │", printed)
    data = json.loads((files / "out" / "evaluation.json").read_text(encoding="utf-8"))
    assert [system["system"] for system in data["systems"]] == ["ours", "theirs"]
    # A sub-sequence ends up to a step past its length.
    for system, percent in zip(data["systems"], (2.0, 5.0), strict=True):
        assert [s["name"] for s in system["sequences"]] == ["07", "09"]
        assert system["pooled"]["te_percent"] == pytest.approx(percent, rel=0.05)
    rows = list(csv.DictReader((files / "out" / "evaluation.csv").read_text(encoding="utf-8").splitlines()))
    assert len(rows) == 2 * 3 * 3
    last = rows[-1]
    assert [last[key] for key in ("system", "sequence", "length_m")] == ["theirs", "pooled", "50"]
    in_json = data["systems"][1]["pooled"]["by_length"][1]["te_percent"]
    assert float(last["te_percent"]) == pytest.approx(in_json, abs=1e-6)


@pytest.mark.parametrize(
    ("estimates", "labels"),
    [
        (("ours/07.txt", "theirs/07.txt"), ["ours", "theirs"]),
        (("a/ours/seed_0/poses.txt", "a/theirs/seed_0/poses.txt"), ["ours", "theirs"]),
        (("orb.txt", "ours/poses.txt"), ["orb", "ours"]),
    ],
)
def test_systems_are_called_by_what_tells_their_files_apart(
    files: Path, capsys: pytest.CaptureFixture[str], estimates: tuple[str, ...], labels: list[str]
) -> None:
    for estimate in estimates:
        (files / estimate).parent.mkdir(parents=True, exist_ok=True)
        write_kitti_poses(files / estimate, winding_road(150, 0.03, 1.07))
    assert main([*words(files, ["truth/07.txt"], [*estimates]), "--json"]) == 0
    assert [system["system"] for system in json.loads(capsys.readouterr().out)["systems"]] == labels


def test_a_truth_that_stands_there_twice_is_two_sequences(
    files: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command = words(files, ["truth/07.txt", "truth/07.txt"], ["ours/07.txt", "theirs/07.txt"])
    assert main([*command, "--json"]) == 0
    data = json.loads(capsys.readouterr().out)
    assert len({sequence["name"] for sequence in data["sequences"]}) == 2


def test_pictures_of_paths_and_errors_are_drawn_and_the_same_each_time(files: Path) -> None:
    command = words(files, ["truth/07.txt"], ["ours/07.txt", "theirs/07.txt"])
    for folder in ("a", "b"):
        assert main([*command, "--plot", str(files / folder)]) == 0
    drawn = {path.name for path in (files / "a").glob("[!.]*")}
    # The road is driven at one speed: no curve over it.
    kinds = ("trajectory_07", "coloured_07", "components_07", "errors_07_by_length")
    assert drawn == {f"{kind}.{end}" for kind in kinds for end in ("png", "pdf")}
    assert all((files / "a" / name).read_bytes() == (files / "b" / name).read_bytes() for name in drawn)


def test_a_path_that_is_too_short_is_said_with_what_to_try(
    files: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    truth = winding_road(30, 0.03, 1.0)
    write_kitti_poses(files / "short.txt", truth)
    command = ["evaluate", "--truth", str(files / "short.txt"), "--estimate", str(files / "short.txt")]
    assert main([*command, "--plot", str(files / "plot")]) == 0
    assert "no path holds a sub-sequence of 100 m: try --lengths 20,50,100" in capsys.readouterr().out
    kinds = ("trajectory_short", "coloured_short", "components_short")
    drawn = {path.name for path in (files / "plot").glob("[!.]*")}
    assert drawn == {f"{kind}.{end}" for kind in kinds for end in ("png", "pdf")}


def write_euroc(path: Path, times: Array, poses: Array) -> None:
    """EuRoC's truth: nanoseconds, position, quaternion with w first, speed and biases."""
    rows = ["#timestamp, p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], q_RS_x [], …"]
    for t, T in zip(times, poses, strict=True):
        x, y, z, w = quaternion_from_rotation(T[:3, :3])
        numbers = [*T[:3, 3], w, x, y, z, *np.zeros(9)]
        rows.append(",".join([f"{round(1e9 * t)}", *map(repr, map(float, numbers))]))
    path.write_text("\n".join(rows) + "\n", encoding="utf-8")


def test_euroc_truth_is_met_by_tum_and_euroc_estimates_at_the_times_all_have(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    world = rigid(rotation_from_vector(np.array([0.3, -1.0, 2.0])), np.array([4.0, -2.0, 1.0]))
    truth = world @ winding_road(150, 0.03, 1.07)
    times = np.linspace(1403636579.75, 1403636579.75 + 0.05 * len(truth), len(truth))
    write_euroc(tmp_path / "data.csv", times, truth)
    found_times, found = read_euroc(tmp_path / "data.csv")
    np.testing.assert_allclose(found_times, times, atol=1e-6)
    np.testing.assert_allclose(found, truth, atol=1e-12)
    write_tum(tmp_path / "tum.txt", times[::2] + 0.002, truth[::2])
    write_euroc(tmp_path / "other.csv", times[20:], scaled(truth, 1.1)[20:])
    command = words(tmp_path, ["data.csv"], ["tum.txt", "other.csv"])
    assert main([*command, "--format", "euroc", "--json"]) == 0
    tum, other = (s["sequences"][0] for s in json.loads(capsys.readouterr().out)["systems"])
    assert tum["frames"] == other["frames"] == 65
    assert tum["te_percent"] == pytest.approx(0.0, abs=1e-5)
    assert other["te_percent"] == pytest.approx(10.0, rel=0.1)
    (tmp_path / "bad.csv").write_text("#head\n1,2,3,4\n", encoding="utf-8")
    with pytest.raises(DataError, match=r"bad\.csv, line 2: 4 columns; expected 8 numbers or more"):
        read_euroc(tmp_path / "bad.csv")


@pytest.mark.parametrize("name", ["a$b_{", "[bold]x[x]", "日本", "no utf-8 \udcff", "x" * 240])
def test_any_name_stands_in_tables_files_and_pictures(
    files: Path, capsys: pytest.CaptureFixture[str], name: str
) -> None:
    for folder in ("truth", "ours"):
        (files / folder / "07.txt").rename(files / folder / f"{name}.txt")
    command = words(files, [f"truth/{name}.txt"], [f"ours/{name}.txt", "theirs/07.txt"])
    code = main([*command, "--out", str(files / "out"), "--plot", str(files / "plots")])
    said = capsys.readouterr()
    if len(name) > 200:  # a picture's file is named after it
        assert code == 2
        assert "File name too long" in said.err
        return
    assert code == 0
    assert "arning" not in said.err
    assert "".join(name.encode("utf-8", "replace").decode().split()) in "".join(said.out.split())
    assert json.loads((files / "out" / "evaluation.json").read_text())["systems"][0]["system"] == name
    assert len(list((files / "plots").glob("*.png"))) == 4
