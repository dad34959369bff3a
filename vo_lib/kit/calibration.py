"""The estimated calibration errors as a file, as text, and as the start of another run."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import DataError
from ..files import read_mapping
from ..geometry.camera import StereoCamera
from ..geometry.types import Array
from ..settings import to_dict
from .rig import (
    DISPARITY_COUNT,
    ERROR_COUNT,
    ERROR_NAMES,
    FIELD_COUNT,
    RIG_FAULTS,
    Rig,
    field_at,
    field_terms,
)
from .settings import CalibrationConfig

MAX_LENGTH_DIFFERENCE = 0.01  # largest relative difference of focal length and baseline for the same camera
MAX_VIEW_DIFFERENCE = 0.05  # largest difference of image size and principal point, as a share of the image
MAX_RIG_ERROR_PX = 30.0  # largest error in a valid file; the errors of real rigs are smaller
MIN_REPORTED_ERROR_PX = 0.05
# The covariance has the noise of one drive. Between parts of KITTI's drives 00, 0005 and 0013, the estimates
# differ by 1.3 to 2.2 times its standard deviations.
SPREAD_BETWEEN_DRIVES = 2.0
UNREPORTED_EDGE = 0.08  # width of the image border without reported errors, as a share of the image
REPORTED_PLACES = 9  # along the width and along the height of the image


@dataclass(frozen=True, eq=False)
class Calibration:
    """The calibration errors of a stereo camera after a drive.

    Attributes
    ----------
    camera : the stereo camera.
    estimate, covariance : (19,) and (19, 19), see `Rig`.
    """

    camera: StereoCamera
    estimate: Array
    covariance: Array

    def covariance_on_another_drive(self) -> Array:
        """Covariance at the start of another drive, with an added variance for a new shift of disparities."""
        covariance = self.covariance.copy()
        shift = ERROR_NAMES.index("disparity 1")
        covariance[shift, shift] += RIG_FAULTS["shift along the rows"].deviation_px ** 2
        return covariance

    def check(self, camera: StereoCamera) -> None:
        """Raise `DataError` unless the calibration fits the camera.

        Focal length and baseline must agree within 1 %, image size and principal point within 5 %.
        """
        size = np.array(camera.size)
        limits: dict[str, tuple[Any, Any, Any]] = {
            "focal length": (self.camera.f, camera.f, MAX_LENGTH_DIFFERENCE * camera.f),
            "baseline": (self.camera.baseline, camera.baseline, MAX_LENGTH_DIFFERENCE * camera.baseline),
            "image size": (self.camera.size, camera.size, MAX_VIEW_DIFFERENCE * size),
            "principal point": (self.camera.K[:2, 2], camera.K[:2, 2], MAX_VIEW_DIFFERENCE * size),
        }
        for name, (stored, actual, largest_difference) in limits.items():
            if (np.abs(np.subtract(stored, actual)) > largest_difference).any():
                raise DataError(f"the calibration is of another camera: {name} {stored}, here {actual}")

    def in_use(self, config: CalibrationConfig) -> Array:
        """The errors (19,) used for the correction of matches, pixels."""
        rig = Rig(self.camera, config)
        rig.set_estimate(self.estimate, self.covariance)
        return rig.errors

    def describe(self, config: CalibrationConfig) -> str:
        """Text on the errors used for the correction, with standard deviations, without uncertain errors."""
        return describe_errors(self.in_use(config), self.covariance, self.camera)

    def to_json(self) -> str:
        """The text of the file, with exact numbers."""
        data = {
            "camera": to_dict(self.camera),
            "unit": "px, in normalised left positions x, y; disparities and rows are left minus right",
            "errors": dict(zip(ERROR_NAMES, self.estimate.tolist(), strict=True)),
            "covariance": self.covariance.tolist(),
        }
        return json.dumps(data, indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def read_learnt_calibration(path: Path, max_error: float = MAX_RIG_ERROR_PX) -> Calibration:
    """The calibration in a file as `Calibration.to_json` writes it; any other content raises `DataError`.

    max_error : largest error in the image, pixels. A run may have estimated a larger one, and its folder is
        read again without this limit; as the start of another run, such an estimate is refused.
    """
    expected = "a calibration.json, as written by `vo run --variant kit`"
    data = read_mapping(path, expected)
    try:
        camera = StereoCamera(**data["camera"])
        estimate = np.array([data["errors"][name] for name in ERROR_NAMES], np.float64)
        covariance = np.array(data["covariance"], np.float64).reshape(ERROR_COUNT, ERROR_COUNT)
        scale = np.abs(covariance).max()
        if not np.isfinite([*estimate, scale]).all():
            raise ValueError
        positive = min(camera.f, camera.baseline, *camera.size, scale) > 0
        if not positive or not np.allclose(covariance / scale, covariance.T / scale, rtol=0.0, atol=1e-9):
            raise ValueError
        np.linalg.cholesky(covariance)  # raises unless the covariance is positive definite
        corners = camera.normalise(np.array([[0, 0], [0, 1], [1, 0], [1, 1]]) * camera.size)
        field_in_corners = field_at(estimate, *corners.T)
        largest = np.abs([*field_in_corners.ravel(), *estimate[FIELD_COUNT:]]).max()
    except (KeyError, ValueError, TypeError, OverflowError, np.linalg.LinAlgError):
        raise DataError(f"expected {expected}", path) from None
    if not largest <= max_error:  # NaN is refused, too
        raise DataError(f"an error of {largest:.3g} px: expected at most {max_error:g} px", path)
    return Calibration(camera, estimate, covariance)


def describe_errors(errors: Array, covariance: Array, camera: StereoCamera) -> str:
    """Text on the effects of calibration errors (19,) in the image, in pixels with standard deviations.

    The standard deviations include the spread between drives. Effects below two standard deviations or below
    `MIN_REPORTED_ERROR_PX` are omitted.
    """
    width, height = camera.size
    shares = np.linspace(UNREPORTED_EDGE, 1.0 - UNREPORTED_EDGE, REPORTED_PLACES)
    pixels = np.stack(np.meshgrid(shares * width, shares * height), axis=-1).reshape(-1, 2)
    x, y = camera.normalise(pixels).T
    of_disparity, of_row = field_at(errors, x, y)
    terms = field_terms(x, y)
    covariance = SPREAD_BETWEEN_DRIVES**2 * covariance
    fields = (
        ("disparities", of_disparity, slice(0, DISPARITY_COUNT)),
        ("rows", of_row, slice(DISPARITY_COUNT, FIELD_COUNT)),
    )
    parts = []
    for name, field, coefficients in fields:
        # The standard deviation of the field where it is largest.
        largest = int(np.argmax(np.abs(field)))
        own_covariance = covariance[coefficients, coefficients]
        own_terms = terms[: len(own_covariance), largest]
        deviation = float(np.sqrt(own_terms @ own_covariance @ own_terms))
        if abs(field[largest]) >= max(MIN_REPORTED_ERROR_PX, 2.0 * deviation):
            parts.append(f"{name} are off by {field.min():+.1f} to {field.max():+.1f} ±{deviation:.2f} px")
    deviations = np.sqrt(np.diag(covariance))
    lenses = slice(FIELD_COUNT, ERROR_COUNT)
    for name, size, deviation in zip(ERROR_NAMES[lenses], errors[lenses], deviations[lenses], strict=True):
        if abs(size) >= max(MIN_REPORTED_ERROR_PX, 2.0 * deviation):
            parts.append(f"lens: {name} {size:+.1f} ±{deviation:.1f} px")
    return "; ".join(parts) or "none beyond two standard deviations"
