"""Chapters 3 and 4, beyond the paper: what calib.txt leaves of a rig's errors, learnt from the images.

In a rectified pair both images of a point lie on one row, and the columns differ by f b / Z. In a real pair
both are off by a smooth field over the image, of some tenths of a pixel: far points seem too far, or near,
and steps come out too long, on the KITTI highway by 5 %. The field is a polynomial for the disparities and
one for the rows, in the normalised position x, y. They belong together, for each fault of a rig has a shape
in both (`RIG_FAULTS`). Too few terms are worse than none: the rest of the field ends up in the constant,
which decides the length of the steps. Half of the field is attributed to the left camera at x_l, half to the
right one at x_r = x_l - D / f, where D is a point's disparity: flow on KITTI fits that better than all of it
in the right camera.

Both lenses have errors of their own, taken to be alike: Brown's decentering and radial terms, r² = x² + y²,

    (2 p1 x y + p2 (r² + 2 x²),  p1 (r² + 2 y²) + 2 p2 x y)   and   (k1 r² + k2 r⁴) (x, y).

Stereo matches show the rows at once, and with them roll and focal length, which a moving camera cannot tell
from a longer step; near and far points on one row show the lens. The motion tells the disparities and, again,
the lens: disparities must agree with parallax, and flow with epipolar lines. One frame knows little of that;
a Kalman filter carries everything along.

Noise would do harm where a rig is good. So what is in use is shrunk as empirical Bayes asks: the part of a
square that its own variance explains is taken for noise (James and Stein 1961, positive part).
"""

from __future__ import annotations

import dataclasses

import numpy as np

from ..geometry.camera import StereoCamera
from ..geometry.matches import StereoMatches
from ..geometry.motion import DEVIATION_OVER_MEDIAN
from ..geometry.types import Array
from .parallax import MIN_NOISE_PX, parallax_information
from .settings import CalibrationConfig

Shape = dict[str, float]

DISPARITY_TERMS = ("1", "x", "y", "x²", "xy", "y²", "x³", "x²y", "x⁴")
ROW_TERMS = DISPARITY_TERMS[:6]
# How large each may be, standard deviations, pixels (KITTI's rigs have a k1 of 12 to 17), and what of it no
# number of frames mends: drawn cars give a perfect lens up to 2.6 px of k1, a drawn highway 0.8 px of p2.
LENS_PX = {"p1": (1.5, 0.7), "p2": (1.5, 1.2), "k1": (15.0, 2.0), "k2": (10.0, 4.0)}
N, FIELD = len(DISPARITY_TERMS), len(DISPARITY_TERMS) + len(ROW_TERMS)
ERROR_NAMES = (
    *(f"disparity {term}" for term in DISPARITY_TERMS),
    *(f"row {term}" for term in ROW_TERMS),
    *LENS_PX,
)
ERROR_COUNT = len(ERROR_NAMES)
P1, P2, K1, K2 = range(FIELD, ERROR_COUNT)
BY_PARALLAX = [*range(N), *range(FIELD, ERROR_COUNT)]  # what the motion tells; rows tell all but the first N
# What may be wrong with one camera against the other: its shape in the columns, in the rows, and how large it
# may be, pixels (standard deviation before the first frame). To first order a yaw is a shift along the rows
# and a tilt about the vertical; decentering is a tilt of three times its size and what is left here.
RIG_FAULTS: dict[str, tuple[Shape, Shape, float]] = {
    "shift along the rows": ({"1": 1}, {}, 1.5),
    "shift across the rows": ({}, {"1": 1}, 3.0),
    "roll": ({"y": 1}, {"x": -1}, 1.0),
    "focal length": ({"x": 1}, {"y": 1}, 1.0),
    "tilt about the vertical": ({"x²": 1}, {"xy": 1}, 5.0),
    "tilt about the horizontal": ({"xy": 1}, {"y²": 1}, 1.0),
    "decentering along the rows": ({"y²": 1}, {"xy": -1}, 5.0),
    "decentering across the rows": ({"xy": -1}, {"x²": 1}, 1.0),
}
# What an undistortion by other polynomials leaves has no shape of its own.
UNDISTORTION_PX = {"x²": 1.0, "xy": 0.2, "y²": 1.5, "x³": 0.5, "x²y": 1.0, "x⁴": 4.0}
RIG_FAULTS |= {f"columns, {term}": ({term: 1}, {}, deviation) for term, deviation in UNDISTORTION_PX.items()}
RIG_FAULTS |= {f"rows, {term}": ({}, {term: 1}, 0.5) for term in ("x²", "xy", "y²")}
FREE_DEVIATION_PX = 0.01  # pixels; what no fault explains, in each coefficient of the field

