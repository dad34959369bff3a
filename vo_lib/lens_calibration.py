"""Chapter 3, beyond the paper: what the undistortion left of the lens bends the epipolar geometry.

Brown's decentering terms, with r² = x² + y² ("Decentering distortion of lenses", 1966):

    δx = 2 p1 x y + p2 (r² + 2 x²),   δy = p1 (r² + 2 y²) + 2 p2 x y,

or with the vector q = (p2, p1): δ = 2 (q · x) x + r² q.

On sequences 00 and 01 of KITTI p1 and p2 times f are about 1.3 and -1.5 px: three pixels near the border of
the left image. They turn the rotations of the essential matrix: RE on 00 is 1.56 deg/100 m with them and
1.17 without. The epipolar residuals of matches betray both. They are found by recursive least squares.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from .config import CalibrationConfig
from .geometry import NORMAL, Array, essential_from_motion
from .refinement import distances_and_derivatives
from .sampson import match_terms

FINEST = 0.05  # pixels; no match is taken to be known better
DIFFERENCE = 1e-4  # of a coefficient, for derivatives


def decentering(x: Array, coefficients: Array) -> Array:
    """Displacements (…, 2, N) of normalised points (2, N) by lenses with p1 and p2 (…, 2)."""
    q = coefficients[..., ::-1]
    return np.asarray(2.0 * (q @ x)[..., None, :] * x + np.einsum("in,in->n", x, x) * q[..., None])


class LensError:
    """The decentering distortion left in the left images, from frame to frame.

    Attributes
    ----------
    coefficients : (2,) p1 and p2 of the correction; information : (2, 2) its inverse covariance.
    """

    def __init__(self, focal: float, config: CalibrationConfig):
        self.focal = focal
        self.config = config
        self.coefficients = np.zeros(2)
        self.information = np.eye(2) * (focal / config.lens_deviation) ** 2

    def state(self) -> dict[str, Array]:
        """What was learnt so far, as plain arrays."""
        return {"lens": self.coefficients, "lens_information": self.information}

    def restore(self, state: Mapping[str, Array]) -> None:
        """Go on as the lens whose `state` this was; same settings."""
        self.coefficients, self.information = state["lens"], state["lens_information"]

    def correct(self, x: Array) -> Array:
        """Normalised points (N, 2) without the distortion known so far."""
        return np.asarray(x + decentering(x.T, self.coefficients).T)

    def update(self, x_p: Array, x_c: Array, R_cp: Array, direction: Array) -> None:
        """Learn from a frame's points as measured, (N, 2) each, and its motion.

        Weights are squared Cauchy weights: wrong matches must not count, they would bend the lens.

        One Gauss-Newton step on the distances over rotation, direction and lens. The motion is eliminated,
        so its own error does no harm.
        """
        E = essential_from_motion(R_cp, direction)
        steps = np.concatenate([np.zeros((1, 2)), DIFFERENCE * np.eye(2)])
        r, *moved = measured_distances(E, x_p, x_c, self.coefficients + steps)
        deviation = max(NORMAL * float(np.median(np.abs(r))), FINEST / self.focal)
        _, by_motion = distances_and_derivatives(
            R_cp, direction, match_terms(self.correct(x_p), self.correct(x_c))
        )
        jac = np.concatenate([by_motion, (moved - r) / DIFFERENCE])
        weighted = jac / (1.0 + (r * self.focal / self.config.lens_scale) ** 2) ** 2
        H, g = weighted @ jac.T, -weighted @ r
        H[np.diag_indices(5)] += 1e-12 * max(float(np.trace(H[:5, :5])), 1e-12)
        motion = np.linalg.solve(H[:5, :5], np.column_stack([H[:5, 5:], g[:5]]))
        # Parts of a drive differ by up to six times more than noise explains; twice that is safe.
        deviation *= self.config.lens_caution
        self.information = self.information + (H[5:, 5:] - H[5:, :5] @ motion[:, :2]) / deviation**2
        change = np.linalg.solve(self.information, (g[5:] - H[5:, :5] @ motion[:, 2]) / deviation**2)
        self.coefficients = self.coefficients + change


def measured_distances(E: Array, x_p: Array, x_c: Array, coefficients: Array) -> Array:
    """Epipolar distances (K, N) of points corrected by K lenses, in units of the points as measured.

    The Sampson distance divides by the length of the gradient. It is taken here by the points as measured,
    whose noise is known: else a lens that draws the points together would always seem the better one.

    Parameters
    ----------
    E : (3, 3); x_p, x_c : (N, 2) normalised points as measured; coefficients : (K, 2) p1 and p2 of each lens.
    """
    n = len(x_p)
    x = np.concatenate([x_p, x_c]).T
    at = x + decentering(x, coefficients)
    p, c = at[..., :n], at[..., n:]
    lines_c, lines_p = E[:, :2] @ p + E[:, 2:], E[:2, :2].T @ c + E[2, :2, None]
    distance = np.sum(lines_c[:, :2] * c, axis=1) + lines_c[:, 2]
    # The derivative of the correction is the unit matrix and this symmetric one.
    xy, yx = coefficients @ (2.0 * x), coefficients @ (2.0 * x[::-1])
    xx, yy = (
        1.0 + yx + 2.0 * coefficients[:, 1:] * (2.0 * x[0]),
        1.0 + yx + 2.0 * coefficients[:, :1] * (2.0 * x[1]),
    )
    a, b = np.concatenate([lines_p, lines_c[:, :2]], axis=2).swapaxes(0, 1)
    squared = (a * xx + b * xy) ** 2 + (a * xy + b * yy) ** 2
    norm2 = squared[:, :n] + squared[:, n:]
    return np.asarray(distance / np.sqrt(np.maximum(norm2, 1e-20)))
