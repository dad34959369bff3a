"""Commands replace only files that the kit wrote; the reader's files and inputs stay as they are."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from vo_lib.commands.cli import main

QUICK = ["--features.blob_cell", "9"]


def contents(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def commands(bands: Path, out: Path) -> dict[str, list[str]]:
    """A command line for each command with a folder of results."""
    cache = ["--cache", str(bands.parent / "cache"), "--out", str(out)]
    few = ["--variant", "published", "--seeds", "1"]
    return {
        "run": ["run", str(bands), "--out", str(out), *QUICK],
        "sweep": ["sweep", "--sequence", str(bands), "--set", "selection.sets=20", "--seeds", "1", *cache],
        "reproduce": ["reproduce", "--sequences", str(bands), "--methods", "mesvo_f", *few, *cache],
    }


@pytest.mark.parametrize(
    ("command", "name"),
    [
        *(("run", name) for name in ("poses.txt", "calibration.json", "loops.csv", "trajectory.png")),
        *(("sweep", name) for name in ("sweep.csv", "sweep.png")),
        *(
            ("reproduce", name)
            for name in ("table1.csv", "table1.md", "report.html", "figure4_published.png")
        ),
        ("reproduce", "trajectory_published_bands.png"),
    ],
)
@pytest.mark.parametrize("fresh", [[], ["--fresh"]], ids=["", "fresh"])
def test_a_file_of_somebody_else_is_refused_by_name(
    bands: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], command: str, name: str, fresh: list[str]
) -> None:
    out = tmp_path / "out"
    out.mkdir()
    (out / name).write_text("mine", encoding="utf-8")
    assert main([*commands(bands, out)[command], *fresh]) == 2
    printed = capsys.readouterr()
    assert printed.err == (
        f"vo: error: {out / name}: is not the kit's file: choose another folder for the results\n"
    )
    assert contents(out) == {name: b"mine"}


@pytest.mark.parametrize("command", ["run", "sweep", "reproduce"])
def test_own_files_are_replaced(bands: Path, tmp_path: Path, command: str) -> None:
    out = tmp_path / "out"
    words = commands(bands, out)[command]
    assert main(words) == 0
    first = contents(out)
    assert main([*words, "--fresh"]) == 0
    assert contents(out).keys() == first.keys()
    for folder in ("cells", "runs"):  # the table alone shows that the folder is the kit's
        shutil.rmtree(out / folder, ignore_errors=True)
    assert main(words) == 0
    assert contents(out).keys() == first.keys()


def test_input_is_never_replaced_by_the_result(
    bands: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["run", str(bands), "--variant", "kit", "--features.cell", "10"]
    run = tmp_path / "run"
    assert main([*words, "--out", str(run)]) == 0
    mine = tmp_path / "mine"
    mine.mkdir()
    shutil.copy(run / "calibration.json", mine)
    before = {folder: contents(folder) for folder in (run, mine)}
    for folder, expected in ((mine, "is not the kit's file"), (run, "is read by --calibration")):
        capsys.readouterr()
        given = ["--calibration", str(folder / "calibration.json"), "--out", str(folder), "--fresh"]
        assert main([*words, *given]) == 2
        assert f"calibration.json: {expected}" in capsys.readouterr().err
        assert contents(folder) == before[folder]


def test_damaged_run_is_told_and_computed_again(
    bands: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    words = commands(bands, out)["run"]
    assert main(words) == 0
    poses, printed = (out / "poses.txt").read_bytes(), capsys.readouterr().out
    (out / "poses.txt").write_bytes(poses[:-5])
    (out / "metrics.json").unlink()
    assert main(words) == 0
    again = capsys.readouterr().out
    assert "note: poses.txt, metrics.json were missing or changed in" in " ".join(again.split())
    assert [line for line in printed.splitlines() if "bands" in line][1:2] == [
        line for line in again.splitlines() if "bands" in line
    ][1:2]
    assert (out / "poses.txt").read_bytes() == poses
    assert main(words) == 0
    assert "contains this run already" in capsys.readouterr().out


@pytest.mark.parametrize("command", ["sweep", "reproduce"])
def test_damaged_runs_of_a_table_are_told_and_computed_again(
    bands: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], command: str
) -> None:
    out = tmp_path / "out"
    words = commands(bands, out)[command]
    assert main(words) == 0
    table = next(out.glob("*.csv")).read_text(encoding="utf-8").split(",")[:7]
    (poses,) = out.rglob("poses.txt")
    whole = poses.read_bytes()
    poses.write_bytes(whole[: len(whole) // 2])
    capsys.readouterr()
    assert main(words) == 0
    printed = "".join(capsys.readouterr().out.split())
    assert f"note:poses.txtwasmissingorchangedin{poses.parent}".replace(" ", "") in printed
    assert poses.read_bytes() == whole
    assert next(out.glob("*.csv")).read_text(encoding="utf-8").split(",")[:7] == table


@pytest.mark.parametrize("command", ["run", "sweep", "reproduce"])
def test_unknown_backend_of_matplotlib_is_told_before_the_work(
    bands: Path, tmp_path: Path, command: str
) -> None:
    words = [sys.executable, "-m", "vo_lib", *commands(bands, tmp_path / "out")[command]]
    environ = {**os.environ, "MPLBACKEND": "nonsense"}
    done = subprocess.run(words, capture_output=True, text=True, env=environ, check=False)
    assert done.returncode == 2
    assert done.stderr == "vo: error: MPLBACKEND=nonsense: is no backend of Matplotlib; unset this variable\n"
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(("jobs", "note"), [("1", False), ("999", True)])
def test_jobs_are_at_most_the_runs(
    bands: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    jobs: str,
    note: bool,
) -> None:
    monkeypatch.setattr("vo_lib.commands.common.os.cpu_count", lambda: 1)
    words = commands(bands, tmp_path / "out")["reproduce"]
    words[words.index("--seeds") + 1] = "2"
    assert main([*words, "--jobs", jobs]) == 0
    printed = capsys.readouterr().out
    assert ("note: 2 processes, but this machine has 1 processor core" in " ".join(printed.split())) == note
    assert f"processes: {2 if note else 1}" in (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
