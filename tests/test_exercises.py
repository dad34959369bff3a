"""The checks of the exercises: right answers pass, each foreseen mistake gets its own words."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from vo_lib import open_sequence
from vo_lib.core.camera import StereoCamera
from vo_lib.core.geometry import essential_vector, inverse
from vo_lib.core.types import Array
from vo_lib.course.exercises import Verdict, Wrong, ch00, ch02, ch03, exercise
from vo_lib.course.exercises.verdict import NOT_YET_CLASS, RIGHT_CLASS
from vo_lib.method.five_point import epipolar_rows

CAMERA = StereoCamera(f=700.0, cx=600.0, cy=180.0, baseline=0.5, width=1241, height=376)


def wrong(verdict: Verdict, words: str) -> None:
    """The verdict is "not yet" and says why."""
    assert not verdict.passed
    assert words in f"{verdict.message} {verdict.hint}"


def test_a_missing_answer_is_no_error() -> None:
    for verdict in (ch00.depth_error_ratio(...), ch02.epipolar_rows(lambda x_p, x_c: None), ch03.angle(None)):
        assert not verdict.passed
        assert NOT_YET_CLASS in verdict._repr_html_()


def test_code_that_stops_is_told_with_its_line() -> None:
    def broken(x_p: Array, x_c: Array) -> Array:
        return x_p @ x_c

    wrong(ch02.epipolar_rows(broken), "ValueError")
    wrong(ch02.epipolar_rows(broken), "x_p @ x_c")


def test_wrong_kinds_of_answers_are_named() -> None:
    wrong(ch00.depth_error_ratio("sixteen"), "expected a number, got str")
    wrong(ch00.depth_error_ratio([1, 2]), "shape (2,)")
    wrong(ch02.epipolar_rows(lambda x_p, x_c: np.zeros((9, 5))), "transpose")
    wrong(ch02.epipolar_rows(lambda x_p, x_c: np.full((5, 9), np.nan)), "NaN")


def test_verdicts_escape_what_they_show() -> None:
    @exercise
    def check(answer: Any) -> str:
        raise Wrong(f"{answer} is not it.", "a < b")

    page = check("<script>")._repr_html_()
    assert "<script>" not in page
    assert "a &lt; b" in page
    assert repr(check(1)) == "not yet: 1 is not it. Hint: a < b"
    assert RIGHT_CLASS in Verdict(True, "yes")._repr_html_()


def test_chapter_0_depth() -> None:
    right = CAMERA.f * CAMERA.baseline / 20.0
    assert ch00.disparity_at_20_m(right, CAMERA).passed
    wrong(ch00.disparity_at_20_m(CAMERA.f / 20.0, CAMERA), "between the two cameras")
    wrong(ch00.disparity_at_20_m(1.0 / right, CAMERA), "other way round")
    wrong(ch00.disparity_at_20_m(3.0, CAMERA), "f b / Z")
    assert ch00.depth_error_ratio(16.0).passed
    wrong(ch00.depth_error_ratio(4.0), "faster than the distance")

    def point(u: float, v: float, d: float, camera: StereoCamera) -> Array:
        return np.asarray(camera.back_project(np.array([[u, v]]), np.array([d]))[0])

    assert ch00.back_project(point).passed
    wrong(ch00.back_project(lambda u, v, d, c: point(u, v, 2 * d, c)), "Z is")
    wrong(ch00.back_project(lambda u, v, d, c: point(u + c.cx, v + c.cy, d, c)), "corner")


def test_chapter_0_path(bands: Path) -> None:
    sequence = open_sequence(bands)
    assert ch00.path_length(2.5, sequence).passed
    wrong(ch00.path_length(9.0, sequence), "np.diff")

    def chain(motions: list[Array]) -> list[Array]:
        poses = [np.eye(4)]
        for T in motions:
            poses.append(poses[-1] @ inverse(T))
        return poses

    def reversed_order(motions: list[Array]) -> list[Array]:
        poses = [np.eye(4)]
        for T in motions:
            poses.append(inverse(T) @ poses[-1])
        return poses

    assert ch00.chain(chain).passed
    wrong(ch00.chain(reversed_order), "order")
    wrong(ch00.chain(lambda motions: chain([inverse(T) for T in motions])), "backwards")
    wrong(ch00.chain(lambda motions: chain(motions)[1:]), "3 poses")


def test_chapter_0_panel() -> None:
    assert ch00.wrong_depth({"depth Z": 9.0, "true depth": 12.0}).passed
    wrong(ch00.wrong_depth({"depth Z": 11.9, "true depth": 12.0}), "only 1 % off")
    wrong(ch00.wrong_depth({"depth Z": float("nan"), "true depth": 12.0}), "found nothing")
    wrong(ch00.wrong_depth({"depth Z": 9.0, "true depth": float("nan")}), "sky")


def test_chapter_2_epipolar_distance() -> None:
    def distance(E: Array, x_p: Array, x_c: Array) -> float:
        line = E @ np.append(x_p, 1.0)
        return float(line @ np.append(x_c, 1.0)) / float(np.hypot(line[0], line[1]))

    assert ch02.epipolar_distance(lambda E, p, c: abs(distance(E, p, c))).passed
    wrong(ch02.epipolar_distance(lambda E, p, c: -abs(distance(E, p, c))), "absolute")
    wrong(ch02.epipolar_distance(lambda E, p, c: abs(distance(E.T, p, c))), "transposed")
    algebraic = ch02.epipolar_distance(lambda E, p, c: abs(np.append(c, 1.0) @ E @ np.append(p, 1.0)))
    wrong(algebraic, "length of the line")


def test_chapter_2_constraints() -> None:
    def rows(x_p: Array, x_c: Array) -> Array:
        return np.asarray(epipolar_rows(x_p[None], x_c[None])[:, :, 0])

    assert ch02.epipolar_rows(rows).passed
    wrong(ch02.epipolar_rows(lambda p, c: rows(c, p)), "changed places")
    assert ch02.null_basis(lambda A: np.linalg.svd(A)[2][5:]).passed
    wrong(ch02.null_basis(lambda A: np.linalg.svd(A)[2][:4]), "not 0")
    wrong(ch02.null_basis(lambda A: 2.0 * np.linalg.svd(A)[2][5:]), "orthonormal")

    def ten(E: Array, half: float = 0.5) -> Array:
        return np.append((E @ E.T @ E - half * np.trace(E @ E.T) * E).ravel(), np.linalg.det(E))

    assert ch02.essential_constraints(ten).passed
    wrong(ch02.essential_constraints(lambda E: ten(E, 1.0)), "trace")
    wrong(ch02.essential_constraints(lambda E: np.full(10, np.linalg.det(E))), "not only for them")


def test_chapter_2_numbers() -> None:
    wrong(ch02.most_frequent_count(3), "pairs")
    passed = [count for count in range(11) if ch02.most_frequent_count(count).passed]
    assert passed in ([2], [4], [6])
    factor = ch02.median_error(0.4) / ch02.median_error(0.1)
    assert 3.0 < factor < 5.0
    assert ch02.noise_factor(factor).passed
    wrong(ch02.noise_factor(1.0 / factor), "inverse")
    assert ch02.far_off({"rotation error of this solution": 2.5, "real solutions": 4}).passed
    wrong(ch02.far_off({"rotation error of this solution": 0.1, "real solutions": 4}), "0.10")


def test_chapter_3_pieces() -> None:
    assert ch03.angle(lambda a, b: np.arccos(min(abs(a @ b), 1.0))).passed
    wrong(ch03.angle(lambda a, b: np.degrees(np.arccos(min(abs(a @ b), 1.0)))), "degrees")
    wrong(ch03.angle(lambda a, b: np.arccos(abs(a @ b))), "1 + 1e-16")
    assert ch03.truncated_error(lambda d, t: np.mean(np.minimum((d / t) ** 2, 1.0))).passed
    wrong(ch03.truncated_error(lambda d, t: np.mean((d / t) ** 2)), "decides everything")
    wrong(ch03.truncated_error(lambda d, t: np.mean(np.abs(d) > t)), "only counts")
    wrong(ch03.truncated_error(lambda d, t: np.mean(np.minimum(d**2, 1.0))), "threshold is not used")
    assert ch03.sets_needed(np.log(0.01) / np.log(1 - 0.7**5)).passed
    wrong(ch03.sets_needed(np.log(0.01) / np.log(1 - 0.3**5)), "0.7")


def angles(E: Array, e_prev: Array) -> Array:
    return np.asarray(np.arccos(np.minimum(np.abs(essential_vector(E) @ e_prev), 1.0)))


def test_chapter_3_selection() -> None:
    assert ch03.nearest(lambda E, e, k: np.argsort(angles(E, e))[:k]).passed
    wrong(ch03.nearest(lambda E, e, k: np.argsort(-angles(E, e))[:k]), "farthest")

    def select(E: Array, sets: Any, errors: Array, e_prev: Array, k: int) -> int:
        kept: list[int] = []
        for s in np.unique(sets):
            members = np.flatnonzero(sets == s)
            kept += members[np.argsort(angles(E[members], e_prev))[:k]].tolist()
        return min(kept, key=lambda i: float(errors[i]))

    assert ch03.select(select).passed
    wrong(ch03.select(lambda E, s, errors, e, k: np.argmin(errors)), "consensus")
    wrong(ch03.select(lambda E, s, errors, e, k: np.argmin(angles(E, e))), "last word")
    assert ch03.consensus_fooled({"error by consensus": 2.0, "error by selection": 2.0}).passed
    wrong(ch03.consensus_fooled({"error by consensus": 0.01}), "moving share")


@pytest.mark.parametrize("module", [ch00, ch02, ch03])
def test_no_check_falls_over_nonsense(module: Any) -> None:
    for name, check in vars(module).items():
        if hasattr(check, "__wrapped__") and check.__module__ == module.__name__:
            others = [object()] * (check.__wrapped__.__code__.co_argcount - 1)
            for answer in ("text", [], {}, object(), lambda *a: "text", lambda: 0):
                assert isinstance(check(answer, *others), Verdict), name
