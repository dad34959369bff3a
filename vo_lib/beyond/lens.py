"""Chapter 3, beyond the paper: what the undistortion left of the lenses, learnt from the flow.

A lens whose elements are not quite in line moves points by Brown's decentering terms, with r² = x² + y²,

    (2 p1 x y + p2 (r² + 2 x²),  p1 (r² + 2 y²) + 2 p2 x y),

and that bends epipolar lines. On sequences 00 and 01 of KITTI, of one recording day, both are about a pixel
(in units of the focal length); taking them out lowers RE over 100 m of 00 from 1.60 to 1.08 deg. Other errors
are left alone. A shift of the principal point fits worse, and does harm where it is learnt from a decentered
lens. A radial term is found by this method on drawn scenes too, which have none: driving straight, it looks
like depth. The numbers are in `notebooks/appendix_calibration.ipynb`.

Each frame gives normal equations for p1 and p2, the motion eliminated; they are summed up. With them goes a
flow that is too long along u and too short along v, by (2x, y) times the same in all frames: matching leaves
some hundredths of a pixel of it.

Noisy terms do harm where a lens is good. So each is shrunk as empirical Bayes asks: the part of its square
that its own variance explains is taken for noise (James and Stein 1961, positive part).
"""

from __future__ import annotations

import dataclasses

import numpy as np

from ..core.camera import StereoCamera
from ..core.geometry import NORMAL, essential_from_motion
from ..core.matches import StereoMatches
from ..core.sampson import match_terms
from ..core.types import Array
from .config import CalibrationConfig
from .refinement import distances_and_derivatives

FINEST = 0.05  # pixels; no match is taken to be known better


class Lens:
    """The decentering of both cameras, taken to be alike, from frame to frame.

    Attributes
    ----------
    decentering : (2,) p1 and p2 in use, normalised units; `pixels` gives them times f.
    information : (3, 3) inverse covariance of both, before they are shrunk, and of the stretch of the flow.
    vector : (3,) the information times these.
    """

    def __init__(self, camera: StereoCamera, config: CalibrationConfig):
        self.camera = camera
        self.config = config
        prior = np.array([config.lens_deviation, config.lens_deviation, config.flow_stretch]) / camera.f
        self.know(np.diag(prior**-2), np.zeros(3))

    @property
    def pixels(self) -> Array:
        """p1 and p2 times the focal length, (2,)."""
        return self.camera.f * self.decentering

    def correct(self, matches: StereoMatches) -> StereoMatches:
        """Matches as a lens without decentering would show them."""
        if not self.decentering.any():
            return matches

        def moved(uv: Array) -> Array:
            shapes = decentering_shapes(self.camera.normalise(uv))
            return uv + np.tensordot(self.pixels, shapes, 1).T

        return dataclasses.replace(
            matches,
            prev_left=moved(matches.prev_left),
            prev_right=moved(matches.prev_right),
            cur_left=moved(matches.cur_left),
            cur_right=moved(matches.cur_right),
        )

    def update(self, x_p: Array, x_c: Array, R_cp: Array, direction: Array) -> None:
        """Learn from a frame's corrected points, (N, 2) each, normalised, and its motion.

        One Gauss-Newton step on the Sampson distances over rotation, direction, p1, p2 and stretch.
        """
        r, by_motion = distances_and_derivatives(R_cp, direction, match_terms(x_p, x_c))
        by_p, by_c = by_points(essential_from_motion(R_cp, direction), x_p, x_c, r)
        by_lens = np.sum(by_p * decentering_shapes(x_p) + by_c * decentering_shapes(x_c), axis=1)
        by_stretch = by_c[0] * 2.0 * x_c[:, 0] + by_c[1] * x_c[:, 1]
        jac = np.concatenate([by_motion, by_lens, by_stretch[None]])
        deviation = max(NORMAL * float(np.median(np.abs(r))), FINEST / self.camera.f)
        # Squared Cauchy weights: what moves and what is wrong must not count.
        weighted = jac / (1.0 + (r / (self.config.lens_scale * deviation)) ** 2) ** 2
        H, g = weighted @ jac.T, -weighted @ r
        H[np.diag_indices(5)] += 1e-12 * max(float(np.trace(H[:5, :5])), 1e-12)
        motion = np.linalg.solve(H[:5, :5], np.column_stack([H[:5, 5:], g[:5]]))
        variance = (self.config.lens_noise_inflation * deviation) ** 2
        information = (H[5:, 5:] - H[5:, :5] @ motion[:, :3]) / variance
        # The points were corrected already, but for the stretch.
        known = np.append(self.decentering, 0.0)
        vector = (g[5:] - H[5:, :5] @ motion[:, 3]) / variance + information @ known
        self.know(self.information + information, self.vector + vector)

    def know(self, information: Array, vector: Array) -> None:
        """From now on this is known: an information (3, 3), and it times the estimate (3,)."""
        self.information, self.vector = information, vector
        floor, prior = (px / self.camera.f for px in (self.config.lens_floor, self.config.lens_deviation))
        self.decentering = shrunk(information, vector, floor, prior)


def decentering_shapes(points: Array) -> Array:
    """How p1 and p2, each of size 1, move normalised points (N, 2): (2, 2, N), term, then x and y."""
    x, y = points.T
    r2, xy = x * x + y * y, 2.0 * x * y
    return np.array([[xy, r2 + 2.0 * y * y], [r2 + 2.0 * x * x, xy]])


def by_points(E: Array, x_p: Array, x_c: Array, r: Array) -> tuple[Array, Array]:
    """Derivatives (2, N) of Sampson distances r (N,) by the previous and by the current points.

    E : (3, 3); x_p, x_c : (N, 2) normalised points.
    """
    line_c, line_p = E[:2, :2] @ x_p.T + E[:2, 2:], E[:2, :2].T @ x_c.T + E[2, :2, None]
    norm2 = np.maximum(np.sum(line_c**2 + line_p**2, axis=0), 1e-20)
    norm, r_by_norm = np.sqrt(norm2), r / norm2
    by_p = line_p / norm - r_by_norm * (E[:2, :2].T @ line_c)
    by_c = line_c / norm - r_by_norm * (E[:2, :2] @ line_p)
    return np.asarray(by_p), np.asarray(by_c)


def shrunk(information: Array, vector: Array, floor: float, prior: float) -> Array:
    """Means (2,) of the first two of a normal distribution, each c of variance v times max(0, 1 - v / c²).

    information : (3, 3) inverse covariance; vector : (3,) it times the means.
    floor : standard deviation of an error that is not in the information; its square adds to v.
    prior : standard deviation before the first frame, in the information. What the frames know less of than
        that is 0: crawling in a jam says little, but always the same.
    """
    covariance = np.linalg.inv(information)
    mean, variance = (covariance @ vector)[:2], np.diag(covariance)[:2]
    share = 1.0 - (variance + floor**2) / np.maximum(mean**2, 1e-30)
    return np.asarray(mean * np.where(variance <= 0.5 * prior**2, np.maximum(0.0, share), 0.0))
