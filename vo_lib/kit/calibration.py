"""The learnt errors of a rig: kept in a file, described in a sentence, and used again."""

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
from .rig import ERROR_COUNT, ERROR_NAMES, FIELD, RIG_FAULTS, N, Rig, field_at, powers
from .settings import CalibrationConfig

MAX_LENGTH_DIFFERENCE = 0.01  # of the focal lengths and baselines of one camera, as a share
MAX_VIEW_DIFFERENCE = 0.05  # of its image sizes and principal points, as a share of the image
MAX_RIG_ERROR_PX = 30.0  # larger than the error of any rig in use
MIN_REPORTED_ERROR_PX = 0.05
UNREPORTED_EDGE = 0.08  # share of the image at each side


@dataclass(frozen=True)
class Calibration:
    """The errors of one stereo camera, as known after a drive.

    Attributes
    ----------
    camera : whose errors these are.
    estimate, covariance : (19,) and (19, 19), as `Rig` has them.
    """

    camera: StereoCamera
    estimate: Array
    covariance: Array

    def covariance_on_another_drive(self) -> Array:
        """Covariance where another drive begins: disparities shift, by a pixel between two of one day."""
        covariance = self.covariance.copy()
        covariance[0, 0] += RIG_FAULTS["shift along the rows"][2] ** 2
        return covariance

    def check(self, camera: StereoCamera) -> None:
        """`DataError` unless the camera is like the one given.

        Focal length and baseline agree within a hundredth, size and principal point within a twentieth.
        """
        size = np.array(camera.size)
        limits: dict[str, tuple[Any, Any, Any]] = {
            "focal length": (self.camera.f, camera.f, MAX_LENGTH_DIFFERENCE * camera.f),
            "baseline": (self.camera.baseline, camera.baseline, MAX_LENGTH_DIFFERENCE * camera.baseline),
            "image size": (self.camera.size, camera.size, MAX_VIEW_DIFFERENCE * size),
            "principal point": (self.camera.K[:2, 2], camera.K[:2, 2], MAX_VIEW_DIFFERENCE * size),
        }
        for name, (learnt, given, limit) in limits.items():
            if (np.abs(np.subtract(learnt, given)) > limit).any():
                raise DataError(f"the calibration is of another camera: {name} {learnt}, here {given}")

    def in_use(self, config: CalibrationConfig) -> Array:
        """The errors (19,) that are taken out of matches, pixels."""
        rig = Rig(self.camera, config)
        rig.know(self.estimate, self.covariance)
        return rig.errors

    def in_words(self, config: CalibrationConfig) -> str:
        """The errors in use as a sentence, with standard deviations; uncertain errors are left out."""
        return describe_errors(self.in_use(config), self.covariance, self.camera)

    def to_json(self) -> str:
        """The file's text; numbers are exact."""
        data = {
            "camera": to_dict(self.camera),
            "unit": "px, in normalised left positions x, y; disparities and rows left less right",
            "errors": dict(zip(ERROR_NAMES, self.estimate.tolist(), strict=True)),
            "covariance": self.covariance.tolist(),
        }
        return json.dumps(data, indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def read_learnt_calibration(path: Path) -> Calibration:
    """A calibration from its file; `DataError` where the file is not as the kit writes it."""
    expected = "a calibration.json, as `vo run --variant kit` writes it"
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
        np.linalg.cholesky(covariance)  # raises unless it is positive definite
        corners = camera.normalise(np.array([[0, 0], [0, 1], [1, 0], [1, 1]]) * camera.size).T
        errors = [*np.ravel(field_at(estimate, *corners)), *estimate[FIELD:]]
    except (KeyError, ValueError, TypeError, OverflowError, np.linalg.LinAlgError):
        raise DataError(f"expected {expected}", path) from None
    if not np.abs(errors).max() <= MAX_RIG_ERROR_PX:
        raise DataError(
            f"an error of {np.abs(errors).max():.3g} px: expected {MAX_RIG_ERROR_PX:g} px at most", path
        )
    return Calibration(camera, estimate, covariance)


def describe_errors(errors: Array, covariance: Array, camera: StereoCamera) -> str:
    """The effects of a rig's errors (19,), pixels, in the image, with standard deviations, as a sentence.

    An effect is left out where its largest value is below two standard deviations, or too small to matter.
    """
    u, v = (np.linspace(UNREPORTED_EDGE, 1.0 - UNREPORTED_EDGE, 9) * size for size in camera.size)
    x, y = camera.normalise(np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2)).T
    terms, deviations = powers(x, y), np.sqrt(np.diag(covariance))
    parts = []
    for name, field, used in zip(
        ("disparities", "rows"), field_at(errors, x, y), (slice(0, N), slice(N, FIELD)), strict=True
    ):
        largest = int(np.argmax(np.abs(field)))
        term = terms[: used.stop - used.start, largest]
        deviation = float(np.sqrt(term @ covariance[used, used] @ term))
        if abs(field[largest]) >= max(MIN_REPORTED_ERROR_PX, 2.0 * deviation):
            parts.append(f"{name} are off by {field.min():+.1f} to {field.max():+.1f} ±{deviation:.2f} px")
    for name, size, deviation in zip(ERROR_NAMES[FIELD:], errors[FIELD:], deviations[FIELD:], strict=True):
        if abs(size) >= max(MIN_REPORTED_ERROR_PX, 2.0 * deviation):
            parts.append(f"lens: {name} {size:+.1f} ±{deviation:.1f} px")
    return "; ".join(parts) or "none that needs correction"
