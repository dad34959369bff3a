"""What was learnt of a rig's errors, to be kept in a file, said in words, and used again."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..core.camera import StereoCamera
from ..core.errors import DataError
from ..core.files import NUMBER, read_json
from ..core.settings import to_dict
from ..core.types import Array
from .config import CalibrationConfig
from .rig import FAULTS, FIELD, NAMES, SIZE, Rig, field_at

SHAPE = {"camera": {str: NUMBER}, "errors": {str: NUMBER}, "covariance": [[NUMBER]]}
ALIKE = 0.01  # share by which focal length and baseline of a camera that is the same may differ
SAME_VIEW = 0.05  # share of the image by which its size and principal point may
LARGEST = 30.0  # pixels; no rig that anybody used is so far from its calib.txt
NOTHING = 0.05  # pixels; a smaller error is not worth a word
SHARE = 0.1  # % of the baseline; neither is a smaller one
EDGE = 0.08  # share of the image at each side that is left out where an error is said in words


@dataclass(frozen=True)
class Calibration:
    """The errors of one stereo camera, as known after a drive.

    Attributes
    ----------
    camera : whose errors these are.
    estimate, covariance : (21,) and (21, 21), as `Rig` has them.
    """

    camera: StereoCamera
    estimate: Array
    covariance: Array

    def covariance_on_another_drive(self) -> Array:
        """Covariance where another drive begins: disparities shift, by a pixel between two of one day."""
        covariance = self.covariance.copy()
        covariance[0, 0] += FAULTS["shift along the rows"][2] ** 2
        return covariance

    def check(self, camera: StereoCamera) -> None:
        """`DataError` unless this was learnt with a camera like the one given."""
        require_same_camera(self.camera, camera, "the calibration")

    def in_use(self, config: CalibrationConfig) -> Array:
        """The errors (21,) that are taken out of matches, pixels."""
        rig = Rig(self.camera, config)
        rig.know(self.estimate, self.covariance)
        return rig.errors

    def in_words(self, config: CalibrationConfig) -> str:
        """What these errors do in the image; errors too uncertain to be corrected are left out."""
        return in_words(self.in_use(config), self.camera)

    def to_json(self) -> str:
        """The file's text; numbers are exact."""
        data = {
            "camera": to_dict(self.camera),
            "unit": "px, in normalised left positions x, y; disparities and rows left less right; "
            "the right camera's place in % of the baseline",
            "errors": dict(zip(NAMES, self.estimate.tolist(), strict=True)),
            "covariance": self.covariance.tolist(),
        }
        return json.dumps(data, indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def require_same_camera(one: StereoCamera, other: StereoCamera, name: str) -> None:
    """`DataError` naming what differs between two cameras.

    Focal length and baseline are the same within a hundredth, size and principal point within a twentieth.
    """
    for field in ("f", "baseline"):
        mine, theirs = getattr(one, field), getattr(other, field)
        if abs(mine - theirs) > ALIKE * theirs:
            raise DataError(f"{name} is of another camera: {field} is {mine:g} and {theirs:g}")
    for field, two in (
        ("image", (one.size, other.size)),
        ("principal point", ((one.cx, one.cy), (other.cx, other.cy))),
    ):
        if (np.abs(np.subtract(*two)) > SAME_VIEW * np.array(other.size)).any():
            mine, theirs = ("×".join(f"{number:g}" for number in each) for each in two)
            raise DataError(f"{name} is of another camera: {field} is {mine} and {theirs} px")


def read_calibration(path: Path) -> Calibration:
    """A calibration from its file; `DataError` where it is not as the kit writes it."""
    expected = "a calibration.json, as `vo run` and `vo calibrate` write it"
    data = read_json(path, SHAPE, expected)
    try:
        camera = StereoCamera(**data["camera"])
        if min(camera.f, camera.baseline, *camera.size) <= 0:
            raise ValueError
        known = Calibration(
            camera,
            _array(list(data["errors"].values()), SIZE),
            _covariance(data["covariance"], SIZE),
        )
        corners = camera.normalise(np.array([[0, 0], [0, 1], [1, 0], [1, 1]]) * camera.size).T
        largest = np.abs([*np.ravel(field_at(known.estimate, *corners)), *known.estimate[FIELD:]]).max()
    except (ValueError, TypeError, OverflowError, np.linalg.LinAlgError):
        raise DataError(f"expected {expected}", path) from None
    if not largest <= LARGEST:
        raise DataError(f"an error of {largest:.3g} px: expected {LARGEST:g} px at most", path)
    return known


def _array(values: Any, *shape: int) -> Array:
    array = np.array(values, np.float64)
    if array.shape != shape or not np.isfinite(array).all():
        raise ValueError
    return array


def _covariance(values: Any, size: int) -> Array:
    """A symmetric positive definite matrix."""
    array = _array(values, size, size)
    if np.abs(array - array.T).max() > 1e-9 * np.abs(array).max() or np.linalg.eigvalsh(array)[0] <= 0:
        raise ValueError
    return array


def in_words(errors: Array, camera: StereoCamera) -> str:
    """What a rig's errors (21,), pixels, do in the image."""
    u, v = (np.linspace(EDGE, 1.0 - EDGE, 9) * size for size in camera.size)
    grid = np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2)
    disparity, row = field_at(errors, *camera.normalise(grid).T)
    said = []
    if np.abs(disparity).max() >= NOTHING:
        worst, place = _worst(disparity, grid, camera)
        said.append(
            f"disparities are up to {abs(worst):.1f} px too {'large' if worst > 0 else 'small'} {place}"
        )
    if np.abs(row).max() >= NOTHING:
        worst, place = _worst(row, grid, camera)
        said.append(f"rows differ by up to {abs(worst):.1f} px {place}")
    down, back, p1, p2, k1, k2 = errors[FIELD:]
    for way, share in (("lower" if down > 0 else "higher", down), ("behind" if back > 0 else "ahead", back)):
        if abs(share) >= SHARE:
            said.append(f"the right camera stands {abs(share):.1f} % of the baseline {way}")
    shape = "a pincushion" if k1 > 0 else "a barrel"
    for what, terms in (("is decentered", {"p1": p1, "p2": p2}), (f"has {shape}", {"k1": k1, "k2": k2})):
        large = [f"{name} {size:+.1f} px" for name, size in terms.items() if abs(size) >= NOTHING]
        if large:
            said.append(f"the lens {what}, {' and '.join(large)}")
    return "; ".join(said) or "nothing that needs correction"


def _worst(error: Array, grid: Array, camera: StereoCamera) -> tuple[float, str]:
    """The largest of the errors (N,) at pixels (N, 2), and where in the image it is."""
    at = int(np.argmax(np.abs(error)))
    if np.ptp(error) < 0.3 * abs(error[at]):
        return float(error[at]), "everywhere"
    u, v = grid[at] / camera.size - 0.5
    above = "at the top" if v < 0 else "at the bottom"
    places = {(True, True): "in the corners", (True, False): "at the sides", (False, True): above}
    return float(error[at]), places.get((bool(abs(u) > 0.25), bool(abs(v) > 0.25)), "in the middle")
