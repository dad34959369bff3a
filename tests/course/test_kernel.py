"""A kernel without the kit is told in one sentence which Python to choose."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import venv
from pathlib import Path

import pytest

from vo_lib.checkout import kit_subfolder


@pytest.mark.parametrize("written", [True, False])
def test_a_python_without_the_kit_says_which_one_has_it(tmp_path: Path, written: bool) -> None:
    shutil.copytree(kit_subfolder("notebooks") / "course", tmp_path / "course")
    expected = "the kit's environment"
    if written:
        expected = "/home/anna/kit/.venv/bin/python"
        (tmp_path / ".kit_python").write_text(f"{expected}\n", encoding="utf-8")
    bare = [sys.executable, "-I", "-S", "-c", "import sys; sys.path.insert(0, sys.argv[1]); import course"]
    done = subprocess.run([*bare, str(tmp_path)], capture_output=True, text=True, check=False)
    last = done.stderr.strip().splitlines()[-1]
    assert "lacks the kit (vo_lib is missing)" in last
    assert f"choose the kernel of {expected}, or open the course with `vo lab`" in last


@pytest.fixture(scope="module")
def bare_python(tmp_path_factory: pytest.TempPathFactory) -> str:
    """The Python of an environment without any package."""
    folder = tmp_path_factory.mktemp("bare") / "environment"
    venv.create(folder, with_pip=False)
    return str(folder / ("Scripts/python.exe" if os.name == "nt" else "bin/python"))


@pytest.mark.parametrize("place", ["", "solutions"])
def test_the_first_cell_of_each_notebook_says_that_the_kit_is_missing(bare_python: str, place: str) -> None:
    folder = kit_subfolder("notebooks") / place
    notebooks = sorted(folder.glob("*.ipynb"))
    assert len(notebooks) == 11
    for notebook in notebooks:
        cells = json.loads(notebook.read_text(encoding="utf-8"))["cells"]
        source = "".join(next(cell["source"] for cell in cells if cell["cell_type"] == "code"))
        # In a kernel, the folder of the notebook is the first that is searched.
        done = subprocess.run(
            [bare_python, "-c", source], cwd=folder, capture_output=True, text=True, check=False
        )
        last = done.stderr.strip().splitlines()[-1]
        assert last.startswith("course.kernel.NoKit: The Python of this kernel, "), notebook.name
        assert "lacks the kit" in last
        assert "or open the course with `vo lab`." in last
