"""Refinement of rotation and direction of translation on all inliers (chapter 3, not in the paper)."""

from __future__ import annotations

import cv2
import numpy as np

from ..geometry.motion import skew
from ..geometry.types import Array
from ..paper.sampson import MIN_DENOMINATOR, MatchTerms

REFINEMENT_ITERATIONS = 15
CONVERGED_ROTATION_RAD = 5e-6  # 0.0003°, a tenth of the error due to noise
MAX_STEP_RATIO = 1.5  # the longest step, as a multiple of the Gauss-Newton step with constant weights
GENERATORS = skew(np.eye(3))  # d/dω of exp([ω]×) at 0


def refine(
    R_cp: Array, direction: Array, matches: MatchTerms, scale: float, iterations: int = REFINEMENT_ITERATIONS
) -> tuple[Array, Array]:
    """R and the direction of t that minimise the Sampson distances, by robust Gauss-Newton steps.

    Parameters
    ----------
    R_cp, direction : (3, 3) and (3,), the start; matches : `match_terms` of normalised points.
    scale : Sampson distance, in the unit of the points, at which a match's weight is halved.
    iterations : largest number of steps.

    Returns
    -------
    R_cp (3, 3) and unit direction (3,).
    """
    R = R_cp
    t = direction / np.linalg.norm(direction)
    for _ in range(iterations):
        distances, J = distances_and_derivatives(R, t, matches)
        weight = 1.0 / (1.0 + (distances / scale) ** 2)
        weighted = J * weight
        H = weighted @ J.T
        H[np.diag_indices(5)] += 1e-12 * np.trace(H)  # so that H can be inverted
        # Gauss-Newton takes each weight w for a constant, so the step is too short: the cost has the
        # curvature 2 w² - w, not w (Huber 1981). The ratio is that of the two sums over all matches.
        curvature_ratio = 2.0 * float(weight @ weight / weight.sum()) - 1.0
        curvature_ratio = min(max(curvature_ratio, 1.0 / MAX_STEP_RATIO), 1.0)
        delta = -np.linalg.solve(H, weighted @ distances) / curvature_ratio
        R = cv2.Rodrigues(delta[:3])[0] @ R
        t = t + delta[3:] @ _tangent_basis(t)
        t = t / np.linalg.norm(t)
        if float(delta @ delta) < CONVERGED_ROTATION_RAD**2:
            break
    return R, t


def distances_and_derivatives(R_cp: Array, direction: Array, matches: MatchTerms) -> tuple[Array, Array]:
    """Sampson distances (N,) of a motion, and their derivatives (5, N): by a rotation, and by a turn of t.

    The distance is d = cᵀ E p / norm, with norm² = |(E p)₁,₂|² + |(Eᵀ c)₁,₂|². A rotation δω of R and a
    tangential change δt of t change E by [t]× [δω]× R + [δt]× R. The derivative of the quotient follows.
    Without the derivative of the norm, noise biases the direction towards the matches, that is downwards.
    """
    basis = np.concatenate([direction[None], _tangent_basis(direction)])
    # [t]×, and [δt]× for each of the two tangential directions, (3, 3) each.
    t_cross, *changes_of_t = (basis @ GENERATORS.reshape(3, 9)).reshape(3, 3, 3)
    # E and its five derivatives, (6, 3, 3).
    E = np.concatenate([t_cross[None], t_cross @ GENERATORS, changes_of_t]) @ R_cp
    p, c = matches.points
    line_c = E[:, :2] @ p
    line_p = E[:, :, :2].swapaxes(1, 2) @ c
    norm2 = np.maximum(np.sum(line_c[0] ** 2 + line_p[0] ** 2, axis=0), MIN_DENOMINATOR)
    half_change_of_norm2 = np.sum(line_c[0] * line_c[1:] + line_p[0] * line_p[1:], axis=1)
    over_norm = (E.reshape(6, 9) @ matches.outer) / np.sqrt(norm2)
    distances = over_norm[0]
    return distances, over_norm[1:] - half_change_of_norm2 * (distances / norm2)


def _tangent_basis(t: Array) -> Array:
    """Two unit vectors (2, 3) orthogonal to each other and to the unit vector t."""
    # The first two rows of the reflection that maps t to ± the third axis.
    h = t.copy()
    h[2] += np.copysign(1.0, t[2])
    return np.asarray((np.eye(3) - np.outer(h, h) / (1.0 + abs(t[2])))[:2])
