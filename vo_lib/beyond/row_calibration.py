"""Chapter 4, beyond the paper: rows of a stereo pair that do not quite agree.

In a rectified pair both images of a point lie on one row. On KITTI they differ by up to 0.8 px in the corners
of the image, much the same in every recording: the lenses were not undistorted perfectly (Krešo and Šegvić,
"Improving the egomotion estimation by correcting the calibration bias", VISAPP 2015). Stereo matches
alone show the difference. A polynomial of degree two in the image holds nearly all of it; its coefficients
are found by recursive least squares.
"""

from __future__ import annotations

import numpy as np

from ..core.camera import StereoCamera
from ..core.types import Array
from .config import CalibrationConfig

TERMS = 6
ITERATIONS = 6  # re-weightings in the first frame; later ones need fewer
DONE = 0.01  # pixels; coefficients that change less are the last


def row_terms(x: Array, y: Array) -> Array:
    """1, x, y, x², xy, y² of normalised image points (N,) each, (6, N)."""
    return np.stack([np.ones_like(x), x, y, x * x, x * y, y * y])


class RowError:
    """The row in the left less that in the right image, as a polynomial of the left position.

    Attributes
    ----------
    coefficients : (6,) pixels, of `row_terms`.
    information : (6, 6) inverse covariance; vector : (6,) it times the coefficients.
    """

    def __init__(self, config: CalibrationConfig):
        self.config = config
        self.information, self.vector = np.eye(TERMS) / config.row_deviation**2, np.zeros(TERMS)
        self.coefficients = np.linalg.solve(self.information, self.vector)

    def at(self, x: Array, y: Array) -> Array:
        """Row differences (N,), pixels, expected at normalised left points, (N,) each."""
        return np.asarray(self.coefficients @ row_terms(x, y))

    def update(self, camera: StereoCamera, left: Array, right: Array) -> None:
        """Learn from stereo matches as they were measured, pixels (N, 2) each; Cauchy weights."""
        terms, scale = row_terms(*camera.normalise(left).T), self.config.row_scale
        difference = left[:, 1] - right[:, 1]
        keep = 1.0 - 1.0 / self.config.row_memory
        information, vector = keep * self.information, keep * self.vector
        for _ in range(ITERATIONS):
            weight = 1.0 / (scale**2 + (difference - self.coefficients @ terms) ** 2)
            weighted = terms * weight
            self.information, self.vector = information + weighted @ terms.T, vector + weighted @ difference
            before, self.coefficients = self.coefficients, np.linalg.solve(self.information, self.vector)
            if np.abs(self.coefficients - before).max() < DONE:
                break
