"""Chapter 4, beyond the paper: disparities of a pair that is not perfectly rectified.

A right camera turned by a milliradian shifts every disparity by most of a pixel. Far points then seem too
far and the steps come out too long: on the KITTI highway by a tenth. What the undistortion left adds a
quadratic term, about -1 px times x² on KITTI. The motion betrays both, for the disparities of a moving camera
must agree with its parallax: measured disparity = f b / Z + offset + quadratic x².

One frame knows the two to some tenths of a pixel. A Kalman filter carries them along.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from ..core.camera import StereoCamera
from ..core.matches import StereoMatches
from ..core.symmetric import FULL, times
from ..core.types import Array
from .config import CalibrationConfig
from .row_calibration import RowError
from .stereo_points import linearised_points
from .translation import eliminate_points

ITERATIONS = 4  # from the linear solution two suffice; wrong matches need a few more to lose their weight
DONE = 2e-2  # pixels; disparities near the border that change less are the last
DEPTHS = 0.5, 1e4  # metres; points are held between
LARGEST = 100.0  # metres and pixels; a larger answer is none
EDGE = 0.5  # x² near the border of a KITTI image
CHANGES = np.array([1.0, 0.1])  # a jolt can turn a camera a little; its lens stays as it is


def disparity_terms(x: Array) -> Array:
    """1, x² of normalised columns (N,), (2, N)."""
    return np.stack([np.ones_like(x), x * x])


def with_right_moved(
    camera: StereoCamera, matches: StereoMatches, error: Array, rows: RowError | None = None
) -> StereoMatches:
    """Matches whose disparities are smaller by error (2,) · `disparity_terms`, pixels, and whose rows agree.

    The right positions move; which of the two images is at fault cannot be told.
    """

    def moved(left: Array, right: Array) -> Array:
        x, y = camera.normalise(left).T
        u = right[:, 0] + error @ disparity_terms(x)
        v = right[:, 1] if rows is None else right[:, 1] + rows.at(x, y)
        return np.stack([u, v], axis=1)

    return dataclasses.replace(
        matches,
        prev_right=moved(matches.prev_left, matches.prev_right),
        cur_right=moved(matches.cur_left, matches.cur_right),
    )


class StereoCalibration:
    """What the rectification left, from frame to frame.

    `learn_rows` and `correct` take a frame's matches as measured; `update` learns from the solved frame.

    Attributes
    ----------
    camera : the stereo camera as known now; who learns more about it may replace it.
    rows : difference of rows.
    disparity : (2,) offset and quadratic term, pixels; covariance : (2, 2).
    """

    def __init__(self, camera: StereoCamera, config: CalibrationConfig):
        self.camera = camera
        self.config = config
        self.rows = RowError(config)
        self.disparity = np.zeros(2)
        self.covariance = np.eye(2) * config.initial_deviation**2

    def learn_rows(self, matches: StereoMatches) -> None:
        """Learn the difference of rows from a frame's matches as measured."""
        if self.config.estimate:
            self.rows.update(self.camera, matches.cur_left, matches.cur_right)

    def correct(self, matches: StereoMatches) -> StereoMatches:
        """Matches without the errors known so far."""
        return with_right_moved(self.camera, matches, self.disparity, self.rows)

    def update(self, matches: StereoMatches, R_cp: Array, t_cp: Array) -> StereoMatches | None:
        """Learn from a frame's corrected matches and its motion.

        Returns the matches without what was learnt, or None where that hardly changed them.
        """
        found = estimate_disparity_error(self.camera, matches, R_cp, t_cp, self.config.scale)
        if found is None:
            return None
        innovation, noise = found
        covariance = self.covariance + np.diag(self.config.drift * CHANGES) ** 2
        # Frames scatter some four times more than noise alone explains (moving things, outlines).
        total = covariance + self.config.noise_inflation**2 * noise
        mahalanobis = float(np.sqrt(innovation @ np.linalg.solve(total, innovation)))
        gain = np.linalg.solve(total, covariance).T
        change = gain @ innovation * min(1.0, 3.0 / max(mahalanobis, 1e-12))
        self.disparity = self.disparity + change
        self.covariance = covariance - gain @ covariance
        if abs(change[0]) + EDGE * abs(change[1]) < self.config.least_change:
            return None
        return with_right_moved(self.camera, matches, change)


