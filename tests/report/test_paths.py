"""`vo evaluate`: runs, pose files of other systems, and truth files."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import winding_road, write_bands, write_euroc_truth
from made_entries import straight

from vo_lib import preset, run
from vo_lib.commands.cli import main
from vo_lib.config import change
from vo_lib.data.catalogue import open_sequence
from vo_lib.data.poses import format_tum, read_euroc, read_kitti_poses, write_kitti_poses
from vo_lib.evaluation.ate_rpe import Alignment
from vo_lib.evaluation.kitti_errors import kitti_errors, trajectory_distances
from vo_lib.geometry.motion import rigid, rotation_from_vector
from vo_lib.geometry.types import Array
from vo_lib.runs.folder import write_run
from vo_lib.runs.identity import run_identity

TURNED = rigid(rotation_from_vector(np.array([0.3, -1.0, 2.0])), np.array([4.0, -2.0, 1.0]))


def scaled(poses: Array, factor: float) -> Array:
    """The path with all steps multiplied by a factor."""
    longer = poses.copy()
    longer[:, :3, 3] *= factor
    return longer


def numbers(capsys: pytest.CaptureFixture[str], *words: Path | str) -> dict[str, dict[str, Any]]:
    """Errors by system, from the JSON of `vo evaluate` on one sequence."""
    capsys.readouterr()
    assert main(["evaluate", *map(str, words), "--json"]) == 0
    (sequence,) = json.loads(capsys.readouterr().out)["sequences"]
    return {each["name"]: each for each in sequence["systems"]}


def json_of(capsys: pytest.CaptureFixture[str], *words: Path | str) -> str:
    """The JSON of `vo evaluate`."""
    capsys.readouterr()
    assert main(["evaluate", *map(str, words), "--json"]) == 0
    return capsys.readouterr().out


def refused(capsys: pytest.CaptureFixture[str], *words: Path | str) -> str:
    """The error text of a refused `vo evaluate`."""
    assert main(["evaluate", *map(str, words)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    return line


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Run folders: a reference, and runs with a different method, seed, part of the frames, or sequence."""
    base = tmp_path_factory.mktemp("runs")
    sequence, other = (open_sequence(write_bands(base / name)) for name in ("bands", "street"))
    jobs = {"a": (sequence, "viso2", 0), "b": (sequence, "mesvo_f", 0), "c": (sequence, "viso2", 1)}
    jobs |= {"sets": (sequence, "mesvo_f", 0)}
    jobs |= {"part": (sequence.part(1, 5), "viso2", 0), "else": (other, "viso2", 0)}
    for name, (data, method, seed) in jobs.items():
        config = change(preset(method, seed=seed), "selection.sets", 20 if name == "sets" else 200)
        (base / name).mkdir()
        write_run(base / name, run(data, config), run_identity(data, config, method))
    return base