ROW_REWEIGHTINGS = 4  # re-weightings of the rows


class Rig:
    """The errors of a stereo camera, from frame to frame: what is measured less what is true.

    Attributes
    ----------
    estimate : (19,) errors in the order of `ERROR_NAMES`, pixels; rows and disparities are
        left less right.
    covariance : (19, 19) of the estimate.
    errors : (19,) those in use. Of the lens one after the other is shrunk, and is zero while the frames know
        less of it than was known before them: crawling in a jam says little, but always the same. What comes
        after it is what would be known were it the true one. At the end the field is shrunk as a whole.
    """

    def __init__(self, camera: StereoCamera, config: CalibrationConfig):
        self.camera = camera
        self.config = config
        self._prior = prior_covariance()
        self.know(np.zeros(ERROR_COUNT), self._prior)

    def correct(self, matches: StereoMatches, errors: Array | None = None) -> StereoMatches:
        """Matches without these errors (19,), by default those in use."""
        errors = self.errors if errors is None else errors
        if not errors.any():
            return matches
        views = (matches.prev_left, matches.cur_left), (matches.prev_right, matches.cur_right)
        left, right = self._without(errors, *(np.concatenate(each) for each in views))
        prev, cur = slice(len(matches)), slice(len(matches), None)
        return dataclasses.replace(
            matches, prev_left=left[prev], prev_right=right[prev], cur_left=left[cur], cur_right=right[cur]
        )

    def _without(self, errors: Array, left: Array, right: Array) -> tuple[Array, Array]:
        true = left, right
        for _ in range(2):  # the errors are those of the true places
            added = effects(self.camera, self.camera.normalise(true[0]).T, (true[0] - true[1])[:, 0])
            u, v, disparity, row = np.tensordot(errors, added, 1)
            true = left - np.stack([u, v], axis=1), right - np.stack([u - disparity, v - row], axis=1)
        return true

    def learn_rows(self, matches: StereoMatches) -> None:
        """Learn from the rows of a frame's stereo matches, as they were measured; Cauchy weights."""
        if len(matches) == 0:
            return
        left, right = self._without(self.errors, matches.cur_left, matches.cur_right)
        A = effects(self.camera, self.camera.normalise(left).T, (left - right)[:, 0])[:, 3]
        difference = (matches.cur_left - matches.cur_right)[:, 1]
        prior_information = np.linalg.inv(self.covariance + self.config.drift**2 * self._prior)
        start, estimate = prior_information @ self.estimate, self.estimate
        for _ in range(ROW_REWEIGHTINGS):
            residual = difference - estimate @ A
            noise = max(DEVIATION_OVER_MEDIAN**2 * float(np.median(residual**2)), MIN_NOISE_PX**2)
            weighted = A / (1.0 + (residual / self.config.row_scale) ** 2)
            weighted /= noise * self.config.noise_inflation**2
            information = prior_information + weighted @ A.T
            estimate = np.asarray(np.linalg.solve(information, start + weighted @ difference))
        self.know(estimate, np.asarray(np.linalg.inv(information)))

    def update(self, matches: StereoMatches, R_cp: Array, t_cp: Array) -> None:
        """Learn from a frame's corrected matches and motion."""

        def added(x: Array, disparity: Array) -> Array:
            return effects(self.camera, x, disparity)[BY_PARALLAX, :3]

        evidence = parallax_information(self.camera, matches, R_cp, t_cp, added, self.config.scale)
        if evidence is None:
            return
        information, vector = np.zeros((ERROR_COUNT, ERROR_COUNT)), np.zeros(ERROR_COUNT)
        information[np.ix_(BY_PARALLAX, BY_PARALLAX)], vector[BY_PARALLAX] = evidence
        information /= self.config.noise_inflation**2
        vector /= self.config.noise_inflation**2
        prior_information = np.linalg.inv(self.covariance)
        # What corrected the matches is what is in use, not the estimate.
        vector -= information @ (self.estimate - self.errors)
        change = np.linalg.solve(prior_information + information, vector)
        self.know(self.estimate + change, np.asarray(np.linalg.inv(prior_information + information)))

    def know(self, estimate: Array, covariance: Array) -> None:
        """From now on this is known: an estimate (19,) and its covariance (19, 19)."""
        self.estimate, self.covariance = estimate, covariance
        errors, covariance, lens = estimate.copy(), covariance.copy(), {}
        for i in (K2, K1, P1, P2):
            (prior, floor), variance = LENS_PX[ERROR_NAMES[i]], covariance[i, i]
            share = max(0.0, 1.0 - (variance + floor**2) / max(errors[i] ** 2, 1e-12))
            lens[i] = errors[i] * share * (variance <= 0.5 * prior**2)
            # What the others would be were this the true one.
            gain = covariance[i] / variance
            errors += gain * (lens[i] - errors[i])
            covariance -= np.outer(gain, covariance[i])
        squared = float(errors[:FIELD] @ np.linalg.solve(covariance[:FIELD, :FIELD], errors[:FIELD]))
        errors[:FIELD] *= max(0.0, 1.0 - FIELD / max(squared, 1e-12))
        errors[[*lens]] = [*lens.values()]
        self.errors = errors