def estimate_disparity_error(
    camera: StereoCamera, matches: StereoMatches, R_cp: Array, t_cp: Array, scale: float
) -> tuple[Array, Array] | None:
    """Offset and quadratic term left in a frame's disparities, (2,) pixels, and their covariance (2, 2).

    Gauss-Newton on the reprojection error in all four images over points, translation, offset and quadratic
    term, the rotation held; each point is eliminated from the normal equations. Cauchy weights, `scale` in
    pixels. The covariance is that from noise.
    The linear rows of equation (3) will not do here: their noisy coefficients bias the offset.
    """
    Q = camera.triangulate(matches.prev_left, matches.prev_right)
    good = np.isfinite(Q[:, 2])
    Q = Q[good].T
    if Q.shape[1] < 10:
        return None
    views = (matches.prev_left, matches.prev_right, matches.cur_left, matches.cur_right)
    before_left, before_right, now_left, now_right = (camera.normalise(uv[good]).T for uv in views)
    t, error, fb = t_cp, np.zeros(2), camera.f * camera.baseline
    H, right = np.empty((5, 5)), np.empty(5)
    try:
        for _ in range(ITERATIONS):
            P = R_cp @ Q + t[:, None]
            P[2] = np.clip(P[2], *DEPTHS)
            before = linearised_points(camera.baseline, Q, before_left, before_right).rotated(R_cp)
            now = linearised_points(camera.baseline, P, now_left, now_right)
            system = eliminate_points(before, now, Q[2], P[2])
            # A disparity smaller by a pixel takes a point X away to X (1 + Z / f b):
            # now + moved_c error = before + moved_p error + t, for every feature.
            moved_p = R_cp @ Q * (disparity_terms(Q[0] / Q[2]) * (Q[2] / fb))[:, None]
            moved = P * (disparity_terms(P[0] / P[2]) * (P[2] / fb))[:, None] - moved_p
            apart = np.concatenate([now.X - before.X, *moved]).reshape(3, 3, -1)
            W = system.W[FULL]
            W_apart = np.einsum("ijn,kjn->kin", W, apart)
            v, W_v = (np.einsum("k,kin->in", [1.0, *error], a) for a in (apart, W_apart))
            v, W_v = v - t[:, None], W_v - np.einsum("ijn,j->in", W, t)
            squared = camera.f**2 * (np.sum(v * W_v, axis=0) + system.residual_floor)
            weight = 1.0 / (1.0 + squared / scale**2)
            W_apart *= weight
            H[:3, :3] = W @ weight
            H[:3, 3:] = -W_apart[1:].sum(axis=2).T
            H[3:, :3] = H[:3, 3:].T
            products = apart.reshape(3, -1) @ W_apart[1:].reshape(2, -1).T
            H[3:, 3:] = products[1:]
            right[:3], right[3:] = W_apart[0].sum(axis=1), -products[0]
            solved = np.linalg.solve(H, right)
            if not np.abs(solved).max() < LARGEST:
                return None
            change = np.abs(solved[3:] - error) @ [1.0, EDGE]
            t, error = np.asarray(solved[:3]), np.asarray(solved[3:])
            if change < DONE:
                break
            v = np.einsum("k,kin->in", [1.0, *error], apart) - t[:, None]
            shift = np.einsum("k,kin->in", error, moved_p)
            Q = R_cp.T @ (before.X + shift + times(system.C_p, times(system.W, v)))
            Q[2] = np.clip(Q[2], *DEPTHS)
        covariance = np.linalg.inv(H)[3:, 3:] / camera.f**2
    except np.linalg.LinAlgError:
        return None
    # Eight rows less three for the point leave five that see the noise.
    covariance = covariance * float(np.median(squared)) / 5.0
    if not (np.isfinite(covariance).all() and np.linalg.eigvalsh(covariance)[0] > 0):
        return None
    return error, np.asarray(covariance)
