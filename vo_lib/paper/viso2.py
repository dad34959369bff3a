"""The VISO2 estimator of Table 1 (StereoScan: Geiger, Ziegler, Stiller, IV 2011).

Gauss-Newton on the reprojection error in both current images: many motions, each from three points of known
depth, and a refit of the best motion.
"""

from __future__ import annotations

import numpy as np

from ..geometry.camera import StereoCamera
from ..geometry.matches import StereoMatches
from ..geometry.motion import rigid, rotation_from_vector
from ..geometry.reprojection import CONVERGED_STEP, CONVERGED_TRIAL_STEP, linearise, measured_pixels
from ..geometry.result import FrameResult
from ..geometry.types import Array, BoolArray, Index
from .odometry import Odometry
from .settings import ReprojectionConfig

MIN_MATCHES_FOR_FIT = 6  # smallest number of matches for a motion; three would suffice without outliers


class Viso2(Odometry):
    """VISO2 on a sequence: StereoScan's estimator instead of the essential matrix and equation (3)."""

    def stationary_motion(self, matches: StereoMatches) -> FrameResult:
        """The measured motion, since the reprojection error is also defined for a camera at rest."""
        return self.motion_or_previous(matches)

    def motion(self, matches: StereoMatches) -> FrameResult | None:
        """Rotation and translation from one fit; None with too few inliers."""
        solution = self.fit(matches)
        self.clock.stage("rotation")
        if solution is None:
            return None
        R_cp, t_cp, inliers = solution
        return FrameResult(rigid(R_cp, t_cp), inliers=int(np.count_nonzero(inliers)))

    def fit(self, matches: StereoMatches) -> tuple[Array, Array, BoolArray] | None:
        """Rotation, translation and inliers (N,); None with too few inliers."""
        solution = ransac_motion(self.camera, matches, self.random(), self.config.reprojection)
        if solution is None:
            return None
        _, _, inliers = solution
        return solution if np.count_nonzero(inliers) >= self.config.min_matches else None


def ransac_motion(
    camera: StereoCamera, matches: StereoMatches, rng: np.random.Generator, config: ReprojectionConfig
) -> tuple[Array, Array, BoolArray] | None:
    """The motion with the most inliers among motions from random triples of matches, refitted on its inliers.

    Returns
    -------
    R_cp (3, 3), t_cp (3,) metres, and a mask (N,) of inliers: their residual norm over four coordinates is
    below the threshold. None with fewer than six matches with depth, or fewer than six inliers.
    """
    usable = np.flatnonzero(matches.prev_left[:, 0] > matches.prev_right[:, 0])
    if len(usable) < MIN_MATCHES_FOR_FIT:
        return None
    X, measured, weight = observed(camera, matches[usable], config)
    triples = _triples(rng, len(usable), config.trials)
    R, t = _gauss_newton(
        camera,
        X[triples],
        measured[triples],
        weight[triples],
        np.tile(np.eye(3), (config.trials, 1, 1)),
        np.zeros((config.trials, 3)),
        config.iterations,
        CONVERGED_TRIAL_STEP,
    )
    inliers = _residuals(camera, X, measured, R, t) < config.threshold
    best = int(np.argmax(np.count_nonzero(inliers, axis=1)))
    agreed = usable[inliers[best]]
    if len(agreed) < MIN_MATCHES_FOR_FIT:
        return None
    R_cp, t_cp = refit_motion(camera, matches[agreed], R[best], t[best], config)
    # The refit changes the inliers, so they are computed again for the final motion.
    final = np.zeros(len(matches), np.bool_)
    final[usable] = (_residuals(camera, X, measured, R_cp[None], t_cp[None]) < config.threshold)[0]
    return R_cp, t_cp, final


