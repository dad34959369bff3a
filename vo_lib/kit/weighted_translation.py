"""The translation by weighted linear least squares, equations (2) and (3) of the paper (chapter 4).

With known R, a feature at x = (u - cx) / f, y = (v - cy) / f gives two rows in each image: (x e3 - e1)ᵀ P = 0
and (y e3 - e2)ᵀ P = 0 in a left image; (x e3 - e1)ᵀ P = -b in a right image, where P = Q in the previous pair
and P = R Q + t in the current pair. The eight rows have six unknowns, Q and t. In the paper, Q is in the
current frame, and P̂ is its projection.

Four rows give the point in the previous pair, and four rows give the point in the current pair. One feature
thus gives t = P - R Q. All features together, with each Q eliminated, give the normal equations
Σ W_i t = Σ W_i (P_i - R Q_i), where W_i is the inverse covariance of the difference. The four rows of a pair,
with x, y in the left and x', y' in the right image, have the normal matrix

    S = 2 [[1, 0, -m], [0, 1, -n], [-m, -n, m² + n² + d²/4]],   m, n = (x + x')/2, (y + y')/2,
                                                                d² = (x - x')² + (y - y')²,

whose inverse is diag(1, 1, 0)/2 + 2/d² (m, n, 1)(m, n, 1)ᵀ: errors of a point are small across the ray and
large along the ray. With rows weighted by 1/Z, the covariance is Z² times this inverse, in units of the pixel
noise. Symmetric 3×3 matrices are stored as (6, N): xx, yy, zz, xy, xz, yz.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..geometry.camera import StereoCamera
from ..geometry.matches import StereoMatches
from ..geometry.symmetric import FULL, invert, outer, times
from ..geometry.types import Array
from ..paper.settings import TranslationConfig
from ..paper.translation import solve_translation
from .settings import KitTranslationConfig

CONVERGED_TRANSLATION_M = 1e-4  # change at which the re-weighting ends, a fortieth of the error due to noise
MIN_ROW_DEPTH_M = 0.1  # lower bound of the depths by which rows are divided
# Lower bound of d² (normalised): for f = 720 px, d = 0.07 px. With less, no depth is known.
MIN_SQUARED_DISPARITY = 1e-8
ROBUST_START_LIMIT = 4.0  # residual at which the start truncates a feature's error, in `config.scale`
IDENTITY = np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0])  # as xx, yy, zz, xy, xz, yz


def robust_translation(
    camera: StereoCamera, matches: StereoMatches, R_cp: Array, config: KitTranslationConfig
) -> tuple[Array, Array] | None:
    """The common translation of all features.

    The error of a row is in metres and grows with depth, so rows are weighted by 1/Z with estimated depths.
    Re-weighting by the residual in pixels (Cauchy) makes the solution robust.

    Parameters
    ----------
    matches : N features; R_cp : (3, 3) rotation, previous to current.

    Returns
    -------
    t_cp (3,), metres, and the residual norm of each feature over its eight rows, (N,) pixels (infinite for
    features beyond the largest depth). None without a usable feature or a unique solution.
    """
    depth = camera.triangulate(matches.prev_left, matches.prev_right)[:, 2]
    # A NaN depth fails the comparison.
    usable = np.flatnonzero((depth > 0) & (depth <= config.max_depth))
    if len(usable) == 0:
        return None
    before = stereo_points(camera, matches.prev_left[usable], matches.prev_right[usable]).rotated(R_cp)
    now = stereo_points(camera, matches.cur_left[usable], matches.cur_right[usable])
    scale = config.scale / camera.f
    system = EliminatedPoints(before, now, depth[usable], depth[usable])
    try:
        if "robust-start" in config.without:
            t = least_squares(system)
        else:
            t = robust_start(system, ROBUST_START_LIMIT * scale)
        for _ in range(config.iterations):
            # The weights of the rows use the estimated depth of each point in both frames.
            system = EliminatedPoints(before, now, *system.depths(t))
            weight = 1.0 / (1.0 + system.squared_residuals(t) / scale**2)
            previous_t = t
            t = np.linalg.solve((system.W @ weight)[FULL], system.right_sides() @ weight)
            if np.linalg.norm(t - previous_t) < CONVERGED_TRANSLATION_M:
                break
    except np.linalg.LinAlgError:
        return None
    residual = np.full(len(matches), np.inf)
    residual[usable] = camera.f * np.sqrt(system.squared_residuals(t))
    return t, residual


def papers_translation(
    camera: StereoCamera, matches: StereoMatches, R_cp: Array, config: KitTranslationConfig
) -> tuple[Array, Array] | None:
    """The translation by the paper's pseudo-inverse of two pairs, in place of `robust_translation`.

    Same parameters and result, but the residual is only 0 for an inlier and infinite for another feature.
    """
    limits = TranslationConfig(max_depth=config.max_depth, agreement=config.agreement)
    solved = solve_translation(camera, matches, R_cp, limits)
    if solved is None:
        return None
    t, fits = solved
    return t, np.where(fits, 0.0, np.inf)


class StereoPoints(NamedTuple):
    """N points of one stereo pair, in the axes of a camera.

    Attributes
    ----------
    X : (3, N) points, metres.
    ray : (3, N) directions of largest uncertainty, with z component 1 in the pair's own axes.
    axis : (3,) the pair's own z axis; lateral errors are orthogonal to it.
    along : (N,) ratio of the variances along and across the ray, 4 / d².
    residual_floor : (N,) smallest possible squared residual of the rows without division by depth, due to the
        difference of y and y'.
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
        """Covariances (6, N) for unit row errors, with rows divided by `depth` (N,), metres.

        depth² (lateral / 2 + along / 2 · ray rayᵀ), where `lateral` is diag(1, 1, 0) in the pair's own axes.
        """
        half = 0.5 * depth * depth
        lateral = IDENTITY - outer(self.axis)
        return half * lateral[:, None] + (half * self.along) * outer(self.ray)


