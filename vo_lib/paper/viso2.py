"""The VISO2 estimator of Table 1 (StereoScan: Geiger, Ziegler, Stiller, IV 2011).

A RANSAC: Gauss-Newton on the reprojection error in both current images gives many motions, each from three
points of known depth. The motion with the most inliers wins, and is fitted again to all of its inliers.
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
DIVERGENT_STEP = 1e3  # length of a step, radians and metres, from which on an iteration has diverged


class Viso2(Odometry):
    """VISO2 on a sequence: StereoScan's estimator instead of the essential matrix and equation (3)."""

    def stationary_motion(self, matches: StereoMatches) -> FrameResult:
        """The measured motion, since the reprojection error is also defined for a camera at rest."""
        return self.motion_or_previous(matches)

    def motion(self, matches: StereoMatches) -> FrameResult | None:
        """Rotation and translation from one fit; None with too few inliers."""
        solution = ransac_motion(self.camera, matches, self.random(), self.config.reprojection)
        self.clock.stage("rotation")
        if solution is None:
            return None
        R_cp, t_cp, is_inlier = solution
        inliers = int(np.count_nonzero(is_inlier))
        if inliers < self.config.min_matches:
            return None
        return FrameResult(rigid(R_cp, t_cp), inliers=inliers)


def ransac_motion(
    camera: StereoCamera, matches: StereoMatches, rng: np.random.Generator, config: ReprojectionConfig
) -> tuple[Array, Array, BoolArray] | None:
    """The motion with the most inliers among motions from random triples of matches, refitted on its inliers.

    Returns
    -------
    R_cp (3, 3), t_cp (3,) metres, and a mask (N,) of inliers: their residual norm over four coordinates is
    below the threshold. None with fewer than six matches with depth, or fewer than six inliers.
    """
    with_depth = np.flatnonzero(matches.prev_left[:, 0] > matches.prev_right[:, 0])
    if len(with_depth) < MIN_MATCHES_FOR_FIT:
        return None
    X_p, measured, weight = observations(camera, matches[with_depth], config)
    triples = _triples(rng, len(with_depth), config.trials)
    R, t = _gauss_newton(
        camera,
        X_p[triples],
        measured[triples],
        weight[triples],
        R=np.tile(np.eye(3), (config.trials, 1, 1)),
        t=np.zeros((config.trials, 3)),
        iterations=config.iterations,
        tolerance=CONVERGED_TRIAL_STEP,
    )
    agrees = _residuals(camera, X_p, measured, R, t) < config.threshold
    best = int(np.argmax(np.count_nonzero(agrees, axis=1)))
    agreeing = with_depth[agrees[best]]
    if len(agreeing) < MIN_MATCHES_FOR_FIT:
        return None
    R_cp, t_cp = refit_motion(camera, matches[agreeing], R[best], t[best], config)
    # The refit changes the inliers, so they are computed again for the final motion.
    residual = _residuals(camera, X_p, measured, R_cp[None], t_cp[None])[0]
    inliers = np.zeros(len(matches), np.bool_)
    inliers[with_depth] = residual < config.threshold
    return R_cp, t_cp, inliers


def refit_motion(
    camera: StereoCamera, matches: StereoMatches, R_cp: Array, t_cp: Array, config: ReprojectionConfig
) -> tuple[Array, Array]:
    """The motion R_cp (3, 3) and t_cp (3,), metres, that fits all matches by weighted least squares.

    The weights are those of `observations`. The arguments R_cp and t_cp are a start near the solution.
    """
    X_p, measured, weight = observations(camera, matches, config)
    R, t = _gauss_newton(
        camera,
        X_p[None],
        measured[None],
        weight[None],
        R=R_cp[None],
        t=t_cp[None],
        iterations=config.iterations,
        tolerance=CONVERGED_STEP,
    )
    return R[0], t[0]


def observations(
    camera: StereoCamera, matches: StereoMatches, config: ReprojectionConfig
) -> tuple[Array, Array, Array]:
    """What the fit compares: points, the pixels to which a motion should move them, and weights.

    StereoScan's weight is 1 / (|u - cx| / |cx| + centre): calibration errors grow towards the left and right
    border of the image, so the centre has larger weights.

    Returns
    -------
    Points X_p (N, 3) of the previous pair, metres; `measured_pixels` (N, 4) of the current pair; weights
    (N,) of the residuals.
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
    """Motions R (M, 3, 3) and t (M, 3) of M problems at once, each with N points.

    A converged problem is not changed any more; a divergent problem keeps its last state.

    Parameters
    ----------
    X_p : (M, N, 3) points, metres; measured : (M, N, 4) pixels; weight : (M, N); see `observations`.
    R, t : (M, 3, 3) and (M, 3) at the start.
    iterations : largest number of steps.
    tolerance : length of a step, radians and metres, that ends the iteration of a problem.
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
        step = np.asarray(np.linalg.solve(H, jac_t @ r)[:, :, 0], np.float64)
        length = np.linalg.norm(step, axis=1)
        bounded = length < DIVERGENT_STEP  # NaN, too, fails the comparison
        moved = active[bounded]
        R[moved] = rotation_from_vector(step[bounded, :3]) @ R[moved]
        t[moved] += step[bounded, 3:]
        active = active[bounded & (length > tolerance)]
        if len(active) == 0:
            break
    return R, t


def _triples(rng: np.random.Generator, number: int, trials: int) -> Index:
    """Random triples (trials, 3) of different indices below `number`; all triples are equally likely."""
    first = rng.integers(0, number, trials)
    second = rng.integers(0, number - 1, trials)
    third = rng.integers(0, number - 2, trials)
    # Each number is drawn as a rank among the indices that are still free. Each used index at or below it, in
    # ascending order, moves it up by one; then it is the index.
    second += second >= first
    for used in np.sort([first, second], axis=0):
        third += third >= used
    return np.stack([first, second, third], axis=1)


def _residuals(camera: StereoCamera, X_p: Array, measured: Array, R: Array, t: Array) -> Array:
    """Residual norms (M, N), pixels, of N matches for M motions R (M, 3, 3), t (M, 3).

    Points X_p (N, 3) and pixels `measured` (N, 4) are from `observations`. The residual of a point that is
    behind the current camera is infinite.
    """
    x, y, z = np.moveaxis(R @ X_p.T + t[:, :, None], 1, 0)
    in_front = z > 0
    s = camera.f / np.where(in_front, z, 1.0)
    u = s * x
    v = s * y
    squared = (measured[:, 0] - u) ** 2 + (measured[:, 1] - v) ** 2
    squared += (measured[:, 2] - u + s * camera.baseline) ** 2 + (measured[:, 3] - v) ** 2
    return np.asarray(np.where(in_front, np.sqrt(squared), np.inf))
