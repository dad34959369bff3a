"""Refinement of rotation and direction of translation on all inliers (chapter 3, not in the paper)."""

from __future__ import annotations

import cv2
import numpy as np

from ..geometry.motion import skew
from ..geometry.types import Array
from ..paper.sampson import MatchTerms

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
    R_cp, direction : start; matches : `match_terms` of normalised points.
    scale : Sampson distance, in the unit of the points, at which a match's weight is halved.

    Returns
    -------
    R_cp (3, 3) and unit direction (3,).
    """
    R = R_cp
    t = direction / np.linalg.norm(direction)
    for _ in range(iterations):
        r, jac = distances_and_derivatives(R, t, matches)
        weight = 1.0 / (1.0 + (r / scale) ** 2)
        weighted = jac * weight
        H = weighted @ jac.T
        H[np.diag_indices(5)] += 1e-12 * np.trace(H)
        # Constant weights make the step too short: the cost has curvature 2 w² - w, not w (Huber 1981).
        curvature = 2.0 * float(weight @ weight / weight.sum()) - 1.0
        curvature = min(max(curvature, 1.0 / MAX_STEP_RATIO), 1.0)
        delta = -np.linalg.solve(H, weighted @ r) / curvature
        R = cv2.Rodrigues(delta[:3])[0] @ R
        t = t + delta[3:] @ _tangent_basis(t)
        t = t / np.linalg.norm(t)
        if float(delta @ delta) < CONVERGED_ROTATION_RAD**2:
            break
    return R, t


def distances_and_derivatives(R_cp: Array, direction: Array, matches: MatchTerms) -> tuple[Array, Array]:
    """Sampson distances (N,), and derivatives (5, N) with respect to the rotation and the direction of t.

    The distance is d = cᵀ E p / norm, with norm² = |(E p)₁,₂|² + |(Eᵀ c)₁,₂|². A rotation δω of R and a
    tangential change δt of t change E by [t]× [δω]× R + [δt]× R. The derivative of the quotient follows.
    Without the derivative of the norm, noise biases the direction towards the matches, that is downwards.
    """
    basis = np.concatenate([direction[None], _tangent_basis(direction)])
    t, *across = (basis @ GENERATORS.reshape(3, 9)).reshape(3, 3, 3)
    E = np.concatenate([t[None], t @ GENERATORS, across]) @ R_cp  # E and its five derivatives, (6, 3, 3)
    p, c = matches.points
    line_c = E[:, :2] @ p
    line_p = E[:, :, :2].swapaxes(1, 2) @ c
    norm2 = np.maximum(np.sum(line_c[0] ** 2 + line_p[0] ** 2, axis=0), 1e-20)
    half_change = np.sum(line_c[0] * line_c[1:] + line_p[0] * line_p[1:], axis=1)
    error = (E.reshape(6, 9) @ matches.outer) / np.sqrt(norm2)
    return error[0], error[1:] - half_change * (error[0] / norm2)


def _tangent_basis(t: Array) -> Array:
    """Two unit vectors (2, 3) orthogonal to each other and to the unit vector t."""
    # The first two rows of the reflection that maps t to ± the third axis.
    h = t.copy()
    h[2] += np.copysign(1.0, t[2])
    return np.asarray((np.eye(3) - np.outer(h, h) / (1.0 + abs(t[2])))[:2])
