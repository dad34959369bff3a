"""Chapter 4, beyond the paper: the disparity offset of a pair that is not perfectly rectified.

A right camera turned by a milliradian shifts every disparity by most of a pixel. Far points then seem too
far and the steps come out too long: on the KITTI highway by a tenth. The motion betrays the offset, for
the disparities of a moving camera must agree with its parallax: measured disparity = f b / Z + offset.

One frame knows the offset to some tenths of a pixel. A Kalman filter with one state carries it along.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from .camera import StereoCamera
from .config import CalibrationConfig
from .matching import StereoMatches

Array = NDArray[np.float64]

ITERATIONS = 4  # from the linear solution two suffice; wrong matches need a few more to lose their weight


def without_offset(matches: StereoMatches, offset: float) -> StereoMatches:
    """Matches whose disparities are smaller by `offset` pixels: the right positions move."""
    shift = np.array([offset, 0.0])
    return dataclasses.replace(
        matches, prev_right=matches.prev_right + shift, cur_right=matches.cur_right + shift
    )


class DisparityOffset:
    """The offset, pixels, and its variance, from frame to frame.

    `correct` gives matches without the offset known so far; `update` learns from a solved frame.
    """

    def __init__(self, config: CalibrationConfig):
        self.config = config
        self.offset = 0.0
        self.variance = config.initial_deviation**2

    def correct(self, matches: StereoMatches) -> StereoMatches:
        """Matches without the offset known so far."""
        return without_offset(matches, self.offset)

    def update(self, camera: StereoCamera, matches: StereoMatches, R_cp: Array, t_cp: Array) -> None:
        """Learn from a frame's corrected matches and its motion."""
        found = estimate_offset(camera, matches, R_cp, t_cp, self.config.scale)
        if found is None:
            return
        innovation, deviation = found
        variance = self.variance + self.config.drift**2
        # Frames scatter some four times more than noise alone explains (moving things, outlines).
        measured = (self.config.caution * deviation) ** 2
        limit = 3.0 * np.sqrt(variance + measured)
        gain = variance / (variance + measured)
        self.offset += gain * float(np.clip(innovation, -limit, limit))
        self.variance = (1.0 - gain) * variance


def estimate_offset(
    camera: StereoCamera, matches: StereoMatches, R_cp: Array, t_cp: Array, scale: float
) -> tuple[float, float] | None:
    """Disparity offset left in the matches of one frame, and its standard deviation from noise, pixels.

    Gauss-Newton on the reprojection error in all four images over points, translation and offset, the
    rotation held; each point is eliminated from the normal equations. Cauchy weights, `scale` in pixels.
    The linear rows of equation (3) will not do here: their noisy coefficients bias the offset.
    """
    Q = camera.triangulate(matches.prev_left, matches.prev_right)
    good = np.isfinite(Q[:, 2])
    Q, matches = Q[good], matches[good]
    if len(Q) < 10:
        return None
    views = (matches.prev_left, matches.prev_right, matches.cur_left, matches.cur_right)
    measured = np.concatenate(views, axis=1) - np.tile([camera.cx, camera.cy], 4)
    unknown = np.append(t_cp, 0.0)  # translation and offset
    G = np.zeros((len(Q), 8, 4))
    G[:, 2, 3] = G[:, 6, 3] = -1.0
    try:
        for _ in range(ITERATIONS):
            P = Q @ R_cp.T + unknown[:3]
            predicted_p, D_p = _project(camera, Q)
            predicted_c, D_c = _project(camera, P)
            r = measured - np.concatenate([predicted_p, predicted_c], axis=1)
            r[:, [2, 6]] += unknown[3]
            J = np.concatenate([D_p, D_c @ R_cp], axis=1)
            G[:, 4:, :3] = D_c
            Jt = np.swapaxes(J, 1, 2)
            back = np.linalg.solve(Jt @ J, Jt @ np.concatenate([G, r[:, :, None]], axis=2))
            M = G - J @ back[:, :, :4]
            y = r - (J @ back[:, :, 4:])[:, :, 0]
            squared = np.sum(y * y, axis=1)
            weight = 1.0 / (1.0 + squared / scale**2)
            weighted = M * weight[:, None, None]
            H = np.einsum("nij,nik->jk", weighted, M)
            step = np.linalg.solve(H, np.einsum("nij,ni->j", weighted, y))
            unknown = unknown + step
            Q = Q + back[:, :, 4] - back[:, :, :4] @ step
            Q[:, 2] = np.maximum(Q[:, 2], 0.5)
        covariance = np.linalg.inv(H)
    except np.linalg.LinAlgError:
        return None
    # Eight rows less three for the point leave five that see the noise.
    noise = float(np.median(squared)) / 5.0
    deviation = float(np.sqrt(covariance[3, 3] * noise))
    return (float(unknown[3]), deviation) if np.isfinite(deviation) and deviation > 0 else None


def _project(camera: StereoCamera, X: Array) -> tuple[Array, Array]:
    """Left and right pixels of X (N, 3) from the principal point, (N, 4), and derivatives (N, 4, 3)."""
    x, y, z = X[:, 0], X[:, 1], np.maximum(X[:, 2], 0.1)
    s, zero = camera.f / z, np.zeros(len(X))
    u, v, right = s * x, s * y, s * (x - camera.baseline)
    row_v = np.stack([zero, s, -v / z], axis=1)
    rows = [np.stack([s, zero, -u / z], axis=1), row_v, np.stack([s, zero, -right / z], axis=1), row_v]
    return np.stack([u, v, right, v], axis=1), np.stack(rows, axis=1)
