"""Exercises of chapter 4: the eight rows, one feature, far features, stacking, depth, robust weights."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from ...beyond.translation import solve_translation
from ...config import TranslationConfig
from ...core.camera import StereoCamera
from ...core.geometry import rotation_from_vector
from ...core.matches import StereoMatches
from ...core.types import Array
from ...method.translation import feature_rows as library_rows
from .verdict import Wrong, as_array, as_number, differs, exercise

CAMERA = StereoCamera(f=700.0, cx=600.0, cy=180.0, baseline=0.5, width=1241, height=376)
R_CP = rotation_from_vector(np.array([0.01, 0.05, -0.02]))
T_CP = np.array([0.05, -0.02, -0.9])
VIEWS = ("previous left", "previous right", "current left", "current right")
FAR, NEAR, FOCAL = 40.0, 8.0, 700.0  # exercise on depth: metres, metres, pixels


def exact_matches(count: int, seed: int, noise: float = 0.0) -> StereoMatches:
    """Matches (count,) of random points 5 to 40 m ahead under R_CP, T_CP, with noise in pixels."""
    rng = np.random.default_rng(seed)
    z = rng.uniform(5.0, 40.0, count)
    Q = np.stack([rng.uniform(-0.7, 0.7, count) * z, rng.uniform(-0.2, 0.2, count) * z, z], axis=1)
    places = np.stack([*CAMERA.project(Q), *CAMERA.project(Q @ R_CP.T + T_CP)])
    a, b, c, d = places + rng.normal(0.0, noise, places.shape)
    ones = np.ones(count, np.int64)
    return StereoMatches(a, b, c, d, ones, np.ones(count), np.arange(count))


@exercise
def feature_rows(function: Callable[..., Any]) -> str:
    """A function (x_pl, x_pr, x_cl, x_cr, R_cp, b) -> M (8, 6), c (8,) of equation (3) for one feature."""
    matches = exact_matches(1, 3)
    views = (matches.prev_left, matches.prev_right, matches.cur_left, matches.cur_right)
    x = [CAMERA.normalise(uv)[0] for uv in views]
    A, B, c = (part[0] for part in library_rows(CAMERA, matches, R_CP))
    expected = np.concatenate([A, B], axis=1)
    answer = function(*(each.copy() for each in x), R_CP.copy(), CAMERA.baseline)
    if not isinstance(answer, tuple) or len(answer) != 2:
        raise Wrong("the function should give back two arrays.", "return M, c")
    M, right = as_array(answer[0], (8, 6), "M"), as_array(answer[1], (8,), "c")
    if not differs(M, expected, 1e-9):
        if not differs(right, c, 1e-9):
            return "the library's rows, for one feature: M (Q, t) = c."
        if not differs(right, -c, 1e-9):
            raise Wrong(
                "c has the wrong sign.", "in a right image x (e3ᵀ P) = e1ᵀ P - b, so the row gives -b."
            )
        if not differs(right, np.zeros(8), 1e-9):
            raise Wrong("c is zero: then the point has no size.", "the right images carry the baseline.")
        raise Wrong("M is right, c is not.", "-b in the x rows of the right images (1-based: rows 3 and 7).")
    flipped = -1.0 if not differs(M, -expected, 1e-9) else 1.0
    if flipped < 0:
        raise Wrong("every row has the other sign.", "as the paper: (x e3 - e1)ᵀ P, not (e1 - x e3)ᵀ P.")
    if not differs(M[:, :3], expected[:, :3], 1e-9):
        raise Wrong(
            "the columns of Q are right, those of t are not.",
            "t enters in the current pair only, with the row (x e3 - e1)ᵀ itself.",
        )
    unturned = library_rows(CAMERA, matches, np.eye(3))[0][0]
    if not differs(M[:, :3], unturned, 1e-9):
        raise Wrong("the rotation is missing.", "in the current pair P = R Q + t: the row times R.")
    backwards = library_rows(CAMERA, matches, R_CP.T)[0][0]
    if not differs(M[:, :3], backwards, 1e-9):
        raise Wrong("the rotation is used the other way round.", "row @ R_cp, not row @ R_cp.T.")
    wrong = int(np.argmax(np.abs(M - expected).max(axis=1) > 1e-9))
    raise Wrong(
        f"row {wrong + 1} ({'xy'[wrong % 2]} in the {VIEWS[wrong // 2]} image) is not as expected.",
        "order: x and y in previous left, previous right, current left, current right.",
    )


@exercise
def one_feature(function: Callable[..., Any]) -> str:
    """A function (M (8, 6), c (8,)) -> t_cp (3,), metres, from one feature."""
    A, B, c = (part[0] for part in library_rows(CAMERA, exact_matches(1, 4, noise=0.3), R_CP))
    M = np.concatenate([A, B], axis=1)
    solution = np.linalg.lstsq(M, c, rcond=None)[0]
    answer = function(M.copy(), c.copy())
    if np.size(answer) == 6 and not differs(np.ravel(answer), solution, 1e-6):
        raise Wrong("this is (Q, t), six numbers.", "t are the last three.")
    got = as_array(answer, (3,), "t")
    if not differs(got, solution[:3], 1e-6):
        raise Wrong("these are the first three unknowns: the point Q.", "t are the last three.")
    if differs(got, solution[3:], 1e-6):
        raise Wrong(
            f"got {got.round(3)}, expected {solution[3:].round(3)}.", "np.linalg.lstsq(M, c, rcond=None)[0]."
        )
    return f"t = {got.round(3)} m from one noisy feature; true is {T_CP}."


@exercise
def rank_at_infinity(answer: Any) -> str:
    """The rank of the 8×6 matrix of a feature whose disparity is zero in both pairs."""
    value = as_number(answer)
    right = 4
    if value == 6:
        raise Wrong(
            "with rank 6 such a feature would tell t.",
            "without a disparity, which two rows of a pair are equal?",
        )
    if value == 8:
        raise Wrong("a matrix of six columns has no rank 8.", "np.linalg.matrix_rank(M).")
    if value != right:
        raise Wrong(
            f"{value:g} is not it.",
            "x and x' are equal, y and y' too: each pair has two different rows left.",
        )
    return "4: each pair keeps two of its four rows. Such a feature knows a direction, and no length."


@exercise
def row_error(answer: Any) -> str:
    """How many times larger the error of a row is at 40 m than at 8 m, for the same error in pixels."""
    value, right = as_number(answer), FAR / NEAR
    if abs(value - right**2) < 0.5:
        raise Wrong(
            "this is how the depth error grows.", "a row is (x e3 - e1)ᵀ P: an error dx changes it by dx · Z."
        )
    if abs(value - 1.0 / right) < 0.02 or abs(value - 1.0) < 1e-6:
        raise Wrong("far rows are not better, and not equal.", "which factor stands beside x in a row?")
    if abs(value - right) > 0.05:
        raise Wrong(f"{value:.3g} is not it.", "d/dx of (x e3 - e1)ᵀ P is e3ᵀ P = Z.")
    return f"Z: {right:g} times. So a row divided by Z has the same error, dx, at every depth."


@exercise
def stack(function: Callable[..., Any]) -> str:
    """A function (A (N, 8, 3), B (N, 8, 3), c (N, 8)) -> t (3,): the least-squares t of A Q_i + B t = c."""
    matches = exact_matches(30, 5, noise=0.5)
    rows = library_rows(CAMERA, matches, R_CP)
    solved = solve_translation(CAMERA, matches, R_CP, TranslationConfig(variant="unweighted", max_depth=1000))
    assert solved is not None
    expected = solved[0]
    got = as_array(function(*(part.copy() for part in rows)), (3,), "t")
    if not differs(got, expected, 1e-6):
        return f"t = {got.round(4)} m, as the library's `unweighted` variant has it."
    singles = np.array([_alone(*(part[i] for part in rows)) for i in range(30)])
    if not differs(got, singles.mean(axis=0), 1e-6):
        raise Wrong(
            "this is the mean of the features' own answers: a far one counts as much as a near one.",
            "one t for all rows at once; only Q differs from feature to feature.",
        )
    if not differs(got, np.asarray(np.median(singles, axis=0), np.float64), 1e-6):
        raise Wrong("this is the median of the features' own answers.", "one t for all rows at once.")
    without = np.linalg.lstsq(rows[1].reshape(-1, 3), rows[2].reshape(-1), rcond=None)[0]
    if not differs(got, np.asarray(without, np.float64), 1e-6):
        raise Wrong(
            "the points Q are left out.", "eliminate each Q: N = I - A_i pinv(A_i), then N B_i, N c_i."
        )
    raise Wrong(
        f"got {got.round(4)}, expected {expected.round(4)}.",
        "with N = I - A_i pinv(A_i): add up H += B_iᵀ N B_i and g += B_iᵀ N c_i, then solve H t = g.",
    )


def _alone(A: Array, B: Array, c: Array) -> Array:
    return np.asarray(np.linalg.lstsq(np.concatenate([A, B], axis=1), c, rcond=None)[0][3:])


@exercise
def robust_weight(function: Callable[..., Any]) -> str:
    """A function (r (N,), s) -> Cauchy weights (N,) of residuals."""
    r = np.array([0.0, 0.25, 0.5, -0.5, 2.0, 100.0])
    s = 0.5
    expected = 1.0 / (1.0 + (r / s) ** 2)
    got = as_array(function(r.copy(), s), (6,), "w")
    if not differs(got, expected, 1e-9):
        return "1 for a perfect feature, ½ at the scale s, and next to nothing for a mismatch."
    if abs(got[0] - 1.0) > 1e-9:
        raise Wrong(f"a feature without residual has weight {got[0]:.3g}, not 1.", "w = 1 / (1 + (r / s)²).")
    if not differs(got[[2]], got[[3]], 1e-9) and abs(got[2] - 0.5) > 1e-9:
        raise Wrong(f"at r = s the weight is {got[2]:.3g}, not ½.", "is r divided by s, and squared?")
    if abs(got[2] - got[3]) > 1e-9:
        raise Wrong("r and -r have different weights.", "square the residual.")
    if not differs(got, (np.abs(r) <= s).astype(float), 1e-9):
        raise Wrong("this is all or nothing.", "the Cauchy weight falls smoothly: 1 / (1 + (r / s)²).")
    raise Wrong(f"got {got.round(3)}, expected {expected.round(3)}.", "w = 1 / (1 + (r / s)²).")


@exercise
def turned_sideways(facts: Mapping[str, float]) -> str:
    """The panel shows an error of more than 20 mm in x, at most half of that in z, by a wrong rotation."""
    x, z = abs(facts.get("error in x", np.nan)), abs(facts.get("error in z", np.nan))
    if not x > 20.0:
        raise Wrong(
            f"the error in x is only {x:.1f} mm.", "turn the rotation a little; leave the rest as it is."
        )
    if not x > 2.0 * z:
        raise Wrong(
            f"{x:.0f} mm in x, but {z:.0f} mm in z, too.",
            "less wrong matches, less noise, weighting `stacked`: only the rotation is to blame.",
        )
    return f"{x:.0f} mm in x against {z:.0f} mm in z: what turns too far seems to slip sideways."