def effects(camera: StereoCamera, x: Array, disparity: Array) -> Array:
    """What errors of size 1 add to u and v on the left, to disparity and row, (19, 4, N), pixels.

    x : (2, N) normalised left positions; disparity : (N,) pixels.
    """
    right = np.array([x[0] - disparity / camera.f, x[1]])
    added, on_left, on_right = np.zeros((ERROR_COUNT, 4, len(disparity))), powers(*x), powers(*right)
    for terms, n, axis in ((slice(N), N, 0), (slice(N, FIELD), len(ROW_TERMS), 1)):
        added[terms, axis] = 0.5 * on_left[:n]
        added[terms, axis + 2] = 0.5 * (on_left + on_right)[:n]
    added[FIELD:, :2] = lens_shapes(x)
    added[FIELD:, 2:] = added[FIELD:, :2] - lens_shapes(right)
    return added


def field_at(errors: Array, x: Array, y: Array) -> Array:
    """The field's errors (2, N) of disparity and row, pixels, at normalised left positions x, y (N,)."""
    terms = powers(x, y)
    return np.stack([errors[:N] @ terms, errors[N:FIELD] @ terms[: len(ROW_TERMS)]])


def powers(x: Array, y: Array) -> Array:
    """`DISPARITY_TERMS` at normalised positions x, y (N,), (9, N); the first six are `ROW_TERMS`."""
    x2 = x * x
    return np.array([np.ones_like(x), x, y, x2, x * y, y * y, x2 * x, x2 * y, x2 * x2])


def lens_shapes(points: Array) -> Array:
    """How the terms of `LENS_PX`, each of size 1, move normalised points (2, N): (4, 2, N)."""
    x, y = points
    r2, xy = x * x + y * y, 2.0 * x * y
    radial = r2 * points
    return np.array([(xy, r2 + 2.0 * y * y), (r2 + 2.0 * x * x, xy), radial, r2 * radial])


def prior_covariance() -> Array:
    """Covariance (19, 19) of the errors before the first frame: all `RIG_FAULTS`, each of random size."""
    covariance = np.diag([FREE_DEVIATION_PX] * FIELD + [prior for prior, _ in LENS_PX.values()]) ** 2
    for columns, rows, deviation in RIG_FAULTS.values():
        shape = np.array(
            [columns.get(k, 0.0) for k in DISPARITY_TERMS] + [rows.get(k, 0.0) for k in ROW_TERMS]
        )
        covariance[:FIELD, :FIELD] += deviation**2 * np.outer(shape, shape)
    return covariance
