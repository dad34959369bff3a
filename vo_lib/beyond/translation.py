"""Chapter 4: the translation by linear least squares, equations (2) and (3) of the paper.

With R known, a feature seen at x = (u - cx) / f, y = (v - cy) / f gives two rows in each image:
(x e3 - e1)ᵀ P = 0 and (y e3 - e2)ᵀ P = 0 in a left image; (x e3 - e1)ᵀ P = -b in a right one, where
P = Q in the previous pair and P = R Q + t in the current one. Eight rows, six unknowns (Q, t). In the paper
Q is in the current frame, and its P is the projection.

Four rows give the point in the previous pair, four the point in the current one, so alone a feature says
t = P - R Q. Stacked, with one t and with each Q eliminated, the features leave the normal equations
Σ W_i t = Σ W_i (P_i - R Q_i), where W_i is the inverse of the covariance of that difference
(`vo_lib.beyond.stereo_points`).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..core.camera import StereoCamera
from ..core.matches import StereoMatches
from ..core.symmetric import FULL, invert, times
from ..core.types import Array
from .config import TranslationConfig
from .stereo_points import StereoPoints, stereo_points

DONE = 1e-4  # metres, a fortieth of what noise leaves; a re-weighting that changes less is the last
NEAREST = 0.1  # metres; rows are divided by no smaller depth


def solve_translation(
    camera: StereoCamera, matches: StereoMatches, R_cp: Array, config: TranslationConfig
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
    try:
        system, t = _stacked(before, now, depth[used], camera.f, config)
    except np.linalg.LinAlgError:
        return None
    if not np.isfinite(t).all():
        return None
    full = np.full(len(matches), np.inf)
    full[used] = camera.f * np.sqrt(system.squared_residuals(t))
    return np.asarray(t), full


class EliminatedPoints(NamedTuple):
    """The eight rows of N features, divided by their depths, with every point eliminated.

    Attributes
    ----------
    before, now : points in the previous pair, in the axes of the current one, and in the current pair.
    C_p : (6, N) covariance of the points before; W : (6, N) inverse covariance of now.X - before.X.
    residual_floor : (N,) squared residual that is left whatever t is.
    """

    before: StereoPoints
    now: StereoPoints
    C_p: Array
    W: Array
    residual_floor: Array

    def normal_equations(self) -> tuple[Array, Array]:
        """Each feature's H (6, N) and g (3, N) of H t = g."""
        return self.W, times(self.W, self.now.X - self.before.X)

    def squared_residuals(self, t: Array) -> Array:
        """Squared residual (N,) over the eight rows under t (3,), each feature with its best point."""
        v = self.now.X - self.before.X - t[:, None]
        return np.asarray(np.maximum(np.einsum("in,in->n", v, times(self.W, v)) + self.residual_floor, 0.0))

    def depths(self, t: Array) -> tuple[Array, Array]:
        """Depths (N,) of each feature's best point under t, in the previous and in the current pair."""
        v = self.now.X - self.before.X - t[:, None]
        RQ = self.before.X + times(self.C_p, times(self.W, v))
        return np.maximum(self.before.axis @ RQ, NEAREST), np.maximum(RQ[2] + t[2], NEAREST)


def eliminate_points(
    before: StereoPoints, now: StereoPoints, depth_p: Array, depth_c: Array
) -> EliminatedPoints:
    """Features' rows divided by their depths (N,), metres, in the previous and the current pair."""
    C_p = before.covariance(depth_p)
    W = invert(C_p + now.covariance(depth_c))
    floor = before.residual_floor / depth_p**2 + now.residual_floor / depth_c**2
    return EliminatedPoints(before, now, C_p, W, floor)


def _stacked(
    before: StereoPoints, now: StereoPoints, depth: Array, focal: float, config: TranslationConfig
) -> tuple[EliminatedPoints, Array]:
    """The last system and its robust solution t_cp (3,)."""
    scale = config.scale / focal
    system = eliminate_points(before, now, depth, depth)
    t = robust_start(system, 4.0 * scale)
    for _ in range(config.iterations):
        # The rows' weights use the depth of each point as solved, in both frames.
        system = eliminate_points(before, now, *system.depths(t))
        weight = 1.0 / (1.0 + system.squared_residuals(t) / scale**2)
        H, g = system.normal_equations()
        before_step, t = t, np.linalg.solve((H @ weight)[FULL], g @ weight)
        if np.linalg.norm(t - before_step) < DONE:
            break
    return system, t


def robust_start(system: EliminatedPoints, limit: float) -> Array:
    """The best of many translations from three features each: a start no wrong match can pull away.

    The triples are cut from the features in order, a third of them apart, so every feature is used once
    and nothing is random. The best one has the smallest sum of squared residuals, truncated at `limit`.
    """
    H, g = system.normal_equations()
    third = H.shape[1] // 3
    sums = [a[:, : 3 * third].reshape(-1, 3, third).sum(axis=1) if third else a[:, :1] for a in (H, g)]
    # A triple of features on one line of sight leaves a direction open; close it gently.
    A = np.moveaxis(sums[0][FULL], 2, 0)
    A = A + 1e-9 * np.trace(A, axis1=1, axis2=2)[:, None, None] * np.eye(3)
    t = np.linalg.solve(A, sums[1].T[:, :, None])[:, :, 0]
    # The squared residuals of all features under all translations are one matrix product.
    x, y, z = t.T
    monomials = np.stack(
        [x * x, y * y, z * z, 2 * x * y, 2 * x * z, 2 * y * z, -2 * x, -2 * y, -2 * z], axis=1
    )
    squared = monomials @ np.concatenate([H, g]) + system.squared_residuals(np.zeros(3))
    return np.asarray(t[np.argmin(np.minimum(squared, limit**2).sum(axis=1))])
