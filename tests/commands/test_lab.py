"""`vo lab` copies the notebooks on demand, whole or not at all."""

from __future__ import annotations

from pathlib import Path

import pytest

from vo_lib.commands import lab
from vo_lib.commands.cli import main


def test_a_copy_keeps_the_students_files_and_heals_a_cut_one(tmp_path: Path) -> None:
    mine, cut = tmp_path / lab.FIRST, tmp_path / "teaching.md"
    mine.write_text("my own answers", encoding="utf-8")
    cut.write_bytes((lab.NOTEBOOKS / cut.name).read_bytes()[:100])
    assert lab.copy_notebooks(lab.NOTEBOOKS, tmp_path) == tmp_path.resolve()
    assert mine.read_text(encoding="utf-8") == "my own answers"
    assert cut.read_bytes() == (lab.NOTEBOOKS / cut.name).read_bytes()
    copied = {path.relative_to(tmp_path) for path in tmp_path.rglob("*.ipynb")}
    there = {path.relative_to(lab.NOTEBOOKS) for path in lab.NOTEBOOKS.rglob("*.ipynb")}
    assert copied == {path for path in there if ".ipynb_checkpoints" not in path.parts}
    assert len(copied) > 2


def test_a_full_disk_leaves_no_part_of_a_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(descriptor: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("vo_lib.files.os.fsync", full)
    assert main(["lab", "--copy", str(tmp_path)]) == 2
    assert [path for path in tmp_path.rglob("*") if path.is_file()] == []