def stereo_points(camera: StereoCamera, left: Array, right: Array) -> StereoPoints:
    """Linear triangulation, equation (2) with one pair, of left and right pixels (N, 2).

    If the two rows differ, y is their mean. Equal rows give the points of `StereoCamera.triangulate`.
    """
    x, y = camera.normalise(left).T
    x_r, y_r = camera.normalise(right).T
    d2 = np.maximum((x - x_r) ** 2 + (y - y_r) ** 2, MIN_SQUARED_DISPARITY)
    ray = np.stack([0.5 * (x + x_r), 0.5 * (y + y_r), np.ones_like(x)])
    X = ray * (camera.baseline * (x - x_r) / d2)
    X[0] += 0.5 * camera.baseline
    residual_floor = 0.5 * camera.baseline**2 * (y - y_r) ** 2 / d2
    return StereoPoints(X, ray, np.array([0.0, 0.0, 1.0]), 4.0 / d2, residual_floor)


class EliminatedPoints:
    """The eight rows of N features, divided by the features' depths, after the elimination of each point.

    Parameters
    ----------
    depth_p, depth_c : (N,) metres, by which the rows of the previous and of the current pair are divided.

    Attributes
    ----------
    before : points of the previous pair, in the axes of the current pair; now : points of the current pair.
    apart : (3, N) differences `now` minus `before`, metres.
    C_p : (6, N) covariances of the points in `before`; W : (6, N) inverse covariances of `apart`.
    residual_floor : (N,) squared residual that does not depend on t.
    """

    def __init__(self, before: StereoPoints, now: StereoPoints, depth_p: Array, depth_c: Array):
        self.before = before
        self.now = now
        self.apart = now.X - before.X
        self.C_p = before.covariance(depth_p)
        self.W = invert(self.C_p + now.covariance(depth_c))
        self.residual_floor = before.residual_floor / depth_p**2 + now.residual_floor / depth_c**2

    def right_sides(self) -> Array:
        """Right-hand sides g (3, N) of the features' normal equations W t = g."""
        return times(self.W, self.apart)

    def squared_residuals(self, t: Array) -> Array:
        """Sum (N,) of each feature's eight squared residuals at t (3,), for the feature's best point."""
        off = self.apart - t[:, None]
        squared = np.einsum("in,in->n", off, times(self.W, off)) + self.residual_floor
        return np.asarray(np.maximum(squared, 0.0))

    def depths(self, t: Array) -> tuple[Array, Array]:
        """Depths (N,), metres, of each feature's best point for t, in the previous and in the current pair.

        `apart` minus t is distributed over both points by their covariances; C_p W is the share of `before`.
        """
        off = self.apart - t[:, None]
        RQ = self.before.X + times(self.C_p, times(self.W, off))
        previous_depth = np.maximum(self.before.axis @ RQ, MIN_ROW_DEPTH_M)
        current_depth = np.maximum(RQ[2] + t[2], MIN_ROW_DEPTH_M)
        return previous_depth, current_depth


def least_squares(system: EliminatedPoints) -> Array:
    """The translation (3,) with the smallest sum of squared residuals of all features."""
    return np.asarray(np.linalg.solve(system.W.sum(axis=1)[FULL], system.right_sides().sum(axis=1)))


def robust_start(system: EliminatedPoints, limit: float) -> Array:
    """A start that is robust to wrong matches: the best of many translations (3,), each from three features.

    Triple i has the features i, i + n and i + 2 n, where n is a third of the number of features. No feature
    is used twice, and the result is deterministic. The best translation has the smallest sum of squared
    residuals, each truncated at `limit`²; `limit` is in the unit of normalised points.
    """
    W = system.W
    g = system.right_sides()
    W_of_triples = np.moveaxis(_sums_of_triples(W)[FULL], 2, 0)  # (n, 3, 3)
    g_of_triples = _sums_of_triples(g).T[:, :, None]  # (n, 3, 1)
    # A small regularisation for triples of features on one line of sight, which do not fix all directions.
    trace = np.trace(W_of_triples, axis1=1, axis2=2)
    W_of_triples = W_of_triples + 1e-9 * trace[:, None, None] * np.eye(3)
    t = np.linalg.solve(W_of_triples, g_of_triples)[:, :, 0]
    # A squared residual is tᵀ W t - 2 gᵀ t plus its value at t = 0. One matrix product gives the first two
    # terms of all features for all translations.
    x, y, z = t.T
    factors_of_W = [x * x, y * y, z * z, 2 * x * y, 2 * x * z, 2 * y * z]
    factors_of_g = [-2 * x, -2 * y, -2 * z]
    factors = np.stack(factors_of_W + factors_of_g, axis=1)
    squared = factors @ np.concatenate([W, g]) + system.squared_residuals(np.zeros(3))
    costs = np.minimum(squared, limit**2).sum(axis=1)
    return np.asarray(t[np.argmin(costs)])


def _sums_of_triples(columns: Array) -> Array:
    """Sums (K, n) over the columns i, i + n and i + 2 n of (K, N); the first column if N is less than 3."""
    n = columns.shape[1] // 3
    if n == 0:
        return columns[:, :1]
    return np.asarray(columns[:, : 3 * n].reshape(-1, 3, n).sum(axis=1))