def refit_motion(
    camera: StereoCamera, matches: StereoMatches, R_cp: Array, t_cp: Array, config: ReprojectionConfig
) -> tuple[Array, Array]:
    """Rotation (3, 3) and translation (3,) by least squares; R_cp and t_cp are a start near the solution."""
    X_p, measured, weight = observed(camera, matches, config)
    R, t = _gauss_newton(
        camera,
        X_p[None],
        measured[None],
        weight[None],
        R_cp[None],
        t_cp[None],
        config.iterations,
        CONVERGED_STEP,
    )
    return R[0], t[0]


def observed(
    camera: StereoCamera, matches: StereoMatches, config: ReprojectionConfig
) -> tuple[Array, Array, Array]:
    """Points X_p (N, 3), metres, their current pixels (N, 4), and the weights (N,) of their residuals.

    StereoScan's weight is 1 / (|u - cu| / |cu| + centre): calibration errors grow towards the left and right
    border of the image, so the centre has larger weights.
    """
    X_p = camera.triangulate(matches.prev_left, matches.prev_right)
    weight = 1.0 / (np.abs(matches.cur_left[:, 0] - camera.cx) / abs(camera.cx) + config.centre)
    return X_p, measured_pixels(camera, matches.cur_left, matches.cur_right), weight


def _gauss_newton(
    camera: StereoCamera,
    X_p: Array,
    measured: Array,
    weight: Array,
    R: Array,
    t: Array,
    iterations: int,
    tolerance: float,
) -> tuple[Array, Array]:
    """Solutions of M problems at once: X_p (M, N, 3), measured (M, N, 4), weight (M, N), initial R and t.

    A converged problem is not changed any more; a divergent problem keeps its last state.
    """
    R = R.copy()
    t = t.copy()
    active = np.arange(len(R))
    for _ in range(iterations):
        rotated = X_p[active] @ np.swapaxes(R[active], 1, 2)
        r, jac, _ = linearise(camera, rotated, t[active, None], measured[active])
        w = weight[active][:, :, None]
        r = (w * r).reshape(len(active), -1, 1)
        jac = (w[..., None] * jac).reshape(len(active), -1, 6)
        jac_t = np.swapaxes(jac, 1, 2)
        # Three points on one line do not fix the rotation; a small regularisation keeps the batch solvable.
        H = jac_t @ jac
        H += 1e-9 * np.trace(H, axis1=1, axis2=2)[:, None, None] * np.eye(6)
        delta = np.asarray(np.linalg.solve(H, jac_t @ r)[:, :, 0], np.float64)
        size = np.linalg.norm(delta, axis=1)
        sane = size < 1e3
        moved = active[sane]
        R[moved] = rotation_from_vector(delta[sane, :3]) @ R[moved]
        t[moved] += delta[sane, 3:]
        active = active[sane & (size > tolerance)]
        if len(active) == 0:
            break
    return R, t


def _triples(rng: np.random.Generator, number: int, trials: int) -> Index:
    """Random triples (trials, 3) of different indices below `number`; all triples are equally likely."""
    first = rng.integers(0, number, trials)
    second = rng.integers(0, number - 1, trials)
    third = rng.integers(0, number - 2, trials)
    # Each index is drawn as a rank among the unused indices, then increased past the used indices.
    second += second >= first
    for lower in np.sort([first, second], axis=0):
        third += third >= lower
    return np.stack([first, second, third], axis=1)


def _residuals(camera: StereoCamera, X_p: Array, measured: Array, R: Array, t: Array) -> Array:
    """Residual norms (M, N) of N matches for M motions, pixels; infinite for points behind the camera."""
    x, y, z = np.moveaxis(R @ X_p.T + t[:, :, None], 1, 0)
    front = z > 0
    s = camera.f / np.where(front, z, 1.0)
    u = s * x
    v = s * y
    squared = (measured[:, 0] - u) ** 2 + (measured[:, 1] - v) ** 2
    squared += (measured[:, 2] - u + s * camera.baseline) ** 2 + (measured[:, 3] - v) ** 2
    return np.asarray(np.where(front, np.sqrt(squared), np.inf))
