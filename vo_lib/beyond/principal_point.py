"""Chapter 3, beyond the paper: where the principal point of the left camera is.

A calibration knows the principal point to some pixels only, for a shifted one looks much like a turned camera
with a decentered lens. Turns betray it: it bends their epipolar lines. On sequences 00 and 01 of KITTI it is
found 3 to 7 px to the left of its place in calib.txt and 1 to 4 px below. Without that RE over 100 m of 00 is
1.56 deg, with it 1.01. (Cvišić, Marković and Petrović, "Recalibrating the KITTI dataset camera setup for
improved odometry accuracy", ECMR 2021, found a better calibration from the images of the chessboards.)

Two numbers are a model, not the whole truth. What calib.txt misses on KITTI looks even more like Brown's
decentering terms, which fit straight roads too; they give the same rotations, but on both clips a larger TE,
and curves a degree less than the truth's path has. The converse: where a lens is decentered and nothing else,
as in a drawn scene with p1 and p2 of 1.5 px, a shift is found that is not there, and TE doubles.

Each frame gives normal equations for the shift, the motion eliminated; they are summed up. With it goes a
third unknown, a flow that is too long along u and too short along v, by (2x, y) times the same in all frames.
Matching leaves some hundredths of a pixel of it. In a gentle curve that looks like a shift of many pixels,
for a yaw ω turns a shift δ into ω δ (2x, y); but it is there on straight roads as well.

A noisy shift does harm where the calibration is good. So each coordinate is shrunk as empirical Bayes asks:
the part of its square that its own variance explains is taken for noise (James and Stein 1961, positive
part). On drawn scenes, with nothing to find, parts of 5 to 80 frames are off by 0.8 times the noise and 1 px
besides, which more frames do not mend; the settings allow for twice that.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from ..core.camera import StereoCamera
from ..core.geometry import NORMAL, essential_from_motion
from ..core.sampson import match_terms
from ..core.types import Array
from .config import CalibrationConfig
from .refinement import distances_and_derivatives

FINEST = 0.05  # pixels; no match is taken to be known better
FARTHEST = 3.0  # standard deviations of the prior; farther off is no calibration: things that move


class PrincipalPoint:
    """The shift of all normalised points that makes turns agree, from frame to frame.

    Attributes
    ----------
    shift : (2,) added to normalised points of the nominal camera.
    information : (3, 3) inverse covariance of the shift, before it is shrunk, and of the stretch of the flow.
    vector : (3,) the information times these.
    """

    def __init__(self, nominal: StereoCamera, config: CalibrationConfig):
        self.nominal = nominal
        self.config = config
        prior = np.array([config.centre_deviation, config.centre_deviation, config.flow_stretch])
        self._learn(np.diag((nominal.f / prior) ** 2), np.zeros(3))

    @property
    def camera(self) -> StereoCamera:
        """The stereo camera as known now."""
        du, dv = self.pixels
        return dataclasses.replace(self.nominal, cx=self.nominal.cx + du, cy=self.nominal.cy + dv)

    @property
    def pixels(self) -> tuple[float, float]:
        """The principal point from its nominal place, along u and v."""
        du, dv = (-self.nominal.f * self.shift).tolist()
        return du, dv

    def update(self, x_p: Array, x_c: Array, R_cp: Array, direction: Array) -> None:
        """Learn from a frame's points, (N, 2) each, normalised by `camera`, and its motion.

        One Gauss-Newton step on the Sampson distances over rotation, direction, shift and stretch.
        """
        r, by_motion = distances_and_derivatives(R_cp, direction, match_terms(x_p, x_c))
        by_p, by_c = by_points(essential_from_motion(R_cp, direction), x_p, x_c, r)
        by_stretch = by_c[0] * 2.0 * x_c[:, 0] + by_c[1] * x_c[:, 1]
        jac = np.concatenate([by_motion, by_p + by_c, by_stretch[None]])
        deviation = max(NORMAL * float(np.median(np.abs(r))), FINEST / self.nominal.f)
        # Squared Cauchy weights: what moves and what is wrong must not count.
        weighted = jac / (1.0 + (r / (self.config.centre_scale * deviation)) ** 2) ** 2
        H, g = weighted @ jac.T, -weighted @ r
        H[np.diag_indices(5)] += 1e-12 * max(float(np.trace(H[:5, :5])), 1e-12)
        motion = np.linalg.solve(H[:5, :5], np.column_stack([H[:5, 5:], g[:5]]))
        variance = (self.config.centre_noise_inflation * deviation) ** 2
        information = (H[5:, 5:] - H[5:, :5] @ motion[:, :3]) / variance
        # The points were shifted already, but not stretched.
        known = np.append(self.shift, 0.0)
        vector = (g[5:] - H[5:, :5] @ motion[:, 3]) / variance + information @ known
        self._learn(self.information + information, self.vector + vector)

    def _learn(self, information: Array, vector: Array) -> None:
        self.information, self.vector = information, vector
        floor, prior = (
            px / self.nominal.f for px in (self.config.centre_floor, self.config.centre_deviation)
        )
        self.shift = shrunk(information, vector, floor, prior)


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
    prior : standard deviation before the first frame, in the information. A coordinate of which the frames
        know less than that is 0: crawling in a jam says little, but always the same. Both are 0 when one is
        farther off than any calibration.
    """
    covariance = np.linalg.inv(information)
    mean, variance = (covariance @ vector)[:2], np.diag(covariance)[:2]
    if np.abs(mean).max() > FARTHEST * prior:
        return np.zeros(2)
    share = 1.0 - (variance + floor**2) / np.maximum(mean**2, 1e-30)
    return np.asarray(mean * np.where(variance <= 0.5 * prior**2, np.maximum(0.0, share), 0.0))
