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
from .stereo_points import linearised_points
from .symmetric import FULL, times
from .translation import NEAREST, stack

Array = NDArray[np.float64]

ITERATIONS = 4  # from the linear solution two suffice; wrong matches need a few more to lose their weight
DONE = 2e-3  # pixels; an offset that changes less is the last


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
    Q, matches = Q[good].T, matches[good]
    if Q.shape[1] < 10:
        return None
    t, offset, fb = t_cp, 0.0, camera.f * camera.baseline
    H, right = np.empty((4, 4)), np.empty(4)
    try:
        for _ in range(ITERATIONS):
            P = R_cp @ Q + t[:, None]
            P[2] = np.maximum(P[2], NEAREST)
            before = linearised_points(camera, Q, matches.prev_left, matches.prev_right).turned(R_cp)
            now = linearised_points(camera, P, matches.cur_left, matches.cur_right)
            system = stack(before, now, Q[2], P[2])
            # A disparity smaller by a pixel takes a point X away to X (1 + Z / f b):
            # now + offset moved_c = before + offset moved_p + t, for every feature.
            moved_p = R_cp @ Q * (Q[2] / fb)
            moved = P * (P[2] / fb) - moved_p
            apart = now.X - before.X
            v = apart + offset * moved - t[:, None]
            squared = camera.f**2 * (np.sum(v * times(system.W, v), axis=0) + system.rest)
            weight = 1.0 / (1.0 + squared / scale**2)
            W_moved = times(system.W, moved)
            H[:3, :3] = (system.W @ weight)[FULL]
            H[:3, 3] = H[3, :3] = -W_moved @ weight
            H[3, 3] = np.sum(moved * W_moved, axis=0) @ weight
            right[:3] = times(system.W, apart) @ weight
            right[3] = -np.sum(apart * W_moved, axis=0) @ weight
            solved = np.linalg.solve(H, right)
            t, change, offset = np.asarray(solved[:3]), abs(float(solved[3]) - offset), float(solved[3])
            if change < DONE:
                break
            v = apart + offset * moved - t[:, None]
            Q = R_cp.T @ (before.X + offset * moved_p + times(system.C_p, times(system.W, v)))
            Q[2] = np.maximum(Q[2], 0.5)
        covariance = np.linalg.inv(H) / camera.f**2
    except np.linalg.LinAlgError:
        return None
    # Eight rows less three for the point leave five that see the noise.
    noise = float(np.median(squared)) / 5.0
    deviation = float(np.sqrt(covariance[3, 3] * noise))
    return (offset, deviation) if np.isfinite(deviation) and deviation > 0 else None
