"""Chapter 4, an experiment: the translations of two steps at once, from features seen in three stereo pairs.

The paper speaks of three consecutive frames, but its system of eight rows and six unknowns has two; two
frames are the method. With a third pair a feature has twelve rows and nine unknowns: its point and two
translations. `vo lesson translation` compares: on clean matches it gains little, and a mismatch in either
step spoils both, so it stays an experiment.
"""

from __future__ import annotations

import numpy as np

from ..beyond.stereo_points import stereo_points
from ..beyond.translation import NEAREST, eliminate_points, solve_translation
from ..config import TranslationConfig
from ..core.camera import StereoCamera
from ..core.matches import StereoMatches
from ..core.symmetric import FULL
from ..core.types import Array


def solve_three_frames(
    camera: StereoCamera,
    earlier: StereoMatches,
    now: StereoMatches,
    R_earlier: Array,
    R_cp: Array,
    config: TranslationConfig,
) -> tuple[Array, Array] | None:
    """Translations of the step before and of the present one, metres, rotations known.

    Parameters
    ----------
    earlier : matches of the pairs a and b; now : of the pairs b and c. The same feature has the same id, and
        the same place in b.
    R_earlier, R_cp : (3, 3) rotations a to b and b to c.

    Returns
    -------
    t_ab and t_bc (3,) each; None where one of the two steps alone has no answer.

    A feature in both says P_b - R P_a = t_ab and P_c - R P_b = t_bc. The error of P_b is in both with
    opposite signs, so the two differences are weighted together, by the inverse of their 6×6 covariance. A
    feature seen in two pairs only says one of the two. Rows by 1/Z and Cauchy weights as in the method.
    """
    first = solve_translation(camera, earlier, R_earlier, config)
    second = solve_translation(camera, now, R_cp, config)
    if first is None or second is None:
        return None
    used, used_now = np.isfinite(first[1]), np.isfinite(second[1])
    earlier, now = earlier[used], now[used_now]
    _, i, j = np.intersect1d(earlier.id, now.id, return_indices=True)
    alone_i, alone_j = (np.setdiff1d(np.arange(len(m)), k) for m, k in ((earlier, i), (now, j)))
    d_ab, V_ab, floor_ab, (_, depth) = _differences(camera, earlier, R_earlier, first[0])
    d_bc, V_bc, floor_bc, (depth_now, _) = _differences(camera, now, R_cp, second[0])
    V = np.zeros((len(i) + len(alone_i) + len(alone_j), 6, 6))
    V[:] = np.eye(6)
    apart, floor = np.zeros((len(V), 6)), np.zeros(len(V))
    both, only_ab, only_bc = np.split(np.arange(len(V)), [len(i), len(i) + len(alone_i)])
    for rows, k in ((both, i), (only_ab, alone_i)):
        V[rows, :3, :3], apart[rows, :3] = V_ab[k], d_ab[k]
        floor[rows] += floor_ab[k]
    for rows, k in ((both, j), (only_bc, alone_j)):
        V[rows, 3:, 3:], apart[rows, 3:] = V_bc[k], d_bc[k]
        floor[rows] += floor_bc[k]
    # P_b is added in the first difference, and R_cp P_b taken away in the second.
    # Both differences have their own opinion of its depth: with the mean V stays positive.
    P_b = stereo_points(camera, now.prev_left[j], now.prev_right[j])
    shared = -_full(P_b.covariance(np.sqrt(depth[i] * depth_now[j]))) @ R_cp.T
    V[both, :3, 3:], V[both, 3:, :3] = shared, np.swapaxes(shared, 1, 2)
    information = np.linalg.inv(V)
    information[only_ab, 3:, 3:] = information[only_bc, :3, :3] = 0.0
    both_t = np.concatenate([first[0], second[0]])
    for _ in range(config.iterations):
        v = apart - both_t
        squared = np.einsum("ni,nij,nj->n", v, information, v) + floor
        weighted = information / (1.0 + squared / (config.scale / camera.f) ** 2)[:, None, None]
        both_t = np.linalg.solve(weighted.sum(axis=0), np.einsum("nij,nj->i", weighted, apart))
    return both_t[:3], both_t[3:]


def _differences(
    camera: StereoCamera, matches: StereoMatches, R: Array, t: Array
) -> tuple[Array, Array, Array, tuple[Array, Array]]:
    """Each feature's own translation (N, 3), its covariance (N, 3, 3), the residual that is left whatever the
    translation is, (N,), and the depths in both pairs by which rows are divided: as t gives them."""
    before = stereo_points(camera, matches.prev_left, matches.prev_right)
    now = stereo_points(camera, matches.cur_left, matches.cur_right)
    start = np.maximum(before.X[2], NEAREST)
    before = before.rotated(R)
    depths = eliminate_points(before, now, start, start).depths(t)
    system = eliminate_points(before, now, *depths)
    V = _full(system.C_p + now.covariance(depths[1]))
    return (now.X - before.X).T, V, system.residual_floor, depths


def _full(C: Array) -> Array:
    """Symmetric matrices (6, N) as (N, 3, 3)."""
    return np.asarray(np.moveaxis(C[FULL], 2, 0))
