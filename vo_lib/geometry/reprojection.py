"""Reprojection residuals in both current images, and a robust fit of a motion."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .camera import StereoCamera
from .matches import StereoMatches
from .motion import rigid, rotation_from_vector
from .types import Array

CONVERGED_STEP = 1e-9  # length of a step at which the iteration ends, radians and metres
CONVERGED_TRIAL_STEP = 1e-4  # the same for a trial motion, of which only the inliers are counted
MAX_AGREEMENT_RESIDUAL_PX = 2.0  # a match with a smaller residual norm agrees with a motion


class MotionFit(NamedTuple):
    """A motion T_cp (4, 4), and the residual norm of each match over its four coordinates, (N,) pixels.

    The residual of a point without depth or behind the camera is infinite.
    """

    T_cp: Array
    residual: Array


def fit_motion(
    camera: StereoCamera,
    matches: StereoMatches,
    start: Array,
    scale: float = 1.0,
    iterations: int = 8,
    tolerance: float = CONVERGED_STEP,
) -> MotionFit:
    """Robust motion that moves the points of the previous pair to their pixels in the current pair.

    Parameters
    ----------
    matches : N matches; those whose points have no depth do not count.
    start : T_cp (4, 4) at which the iteration starts.
    scale : residual, pixels, at which a point's weight is halved (Cauchy weights, 1 / (1 + r² / scale²)); the
        median residual takes its place as long as it is larger.
    iterations : largest number of steps.
    tolerance : length of a step at which the iteration ends, radians and metres.
    """
    X_p = camera.triangulate(matches.prev_left, matches.prev_right)
    has_depth = np.isfinite(X_p).all(axis=1)  # a single NaN would make the whole system NaN
    X_p = X_p[has_depth]
    measured = measured_pixels(camera, matches.cur_left, matches.cur_right)[has_depth]
    R = start[:3, :3]
    t = start[:3, 3]
    residual = np.full(len(X_p), np.inf)
    converged = False
    for step in range(iterations + 1):
        rotated = X_p @ R.T
        r, jac, depth = linearise(camera, rotated, t, measured)
        residual = np.where(depth > 0, np.sqrt(np.sum(r * r, axis=1)), np.inf)
        # The last round is without a step, so that the residuals returned are those of the final motion.
        if converged or step == iterations:
            break
        # Far from the solution all residuals are large. Near points, which determine the translation, keep a
        # high weight if the scale is at least the median residual.
        scale_now = max(scale, float(np.median(residual)))
        in_front = np.isfinite(residual)
        # A point behind the camera has hardly any weight.
        ratio = np.divide(residual, scale_now, out=np.full_like(residual, 1e6), where=in_front)
        weight = 1.0 / (1.0 + ratio**2)
        jac = jac.reshape(-1, 6)
        weighted = (jac * np.repeat(weight, 4)[:, None]).T
        # The small diagonal keeps the system solvable if the points do not determine the motion.
        delta = np.asarray(np.linalg.solve(weighted @ jac + 1e-9 * np.eye(6), weighted @ r.ravel()), float)
        R = rotation_from_vector(delta[:3]) @ R
        t = t + delta[3:]
        converged = float(delta @ delta) < tolerance**2
    residual_of_all = np.full(len(matches), np.inf)
    residual_of_all[has_depth] = residual
    return MotionFit(rigid(R, t), residual_of_all)


def stereo_residuals(camera: StereoCamera, matches: StereoMatches, T_cp: Array) -> Array:
    """How far a motion is from the stereo depths: the reprojection error of each match, (N,) pixels.

    The point of the previous pair moves with T_cp (4, 4) and is projected into the current pair. The error is
    the norm of the residuals of its four coordinates, and infinite for a point without depth or behind the
    camera.
    """
    X_p = camera.triangulate(matches.prev_left, matches.prev_right)
    measured = measured_pixels(camera, matches.cur_left, matches.cur_right)
    r, _, depth = linearise(camera, X_p @ T_cp[:3, :3].T, T_cp[:3, 3], measured)
    norm = np.linalg.norm(r, axis=1)
    return np.where(np.isfinite(norm) & (depth > 0), norm, np.inf)


def linearise(
    camera: StereoCamera, rotated: Array, t_cp: Array, measured: Array
) -> tuple[Array, Array, Array]:
    """Reprojection residuals of points, and their derivatives, for one motion or a batch of motions.

    Parameters
    ----------
    rotated : (..., N, 3) points R_cp X_p, metres; t_cp : (3,) or broadcastable to `rotated`.
    measured : (..., N, 4) `measured_pixels`: u, v in the left and u, v in the right image.

    Returns
    -------
    residuals (..., N, 4), pixels; derivatives (..., N, 4, 6) of the prediction with respect to a rotation
    vector (about the previous camera's centre) and the translation, both in the axes of the current camera;
    depth (..., N), metres.
    """
    moved = rotated + t_cp
    depth = moved[..., 2]
    z = np.maximum(depth, 1e-3)  # a point behind the camera gets finite pixels; its `depth` tells it apart
    s = camera.f / z
    # As in `measured`, pixels are relative to the principal point.
    u = s * moved[..., 0]
    v = s * moved[..., 1]
    u_right = u - s * camera.baseline
    residual = measured - np.stack([u, v, u_right, v], axis=-1)
    # With R X_p = (a, b, c), a rotation δω and a translation δt move the point by δω × (a, b, c) + δt.
    a = rotated[..., 0]
    b = rotated[..., 1]
    c = rotated[..., 2]
    jac = np.zeros((*z.shape, 4, 6))
    # A moved point (x, y, z) has u = f x / z, so du = s dx - (u / z) dz with s = f / z. The derivatives in
    # the left and in the right image differ only in u.
    for row, u_over_z in ((0, u / z), (2, u_right / z)):
        jac[..., row, 0] = -u_over_z * b
        jac[..., row, 1] = s * c + u_over_z * a
        jac[..., row, 2] = -s * b
        jac[..., row, 3] = s
        jac[..., row, 5] = -u_over_z
    # dv = s dy - (v / z) dz, equal in both images.
    v_over_z = v / z
    jac[..., 1, 0] = -s * c - v_over_z * b
    jac[..., 1, 1] = v_over_z * a
    jac[..., 1, 2] = s * a
    jac[..., 1, 4] = s
    jac[..., 1, 5] = -v_over_z
    jac[..., 3, :] = jac[..., 1, :]
    return residual, jac, depth


def measured_pixels(camera: StereoCamera, cur_left: Array, cur_right: Array) -> Array:
    """Pixels (N, 4) of both current images relative to the principal point."""
    both = np.concatenate([cur_left, cur_right], axis=1)
    return np.asarray(both - np.tile([camera.cx, camera.cy], 2))
