"""Commands replace only files that the kit wrote; the reader's files and inputs stay as they are."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
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


@pytest.mark.usefixtures("pictures_not_drawn")
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


@pytest.mark.usefixtures("pictures_not_drawn")
def test_a_damaged_run_is_computed_again_with_a_note(
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


@pytest.mark.usefixtures("pictures_not_drawn")
@pytest.mark.parametrize("command", ["sweep", "reproduce"])
def test_damaged_runs_of_a_table_are_computed_again_with_a_note(
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
def test_an_unknown_backend_of_matplotlib_is_refused_before_the_work(
    bands: Path, tmp_path: Path, command: str
) -> None:
    words = [sys.executable, "-m", "vo_lib", *commands(bands, tmp_path / "out")[command]]
    environ = {**os.environ, "MPLBACKEND": "nonsense"}
    done = subprocess.run(words, capture_output=True, text=True, env=environ, check=False)
    assert done.returncode == 2
    assert done.stderr == "vo: error: MPLBACKEND=nonsense: is no backend of Matplotlib; unset this variable\n"
    assert not (tmp_path / "out").exists()


@pytest.mark.usefixtures("pictures_not_drawn")
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


def test_film_of_somebody_else_is_kept(
    bands: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    film = tmp_path / "drive.webm"
    film.write_bytes(b"a recording")
    words = [*commands(bands, tmp_path / "out")["run"], "--video", str(film)]
    assert main(words) == 2
    assert "drive.webm: is not a film of the kit: choose another name" in capsys.readouterr().err
    assert film.read_bytes() == b"a recording"
    assert not (tmp_path / "out").exists()
    film.unlink()
    for _ in range(2):  # its own film is replaced
        assert main(words) == 0
    assert cv2.VideoCapture(str(film)).get(cv2.CAP_PROP_FRAME_COUNT) == 5


def test_film_of_somebody_else_is_kept_beside_a_finished_run(
    bands: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = commands(bands, tmp_path / "out")["run"]
    assert main(run) == 0
    film = tmp_path / "out" / "mine.webm"
    film.write_bytes(b"a recording")
    assert main([*run, "--video", str(film)]) == 2
    assert "mine.webm: is not a film of the kit: choose another name" in capsys.readouterr().err
    assert film.read_bytes() == b"a recording"


def test_film_of_somebody_else_is_refused_before_the_runs_of_a_table(
    bands: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    table = [*commands(bands, tmp_path / "out")["reproduce"], "--methods", "feature_selection"]
    assert main(table) == 0
    (config,) = (tmp_path / "out" / "runs").rglob("config.json")
    film = config.with_name("film.webm")
    film.write_bytes(b"a recording")
    before = contents(tmp_path / "out")
    assert main([*table, "--films"]) == 2
    assert "film.webm: is not a film of the kit: choose another name" in capsys.readouterr().err
    assert contents(tmp_path / "out") == before


@pytest.mark.usefixtures("pictures_not_drawn")
@pytest.mark.parametrize(
    "names", [("x_y", "x y"), ("街道", "山路"), ("Road", "road"), ("a__b", "a_b"), ("é", "_")]
)
def test_sequences_whose_results_would_share_files_are_refused(
    bands: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], names: tuple[str, str]
) -> None:
    folders = [Path(shutil.copytree(bands, tmp_path / "own" / name)) for name in names]
    shared = ["--sequences", ",".join(map(str, folders)), "--seeds", "1", "--out", str(tmp_path / "out")]
    table = ["reproduce", "--methods", "mesvo_f", "--variant", "published"]
    sweep = ["sweep", "--method", "mesvo_f", "--set", "selection.sets=5"]
    for command in (table, sweep):
        assert main([*command, *shared]) == 2
        error = " ".join(capsys.readouterr().err.split())
        assert f"the results of {names[0]} and {names[1]} would have the same name" in error
        assert not (tmp_path / "out").exists()


def test_data_set_of_somebody_else_is_kept(
    bands: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "set"
    for split in ("train", "valid"):
        for kind in ("images", "labels"):
            (folder / split / kind).mkdir(parents=True)
    shutil.copy(bands / "image_0" / "000000.png", folder / "train" / "images")
    shutil.copy(bands / "image_0" / "000000.png", folder / "valid" / "images")
    for split in ("train", "valid"):
        (folder / split / "labels" / "000000.txt").write_text("0 0.5 0.5 0.1 0.1\n", encoding="utf-8")
    text = "train: train/images\nval: valid/images\nnames: [car]\n"
    (folder / "data.yaml").write_text(text, encoding="utf-8")
    before = contents(folder)
    for words in (
        ["data", "train_detector", str(folder), "--out", str(folder)],
        ["data", "make_detection_set", str(folder)],
    ):
        assert main(words) == 2
        assert f"{folder / 'data.yaml'}: is not the kit's file" in capsys.readouterr().err
        assert contents(folder) == before


@pytest.mark.usefixtures("pictures_not_drawn")
@pytest.mark.parametrize("variant", [[], ["--variant", "kit"]], ids=["published", "kit"])
@pytest.mark.parametrize("exchange", [False, True])
def test_exchanged_cameras_are_named(
    bands: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    variant: list[str],
    exchange: bool,
) -> None:
    if exchange:
        (bands / "image_0").rename(bands / "image_2")
        (bands / "image_1").rename(bands / "image_0")
        (bands / "image_2").rename(bands / "image_1")
    assert main(["run", str(bands), "--out", str(tmp_path / "run"), *variant]) == 0
    sentence = "the cameras are exchanged, so exchange the left and the right images"
    assert (sentence in " ".join(capsys.readouterr().out.split())) == exchange
    if variant == []:  # the table is one of variant published
        assert main(commands(bands, tmp_path / "table")["reproduce"]) == 0
        assert " ".join(capsys.readouterr().out.split()).count(sentence) == int(exchange)


def test_dark_images_are_not_called_exchanged(
    bands: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for path in bands.rglob("*.png"):
        cv2.imwrite(str(path), np.zeros((240, 480), np.uint8))
    assert main(["run", str(bands), "--out", str(tmp_path / "run")]) == 0
    assert "exchanged" not in capsys.readouterr().out
