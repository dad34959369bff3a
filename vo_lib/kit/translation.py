"""Chapter 4: the translation by linear least squares, equations (2) and (3) of the paper, weighted.

With R known, a feature seen at x = (u - cx) / f, y = (v - cy) / f gives two rows in each image:
(x e3 - e1)ᵀ P = 0 and (y e3 - e2)ᵀ P = 0 in a left image; (x e3 - e1)ᵀ P = -b in a right one, where
P = Q in the previous pair and P = R Q + t in the current one. Eight rows, six unknowns (Q, t). In the paper
Q is in the current frame, and its P is the projection.

Four rows give the point in the previous pair, four the point in the current one, so alone a feature says
t = P - R Q. Stacked, with one t and with each Q eliminated, the features leave the normal equations
Σ W_i t = Σ W_i (P_i - R Q_i), where W_i is the inverse of the covariance of that difference. The four rows of
a pair, with x, y in the left and x', y' in the right image, leave

    S = 2 [[1, 0, -m], [0, 1, -n], [-m, -n, m² + n² + d²/4]],   m, n = (x + x')/2, (y + y')/2,
                                                                d² = (x - x')² + (y - y')²,

whose inverse is diag(1, 1, 0)/2 + 2/d² (m, n, 1)(m, n, 1)ᵀ: errors of a point are small across its ray and
large along it. Rows weighted by 1/Z give Z² times that, in units of the pixel noise. Symmetric 3×3 matrices
are kept as (6, N): xx, yy, zz, xy, xz, yz.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..geometry.camera import StereoCamera
from ..geometry.matches import StereoMatches
from ..geometry.symmetric import FULL, invert, outer, times
from ..geometry.types import Array
from .settings import KitTranslationConfig

CONVERGED_TRANSLATION_M = (
    1e-4  # metres, a fortieth of what noise leaves; a re-weighting that changes less is the last
)
MIN_ROW_DEPTH_M = 0.1  # metres; rows are divided by no smaller depth
MIN_SQUARED_DISPARITY = 1e-8  # smallest d², a tenth of a pixel: below, the depth is as good as unknown
_ONE = np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0])


def robust_translation(
    camera: StereoCamera, matches: StereoMatches, R_cp: Array, config: KitTranslationConfig
) -> tuple[Array, Array] | None:
    """One translation for all features, stacked.

    A row is an error in metres and grows with depth, so rows are weighted by 1/Z, depths as solved; a few
    re-weightings by the residual in pixels (Cauchy) make it robust.

    Parameters
    ----------
    matches : N features; R_cp : (3, 3) rotation, previous to current.

    Returns
    -------
    t_cp (3,), metres, and the residual norm of each feature over its eight rows, (N,) pixels (infinite
    for features not used: beyond the largest depth). None when no feature can be used or the system has
    no unique answer.
    """
    depth = camera.triangulate(matches.prev_left, matches.prev_right)[:, 2]
    # NaN depth compares false.
    used = np.flatnonzero((depth > 0) & (depth <= config.max_depth))
    if len(used) == 0:
        return None
    before = stereo_points(camera, matches.prev_left[used], matches.prev_right[used]).rotated(R_cp)
    now = stereo_points(camera, matches.cur_left[used], matches.cur_right[used])
    scale, system = config.scale / camera.f, EliminatedPoints(before, now, depth[used], depth[used])
    try:
        t = robust_start(system, 4.0 * scale)
        for _ in range(config.iterations):
            # The rows' weights use the depth of each point as solved, in both frames.
            system = EliminatedPoints(before, now, *system.depths(t))
            weight = 1.0 / (1.0 + system.squared_residuals(t) / scale**2)
            before_step, t = t, np.linalg.solve((system.W @ weight)[FULL], system.pull() @ weight)
            if np.linalg.norm(t - before_step) < CONVERGED_TRANSLATION_M:
                break
    except np.linalg.LinAlgError:
        return None
    full = np.full(len(matches), np.inf)
    full[used] = camera.f * np.sqrt(system.squared_residuals(t))
    return t, full


class StereoPoints(NamedTuple):
    """N points of one stereo pair, in the axes of some camera.

    Attributes
    ----------
    X : (3, N) points, metres.
    ray : (3, N) directions along which they are uncertain, of length 1 in the pair's own z.
    axis : (3,) the pair's own z axis; lateral errors are orthogonal to it.
    along : (N,) variance along the ray against that across it, 4 / d².
    residual_floor : (N,) squared residual that no point can mend, of the rows not divided by depth: y differs
        from y'.
    """

    X: Array
    ray: Array
    axis: Array
    along: Array
    residual_floor: Array

    def rotated(self, R: Array) -> StereoPoints:
        """The same points in axes rotated by R (3, 3)."""
        return self._replace(X=R @ self.X, ray=R @ self.ray, axis=R @ self.axis)

    def covariance(self, depth: Array) -> Array:
        """Covariances (6, N) where rows are divided by `depth` (N,), metres; for unit row errors."""
        half = 0.5 * depth * depth
        lateral = _ONE - outer(self.axis)
        return half * lateral[:, None] + (half * self.along) * outer(self.ray)


def stereo_points(camera: StereoCamera, left: Array, right: Array) -> StereoPoints:
    """Linear triangulation, equation (2) with one pair, of left and right pixels (N, 2).

    Rows may differ: y is then met half way. Equal rows give `StereoCamera.triangulate`'s points.
    """
    (x, y), (x_r, y_r) = camera.normalise(left).T, camera.normalise(right).T
    d2 = np.maximum((x - x_r) ** 2 + (y - y_r) ** 2, MIN_SQUARED_DISPARITY)
    ray = np.stack([0.5 * (x + x_r), 0.5 * (y + y_r), np.ones_like(x)])
    X = ray * (camera.baseline * (x - x_r) / d2)
    X[0] += 0.5 * camera.baseline
    residual_floor = 0.5 * camera.baseline**2 * (y - y_r) ** 2 / d2
    return StereoPoints(X, ray, np.array([0.0, 0.0, 1.0]), 4.0 / d2, residual_floor)


class EliminatedPoints:
    """The eight rows of N features, divided by their depths (N,), metres, with every point eliminated.

    Attributes
    ----------
    before, now : points in the previous pair, in the axes of the current one, and in the current pair.
    apart : (3, N) how far the points now are from those before.
    C_p : (6, N) covariance of the points before; W : (6, N) inverse covariance of `apart`.
    residual_floor : (N,) squared residual that is left whatever t is.
    """

    def __init__(self, before: StereoPoints, now: StereoPoints, depth_p: Array, depth_c: Array):
        self.before, self.now, self.apart = before, now, now.X - before.X
        self.C_p = before.covariance(depth_p)
        self.W = invert(self.C_p + now.covariance(depth_c))
        self.residual_floor = before.residual_floor / depth_p**2 + now.residual_floor / depth_c**2

    def pull(self) -> Array:
        """Right sides g (3, N) of each feature's normal equations W t = g."""
        return times(self.W, self.apart)

    def squared_residuals(self, t: Array) -> Array:
        """Squared residual (N,) over the eight rows under t (3,), each feature with its best point."""
        v = self.apart - t[:, None]
        return np.asarray(np.maximum(np.einsum("in,in->n", v, times(self.W, v)) + self.residual_floor, 0.0))

    def depths(self, t: Array) -> tuple[Array, Array]:
        """Depths (N,) of each feature's best point under t, in the previous and in the current pair."""
        RQ = self.before.X + times(self.C_p, times(self.W, self.apart - t[:, None]))
        return np.maximum(self.before.axis @ RQ, MIN_ROW_DEPTH_M), np.maximum(RQ[2] + t[2], MIN_ROW_DEPTH_M)


