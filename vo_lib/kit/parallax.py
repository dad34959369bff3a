"""Information on calibration errors from the matches of a frame with unknown motion (not in the paper)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..geometry.camera import StereoCamera
from ..geometry.matches import StereoMatches
from ..geometry.types import Array

MIN_PARALLAX_DISPARITY_PX = 0.3  # features with a smaller disparity are not used
MIN_DEPTH_RATIO = 0.05  # smallest ratio of the depths in the current and the previous frame
MIN_PARALLAX_FEATURES = 10  # with fewer features, a frame gives no information
MIN_NOISE_PX = 0.1  # lower bound of the estimated noise
# Median of a feature's squared residual for unit noise: that of χ² with three degrees of freedom, since D
# takes one of the four measurements.
MEDIAN_SQUARED_RESIDUAL = 2.366


def parallax_information(
    camera: StereoCamera,
    matches: StereoMatches,
    R_cp: Array,
    t_cp: Array,
    effects: Callable[[Array, Array], Array],
    scale: float,
) -> tuple[Array, Array] | None:
    """Information of a frame on K calibration errors, in 1/px².

    Let D be a feature's true disparity in the previous pair, where its depth is f b / D, and e the effect of
    the errors. Then

        (X, Y, Z) = R_cp (x_p - e_uv / f, 1) + D / (f b) t_cp

    is the feature's position in the current frame divided by its previous depth, and the measurements are

        d_p = D + e_d,   (u_c, v_c) = f (X, Y) / Z + e_uv,   d_c = D / Z + e_d.

    One Gauss-Newton step with Cauchy weights gives the information; all D, R_cp and t_cp are eliminated.

    Parameters
    ----------
    matches : corrected matches; the second result measures the errors that are left in them.
    R_cp, t_cp : (3, 3), and (3,) metres, the motion from which the step starts.
    effects : function of normalised left positions (2, N) and disparities (N,), pixels; returns (K, 3, N),
        pixels: the changes of left u, left v and disparity due to a size of 1 of each of the K errors.
    scale : residual at which a feature's weight is halved, pixels.

    Returns
    -------
    The information (K, K), and the information times the errors that remain in these matches (K,); None with
    too few features or without a unique motion.
    """
    matches = matches[matches.prev_left[:, 0] - matches.prev_right[:, 0] > MIN_PARALLAX_DISPARITY_PX]
    if len(matches) < MIN_PARALLAX_FEATURES:
        return None
    residual, J, J_D = _linearised(camera, matches, R_cp, t_cp, effects)
    # Elimination of D: for each feature, I - J_D J_Dᵀ / |J_D|² removes what a change of its D explains.
    norm2 = np.maximum(np.sum(J_D**2, axis=0), 1e-12)
    residual = residual - J_D * (np.sum(J_D * residual, axis=0) / norm2)
    J = J - J_D * (np.sum(J_D * J, axis=1) / norm2)[:, None]
    squared = np.sum(residual**2, axis=0)
    weighted = (J / (1.0 + squared / scale**2)).reshape(len(J), -1)
    H = weighted @ J.reshape(len(J), -1).T
    g = weighted @ residual.ravel()
    # Elimination of the motion, the first six unknowns, by the Schur complement.
    try:
        by_motion = np.linalg.solve(H[:6, :6], np.column_stack([g[:6], H[:6, 6:]]))
    except np.linalg.LinAlgError:
        return None
    information = H[6:, 6:] - H[6:, :6] @ by_motion[:, 1:]
    vector = g[6:] - H[6:, :6] @ by_motion[:, 0]
    variance = max(float(np.median(squared)) / MEDIAN_SQUARED_RESIDUAL, MIN_NOISE_PX**2)
    return information / variance, vector / variance


def _linearised(
    camera: StereoCamera,
    matches: StereoMatches,
    R_cp: Array,
    t_cp: Array,
    effects: Callable[[Array, Array], Array],
) -> tuple[Array, Array, Array]:
    """Residuals, measured minus predicted, of N features, and the derivatives of the predictions.

    The four measurements of a feature are d_p, u_c, v_c and d_c. Each D starts at the measured d_p, so the
    residual of d_p is 0. Parameters as in `parallax_information`.

    Returns
    -------
    residuals (4, N), pixels; derivatives (6 + K, 4, N) with respect to the rotation, t_cp and the K errors;
    derivatives (4, N) with respect to the feature's own D.
    """
    f = camera.f
    fb = camera.f * camera.baseline
    x_p = camera.normalise(matches.prev_left).T
    x_c = camera.normalise(matches.cur_left).T
    D = (matches.prev_left - matches.prev_right)[:, 0]
    d_c = (matches.cur_left - matches.cur_right)[:, 0]
    one = np.ones_like(D)
    ray = R_cp @ np.vstack([x_p, one])
    X, Y, Z = ray + D / fb * t_cp[:, None]
    Z = np.maximum(Z, MIN_DEPTH_RATIO)
    predicted = np.stack([X, Y]) / Z
    u_residual, v_residual = f * (x_c - predicted)
    residual = np.stack([np.zeros_like(D), u_residual, v_residual, d_c - D / Z])
    effects_before = effects(x_p, D)
    # At the predicted positions of the current pair: at the measured ones, derivative and residual would have
    # the same noise.
    effects_now = effects(predicted, D / Z)
    # Derivatives (6 + K, 3, N) of (X, Y, Z): a rotation δω moves the ray by δω × ray.
    dX = np.zeros((6 + len(effects_now), 3, len(D)))
    dX[0, 1] = -ray[2]
    dX[0, 2] = ray[1]
    dX[1, 0] = ray[2]
    dX[1, 2] = -ray[0]
    dX[2, 0] = -ray[1]
    dX[2, 1] = ray[0]
    for axis in range(3):
        dX[3 + axis, axis] = D / fb
    dX[6:] = -np.einsum("ij,kjn->kin", R_cp[:, :2] / f, effects_before[:, :2])
    # The derivative of a quotient: d(X / Z) = (dX - X / Z dZ) / Z.
    f_over_Z = f / Z
    J = np.zeros((len(dX), 4, len(D)))
    J[:, 1:3] = f_over_Z * (dX[:, :2] - predicted * dX[:, 2:])
    J[:, 3] = -D / Z**2 * dX[:, 2]
    J[6:, 0] = effects_before[:, 2]
    J[6:, 1:] += effects_now
    u_by_D, v_by_D = (t_cp[:2, None] - t_cp[2] * predicted) * f_over_Z / fb
    J_D = np.stack([one, u_by_D, v_by_D, (1.0 - t_cp[2] * D / (fb * Z)) / Z])
    return residual, J, J_D
