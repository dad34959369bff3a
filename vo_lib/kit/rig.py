"""Estimation of calibration errors that remain in calib.txt (chapters 3 and 4, not in the paper).

In a rectified pair both images of a point are in one row, and the columns differ by f b / Z. In a real pair,
rows and disparities are wrong by some tenths of a pixel, and so are depths and steps: on the KITTI highway
by 5 %. These errors form a smooth field, which is modelled by one polynomial for the disparities and one for
the rows, in the normalised position x, y. Their coefficients are correlated, since a fault of the rig changes
both (`RIG_FAULTS`). Too few terms are worse than none: the constant, which determines the length of the
steps, then absorbs the rest of the field. Half of the field is attributed to the left camera at x_l, half to
the right camera at x_r = x_l - D / f, where D is a point's disparity, because this fits the flow on KITTI
better than the whole field in the right camera.

The two lenses have equal errors: Brown's decentering and radial terms with r² = x² + y²,

    (2 p1 x y + p2 (r² + 2 x²),  p1 (r² + 2 y²) + 2 p2 x y)   and   (k1 r² + k2 r⁴) (x, y).

Stereo matches measure the row errors directly. These contain roll and focal length, which a moving camera
cannot tell from a longer step. Near and far points on one row measure the lens errors. The motion measures
them again, and the disparity errors as well: the disparities must agree with the parallax, and the optical
flow with the epipolar lines. A single frame contributes little, so a Kalman filter combines all of them. For
a good rig, a correction by noisy estimates would only add errors. It therefore uses shrunk values (empirical
Bayes, James and Stein 1961, positive part): the part of a squared estimate that is due to its variance counts
as noise.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

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
# Prior standard deviation of each lens error, pixels (KITTI's rigs have a k1 of 12 to 17), and a noise floor
# that more frames do not reduce: on drawn scenes with perfect lenses, cars cause up to 2.6 px of k1, and a
# highway causes 0.8 px of p2.
LENS_PX = {"p1": (1.5, 0.7), "p2": (1.5, 1.2), "k1": (15.0, 2.0), "k2": (10.0, 4.0)}
# The errors are, in this order: of disparities, of rows (together the field), and of the lenses.
DISPARITIES = len(DISPARITY_TERMS)
FIELD = DISPARITIES + len(ROW_TERMS)
ERROR_NAMES = (
    *(f"disparity {term}" for term in DISPARITY_TERMS),
    *(f"row {term}" for term in ROW_TERMS),
    *LENS_PX,
)
ERROR_COUNT = len(ERROR_NAMES)
P1, P2, K1, K2 = range(FIELD, ERROR_COUNT)
# Indices of the errors that the motion measures; the rows measure the errors from `DISPARITIES` on.
BY_PARALLAX = [*range(DISPARITIES), *range(FIELD, ERROR_COUNT)]
# Faults of one camera relative to the other: shape in the columns, shape in the rows, prior standard
# deviation in pixels. To first order, a yaw is a shift along the rows and a tilt about the vertical. Brown's
# decentering is three times a tilt plus one of the last two faults.
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
# Errors of the undistortion of the images have no particular shape; standard deviations in pixels.
UNDISTORTION_PX = {"x²": 1.0, "xy": 0.2, "y²": 1.5, "x³": 0.5, "x²y": 1.0, "x⁴": 4.0}
RIG_FAULTS |= {f"columns, {term}": ({term: 1}, {}, deviation) for term, deviation in UNDISTORTION_PX.items()}
RIG_FAULTS |= {f"rows, {term}": ({}, {term: 1}, 0.5) for term in ("x²", "xy", "y²")}
# Groups of errors that `CalibrationConfig.without` holds at zero: beginnings of the names of faults that are
# left out, and of the names of errors whose prior standard deviation is multiplied by a small share.
FAULTS_OF_GROUP = {"undistortion": ("columns", "rows"), "focal-length": ("focal length",)}
ERRORS_OF_GROUP = {
    "field": ("disparity", "row"),
    "field-shape": ("disparity x", "disparity y", "row x", "row y"),
    "lens": tuple(LENS_PX),
}
HELD_SHARE = 1e-4
FREE_DEVIATION_PX = 0.01  # prior standard deviation of each coefficient, in addition to the faults

ROW_REWEIGHTINGS = 4  # number of re-weightings in the estimation of the row errors


class Rig:
    """The calibration errors of a stereo camera, measured minus true values, updated frame by frame.

    Attributes
    ----------
    estimate : (19,) errors in the order of `ERROR_NAMES`, pixels; rows and disparities are left minus right.
    covariance : (19, 19) covariance of the estimate.
    errors : (19,) shrunk errors, used in `correct`. Lens errors are shrunk one after the other. A lens error
        is zero until its variance is at most half of the prior variance, since slow driving in a jam gives
        little and one-sided information. All other errors are then conditioned on the shrunk value. Finally,
        the whole field is shrunk.
    """

    def __init__(self, camera: StereoCamera, config: CalibrationConfig):
        self.camera = camera
        self.config = config
        self._prior = prior_covariance(config.without)
        self.set_estimate(np.zeros(ERROR_COUNT), self._prior)

    def correct(self, matches: StereoMatches, errors: Array | None = None) -> StereoMatches:
        """Matches corrected by `errors` (19,), by default `self.errors`."""
        errors = self.errors if errors is None else errors
        if not errors.any():
            return matches
        left = np.concatenate([matches.prev_left, matches.cur_left])
        right = np.concatenate([matches.prev_right, matches.cur_right])
        left, right = self._without(errors, left, right)
        n = len(matches)
        return dataclasses.replace(
            matches, prev_left=left[:n], prev_right=right[:n], cur_left=left[n:], cur_right=right[n:]
        )

    def _without(self, errors: Array, left: Array, right: Array) -> tuple[Array, Array]:
        """Left and right pixels (N, 2) without the `errors` (19,)."""
        true_left = left
        true_right = right
        for _ in range(2):  # the errors depend on the true positions
            disparity = (true_left - true_right)[:, 0]
            added = effects(self.camera, self.camera.normalise(true_left).T, disparity)
            of_u, of_v, of_disparity, of_row = np.tensordot(errors, added, 1)
            true_left = left - np.stack([of_u, of_v], axis=1)
            true_right = right - np.stack([of_u - of_disparity, of_v - of_row], axis=1)
        return true_left, true_right

    def update_from_rows(self, matches: StereoMatches) -> None:
        """Update the errors from the rows of a frame's uncorrected stereo matches, with Cauchy weights."""
        if len(matches) == 0 or "rows" in self.config.without:
            return
        left, right = self._without(self.errors, matches.cur_left, matches.cur_right)
        A = effects(self.camera, self.camera.normalise(left).T, (left - right)[:, 0])[:, 3]
        difference = (matches.cur_left - matches.cur_right)[:, 1]
        prior_information = np.linalg.inv(self.covariance + self.config.drift**2 * self._prior)
        prior_vector = prior_information @ self.estimate
        estimate = self.estimate
        for _ in range(ROW_REWEIGHTINGS):
            residual = difference - estimate @ A
            noise = max(DEVIATION_OVER_MEDIAN**2 * float(np.median(residual**2)), MIN_NOISE_PX**2)
            weighted = A / (1.0 + (residual / self.config.row_scale) ** 2)
            weighted /= noise * self.config.noise_inflation**2
            information = prior_information + weighted @ A.T
            estimate = np.asarray(np.linalg.solve(information, prior_vector + weighted @ difference))
        self.set_estimate(estimate, np.asarray(np.linalg.inv(information)))

    def update(self, matches: StereoMatches, R_cp: Array, t_cp: Array) -> None:
        """Update the errors from a frame's corrected matches and motion."""

        def added(x: Array, disparity: Array) -> Array:
            return effects(self.camera, x, disparity)[BY_PARALLAX, :3]

        evidence = parallax_information(self.camera, matches, R_cp, t_cp, added, self.config.scale)
        if evidence is None:
            return
        measured_information, measured_vector = evidence
        information = np.zeros((ERROR_COUNT, ERROR_COUNT))
        vector = np.zeros(ERROR_COUNT)
        information[np.ix_(BY_PARALLAX, BY_PARALLAX)] = measured_information
        vector[BY_PARALLAX] = measured_vector
        information /= self.config.noise_inflation**2
        vector /= self.config.noise_inflation**2
        prior_information = np.linalg.inv(self.covariance)
        # The matches were corrected by the shrunk errors, not by the estimate.
        vector -= information @ (self.estimate - self.errors)
        information += prior_information
        change = np.linalg.solve(information, vector)
        self.set_estimate(self.estimate + change, np.asarray(np.linalg.inv(information)))

    def set_estimate(self, estimate: Array, covariance: Array) -> None:
        """Set the estimate (19,) and its covariance (19, 19), and compute the shrunk errors."""
        self.estimate = estimate
        self.covariance = covariance
        self.errors = estimate.copy() if "shrinking" in self.config.without else shrunk(estimate, covariance)


