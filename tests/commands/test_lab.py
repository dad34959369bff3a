"""`vo lab` finds the notebooks, copies them when asked, and says clearly what is missing."""

from __future__ import annotations

from pathlib import Path

import pytest

from vo_lib import DataError
from vo_lib.commands import lab
from vo_lib.commands.cli import main


def test_a_copy_keeps_what_the_reader_wrote(tmp_path: Path) -> None:
    mine = tmp_path / "mine"
    mine.mkdir()
    (mine / lab.FIRST).write_text("my own answers", encoding="utf-8")
    assert lab.copy_notebooks(lab.NOTEBOOKS, mine) == mine.resolve()
    assert (mine / lab.FIRST).read_text(encoding="utf-8") == "my own answers"
    copied = {path.relative_to(mine) for path in mine.rglob("*.ipynb")}
    there = {path.relative_to(lab.NOTEBOOKS) for path in lab.NOTEBOOKS.rglob("*.ipynb")}
    assert copied == {path for path in there if ".ipynb_checkpoints" not in path.parts}
    assert len(copied) > 2


def test_a_place_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("", encoding="utf-8")
    with pytest.raises(DataError, match="cannot be copied"):
        lab.copy_notebooks(lab.NOTEBOOKS, tmp_path / "file" / "copy")


def test_missing_notebooks_are_one_clear_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(lab, "NOTEBOOKS", tmp_path / "nowhere")
    assert main(["lab"]) == 2
    error = capsys.readouterr().err
    assert "00_start_here.ipynb" in error
    assert len(error.splitlines()) == 1


def test_what_stands_behind_two_dashes_goes_to_jupyter(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as end:
        main(["lab", "--", "--version"])
    assert end.value.code == 0
    assert "JupyterLab opens" in capsys.readouterr().out
