"""Chapter 3, beyond the paper: a rotation and a direction of translation refined on all inliers."""

from __future__ import annotations

import cv2
import numpy as np

from ..core.geometry import skew
from ..core.sampson import FORM_HESSIANS, MatchTerms
from ..core.types import Array

ITERATIONS = 15
DONE = 5e-6  # radians, 0.0003°; a tenth of the error that noise leaves
LONGEST = 1.5  # the longest step, in Gauss-Newton steps with held weights
GENERATORS = skew(np.eye(3))  # d/dω of exp([ω]×) at 0


def refine(
    R_cp: Array, direction: Array, matches: MatchTerms, scale: float, iterations: int = ITERATIONS
) -> tuple[Array, Array]:
    """R and the direction of t refined together by robust Gauss-Newton on the Sampson distance.

    Parameters
    ----------
    R_cp, direction : start; matches : `match_terms` of normalised points.
    scale : Sampson distance, in the unit of the points, at which a match's weight is halved.

    Returns
    -------
    R_cp (3, 3) and unit direction (3,).
    """
    R, t = R_cp, direction / np.linalg.norm(direction)
    for _ in range(iterations):
        r, jac = distances_and_derivatives(R, t, matches)
        weight = 1.0 / (1.0 + (r / scale) ** 2)
        weighted = jac * weight
        H = weighted @ jac.T
        H[np.diag_indices(5)] += 1e-12 * np.trace(H)
        # Weights that are held make the step too short: the cost bends by 2 w² - w, not by w (Huber 1981).
        bend = 2.0 * float(weight @ weight / weight.sum()) - 1.0
        delta = -np.linalg.solve(H, weighted @ r) / min(max(bend, 1.0 / LONGEST), 1.0)
        R = cv2.Rodrigues(delta[:3])[0] @ R
        t = t + delta[3:] @ _across(t)
        t = t / np.linalg.norm(t)
        if float(delta @ delta) < DONE**2:
            break
    return R, t


def distances_and_derivatives(R_cp: Array, direction: Array, matches: MatchTerms) -> tuple[Array, Array]:
    """Sampson distances (N,) and their derivatives by a rotation and by the direction across itself (5, N).

    The distance is cᵀ E p / norm, with norm² = |(E p)₁,₂|² + |(Eᵀ c)₁,₂|². Turning R by δω and moving t by δt
    across itself changes E by [t]× [δω]× R + [δt]× R, so cᵀ E p and its five derivatives are one product
    with the nine c_i p_j of the matches. norm² is quadratic in E, so it and its derivatives are another. They
    must not be left out: with the norm held, noise pulls the direction to where the matches are, down.
    """
    t, *across = (np.concatenate([direction[None], _across(direction)]) @ GENERATORS.reshape(3, 9)).reshape(
        3, 3, 3
    )
    E_and_changes = (np.concatenate([t[None], t @ GENERATORS, across]) @ R_cp).reshape(6, 9)
    r_and_jac = E_and_changes @ matches.outer
    by_entries = FORM_HESSIANS @ E_and_changes[0]
    norm2_and_changes = (E_and_changes @ by_entries.T) @ matches.squares
    norm2 = np.maximum(0.5 * norm2_and_changes[0], 1e-20)
    r_and_jac /= np.sqrt(norm2)
    r = r_and_jac[0]
    return r, r_and_jac[1:] - norm2_and_changes[1:] * (0.5 * r / norm2)


def _across(t: Array) -> Array:
    """Two unit vectors (2, 3) orthogonal to each other and to the unit vector t."""
    # The reflection that takes t to ± the third axis has them as its first rows.
    h = t.copy()
    h[2] += np.copysign(1.0, t[2])
    return np.asarray((np.eye(3) - np.outer(h, h) / (1.0 + abs(t[2])))[:2])
