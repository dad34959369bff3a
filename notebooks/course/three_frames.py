"""Chapter 4, an experiment: the translations of two steps at once, from features seen in three stereo pairs.

The paper speaks of three consecutive frames, but its system of eight rows and six unknowns has two; two
frames are the method. With a third pair a feature has twelve rows and nine unknowns: its point and two
translations. `vo lesson translation` compares: on clean matches it gains little, and a mismatch in either
step spoils both, so it stays an experiment.
"""

from __future__ import annotations

import numpy as np

from vo_lib.beyond.translation import NEAREST, solve_translation
from vo_lib.config import TranslationConfig
from vo_lib.core.camera import StereoCamera
from vo_lib.core.matches import StereoMatches
from vo_lib.core.types import Array
from vo_lib.method.translation import feature_rows


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
    t_ab and t_bc (3,) each; None where one of the two steps alone has no answer. Rows by 1/Z and Cauchy
    weights as in the method; a feature that is in two pairs only keeps its eight rows.
    """
    first = solve_translation(camera, earlier, R_earlier, config)
    second = solve_translation(camera, now, R_cp, config)
    if first is None or second is None:
        return None
    earlier, now = earlier[np.isfinite(first[1])], now[np.isfinite(second[1])]
    _, i, j = np.intersect1d(earlier.id, now.id, return_indices=True)
    A_ab, B_ab, c_ab = _weighted_rows(camera, earlier, R_earlier, first[0])
    A_bc, B_bc, c_bc = _weighted_rows(camera, now, R_cp, second[0])
    n, both = len(earlier), len(earlier) + len(now)
    A, B, c = np.zeros((both, 12, 3)), np.zeros((both, 12, 6)), np.zeros((both, 12))
    A[:n, :8], B[:n, :8, :3], c[:n, :8] = A_ab, B_ab, c_ab
    A[n:, :8], B[n:, :8, 3:], c[n:, :8] = A_bc, B_bc, c_bc
    # The pair c of a feature that is in all three: P_c = R_cp (R_earlier Q + t_ab) + t_bc.
    rows = B_bc[j, 4:]
    A[i, 8:], B[i, 8:, :3], B[i, 8:, 3:], c[i, 8:] = rows @ R_cp @ R_earlier, rows @ R_cp, rows, c_bc[j, 4:]
    own = np.delete(np.arange(both), n + j)
    projector = np.eye(12) - A[own] @ np.linalg.pinv(A[own])
    M, d = projector @ B[own], projector @ c[own, :, None]
    t = np.concatenate([first[0], second[0]])[:, None]
    for _ in range(config.iterations):
        squared = np.sum((d - M @ t) ** 2, axis=(1, 2))
        weighted = M.swapaxes(1, 2) / (1.0 + squared / (config.scale / camera.f) ** 2)[:, None, None]
        t = np.linalg.solve((weighted @ M).sum(axis=0), (weighted @ d).sum(axis=0))
    return t[:3, 0], t[3:, 0]


def _weighted_rows(
    camera: StereoCamera, matches: StereoMatches, R: Array, t: Array
) -> tuple[Array, Array, Array]:
    """A and B (N, 8, 3), c (N, 8) of equation (3), rows divided by the depth of the point in the pair."""
    X_p = camera.triangulate(matches.prev_left, matches.prev_right)
    depths = np.maximum(np.stack([X_p[:, 2], (X_p @ R.T + t)[:, 2]]), NEAREST)
    depth = np.repeat(depths, 4, axis=0).T
    A, B, c = feature_rows(camera, matches, R)
    return A / depth[:, :, None], B / depth[:, :, None], c / depth
