"""Estimation of calibration errors that remain in calib.txt (appendix, not in the paper).

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

All errors together are a vector (19,), in the order of `ERROR_NAMES`: 9 of the disparities and 6 of the rows,
which are the field, and 4 of the lenses.

Stereo matches measure the row errors directly. Roll and focal length show in the rows; from the motion
alone, they would look like a longer step. The lens errors show there, too: the nearer a point, the farther
apart are its places in the two images, and the more the lens errors at these places differ. The motion
measures the lens errors again, and the disparity errors: the disparities must agree with the parallax, and
the optical flow with the epipolar lines. A single frame contributes little, so a Kalman filter combines all
of them. For a good rig, a correction by noisy estimates would only add errors. It therefore uses shrunk
values (empirical Bayes, James and Stein 1961, positive part): the part of a squared estimate that is due to
its variance counts as noise.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..geometry.camera import StereoCamera
from ..geometry.matches import StereoMatches
from ..geometry.motion import DEVIATION_OVER_MEDIAN
from ..geometry.types import Array
from .parallax import MIN_NOISE_PX, parallax_information
from .settings import CalibrationConfig

# A polynomial in x and y: the coefficient of each term.
Polynomial = dict[str, float]


class LensPrior(NamedTuple):
    """Prior standard deviation of a lens error, and the noise that more frames do not reduce, pixels."""

    deviation_px: float
    floor_px: float


class RigFault(NamedTuple):
    """A fault of one camera relative to the other.

    Attributes
    ----------
    columns, rows : the field of a fault of size 1: errors of disparity and row difference.
    deviation_px : prior standard deviation of the fault's size, pixels.
    """

    columns: Polynomial
    rows: Polynomial
    deviation_px: float


DISPARITY_TERMS = ("1", "x", "y", "x²", "xy", "y²", "x³", "x²y", "x⁴")
ROW_TERMS = DISPARITY_TERMS[:6]
# The k1 of KITTI's rigs is estimated as 14 to 17 px together with k2, as here, and as 8 to 14 px without k2.
# The floors: on drawn scenes with perfect lenses, cars cause up to 2.6 px of k1, and a highway causes 0.8 px
# of p2.
LENS_PX = {
    "p1": LensPrior(1.5, 0.7),
    "p2": LensPrior(1.5, 1.2),
    "k1": LensPrior(15.0, 2.0),
    "k2": LensPrior(10.0, 4.0),
}
DISPARITY_NAMES = tuple(f"disparity {term}" for term in DISPARITY_TERMS)
ROW_NAMES = tuple(f"row {term}" for term in ROW_TERMS)
ERROR_NAMES = (*DISPARITY_NAMES, *ROW_NAMES, *LENS_PX)
# The errors [:DISPARITY_COUNT] are those of disparities, [:FIELD_COUNT] those of the field, disparities and
# rows, and [FIELD_COUNT:] those of the lenses.
DISPARITY_COUNT = len(DISPARITY_NAMES)
FIELD_COUNT = DISPARITY_COUNT + len(ROW_NAMES)
ERROR_COUNT = len(ERROR_NAMES)
# Index of each lens error.
P1 = ERROR_NAMES.index("p1")
P2 = ERROR_NAMES.index("p2")
K1 = ERROR_NAMES.index("k1")
K2 = ERROR_NAMES.index("k2")
# Indices of the errors that the motion measures; the rows measure the errors from `DISPARITY_COUNT` on.
BY_PARALLAX = [*range(DISPARITY_COUNT), *range(FIELD_COUNT, ERROR_COUNT)]
# To first order, a yaw is a shift along the rows and a tilt about the vertical. Brown's decentering is three
# times a tilt plus one of the two faults with the name decentering.
RIG_FAULTS = {
    "shift along the rows": RigFault({"1": 1}, {}, 1.5),
    "shift across the rows": RigFault({}, {"1": 1}, 3.0),
    "roll": RigFault({"y": 1}, {"x": -1}, 1.0),
    "focal length": RigFault({"x": 1}, {"y": 1}, 1.0),
    "tilt about the vertical": RigFault({"x²": 1}, {"xy": 1}, 5.0),
    "tilt about the horizontal": RigFault({"xy": 1}, {"y²": 1}, 1.0),
    "decentering along the rows": RigFault({"y²": 1}, {"xy": -1}, 5.0),
    "decentering across the rows": RigFault({"xy": -1}, {"x²": 1}, 1.0),
}
# Errors of the undistortion of the images have no particular shape: each term is a fault of its own, here
# with its standard deviation in pixels.
COLUMN_UNDISTORTION_PX = {"x²": 1.0, "xy": 0.2, "y²": 1.5, "x³": 0.5, "x²y": 1.0, "x⁴": 4.0}
ROW_UNDISTORTION_PX = {"x²": 0.5, "xy": 0.5, "y²": 0.5}
RIG_FAULTS |= {f"columns, {term}": RigFault({term: 1}, {}, px) for term, px in COLUMN_UNDISTORTION_PX.items()}
RIG_FAULTS |= {f"rows, {term}": RigFault({}, {term: 1}, px) for term, px in ROW_UNDISTORTION_PX.items()}
FREE_DEVIATION_PX = 0.01  # prior standard deviation of each coefficient, in addition to the faults
# Groups of errors that `CalibrationConfig.without` holds at zero. Of these groups, the faults whose names
# begin with one of the words are left out of the prior.
FAULTS_OF_GROUP = {"undistortion": ("columns", "rows"), "focal-length": ("focal length",)}
# Of these groups, the errors whose names begin with one of the words have their prior standard deviations
# multiplied by `HELD_SHARE`.
ERRORS_OF_GROUP = {
    "field": ("disparity", "row"),
    "field-shape": ("disparity x", "disparity y", "row x", "row y"),
    "lens": tuple(LENS_PX),
}
HELD_SHARE = 1e-4

ROW_REWEIGHTINGS = 4  # number of re-weightings in the estimation of the row errors
KNOWN_VARIANCE_SHARE = 0.5  # of the prior variance; a lens error with a larger variance is not corrected
MIN_SQUARE = 1e-12  # divisor in place of the square of an estimate that is zero


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
        if errors is None:
            errors = self.errors
        if not errors.any():
            return matches
        n = len(matches)
        left, right = self._true_pixels(
            np.concatenate([matches.prev_left, matches.cur_left]),
            np.concatenate([matches.prev_right, matches.cur_right]),
            errors,
        )
        return dataclasses.replace(
            matches, prev_left=left[:n], prev_right=right[:n], cur_left=left[n:], cur_right=right[n:]
        )

    def _true_pixels(self, left: Array, right: Array, errors: Array) -> tuple[Array, Array]:
        """Left and right pixels (N, 2) that a rig without the `errors` (19,) would measure."""
        true_left = left
        true_right = right
        for _ in range(2):  # the errors depend on the true positions
            disparity = (true_left - true_right)[:, 0]
            changes = effects(self.camera, self.camera.normalise(true_left).T, disparity)
            of_u, of_v, of_disparity, of_row = np.tensordot(errors, changes, 1)
            true_left = left - np.stack([of_u, of_v], axis=1)
            true_right = right - np.stack([of_u - of_disparity, of_v - of_row], axis=1)
        return true_left, true_right

    def update_from_rows(self, matches: StereoMatches) -> None:
        """Update the errors from the row differences of a frame's uncorrected stereo matches.

        A Kalman step in information form: the errors have drifted since the frame before, and each match of
        the current pair measures them with a Cauchy weight.
        """
        if len(matches) == 0 or "rows" in self.config.without:
            return
        # Errors are functions of the true positions; the row differences below are as measured.
        left, right = self._true_pixels(matches.cur_left, matches.cur_right, self.errors)
        # (19, N): the row difference of each match for 1 px of each error.
        row_effects = effects(self.camera, self.camera.normalise(left).T, (left - right)[:, 0])[:, 3]
        row_difference = (matches.cur_left - matches.cur_right)[:, 1]
        drifted_covariance = self.covariance + self.config.drift**2 * self._prior
        prior_information = np.linalg.inv(drifted_covariance)
        prior_vector = prior_information @ self.estimate
        estimate = self.estimate
        for _ in range(ROW_REWEIGHTINGS):
            residual = row_difference - estimate @ row_effects
            variance = max(DEVIATION_OVER_MEDIAN**2 * float(np.median(residual**2)), MIN_NOISE_PX**2)
            weighted = row_effects / (1.0 + (residual / self.config.row_scale) ** 2)
            weighted /= variance * self.config.noise_inflation**2
            information = prior_information + weighted @ row_effects.T
            vector = prior_vector + weighted @ row_difference
            estimate = np.asarray(np.linalg.solve(information, vector))
        self.set_estimate(estimate, np.asarray(np.linalg.inv(information)))

    def update(self, matches: StereoMatches, R_cp: Array, t_cp: Array) -> None:
        """Update the errors from a frame's corrected matches and its motion.

        The drift since the frame before is added in `update_from_rows`, which comes first; without `rows`,
        there is none.

        R_cp, t_cp : (3, 3), and (3,) metres; a frame without information on the errors changes nothing.
        """

        def parallax_effects(x: Array, disparity: Array) -> Array:
            return effects(self.camera, x, disparity)[BY_PARALLAX, :3]

        evidence = parallax_information(self.camera, matches, R_cp, t_cp, parallax_effects, self.config.scale)
        if evidence is None:
            return
        parallax_matrix, parallax_vector = evidence
        measured_information = np.zeros((ERROR_COUNT, ERROR_COUNT))
        measured_information[np.ix_(BY_PARALLAX, BY_PARALLAX)] = parallax_matrix
        measured_information /= self.config.noise_inflation**2
        vector = np.zeros(ERROR_COUNT)
        vector[BY_PARALLAX] = parallax_vector
        vector /= self.config.noise_inflation**2
        # The matches were corrected by the shrunk errors, so the residuals are those at these errors; but the
        # step begins at the estimate.
        vector -= measured_information @ (self.estimate - self.errors)
        information = measured_information + np.linalg.inv(self.covariance)
        change = np.linalg.solve(information, vector)
        self.set_estimate(self.estimate + change, np.asarray(np.linalg.inv(information)))

    def set_estimate(self, estimate: Array, covariance: Array) -> None:
        """Set the estimate (19,) and its covariance (19, 19), and compute the shrunk errors."""
        self.estimate = estimate
        self.covariance = covariance
        if "shrinking" in self.config.without:
            self.errors = estimate.copy()
        else:
            self.errors = shrunk(estimate, covariance)


def shrunk(estimate: Array, covariance: Array) -> Array:
    """The errors (19,) for the correction, from the estimate (19,) and its covariance; see `Rig.errors`.

    A lens error x becomes x max(0, 1 - s² / x²), where s² is its variance plus the square of its floor; the
    field x of k errors with the covariance C becomes x max(0, 1 - k / xᵀ C⁻¹ x).
    """
    errors = estimate.copy()
    covariance = covariance.copy()
    shrunk_lens: dict[int, float] = {}
    for i in (K2, K1, P1, P2):
        prior = LENS_PX[ERROR_NAMES[i]]
        variance = covariance[i, i]
        kept_share = 0.0
        if variance <= KNOWN_VARIANCE_SHARE * prior.deviation_px**2:
            noise = variance + prior.floor_px**2
            kept_share = max(0.0, 1.0 - noise / max(errors[i] ** 2, MIN_SQUARE))
        shrunk_lens[i] = errors[i] * kept_share
        # The other errors, conditioned on this lens error: what it no longer explains, they must.
        gain = covariance[i] / variance
        errors += gain * (shrunk_lens[i] - errors[i])
        covariance -= np.outer(gain, covariance[i])
    field = errors[:FIELD_COUNT]
    field_covariance = covariance[:FIELD_COUNT, :FIELD_COUNT]
    squared = float(field @ np.linalg.solve(field_covariance, field))
    errors[:FIELD_COUNT] *= max(0.0, 1.0 - FIELD_COUNT / max(squared, MIN_SQUARE))
    # Rounding in the later steps has changed the lens errors of the earlier ones: a zero must stay zero.
    for i, error in shrunk_lens.items():
        errors[i] = error
    return errors


def effects(camera: StereoCamera, x: Array, disparity: Array) -> Array:
    """Changes (19, 4, N), pixels, of left u, left v, disparity and row difference, due to 1 px of each error.

    x : (2, N) normalised left positions; disparity : (N,) pixels.
    """
    x_right = np.array([x[0] - disparity / camera.f, x[1]])
    left_terms = field_terms(*x)
    sum_of_terms = left_terms + field_terms(*x_right)
    changes = np.zeros((ERROR_COUNT, 4, len(disparity)))
    # Half of the field is attributed to each camera, at the point's position in its image.
    disparities = changes[:DISPARITY_COUNT]
    disparities[:, 0] = 0.5 * left_terms
    disparities[:, 2] = 0.5 * sum_of_terms
    rows = changes[DISPARITY_COUNT:FIELD_COUNT]
    rows[:, 1] = 0.5 * left_terms[: len(ROW_TERMS)]
    rows[:, 3] = 0.5 * sum_of_terms[: len(ROW_TERMS)]
    # The lenses move both images of the point; disparity and row difference change if they differ.
    lenses = changes[FIELD_COUNT:]
    lenses[:, :2] = lens_shapes(x)
    lenses[:, 2:] = lenses[:, :2] - lens_shapes(x_right)
    return changes


def field_at(errors: Array, x: Array, y: Array) -> Array:
    """Errors (2, N) of disparity and row difference, pixels, at normalised left positions x, y (N,)."""
    terms = field_terms(x, y)
    of_disparity = errors[:DISPARITY_COUNT] @ terms
    of_row = errors[DISPARITY_COUNT:FIELD_COUNT] @ terms[: len(ROW_TERMS)]
    return np.stack([of_disparity, of_row])


def field_terms(x: Array, y: Array) -> Array:
    """Values (9, N) of `DISPARITY_TERMS` at normalised x, y (N,); the first six are the `ROW_TERMS`."""
    x2 = x * x
    return np.array([np.ones_like(x), x, y, x2, x * y, y * y, x2 * x, x2 * y, x2 * x2])


def lens_shapes(points: Array) -> Array:
    """Displacements (4, 2, N) of normalised points (2, N), for each term of `LENS_PX` with size 1."""
    x, y = points
    r2 = x * x + y * y
    twice_xy = 2.0 * x * y
    by_p1 = (twice_xy, r2 + 2.0 * y * y)
    by_p2 = (r2 + 2.0 * x * x, twice_xy)
    by_k1 = r2 * points
    by_k2 = r2 * by_k1
    return np.array([by_p1, by_p2, by_k1, by_k2])


def prior_covariance(without: Sequence[str] = ()) -> Array:
    """Covariance (19, 19) of the errors before the first frame, from `RIG_FAULTS` and `LENS_PX`.

    without : groups of errors that are held at zero; see `CalibrationConfig.without`.
    """
    deviations = np.full(ERROR_COUNT, FREE_DEVIATION_PX)
    deviations[FIELD_COUNT:] = [prior.deviation_px for prior in LENS_PX.values()]
    covariance = np.diag(deviations) ** 2
    left_out = _names_of_groups(FAULTS_OF_GROUP, without)
    for name, fault in RIG_FAULTS.items():
        if not name.startswith(left_out):
            columns = [fault.columns.get(term, 0.0) for term in DISPARITY_TERMS]
            rows = [fault.rows.get(term, 0.0) for term in ROW_TERMS]
            shape = np.array(columns + rows)
            covariance[:FIELD_COUNT, :FIELD_COUNT] += fault.deviation_px**2 * np.outer(shape, shape)
    held = _names_of_groups(ERRORS_OF_GROUP, without)
    shares = np.array([HELD_SHARE if name.startswith(held) else 1.0 for name in ERROR_NAMES])
    return np.asarray(covariance * np.outer(shares, shares))


def _names_of_groups(names: dict[str, tuple[str, ...]], groups: Sequence[str]) -> tuple[str, ...]:
    """The beginnings of names that belong to some groups; () if there are none, with which no name begins."""
    beginnings: list[str] = []
    for group in groups:
        beginnings.extend(names.get(group, ()))
    return tuple(beginnings)
