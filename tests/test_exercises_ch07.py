"""Chapter 7's checks: right answers pass, each foreseen mistake gets its own words."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from vo_lib.config import preset
from vo_lib.core.settings import replace
from vo_lib.core.types import Array
from vo_lib.course.exercises import Verdict, ch07
from vo_lib.evaluation.kitti import kitti_errors
from vo_lib.runs.runner import run_methods


def wrong(verdict: Verdict, words: str) -> None:
    """The verdict is "not yet" and says why."""
    assert not verdict.passed
    assert words in f"{verdict.message} {verdict.hint}"


def test_the_average_leaves_out_01_and_what_has_no_number() -> None:
    def average(te: dict[str, Any], leave: str = "01", none: float | None = None) -> float:
        rows = [value for name, value in te.items() if name != leave]
        return float(np.mean([none if v is None else v for v in rows if v is not None or none is not None]))

    assert ch07.paper_average(average).passed
    wrong(ch07.paper_average(lambda te: average(te, leave="")), "01 is in it")
    wrong(ch07.paper_average(lambda te: average(te, none=0.0)), "counted as 0")
    wrong(ch07.paper_average(lambda te: 3 * average(te)), "sum")
    wrong(ch07.paper_average(lambda te: sum(te.values())), "leave None out")


def test_the_unit_of_the_papers_rotation_error() -> None:
    assert ch07.true_rotation_error(1 / 5555.6 * 100 * 180 / np.pi).passed
    wrong(ch07.true_rotation_error(5555.6 / 5729.6), "other way round")
    wrong(ch07.true_rotation_error(0.0313), "difference")
    wrong(ch07.true_rotation_error(3.13), "difference")


def test_one_row_cannot_explain_the_average() -> None:
    assert ch07.odd_row(3.3).passed
    wrong(ch07.odd_row(0.33), "1/10")
    wrong(ch07.odd_row(-3.3), "sign")


def pair(mean: Callable[..., Any], spread: Callable[..., Any]) -> Callable[..., tuple[Any, Any]]:
    return lambda before, after: (mean(after - before), spread(before, after))


@pytest.mark.parametrize(
    ("spread", "words"),
    [
        (lambda b, a: a.std(), "one method alone"),
        (lambda b, a: np.hypot(a.std(), b.std()), "two methods' own"),
        (lambda b, a: (a - b).var(), "variance"),
    ],
)
def test_a_gain_is_taken_seed_by_seed(spread: Callable[..., Any], words: str) -> None:
    assert ch07.gain(pair(np.mean, lambda b, a: np.std(a - b))).passed
    assert ch07.gain(pair(np.mean, lambda b, a: np.std(a - b, ddof=1))).passed
    wrong(ch07.gain(pair(np.mean, spread)), words)
    wrong(ch07.gain(pair(lambda change: -np.mean(change), spread)), "sign")
    wrong(ch07.gain(lambda before, after: np.mean(after - before)), "two numbers")


def test_a_sweep_runs_the_back_end_on_the_given_matches() -> None:
    def sweep(sequence: Any, matches: Any, values: Any, name: str = "te", **measure: Any) -> Array:
        found = []
        for value in values:
            config = replace(preset("solution_selection"), "selection.sets", value)
            poses = run_methods(sequence, {"": config}, matches=matches)[""].poses
            found.append(getattr(kitti_errors(sequence.truth, poses, **measure), name))
        return np.array(found)

    short: dict[str, Any] = {"lengths": (20,), "step": 1}
    assert ch07.sweep(lambda *given: sweep(*given, **short)).passed
    wrong(ch07.sweep(lambda *given: sweep(*given)), "no sub-sequence fits")
    wrong(ch07.sweep(lambda s, m, values: sweep(s, m, values, "re", **short)), "this is RE")
    wrong(ch07.sweep(lambda s, m, values: sweep(s, m, (200,) * len(values), **short)), "has not changed")
    wrong(ch07.sweep(lambda *given: sweep(*given, **short) / 100), "fraction")
    errors = ch07.errors_of_sets()[0]
    assert errors[0] > errors[1] > errors[2]


def test_fewer_sets_are_found_by_the_panel() -> None:
    facts = {"five-point sets": 20.0, "TE": 0.05, "TE of the preset": 0.049}
    assert ch07.fewer_sets(facts).passed
    wrong(ch07.fewer_sets(facts | {"five-point sets": 200.0}), "more than 20")
    wrong(ch07.fewer_sets(facts | {"TE": 0.06}), "5 % above")
    wrong(ch07.fewer_sets({}), "no TE yet")
