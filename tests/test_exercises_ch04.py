"""Chapter 4's checks: right answers pass, each foreseen mistake gets its own words."""

from __future__ import annotations

from typing import Any

import numpy as np

from vo_lib.course.exercises import Verdict, ch04


def wrong(verdict: Verdict, words: str) -> None:
    """The verdict is "not yet" and says why."""
    assert not verdict.passed
    assert words in f"{verdict.message} {verdict.hint}"


def eight_rows(
    turn: Any = lambda R: R, sign: float = 1.0, c_sign: float = 1.0, t_columns: bool = True
) -> Any:
    """The right answer to the first exercise, or one with a mistake in it."""

    def rows(x_pl: Any, x_pr: Any, x_cl: Any, x_cr: Any, R_cp: Any, b: float) -> Any:
        e1, e2, e3 = np.eye(3)
        M, c = [], []
        for view, x in enumerate((x_pl, x_pr, x_cl, x_cr)):
            for axis, e in enumerate((e1, e2)):
                row = sign * (x[axis] * e3 - e)
                current = view >= 2
                M.append(
                    np.concatenate([row @ turn(R_cp), row if t_columns else 0 * row])
                    if current
                    else np.concatenate([row, np.zeros(3)])
                )
                c.append(-c_sign * b if view % 2 and axis == 0 else 0.0)
        return np.array(M), np.array(c)

    return rows


def test_the_eight_rows() -> None:
    assert ch04.feature_rows(eight_rows()).passed
    wrong(ch04.feature_rows(eight_rows(c_sign=-1.0)), "wrong sign")
    wrong(ch04.feature_rows(eight_rows(c_sign=0.0)), "no size")
    wrong(ch04.feature_rows(eight_rows(c_sign=2.0)), "c is not")
    wrong(ch04.feature_rows(eight_rows(sign=-1.0)), "other sign")
    wrong(ch04.feature_rows(eight_rows(t_columns=False)), "those of t are not")
    wrong(ch04.feature_rows(eight_rows(turn=lambda R: np.eye(3))), "rotation is missing")
    wrong(ch04.feature_rows(eight_rows(turn=lambda R: R.T)), "other way round")
    wrong(ch04.feature_rows(lambda *given: np.zeros((8, 6))), "two arrays")
    wrong(ch04.feature_rows(lambda *given: (np.zeros((8, 6)), np.zeros(8))), "row 1 (x in the previous left")


def solve(M: Any, c: Any) -> Any:
    return np.linalg.lstsq(M, c, rcond=None)[0]


def test_one_feature() -> None:
    assert ch04.one_feature(lambda M, c: solve(M, c)[3:]).passed
    wrong(ch04.one_feature(solve), "six numbers")
    wrong(ch04.one_feature(lambda M, c: solve(M, c)[:3]), "the point Q")
    wrong(ch04.one_feature(lambda M, c: np.zeros(3)), "expected")


def test_numbers() -> None:
    assert ch04.rank_at_infinity(4).passed
    for answer, words in ((6, "tell t"), (8, "six columns"), (5, "not it")):
        wrong(ch04.rank_at_infinity(answer), words)
    assert ch04.row_error(5).passed
    for number, words in ((25.0, "depth error"), (0.2, "not better"), (1.0, "not equal"), (7.0, "not it")):
        wrong(ch04.row_error(number), words)


def test_stacking() -> None:
    def stacked(A: Any, B: Any, c: Any) -> Any:
        H, g = np.zeros((3, 3)), np.zeros(3)
        for A_i, B_i, c_i in zip(A, B, c, strict=True):
            N = np.eye(8) - A_i @ np.linalg.pinv(A_i)
            H += B_i.T @ N @ B_i
            g += B_i.T @ N @ c_i
        return np.linalg.solve(H, g)

    def singles(A: Any, B: Any, c: Any) -> Any:
        return np.array([solve(np.hstack([A[i], B[i]]), c[i])[3:] for i in range(len(A))])

    assert ch04.stack(stacked).passed
    wrong(ch04.stack(lambda *rows: singles(*rows).mean(axis=0)), "this is the mean")
    wrong(ch04.stack(lambda *rows: np.median(singles(*rows), axis=0)), "median")
    wrong(ch04.stack(lambda A, B, c: solve(B.reshape(-1, 3), c.ravel())), "left out")
    wrong(ch04.stack(lambda A, B, c: np.ones(3)), "expected")


def test_weights() -> None:
    assert ch04.robust_weight(lambda r, s: 1 / (1 + (r / s) ** 2)).passed
    wrong(ch04.robust_weight(lambda r, s: np.log1p(r**2)), "without residual")
    wrong(ch04.robust_weight(lambda r, s: 1 / (1 + r**2)), "not ½")
    wrong(ch04.robust_weight(lambda r, s: np.where(r < 0, 0.4, 1 / (1 + (r / s) ** 2))), "r and -r")
    wrong(ch04.robust_weight(lambda r, s: 1 / (1 + np.abs(r / s))), "expected")
    wrong(ch04.robust_weight(lambda r, s: (np.abs(r) <= s) * 1.0), "not ½")


def test_a_rotation_that_slips() -> None:
    assert ch04.turned_sideways({"error in x": -27.0, "error in z": -11.0}).passed
    wrong(ch04.turned_sideways({"error in x": 2.0, "error in z": 0.1}), "only 2.0 mm")
    wrong(ch04.turned_sideways({"error in x": 30.0, "error in z": -40.0}), "in z, too")
