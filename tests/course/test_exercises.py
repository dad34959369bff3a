"""The tables of the exercises: right answers pass, and each known mistake has a different message."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from course.appendix import exercises as appendix
from course.ch00 import exercises as ch00
from course.ch01 import exercises as ch01
from course.ch02 import exercises as ch02
from course.ch03 import exercises as ch03
from course.ch04 import exercises as ch04
from course.ch04.weightings import METRES, solve_by
from course.ch05 import exercises as ch05
from course.ch06 import exercises as ch06
from course.ch07 import exercises as ch07
from course.ch08 import exercises as ch08
from course.ch09 import exercises as ch09
from course.checker import SLIPS, Exercise
from course.perturbed_path import block_tour, perturbed_path
from course.results import NOT_YET_CLASS, Verdict
from vo_lib.data.poses import from_first
from vo_lib.data.sequence import Sequence
from vo_lib.evaluation.kitti_errors import kitti_errors
from vo_lib.geometry.boxes import Boxes
from vo_lib.geometry.matches import StereoMatches
from vo_lib.kit.settings import KitTranslationConfig
from vo_lib.paper.box_removal import on_vehicles
from vo_lib.paper.settings import FilterConfig
from vo_lib.paper.translation import feature_rows

TABLES = {
    f"{chapter.__name__.split('.')[1]}.{name}": exercise
    for chapter in (ch00, ch01, ch02, ch03, ch04, ch05, ch06, ch07, ch08, ch09, appendix)
    for name, exercise in vars(chapter).items()
    if isinstance(exercise, Exercise)
}
ANSWERS = [
    (name, says, number)
    for name, exercise in TABLES.items()
    for says, answers in exercise.answers.items()
    for number in range(len(answers))
]


def tour(truth: Any) -> Sequence:
    return Sequence("tour", Path("tour"), (), ch00.CAMERA, np.zeros(0), truth, None)


BEND = block_tour(1)[150:300:2]
# Further inputs of a check, beside the answer.
GIVEN: dict[str, tuple[Any, ...]] = {
    "ch00.disparity_at_20_m": (ch00.CAMERA,),
    "ch08.drift": (from_first(perturbed_path(BEND, 2.0, 3.0, 20.0)), tour(BEND)),
    "ch08.te_and_re": (from_first(perturbed_path(BEND, 2.0, 3.0, 20.0)), tour(BEND)),
}


def judge(name: str, answer: Any) -> Verdict:
    """The verdict on a student's answer, which is a function, a value or facts."""
    exercise, given = TABLES[name], GIVEN.get(name, ())
    exercise.failures.clear()
    if isinstance(answer, dict):
        answer = exercise.right | answer
    elif callable(answer) and exercise.cases is None:
        answer = answer(*given)
    return exercise(answer, *given)


@pytest.mark.parametrize("name", TABLES)
def test_the_right_answers_pass(name: str) -> None:
    for right in (TABLES[name].right, *TABLES[name].also):
        verdict = judge(name, right)
        assert verdict.passed, verdict


@pytest.mark.parametrize(
    ("name", "answer"),
    [
        ("ch01.loop_closes", lambda *case: set(ch01.closed_loops(*case).tolist())),
        ("ch01.buckets", lambda *case: set(ch01.kept(*case).tolist())),
        ("ch01.maxima", lambda *case: ch01.largest_in_squares(*case)[::-1].astype(int).tolist()),
        ("ch01.corner_strength", lambda *g: ch01.strength(*(each.astype(np.float32) for each in g))),
        ("ch02.essential_constraints", lambda E: [2 * np.linalg.det(E), *ch02.ten_constraints(E)[:9]]),
        ("ch02.essential_constraints", lambda E: [*-3.0 * ch02.ten_constraints(E)[:9], np.linalg.det(E)]),
    ],
)
def test_an_answer_in_another_form_is_right(name: str, answer: Any) -> None:
    assert judge(name, answer).passed


@pytest.mark.parametrize(("name", "says", "number"), ANSWERS)
def test_each_known_mistake_has_its_own_message(name: str, says: str, number: int) -> None:
    verdict = judge(name, TABLES[name].answers[says][number])
    assert not verdict.passed
    assert verdict.message.startswith(says.split("{")[0])


