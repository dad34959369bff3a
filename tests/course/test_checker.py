"""The checker of the exercises: one test per verdict, and the saved functions."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from course.ch02 import exercises as ch02
from course.checker import SLIPS, Condition, Exercise, in_order
from course.results import NOT_YET, NOT_YET_CLASS
from course.stored_answers import HEAD, library_call_in, load_functions, store_answer
from vo_lib.paper.five_point import null_space as other_name


def table(right: Any, *more: Any, twice: Any = -1, odd: Any = -3, **options: Any) -> Exercise:
    """An exercise with two known mistakes, defined by a wrong answer or by a test."""
    mistakes = {"twice: {got:g}.": twice, "odd.": odd}
    words = {"praise": "well done, {got}.", "hint": "try."}
    return Exercise(right, *more, mistakes=mistakes, **{**words, **options})


def square(x: float) -> float:
    return x**2


def both(x: float) -> tuple[float, float]:
    return x + 1.0, x - 1.0


def begun(x: float) -> None: ...


def numbers() -> list[tuple[Any, ...]]:
    return [(0.0,), (2.0,), (3.0,)]


def ones(*shape: int) -> Any:
    return lambda: [(np.ones(shape),)]


def same(A: Any) -> Any:
    return 1.0 * A


SQUARE = table(square, numbers, twice=lambda x: 2.0 * x, odd=lambda x: x**3, library=["square"], line="x**2")
MINUS = table(both, numbers, parts=("a", "b"), twice=lambda x: (2 * x + 2.0, x - 1.0), odd=lambda x: (x, 5.0))
VALUE = table(lambda given: given + 1, rtol=0.1, twice=lambda given: 2 * given)
FACTS = table({"got": 3.0}, twice=lambda f: f["got"] == 2, odd=lambda f: f["got"] == 9)
MATRIX = table(same, ones(2, 3))
ORDER = table(np.argsort, lambda: [(np.array([3.0, 1.0, 2.0]),)], also=(lambda a: [0, 1],), form=in_order)
STOPS = table(lambda x: None if x else 1.0, numbers, odd=lambda x: [1.0][int(x)])
SPOILT = table(lambda kept, spoiled: len(spoiled), lambda: [(np.zeros(2), [np.zeros(3)])] * 2)
IS_SEVEN = Condition(lambda got, x: got == 7)
IS_EIGHT = Condition(lambda got, x: got == 8)
EITHER = table(square, numbers, odd=(IS_SEVEN, IS_EIGHT))
EITHER_FACT = table(
    {"got": 3.0}, twice=lambda f: False, odd=(lambda f: f["got"] == 7, lambda f: f["got"] == 8)
)
# In addition to the bank of wrong answers.
VERDICTS: list[tuple[Exercise, tuple[Any, ...], str]] = [
    (SQUARE, (square,), "right: well done, 0.0."),
    # 2 x is right for 0 and 2, x³ for 0 only: the mistake that agrees for longest is named.
    (SQUARE, (lambda x: 2.0 * x,), "not yet: twice: 6."),
    (SQUARE, (lambda x: x + 2.0,), "not yet: the result is 2, expected 0 for x = 0. Hint: try."),
    (SQUARE, (lambda x: 0.0,), "the same for all inputs"),
    (SQUARE, (begun,), "there is no answer: replace the dots."),
    (SQUARE, (lambda x: sum(np.square(y) for y in [x]),), "hands the work to `square`"),
    (SQUARE, (lambda x: square(x),), "right: "),  # a student's function may have this name
    (VALUE, (11.5, 10), "right: "),
    (VALUE, (20, 10), "not yet: twice: 20."),
    (VALUE, (15, 10), "not yet: 15 is wrong. Hint: try."),
    (FACTS, ({"got": 3.0},), "right: "),
    (FACTS, ({"got": 2.0},), "twice: 2."),
    (FACTS, ({},), "the panel shows no numbers"),
    (MINUS, (lambda x: (y for y in both(x)),), "right: "),
    (MINUS, (lambda x: (2 * x + 2.0, 77.0),), "twice: 2."),
    (MINUS, (lambda x: (x + 1.0, 9.0),), "b is 9, expected -1 for x = 0"),
    (MATRIX, (lambda A: A @ A,), "A @ A"),
    (MATRIX, (lambda A: 3 * A,), "is [[3, 3, 3], [3, 3, 3]], expected [[1, 1, 1], [1, 1, 1]] for A ="),
    (
        table(same, ones(4, 3)),
        (lambda A: A + np.eye(4, 3, -1),),
        "3 of 12 numbers wrong: at [1, 0] it is 2, exp",
    ),
    (ORDER, (lambda a: [2, 0, 1],), "right: "),
    (ORDER, (lambda a: [1, 0],), "right: "),
    (ORDER, (lambda a: [2, 2],), "is [2, 2], expected [1, 2, 0]"),
    (
        table(lambda a: np.arange(9), ones(1)),
        (lambda a: [*range(8), 77],),
        "has 1 of 9 indices wrong (for example 77).",
    ),
    (STOPS, (lambda x: {0.0: 1.0}.get(x) or [].pop(),), "odd."),
    (STOPS, (lambda x: 1.0,), "expected None for x = 2"),
    (table(square, numbers, odd=Condition(lambda *case: 1 / 0)), (lambda x: 7.0,), "ZeroDivisionError"),
    (EITHER, (lambda x: 7.0,), "odd."),
    (EITHER, (lambda x: 8.0,), "odd."),
    (EITHER, (lambda x: 9.0,), "9, expected 0"),
    (EITHER_FACT, ({"got": 7.0},), "odd."),
    (EITHER_FACT, ({"got": 8.0},), "odd."),
    (EITHER_FACT, ({"got": 3.0},), "right: "),
    (SPOILT, (lambda kept, spoiled: 1,), "right: "),
    (SPOILT, (lambda kept, spoiled: spoiled[0].fill(1) or 1,), "changes its input `spoiled`"),
]


@pytest.mark.parametrize(("exercise", "answer", "words"), VERDICTS)
def test_each_kind_of_answer_gets_its_verdict(
    exercise: Exercise, answer: tuple[Any, ...], words: str
) -> None:
    exercise.failures.clear()
    assert words in repr(exercise(*answer))


def test_the_third_different_failure_in_a_row_shows_the_line_of_code() -> None:
    line = "try. In code: `x**2`."
    SQUARE.failures.clear()
    for answer in (lambda x: x + 2.0, lambda x: x + 2.0, lambda x: x + 3.0):
        assert SQUARE(...).hint == ""  # a missing answer is not a failure
        assert SQUARE.grade(lambda x: x + 9.0).hint == "try."  # `grade` counts no failures
        assert SQUARE(answer).hint == "try."  # the same answer twice counts once
    assert SQUARE(lambda x: x + 4.0).hint == line
    assert SQUARE(square).passed
    assert SQUARE(lambda x: x + 4.0).hint == "try."
    for broken in (lambda x: 1 / 0, lambda x: "4", lambda x: [1.0, x], lambda x: None):
        assert "In code" not in SQUARE(broken).hint  # all of these are of one kind
    assert SQUARE(lambda x: x + 5.0).hint == line


def begun_with_a_line(x: float) -> None:
    _ = x + 1.0
    ...


def test_an_untouched_function_counts_as_no_try_and_shows_no_alarm() -> None:
    for untouched in (begun, begun_with_a_line):
        verdict = SQUARE(untouched)
        assert "there is no answer" in verdict.message
        assert NOT_YET_CLASS in verdict._repr_html_()
        assert NOT_YET not in verdict._repr_html_()
    assert NOT_YET in SQUARE(lambda x: x + 5.0)._repr_html_()


@pytest.mark.parametrize(
    ("off", "words"),
    [
        (1e-3, "the result is 175.001, expected 175 for x = 175."),
        (2e-8, "the result differs by 2e-08 from 175: is something rounded on the way?"),
    ],
)
def test_a_message_prints_different_numbers_differently(off: float, words: str) -> None:
    exercise = table(lambda x: x, lambda: [(175.0,)], rtol=1e-12)
    assert exercise(lambda x: x + off).message.startswith(words)


def test_single_precision_is_enough_where_the_answer_is_right() -> None:
    exercise = table(lambda A: A / 3.0, lambda: [(np.array([3e4, 0.1, np.nan]),)])
    assert exercise(lambda A: (A / 3.0).astype(np.float32)).passed
    assert not exercise(lambda A: (A / 3.01).astype(np.float32)).passed
    assert not exercise(lambda A: A / 3.0 + 1e-6).passed


MATRICES = [(np.array([[1.0, 2.0, 3.0], [5.0, 4.0, 7.0]]),), (np.array([[4.0, 2.0], [8.0, 3.0]]),)]
MASKS = [(np.array([True, True, False]),), (np.array([False, True]),)]


@pytest.mark.parametrize("name", SLIPS)
def test_a_slip_is_named_only_if_it_explains_every_result(name: str) -> None:
    cases, (says, make) = MASKS if name in ("indices", "inverted") else MATRICES, SLIPS[name]
    if name == "order":
        make = np.flipud
    x = table(lambda A: 1 * A, lambda: cases)
    assert x(lambda A: make(1 * A)).message == says.replace("{what}", "the result")
    assert "off by" not in x(lambda A: make(1 * A) if len(A.T) > 2 else 7 * A).message
    own = table(lambda A: 1 * A, lambda: cases, slips={name: "mind."})
    assert own(lambda A: make(1 * A)).message == "mind."


def test_a_library_function_under_another_name_is_recognised() -> None:
    assert library_call_in(lambda rows: other_name(rows), ["null_space"]) == "null_space"


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The current folder, which contains the first notebook of the course."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "00_start_here.ipynb").touch()
    return tmp_path


def null_basis(A: Any) -> Any:
    # a student's own
    return np.linalg.svd(A)[2][5:]


OWN = """# ---- null_basis ----
from typing import Any
import numpy as np


