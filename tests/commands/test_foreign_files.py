"""What the kit did not write it does not replace: each command, each file that it writes."""

from __future__ import annotations

import shlex
from pathlib import Path

import pytest
from conftest import write_bands

from vo_lib.commands import lab
from vo_lib.commands.cli import main

SMALL = "--features.cell 10"
COMMANDS = {
    "run": f"run BANDS --out OUT {SMALL} --video OUT/film.mp4 --view OUT/view.html",
    "run as published": "run BANDS --variant published --out OUT",
    "sweep": "sweep --sequence BANDS --seeds 1 --set features.cell=10,12 --set matching.levels=2,3 --out OUT",
    "compare": "compare RUN RUN --out OUT",
    "evaluate": "evaluate --truth TRUTH --estimate TRUTH --lengths 1 --step 1 --out OUT --plot OUT",
    "calibrate": "calibrate BANDS --out OUT/package.json",
    "reproduce": "reproduce --sequences BANDS --methods solution_selection --variant kit --seeds 1 --out OUT",
    "boxes": "boxes BANDS --out OUT",
    "lab": "lab --html OUT",
}


@pytest.fixture(scope="module")
def places(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """A sequence, its truth and a run of it."""
    base = tmp_path_factory.mktemp("foreign")
    bands = write_bands(base / "bands")
    assert main(["run", str(bands), "--out", str(base / "run"), *SMALL.split()]) == 0
    return {"BANDS": str(bands), "TRUTH": str(bands / "poses.txt"), "RUN": str(base / "run")}


def words(line: str, places: dict[str, str], out: Path) -> list[str]:
    for name, path in {**places, "OUT": str(out)}.items():
        line = line.replace(name, path)
    return shlex.split(line)


@pytest.fixture(autouse=True)
def one_notebook(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """`vo lab` has a notebook without cells, a text and a picture."""
    folder = tmp_path / "notebooks"
    (folder / "images").mkdir(parents=True)
    empty = '{"cells": [], "metadata": {}, "nbformat": 4, "nbformat_minor": 5}'
    (folder / lab.FIRST).write_text(empty, encoding="utf-8")
    (folder / "teaching.md").write_text("# Words\n", encoding="utf-8")
    (folder / "images" / "one.jpg").write_bytes(b"a picture")
    monkeypatch.setattr(lab, "NOTEBOOKS", folder)


MANY = ("reproduce", "sweep")  # files, a table for each of them
SLOW = (*MANY, "evaluate")  # draws twelve pictures for each of them


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.slow if name in SLOW else ()) for name in COMMANDS]
)
def test_a_file_that_the_kit_did_not_write_stays(
    places: dict[str, str], tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str
) -> None:
    out = tmp_path / "out"
    out.mkdir()
    line = words(COMMANDS[name], places, out)
    assert main(line) == 0
    written = [p.relative_to(out) for p in out.rglob("*") if p.is_file() and not p.name.startswith(".")]
    assert written
    assert main(line) == 0  # its own files it replaces
    for k, file in enumerate(written):
        folder = tmp_path / f"out{k}"
        (folder / file).parent.mkdir(parents=True)
        (folder / file).write_text("mine", encoding="utf-8")
        capsys.readouterr()
        # A run of many that cannot be written has failed; the others are done.
        of_many = name in MANY and file.parent != Path()
        assert main(words(COMMANDS[name], places, folder)) == (1 if of_many else 2)
        said = "".join("".join(capsys.readouterr()).split())
        assert str(file) in said
        assert (folder / file).read_text(encoding="utf-8") == "mine"