@pytest.mark.parametrize(
    ("name", "slip"),
    [
        (name, slip)
        for name, exercise in TABLES.items()
        for slip in exercise.slips
        if exercise.slips[slip] != SLIPS[slip][0]
    ],
)
def test_a_slip_has_the_message_of_its_exercise(name: str, slip: str) -> None:
    exercise, make = TABLES[name], SLIPS[slip][1]

    def slipped(*case: Any) -> Any:
        right = exercise.right(*case) if callable(exercise.right) else exercise.right
        first, *rest = right if exercise.parts else [right]
        return [make(np.asarray(first)), *rest] if rest else make(np.asarray(first))

    verdict = judge(name, slipped if exercise.cases else slipped(*GIVEN.get(name, ())))
    assert verdict.message == exercise.slips[slip]


BANK = Path(__file__).with_name("wrong_answers.txt").read_text(encoding="utf-8").split("\n# ")[1:]


@pytest.mark.parametrize("entry", BANK, ids=lambda entry: entry.split("\n")[0])
def test_a_wrong_answer_is_refused_with_the_hint_meant_for_it(entry: str) -> None:
    head, code = entry.split("\n", 1)
    name, hint = head.split(" | ")
    written: dict[str, Any] = {"__name__": "__main__", "np": np}
    exec(code, written)
    verdict = judge(name, list(written.values())[-1])
    assert not verdict.passed
    assert hint in f"{verdict.message} {verdict.hint}", verdict


@pytest.mark.parametrize("name", TABLES)
def test_every_check_refuses_values_that_are_no_answer_without_an_error(name: str) -> None:
    values = ["text", [], object(), np.full(3, np.nan), np.zeros((2, 0, 7)), [[1], [2, 3]], 1j, iter("ab")]
    functions: list[Any] = [
        lambda: 0,
        lambda *case: 1 / 0,
        *(lambda *case, each=each: each for each in (None, *values)),
    ]
    for answer in (None, ..., *values, *functions):
        verdict = TABLES[name](answer, *GIVEN.get(name, ()))
        assert NOT_YET_CLASS in verdict._repr_html_(), answer
        assert "cannot be judged" not in verdict.message


def test_numbers_of_chapters_2_and_6_are_those_of_the_kit() -> None:
    assert [count for count in range(11) if ch02.most_frequent_count(count).passed] in ([2], [4], [6])
    assert 3.0 < ch02.noise_factor.right() < 5.0
    te = kitti_errors(block_tour(), perturbed_path(block_tour(), scale=1.0), lengths=(800,)).te
    assert ch06.once_round(te).passed
    errors = ch07.errors_of_sets()[0]
    assert errors[0] > errors[1] > errors[2]


def test_answers_of_chapter_4_equal_the_library() -> None:
    matches = ch04.matches_ahead(30, 5, noise=0.5)
    A, B, c = feature_rows(ch00.CAMERA, ch04.matches_ahead(1, 3), ch04.R_CP)
    M, right = ch04.eight_rows(*ch04.one_match()[0])
    np.testing.assert_allclose(M, np.concatenate([A[0], B[0]], axis=1), atol=1e-12)
    np.testing.assert_allclose(right, c[0], atol=1e-12)
    solved = solve_by(METRES, ch00.CAMERA, matches, ch04.R_CP, KitTranslationConfig(max_depth=1000))
    assert solved is not None
    np.testing.assert_allclose(ch04.stacked(*ch04.weighted_frames()[1]), solved[0], atol=1e-9)


def test_rule_of_chapter_5_equals_the_library() -> None:
    for uv_p, uv_c, *corners in ch05.features():
        ones = np.ones(len(uv_p), np.int64)
        matches = StereoMatches(uv_p, uv_p, uv_c, uv_c, ones, np.ones(len(ones)), np.arange(len(ones)))
        boxes = [Boxes(xyxy, np.full(len(xyxy), 2), np.ones(len(xyxy))) for xyxy in corners]
        kept = ~on_vehicles(matches, boxes[0], boxes[1], FilterConfig())
        np.testing.assert_array_equal(ch05.outside(uv_p, uv_c, *corners), kept)