def shrunk(estimate: Array, covariance: Array) -> Array:
    """The errors (19,) for the correction, from the estimate (19,) and its covariance; see `Rig.errors`."""
    errors = estimate.copy()
    covariance = covariance.copy()
    lens = {}
    for i in (K2, K1, P1, P2):
        prior, floor = LENS_PX[ERROR_NAMES[i]]
        variance = covariance[i, i]
        if variance <= 0.5 * prior**2:
            share = max(0.0, 1.0 - (variance + floor**2) / max(errors[i] ** 2, 1e-12))
        else:
            share = 0.0
        lens[i] = errors[i] * share
        # The other errors, conditioned on this lens error.
        gain = covariance[i] / variance
        errors += gain * (lens[i] - errors[i])
        covariance -= np.outer(gain, covariance[i])
    squared = float(errors[:FIELD] @ np.linalg.solve(covariance[:FIELD, :FIELD], errors[:FIELD]))
    errors[:FIELD] *= max(0.0, 1.0 - FIELD / max(squared, 1e-12))
    errors[[*lens]] = [*lens.values()]
    return errors


def effects(camera: StereoCamera, x: Array, disparity: Array) -> Array:
    """Changes (19, 4, N), pixels, of left u, left v, disparity and row difference, due to 1 px of each error.

    x : (2, N) normalised left positions; disparity : (N,) pixels.
    """
    right = np.array([x[0] - disparity / camera.f, x[1]])
    on_left = powers(*x)
    both = on_left + powers(*right)
    rows = len(ROW_TERMS)
    added = np.zeros((ERROR_COUNT, 4, len(disparity)))
    # Half of the field is attributed to each camera, at the point's position in its image.
    added[:DISPARITIES, 0] = 0.5 * on_left
    added[:DISPARITIES, 2] = 0.5 * both
    added[DISPARITIES:FIELD, 1] = 0.5 * on_left[:rows]
    added[DISPARITIES:FIELD, 3] = 0.5 * both[:rows]
    added[FIELD:, :2] = lens_shapes(x)
    added[FIELD:, 2:] = added[FIELD:, :2] - lens_shapes(right)
    return added


