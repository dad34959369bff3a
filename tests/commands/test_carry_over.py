"""Answers of an older notebook in the current version of it."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest

from vo_lib.checkout import kit_subfolder
from vo_lib.commands.carry_over import ANOTHER, LEFT, carry_over

NOTEBOOKS = kit_subfolder("notebooks")
HEAD = "### Exercise 3.4 ★\n\nWrite it."
OPEN = 'def angle(a, b):\n    """The angle."""\n    ...\n\n\nch03.angle(angle)'
MINE = "import math\n\n\ndef angle(a, b):\n    return math.acos(dot(a, b))\n\n\nch03.angle(angle)"


def notebook(*sources: str) -> bytes:
    """A notebook of code cells, in which the student changed some."""
    cells = [{"cell_type": "markdown", "source": [HEAD]}]
    cells += [{"cell_type": "code", "source": source.splitlines(keepends=True)} for source in sources]
    return json.dumps({"cells": cells, "metadata": {}}).encode()


def carried(old: bytes, new: bytes) -> tuple[list[str], list[str]]:
    """The texts of the code cells of the new notebook, and the names of the answers."""
    content, as_code, as_comments = carry_over(old, new)
    cells = json.loads(content)["cells"]
    texts = ["".join(cell["source"]) for cell in cells if cell["cell_type"] == "code"]
    return texts, [*as_code, *(f"# {name}" for name in as_comments)]


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        # Another text around the answer, and another number of the exercise: the answer and its imports come.
        (
            MINE,
            f"a = 1\n\n\n{OPEN}",
            f"a = 1\n\n\n{MINE}",
        ),
        # A check with another name, of a function with the same name.
        (MINE.replace("ch03.angle", "ch03.turn"), OPEN, MINE),
        # A number, with the lines that lead to it.
        (
            "n = 3\nfactor = n**2\nch02.noise_factor(factor)",
            "factor = ...\nch02.noise_factor(factor)",
            "n = 3\nfactor = n**2\nch02.noise_factor(factor)",
        ),
        # Lines that the new notebook gives as well are not there twice.
        (
            "x = 1\nshare = x / 2\nch05.share(share)",
            "x = 1\nshare = ...\nch05.share(share)",
            "x = 1\nshare = x / 2\nch05.share(share)",
        ),
        # A check with data of the notebook.
        (
            "percent = 2.5\nch08.drift(percent, yours, street)",
            "percent = ...\nch08.drift(percent, mine, road)",
            "percent = 2.5\nch08.drift(percent, mine, road)",
        ),
    ],
)
def test_an_answer_is_carried_over(old: str, new: str, expected: str) -> None:
    (text,), (name,) = carried(notebook(old), notebook(new))
    assert text == expected
    compile(text, "cell", "exec")
    assert name in text


@pytest.mark.parametrize(
    ("old", "new"),
    [
        (OPEN, OPEN),  # not answered
        (MINE, MINE),  # the new one is answered already
        ("%timeit angle(1, 2)\nch03.angle(angle)", OPEN),
        ("x = 1", OPEN),
    ],
)
def test_nothing_else_is_carried_over(old: str, new: str) -> None:
    assert carry_over(notebook(old), notebook(new)) == (notebook(new), [], [])
    assert carry_over(b"no notebook", notebook(new)) == (notebook(new), [], [])
    assert carry_over(notebook(old), b"[]") == (b"[]", [], [])


def test_an_answer_with_other_arguments_is_a_comment() -> None:
    (text,), names = carried(notebook(MINE), notebook(OPEN.replace("(a, b)", "(a, b, unit)")))
    assert names == ["# angle"]
    assert text.startswith('def angle(a, b, unit):\n    """The angle."""\n    ...\n' + ANOTHER)
    assert "#     return math.acos(dot(a, b))" in text
    compile(text, "cell", "exec")


def test_an_answer_is_carried_with_the_functions_that_it_calls() -> None:
    own = "def dot(a, b):\n    return sum(a * b)\n\n\ndef unused():\n    return 1"
    (text,), _ = carried(notebook(own, MINE), notebook(OPEN))
    assert text.index("def dot(a, b):\n    return sum(a * b)") < text.index("def angle")
    assert "unused" not in text


BODY = "def angle(a, b):\n    return a - b"
CALL = "ch03.angle(angle)"
DONE = f"{BODY}\n\n\n{CALL}"


@pytest.mark.parametrize(
    ("old", "expected"),
    [
        ((f"%matplotlib inline\n{DONE}",), f"%matplotlib inline\n\n\n{DONE}"),
        ((f"!ls\n{DONE}",), f"!ls\n\n\n{DONE}"),
        ((f"{DONE}\nangle?",), f"{BODY}\n\n\nangle?\n\n\n{CALL}"),
        ((f"{DONE}\nprint(",), f"{BODY}\n\n\n# print(\n\n\n{CALL}"),
        ((f"print(\n{DONE}",), f"# print(\n\n\n{DONE}"),
        ((f"{BODY}\n{CALL}  # yes!",), DONE),
        ((f"{BODY}\nv = {CALL}",), DONE),
        ((f"{BODY}\nprint({CALL})",), DONE),
        ((BODY, CALL), DONE),
        ((BODY,), DONE),  # without a check
        ((f"# mine\n# because\n{DONE}",), f"# mine\n# because\n{DONE}"),
        ((f"angle = lambda a, b: a - b\n{CALL}",), f"angle = lambda a, b: a - b\n\n\n{CALL}"),
        (
            (DONE.replace("def angle", "def my_angle").replace("(angle)", "(my_angle)"),),
            f"{BODY.replace('angle', 'my_angle')}\n\n\nangle = my_angle\n\n\n{CALL}",
        ),
        ((DONE.replace("(a, b)", "(a: float, b: float) -> float"),), None),
    ],
)
def test_half_done_cells_are_carried_over(old: tuple[str, ...], expected: str | None) -> None:
    (text,), names = carried(notebook(*old), notebook(OPEN))
    assert text == (old[0] if expected is None else expected)
    assert names == ["angle"]


@pytest.mark.parametrize(
    ("old", "kept"),
    [
        ("factor: float = 16", "factor: float = 16"),
        ("# four squared\nfactor = 16", "# four squared\nfactor = 16"),
        ("x = 4\n# Your answer:\n# four squared\nfactor = x * x", "# four squared\nfactor = x * x"),
        ("factor = 16; x = 3", "factor = 16; x = 3"),
    ],
)
def test_numbers_come_with_their_comments(old: str, kept: str) -> None:
    new = "x = 4\n# Your answer:\nfactor = ...\nch02.noise(factor)"
    (text,), names = carried(notebook(f"{old}\nch02.noise(factor)"), notebook(new))
    assert text.startswith(f"x = 4\n# Your answer:\n{kept}\n")
    assert text.endswith("ch02.noise(factor)")
    assert names == ["factor"]


def test_a_cell_may_have_two_exercises() -> None:
    new = "a = ...\nch04.one(a)\nb = ...\nch04.two(b)"
    old = "a = 1\nch04.one(a)\nb = 2\nch04.two(b)"
    (text,), names = carried(notebook(old), notebook(new))
    here: dict[str, Any] = {"ch04": type("", (), {"one": print, "two": print})}
    exec(text, here)
    assert (here["a"], here["b"], names) == (1, 2, ["a", "b"])


def test_an_answer_that_is_no_python_is_a_comment() -> None:
    (text,), names = carried(notebook(DONE.replace("b):", "b)")), notebook(OPEN))
    assert names == ["# angle"]
    assert f"    ...\n{ANOTHER}\n# def angle(a, b)\n#     return a - b\n" in text
    compile(text, "cell", "exec")


def test_answers_to_exercises_that_are_gone_are_comments_at_the_end() -> None:
    gone = "# metres\nlength = 3\nch00.length(length)"
    function = "def gain(a):\n    return a\n\n\nch07.gain(gain)"
    old = notebook(gone, DONE, function)
    (text, last), names = carried(old, notebook(OPEN))
    assert text == DONE
    assert names == ["angle", "# length", "# gain"]
    assert last == f"{LEFT}\n\n# # metres\n# length = 3\n\n# def gain(a):\n#     return a"
    # They are there once, also after the next update; and a later answer is kept.
    newer = carry_over(old, notebook(OPEN)).content
    again = carry_over(old, newer)
    assert again == (newer, [], [])
    assert carried(notebook("rank = 3\nch04.rank(rank)"), notebook("rank = ...\nch04.other(rank)"))[1] == [
        "# rank"
    ]


def test_a_changed_function_of_the_notebook_is_not_lost() -> None:
    given = "def drive(a):\n    return a"
    new = notebook(given, "my_drive = ...\n\nch08.better(my_drive, street)")
    old = notebook(
        given.replace("return a", "return 2 * a"), "my_drive = drive\n\nch08.better(my_drive, street)"
    )
    (_, text), names = carried(old, new)
    assert names == ["my_drive", "# drive"]
    assert text.startswith("my_drive = drive\n")
    assert text.endswith(f"{ANOTHER}\n# def drive(a):\n#     return 2 * a")


@pytest.mark.parametrize("path", sorted(NOTEBOOKS.glob("*.ipynb")), ids=lambda path: path.stem)
def test_every_answer_of_the_solutions_is_carried_over(path: Path) -> None:
    """The functions and numbers of the real notebooks, by the names that their checks get."""
    solved = (NOTEBOOKS / "solutions" / path.name).read_bytes()
    content, as_code, as_comments = carry_over(solved, path.read_bytes())
    cells = [_source(cell) for cell in json.loads(path.read_bytes())["cells"] if cell["cell_type"] == "code"]
    calls = [
        name
        for text in cells
        for name in re.findall(r"^(?:ch\d\d|appendix)\.\w+\((\w+)[,)]", text, re.MULTILINE)
    ]
    expected = [name for name in calls if name != "my_drive"]  # in the solutions, a function
    assert as_code == expected
    assert as_comments == (["drive"] if "my_drive" in calls else [])
    for cell in json.loads(content)["cells"]:
        if cell["cell_type"] == "code":
            compile(_source(cell), path.name, "exec")


def _source(cell: dict[str, Any]) -> str:
    return "".join(cell["source"])
