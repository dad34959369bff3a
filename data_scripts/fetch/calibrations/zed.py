"""Factory calibrations of ZED cameras (SN12345.conf), for the raw images of one of their resolutions.

The rotation from the left to the right camera is the vector (RX, CV, RZ), radians, for `cv2.Rodrigues`. T is
(-Baseline, TY, TZ), millimetres: the file has the absolute value of the first number. So read Stereolabs' own
programs (github.com/stereolabs/zed-opencv-native, python/zed_opencv_native.py; stereolabs/
zed-opencv-calibration, include/opencv_calibration.hpp).
"""

from __future__ import annotations

import configparser
import re
from pathlib import Path

import cv2
import numpy as np

from fetch.calibrations.values import intrinsic_matrix, numbers
from fetch.rectification import FISHEYE, RADTAN, Lens
from fetch.stereo_calibration import UNITS, FileCalibration
from vo_lib.errors import DataError
from vo_lib.geometry.types import Array

SIZES = {
    (2208, 1242): "2K",
    (1920, 1080): "FHD",
    (1920, 1200): "FHD1200",
    (1280, 720): "HD",
    (960, 600): "SVGA",
    (672, 376): "VGA",
    (3840, 2160): "4K",
    (3200, 1800): "QHDPLUS",
}
RADIAL = ("k1", "k2", "k3", "k4", "k5", "k6")


def is_conf(text: str) -> bool:
    """Whether a text is the factory calibration of a ZED camera."""
    return bool(re.search(r"^\s*\[LEFT_CAM_\w+\]", text, re.MULTILINE)) and "[STEREO]" in text


def read_conf(text: str, path: Path, size: tuple[int, int]) -> FileCalibration:
    """The calibration for images of this size; `DataError` if the camera does not have this resolution."""
    parser = configparser.ConfigParser(strict=False, interpolation=None)
    try:
        parser.read_string(text)
    except configparser.Error as error:
        raise DataError(
            "is not a calibration of a ZED camera", path, getattr(error, "lineno", None)
        ) from None
    mode = SIZES.get(size)
    if mode is None or f"LEFT_CAM_{mode}" not in parser:
        present = [f"{w}×{h}" for (w, h), name in SIZES.items() if f"LEFT_CAM_{name}" in parser]
        raise DataError(
            f"has no calibration for images of {size[0]}×{size[1]}, expected {' or '.join(present)}; is it a "
            "video with both images side by side? Then use --video",
            path,
        )
    matrices: dict[str, Array] = {}
    lenses = []
    for number, side in (("1", "LEFT"), ("2", "RIGHT")):
        matrices[f"K{number}"], matrices[f"D{number}"], lens = _camera(parser, side, mode, path)
        lenses.append(lens)
    angles = [_number(parser, "STEREO", (f"{name}_{mode}", name), path) for name in ("RX", "CV", "RZ")]
    baseline = _number(parser, "STEREO", ("Baseline",), path, needed=True)
    rest = [_number(parser, "STEREO", (f"{name}_{mode}", name), path) for name in ("TY", "TZ")]
    matrices["R"] = np.asarray(cv2.Rodrigues(np.array(angles))[0], np.float64)
    matrices["T"] = np.array([-abs(baseline), *rest])
    return FileCalibration(matrices, path, size, UNITS["mm"], (lenses[0], lenses[1]))


def _camera(parser: configparser.ConfigParser, side: str, mode: str, path: Path) -> tuple[Array, Array, Lens]:
    """K, D and the lens model of a camera. Newer files have one section of distortion for all resolutions."""
    section = f"{side}_CAM_{mode}"
    pinhole = [_number(parser, section, (name,), path, needed=True) for name in ("fx", "fy", "cx", "cy")]
    place = f"{side}_DISTO" if f"{side}_DISTO" in parser else section
    radial = [_number(parser, place, (name,), path) for name in RADIAL]  # k1 to k6
    tangential = [_number(parser, place, (name,), path) for name in ("p1", "p2")]
    K = intrinsic_matrix(np.array(pinhole), path)
    # The rule of zed-opencv-calibration: a wide lens has k1 to k4 and nothing else.
    if not any([*tangential, *radial[4:]]) and 0 not in radial[2:4]:
        return K, np.array(radial[:4]), Lens(FISHEYE)
    return K, np.array([*radial[:2], *tangential, *radial[2:]]), Lens(RADTAN)


def _number(
    parser: configparser.ConfigParser, section: str, names: tuple[str, ...], path: Path, needed: bool = False
) -> float:
    """The first of the entries that exists, or 0 if it is not needed."""
    for name in names:
        value = parser.get(section, name, fallback=None)
        if value is not None:
            return float(numbers([value], 1, f"[{section}] {name}", path)[0])
    if needed:
        raise DataError(f"[{section}]: expected a line {names[-1]}=", path)
    return 0.0