def field_at(errors: Array, x: Array, y: Array) -> Array:
    """Errors (2, N) of disparity and row difference, pixels, at normalised left positions x, y (N,)."""
    terms = powers(x, y)
    of_disparity = errors[:DISPARITIES] @ terms
    of_row = errors[DISPARITIES:FIELD] @ terms[: len(ROW_TERMS)]
    return np.stack([of_disparity, of_row])


def powers(x: Array, y: Array) -> Array:
    """Values (9, N) of `DISPARITY_TERMS` at normalised x, y (N,); the first six are the `ROW_TERMS`."""
    x2 = x * x
    return np.array([np.ones_like(x), x, y, x2, x * y, y * y, x2 * x, x2 * y, x2 * x2])


def lens_shapes(points: Array) -> Array:
    """Displacements (4, 2, N) of normalised points (2, N), for each term of `LENS_PX` with size 1."""
    x, y = points
    r2 = x * x + y * y
    xy = 2.0 * x * y
    radial = r2 * points
    return np.array([(xy, r2 + 2.0 * y * y), (r2 + 2.0 * x * x, xy), radial, r2 * radial])


def prior_covariance(without: Sequence[str] = ()) -> Array:
    """Covariance (19, 19) of the errors before the first frame, from `RIG_FAULTS` and `LENS_PX`.

    without : groups of errors that are held at zero; see `CalibrationConfig.without`.
    """
    left_out = tuple(start for group in without for start in FAULTS_OF_GROUP.get(group, ()))
    faults = [fault for name, fault in RIG_FAULTS.items() if not name.startswith(left_out)]
    field = np.full(FIELD, FREE_DEVIATION_PX)
    lens = np.array([deviation for deviation, _ in LENS_PX.values()])
    covariance = np.diag(np.concatenate([field, lens])) ** 2
    for columns, rows, deviation in faults:
        shape = np.array(
            [columns.get(k, 0.0) for k in DISPARITY_TERMS] + [rows.get(k, 0.0) for k in ROW_TERMS]
        )
        covariance[:FIELD, :FIELD] += deviation**2 * np.outer(shape, shape)
    held = tuple(start for group in without for start in ERRORS_OF_GROUP.get(group, ()))
    share = np.array([HELD_SHARE if name.startswith(held) else 1.0 for name in ERROR_NAMES])
    return np.asarray(covariance * np.outer(share, share))
