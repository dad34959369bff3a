"""Chapter 4: the translation by the pseudo-inverse, equations (2) and (3) of the paper.

With R known, a feature seen at x = (u - cx) / f, y = (v - cy) / f gives two rows in each image:
(x e3 - e1)ᵀ P = 0 and (y e3 - e2)ᵀ P = 0 in a left image; (x e3 - e1)ᵀ P = -b in a right one, where
P = Q in the previous pair and P = R Q + t in the current one. Eight rows, six unknowns (Q, t). The paper has
Q in the current frame, and calls the projection matrix P. Divided by the feature's depth a row is in pixels
over f, as (2) projects with its factor α; in metres far features weigh most, and steps come out too long.
"""

from __future__ import annotations

import numpy as np

from ..geometry.camera import StereoCamera
from ..geometry.matches import StereoMatches
from ..geometry.types import Array, BoolArray
from .settings import TranslationConfig

SOLVING_ROUNDS = 2


def feature_rows(camera: StereoCamera, matches: StereoMatches, R_cp: Array) -> tuple[Array, Array, Array]:
    """The system A Q + B t = c of every feature, equation (3).

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


def eliminate_points(A: Array, B: Array, c: Array) -> tuple[Array, Array]:
    """The rows M t = d that are left of every feature when I - A A⁺ takes out its point Q.

    A, B (N, 8, 3) and c (N, 8) as `feature_rows` gives them; M (N, 8, 3), d (N, 8).
    """
    A_plus = np.linalg.solve(A.swapaxes(1, 2) @ A, A.swapaxes(1, 2))
    projector = np.eye(8) - A @ A_plus
    return projector @ B, (projector @ c[..., None])[..., 0]


def solve_translation(
    camera: StereoCamera, matches: StereoMatches, R_cp: Array, config: TranslationConfig
) -> tuple[Array, BoolArray] | None:
    """One translation for all features: equation (3) stacked and solved by the pseudo-inverse.

    A single feature gives a translation already. The median of all of these is the start; features whose
    rows it does not fit are left out of the stacked system; then the same once more, from its solution.

    Parameters
    ----------
    matches : N features; R_cp : (3, 3) rotation, previous to current.

    Returns
    -------
    t_cp (3,), metres, and which features fit it, (N,). None where no feature can be used, or too few to tell.
    """
    depth = camera.triangulate(matches.prev_left, matches.prev_right)[:, 2]
    near = np.flatnonzero(depth <= config.max_depth)  # no depth is NaN, which compares false
    if len(near) == 0:
        return None
    M, d = eliminate_points(*feature_rows(camera, matches[near], R_cp))
    M, d = M / depth[near, None, None], d / depth[near, None]
    H, g = M.swapaxes(1, 2) @ M, (M.swapaxes(1, 2) @ d[..., None])[..., 0]  # normal equations of each feature
    try:
        t = np.median(np.linalg.solve(H, g[..., None])[..., 0], axis=0)
        for _ in range(SOLVING_ROUNDS):
            residual = camera.f * np.linalg.norm(d - M @ t, axis=1)
            fits = residual < config.agreement
            t = np.linalg.solve(H[fits].sum(axis=0), g[fits].sum(axis=0))
    except np.linalg.LinAlgError:
        return None
    agrees = np.zeros(len(matches), np.bool_)
    agrees[near[fits]] = True
    return t, agrees