def null_basis(A: Any) -> Any:
    # a student's own
    return np.linalg.svd(A)[2][5:]"""


def test_only_passed_functions_are_saved_and_only_beside_the_notebooks(folder: Path) -> None:
    assert not ch02.null_basis(lambda A: 2 * null_basis(A)).passed
    spoken: dict[str, Any] = {}
    exec("def null_basis(A): ...", spoken)
    for function in (spoken["null_basis"], np.sum, lambda A: A, partial(null_basis), int):
        assert store_answer(function) == ""  # it has no source
    assert not (folder / "my_vo.py").exists()
    assert "saved in `my_vo.py`" in ch02.null_basis(null_basis).message
    assert (folder / "my_vo.py").read_text(encoding="utf-8") == f"{HEAD}\n\n\n{OWN}\n"
    (folder / "00_start_here.ipynb").unlink()
    (folder / "my_vo.py").unlink()
    assert ch02.null_basis(null_basis).passed
    assert not (folder / "my_vo.py").exists()


def test_stored_function_replaces_only_its_own_section(folder: Path) -> None:
    before = (
        "import math\r\nfirst = 1  # ü\ndef null_basis(A): ...\n\n\n# ---- other ----\nother = math.pi\n\n\n"
    )
    old, after = "# ---- null_basis ----\r\nnull_basis = 0", "\n\n\n# ---- last ----\nlast = first + 1\n"
    path = folder / "my_vo.py"
    path.write_bytes(f"{before}{old}{after}".encode())
    for _ in range(2):
        assert store_answer(null_basis) == " It is saved in `my_vo.py`."
        assert path.read_bytes().decode() == f"{before}{OWN}{after}"
    assert load_functions(path)["null_basis"](np.eye(9)).shape == (4, 9)
    path.write_bytes(b"def half(:\n")
    assert "was not saved" in store_answer(null_basis)
    assert path.read_bytes() == b"def half(:\n"


def test_each_kept_function_has_its_own_helpers(folder: Path) -> None:
    for factor in (2, 3):
        notebook = folder / f"{factor}.py"
        notebook.write_text(
            f"def helper(x): return {factor} * x\n\n\ndef times_{factor}(x):\n    return helper(x)\n"
        )
        store_answer(load_functions(notebook)[f"times_{factor}"])
    saved = load_functions(folder / "my_vo.py")
    assert (saved["times_2"](1), saved["times_3"](1)) == (2, 3)
    with pytest.raises(TypeError) as error:
        saved["times_3"](None)
    lines = (folder / "my_vo.py").read_text(encoding="utf-8").splitlines()
    assert lines[error.traceback[-1].lineno] == "def helper(x): return 3 * x"
