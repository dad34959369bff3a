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
    for features not used: beyond the largest depth). None when fewer than one feature can be used or the
    system has no unique answer.
    """
    X_p = camera.back_project(matches.prev_left, matches.prev_left[:, 0] - matches.prev_right[:, 0])
    # NaN depth compares false.
    used = np.flatnonzero((X_p[:, 2] > 0) & (X_p[:, 2] <= config.max_depth))
    if len(used) == 0:
        return None
    A, B, c = feature_rows(camera, matches[used], R_cp)
    depth = np.repeat(X_p[used, 2:3], 8, axis=1)
    weight = np.ones(len(used))
    t = np.zeros(3)
    residual = np.zeros(len(used))
    for _ in range(config.iterations + 1):
        Aw, Bw, cw = A / depth[:, :, None], B / depth[:, :, None], c / depth
        At = np.swapaxes(Aw, 1, 2)
        try:
            eliminate = np.linalg.solve(At @ Aw, At @ np.concatenate([Bw, cw[:, :, None]], axis=2))
            M = Bw - Aw @ eliminate[:, :, :3]
            y = cw - (Aw @ eliminate[:, :, 3:])[:, :, 0]
            Mw = M * weight[:, None, None]
            t = np.linalg.solve(np.einsum("nij,nik->jk", Mw, M), np.einsum("nij,ni->j", Mw, y))
        except np.linalg.LinAlgError:
            return None
        residual = camera.f * np.linalg.norm(M @ t - y, axis=1)
        scale = max(config.scale, float(np.median(residual)))
        weight = 1.0 / (1.0 + (residual / scale) ** 2)
        # The next round's row weights use the depth of the point as solved, in both frames.
        Q = eliminate[:, :, 3] - eliminate[:, :, :3] @ t
        depth[:, :4] = np.maximum(Q[:, 2:3], 0.1)
        depth[:, 4:] = np.maximum(Q @ R_cp[2][:, None] + t[2], 0.1)
    full = np.full(len(matches), np.inf)
    full[used] = residual
    return t, full
