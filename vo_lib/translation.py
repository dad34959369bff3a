"""Chapter 4: the translation by linear least squares, equations (2) and (3) of the paper.

With R known, a feature seen at x = (u - cx) / f, y = (v - cy) / f gives two rows in each image:
(x e3 - e1)ᵀ P = 0 and (y e3 - e2)ᵀ P = 0 in a left image; (x e3 - e1)ᵀ P = -b in a right one, where
P = Q in the previous pair and P = R Q + t in the current one. Eight rows, six unknowns (Q, t).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .camera import StereoCamera
from .config import TranslationConfig
from .matching import StereoMatches

Array = NDArray[np.float64]


def feature_rows(camera: StereoCamera, matches: StereoMatches, R_cp: Array) -> tuple[Array, Array, Array]:
    """The system A Q + B t = c of every feature.

    Returns
    -------
    A (N, 8, 3), B (N, 8, 3), c (N, 8). Rows: x and y in previous left, previous right, current left,
    current right. Q in the previous left frame and t_cp, metres.
    """
    n = len(matches)
    A = np.zeros((n, 4, 2, 3))
    c = np.zeros((n, 4, 2))
    views = (matches.prev_left, matches.prev_right, matches.cur_left, matches.cur_right)
    for view, uv in enumerate(views):
        A[:, view, :, 2] = camera.normalise(uv)
        A[:, view, 0, 0] = A[:, view, 1, 1] = -1.0
    c[:, 1::2, 0] = -camera.baseline
    B = np.zeros_like(A)
    B[:, 2:] = A[:, 2:]
    A[:, 2:] = A[:, 2:] @ R_cp
    return A.reshape(n, 8, 3), B.reshape(n, 8, 3), c.reshape(n, 8)


def eliminate_points(A: Array, B: Array, c: Array, depth: Array) -> tuple[Array, Array, Array]:
    """Each feature's rows, divided by their depth (N, 8), with its point Q eliminated.

    Returns
    -------
    M (N, 8, 3) and y (N, 8): the rows projected onto the left null space of A, so that M t = y holds for
    the right t and |M t - y| is the residual of the best Q; and back (N, 3, 4): Q = back · (-t, 1).

    Raises numpy's `LinAlgError` where a feature's own rows do not determine Q.
    """
    A, B, c = A / depth[:, :, None], B / depth[:, :, None], c / depth
    At = np.swapaxes(A, 1, 2)
    back = np.linalg.solve(At @ A, At @ np.concatenate([B, c[:, :, None]], axis=2))
    return B - A @ back[:, :, :3], c - (A @ back[:, :, 3:])[:, :, 0], back


def robust_start(M: Array, y: Array, limit: float) -> Array:
    """The best of many translations from three features each: a start no wrong match can pull away.

    The triples are cut from the features in order, a third of them apart, so every feature is used once
    and nothing is random. The best one has the smallest sum of squared residuals, truncated at `limit`.
    """
    H = np.swapaxes(M, 1, 2) @ M
    g = np.einsum("nij,ni->nj", M, y)
    third = len(M) // 3
    triples = np.arange(3 * third).reshape(3, third)
    sums = [a[triples].sum(axis=0) for a in (H, g)] if third else [H[:1], g[:1]]
    # A triple of features on one line of sight leaves a direction open; close it gently.
    damping = 1e-9 * np.trace(sums[0], axis1=1, axis2=2)[:, None, None] * np.eye(3)
    t = np.linalg.solve(sums[0] + damping, sums[1][:, :, None])[:, :, 0]
    # |M t - y|² of all features under all translations is a quadratic form: two matrix products.
    quadratic = (t[:, :, None] * t[:, None, :]).reshape(len(t), 9) @ H.reshape(-1, 9).T
    squared = quadratic - 2.0 * t @ g.T + np.sum(y * y, axis=1)
    return np.asarray(t[np.argmin(np.minimum(squared, limit**2).sum(axis=1))])


def solve_translation(
    camera: StereoCamera, matches: StereoMatches, R_cp: Array, config: TranslationConfig
) -> tuple[Array, Array] | None:
    """One translation for all features: stacked, weighted, robust.

    Each Q is eliminated (the 8×3 block is projected onto its left null space), which leaves a 3×3
    normal equation for t. A row is an error in metres and grows with depth, so rows are weighted by
    1/Z; a few re-weightings by the residual in pixels (Cauchy) make it robust.

    Parameters
    ----------
    matches : N features; R_cp : (3, 3) rotation, previous to current.

    Returns
    -------
    t_cp (3,), metres, and the residual norm of each feature over its eight rows, (N,) pixels (infinite
    for features not used: beyond the largest depth). None when no feature can be used or the system has
    no unique answer.
    """
    X_p = camera.triangulate(matches.prev_left, matches.prev_right)
    # NaN depth compares false.
    used = np.flatnonzero((X_p[:, 2] > 0) & (X_p[:, 2] <= config.max_depth))
    if len(used) == 0:
        return None
    A, B, c = feature_rows(camera, matches[used], R_cp)
    depth = np.repeat(X_p[used, 2:3], 8, axis=1)
    try:
        M, y, back = eliminate_points(A, B, c, depth)
        t = robust_start(M, y, 4.0 * config.scale / camera.f)
        for _ in range(config.iterations):
            # The rows' weights use the depth of each point as solved, in both frames.
            Q = back[:, :, 3] - back[:, :, :3] @ t
            depth[:, :4] = np.maximum(Q[:, 2:3], 0.1)
            depth[:, 4:] = np.maximum(Q @ R_cp[2][:, None] + t[2], 0.1)
            M, y, back = eliminate_points(A, B, c, depth)
            residual = camera.f * np.linalg.norm(M @ t - y, axis=1)
            weight = 1.0 / (1.0 + (residual / config.scale) ** 2)
            weighted = M * weight[:, None, None]
            t = np.linalg.solve(np.einsum("nij,nik->jk", weighted, M), np.einsum("nij,ni->j", weighted, y))
    except np.linalg.LinAlgError:
        return None
    full = np.full(len(matches), np.inf)
    full[used] = camera.f * np.linalg.norm(M @ t - y, axis=1)
    return t, full
