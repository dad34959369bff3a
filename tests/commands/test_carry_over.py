"""Answers of an older notebook in the current version of it."""

from __future__ import annotations

import json

import pytest

from vo_lib.commands.carry_over import ANOTHER, carry_over

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
    content, names = carry_over(old, new)
    cells = json.loads(content)["cells"]
    return ["".join(cell["source"]) for cell in cells if cell["cell_type"] == "code"], names


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
        ("rank = 3\nch04.rank(rank)", "rank = ...\nch04.other(rank)"),  # a variable of another exercise
        ("def angle(a, b)\n    return 1\n\n\nch03.angle(angle)", OPEN),  # cannot be read
        ("%timeit angle(1, 2)\nch03.angle(angle)", OPEN),
        ("x = 1", OPEN),
    ],
)
def test_nothing_else_is_carried_over(old: str, new: str) -> None:
    assert carry_over(notebook(old), notebook(new)) == (notebook(new), [])
    assert carry_over(b"no notebook", notebook(new)) == (notebook(new), [])
    assert carry_over(notebook(old), b"[]") == (b"[]", [])


def test_an_answer_with_other_arguments_is_a_comment() -> None:
    (text,), names = carried(notebook(MINE), notebook(OPEN.replace("(a, b)", "(a, b, unit)")))
    assert names == ["angle"]
    assert text.startswith('def angle(a, b, unit):\n    """The angle."""\n    ...\n' + ANOTHER)
    assert "#     return math.acos(dot(a, b))" in text
    compile(text, "cell", "exec")


def test_functions_of_ones_own_cells_come_with_the_answer_that_calls_them() -> None:
    own = "def dot(a, b):\n    return sum(a * b)\n\n\ndef unused():\n    return 1"
    (text,), _ = carried(notebook(own, MINE), notebook(OPEN))
    assert text.index("def dot(a, b):\n    return sum(a * b)") < text.index("def angle")
    assert "unused" not in text