def robust_start(system: EliminatedPoints, limit: float) -> Array:
    """The best of many translations from three features each: a start no wrong match can pull away.

    The triples are cut from the features in order, a third of them apart, so every feature is used once
    and nothing is random. The best one has the smallest sum of squared residuals, truncated at `limit`.
    """
    H, g = system.W, system.pull()
    third = H.shape[1] // 3
    A, b = (a[:, : 3 * third].reshape(-1, 3, third).sum(axis=1) if third else a[:, :1] for a in (H, g))
    # A triple of features on one line of sight leaves a direction open; close it gently.
    A = np.moveaxis(A[FULL], 2, 0)
    A = A + 1e-9 * np.trace(A, axis1=1, axis2=2)[:, None, None] * np.eye(3)
    t = np.linalg.solve(A, b.T[:, :, None])[:, :, 0]
    # The squared residuals of all features under all translations are one matrix product.
    x, y, z = t.T
    monomials = np.stack([x * x, y * y, z * z, 2 * x * y, 2 * x * z, 2 * y * z, *(-2 * t.T)], axis=1)
    squared = monomials @ np.concatenate([H, g]) + system.squared_residuals(np.zeros(3))
    return np.asarray(t[np.argmin(np.minimum(squared, limit**2).sum(axis=1))])
