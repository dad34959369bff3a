"""The checker of the exercises: what it says, and what it keeps."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from course.ch00 import exercises as ch00
from course.ch02 import exercises as ch02
from course.checker import SLIPS, Exercise, When, any_order
from course.keep import HEAD, handed_back, keep
from course.results import NOT_YET_CLASS, RIGHT_CLASS, Verdict
from vo_lib.method.five_point import null_space as other_name

SAYS = {"twice": "twice: {got:g}.", "odd": "odd."}
WORDS = {"task": "Do it.", "praise": "well done, {got}.", "hint": "try."}


@pytest.fixture
def table() -> Callable[..., Exercise]:
    """Makes an exercise with two known mistakes: an answer, or a test, each."""

    def make(right: Any, *more: Any, twice: Any = -1, odd: Any = -3, **options: Any) -> Exercise:
        known = {SAYS["twice"]: twice, SAYS["odd"]: odd}
        return Exercise(right, *more, mistakes=known, **{**WORDS, **options})

    return make


def square(x: float) -> float:
    return x**2


def numbers() -> list[tuple[Any, ...]]:
    return [(0.0,), (2.0,), (3.0,)]


def test_a_function_is_run_over_all_cases(table: Callable[..., Exercise]) -> None:
    x = table(square, numbers, twice=lambda x: 2.0 * x, odd=lambda x: x**3)
    assert x.__doc__ == "Do it."
    assert repr(x(square)) == "right: well done, 0.0."
    # 2 x is right for 0 and 2, x³ for 0 only: what agrees for longest is told.
    assert repr(x(lambda x: 2.0 * x)) == "not yet: twice: 6."
    assert x(lambda x: x**3).message == "odd."
    assert repr(x(lambda x: x + 2.0)) == "not yet: the result is 2, expected 0 for x = 0. Hint: try."
    assert "whatever the inputs are" in x(lambda x: 0.0).message
    assert x(lambda x: x * x * (1 + 1e-12)).passed
    assert "expected a function, got float" in x(4.0).message


def test_a_second_failure_in_a_row_is_told_the_line(table: Callable[..., Exercise]) -> None:
    x = table(square, numbers, twice=lambda x: 2.0 * x, line="x**2")
    for told in ("", "In code: `x**2`."):
        assert x(...).hint == ""  # no answer is no failure
        assert x.judge(lambda x: 2.0 * x).hint == ""  # nor is one that only the file asks about
        assert x(lambda x: 2.0 * x).hint == told
    assert x(lambda x: 1.0).hint == "try. In code: `x**2`."
    assert x(square).passed
    assert x(lambda x: 2.0 * x).hint == ""


def test_a_value_is_compared_with_what_stands_beside_it(table: Callable[..., Exercise]) -> None:
    x = table(lambda given: given + 1, rtol=0.1, twice=lambda given: 2 * given)
    assert x(11.5, 10).passed
    assert repr(x(20, 10)) == "not yet: twice: 20."
    assert repr(x(15, 10)) == "not yet: 15 is not it. Hint: try."
    assert "expected numbers, got function" in x(square, 10).message
    for missing in (None, ...):
        assert "replace the dots" in x(missing, 10).message


def test_facts_of_a_panel_are_judged_by_tests_in_turn(table: Callable[..., Exercise]) -> None:
    facts = {"got": 3.0}
    x = table(facts, twice=lambda f: f["got"] == 2, odd=lambda f: np.isnan(f["other"]))
    assert x({"got": 3.0, "other": 1.0}).passed
    assert x({"got": 2.0}).message == "twice: 2."
    assert x(facts).message == "odd."
    assert "expected the facts of a panel, got int" in x(3).message


def test_results_in_parts_are_judged_in_their_order(table: Callable[..., Exercise]) -> None:
    def both(x: float) -> tuple[float, float]:
        return x + 1.0, x - 1.0

    def thrice(x: float) -> tuple[float, float]:
        return x + 1.0, 3.0 * x - 3.0

    x = table(both, numbers, parts=("a", "b"), twice=lambda x: (2 * x + 2.0, x - 1.0), odd=thrice)
    assert x(lambda x: np.array(both(x))).passed
    assert x(lambda x: (y for y in both(x))).passed
    assert x(lambda x: (2 * x + 2.0, 77.0)).message == "twice: 2."
    assert x(thrice).message == "odd."
    assert x(lambda x: both(x)[::-1]).message == "a and b have changed places."
    assert x(lambda x: (x + 1.0, 1.0 - x)).message == "b has the wrong sign."
    assert "b is 9, expected -1 for x = 0" in x(lambda x: (x + 1.0, 9.0)).message
    assert "2 results: a, b" in x(lambda x: x).message


MATRICES = [(np.array([[1.0, 2.0, 3.0], [5.0, 4.0, 7.0]]),), (np.array([[4.0, 2.0], [8.0, 3.0]]),)]
MASKS = [(np.array([True, True, False]),), (np.array([False, True]),)]


@pytest.mark.parametrize("name", SLIPS)
def test_slips_are_told_where_they_explain_every_result(table: Callable[..., Exercise], name: str) -> None:
    cases, (says, make) = MASKS if name in ("indices", "inverted") else MATRICES, SLIPS[name]
    if name == "order":
        make = np.flipud
    x = table(lambda A: 1 * A, lambda: cases)
    assert x(lambda A: make(1 * A)).message == says.replace("{what}", "the result")
    assert "off by" not in x(lambda A: make(1 * A) if len(A.T) > 2 else 7 * A).message
    own = table(lambda A: 1 * A, lambda: cases, slips={name: "mind."})
    assert own(lambda A: make(1 * A)).message == "mind."


def test_values_and_masks_in_the_place_of_indices_are_told(table: Callable[..., Exercise]) -> None:
    x = table(lambda a: np.flatnonzero(a > 1), lambda: [(np.array([0.5, 1.5, 2.5, 0.2]),)])
    assert x(lambda a: a > 1).message == "this looks like a mask; indices are wanted."
    for answer in (lambda a: a[a > 1], lambda a: [[1, 2]]):
        assert x(answer).message == "indices are asked for, not values."


def test_an_exercise_as_the_notebook_begins_it_has_no_answer(table: Callable[..., Exercise]) -> None:
    def begun(x: float) -> None: ...

    x = table(square, numbers)
    assert x(begun).message == "there is no answer, replace the dots."
    assert x.failures == 0


def test_other_right_answers_and_orders_pass(table: Callable[..., Exercise]) -> None:
    x = table(np.argsort, lambda: [(np.array([3.0, 1.0, 2.0]),)], also=(lambda a: [0, 1],), form=any_order)
    assert x(lambda a: [2, 0, 1]).passed
    assert x(lambda a: [1, 0]).passed
    assert "is [2, 2], expected [1, 2, 0]" in x(lambda a: [2, 2]).message


@pytest.mark.parametrize(
    ("answer", "words"),
    [
        (lambda A: None, "gives back nothing"),
        (lambda A: A.T, "transpose"),
        (lambda A: A[0], "shape (3,), expected (2, 3)"),
        (lambda A: np.full((2, 3), np.nan), "NaN"),
        (lambda A: "text", "expected numbers, got str"),
        (lambda A: A + 1j, "expected numbers"),
        (lambda A: A @ A, "ValueError"),
        (lambda A: A @ A, "A @ A"),
        (lambda A, B: A, "TypeError"),
        (lambda A: 3 * A, "the result is [[3, 3, 3], [3, 3, 3]], expected [[1, 1, 1], [1, 1, 1]] for A ="),
    ],
)
def test_what_is_wrong_with_a_result_is_told(
    table: Callable[..., Exercise], answer: Callable[..., Any], words: str
) -> None:
    verdict = table(lambda A: 1.0 * A, lambda: [(np.ones((2, 3)),)])(answer)
    assert not verdict.passed
    assert words in f"{verdict.message} {verdict.hint}"


def test_long_results_are_told_by_their_first_wrong_number(table: Callable[..., Exercise]) -> None:
    x = table(lambda A: 1.0 * A, lambda: [(np.ones((4, 3)),)])
    told = x(lambda A: A + np.eye(4, 3, -1)).message
    assert told == "the result has 3 of 12 numbers wrong: at [1, 0] it is 2, expected 1."


def test_a_function_that_changes_its_inputs_is_told(table: Callable[..., Exercise]) -> None:
    x = table(lambda kept, spoiled: len(spoiled), lambda: [(np.zeros(2), [np.zeros(3)])] * 2)
    assert x(lambda kept, spoiled: 1).passed
    for spoil in (lambda b: b.append(1), lambda b: b[0].fill(1)):
        told = x(lambda kept, spoiled, spoil=spoil: 1 if spoil(spoiled) is None else 0)
        assert not told.passed
        assert "changes its input `spoiled`" in told.message


def test_a_function_that_stops_may_be_a_known_mistake(table: Callable[..., Exercise]) -> None:
    x = table(lambda x: None if x else 1.0, numbers, odd=lambda x: [1.0][int(x)])
    assert x(lambda x: None if x else 1.0).passed
    assert x(lambda x: {0.0: 1.0}.get(x) or [].pop()).message == "odd."
    assert "expected None for x = 2" in x(lambda x: 1.0).message


def test_a_check_never_raises(table: Callable[..., Exercise]) -> None:
    twice, odd = When(lambda got, x: got["no"]), When(lambda *case: 1 / 0)
    x = table(square, numbers, twice=twice, odd=odd)
    assert "ZeroDivisionError" in x(lambda x: 7.0).message
    assert "AttributeError" in ch00.disparity_at_20_m(3.0, object()).message


def test_long_lists_are_told_by_what_does_not_belong(table: Callable[..., Exercise]) -> None:
    x = table(lambda a: np.arange(9), lambda: [(1.0,)])
    assert x(lambda a: [*range(8), 77]).message == (
        "the result has 9 indices, expected 9; 1 of them do not belong there (77 for one)."
    )


def squared(x: float) -> float:
    return np.square(x)  # type: ignore[no-any-return]


def test_who_only_calls_the_library_is_told(table: Callable[..., Exercise]) -> None:
    x = table(square, numbers, library=["null_space", "square"])
    for answer in (np.square, squared, lambda x: np.square(x), lambda x: sum(np.square(y) for y in [x])):
        assert "hands the work to `square`" in x(answer).message
    # A function of one's own may have the name.
    assert x(square).passed
    assert x(lambda x: square(x)).passed
    assert handed_back(lambda rows: other_name(rows), ["null_space"]) == "null_space"
    assert handed_back(ch02.rows, ["library_rows", "epipolar_rows"]) == ""


def test_verdicts_escape_what_they_show() -> None:
    page = Verdict(False, "<script> is not it.", "`a < b`")._repr_html_()
    assert "<script>" not in page
    assert "<code>a &lt; b</code>" in page
    assert NOT_YET_CLASS in page
    assert RIGHT_CLASS in Verdict(True, "yes")._repr_html_()


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The current folder, with the course's first notebook in it."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "00_start_here.ipynb").touch()
    return tmp_path


def null_basis(A: Any) -> Any:
    # a student's own
    return np.linalg.svd(A)[2][5:]


def test_only_what_passed_is_kept_and_only_beside_the_notebooks(folder: Path) -> None:
    assert "my_vo.py" not in ch02.null_basis(lambda A: null_basis(A)).message
    assert not ch02.null_basis(lambda A: 2 * null_basis(A)).passed
    assert not (folder / "my_vo.py").exists()
    assert "kept in `my_vo.py`" in ch02.null_basis(null_basis).message
    assert (folder / "my_vo.py").read_text(encoding="utf-8") == (
        f"{HEAD}\nfrom typing import Any\nimport numpy as np\n\n\ndef null_basis(A: Any) -> Any:\n"
        "    # a student's own\n    return np.linalg.svd(A)[2][5:]\n"
    )
    (folder / "00_start_here.ipynb").unlink()
    (folder / "my_vo.py").unlink()
    assert ch02.null_basis(null_basis).passed
    assert not (folder / "my_vo.py").exists()


def test_a_kept_function_replaces_its_old_self_and_nothing_else(folder: Path) -> None:
    before = "from typing import Any\nimport numpy as np\r\n\x0c\n@print\ndef other(A): ...  # ü\n\n"
    after = "\n\nfirst = 1\nclass C:\n    def null_basis(self): ...\n"
    old = "@staticmethod\ndef null_basis(A):\n    return 0"
    own = "def null_basis(A: Any) -> Any:\n    # a student's own\n    return np.linalg.svd(A)[2][5:]"
    path = folder / "my_vo.py"
    path.write_bytes(f"{before}{old}{after}".encode())
    for _ in range(2):
        assert keep(null_basis) == " It is kept in `my_vo.py`."
        assert path.read_bytes().decode() == f"{before}{own}{after}"
    assert sorted(each.name for each in folder.iterdir()) == ["00_start_here.ipynb", "my_vo.py"]


def test_a_file_that_cannot_be_read_as_python_stays_as_it_is(folder: Path) -> None:
    path = folder / "my_vo.py"
    for broken in (b"def half(:\n", b"\xff\xfe"):
        path.write_bytes(broken)
        assert "could not be kept" in keep(null_basis)
        assert path.read_bytes() == broken


def test_what_has_no_source_is_passed_over(folder: Path) -> None:
    spoken: dict[str, Any] = {}
    exec("def null_basis(A): ...", spoken)
    for function in (spoken["null_basis"], np.sum, lambda A: A, partial(null_basis), int):
        assert keep(function) == ""
    assert not (folder / "my_vo.py").exists()
