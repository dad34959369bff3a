"""`vo lab` updates a copy of the course and keeps the reader's own changes."""

from __future__ import annotations

import json
import re
import shutil
import sys
from pathlib import Path

import pytest
from ipykernel.ipkernel import IPythonKernel
from jupyter_client.kernelspec import get_kernel_spec

from vo_lib.checkout import kit_subfolder
from vo_lib.commands import lab
from vo_lib.commands.cli import main
from vo_lib.commands.lab import FIRST_NOTEBOOK

LINK = re.compile(r"\]\((?!\w+://)([^)#\s]+)")


def files(folder: Path) -> set[str]:
    """Names of all files in a folder except caches and the files of `vo lab` itself."""
    own = {"__pycache__", lab.DIGESTS_FILE, lab.KIT_PYTHON}
    paths = [path.relative_to(folder) for path in folder.rglob("*") if path.is_file()]
    return {path.as_posix() for path in paths if not own & {*path.parts}}


def content(path: Path) -> bytes:
    """The content of a file; of a notebook, only its cells."""
    if path.suffix != ".ipynb":
        return path.read_bytes()
    return json.dumps(json.loads(path.read_bytes())["cells"]).encode()


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
    assert {FIRST_NOTEBOOK, "course/__init__.py", "images/jam.gif", "choices.csv"} < files(folder)
    assert [name for name in files(folder) if "solutions" in name or "teaching" in name] == []
    for path in [*folder.glob("*.ipynb"), *folder.glob("*.md")]:
        for link in LINK.findall(path.read_text(encoding="utf-8")):
            assert (folder / link).exists(), (path, link)
    assert "solutions (`vo lab --teacher`)" in (folder / FIRST_NOTEBOOK).read_text(encoding="utf-8")


