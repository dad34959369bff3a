"""`vo lab` updates a copy of the course and keeps the reader's own changes."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path

import pytest

from vo_lib.checkout import folder_of_checkout
from vo_lib.commands import lab
from vo_lib.commands.cli import main

LINK = re.compile(r"\]\((?!\w+://)([^)#\s]+)")


def files(folder: Path) -> set[str]:
    """Names of all files in a folder except caches and the file of digests."""
    paths = [path.relative_to(folder) for path in folder.rglob("*") if path.is_file()]
    return {path.as_posix() for path in paths if not {"__pycache__", lab.DIGESTS_FILE} & {*path.parts}}


def notebook(source: str, count: int | None = None) -> str:
    """Text of a notebook with one cell and an execution count."""
    cell = {"cell_type": "code", "source": [source], "execution_count": count}
    return json.dumps({"cells": [cell], "metadata": {}, "nbformat": 4, "nbformat_minor": 5})


@pytest.fixture
def source(tmp_path: Path) -> Path:
    """A small course."""
    folder = tmp_path / "source"
    (folder / "course").mkdir(parents=True)
    (folder / "01.ipynb").write_text(notebook("first"), encoding="utf-8")
    (folder / "course" / "a.py").write_text("first = 1", encoding="utf-8")
    return folder


def test_lab_copies_the_course(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("HOME", "USERPROFILE"):
        monkeypatch.setenv(name, str(tmp_path))
    with pytest.raises(SystemExit):
        main(["lab", "--", "--version"])
    folder = tmp_path / "stereo-vo-course"
    assert f"The course is in {folder.resolve()}" in capsys.readouterr().out
    assert {lab.FIRST_NOTEBOOK, "course/__init__.py", "images/jam.gif", "choices.csv"} < files(folder)
    assert [name for name in files(folder) if "solutions" in name or "teaching" in name] == []
    for path in [*folder.glob("*.ipynb"), *folder.glob("*.md")]:
        for link in LINK.findall(path.read_text(encoding="utf-8")):
            assert (folder / link).exists(), (path, link)
    assert "solutions (`vo lab --teacher`)" in (folder / lab.FIRST_NOTEBOOK).read_text(encoding="utf-8")


def test_teacher_copy_has_all_course_files(
    tmp_path: Path, source: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copytree(folder_of_checkout("notebooks"), source, dirs_exist_ok=True)
    for name in ("my_vo.py", "solutions/my_vo.py"):
        (source / name).touch()
    lab.copy_course(source, tmp_path / "class", teacher=True)
    assert files(source) - files(tmp_path / "class") == {"my_vo.py", "solutions/my_vo.py"}
    for name in files(tmp_path / "class"):
        assert (tmp_path / "class" / name).read_bytes() == (source / name).read_bytes()
    # A student's copy becomes a teacher's copy, which has links to the answers.
    for teacher in (False, True):
        lab.copy_course(source, tmp_path / "student", teacher)
    assert (tmp_path / "student" / lab.FIRST_NOTEBOOK).read_bytes() == (
        source / lab.FIRST_NOTEBOOK
    ).read_bytes()
    assert capsys.readouterr().out == ""


def test_changed_files_are_kept(tmp_path: Path, source: Path, capsys: pytest.CaptureFixture[str]) -> None:
    theirs, mine = source / "course" / "a.py", tmp_path / "mine" / "course" / "a.py"
    beside = mine.with_name("a.new.py")

    def update() -> str:
        lab.copy_course(source, tmp_path / "mine", teacher=False)
        return capsys.readouterr().out

    assert update() == ""
    mine.write_text("first", encoding="utf-8")  # a prefix of its source
    assert update() == ""
    for version in ("second = 2", "third = 3"):
        theirs.write_text(version, encoding="utf-8")
        assert update() == "Your change of course/a.py is kept; the new version is course/a.new.py\n"
        assert update() == ""
        assert beside.read_text(encoding="utf-8") == version
        assert mine.read_text(encoding="utf-8") == "first"


@pytest.mark.parametrize("digests", [None, "[", '{"01.ipynb": ["a"]}'])
def test_damaged_course_is_repaired(
    tmp_path: Path,
    source: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    digests: str | None,
) -> None:
    monkeypatch.setattr(lab, "folder_of_checkout", lambda name: source)
    (source / lab.FIRST_NOTEBOOK).write_text(notebook("start"), encoding="utf-8")
    mine = tmp_path / "mine"

    def start() -> str:
        with pytest.raises(SystemExit):
            main(["lab", "--copy", str(mine), "--", "--version"])
        return capsys.readouterr().out

    start()
    shutil.rmtree(mine / "course")
    (mine / lab.FIRST_NOTEBOOK).unlink()
    (mine / lab.DIGESTS_FILE).unlink()
    (mine / "01.ipynb").write_text(notebook("changed"), encoding="utf-8")
    if digests is not None:
        (mine / lab.DIGESTS_FILE).write_text(digests, encoding="utf-8")
    assert "Your change of 01.ipynb is kept; the new version is 01.new.ipynb\n" in start()
    assert files(mine) == {"01.ipynb", "01.new.ipynb", "00_start_here.ipynb", "course/a.py"}
    assert (mine / "01.ipynb").read_text(encoding="utf-8") == notebook("changed")
    assert "Your change" not in start()


def test_executed_notebooks_are_updated(
    tmp_path: Path, source: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    mine = tmp_path / "mine" / "01.ipynb"
    run = notebook("first", count=3)
    lab.copy_course(source, mine.parent, teacher=False)
    for new, there in (("first", run), ("second", notebook("second"))):
        mine.write_text(run, encoding="utf-8")
        (source / mine.name).write_text(notebook(new), encoding="utf-8")
        lab.copy_course(source, mine.parent, teacher=False)
        assert mine.read_text(encoding="utf-8") == there
    mine.unlink()
    lab.copy_course(source, mine.parent, teacher=False)
    assert mine.read_text(encoding="utf-8") == notebook("second")
    mine.write_text("no JSON", encoding="utf-8")  # also a change of the reader
    (source / mine.name).write_text(notebook("third"), encoding="utf-8")
    lab.copy_course(source, mine.parent, teacher=False)
    assert mine.read_text(encoding="utf-8") == "no JSON"
    assert capsys.readouterr().out.startswith("Your change of 01.ipynb is kept")
