"""Pages of the notebooks: formulas without a script, panels as pictures, nothing asked of a network."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

import nbformat
import pytest

from vo_lib.commands.lab_html import executed, page, portable, write_pages
from vo_lib.commands.mathml import FORMULA, to_mathml, with_mathml
from vo_lib.core.errors import DataError

NOTEBOOKS = Path(__file__).resolve().parents[2] / "notebooks"
TEXTS = sorted([*NOTEBOOKS.rglob("*.ipynb"), *NOTEBOOKS.glob("*.md")])


def words(path: Path) -> list[str]:
    if path.suffix == ".md":
        return [path.read_text(encoding="utf-8")]
    cells = nbformat.read(path, as_version=4).cells  # type: ignore[no-untyped-call]
    return [cell.source for cell in cells if cell.cell_type == "markdown"]


@pytest.mark.parametrize("path", TEXTS, ids=lambda path: path.name)
def test_every_formula_of_the_course_can_be_drawn(path: Path) -> None:
    for text in words(path):
        for code, display, inline in FORMULA.findall(text):
            if not code:
                ElementTree.fromstring(to_mathml(display or inline, block=bool(display)))


def test_scripts_fractions_and_tables_are_where_they_belong() -> None:
    inside = ElementTree.fromstring(to_mathml(r"x_c^\top \tfrac12 \hat P"))
    assert [part.tag for part in inside[0]] == ["msubsup", "mfrac", "mover"]
    assert ["".join(part.itertext()) for part in inside[0][0]] == ["x", "c", "⊤"]
    assert ["".join(part.itertext()) for part in inside[0][1]] == ["1", "2"]
    matrix = ElementTree.fromstring(to_mathml(r"\begin{pmatrix} a & b \\ c & d \end{pmatrix}"))
    assert [len(row) for row in matrix.iter("mtr")] == [2, 2]
    assert "translation of error" in to_mathml(r"\text{translation of error}")


def test_code_is_no_formula_and_unknown_commands_are_told() -> None:
    text = "cost `a$b$c` of $x$\n```\n$y$\n```"
    assert with_mathml(text) == text.replace("$x$", to_mathml("x"))
    with pytest.raises(ValueError, match=r"unheard"):
        to_mathml(r"\unheard x")
    with pytest.raises(ValueError, match="ends nothing"):
        to_mathml("x}")


def test_a_page_has_its_panel_as_a_picture_and_needs_no_network() -> None:
    lines = "import ipywidgets as w\nw.VBox([w.HTML('<b>told</b>'), w.Image(value=b'abc', format='jpeg')])"
    made = [
        nbformat.v4.new_markdown_cell("$x_c$ and [next](01_two.ipynb#part)"),  # type: ignore[no-untyped-call]
        nbformat.v4.new_code_cell(lines),  # type: ignore[no-untyped-call]
    ]
    notebook = executed(nbformat.v4.new_notebook(cells=made), NOTEBOOKS)  # type: ignore[no-untyped-call]
    written = page(notebook, "one")
    assert "<msub>" in written
    assert 'href="01_two.html#part"' in written
    assert "<b>told</b>" in written
    assert 'src="data:image/jpeg;base64,YWJj' in written
    assert "<script" not in written
    assert "http" not in written.replace("http-equiv", "")


def test_a_damaged_notebook_is_named_before_any_page_is_written(tmp_path: Path) -> None:
    (tmp_path / "in").mkdir()
    (tmp_path / "in" / "00_start_here.ipynb").write_text('{"cells": [', encoding="utf-8")
    with pytest.raises(DataError, match=r"00_start_here\.ipynb: is no notebook"):
        write_pages(tmp_path / "in", tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_a_page_names_no_folder_of_this_machine(tmp_path: Path) -> None:
    text = f"into {tmp_path}/data/kitti; detectors: none in {Path.home()}/models"
    assert portable(text, tmp_path) == "into ./data/kitti; detectors: none in ~/models"
