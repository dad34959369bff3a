"""Calibration of a user's stereo camera, from matrices or numbers, and the rectified camera."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path

import cv2
import numpy as np

from fetch.rectification import (
    Lens,
    Maps,
    Size,
    compute_rectification,
    is_identity,
    rectification_maps,
)
from vo_lib.data.kitti import MAX_BASELINE_M, MIN_BASELINE_M
from vo_lib.errors import DataError
from vo_lib.geometry.types import Array, Image

UNITS = {"m": 1.0, "cm": 0.01, "mm": 0.001}
UNIT_WORDS = {"cm": "centimetres", "mm": "millimetres"}
USUAL_BASELINES_M = 0.02, 2.0  # from the smallest depth camera to the roof of a car
MIDDLE = 0.25, 0.75  # share of the width and height in which the principal point usually is


@dataclass(frozen=True, eq=False)
class FileCalibration:
    """A stereo calibration as its files give it. Camera 1 is the left camera, camera 2 the right one.

    Attributes
    ----------
    matrices : by OpenCV's names: K1, K2 (3, 3) intrinsics and D1, D2 (N,) distortion of the raw images; R
        (3, 3) and T (3,) with X_right = R X_left + T; R1, R2 (3, 3) and P1, P2 (3, 4) of the rectification.
    path : the file that messages name.
    size : size of the images, or None if the files do not name it.
    unit : metres per unit of T and of P, or None if the files do not say.
    lenses : lens models of the left and of the right camera.
    notes : sentences on choices that the files leave open.
    """

    matrices: dict[str, Array]
    path: Path
    size: Size | None = None
    unit: float | None = None
    lenses: tuple[Lens, Lens] = (Lens(), Lens())
    notes: tuple[str, ...] = ()

    def rig(self, size: Size, rectified: bool = False, unit: float | None = None) -> RectifiedRig:
        """The rectified camera for images of this size; `unit` replaces the unit of the files.

        Raises `DataError` if the files name another size, or as `rig_from_matrices`.
        """
        if self.size is not None and self.size != size:
            raise DataError(other_size(self.size, size), self.path)
        metres = unit or self.unit or 1.0
        return rig_from_matrices(self.matrices, size, self.path, rectified, metres, self.lenses)

    def centre(self) -> tuple[float, float]:
        """Principal point of the left camera: in the raw image if K1 is given, or else of P1; pixels."""
        matrix = self.matrices["K1"] if "K1" in self.matrices else self.matrices["P1"]
        return float(matrix[0, 2]), float(matrix[1, 2])


@dataclass(frozen=True, eq=False)
class RectifiedRig:
    """A rectified stereo camera.

    Attributes
    ----------
    f, cx, cy : pixels. baseline : metres; negative if cameras are exchanged in the calibration.
    maps : two rectification maps for `cv2.remap` per camera, or None for rectified images.
    R1 : (3, 3) rotation from the axes of the left camera to the rectified axes.
    """

    f: float
    cx: float
    cy: float
    baseline: float
    maps: tuple[Maps, Maps] | None = None
    R1: Array = field(default_factory=lambda: np.eye(3))

    def rectify(self, left: Image, right: Image) -> tuple[Image, Image]:
        """The rectified images, (H, W) uint8 each; `DataError` for a size not in the calibration."""
        if self.maps is None:
            return left, right
        height, width = left.shape
        own_height, own_width = self.maps[0][0].shape[:2]
        if (width, height) != (own_width, own_height):
            raise DataError(
                f"the images are {width}×{height}, but the calibration is for {own_width}×{own_height}"
            )
        rectified = []
        for image, maps in zip((left, right), self.maps, strict=True):
            result = cv2.remap(image, *maps, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
            rectified.append(np.asarray(result, np.uint8))
        return rectified[0], rectified[1]


def other_size(named: Size, actual: Size) -> str:
    """The sentence for images of another size than the calibration; a remedy if they are only scaled."""
    text = f"the calibration is for images of {named[0]}×{named[1]}, but these are {actual[0]}×{actual[1]}"
    scale = actual[0] / named[0]
    if abs(actual[1] / named[1] - scale) < 1.0 / named[1]:  # the height is rounded to whole pixels
        return (
            f"{text}: use images of the calibration's size, or multiply f, cx and cy in the file by "
            f"{scale:.4g} and give the new size"
        )
    return f"{text}: part of the image was cut off, or the file belongs to another camera"


def rig_from_matrices(
    matrices: dict[str, Array],
    size: Size,
    path: Path,
    rectified: bool = False,
    unit: float = 1.0,
    lenses: tuple[Lens, Lens] = (Lens(), Lens()),
) -> RectifiedRig:
    """The rig with the given calibration matrices.

    The rectification is computed from K, D of both cameras and from R, T (for RADTAN lenses by
    `cv2.stereoRectify`, without border pixels), or is given by R1, P1, R2, P2. With P1 and P2 alone, the
    images must already be rectified.

    Parameters
    ----------
    matrices : as in `FileCalibration`. lenses : lens models of both cameras.
    size : width and height of the images, pixels.
    rectified : if true, the images are rectified, and only P1 and P2 are used.
    unit : unit of T and P, metres.
    """
    has_raw_cameras = {"K1", "D1", "K2", "D2"} <= matrices.keys()
    if not rectified and has_raw_cameras and {"R", "T"} <= matrices.keys():
        matrices = {**matrices, **_computed_rectification(matrices, size, path, lenses)}
    if not {"P1", "P2"} <= matrices.keys():
        missing = ", ".join(sorted({"K1", "D1", "K2", "D2", "R", "T"} - matrices.keys()))
        expected_names = "P1 and P2" if rectified else f"{missing} (or P1 and P2 of rectified images)"
        raise DataError(f"the calibration lacks {expected_names}", path)
    P1 = matrices["P1"]
    P2 = matrices["P2"]
    if abs(P2[1, 3] - P1[1, 3]) > abs(P2[0, 3] - P1[0, 3]):
        raise DataError("the second camera is above or below the first camera, not beside it", path)
    f = float(P1[0, 0])
    if f <= 0 or np.abs(P1[:, :3] - P2[:, :3]).max() > 1e-3 * f or abs(P1[1, 1] - f) > 1e-3 * f:
        raise DataError("P1 and P2 do not belong to a rectified pair: f, cx, cy must be equal", path)
    # KITTI's colour cameras have an offset in P1 too.
    baseline = unit * float(P1[0, 3] - P2[0, 3]) / f
    rig = rig_from_numbers(f, float(P1[0, 2]), float(P1[1, 2]), baseline, path)
    if rectified or not has_raw_cameras or not {"R1", "R2"} <= matrices.keys():
        return rig
    maps_l = rectification_maps(matrices, size, "1", lenses[0])
    maps_r = rectification_maps(matrices, size, "2", lenses[1])
    if is_identity(maps_l) and is_identity(maps_r):
        return replace(rig, R1=matrices["R1"])
    return replace(rig, maps=(maps_l, maps_r), R1=matrices["R1"])


def _computed_rectification(
    matrices: dict[str, Array], size: Size, path: Path, lenses: tuple[Lens, Lens]
) -> dict[str, Array]:
    """R1, R2, P1 and P2 of K, D, R and T; `DataError` if these define no rectification."""
    T = matrices["T"].ravel()
    if abs(T[2]) > max(abs(T[0]), abs(T[1])):
        raise DataError("T: the second camera is in front of or behind the first, not beside it", path)
    try:
        computed = compute_rectification(matrices, size, lenses)
        if not all(np.isfinite(matrix).all() for matrix in computed.values()):
            raise ValueError
    except (cv2.error, ValueError):
        raise DataError("these matrices do not define a rectification", path) from None
    return computed


def rig_from_numbers(
    f: float, cx: float, cy: float, baseline: float, path: Path | None = None
) -> RectifiedRig:
    """A rig from numbers in pixels and metres; `DataError` for impossible values."""
    if not np.isfinite([f, cx, cy, baseline]).all() or f <= 0:
        raise DataError(f"focal length {f:g} px, centre {cx:g},{cy:g} px: expected positive numbers", path)
    if abs(baseline) < MIN_BASELINE_M:
        raise DataError(
            f"the baseline is {abs(baseline):g} m: expected the distance between the two cameras, "
            f"{1000 * MIN_BASELINE_M:g} mm to {MAX_BASELINE_M:g} m",
            path,
        )
    if abs(baseline) > MAX_BASELINE_M:
        raise DataError(f"the baseline is {abs(baseline):g} m: {unit_advice(abs(baseline))}", path)
    return RectifiedRig(f, cx, cy, baseline)


def usual_units(baseline: float) -> dict[str, float]:
    """The units in which this number is a usual baseline, each with the baseline in metres."""
    readings = {name: baseline * unit for name, unit in UNITS.items()}
    shortest, longest = USUAL_BASELINES_M
    return {name: metres for name, metres in readings.items() if shortest <= metres <= longest}


def unit_advice(baseline: float) -> str:
    """The units that would make a usual baseline of a number that is too large for metres."""
    readings = usual_units(baseline) or {"mm": UNITS["mm"] * baseline}
    words = [
        f"if the unit is {UNIT_WORDS[name]}, add --unit {name} (then {metres:g} m)"
        for name, metres in readings.items()
    ]
    return "; ".join(words)


def centre_warning(cx: float, cy: float, size: Size) -> str:
    """A sentence if a principal point is not in the middle half of the images; "" otherwise."""
    low, high = MIDDLE
    width, height = size
    if low <= cx / width <= high and low <= cy / height <= high:
        return ""
    return (
        f"the principal point {cx:.1f},{cy:.1f} is far from the middle of the images of {size[0]}×{size[1]}: "
        "is the calibration of another resolution? Then all lengths are wrong by the ratio"
    )
