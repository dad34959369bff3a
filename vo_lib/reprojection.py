"""Motion from points of known depth by Gauss-Newton on the reprojection error in both current images."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .camera import StereoCamera
from .geometry import rotation_from_vector

Array = NDArray[np.float64]


def fit_motion(
    camera: StereoCamera,
    X_p: Array,
    cur_left: Array,
    cur_right: Array,
    R_cp: Array,
    t_cp: Array,
    scale: float = 1.0,
    iterations: int = 8,
) -> tuple[Array, Array, Array]:
    """Robust motion that takes points of the previous frame to their pixels in the current pair.

    Parameters
    ----------
    X_p : (N, 3) points in the previous left frame, metres.
    cur_left, cur_right : (N, 2) pixels.
    R_cp, t_cp : start of the iteration.
    scale : pixel residual at which a point's weight is halved (Cauchy weights, 1 / (1 + r² / scale²)),
        or the median residual while that is larger.

    Returns
    -------
    R_cp (3, 3), t_cp (3,) and the residual norm of each point over its four coordinates, (N,) pixels.
    """
    R, t = R_cp, t_cp
    residual = np.full(len(X_p), np.inf)
    for step in range(iterations + 1):
        X = X_p @ R.T + t
        x, y, z = X[:, 0], X[:, 1], np.maximum(X[:, 2], 1e-3)
        u, v, d = camera.f * x / z, camera.f * y / z, camera.f * camera.baseline / z
        r = np.stack(
            [
                cur_left[:, 0] - camera.cx - u,
                cur_left[:, 1] - camera.cy - v,
                cur_right[:, 0] - camera.cx - u + d,
                cur_right[:, 1] - camera.cy - v,
            ],
            axis=1,
        )
        residual = np.where(X[:, 2] > 0, np.sqrt(np.sum(r * r, axis=1)), np.inf)
        if step == iterations:
            break
        # Far from the solution all residuals are large: a scale that shrinks with their median keeps
        # the near points, which know the translation, from being taken for outliers.
        current = max(scale, float(np.median(residual)))
        weight = 1.0 / (1.0 + np.where(np.isfinite(residual), residual / current, 1e6) ** 2)
        # d(pixel)/dX, then dX = δt + δω × (X - t): the rotation turns about the previous camera's centre.
        zero = np.zeros_like(z)
        rows_u = np.stack([camera.f / z, zero, -u / z], axis=1)
        rows_v = np.stack([zero, camera.f / z, -v / z], axis=1)
        rows_r = np.stack([camera.f / z, zero, (d - u) / z], axis=1)
        jac_t = np.stack([rows_u, rows_v, rows_r, rows_v], axis=1)
        jac = np.concatenate([np.cross(X[:, None] - t, jac_t), jac_t], axis=2)
        weighted = jac * weight[:, None, None]
        H = np.einsum("nij,nik->jk", weighted, jac) + 1e-9 * np.eye(6)
        delta = np.linalg.solve(H, np.einsum("nij,ni->j", weighted, r))
        R = rotation_from_vector(delta[:3]) @ R
        t = t + delta[3:]
        if float(delta @ delta) < 1e-18:
            iterations = step + 1
    return R, t, residual
