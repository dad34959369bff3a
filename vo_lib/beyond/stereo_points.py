"""Chapter 4: points of a stereo pair by linear least squares, and how well they are known.

A pair's four rows of equation (2), with x, y in the left and x', y' in the right image, leave

    S = 2 [[1, 0, -m], [0, 1, -n], [-m, -n, m² + n² + d²/4]],   m, n = (x + x')/2, (y + y')/2,
                                                                d² = (x - x')² + (y - y')²,

whose inverse is diag(1, 1, 0)/2 + 2/d² (m, n, 1)(m, n, 1)ᵀ: errors of a point are small across its ray and
large along it. Rows weighted by 1/Z give Z² times that, in units of the pixel noise. Symmetric 3×3 matrices
are kept as (6, N): xx, yy, zz, xy, xz, yz.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..core.camera import StereoCamera
from ..core.symmetric import outer
from ..core.types import Array

FAINTEST = 1e-8  # smallest d², a tenth of a pixel: below, the depth is as good as unknown
_ONE = np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0])


class StereoPoints(NamedTuple):
    """N points of one stereo pair, in the axes of some camera.

    Attributes
    ----------
    X : (3, N) points, metres.
    ray : (3, N) directions along which they are uncertain, of length 1 in the pair's own z.
    axis : (3,) the pair's own z axis; lateral errors are orthogonal to it.
    along : (N,) variance along the ray against that across it, 4 / d².
    residual_floor : (N,) squared residual that no point can mend, of the rows not divided by depth: y differs
        from y'.
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
        """Covariances (6, N) where rows are divided by `depth` (N,), metres; for unit row errors."""
        half = 0.5 * depth * depth
        lateral = _ONE - outer(self.axis)
        return half * lateral[:, None] + (half * self.along) * outer(self.ray)


def stereo_points(camera: StereoCamera, left: Array, right: Array) -> StereoPoints:
    """Linear triangulation, equation (2) with one pair, of left and right pixels (N, 2).

    Rows may differ: y is then met half way. Equal rows give `StereoCamera.triangulate`'s points.
    """
    (x, y), (x_r, y_r) = camera.normalise(left).T, camera.normalise(right).T
    d2 = np.maximum((x - x_r) ** 2 + (y - y_r) ** 2, FAINTEST)
    ray = np.stack([0.5 * (x + x_r), 0.5 * (y + y_r), np.ones_like(x)])
    X = ray * (camera.baseline * (x - x_r) / d2)
    X[0] += 0.5 * camera.baseline
    residual_floor = 0.5 * camera.baseline**2 * (y - y_r) ** 2 / d2
    return StereoPoints(X, ray, np.array([0.0, 0.0, 1.0]), 4.0 / d2, residual_floor)
