"""Pages of the notebooks: formulas without a script, panels as pictures, nothing asked of a network."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

import nbformat
import pytest

from vo_lib.commands.lab_html import FORMULA, SLIDES, executed, page, portable, with_mathml, write_pages
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
        for found in FORMULA.finditer(text):
            if not found.group(1):
                made = with_mathml(found.group())
                ElementTree.fromstring(made)
                assert "\\" not in made, found.group()


def test_code_is_no_formula_and_a_bar_ends_no_cell_of_a_table() -> None:
    text = "cost `a$b$c` of $x$\n```\n$y$\n```"
    assert with_mathml(text) == text.replace("$x$", with_mathml("$x$"))
    assert "<mi>x</mi>" in with_mathml("$x$")
    assert "|" not in with_mathml(r"$\lvert x\rvert$ and $|y|$")
    assert with_mathml("$x^2^3$") == "$x^2^3$"


def test_a_page_has_its_panel_as_a_picture_and_needs_no_network() -> None:
    lines = (
        "import ipywidgets as w\nslider = w.VBox([w.IntSlider(), w.HTML('its caption')])\n"
        "w.VBox([w.HTML('<b>told</b>'), w.HBox([slider]), w.Image(value=b'abc', format='jpeg')])"
    )
    made = [
        nbformat.v4.new_markdown_cell("$x_c$ and [next](01_two.ipynb#part)"),  # type: ignore[no-untyped-call]
        nbformat.v4.new_code_cell(lines),  # type: ignore[no-untyped-call]
    ]
    notebook = nbformat.v4.new_notebook(cells=made)  # type: ignore[no-untyped-call]
    assert executed(notebook, NOTEBOOKS) == {}
    written = page(notebook, "one")
    assert "<msub>" in written
    assert 'href="01_two.html#part"' in written
    assert "<b>told</b>" in written
    assert "its caption" not in written.split('class="panel"')[1]
    assert 'src="data:image/jpeg;base64,YWJj' in written
    assert "<script" not in written
    namespace = 'xmlns="http://www.w3.org/1998/Math/MathML"'  # a name, not an address to fetch
    assert "http" not in written.replace("http-equiv", "").replace(namespace, "")


def test_what_a_chapter_shows_becomes_files_for_slides_and_what_fails_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    lines = "from course import figure, show\nshow(figure(120)[0])"
    cells = [nbformat.v4.new_code_cell(lines), nbformat.v4.new_markdown_cell("[on](00_start_here.ipynb)")]  # type: ignore[no-untyped-call]
    cells.append(nbformat.v4.new_code_cell("1 / 0"))  # type: ignore[no-untyped-call]
    source = tmp_path / "in"
    (source / "solutions").mkdir(parents=True)
    (source / "course").symlink_to(NOTEBOOKS / "course")
    for place in ("00_start_here.ipynb", "solutions/00_start_here.ipynb"):
        nbformat.write(nbformat.v4.new_notebook(cells=cells), source / place)  # type: ignore[no-untyped-call]
    assert write_pages(source, tmp_path / "out") == 2
    assert "00_start_here.ipynb: cell 2 failed" in capsys.readouterr().out
    files = sorted(path.name for path in (tmp_path / "out" / SLIDES).glob("[!.]*"))
    assert files == ["00_start_here_01.png", "00_start_here_01a.svg"]
    assert "data:image/png" in (tmp_path / "out" / "00_start_here.html").read_text(encoding="utf-8")


def test_a_damaged_notebook_is_named_before_any_page_is_written(tmp_path: Path) -> None:
    (tmp_path / "in").mkdir()
    (tmp_path / "in" / "00_start_here.ipynb").write_text('{"cells": [', encoding="utf-8")
    with pytest.raises(DataError, match=r"00_start_here\.ipynb: is no notebook"):
        write_pages(tmp_path / "in", tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_a_page_names_no_folder_of_this_machine(tmp_path: Path) -> None:
    text = f"into {tmp_path}/data/kitti; detectors: none in {Path.home()}/models"
    assert portable(text, tmp_path) == "into ./data/kitti; detectors: none in ~/models"
