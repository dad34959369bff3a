"""A notebook of an older version, and a kernel without the kit, are told in one sentence."""

from __future__ import annotations

import importlib
import json
import os
import shutil
import subprocess
import sys
import venv
from pathlib import Path
from typing import Any

import nbformat
import pytest
from nbclient import NotebookClient

from vo_lib.checkout import kit_subfolder
from vo_lib.old_notebooks import FIRST_NOTEBOOK, explanation

OLD = [
    line.rsplit(" ", 1)
    for line in (Path(__file__).parent / "old_imports.txt").read_text(encoding="utf-8").splitlines()
    if not line.startswith("#")
]


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder of the course after an update, in which chapter 3 is of an older version."""
    monkeypatch.chdir(tmp_path)
    for name in (FIRST_NOTEBOOK, "03_solution_selection.ipynb", "03_solution_selection.new.ipynb"):
        (tmp_path / name).write_text("{}", encoding="utf-8")
    return tmp_path


@pytest.mark.parametrize("module_and_name", OLD, ids=" ".join)
def test_every_name_that_is_gone_leads_to_the_current_notebook(
    folder: Path, module_and_name: tuple[str, str]
) -> None:
    where, name = module_and_name
    error = _error_of(where, name)
    if error is None:  # the name is back, and there is nothing to tell
        return
    said = explanation(error, "03_solution_selection.ipynb")
    assert "03_solution_selection.ipynb is of an older version; open 03_solution_selection.new" in said
    assert "\n" not in said
    assert "03_solution_selection.new.ipynb" in explanation(error)  # also where the notebook is not known


def test_the_newest_of_several_new_notebooks_is_named(folder: Path) -> None:
    error = _error_of("course", "sketches")
    assert error is not None
    for name in ("04_translation.ipynb", "04_translation.new.ipynb", "04_translation.new.new.ipynb"):
        (folder / name).write_text("{}", encoding="utf-8")
    said = explanation(error)
    assert "one of 03_solution_selection.new.ipynb, 04_translation.new.new.ipynb" in said
    assert "--copy-only" not in said
    assert "open 04_translation.new.new.ipynb beside it" in explanation(error, "04_translation.ipynb")
    assert "open 04_translation.new.new.ipynb beside it" in explanation(error, "04_translation.new.ipynb")
    assert "--copy-only" in explanation(error, "05_yolo_box_filtering.ipynb")


def _error_of(where: str, name: str) -> BaseException | None:
    """The error of an import, or of an attribute of a module; None without one."""
    try:
        if where.endswith(" ."):
            getattr(importlib.import_module(where[:-2]), name)
        else:
            exec(f"from {where} import {name}", {})
    except (ImportError, AttributeError) as error:
        return error
    return None


@pytest.mark.parametrize(
    "line",
    ["import not_there", "from numpy import not_there", "''.not_there", "import numpy; numpy.not_there"],
)
def test_other_errors_are_not_explained(folder: Path, line: str) -> None:
    with pytest.raises((ImportError, AttributeError)) as caught:
        exec(line, {})
    assert explanation(caught.value) == ""


def errors(folder: Path, *sources: str, env: dict[str, str] | None = None) -> list[Any]:
    """The error outputs of cells that run in a kernel in a folder."""
    cells = [nbformat.v4.new_code_cell(source) for source in sources]  # type: ignore[no-untyped-call]
    notebook = nbformat.v4.new_notebook(cells=cells)  # type: ignore[no-untyped-call]
    where = {"metadata": {"path": str(folder)}}
    client = NotebookClient(notebook, timeout=120, allow_errors=True, resources=where)
    client.execute(**({} if env is None else {"env": env}))
    outputs = [output for cell in notebook.cells for output in cell.outputs]
    return [output for output in outputs if output.output_type == "error"]


def test_a_kernel_shows_one_sentence_and_still_fails(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    notebooks = kit_subfolder("notebooks")
    monkeypatch.setenv("PYTHONPATH", str(notebooks))
    monkeypatch.setenv("JPY_SESSION_NAME", str(folder / "03_solution_selection.ipynb"))
    imports = "from vo_lib.course.panels import x", "from course.lessons import selections", "1 / 0"
    first, second, last = errors(folder, *imports)
    for error in (first, second):
        (line,) = error.traceback
        assert "03_solution_selection.ipynb is of an older version; open 03_solution_selection.new" in line
    assert second.traceback[0].startswith("course.lessons")
    assert last.ename == "ZeroDivisionError"
    assert len(last.traceback) > 1


def test_elsewhere_the_usual_traceback_is_shown(tmp_path: Path) -> None:
    (error,) = errors(tmp_path, "from vo_lib.gone import x")
    assert len(error.traceback) > 1


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
