"""A student's function on a frame: it runs wherever it can, and the library's result never passes for it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from course.own_functions import apart, chosen_apart, own_or_library


def double(values: Any) -> Any:
    return 2.0 * values


def positive(values: Any) -> Any:
    return values > 0


VALUES = np.array([-1.0, 2.0, 3.0])


def test_a_right_and_a_wrong_answer_run_as_they_are(capsys: pytest.CaptureFixture[str]) -> None:
    triple = own_or_library(lambda values: 3.0 * values, double)
    np.testing.assert_array_equal(triple(VALUES), 3.0 * VALUES)
    assert triple.whose == "yours"
    assert capsys.readouterr().out == ""


def test_an_answer_that_is_still_missing_is_reported_once(capsys: pytest.CaptureFixture[str]) -> None:
    def mine(values: Any) -> Any: ...

    function = own_or_library(mine, double)
    for _ in range(3):
        np.testing.assert_array_equal(function(VALUES), 2.0 * VALUES)
    assert function.whose == "the library's"
    assert capsys.readouterr().out == "mine has no answer yet, so the library's function runs here.\n"


@pytest.mark.parametrize(
    ("answer", "library", "words"),
    [
        (lambda values: None, double, "returns None"),
        (lambda values: 1 / 0, double, "ZeroDivisionError"),
        (lambda values: values[:, None], double, "returns the shape (3, 1), not (3,)"),
        (lambda values: positive(values)[:2], positive, "returns the shape (2,), not (3,)"),
        (lambda values: np.flatnonzero(values > 0), positive, "returns the shape (2,), not (3,)"),
        (lambda values: (values > 0).astype(int), positive, "returns no mask"),
        (lambda values: "2", double, "returns"),
        (lambda values: [[1.0], [1.0, 2.0]], double, "different lengths"),
        (lambda values: values, lambda values: (values, values), "does not return 2 results"),
        (lambda values: values * np.nan, double, "has values that are not finite"),
        (lambda values: [1.0, np.inf, 2.0], double, "has values that are not finite"),
        (lambda values: (values, -np.inf * values), lambda values: (values, values), "are not finite"),
        (lambda values: np.zeros(0), double, "returns no result"),
        (lambda values: np.zeros((0, 3)), lambda values: np.zeros((4, 3)), "returns no result"),
    ],
)
def test_an_answer_that_cannot_be_drawn_is_reported(
    answer: Any, library: Any, words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    function = own_or_library(answer, library)
    np.testing.assert_equal(function(VALUES), library(VALUES))
    assert function.whose == "the library's"
    assert words in capsys.readouterr().out


def test_infinite_values_are_used_where_the_library_has_some(
    capsys: pytest.CaptureFixture[str],
) -> None:
    def parallel(values: Any) -> Any:
        return np.array([np.inf, 1.0, np.nan])

    function = own_or_library(lambda values: np.array([np.nan, 2.0, 3.0]), parallel)
    np.testing.assert_array_equal(function(VALUES), [np.nan, 2.0, 3.0])
    assert function.whose == "yours"
    assert capsys.readouterr().out == ""


def test_an_empty_result_is_used_where_the_librarys_is_empty() -> None:
    function = own_or_library(lambda values: np.zeros(0), lambda values: np.zeros(0))
    assert len(function(VALUES)) == 0
    assert function.whose == "yours"


def test_results_of_which_some_are_the_librarys_are_partly_yours(capsys: pytest.CaptureFixture[str]) -> None:
    function = own_or_library(lambda value: None if value < 0 else 3.0 * value, double)
    assert function.whose == "yours"
    assert [function(value) for value in VALUES] == [-2.0, 6.0, 9.0]
    assert function.whose == "partly yours (1 of 3 results are the library's)"
    assert capsys.readouterr().out.count("returns None") == 1
    for _ in range(2):
        function(-1.0)
    assert function.whose == "partly yours (3 of 5 results are the library's)"


def test_several_results_may_be_an_array(capsys: pytest.CaptureFixture[str]) -> None:
    both = own_or_library(lambda values: np.array([1.0, 2.0]), lambda values: (3.0, 4.0))
    assert list(both(VALUES)) == [1.0, 2.0]
    assert capsys.readouterr().out == ""


def test_an_answer_cannot_change_the_data_of_the_cell() -> None:
    def spoils(values: Any) -> Any:
        values *= 0
        return values

    given = VALUES.copy()
    own_or_library(spoils, double)(given)
    np.testing.assert_array_equal(given, VALUES)


@pytest.mark.parametrize(
    ("own", "library", "words"),
    [
        (VALUES, VALUES, "equal"),
        (VALUES + 1e-12, VALUES, "equal, within 1e-12"),
        (VALUES + 0.25, VALUES, "apart by up to 0.25 px"),
        (VALUES > 0, VALUES > 2, "1 of 3 differ"),
        (np.array([1, 2, 5]), np.array([1, 2]), "3 results against 2 results"),
        (np.array([0, 1, 2, 3, -1]), np.array([3, 2, 1, 0, -1]), "4 of 5 differ"),
        (np.array([7, 7, 8]), np.array([7, 8, 8]), "1 of 3 differ"),
        (np.array([-1, -1, 4]), np.array([-1, -1, 4]), "0 of 3 differ"),
        (np.zeros((2, 3, 3)), np.zeros((4, 3, 3)), "2 results against 4 results"),
        (np.zeros((1, 3)), np.zeros((4, 3)), "1 result against 4 results"),
        (VALUES * np.nan, VALUES, "3 of 3 numbers are not finite"),
    ],
)
def test_the_distance_between_two_results_is_stated_in_words(own: Any, library: Any, words: str) -> None:
    assert apart(own, library, "px") == words


def test_two_choices_are_compared_without_their_order() -> None:
    assert chosen_apart([4, 1, 2], [1, 2, 4]) == "0 of 3 differ"
    assert chosen_apart([1, 2, 5], [1, 2]) == "1 of 3 differ"
    assert chosen_apart([1, 2], [3, 4]) == "4 of 4 differ"
