"""Cells that run the student's function on a frame: with a wrong answer their picture and numbers change."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import nbformat
import pytest
from test_notebooks import APPENDICES, CHAPTERS, complaints, execute, name, read

CALL = re.compile(r"own_or_library\(\s*(\w+),")
# The solutions under another name, in a cell that should run the student's function.
SOLUTION = re.compile(r"\bright\.(?!plot\()\w+\(|import (?:exercises|library) as right\b")
PICTURES = "image/png", "image/jpeg", "text/html"
# Wrong answers that show in the cell; for other functions, the first mistake that its check knows.
WRONG: dict[str, str] = {
    "suppress": "lambda corners, scores, most: np.argsort(-scores)",  # chapter 5: no box is dropped
    "precision_recall": "lambda scores, right, wanted: [np.cumsum(right) / len(right)] * 2",
    "sweep": "lambda sequence, matches, values: [0.5 + value / 1000 for value in values]",
    "shrunk": "lambda estimate, covariance: 0.5 * estimate",
    # On these frames all candidates have the norm 1, and the prior does not change the winner.
    "nearest": "lambda E, e_prev, k: np.argsort(np.abs(E.reshape(-1, 9) @ e_prev))[:k]",
    "select": "lambda E, set_index, errors, e_prev, k: int(np.argmin(np.abs(E.reshape(-1, 9) @ e_prev)))",
}


def own_functions(source: str) -> list[str]:
    """The functions that a cell takes from the student."""
    return CALL.findall(source)


def check_of(notebook: Any, function: str) -> tuple[str, str] | None:
    """The package of a chapter and the name of the check of a function; None without a check."""
    for cell in notebook.cells:
        found = re.search(rf"^(\w+)\.(\w+)\({function}\)$", cell.source, re.MULTILINE)
        if found and f"def {function}(" in cell.source:
            return found[1], found[2]
    return None


def other_answer(notebook: Any, function: str, wrong: bool) -> str:
    """Code that replaces a function of the notebook by a right or by a wrong answer."""
    if wrong and function in WRONG:
        return f"{function} = {WRONG[function]}"
    check = check_of(notebook, function)
    assert check, f"{function} has no check"
    chapter, exercise = check
    which = "[*exercise.answers.values()][0][0]" if wrong else "exercise.right"
    return f"from course.{chapter}.exercises import {exercise} as exercise\n{function} = {which}"


def with_answers(path: Path, folder: Path) -> tuple[Path, list[str]]:
    """A copy of a chapter in which each own cell runs again with right and wrong answers; its functions."""
    notebook = read(path)
    cells = []
    names = []
    for cell in notebook.cells:
        cells.append(cell)
        functions = own_functions(cell.source) if cell.cell_type == "code" else []
        if not functions:
            continue
        names.append(", ".join(functions))
        # The right answer comes last, so that the cells below work with its results.
        for wrong in (True, False):
            given = "\n".join(other_answer(notebook, each, wrong) for each in functions)
            cells.append(nbformat.v4.new_code_cell(f"{given}\n# again\n{cell.source}"))  # type: ignore[no-untyped-call]
        # What follows uses no answer, as in a fresh notebook.
        empty = "\n".join(f"def {each}(*inputs): ..." for each in functions)
        cells.append(nbformat.v4.new_code_cell(empty))  # type: ignore[no-untyped-call]
    notebook.cells = cells
    copy = folder / path.name
    nbformat.write(notebook, copy)  # type: ignore[no-untyped-call]
    return copy, names


def printed(cell: Any) -> str:
    return "".join(output.text for output in cell.outputs if output.output_type == "stream")


def drawn(cell: Any) -> list[str]:
    data = [output.get("data", {}) for output in cell.outputs]
    return [each[kind] for each in data for kind in PICTURES if kind in each]


@pytest.mark.slow
@pytest.mark.usefixtures("street")
@pytest.mark.parametrize("path", [*CHAPTERS, *APPENDICES], ids=name)
def test_a_wrong_function_changes_the_picture_and_the_numbers_of_its_cell(path: Path, tmp_path: Path) -> None:
    copy, names = with_answers(path, tmp_path)
    if not names:
        pytest.skip("no cell of this chapter runs a function of the student")
    notebook = execute(copy, tmp_path, short=True)
    assert complaints(notebook) == []
    again = [cell for cell in notebook.cells if "\n# again\n" in cell.source]
    for functions, wrong, right in zip(names, again[::2], again[1::2], strict=True):
        assert "library's function runs here" not in printed(right), functions
        assert printed(wrong) != printed(right), f"{functions}: the numbers are the same"
        assert not drawn(right) or drawn(wrong) != drawn(right), f"{functions}: the picture is the same"


def test_functions_of_own_cells_are_exercises() -> None:
    for path in [*CHAPTERS, *APPENDICES]:
        notebook = read(path)
        for cell in notebook.cells:
            for function in own_functions(cell.source):
                assert check_of(notebook, function), f"{path.name}: {function} has no check"


@pytest.mark.parametrize("path", [*CHAPTERS, *APPENDICES], ids=name)
def test_no_cell_calls_a_solution_by_another_name(path: Path) -> None:
    cells = [cell for cell in read(path).cells if cell.cell_type == "code"]
    assert [cell.source for cell in cells if SOLUTION.search(cell.source)] == []


def test_a_call_of_a_solution_is_found() -> None:
    for source in (
        "basis = right.null_space(right.rows(x_p, x_c))",
        "from course.ch02 import exercises as right",
        "values = [right.ten_constraints(E) for E in matrices]",
    ):
        assert SOLUTION.search(source), source
    for source in ("right.plot(depth, measured)", "right = library.rows(x_p, x_c)", "upright.rows(x)"):
        assert not SOLUTION.search(source), source