def test_teacher_copy_has_all_course_files(
    tmp_path: Path, source: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copytree(kit_subfolder("notebooks"), source, dirs_exist_ok=True)
    for name in ("my_vo.py", "solutions/my_vo.py"):
        (source / name).touch()
    lab.copy_course(source, tmp_path / "class", teacher=True)
    assert files(source) - files(tmp_path / "class") == {"my_vo.py", "solutions/my_vo.py"}
    for name in files(tmp_path / "class"):
        assert content(tmp_path / "class" / name) == content(source / name)
    # A student's copy becomes a teacher's copy, which has links to the answers.
    for teacher in (False, True):
        lab.copy_course(source, tmp_path / "student", teacher)
    assert content(tmp_path / "student" / FIRST_NOTEBOOK) == content(source / FIRST_NOTEBOOK)
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


def test_modules_of_an_earlier_course_are_deleted(
    tmp_path: Path, source: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """An old notebook that imports one fails, instead of meeting old code beside new."""
    folder = source / "course" / "ch01"
    folder.mkdir()
    for name in ("gone", "changed", "stays"):
        (folder / f"{name}.py").write_text("first = 1", encoding="utf-8")
    mine = tmp_path / "mine"
    lab.copy_course(source, mine, teacher=False)
    (mine / "course" / "ch01" / "changed.py").write_text("mine = 1", encoding="utf-8")
    (mine / "course" / "own.py").write_text("mine = 1", encoding="utf-8")
    for name in ("gone", "changed"):
        (folder / f"{name}.py").unlink()
    (source / "course" / "a.py").write_text("second = 2", encoding="utf-8")
    (mine / "course" / "a.py").write_text("mine = 1", encoding="utf-8")
    for _ in range(2):
        lab.copy_course(source, mine, teacher=False)
        kept = {
            "course/a.py",
            "course/a.new.py",
            "course/own.py",
            "course/ch01/changed.py",
            "course/ch01/stays.py",
        }
        assert files(mine) == {"01.ipynb", *kept}
    assert (
        capsys.readouterr().out == "Your change of course/a.py is kept; the new version is course/a.new.py\n"
    )


def test_help_says_which_deleted_files_are_copied_again(
    tmp_path: Path, source: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    mine = tmp_path / "mine"
    lab.copy_course(source, mine, teacher=False)
    (mine / "course" / "a.py").write_text("changed = 1", encoding="utf-8")
    (source / "course" / "a.py").write_text("second = 2", encoding="utf-8")
    lab.copy_course(source, mine, teacher=False)
    assert files(mine) == {"01.ipynb", "course/a.py", "course/a.new.py"}
    for deleted in ("01.ipynb", "course/a.new.py"):
        (mine / deleted).unlink()
    lab.copy_course(source, mine, teacher=False)
    assert files(mine) == {"01.ipynb", "course/a.py"}
    capsys.readouterr()
    with pytest.raises(SystemExit):
        main(["lab", "--help"])
    help_text = " ".join(capsys.readouterr().out.split())
    assert "A file of the course that you deleted is copied again, but not a new version" in help_text


@pytest.mark.parametrize("digests", [None, "[", '{"01.ipynb": ["a"]}'])
def test_damaged_course_is_repaired(
    tmp_path: Path,
    source: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    digests: str | None,
) -> None:
    monkeypatch.setattr(lab, "kit_subfolder", lambda name: source)
    (source / FIRST_NOTEBOOK).write_text(notebook("start"), encoding="utf-8")
    mine = tmp_path / "mine"

    def start() -> str:
        with pytest.raises(SystemExit):
            main(["lab", "--copy", str(mine), "--", "--version"])
        return capsys.readouterr().out

    start()
    shutil.rmtree(mine / "course")
    (mine / FIRST_NOTEBOOK).unlink()
    (mine / lab.DIGESTS_FILE).unlink()
    (mine / "01.ipynb").write_text(notebook("changed"), encoding="utf-8")
    if digests is not None:
        (mine / lab.DIGESTS_FILE).write_text(digests, encoding="utf-8")
    assert "Your change of 01.ipynb is kept; the new version is 01.new.ipynb" in start()
    assert files(mine) == {"01.ipynb", "01.new.ipynb", "00_start_here.ipynb", "course/a.py"}
    assert (mine / "01.ipynb").read_text(encoding="utf-8") == notebook("changed")
    assert "Your change" not in start()


def test_executed_notebooks_are_updated(
    tmp_path: Path, source: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    mine = tmp_path / "mine" / "01.ipynb"
    run = notebook("first", count=3)
    lab.copy_course(source, mine.parent, teacher=False)
    for new, there in (("first", "first"), ("second", "second")):
        mine.write_text(run, encoding="utf-8")
        (source / mine.name).write_text(notebook(new), encoding="utf-8")
        lab.copy_course(source, mine.parent, teacher=False)
        (cell,) = json.loads(mine.read_text(encoding="utf-8"))["cells"]
        assert (cell["source"], cell["execution_count"]) == ([there], 3 if there == "first" else None)
    mine.unlink()
    lab.copy_course(source, mine.parent, teacher=False)
    assert content(mine) == content(source / mine.name)
    mine.write_text("no JSON", encoding="utf-8")  # also a change of the reader
    (source / mine.name).write_text(notebook("third"), encoding="utf-8")
    lab.copy_course(source, mine.parent, teacher=False)
    assert mine.read_text(encoding="utf-8") == "no JSON"
    assert capsys.readouterr().out.startswith("Your change of 01.ipynb is kept")


def test_a_new_notebook_has_the_answers_of_the_old_ones(
    tmp_path: Path, source: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Through two updates, also if the reader went on in the first new version."""
    mine = tmp_path / "mine"
    task = "factor = ...\nch00.ratio(factor)"
    (source / "01.ipynb").write_text(notebook(task), encoding="utf-8")
    lab.copy_course(source, mine, teacher=False)
    answered = notebook(task.replace("...", "4"))
    (mine / "01.ipynb").write_text(answered, encoding="utf-8")
    for update, place in (("# second", "01.new.ipynb"), ("# third", "01.new.ipynb")):
        (source / "01.ipynb").write_text(notebook(f"{update}\n{task}"), encoding="utf-8")
        lab.copy_course(source, mine, teacher=False)
        assert f"the new version is {place}, with your answers: factor" in " ".join(
            capsys.readouterr().out.split()
        )
        (cell,) = json.loads((mine / place).read_bytes())["cells"]
        assert "".join(cell["source"]) == f"{update}\nfactor = 4\nch00.ratio(factor)"
        lab.copy_course(source, mine, teacher=False)
        assert capsys.readouterr().out == ""
        assert (mine / "01.ipynb").read_text(encoding="utf-8") == answered
    (mine / "01.new.ipynb").write_text(notebook("# third\nfactor = 5\nch00.ratio(factor)"), encoding="utf-8")
    (source / "01.ipynb").write_text(notebook(f"# fourth\n{task}"), encoding="utf-8")
    lab.copy_course(source, mine, teacher=False)
    (cell,) = json.loads((mine / "01.new.new.ipynb").read_bytes())["cells"]
    assert "".join(cell["source"]) == "# fourth\nfactor = 5\nch00.ratio(factor)"
    assert "factor = 5" in (mine / "01.new.ipynb").read_text(encoding="utf-8")
    assert (mine / "01.ipynb").read_text(encoding="utf-8") == answered


def test_copies_have_the_metadata_that_jupyter_would_add(tmp_path: Path, source: Path) -> None:
    """Otherwise each notebook counts as changed as soon as it is open."""
    lab.copy_course(source, tmp_path / "mine", teacher=False)
    metadata = json.loads((tmp_path / "mine" / "01.ipynb").read_bytes())["metadata"]
    assert metadata["language_info"] == IPythonKernel.language_info
    spec = get_kernel_spec("python3")
    assert metadata["kernelspec"] == {
        "display_name": spec.display_name,
        "language": spec.language,
        "name": "python3",
    }


def test_copy_only_starts_no_server(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "course"
    assert main(["lab", "--copy-only", "--copy", str(folder)]) == 0
    printed = capsys.readouterr().out
    assert f"The course is in {folder}" in printed
    assert f"choose the kernel {sys.executable}" in printed
    assert FIRST_NOTEBOOK in files(folder)
    assert (folder / lab.KIT_PYTHON).read_text(encoding="utf-8") == f"{sys.executable}\n"


def test_root_is_refused_with_the_option_that_allows_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("os.geteuid", lambda: 0, raising=False)
    assert main(["lab", "--copy", str(tmp_path / "course")]) == 2
    assert "does not start as root unless it is told to: vo lab -- --allow-root" in capsys.readouterr().err
