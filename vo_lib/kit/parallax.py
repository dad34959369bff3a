"""Chapter 4, beyond the paper: what one frame's matches say of the cameras' errors, its motion being free."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..geometry.camera import StereoCamera
from ..geometry.matches import StereoMatches
from ..geometry.types import Array

MIN_PARALLAX_DISPARITY_PX = 0.3  # pixels; features of smaller disparity are left out
MIN_DEPTH_RATIO = 0.05  # smallest depth in the current frame, as a share of that in the previous one
MIN_PARALLAX_FEATURES = 10  # features; fewer say nothing
MIN_NOISE_PX = 0.1  # pixels; no frame's noise is taken to be smaller
MEDIAN_SQUARED_RESIDUAL = 2.366  # median of a squared residual of unit noise with three free rows


def parallax_information(
    camera: StereoCamera,
    matches: StereoMatches,
    R_cp: Array,
    t_cp: Array,
    effects: Callable[[Array, Array], Array],
    scale: float,
) -> tuple[Array, Array] | None:
    """What a frame says of K errors of the cameras: information (K, K), and it times their sizes (K,).

    With D = f b / Z, the disparity that a feature should have in the previous pair, and the errors' effect e,

        (X, Y, Z) = R_cp (x_p - e_uv / f, 1) + D / (f b) t_cp

    is its place in the current frame, in units of its previous depth, and there are measured

        d_p = D + e_d,   (u_c, v_c) = f (X, Y) / Z + e_uv,   d_c = D / Z + e_d.

    One Gauss-Newton step over every D, R_cp and t_cp, which are eliminated. Cauchy weights.

    Parameters
    ----------
    matches : corrected as well as is known; R_cp, t_cp : start of the motion.
    effects : from normalised left positions (2, N) and disparities (N,), pixels, to what errors of size 1 add
        to u and v on the left and to the disparity, (K, 3, N), pixels.
    scale : residual at which a feature's weight is halved, pixels.

    Returns None where too few features are left or the motion has no unique answer.
    """
    matches = matches[matches.prev_left[:, 0] - matches.prev_right[:, 0] > MIN_PARALLAX_DISPARITY_PX]
    if len(matches) < MIN_PARALLAX_FEATURES:
        return None
    f, fb = camera.f, camera.f * camera.baseline
    x_p, x_c = camera.normalise(matches.prev_left).T, camera.normalise(matches.cur_left).T
    D, d_c = (matches.prev_left - matches.prev_right)[:, 0], (matches.cur_left - matches.cur_right)[:, 0]
    one = np.ones_like(D)
    ray = R_cp @ np.vstack([x_p, one])
    X, Y, Z = ray + D / fb * t_cp[:, None]
    Z = np.maximum(Z, MIN_DEPTH_RATIO)
    place, s = np.stack([X, Y]) / Z, f / Z
    residual = np.stack([0.0 * D, *(f * (x_c - place)), d_c - D / Z])
    # Where the points should be: noise of a place in both derivative and residual would add up.
    before, now = effects(x_p, D), effects(place, D / Z)
    # How the place changes by a rotation, by t and by the errors, (6 + K, 3, N).
    moves = np.zeros((6 + len(now), 3, len(D)))
    moves[[0, 1, 2], [1, 2, 0]], moves[[0, 1, 2], [2, 0, 1]] = -ray[[2, 0, 1]], ray[[1, 2, 0]]
    moves[[3, 4, 5], [0, 1, 2]] = D / fb
    moves[6:] = -np.einsum("ij,kjn->kin", R_cp[:, :2] / f, before[:, :2])
    by = np.zeros((len(moves), 4, len(D)))
    by[:, 1:3] = s * (moves[:, :2] - place * moves[:, 2:])
    by[:, 3] = -D / Z**2 * moves[:, 2]
    by[6:, 0] = before[:, 2]
    by[6:, 1:] += now
    toward = (t_cp[:2, None] - t_cp[2] * place) * s / fb
    by_D = np.stack([one, *toward, (1.0 - t_cp[2] * D / (fb * Z)) / Z])
    # Without the part along by_D, D is eliminated: the projector I - J Jᵀ / JᵀJ of each feature.
    norm = np.maximum(np.sum(by_D**2, axis=0), 1e-12)
    residual = residual - by_D * (np.sum(by_D * residual, axis=0) / norm)
    by = by - by_D * (np.sum(by_D * by, axis=1) / norm)[:, None]
    squared = np.sum(residual**2, axis=0)
    weighted = (by / (1.0 + squared / scale**2)).reshape(len(by), -1)
    H, g = weighted @ by.reshape(len(by), -1).T, weighted @ residual.ravel()
    try:
        by_motion = np.linalg.solve(H[:6, :6], np.column_stack([g[:6], H[:6, 6:]]))
    except np.linalg.LinAlgError:
        return None
    noise = max(float(np.median(squared)) / MEDIAN_SQUARED_RESIDUAL, MIN_NOISE_PX**2)
    change, information = by_motion[:, 0], H[6:, 6:] - H[6:, :6] @ by_motion[:, 1:]
    return information / noise, (g[6:] - H[6:, :6] @ change) / noise
