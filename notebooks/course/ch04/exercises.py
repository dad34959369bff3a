"""Exercises of chapter 4: eight rows, one feature, far features, the weighted system, depth, robust weights."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from vo_lib.geometry.matches import StereoMatches
from vo_lib.geometry.motion import rigid, rotation_from_vector
from vo_lib.geometry.types import Array
from vo_lib.paper.translation import eliminate_points
from vo_lib.paper.translation import feature_rows as library_rows

from ..ch00.exercises import CAMERA
from ..checker import Case, Condition, Exercise
from .weightings import (
    alone,
    bias_and_deviation,
    length_errors,
    noisy_matches,
    solve_all,
    spread_points,
    weights_by_depth,
    weights_by_residual,
)

R_CP = rotation_from_vector(np.array([0.01, 0.05, -0.02]))
T_CP = np.array([0.05, -0.02, -0.9])
FAR = 40.0  # metres
NEAR = 8.0  # metres


def matches_ahead(count: int, seed: int, noise: float = 0.0) -> StereoMatches:
    """Matches (count,) of random points 5 to 40 m ahead for the motion R_CP, T_CP, with noise in pixels."""
    return noisy_matches(CAMERA, spread_points(count, seed, 5.0, 40.0), rigid(R_CP, T_CP), noise, seed)


def one_match() -> list[Case]:
    """One case with the four normalised points of a match, the rotation and the baseline."""
    match = matches_ahead(1, 3)
    x_pl = CAMERA.normalise(match.prev_left)[0]
    x_pr = CAMERA.normalise(match.prev_right)[0]
    x_cl = CAMERA.normalise(match.cur_left)[0]
    x_cr = CAMERA.normalise(match.cur_right)[0]
    return [(x_pl, x_pr, x_cl, x_cr, R_CP, CAMERA.baseline)]


def eight_rows(
    x_pl: Array, x_pr: Array, x_cl: Array, x_cr: Array, R_cp: Array, b: float
) -> tuple[Array, Array]:
    """M (8, 6) and c (8,) of one feature; rows: x, y of previous left and right, current left and right."""
    parts = []
    for x in (x_pl, x_pr):
        two_rows = _rows_of_image(x)
        parts.append(np.hstack([two_rows, np.zeros((2, 3))]))  # P = Q: no t
    for x in (x_cl, x_cr):
        two_rows = _rows_of_image(x)
        parts.append(np.hstack([two_rows @ R_cp, two_rows]))  # P = R Q + t
    c = np.array([0.0, 0, -b, 0, 0, 0, -b, 0])
    return np.vstack(parts), c


def _rows_of_image(x: Array) -> Array:
    """The rows x e3 - e1 and y e3 - e2, (2, 3), of a normalised point (2,)."""
    e1, e2, e3 = np.eye(3)
    return np.array([x[0] * e3 - e1, x[1] * e3 - e2])


def scaled_rows(x: float, y: float) -> Callable[..., tuple[Array, Array]]:
    """Answer: the eight rows, with the factor `x` for rows in x and the factor `y` for rows in y."""
    factors = np.tile([x, y], 4)

    def scaled(*case: Any) -> tuple[Array, Array]:
        M, c = eight_rows(*case)
        return factors[:, None] * M, factors * c

    return scaled


def t_before_Q(*case: Any) -> tuple[Array, Array]:
    """Wrong answer: the columns of t come before those of Q."""
    M, c = eight_rows(*case)
    return np.roll(M, 3, axis=1), c


def pairs_exchanged(
    x_pl: Array, x_pr: Array, x_cl: Array, x_cr: Array, R_cp: Array, b: float
) -> tuple[Array, Array]:
    """Wrong answer: the points of the current pair are taken for those of the previous pair."""
    return eight_rows(x_cl, x_cr, x_pl, x_pr, R_cp, b)


def current_pair_first(*case: Any) -> tuple[Array, Array]:
    """Wrong answer: as `pairs_exchanged`, with the rows of the previous pair first."""
    M, c = pairs_exchanged(*case)
    return np.roll(M, 4, axis=0), np.roll(c, 4)


def left_and_right_exchanged(
    x_pl: Array, x_pr: Array, x_cl: Array, x_cr: Array, R_cp: Array, b: float
) -> tuple[Array, Array]:
    """Wrong answer: the rows of the right images come first, with the baseline."""
    M, _ = eight_rows(x_pr, x_pl, x_cr, x_cl, R_cp, b)
    return M, np.array([-b, 0, 0, 0, -b, 0, 0, 0])


def baseline_in_the_left_images(*case: Any) -> tuple[Array, Array]:
    """Wrong answer: the right M, and the baseline in the rows of the left images."""
    M, c = eight_rows(*case)
    return M, np.roll(c, -2)


def solve(M: Array, c: Array) -> Array:
    """The least-squares solution (Q, t) (6,) of one feature."""
    return np.asarray(np.linalg.lstsq(M, c, rcond=None)[0])


def noisy_rows(count: int, seed: int, noise: float) -> tuple[Array, Array, Array]:
    """A (N, 8, 3), B (N, 8, 3) and c (N, 8) of noisy matches."""
    return library_rows(CAMERA, matches_ahead(count, seed, noise), R_CP)


def stacked(A: Array, B: Array, c: Array, w: Array) -> Array:
    """The t of all features with weights w (N,), after the elimination of the points Q by projection."""
    M, d = eliminate_points(A, B, c)
    return solve_all(M, d, w)


def two_weights(
    of_left: Callable[[Array], Array], of_right: Callable[[Array], Array]
) -> Callable[..., Array]:
    """Wrong answer: the two sums of the system have the given functions of the weights."""

    def solved(A: Array, B: Array, c: Array, w: Array) -> Array:
        M, d = eliminate_points(A, B, c)
        H = np.einsum("i,ija,ijb->ab", of_left(w), M, M)
        return np.asarray(np.linalg.solve(H, np.einsum("i,ija,ij->a", of_right(w), M, d)))

    return solved


def one_projection(left: bool) -> Callable[..., Array]:
    """Wrong answer: the projection N is only in the sum on the left (or, with `left` false, on the right)."""

    def solved(A: Array, B: Array, c: Array, w: Array) -> Array:
        M, d = eliminate_points(A, B, c)
        if left:
            H = np.einsum("i,ija,ijb->ab", w, M, M)
            g = np.einsum("i,ija,ij->a", w, B, c)
        else:
            H = np.einsum("i,ija,ijb->ab", w, B, B)
            g = np.einsum("i,ija,ij->a", w, M, d)
        return np.asarray(np.linalg.solve(H, g))

    return solved


def weighted_frames() -> list[Case]:
    """Cases with the rows of thirty noisy features: different weights, then equal weights."""
    A, B, c = noisy_rows(30, 5, 0.5)
    different = np.random.default_rng(6).uniform(0.05, 2.0, 30)
    return [(A, B, c, different), (A, B, c, np.ones(30))]


def one_noisy_feature() -> list[Case]:
    """One case with the rows M (8, 6) and c (8,) of a noisy feature."""
    A, B, c = noisy_rows(1, 3, 0.3)
    return [(np.hstack([A[0], B[0]]), c[0])]


def residual_cases() -> list[Case]:
    """Cases with residuals (N,), among them 0 and the scale itself, and their scale."""
    cases: list[Case] = []
    for s in (0.5, 0.8, 2.0):
        for r in ([0.0], [1.0], [0.0, 0.5, 1.0, -1.0, 4.0, 200.0]):
            cases.append((s * np.array(r), s))
    return cases


def is_multiple(M: Array, *case: Any) -> bool:
    """Whether M is a multiple of the eight rows of a case."""
    right, _ = eight_rows(*case)
    factor = np.sum(M * right) / np.sum(right**2)
    return bool(abs(factor) > 1e-6 and np.allclose(M, factor * right, atol=1e-9))


def drawn_answers() -> list[Case]:
    """Cases with S estimated translations (S, 3) and the true translation (3,), metres."""
    rng = np.random.default_rng(8)
    return [(0.97 * T_CP + rng.normal(0.0, 0.01, (count, 3)), T_CP) for count in (5, 20)]


def norm(vectors: Array) -> Array:
    """Lengths of vectors (..., 3)."""
    return np.asarray(np.linalg.norm(vectors, axis=-1))


def only_residual_is(scales: float) -> Callable[..., bool]:
    """Test for cases with a single residual, of so many scales."""
    return lambda w, r, s: len(r) == 1 and r[0] == scales * s and np.isfinite(w)


SCALED = (
    "these are the right equations times a common factor; with the factor 1, a row is a distance in metres."
)

feature_rows = Exercise(
    eight_rows,
    one_match,
    parts=("M", "c"),
    also=(scaled_rows(-1, -1), scaled_rows(-1, 1), scaled_rows(1, -1)),
    praise="the library's rows (up to a sign), for one feature: M (Q, t) = c.",
    hint="order of the rows: x and y in previous left, previous right, current left, current right.",
    line="row = x[0] * e3 - e1; M.append(np.concatenate([row @ R_cp, row]))",
    library=("feature_rows",),
    mistakes={
        "the rotation is missing: in the current pair P = R Q + t.": (
            lambda x_pl, x_pr, x_cl, x_cr, R_cp, b: eight_rows(x_pl, x_pr, x_cl, x_cr, np.eye(3), b)
        ),
        "R is transposed: the row multiplies R Q from the left, so the columns of Q are row @ R_cp.": (
            lambda x_pl, x_pr, x_cl, x_cr, R_cp, b: eight_rows(x_pl, x_pr, x_cl, x_cr, R_cp.T, b)
        ),
        "previous and current pair are exchanged: R and t belong to the rows of the current pair.": (
            pairs_exchanged,
            current_pair_first,
        ),
        "left and right images are exchanged.": left_and_right_exchanged,
        "x and y are exchanged: the row of x contains e1.": (
            lambda x_pl, x_pr, x_cl, x_cr, R_cp, b: eight_rows(
                x_pl[::-1], x_pr[::-1], x_cl[::-1], x_cr[::-1], R_cp, b
            )
        ),
        "the baseline is taken as 1: use `b`.": (
            lambda x_pl, x_pr, x_cl, x_cr, R_cp, b: eight_rows(x_pl, x_pr, x_cl, x_cr, R_cp, 1.0)
        ),
        "the columns are in another order: Q first, then t.": (t_before_Q),
        SCALED: Condition(is_multiple),
        "the columns of Q are right, the columns of t are not: t appears in the current pair only, without R.": Condition(
            lambda M, *case: np.allclose(M[:, :3], eight_rows(*case)[0][:, :3])
        ),
        "M is right, c is not: the baseline appears only in the x rows of the two right images.": (
            baseline_in_the_left_images,
            Condition(lambda c, *case: c.shape == (8,)),
        ),
    },
    slips={"double": SCALED, "half": SCALED}
    | {"order": "correct rows in another order: x and y of an image, then x and y of the next image."},
)

one_feature = Exercise(
    lambda M, c: solve(M, c)[3:],
    one_noisy_feature,
    atol=1e-6,
    praise="t = ({got[0]:.3f}, {got[1]:.3f}, {got[2]:.3f}) m from one noisy feature; the true t is (0.05, -0.02, -0.9) m.",
    hint="solve M q = c by least squares; t is the last three of the six numbers in q.",
    line="np.linalg.lstsq(M, c, rcond=None)[0][3:]",
    mistakes={
        "`np.linalg.lstsq` returns a tuple; the solution is its first element, `[0]`.": np.linalg.lstsq,
        "this is (Q, t), six numbers; t is the last three.": solve,
        "this is the point Q; t is the last three numbers.": lambda M, c: solve(M, c)[:3],
    },
)

rank_at_infinity = Exercise(
    4,
    praise="4: each pair has two different rows. Such a feature tells in which direction the mountain "
    "lies, before and now, but neither its distance nor anything of t.",
    hint="left and right points are equal, so the rows of a pair repeat: count the different rows.",
    line="np.linalg.matrix_rank(rows_of_one(x, x, x, x, np.eye(3), 0.5)[0])",
    mistakes={
        "with rank 6 the feature would determine t. Without a disparity, two rows of each pair repeat.": 6,
        "a matrix with six columns has at most rank 6.": 8,
    },
)

row_error = Exercise(
    FAR / NEAR,
    rtol=0.01,
    praise="{right:g} times: the error is dx · P₃. A row divided by its depth has the error dx at every depth.",
    hint="by how much does (x e3 - e1)ᵀ P change when x changes by dx?",
    line="40 / 8",
    mistakes={
        "this is the growth of the depth error; a row changes by dx · P₃.": (FAR / NEAR) ** 2,
        "the error of a row grows with the depth: dx is multiplied by P₃.": (NEAR / FAR, 1.0),
        "this is a difference; the task asks for the quotient of both errors.": (
            FAR - NEAR,
            FAR / NEAR - 1.0,
        ),
        "the half pixel is in both errors, and the quotient does not contain it.": (
            0.5 * FAR / NEAR,
            2.0 * FAR / NEAR,
            0.5 * FAR,
            2.0 * FAR,
        ),
    },
)

stack = Exercise(
    stacked,
    weighted_frames,
    atol=1e-6,
    praise="t = ({got[0]:.4f}, {got[1]:.4f}, {got[2]:.4f}) m, as with the library's `eliminate_points`.",
    hint="for each feature compute N_i; add up w_i B_iᵀ N_i B_i and w_i B_iᵀ N_i c_i; solve one 3×3 system at the end.",
    line="N = np.eye(8) - A[i] @ np.linalg.pinv(A[i]); H += w[i] * B[i].T @ N @ B[i]; g += w[i] * B[i].T @ N @ c[i]",
    library=("eliminate_points", "solve_translation", "robust_translation"),
    mistakes={
        "the weights are not used: each term of both sums is multiplied by its `w[i]`.": two_weights(
            np.ones_like, np.ones_like
        ),
        "the weight is in one of the two sums only; it belongs to both.": (
            two_weights(np.asarray, np.ones_like),
            two_weights(np.ones_like, np.asarray),
        ),
        "the weights are squared here. `w[i]` multiplies the square of a feature, not its rows.": two_weights(
            np.square, np.square
        ),
        "these are the square roots of the weights: `w[i]` multiplies B_iᵀ N_i B_i as it is.": two_weights(
            np.sqrt, np.sqrt
        ),
        "this is the mean or the median of the single answers; solve for one t with all rows at once.": (
            lambda A, B, c, w: alone(A, B, c).mean(axis=0),
            lambda A, B, c, w: np.median(alone(A, B, c), axis=0),
            lambda A, B, c, w: np.average(alone(A, B, c), axis=0, weights=w),
        ),
        "the points Q are ignored; eliminate them first.": (
            lambda A, B, c, w: solve_all(B, c, np.ones(len(w))),
            lambda A, B, c, w: solve_all(B, c, w),
        ),
        "N_i is missing in one of the two sums: it belongs to B_iᵀ N_i B_i and to B_iᵀ N_i c_i.": (
            one_projection(left=True),
            one_projection(left=False),
        ),
        "this is the answer of the last feature alone: add the terms of all features up before you solve.": (
            lambda A, B, c, w: alone(A, B, c)[-1]
        ),
    },
)

depth_weight = Exercise(
    weights_by_depth,
    lambda: [(np.array(Z),) for Z in ([2.0], [8.0, 40.0], [4.0, 5.0, 70.0, 12.5])],
    library=("weights_by_depth",),
    praise="a feature at 40 m has a 25th of the weight of a feature at 8 m, and its error in metres is five times as large.",
    hint="each row is divided by Z, and then it is squared.",
    line="1 / Z**2",
    mistakes={
        "this divides the squares by Z. Each *row* is divided by Z, and the sum has the squares of the rows.": (
            lambda Z: 1 / Z
        ),
        "far features get the largest weight here: their rows have the largest errors.": (
            lambda Z: Z**2,
            lambda Z: Z,
        ),
        "with these weights the rows stay in metres.": lambda Z: np.ones(len(Z)),
        "a sum of 1 is not needed: a common factor changes no least squares, and each weight depends on its own depth "
        "only.": (
            lambda Z: weights_by_depth(Z) / weights_by_depth(Z).sum(),
            lambda Z: weights_by_depth(Z) / weights_by_depth(Z).mean(),
        ),
    },
)

bias = Exercise(
    bias_and_deviation,
    drawn_answers,
    parts=("bias", "scatter"),
    atol=1e-6,
    library=("bias_and_deviation", "length_errors"),
    praise="bias {got[0]:+.2f} %, scatter {got[1]:.2f} %: more features reduce only the scatter.",
    hint="compute the length of each answer first, then compare it with the true length.",
    line="off = 100 * (np.linalg.norm(answers, axis=1) / np.linalg.norm(t_true) - 1); off.mean(), off.std(ddof=1)",
    mistakes={
        "this is the mean distance from the true translation, to which sideways scatter contributes.": (
            lambda v, t: (100 * norm(v - t).mean() / norm(t), length_errors(v, t).std(ddof=1))
        ),
        "this is the length of the mean answer; take the mean of the lengths.": lambda v, t: (
            100 * (norm(v.mean(axis=0)) / norm(t) - 1),
            length_errors(v, t).std(ddof=1),
        ),
        "this is in metres, not in % of the true length.": (
            lambda v, t: (norm(v).mean() - norm(t), norm(v).std(ddof=1)),
            lambda v, t: (length_errors(v, t).mean(), norm(v).std(ddof=1)),
        ),
        "the scatter divides by S here, as `np.std` does by itself; the deviation of a sample is over S - 1: "
        "`ddof=1`.": lambda v, t: (length_errors(v, t).mean(), length_errors(v, t).std()),
        "this is the scatter of the translations; the task is the scatter of their lengths.": (
            lambda v, t: (length_errors(v, t).mean(), 100 * norm(v - t).std(ddof=1) / norm(t)),
            lambda v, t: (length_errors(v, t).mean(), 100 * norm(v.std(axis=0, ddof=1)) / norm(t)),
        ),
    },
)

robust_weight = Exercise(
    weights_by_residual,
    residual_cases,
    library=("weights_by_residual",),
    praise="1 for a residual of zero, ½ at the scale s, and nearly 0 for a mismatch.",
    hint="divide r by s, square the quotient, add 1, take the inverse.",
    line="1 / (1 + (r / s) ** 2)",
    mistakes={
        "r / s is not squared.": (lambda r, s: 1 / (1 + np.abs(r) / s), lambda r, s: 1 / (1 + r / s)),
        "these are Huber's weights; Cauchy's are below 1 for every residual but zero.": lambda r, s: (
            np.minimum(1.0, s / np.maximum(np.abs(r), 1e-12))
        ),
        "this is all or nothing; the Cauchy weight falls smoothly.": lambda r, s: np.abs(r) <= s,
        "the weights are divided by their sum; each weight depends only on its own residual.": lambda r, s: (
            weights_by_residual(r, s) / weights_by_residual(r, s).sum()
        ),
        "this is a Gaussian, which falls much faster than Cauchy's weight.": (
            lambda r, s: np.exp(-((r / s) ** 2)),
            lambda r, s: np.exp(-0.5 * (r / s) ** 2),
        ),
        "this is the square root of the weight.": lambda r, s: np.sqrt(weights_by_residual(r, s)),
        "the scale is fixed: use `s`.": lambda r, s: weights_by_residual(r, 0.5),
        "a feature without residual has weight {got:.3g}, not 1: is this the cost, or the inverse?": (
            Condition(only_residual_is(0.0))
        ),
        "at r = s the weight is {got:.3g}, not ½: divide r by s, then square the quotient.": (
            Condition(only_residual_is(1.0))
        ),
    },
)

turned_sideways = Exercise(
    {"error in x": -35.0, "error in z": 10.0, "error in x / rotation error": 10.0, "depth limit": 15.0}
    | {"rotation error": 0.2, "wrong share": 0.0, "noise added": 0.1},
    praise="{rotation error:.2f}° cause {error in x:.0f} mm in x; the ratio is the mean depth, "
    "{error in x / rotation error:.0f} m. Near features need a larger rotation error for the same error in x.",
    mistakes={
        "there is no ground truth: choose another sequence.": lambda now: np.isnan(now["error in x"]),
        "the rotation is exact, so this error has another cause: move `rotation error`.": lambda now: (
            not abs(now["rotation error"]) > 0
        ),
        "{wrong share:.0f} % of the matches are wrong, and {noise added:.2f} px of noise is added. Set `wrong share` "
        "to 0 and `noise added` to 0.1 at most: the rotation alone should cause the error.": lambda now: (
            now["wrong share"] > 0 or now["noise added"] > 0.1
        ),
        "features up to {depth limit:.0f} m are used: lower `depth limit` to 15 m.": lambda now: (
            not now["depth limit"] <= 15.0
        ),
        "only {error in x:.1f} mm: the error in x is the depth times the angle, and these features are near."
        "": lambda now: not abs(now["error in x"]) > 30.0,
        "{error in x:.0f} mm in x, but {error in z:.0f} mm in z as well. Choose the first weighting of the list: with "
        "the other weightings, moving cars cause the error in z.": lambda now: (
            not abs(now["error in x"]) >= 2.0 * abs(now["error in z"])
        ),
    },
)
