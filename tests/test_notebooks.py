"""Every notebook runs from top to bottom without an error, on three sequences, and has no stored outputs."""

from __future__ import annotations

import os
import re
import shutil
from pathlib import Path
from typing import Any

import nbclient
import nbformat
import pytest
from conftest import find_browser
from real_images import RealImages

from course.ch08 import own
from course.minutes import FOLDED
from course.panel import ERROR_CLASS
from course.results import NOT_YET_CLASS, RIGHT_CLASS
from vo_lib.data.sequence import Sequence

FOLDER = Path(__file__).resolve().parents[1] / "notebooks"
CHAPTERS = sorted(FOLDER.glob("[0-9]*.ipynb"))
APPENDICES = sorted(FOLDER.glob("appendix_*.ipynb"))
SOLUTIONS = sorted((FOLDER / "solutions").glob("*.ipynb"))
WIDGETS = "application/vnd.jupyter.widget-state+json"
STREET = "synthetic/traffic"  # the sequence that the notebooks load
UNTRUE_FRAMES = 54  # length of the shortest drive in the notebooks
CELL_TIMEOUT_S = 300
# Fewer seeds and frames, for the further runs of a chapter that runs as it is on the drawn street.
SHORTER = {
    '"boxes kept": (), "truck removed": (1,), "van removed": (4,)': '"boxes kept": ()',  # chapter 0: runs
    "same = np.zeros((20, 5))": "same = np.zeros((4, 2))",  # chapter 3: frames, seeds
    "errors_by_seed(scenes, 10, 3, bar)": "errors_by_seed(scenes, 3, 1, bar)",
    "for seed in range(6):": "for seed in range(2):",
    "REPEATS = range(5)": "REPEATS = range(2)",  # chapter 5: seeds, and steps of the training
    "STEPS = 1200": "STEPS = 40",
    "SEEDS = range(5)": "SEEDS = range(2)",  # chapter 6
    "clip(185, detector, report)": "clip(201, detector, report, 0)",  # chapter 7: the frames of chapter 8
    "sixty = part_of(chosen, 60)": "sixty = part_of(chosen, 30)",
    "tuple(methods), 3,": "tuple(methods), 2,",  # seeds
    "seeds=(0, 1, 2)": "seeds=(0,)",  # chapter 8
    "every=10)": "every=40)",  # frames of the film
}


def name(path: Path) -> str:
    return f"{path.parent.name}/{path.stem}"


def read(path: Path) -> Any:
    return nbformat.read(path, as_version=4)  # type: ignore[no-untyped-call]


def outputs(notebook: Any) -> list[Any]:
    return [output for cell in notebook.cells for output in cell.get("outputs", [])]


def complaints(notebook: Any) -> list[str]:
    """Errors in the outputs of the cells and, for panels, in the saved widget state."""
    states = notebook.metadata.get("widgets", {}).get(WIDGETS, {}).get("state", {}).values()
    widget_outputs = [output for state in states for output in state["state"].get("outputs", [])]
    result = []
    for output in [*outputs(notebook), *widget_outputs]:
        if output["output_type"] == "error":
            result.append(f"{output['ename']}: {output['evalue']}")
        if output["output_type"] == "stream" and output["name"] == "stderr":
            result.append(output["text"])
    texts = [str(state["state"].get("value", "")) for state in states]
    return result + [text for text in texts if ERROR_CLASS in text]


def verdicts(notebook: Any) -> list[str]:
    """Verdicts of the exercises as HTML."""
    pages = [output.get("data", {}).get("text/html", "") for output in outputs(notebook)]
    return [page for page in pages if RIGHT_CLASS in page or NOT_YET_CLASS in page]


def execute(path: Path, folder: Path, sequence: str = STREET, short: bool = False, **environment: str) -> Any:
    """The notebook with outputs and widget state after a run in a folder.

    sequence : the sequence in place of the street. short : whether the changes `SHORTER` are made.
    """
    notebook = read(path)
    changes = {f'load("{STREET}")': f"load({sequence!r})"}
    if sequence != STREET:
        changes['other = ""'] = f"other = {sequence!r}"  # of chapter 9
    if short:
        changes |= SHORTER
    for cell in notebook.cells:
        for old, new in changes.items():
            cell.source = cell.source.replace(old, new)
    where = {"metadata": {"path": str(folder)}}
    client = nbclient.NotebookClient(notebook, timeout=CELL_TIMEOUT_S, allow_errors=True, resources=where)
    paths = [str(FOLDER), os.environ.get("PYTHONPATH", "")]
    client.execute(env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, paths)), **environment})
    return notebook


def require_right(path: Path, folder: Path) -> None:
    """Require that all answers of a notebook of solutions are right."""
    notebook = execute(path, folder)
    assert complaints(notebook) == []
    judged = verdicts(notebook)
    assert len(judged) >= (2 if path.stem.startswith("appendix") else 4)
    assert [verdict for verdict in judged if RIGHT_CLASS not in verdict] == []


