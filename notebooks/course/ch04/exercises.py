"""Exercises of chapter 4: the eight rows, one feature, far features, stacking, depth, robust weights."""

from __future__ import annotations

import numpy as np

from vo_lib.core.camera import StereoCamera
from vo_lib.core.geometry import rotation_from_vector
from vo_lib.core.matches import StereoMatches
from vo_lib.core.types import Array
from vo_lib.method.translation import feature_rows as library_rows

from ..checker import Case, Exercise

CAMERA = StereoCamera(f=700.0, cx=600.0, cy=180.0, baseline=0.5, width=1241, height=376)
R_CP = rotation_from_vector(np.array([0.01, 0.05, -0.02]))
T_CP = np.array([0.05, -0.02, -0.9])
FAR, NEAR = 40.0, 8.0  # metres
NO_T = np.array([1, 1, 1, 0, 0, 0])  # keeps the columns of Q


def exact_matches(count: int, seed: int, noise: float = 0.0) -> StereoMatches:
    """Matches (count,) of random points 5 to 40 m ahead under R_CP, T_CP, with noise in pixels."""
    rng = np.random.default_rng(seed)
    z = rng.uniform(5.0, 40.0, count)
    Q = np.stack([rng.uniform(-0.7, 0.7, count) * z, rng.uniform(-0.2, 0.2, count) * z, z], axis=1)
    places = np.stack([*CAMERA.project(Q), *CAMERA.project(Q @ R_CP.T + T_CP)])
    a, b, c, d = places + rng.normal(0.0, noise, places.shape)
    return StereoMatches(a, b, c, d, np.ones(count, np.int64), np.ones(count), np.arange(count))


def one_match() -> list[Case]:
    """The four normalised points of a match, its rotation and the baseline."""
    m = exact_matches(1, 3)
    x = [CAMERA.normalise(uv)[0] for uv in (m.prev_left, m.prev_right, m.cur_left, m.cur_right)]
    return [(*x, R_CP, CAMERA.baseline)]


def eight_rows(
    x_pl: Array, x_pr: Array, x_cl: Array, x_cr: Array, R_cp: Array, b: float
) -> tuple[Array, Array]:
    """M (8, 6) and c (8,) of one feature: x and y in previous left and right, current left and right."""
    M, c = np.zeros((8, 6)), np.array([0.0, 0, -b, 0, 0, 0, -b, 0])
    for view, x in enumerate((x_pl, x_pr, x_cl, x_cr)):
        rows = np.outer(x, [0, 0, 1]) - np.eye(3)[:2]
        M[2 * view : 2 * view + 2] = np.hstack([rows @ R_cp, rows] if view > 1 else [rows, 0.0 * rows])
    return M, c


def solve(M: Array, c: Array) -> Array:
    """(Q, t) (6,) of one feature by least squares."""
    return np.asarray(np.linalg.lstsq(M, c, rcond=None)[0])


def noisy_rows(count: int, seed: int, noise: float) -> tuple[Array, Array, Array]:
    """A (N, 8, 3), B (N, 8, 3) and c (N, 8) of noisy matches."""
    A, B, c = library_rows(CAMERA, exact_matches(count, seed, noise), R_CP)
    return A, B, c


def stacked(A: Array, B: Array, c: Array) -> Array:
    """The least-squares t of all features: what each point Q can explain is projected out."""
    N = np.eye(8) - A @ np.linalg.pinv(A)
    return solve((N @ B).reshape(-1, 3), (N @ c[..., None]).ravel())


def alone(A: Array, B: Array, c: Array) -> Array:
    """The t (N, 3) of each feature by itself."""
    return np.array([solve(np.hstack(rows[:2]), rows[2])[3:] for rows in zip(A, B, c, strict=True)])


def cauchy(r: Array, s: float) -> Array:
    """Cauchy weights of residuals."""
    return np.asarray(1.0 / (1.0 + (r / s) ** 2))


def drawn_answers() -> list[Case]:
    """Translations of a few draws (S, 3), and the true one."""
    rng = np.random.default_rng(8)
    return [(0.97 * T_CP + rng.normal(0.0, 0.01, (count, 3)), T_CP) for count in (5, 20)]


def bias_and_scatter(answers: Array, t_true: Array) -> tuple[float, float]:
    """Mean and standard deviation of the error of the lengths, per cent."""
    off = 100.0 * (np.linalg.norm(answers, axis=1) / np.linalg.norm(t_true) - 1.0)
    return float(off.mean()), float(off.std())


feature_rows = Exercise("ch04.feature_rows", eight_rows, one_match, parts=("M", "c"))

one_feature = Exercise(
    "ch04.one_feature",
    lambda M, c: solve(M, c)[3:],
    lambda: [(np.hstack([A[0], B[0]]), c[0]) for A, B, c in [noisy_rows(1, 4, 0.3)]],
    atol=1e-6,
)

rank_at_infinity = Exercise("ch04.rank_at_infinity", 4)

row_error = Exercise("ch04.row_error", FAR / NEAR, rtol=0.01)

stack = Exercise("ch04.stack", stacked, lambda: [noisy_rows(30, 5, 0.5)], atol=1e-6)

bias = Exercise("ch04.bias", bias_and_scatter, drawn_answers, parts=("bias", "scatter"), atol=1e-6)

robust_weight = Exercise(
    "ch04.robust_weight",
    cauchy,
    lambda: [(np.array(r), 0.5) for r in ([0.0], [0.5], [-0.5], [0.0, 0.25, 0.5, -0.5, 2.0, 100.0])],
)

turned_sideways = Exercise(
    "ch04.turned_sideways",
    {"error in x": -27.0, "error in z": -11.0}
    | {"rotation error": 0.1, "wrong share": 0.0, "noise added": 0.1},
)
