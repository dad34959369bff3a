"""Pages of the notebooks: formulas without a script, panels as pictures, no network access."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from xml.etree import ElementTree

import nbformat
import pytest

from course import pages
from course.minutes import FOLDED
from course.notebook_folder import NOTEBOOKS
from course.pages import FORMULA, read, with_mathml

PANEL = """import ipywidgets as w
slider = w.VBox([w.IntSlider(), w.HTML('its caption')])
w.VBox([w.HTML('<b>told</b>'), w.HBox([slider]), w.Image(value=b'abc', format='jpeg')])"""

PICTURE = """import cv2, numpy as np
from IPython.display import Image
Image(cv2.imencode('.png', np.zeros((2, 2)))[1].tobytes())"""


@pytest.mark.parametrize(
    "path", [*NOTEBOOKS.rglob("*.ipynb"), *NOTEBOOKS.glob("*.md")], ids=lambda path: path.name
)
def test_every_formula_of_the_course_can_be_drawn(path: Path) -> None:
    for cell in read(path).cells:
        for formula in FORMULA.finditer(cell.source if cell.cell_type == "markdown" else ""):
            if not formula.group(1):
                made = with_mathml(formula.group())
                ElementTree.fromstring(made)
                assert "\\" not in made, formula.group()


def test_pages_need_no_network_and_name_broken_notebooks(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(pages, "NOTEBOOKS", tmp_path)
    monkeypatch.setattr(sys, "argv", ["pages", str(tmp_path / "out")])
    cells = [nbformat.v4.new_code_cell(lines) for lines in (PANEL, "1 / 0", PICTURE)]  # type: ignore[no-untyped-call]
    cells.insert(2, nbformat.v4.new_markdown_cell("# [A *part*](x.ipynb)\nText. So it *looks*:"))  # type: ignore[no-untyped-call]
    cells.append(nbformat.v4.new_markdown_cell("$x_c$ and [next](01_two.ipynb#part)\n\n## The point $y_c$"))  # type: ignore[no-untyped-call]
    cells.append(nbformat.v4.new_markdown_cell("### A proof\nWhy.", metadata={FOLDED: True}))  # type: ignore[no-untyped-call]
    nbformat.write(nbformat.v4.new_notebook(cells=cells), tmp_path / "00_one.ipynb")  # type: ignore[no-untyped-call]
    (tmp_path / "table.csv").write_text("a,b\n", encoding="utf-8")
    assert pages.main() == 1
    assert (tmp_path / "out" / "table.csv").read_text(encoding="utf-8") == "a,b\n"
    assert "00_one.ipynb: cell 1 failed" in capsys.readouterr().out
    written = (tmp_path / "out" / "00_one.html").read_text(encoding="utf-8")
    assert "<msub><mi>x</mi><mi>c</mi></msub>" in written
    assert "<msub><mi>y</mi>" in written.split("<h2", 1)[1].split("</h2>")[0]
    assert "formula0" not in written
    assert 'href="01_two.html#part"' in written
    assert "<b>told</b>" in written
    assert "A proof <em>(optional)</em>" in written
    assert "its caption" not in written.split('class="panel"')[1]
    assert 'src="data:image/jpeg;base64,YWJj' in written
    assert re.findall('alt="(.*?)"', written) == ["Panel: told", "So it looks"]
    assert "<script" not in written
    namespace = 'xmlns="http://www.w3.org/1998/Math/MathML"'  # a name, not an address to fetch
    assert "http" not in written.replace("http-equiv", "").replace(namespace, "")
    (tmp_path / "00_one.ipynb").write_text('{"cells": [', encoding="utf-8")
    assert pages.main() == 2
    assert "00_one.ipynb: is not a notebook" in capsys.readouterr().err