@pytest.mark.slow
@pytest.mark.usefixtures("street")
def test_right_answers_of_chapters_0_to_6_form_an_odometry_in_chapter_8(tmp_path: Path) -> None:
    (tmp_path / "00_start_here.ipynb").touch()  # the mark of a folder in which answers are saved
    for path in SOLUTIONS[:7]:
        require_right(path, tmp_path)
    notebook = execute(CHAPTERS[8], tmp_path, short=True)
    assert complaints(notebook) == []
    assert "every stage of this odometry is yours" in verdicts(notebook)[0]
    pages = [output.get("data", {}).get("text/html", "") for output in outputs(notebook)]
    joined = next(page for page in pages if "whose" in page)
    assert joined.count("<td>yours") == len(own.STAGES)  # perhaps "yours, slow: …"
    board = next(page for page in pages if "Errors on " in page)
    assert ">yours<" in board
    assert any("<video" in page for page in pages)
    assert (tmp_path / "my_path.webm").stat().st_size > 100_000


@pytest.mark.slow
@pytest.mark.usefixtures("street")
@pytest.mark.parametrize("path", SOLUTIONS[7:], ids=name)
def test_other_right_answers_of_a_chapter_pass(path: Path, tmp_path: Path) -> None:
    require_right(path, tmp_path)


@pytest.mark.slow
@pytest.mark.usefixtures("street")
@pytest.mark.parametrize("path", [*CHAPTERS, *APPENDICES], ids=name)
def test_chapters_run_on_kitti(path: Path, real: RealImages, tmp_path: Path) -> None:
    sequence, root = real.any_part()
    assert complaints(execute(path, tmp_path, sequence, short=True, KITTI_ROOT=str(root))) == []


@pytest.mark.slow
@pytest.mark.parametrize("path", [*CHAPTERS, *APPENDICES], ids=name)
def test_chapters_run_without_truth(path: Path, street: Sequence, tmp_path: Path) -> None:
    late = [f"{number:06d}.*" for number in range(UNTRUE_FRAMES, len(street))]
    missing = shutil.ignore_patterns("poses.txt", "truth", *late)
    folder = shutil.copytree(street.folder, tmp_path / "street", ignore=missing, copy_function=os.symlink)
    assert complaints(execute(path, tmp_path, str(folder), short=True, KITTI_ROOT="")) == []


@pytest.mark.slow
@pytest.mark.skipif(find_browser() is not None, reason="test_browser.py runs these notebooks in a browser")
@pytest.mark.usefixtures("street")
@pytest.mark.parametrize("path", [*CHAPTERS, *APPENDICES], ids=name)
def test_chapters_run_without_a_browser(path: Path, tmp_path: Path) -> None:
    notebook = execute(path, tmp_path, KITTI_ROOT="")
    assert complaints(notebook) == []
    assert [verdict for verdict in verdicts(notebook) if RIGHT_CLASS in verdict] == []


@pytest.mark.parametrize("path", [*CHAPTERS, *APPENDICES, *SOLUTIONS], ids=name)
def test_notebooks_have_no_outputs_and_valid_links(path: Path) -> None:
    notebook = read(path)
    nbformat.validate(notebook)
    assert set(notebook.metadata) <= {"kernelspec", "language_info"}
    assert notebook.metadata["kernelspec"]["name"] == "python3"
    for cell in notebook.cells:
        assert set(cell.metadata) <= {FOLDED}  # where, is the matter of tests/course/test_minutes.py
        assert cell.get("outputs", []) == []
        assert cell.get("execution_count") is None
        assert cell.source.strip()
    prose = "\n".join(cell.source for cell in notebook.cells if cell.cell_type == "markdown")
    links = [link for link in re.findall(r"\]\(([^)\s]+)\)", prose) if "://" not in link]
    for link in links:
        assert (path.parent / link.split("#")[0]).exists(), link
    assert any(link.endswith(".ipynb") for link in links)


def test_every_chapter_has_solutions() -> None:
    assert [path.name for path in SOLUTIONS] == [path.name for path in sorted(FOLDER.glob("*.ipynb"))]


def test_shorter_runs_change_one_place_each() -> None:
    source = "\n".join(cell.source for path in CHAPTERS for cell in read(path).cells)
    assert [old for old in SHORTER if source.count(old) != 1] == []


def test_complaints_include_errors_of_panels(tmp_path: Path) -> None:
    panel = "from course.ch00 import StartPanel\nStartPanel('nowhere').wait()"
    cell = nbformat.v4.new_code_cell(panel)  # type: ignore[no-untyped-call]
    broken = tmp_path / "broken.ipynb"
    nbformat.write(nbformat.v4.new_notebook(cells=[cell]), broken)  # type: ignore[no-untyped-call]
    assert "nowhere" in "".join(complaints(execute(broken, tmp_path)))