def test_a_truth_that_stands_still_gets_no_advice_on_lengths(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    still = np.tile(np.eye(4), (6, 1, 1))
    moving = still.copy()
    moving[:, 2, 3] = np.arange(6.0)
    for name, poses in (("still.txt", still), ("moving.txt", moving)):
        write_kitti_poses(tmp_path / name, poses)
    for truth, advice in (
        ("still.txt", "no choice of lengths gives errors"),
        ("moving.txt", "--lengths chooses"),
    ):
        assert main(["evaluate", str(tmp_path / "moving.txt"), "--truth", str(tmp_path / truth)]) == 0
        text = " ".join(capsys.readouterr().out.split())
        assert advice in text
        assert ("--lengths" in text) == (truth == "moving.txt")


def test_evaluate_takes_the_truth_from_run_folders(
    runs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folders = [str(runs / name) for name in ("a", "b", "part", "else")]
    assert main(["evaluate", *folders, "--out", str(tmp_path)]) == 0
    text = capsys.readouterr().out
    # A path of 2.5 m has no sub-sequence, so no lengths are named, and there are no curves.
    lines, text = text.splitlines(), " ".join(text.split())
    assert {"bands", "bands, frames 1-4", "street"} <= set(lines)
    for path in ("2.5 m in 6 frames", "1.5 m in 4 frames"):
        assert f"No TE and RE: the path, {path}, is shorter than the shortest sub-sequence, 20 m." in text
    reason = "since too few sub-sequences differ in length and speed."
    assert f"street: no figure of errors by length and speed, {reason}" in text
    assert "benchmark" not in text
    names = ("bands", "bands_frames_1-4", "street")
    files = {f"trajectory_{name}.png" for name in names}
    assert {path.name for path in tmp_path.iterdir()} == files | {"evaluation.json"}
    stored = json.loads((tmp_path / "evaluation.json").read_text(encoding="utf-8"))["sequences"]
    rows = {(each["sequence"], row["name"]): row for each in stored for row in each["systems"]}
    pairs = [("bands", "viso2"), ("bands", "mesvo_f"), ("bands, frames 1-4", "viso2"), ("street", "viso2")]
    assert list(rows) == pairs
    assert all(0 <= row["ate"]["rmse_m"] < 0.05 for row in rows.values())
    apart = "bands, bands, frames 1-4 and street have a table each and are not compared with each other"
    assert apart in text
    assert "not compared with each other" not in printed(capsys, *folders[:2])


def test_evaluate_computes_errors_from_poses(
    runs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copytree(runs / "a", tmp_path / "a")
    (tmp_path / "a" / "metrics.json").unlink()
    truth = read_kitti_poses(runs / "bands" / "poses.txt")
    write_kitti_poses(tmp_path / "a" / "poses.txt", scaled(truth, 1.1))
    write_kitti_poses(tmp_path / "orb.txt", TURNED @ scaled(truth, 1.2))
    (tmp_path / "timed.txt").write_text(format_tum(np.arange(0.102, 0.6, 0.1), scaled(truth, 1.3)[1:]))
    result = numbers(capsys, tmp_path / "a", tmp_path / "orb.txt", tmp_path / "timed.txt")
    assert list(result) == ["viso2", "orb", "timed"]
    for (name, each), percent in zip(result.items(), (10, 20, 30), strict=True):
        assert each["frames"] == 5, name  # common frames of all systems
        assert each["rpe"]["translation"]["rmse_m"] == pytest.approx(0.5 * percent / 100)


def test_evaluate_takes_the_truth_from_a_file(
    runs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copytree(runs / "a", tmp_path / "a")
    config = json.loads((tmp_path / "a" / "config.json").read_text(encoding="utf-8"))
    for folder, says in (("/gone", "no longer at /gone"), (None, "no longer at None")):
        (tmp_path / "a" / "config.json").write_text(json.dumps(config | {"folder": folder}), encoding="utf-8")
        message = refused(capsys, tmp_path / "a", runs / "b")
        assert f"{says}: give its ground truth with --truth FILE, or evaluate this path alone" in message
        alone = printed(capsys, tmp_path / "a")
        assert f"No ground truth: the sequence of this run is {says}." in alone
        assert "For errors, give its ground truth with --truth FILE." in alone
    expected = numbers(capsys, runs / "a")["viso2"]
    kitti, timed = tmp_path / "truth.txt", tmp_path / "timed.txt"
    truth = read_kitti_poses(runs / "bands" / "poses.txt")
    write_kitti_poses(kitti, truth)
    timed.write_text(format_tum(np.arange(0.0, 0.6, 0.1), truth))
    for file in (kitti, timed):
        result = numbers(capsys, tmp_path / "a", "--truth", file)["viso2"]
        assert result["ate"]["rmse_m"] == pytest.approx(expected["ate"]["rmse_m"], abs=1e-6)
        assert result["frames"] == 6


def test_labels_are_the_shortest_distinct_names(
    runs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copytree(runs / "a", tmp_path / "again")
    for folders, labels in (
        (("a", "b"), ["viso2", "mesvo_f"]),
        (("a", "c"), ["viso2, published, seed 0", "viso2, published, seed 1"]),
        (("b", "sets"), ["mesvo_f, published, seed 0", "mesvo_f, selection.sets=20"]),
        (("a", tmp_path / "again"), [str(runs / "a"), str(tmp_path / "again")]),
    ):
        assert list(numbers(capsys, *(runs / name for name in folders))) == labels
    truth = winding_road(150, 0.03, 1.07)
    for files, labels in (
        (("ours/07.txt", "theirs/07.txt"), ["ours", "theirs"]),
        (("ours/07.txt", "ours/07.tum"), ["07.txt", "07.tum"]),
        (("orb.txt", "ours/poses.txt"), ["orb", "ours"]),
    ):
        for file in files:
            (tmp_path / file).parent.mkdir(parents=True, exist_ok=True)
            write_kitti_poses(tmp_path / file, truth)
        assert list(numbers(capsys, *(tmp_path / f for f in files), "--truth", tmp_path / files[0])) == labels


def test_evaluate_refuses_missing_truth_and_other_lengths(
    runs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_kitti_poses(tmp_path / "five.txt", straight(5))
    assert "the runs are of bands and street: evaluate it with the runs of" in refused(
        capsys, runs / "a", runs / "else", tmp_path / "five.txt"
    )
    assert "has 5 poses, but the truth of bands has 6: without times" in refused(
        capsys, runs / "a", tmp_path / "five.txt"
    )
    assert "contains no finished run: expected the folder of a run" in refused(capsys, tmp_path)
    nearest = " ".join(str(runs / name) for name in ("a", "b", "c"))
    assert refused(capsys, runs).endswith(
        f": is not the folder of a run, but contains runs: {nearest} and 3 more"
    )
    (tmp_path / "later.txt").write_text(format_tum(np.arange(10.0, 15.0), straight(5)))
    assert "fewer than two poses at the times" in refused(capsys, runs / "a", tmp_path / "later.txt")
    write_kitti_poses(tmp_path / "truth.txt", straight(150))
    write_kitti_poses(tmp_path / "tenth.txt", straight(150)[::10])
    message = refused(capsys, tmp_path / "tenth.txt", "--truth", tmp_path / "truth.txt")
    assert (
        "both need a pose for the same frames. If frames are missing, give both files with times" in message
    )
    assert "cut" not in message


def test_evaluate_writes_the_same_bytes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    truth = winding_road(300, 0.03, 1.07)
    for name, factor in (("07", 1.0), ("ours", 1.02), ("feature_selection", 1.05)):
        write_kitti_poses(tmp_path / f"{name}.txt", scaled(truth, factor))
    words = [str(tmp_path / name) for name in ("ours.txt", "feature_selection.txt", "07.txt")]
    command = ["evaluate", *words[:2], "--truth", words[2]]
    for folder in ("one", "two"):
        assert main([*command, "--out", str(tmp_path / folder)]) == 0
    text = capsys.readouterr().out
    assert "│ 100 m" in text
    assert "SE3" in text
    # The speed is constant, so there is no curve over speed.
    assert "07: no figure of errors by speed, since too few sub-sequences differ in speed." in text
    files = {"trajectory_07.png", "errors_07_by_length.png"}
    assert {path.name for path in (tmp_path / "one").glob("*.p*")} == files
    for path in (tmp_path / "one").iterdir():
        assert path.read_bytes() == (tmp_path / "two" / path.name).read_bytes()
    result = numbers(capsys, *command[1:])
    # A sub-sequence is up to one step longer than its length.
    assert [each["te_percent"] for each in result.values()] == pytest.approx([2.0, 5.0], rel=0.02)
    for alignment in Alignment:
        result = numbers(
            capsys, *command[1:], "--alignment", alignment.value, "--lengths", "20", "--step", "7"
        )
        assert result["ours"]["ate"]["alignment"] == alignment.value
        assert [each["length_m"] for each in result["ours"]["by_length"]] == [20.0]


def test_evaluate_takes_the_interval_of_rpe_and_the_tolerance_of_times(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    truth, times = straight(101, 0.5), np.arange(101.0)
    (tmp_path / "truth.txt").write_text(format_tum(times, truth))
    (tmp_path / "ours.txt").write_text(format_tum(times + 0.2, scaled(truth, 1.1)))
    files: list[Path | str] = [tmp_path / "ours.txt", "--truth", tmp_path / "truth.txt"]
    words = [*files, "--t-max-diff", "0.3"]
    message = refused(capsys, *files)
    assert "fewer than two poses" in message
    assert message.endswith("; --t-max-diff sets the tolerance")
    # A step is 0.5 m long, and its error 0.05 m.
    for delta, key, error in (("1f", "frames", 0.05), ("8f", "frames", 0.4), ("3.2m", "m", 0.35)):
        rpe = numbers(capsys, *words, "--delta", delta)["ours"]["rpe"]
        assert rpe[f"delta_{key}"] == float(delta[:-1])
        assert rpe["translation"]["rmse_m"] == pytest.approx(error, abs=1e-6)
    assert main(["evaluate", *map(str, words), "--delta", "3.2m"]) == 0
    text = " ".join(capsys.readouterr().out.split())
    assert "RPE over 3.2 m: root mean square" in text
    assert "Matched" not in text
    assert main(["evaluate", *map(str, words), "--delta", "500m"]) == 0
    assert "No RPE over 500 m: the path" in " ".join(capsys.readouterr().out.split())


def test_evaluate_matches_euroc_and_tum_times(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    truth = TURNED @ winding_road(150, 0.03, 1.07)
    times = np.linspace(1403636579.75, 1403636579.75 + 0.05 * len(truth), len(truth))
    times_ns = np.rint(1e9 * times).astype(np.int64)
    write_euroc_truth(tmp_path / "data.csv", times_ns, truth)
    found_times, poses = read_euroc(tmp_path / "data.csv")
    np.testing.assert_allclose(found_times, times, atol=1e-6)
    np.testing.assert_allclose(poses, truth, atol=1e-12)
    (tmp_path / "tum.txt").write_text(format_tum(times[::2] + 0.002, truth[::2]))
    write_euroc_truth(tmp_path / "other.csv", times_ns[20:], scaled(truth, 1.1)[20:])
    places = [tmp_path / name for name in ("tum.txt", "other.csv", "data.csv")]
    tum, other = numbers(capsys, *places[:2], "--truth", places[2], "--lengths", "20,50").values()
    assert tum["frames"] == other["frames"] == 65
    assert main(["evaluate", *map(str, places[:2]), "--truth", str(places[2])]) == 0
    assert f"Matched 65 of {len(truth)} true poses." in capsys.readouterr().out.splitlines()
    assert tum["te_percent"] == pytest.approx(0.0, abs=1e-5)
    assert other["te_percent"] == pytest.approx(10.0, rel=0.1)


def printed(capsys: pytest.CaptureFixture[str], *words: Path | str) -> str:
    """The text of `vo evaluate` without line breaks."""
    capsys.readouterr()
    assert main(["evaluate", *map(str, words)]) == 0
    return " ".join(capsys.readouterr().out.split())


def test_evaluate_says_how_many_sub_sequences_and_when_they_are_few(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for frames in (103, 900):
        write_kitti_poses(tmp_path / f"truth{frames}.txt", straight(frames))
        write_kitti_poses(tmp_path / f"ours{frames}.txt", straight(frames, 1.01))
    few = printed(capsys, tmp_path / "ours103.txt", "--truth", tmp_path / "truth103.txt")
    assert "truth103: 1 sub-sequence (few) of 100, 200, … 800 m, every 10 frames Fewer than 20" in few
    assert "KITTI" not in few
    many = printed(capsys, tmp_path / "ours900.txt", "--truth", tmp_path / "truth900.txt")
    count = len(kitti_errors(straight(900), straight(900)))
    assert f"truth900: {count} sub-sequences of 100, 200, … 800 m, every 10 frames (as KITTI)" in many
    assert "few" not in many.lower()
    words: list[Path | str] = ["--truth", tmp_path / "truth900.txt", "--step", "1", "--lengths", "50"]
    other = printed(capsys, tmp_path / "ours900.txt", *words)
    assert "849 sub-sequences of 50 m, every frame Other sub-sequences than KITTI's" in other


def test_key_frames_of_another_system_are_frames_of_the_truth(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    truth, times = winding_road(600, 0.03, 1.07), 0.1 * np.arange(600.0)
    (tmp_path / "truth.tum").write_text(format_tum(times, truth))
    (tmp_path / "ours.tum").write_text(format_tum(times[::10], scaled(truth, 1.02)[::10]))
    (tmp_path / "all.tum").write_text(format_tum(times, scaled(truth, 1.02)))
    words: list[Path | str] = ["--truth", tmp_path / "truth.tum", "--delta", "10f"]
    ours = numbers(capsys, tmp_path / "ours.tum", *words)["ours"]
    dense = numbers(capsys, tmp_path / "all.tum", *words)["all"]
    assert ours["rpe"]["translation"] == pytest.approx(dense["rpe"]["translation"], abs=1e-6)
    assert ours["te_percent"] == pytest.approx(dense["te_percent"], rel=0.05)
    assert 0.9 * dense["subsequences"] < ours["subsequences"] <= dense["subsequences"]
    text = printed(capsys, tmp_path / "ours.tum", "--truth", tmp_path / "truth.tum")
    assert "No RPE from frame to frame: the compared poses are 10 frames apart; use --delta 10f." in text
    assert "Part of the truth, not comparable" in text
    assert "(as KITTI)" not in text


def test_times_since_1970_in_other_units_are_read_with_a_note(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    truth = winding_road(150, 0.03, 1.07)
    times = 1403636579.75 + 0.1 * np.arange(150.0)
    units = {"s": (1.0, ""), "ms": (1e-3, "milliseconds"), "us": (1e-6, "microseconds")}
    units["ns"] = (1e-9, "nanoseconds")
    for name, (unit, _) in units.items():
        (tmp_path / f"{name}.tum").write_text(format_tum(times / unit, truth))
    for name, (_, words) in units.items():
        text = printed(capsys, tmp_path / f"{name}.tum", "--truth", tmp_path / "s.tum")
        assert ("since 1970" in text) == (f"the times are read as {words} since 1970." in text) == bool(words)
        each = numbers(capsys, tmp_path / "s.tum", "--truth", tmp_path / f"{name}.tum")["s"]
        assert each["frames"] == 150
        assert each["te_percent"] == pytest.approx(0.0, abs=1e-4)
    (tmp_path / "later.tum").write_text(format_tum((times + 100.0) / 1e-9, truth))
    message = refused(capsys, tmp_path / "later.tum", "--truth", tmp_path / "s.tum")
    assert "its times are 1403636679.75 to 1403636694.65, those of s 1403636579.75 to" in message


def test_times_in_other_units_are_refused_with_both_ranges(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    truth = winding_road(150, 0.03, 1.07)
    times = 57.75 + 0.1 * np.arange(150.0)
    for name, unit in (("s", 1.0), ("ms", 1e-3), ("us", 1e-6), ("ns", 1e-9)):
        (tmp_path / f"{name}.tum").write_text(format_tum(times / unit, truth))
    for name, words in (("ms", "milliseconds"), ("us", "microseconds"), ("ns", "nanoseconds")):
        message = refused(capsys, tmp_path / f"{name}.tum", "--truth", tmp_path / "s.tum")
        assert f"its times are probably {words}" in message
        assert "those of s 57.75 to 72.65" in message
        message = refused(capsys, tmp_path / f"{name}.tum", "--truth", tmp_path / f"{name}.tum")
        assert f"expected 0.001 to 10 s; they are probably {words}" in message
    (tmp_path / "numbers.tum").write_text(format_tum(np.arange(150.0), truth))
    (tmp_path / "zero.tum").write_text(format_tum(times - times[0], truth))
    message = refused(capsys, tmp_path / "numbers.tum", "--truth", tmp_path / "zero.tum")
    assert (
        "the times are frame numbers, expected seconds: its times are 0 to 149, those of zero 0 to" in message
    )
    # The remedy of the message: a first line with the unit.
    header = "# timestamp [ns] tx ty tz qx qy qz qw\n"
    (tmp_path / "named.tum").write_text(header + (tmp_path / "ns.tum").read_text())
    assert numbers(capsys, tmp_path / "named.tum", "--truth", tmp_path / "s.tum")["named"]["frames"] == 150


@pytest.mark.parametrize("header", ["timestamp,tx,ty,tz,qw,qx,qy,qz\n", ""])
def test_quaternions_in_another_order_than_stated_are_noticed_on_a_gentle_path(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], header: str
) -> None:
    truth = winding_road(200, 0.02, 1.0)
    times = 0.1 * np.arange(200.0)
    rows = format_tum(times, truth).splitlines()
    (tmp_path / "truth.tum").write_text("\n".join(rows))
    # Nanoseconds and commas are EuRoC's, whose order without a header has qw first.
    cells = [row.split() for row in rows]
    lines = [",".join([str(round(1e9 * float(row[0]))) if not header else row[0], *row[1:]]) for row in cells]
    (tmp_path / "est.csv").write_text(header + "\n".join(lines))
    text = printed(capsys, tmp_path / "est.csv", "--truth", tmp_path / "truth.tum")
    assert "agree only with the quaternions of one file in another order" in text
    (tmp_path / "est.csv").write_text("timestamp,tx,ty,tz,qx,qy,qz,qw\n" + "\n".join(map(",".join, cells)))
    assert "another order" not in printed(capsys, tmp_path / "est.csv", "--truth", tmp_path / "truth.tum")


def test_paths_that_do_not_fit_the_truth_cause_a_warning(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    truth = winding_road(150, 0.3, 1.07)
    write_kitti_poses(tmp_path / "truth.txt", truth)
    imu = truth.copy()
    imu[:, :3, :3] = truth[:, :3, :3] @ rotation_from_vector(np.array([0.0, np.pi / 2, 0.0]))
    for name, poses in (("imu", imu), ("mono", scaled(truth, 0.1)), ("right", scaled(truth, 1.1))):
        write_kitti_poses(tmp_path / f"{name}.txt", poses)
    words: list[Path | str] = ["--truth", tmp_path / "truth.txt"]
    assert "positions of imu and of the truth agree, but orientations do not" in printed(
        capsys, tmp_path / "imu.txt", *words
    )
    assert "the path of mono is 0.1 times as long as the truth" in printed(
        capsys, tmp_path / "mono.txt", *words
    )
    assert "warning" not in printed(capsys, tmp_path / "right.txt", *words)


def test_a_part_of_a_sequence_is_never_as_kitti(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    sequence = open_sequence(write_bands(tmp_path / "bands"))
    assert not sequence.is_part
    assert sequence.part(0, 4).is_part
    (tmp_path / "bands" / "part.txt").write_text("--sequences 00 --frames 0:6\n", encoding="utf-8")
    assert open_sequence(tmp_path / "bands").is_part


def test_evaluate_warns_of_poses_that_changed_since_the_run(
    runs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copytree(runs / "a", tmp_path / "a")
    assert main(["evaluate", str(tmp_path / "a")]) == 0
    assert capsys.readouterr().err == ""
    poses = tmp_path / "a" / "poses.txt"
    poses.write_bytes(poses.read_bytes()[:-5])
    assert main(["evaluate", str(tmp_path / "a"), "--json"]) == 0
    answer = capsys.readouterr()
    assert answer.err.startswith(
        f"warning: poses.txt was missing or changed in {tmp_path / 'a'} since the run"
    )
    json.loads(answer.out)


@pytest.mark.parametrize("name", ["evaluation.json", "trajectory_bands.png"])
def test_files_of_somebody_else_are_kept(
    runs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str
) -> None:
    out = tmp_path / "out"
    out.mkdir()
    (out / name).write_text("mine", encoding="utf-8")
    assert f"{name}: is not the kit's file" in refused(capsys, runs / "a", "--out", out)
    assert [(path.name, path.read_text()) for path in out.iterdir()] == [(name, "mine")]
    (out / name).unlink()
    for _ in range(2):  # its own files are replaced
        assert main(["evaluate", str(runs / "a"), "--out", str(out)]) == 0
    assert {"evaluation.json", "trajectory_bands.png"} <= {path.name for path in out.iterdir()}


@pytest.fixture(scope="module")
def untrue(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two runs on a sequence without ground truth."""
    base = tmp_path_factory.mktemp("untrue")
    (write_bands(base / "street") / "poses.txt").unlink()
    sequence = open_sequence(base / "street")
    for method in ("viso2", "mesvo_f"):
        config = preset(method)
        (base / method).mkdir()
        write_run(base / method, run(sequence, config), run_identity(sequence, config, method))
    return base


def alone(capsys: pytest.CaptureFixture[str], *words: Path | str) -> dict[str, Any]:
    """The facts of one sequence without ground truth, from the JSON of `vo evaluate`."""
    capsys.readouterr()
    assert main(["evaluate", *map(str, words), "--json"]) == 0
    (sequence,) = json.loads(capsys.readouterr().out)["sequences"]
    assert sequence["ground_truth"] is False
    return dict(sequence)


def test_runs_without_truth_are_drawn_and_compared(
    untrue: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = printed(capsys, untrue / "viso2", untrue / "mesvo_f", "--out", tmp_path / "out")
    assert "street, frames 0-5: no ground truth, so these numbers are no errors" in text
    assert "viso2 – mesvo_f" in text
    assert text.count("has no truth for the frames of this run") == 1
    picture, stored = sorted((tmp_path / "out").iterdir(), key=lambda path: path.suffix == ".json")
    assert picture.name == "trajectory_street_frames_0-5.png"
    (sequence,) = json.loads(stored.read_text(encoding="utf-8"))["sequences"]
    assert sequence == alone(capsys, untrue / "viso2", untrue / "mesvo_f")
    for system in sequence["systems"]:
        poses = read_kitti_poses(untrue / system["name"] / "poses.txt")
        facts = system["path"]
        assert facts["length_m"] == pytest.approx(trajectory_distances(poses)[-1], abs=1e-6)
        assert facts["duration_s"] == pytest.approx(0.5)
        assert facts["mean_speed_m_s"] == pytest.approx(2 * facts["length_m"])
        assert facts["end_m"] == pytest.approx(poses[-1, :3, 3], abs=1e-6)
    # Some time later, the same call replaces its own files.
    assert main(["evaluate", str(untrue / "viso2"), "--out", str(tmp_path / "out")]) == 0


def test_paths_without_truth_start_at_the_same_pose(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    road, times = winding_road(150, 0.03, 1.07), 100.0 + 0.1 * np.arange(150.0)
    (tmp_path / "a.tum").write_text(format_tum(times, road))
    (tmp_path / "b.tum").write_text(format_tum(times[10:] + 0.002, TURNED @ scaled(road, 1.1)[10:]))
    sequence = alone(capsys, tmp_path / "a.tum", tmp_path / "b.tum")
    a, b = sequence["systems"]
    # What is said of one path comes from all its poses and its own times.
    assert (a["frames"], b["frames"]) == (150, 140)
    assert a["path"]["length_m"] == pytest.approx(149 * 1.07)
    assert b["path"]["length_m"] == pytest.approx(1.1 * 139 * 1.07)
    assert a["path"]["duration_s"] == pytest.approx(14.9)
    assert b["path"]["duration_s"] == pytest.approx(13.9)
    assert a["path"]["end_m"] == pytest.approx(road[-1, :3, 3], abs=1e-6)
    end = np.linalg.inv(road[10]) @ road[-1]
    assert b["path"]["end_m"] == pytest.approx(1.1 * end[:3, 3], abs=1e-6)
    # What compares them comes from the common poses, and begins where the second path begins.
    assert sequence["compared_frames"] == 140
    (pair,) = sequence["differences"]
    assert pair["paths"] == ["a", "b"]
    # Equal orientations, and every step 10 % longer.
    assert pair["end_m"] == pytest.approx(0.1 * np.linalg.norm(end[:3, 3]), abs=1e-6)
    assert pair["max_m"] >= pair["end_m"]
    assert "the 140 poses at times that all paths have" in " ".join(sequence["notes"])
    text = printed(capsys, tmp_path / "a.tum", tmp_path / "b.tum")
    assert "│ a │ 150 │ 159.43 │ 14.90 │ 10.70 │" in text
    assert "Each row is about all poses of its path, with the path's own times." in text
    assert "Distances between the paths, at only the 140 poses that all paths have" in text
    assert "warning" not in text


def test_a_file_without_times_gets_no_duration_from_another_file(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    road = winding_road(150, 0.03, 1.07)
    (tmp_path / "a.tum").write_text(format_tum(0.1 * np.arange(150.0), road))
    (tmp_path / "b.csv").write_text(
        "tx,ty,tz,qw,qx,qy,qz\n"
        + "".join(f"{z},0,{z},1,0,0,0\n" for z in np.linspace(0.0, 110.0, 150).round(6))
    )
    write_kitti_poses(tmp_path / "c.txt", scaled(road, 1.02))
    for names in (("a.tum", "b.csv", "c.txt"), ("c.txt", "b.csv", "a.tum")):
        files = [tmp_path / name for name in names]
        facts = {each["name"]: each["path"] for each in alone(capsys, *files)["systems"]}
        assert facts["a"]["duration_s"] == pytest.approx(14.9)
        for name in ("b", "c"):
            assert facts[name]["duration_s"] is None
            assert facts[name]["mean_speed_m_s"] is None
        text = printed(capsys, *files)
        untimed = " and ".join(name[0] for name in names if name[0] != "a")
        assert f"No duration and no speed of {untimed}: their files have no times." in text
        assert f"c.txt: has no times, so row k is compared with row k of {tmp_path / 'a.tum'}." in text
    # With a truth file, its times are no times of the path either.
    truth: list[Path | str] = ["--truth", tmp_path / "a.tum"]
    assert numbers(capsys, tmp_path / "c.txt", *truth)["c"]["path"]["duration_s"] is None


def offset_pair(folder: Path, first: int, last: int, shift: float) -> list[Path]:
    """A path of 150 frames, ten a second, and its frames first … last - 1 by a clock `shift` s ahead."""
    road, times = winding_road(150, 0.03, 1.07), 100.0 + 0.1 * np.arange(150.0)
    (folder / "a.tum").write_text(format_tum(times, road))
    (folder / "b.tum").write_text(format_tum(times[first:last] + shift, road[first:last]))
    return [folder / "a.tum", folder / "b.tum"]


@pytest.mark.parametrize(
    ("first", "last", "shift", "matches"),
    [(0, 150, 7.0, 80), (0, 150, -0.1, 149), (3, 150, 2.004, 127), (0, 150, 9.0, 60)],
)
def test_clocks_that_may_differ_cause_a_warning(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    first: int,
    last: int,
    shift: float,
    matches: int,
) -> None:
    a, b = offset_pair(tmp_path, first, last, shift)
    only = "only " if matches < 75 else ""
    counts = f"{b}: {only}{matches} of {last - first} poses have one of the 150 poses of"
    (warning,) = [note for note in alone(capsys, a, b)["notes"] if note.startswith("warning: ")]
    assert counts in warning
    assert "those of a.tum 100 to 114.9" in warning
    assert ("its clock may differ" in warning) is (matches > 75)
    notes = json.loads(json_of(capsys, b, "--truth", a))["sequences"][0]["notes"]
    assert any(note.startswith(f"warning: {counts}") for note in notes)


@pytest.mark.parametrize(
    ("first", "last", "shift", "matches"), [(0, 150, 13.0, 20), (0, 150, -12.5, 25), (100, 150, 10.0, 0)]
)
def test_paths_with_few_common_times_are_refused(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    first: int,
    last: int,
    shift: float,
    matches: int,
) -> None:
    a, b = offset_pair(tmp_path, first, last, shift)
    for message in (refused(capsys, a, b), refused(capsys, b, "--truth", a)):
        assert str(b) in message
        if matches:
            assert f"only {matches} of {last - first} poses have one of the 150 poses of" in message
        assert "write the times of one clock in both files" in message


def test_two_cameras_without_synchronisation_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    road = winding_road(300, 0.03, 1.07)
    (tmp_path / "a.tum").write_text(format_tum(0.1 * np.arange(300.0), road))
    (tmp_path / "b.tum").write_text(format_tum(0.0983 * np.arange(300.0), road))
    message = refused(capsys, tmp_path / "a.tum", tmp_path / "b.tum")
    assert "if not, give a larger --t-max-diff" in message
    # The remedy.
    assert alone(capsys, tmp_path / "a.tum", tmp_path / "b.tum", "--t-max-diff", "0.05")["compared_frames"]


def test_key_frames_and_parts_of_a_path_cause_no_warning(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for first, last in ((0, 150), (20, 150), (0, 120), (30, 90)):
        assert "warning" not in printed(capsys, *offset_pair(tmp_path, first, last, 0.003))
    road, times = winding_road(150, 0.03, 1.07), 100.0 + 0.1 * np.arange(150.0)
    (tmp_path / "key.tum").write_text(format_tum(times[::10], road[::10]))
    assert "warning" not in printed(capsys, tmp_path / "key.tum", tmp_path / "a.tum")


def test_files_with_few_times_common_to_all_are_not_compared(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    road, times = winding_road(150, 0.03, 1.07), 0.1 * np.arange(150.0)
    for name, part in {"a": slice(0, 150), "b": slice(0, 80), "c": slice(70, 150)}.items():
        (tmp_path / f"{name}.tum").write_text(format_tum(times[part], road[part]))
    a, b, c = (tmp_path / f"{name}.tum" for name in "abc")
    for words in ((a, b, c), (b, c, "--truth", a)):
        message = refused(capsys, *words)
        assert "only 10 poses are at times that all files have" in message
        assert message.endswith("evaluate fewer files at once")
    (tmp_path / "c.tum").write_text(format_tum(times[50:], road[50:]))
    text = printed(capsys, a, b, c)
    assert "warning: only 30 poses are at times that all files have" in text
    assert "of 80 poses in the shortest" in text


ROBOT = rigid(np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]), np.zeros(3))


def town_road(frames: int, seed: int = 0) -> Array:
    """Poses (N, 4, 4) with turns to both sides that begin at random times, 1 m from frame to frame."""
    road = np.tile(np.eye(4), (frames, 1, 1))
    turns = np.convolve(np.random.default_rng(seed).normal(0.0, 0.05, frames), np.hanning(15), "same")
    for k in range(1, frames):
        step = rigid(rotation_from_vector(np.array([0.0, turns[k], 0.0])), np.array([0.0, 0.0, 1.0]))
        road[k] = road[k - 1] @ step
    return road


def test_another_clock_within_the_times_of_a_file_causes_a_warning(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    road = town_road(300)
    times = 0.1 * np.arange(300.0)
    a, b = tmp_path / "a.tum", tmp_path / "b.tum"
    a.write_text(format_tum(times, road))
    for shift in (0.0, 2.5, 0.5, 0.2, -0.1):
        b.write_text(format_tum(times[80:220] + shift, scaled(road, 1.1)[80:220]))
        for words in ((a, b), (b, "--truth", a)):
            notes = json.loads(json_of(capsys, *words))["sequences"][0]["notes"]
            warnings = [note for note in notes if note.startswith("warning: ")]
            assert len(warnings) == (shift != 0)
            if shift:
                assert f"{b}: 140 of 140 poses have one of the 300 poses" in warnings[0]
                way = "earlier" if shift > 0 else "later"
                assert f"would agree far better if its times were {abs(shift):g} s {way}" in warnings[0]
    # Both begin and end later than the other, but turn at the same times: this is no other clock.
    a.write_text(format_tum(times[:260], road[:260]))
    b.write_text(format_tum(times[40:], road[40:]))
    assert "warning" not in printed(capsys, a, b)


def test_parts_of_one_path_with_one_clock_cause_no_warning(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Both begin and end later than the other: so too little is common, or too straight, for the turns."""
    a, b = tmp_path / "a.tum", tmp_path / "b.tum"
    times = 0.1 * np.arange(300.0)
    straight = winding_road(300, 0.0, 1.0)
    straight[:, 2, 3] += 20.0 * np.sin(times)
    with_stop = straight[np.clip(np.arange(300), 0, 60)]  # it stands for more than half of the time
    for road, first, last in (
        (town_road(300), 90, 210),
        (straight, 5, 295),
        (scaled(straight, 1.001), 90, 210),
        (with_stop, 5, 295),
    ):
        a.write_text(format_tum(times[:last], road[:last]))
        b.write_text(format_tum(times[first:], road[first:]))
        assert "clock" not in printed(capsys, a, b)
        assert "clock" not in printed(capsys, b, "--truth", a)
    # Straight paths by another clock, as the speed tells.
    for road in (straight, with_stop):
        a.write_text(format_tum(times, road))
        b.write_text(format_tum(times + 1.2, road))
        assert "both about 1.2 s later, so its clock may differ" in printed(capsys, a, b)


def test_a_path_of_another_drive_is_noticed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    times = 0.1 * np.arange(500.0)
    a, b = tmp_path / "a.tum", tmp_path / "b.tum"
    a.write_text(format_tum(times, town_road(500)))
    for frames, seed, other in ((500, 0, False), (500, 3, True), (350, 4, True), (400, 0, False)):
        b.write_text(format_tum(times[:frames], scaled(town_road(500, seed)[:frames], 1.1)))
        for words in ((a, b), (b, "--truth", a)):
            text = printed(capsys, *words)
            assert ("perhaps one is of another drive" in text) is other
            if other:  # above all tables
                assert text.index("another drive") < text.index("┏")


def straight_with_errors(frames: int, error: float, seed: int = 0) -> Array:
    """Poses (N, 4, 4) straight ahead, with random turns of about this angle, radians, from frame to frame."""
    turns = rotation_from_vector(np.random.default_rng(seed).normal(0.0, error, (frames, 3)))
    poses = straight(frames)
    for k in range(1, frames):
        poses[k] = poses[k - 1] @ rigid(turns[k], np.array([0.0, 0.0, 1.0]))
    return poses


def test_the_errors_of_a_straight_path_are_not_those_of_another_drive(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Its orientations change by the rounding of one file, and by the errors of the other."""
    times = 0.1 * np.arange(500.0)
    a, b = tmp_path / "a.tum", tmp_path / "b.tum"
    a.write_text(format_tum(times, TURNED @ straight_with_errors(500, 1e-7)))
    for error in (1e-7, 3e-4, 1e-3):
        b.write_text(format_tum(times, straight_with_errors(500, error, seed=1)))
        for words in ((a, b), (b, "--truth", a)):
            assert "another drive" not in printed(capsys, *words)
    b.write_text(format_tum(times, town_road(500)))
    assert "perhaps one is of another drive" in printed(capsys, a, b)


def test_paths_in_other_axes_than_a_camera_are_noticed_without_truth(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """`ROBOT` leads from the axes of a camera to those of a robot, x forward, y left and z up."""
    road, times = winding_road(150, 0.03, 1.07), 0.1 * np.arange(150.0)
    standing = np.concatenate([np.repeat(road[:1], 200, axis=0), road])
    sideways = winding_road(150, 0.0, 1.0)
    sideways[:, 0, 3] = np.linspace(0.0, 20.0, 150)
    to_and_fro = np.concatenate([road, road[::-1]])
    paths = {
        "camera": (road, ""),
        "standing": (standing, ""),
        "gently_sideways": (sideways, ""),
        "to_and_fro": (to_and_fro, ""),
        "robot": (ROBOT @ road @ np.linalg.inv(ROBOT), "+x"),
        "robot_moved": (TURNED @ ROBOT @ standing @ np.linalg.inv(ROBOT), "+x"),
        "robot_to_and_fro": (ROBOT @ to_and_fro @ np.linalg.inv(ROBOT), "x"),
        "robot_backwards": (ROBOT @ road[::-1] @ np.linalg.inv(ROBOT), "-x"),
        "backwards": (road[::-1], "-z"),
    }
    for name, (poses, axis) in paths.items():
        file = tmp_path / f"{name}.tum"
        file.write_text(format_tum(0.1 * np.arange(float(len(poses))), poses))
        text = printed(capsys, file)
        assert alone(capsys, file)["warnings"] == [] or axis, name
        if axis:
            assert f"warning: {name}: the poses move along their own {axis} axis rather than along +z" in text
            way = "backwards" if axis == "-z" else "sideways"
            assert f"Unless the camera really moved {way}" in text
    (tmp_path / "inverted.tum").write_text(format_tum(times, np.asarray(np.linalg.inv(road))))
    (warning,) = alone(capsys, tmp_path / "inverted.tum")["warnings"]
    assert "inverted: the poses are probably inverted (world to camera)" in warning
    robots = [tmp_path / "robot.tum", tmp_path / "twin.tum"]
    robots[1].write_text(format_tum(times, scaled(paths["robot"][0], 1.02)))
    (warning,) = alone(capsys, *robots)["warnings"]
    assert warning.startswith("warning: robot and twin: the poses move along their own +x axis")


def test_inverted_poses_are_named_beside_another_path(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    road = town_road(500)
    times = 0.1 * np.arange(500.0)
    a, b = tmp_path / "a.tum", tmp_path / "b.tum"
    a.write_text(format_tum(times, road))
    for scale in (1.0, 0.1):
        for inverted in (True, False):
            poses = scaled(road, 1.02 * scale)
            written = np.asarray(np.linalg.inv(poses)) if inverted else poses
            b.write_text(format_tum(times, written))
            for words in ((a, b), (b, a), (b, "--truth", a), (a, "--truth", b)):
                text = printed(capsys, *words)
                assert ("agree only if the poses of one of them are inverted" in text) is inverted
                assert ("times as long" in text) is (scale < 1 and not inverted)
                assert "leaps by" not in text


def test_mirrored_axes_are_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    road = town_road(500)
    hills = np.convolve(np.random.default_rng(7).normal(0.0, 0.01, 500), np.hanning(15), "same")
    for k in range(1, 500):
        motion = np.linalg.inv(road[k - 1]) @ road[k]
        pitched = rigid(rotation_from_vector(np.array([hills[k], 0.0, 0.0])), np.zeros(3))
        road[k:] = road[k - 1] @ motion @ pitched @ np.linalg.inv(road[k]) @ road[k:]
    times = 0.1 * np.arange(500.0)
    truth, file = tmp_path / "truth.tum", tmp_path / "b.tum"
    truth.write_text(format_tum(times, road))
    for axis, signs in {"": (1, 1, 1), "x": (-1, 1, 1), "y": (1, -1, 1), "z": (1, 1, -1)}.items():
        mirror = np.diag([*map(float, signs), 1.0])
        file.write_text(format_tum(times, mirror @ scaled(road, 1.003) @ mirror))
        text = printed(capsys, file, "--truth", truth)
        assert ("mirrored (left-handed) axes" in text) is bool(axis)
        assert (f"if the {axis} axis of one of them is reversed" in text) is bool(axis)


def test_a_leap_is_named_with_its_pose_with_and_without_truth(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    road = town_road(400)
    times = 0.1 * np.arange(400.0)
    jump = road.copy()
    jump[250:, 0, 3] += 300.0
    reset = road.copy()
    reset[250:] = road[:1] @ np.linalg.inv(road[250]) @ road[250:]
    gap = np.r_[0:100, 180:400]
    stops = road[np.minimum(np.arange(400), 60)]
    truth = tmp_path / "truth.tum"
    truth.write_text(format_tum(times, road))
    for path, rows, leaps in (
        (jump, np.arange(400), True),
        (reset, np.arange(400), True),
        (scaled(jump, 0.05), np.arange(400), True),
        (road, gap, False),
        (stops, np.arange(400), False),
        (road, np.arange(0, 400, 10), False),
    ):
        file = tmp_path / "b.tum"
        file.write_text(format_tum(times[rows], path[rows]))
        for words in ([file], [file, "--truth", truth], [truth, file]):
            text = printed(capsys, *words)
            assert (
                "from pose 249 to pose 250 (at 25.000 s), counted from 0, the path leaps" in text
            ) is leaps
            assert ("leaps by" in text) is leaps
    file.write_text(format_tum(times, jump))
    assert "the truth b: from pose 249 to pose 250" in printed(capsys, truth, "--truth", file)
    file.write_text(format_tum(times, scaled(road, 100.0)))
    for words in ([file], [file, "--truth", truth]):
        assert "b: a usual speed of 1e+03 m/s is impossible for a vehicle" in printed(capsys, *words)


def test_a_truth_in_other_axes_than_a_camera_is_noticed_beside_its_picture(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    road = winding_road(150, 0.03, 1.07)
    for name, poses in (("camera", road), ("robot", ROBOT @ road @ np.linalg.inv(ROBOT))):
        write_kitti_poses(tmp_path / f"{name}.txt", poses)
        words: list[Path | str] = [tmp_path / f"{name}.txt", "--truth", tmp_path / f"{name}.txt"]
        text = printed(capsys, *words, "--out", tmp_path / name)
        assert ("robot: the true poses move along their own +x axis" in text) is (name == "robot")
        assert "warning" not in printed(capsys, *words)  # the errors are the same in all axes


def test_runs_of_two_sequences_with_one_name_are_not_compared(
    untrue: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copytree(untrue / "viso2", tmp_path / "other")
    config = json.loads((tmp_path / "other" / "config.json").read_text(encoding="utf-8"))
    (tmp_path / "other" / "config.json").write_text(
        json.dumps(config | {"images": "0" * 16}), encoding="utf-8"
    )
    message = refused(capsys, untrue / "mesvo_f", tmp_path / "other")
    assert "two sequences have the name street, frames 0-5: evaluate them separately" in message


def test_an_end_at_the_start_has_no_minus_sign(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    standing = np.tile(np.eye(4), (9, 1, 1))
    standing[-1, :3, 3] = -0.01
    write_kitti_poses(tmp_path / "standing.txt", standing)
    assert "│ 0.0, 0.0, 0.0 │" in printed(capsys, tmp_path / "standing.txt")


def test_a_run_that_moves_to_the_side_is_no_file_in_other_axes(
    untrue: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert alone(capsys, untrue / "viso2", untrue / "mesvo_f")["warnings"] == []
    assert alone(capsys, untrue / "viso2" / "poses.txt")["warnings"] != []


def test_evaluate_without_truth_names_what_the_paths_do_not_say(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    road = winding_road(150, 0.3, 1.07)
    write_kitti_poses(tmp_path / "plain.txt", road)
    assert alone(capsys, tmp_path / "plain.txt")["systems"][0]["path"]["duration_s"] is None
    assert "No duration and no speed: no file has times." in printed(capsys, tmp_path / "plain.txt")
    (tmp_path / "numbers.tum").write_text(format_tum(np.arange(150.0), road))
    text = printed(capsys, tmp_path / "numbers.tum")
    assert "if these are numbers of frames, durations and speeds are wrong" in text
    (tmp_path / "some.tum").write_text(format_tum(3.0 + 2.0 * np.arange(150.0), road))
    text = printed(capsys, tmp_path / "some.tum", "--truth", tmp_path / "some.tum")
    assert "warning: " in text
    assert "if these are numbers of frames, durations and speeds are wrong" in text
    write_kitti_poses(tmp_path / "mono.txt", scaled(road, 0.1))
    imu = road.copy()
    imu[:, :3, :3] = road[:, :3, :3] @ rotation_from_vector(np.array([0.0, np.pi / 2, 0.0]))
    write_kitti_poses(tmp_path / "imu.txt", imu)
    text = printed(capsys, tmp_path / "plain.txt", tmp_path / "mono.txt", tmp_path / "imu.txt")
    assert "the path of mono is 0.1 times as long as that of plain" in text
    assert "imu and plain have other axes or another order of quaternions" in text
    write_kitti_poses(tmp_path / "short.txt", road[:-1])
    message = refused(capsys, tmp_path / "plain.txt", tmp_path / "short.txt")
    assert "short.txt: has 149 poses, but " in message  # a long path is shortened
    assert "a pose for the s" in message
    write_kitti_poses(tmp_path / "one.txt", road[:1])
    assert "one.txt: has one pose: a path needs two or more" in refused(capsys, tmp_path / "one.txt")
    (tmp_path / "ms.tum").write_text(format_tum(1e5 * np.arange(150.0), road))
    assert "the median interval of the times is" in refused(capsys, tmp_path / "ms.tum")


def test_files_belong_to_the_only_sequence_of_the_runs(
    untrue: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copy(untrue / "viso2" / "poses.txt", tmp_path / "theirs.txt")
    sequence = alone(capsys, untrue / "mesvo_f", tmp_path / "theirs.txt")
    assert [system["name"] for system in sequence["systems"]] == ["mesvo_f", "theirs"]
    assert sequence["systems"][1]["path"]["duration_s"] == pytest.approx(0.5)
    assert any(note.endswith("and gets the times of street, frames 0-5.") for note in sequence["notes"])
    shutil.copytree(untrue / "viso2", tmp_path / "other")
    config = tmp_path / "other" / "config.json"
    config.write_text(
        config.read_text(encoding="utf-8").replace('"sequence": "street"', '"sequence": "road"')
    )
    message = refused(capsys, untrue / "mesvo_f", tmp_path / "other", tmp_path / "theirs.txt")
    assert "is a pose file, and the runs are of street, frames 0-5 and road, frames 0-5" in message


def test_evaluate_prints_mean_median_and_maximum(runs: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = printed(capsys, runs / "a", runs / "b")
    systems = numbers(capsys, runs / "a", runs / "b")
    assert "error, system ┃ rmse ┃ mean ┃ median ┃ max" in text
    for name, each in systems.items():
        errors = each["ate"]
        cells = " │ ".join(f"{errors[f'{kind}_m']:.4f}" for kind in ("rmse", "mean", "median", "max"))
        assert f"ATE m, {name} │ {cells}" in text
        assert each["path"]["duration_s"] == pytest.approx(0.5)


def test_runs_of_two_sequences_have_no_common_truth_and_no_common_file(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    runs = []
    for name in ("one", "two"):
        folder = write_bands(tmp_path / name, 6)
        out = tmp_path / f"run_{name}"
        assert main(["run", str(folder), "--out", str(out), "--cache", str(tmp_path / "cache")]) == 0
        runs.append(out)
    shutil.copy(runs[0] / "poses_tum.txt", tmp_path / "theirs.tum")
    message = refused(capsys, *runs, tmp_path / "theirs.tum")
    assert (
        "is a pose file, and the runs are of one and two: evaluate it with the runs of its sequence"
        in message
    )
    assert "--truth" not in message
    message = refused(capsys, *runs, "--truth", tmp_path / "theirs.tum")
    assert "is the truth of one sequence, and the runs are of one and two: evaluate each" in message
    printed(capsys, runs[0], tmp_path / "theirs.tum")
    printed(capsys, runs[0], "--truth", tmp_path / "theirs.tum")
