"""Chapter 3, beyond the paper: a rotation and a direction of translation refined on all inliers."""

from __future__ import annotations

import numpy as np

from .geometry import Array, essential_from_motion, rotation_from_vector, skew
from .sampson import denominator_forms, match_terms

ITERATIONS = 15
DONE = 1e-6  # radians; a hundredth of the error that noise leaves
LONGEST = 1.5  # the longest step, in Gauss-Newton steps with held weights
GENERATORS = skew(np.eye(3))  # d/dω of exp([ω]×) at 0


def refine(
    R_cp: Array, direction: Array, x_p: Array, x_c: Array, scale: float, iterations: int = ITERATIONS
) -> tuple[Array, Array]:
    """R and the direction of t refined together by robust Gauss-Newton on the Sampson distance.

    Parameters
    ----------
    R_cp, direction : start; x_p, x_c : (N, 2) normalised points.
    scale : Sampson distance, in the unit of the points, at which a match's weight is halved.

    Returns
    -------
    R_cp (3, 3) and unit direction (3,).

    The residual is cᵀ E p / norm; the norm changes little and is held within a step. Turning R by δω and
    moving t by δt across itself changes E by [t]× [δω]× R + [δt]× R, so the residuals and all five
    derivatives are one product with the nine c_i p_j of the matches.
    """
    R, t = R_cp, direction / np.linalg.norm(direction)
    terms = match_terms(x_p, x_c)
    for _ in range(iterations):
        E = essential_from_motion(R, t)
        across = _across(t)
        changes = np.concatenate([E[None], skew(t) @ GENERATORS @ R, skew(across) @ R]).reshape(6, 9)
        norm2 = np.maximum(denominator_forms(E[None])[0] @ terms.squares, 1e-20)
        r_and_jac = changes @ terms.outer
        r_and_jac /= np.sqrt(norm2)
        r, jac = r_and_jac[0], r_and_jac[1:]
        weight = 1.0 / (1.0 + (r / scale) ** 2)
        weighted = jac * weight
        H = weighted @ jac.T
        H[np.diag_indices(5)] += 1e-12 * np.trace(H)
        # Weights that are held make the step too short: the cost bends by 2 w² - w, not by w (Huber 1981).
        bend = float(np.sum(2.0 * weight**2 - weight) / np.sum(weight))
        delta = -np.linalg.solve(H, weighted @ r) / np.clip(bend, 1.0 / LONGEST, 1.0)
        R = rotation_from_vector(delta[:3]) @ R
        t = t + delta[3:] @ across
        t = t / np.linalg.norm(t)
        if float(delta @ delta) < DONE**2:
            break
    return R, t


def _across(t: Array) -> Array:
    """Two unit vectors (2, 3) orthogonal to each other and to the unit vector t."""
    # The reflection that takes t to ± the third axis has them as its first rows.
    h = t.copy()
    h[2] += np.copysign(1.0, t[2])
    return np.asarray((np.eye(3) - np.outer(h, h) / (1.0 + abs(t[2])))[:2])
