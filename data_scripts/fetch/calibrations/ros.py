"""ROS camera_info: the files left.yaml and right.yaml of camera_calibration, ost.txt, and printed messages.

D is the distortion of the raw image, R the rotation to the rectified axes, and P the projection of the
rectified camera. For the right camera P[0,3] is Tx = -f B, with the baseline B in metres; for the left one it
is 0 (https://docs.ros.org/en/api/sensor_msgs/html/msg/CameraInfo.html). D has OpenCV's order for plumb_bob (5
numbers) and rational_polynomial (8), and is the one of `cv2.fisheye` for equidistant (4).
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from fetch.calibrations.values import common_size, image_size, numbers, rotation, side_of
from fetch.rectification import FISHEYE, RADTAN, Lens
from fetch.stereo_calibration import FileCalibration
from vo_lib.errors import DataError
from vo_lib.geometry.types import Array

MODELS = {
    "plumb_bob": (RADTAN, (4, 5)),
    "rational_polynomial": (RADTAN, (8, 12, 14)),
    "thin_prism": (RADTAN, (12, 14)),
    "equidistant": (FISHEYE, (4,)),
    "kannala_brandt4": (FISHEYE, (4,)),
    "fisheye": (FISHEYE, (4,)),
}
MODEL_OF_COUNT = {4: "equidistant", 5: "plumb_bob"}  # by the number of coefficients
# The names in the files of camera_calibration, in messages of ROS 1, and in messages of ROS 2.
KEYS = {
    "K": ("camera_matrix", "K", "k"),
    "D": ("distortion_coefficients", "D", "d"),
    "R": ("rectification_matrix", "R", "r"),
    "P": ("projection_matrix", "P", "p"),
    "width": ("image_width", "width"),
    "height": ("image_height", "height"),
}
SAME_CAMERA = 1e-6  # of f: smaller distances between the cameras are zero


@dataclass(frozen=True, eq=False)
class CameraInfo:
    """One camera: K (3, 3), D (N,), R (3, 3), P (3, 4), image size, lens, and the file."""

    K: Array
    D: Array
    R: Array
    P: Array
    size: tuple[int, int]
    lens: Lens
    path: Path
    name: str = ""


def is_camera_info(content: dict[Any, Any]) -> bool:
    """Whether the mapping of a YAML file is a camera_info."""
    return all(_entry(content, key) is not None for key in ("K", "P", "width", "height"))


def _entry(content: dict[Any, Any], key: str) -> Any:
    """The value under the first of the names of `KEYS` that is there, or None."""
    return next((content[name] for name in KEYS[key] if name in content), None)


def parse_camera_info(content: dict[Any, Any], path: Path) -> CameraInfo:
    """A camera from the mapping of a YAML file; `DataError` for missing or impossible values."""
    model = str(content.get("distortion_model") or "plumb_bob")
    if model not in MODELS:
        raise DataError(f"distortion_model {model}: expected {', '.join(MODELS)}", path)
    lens, counts = MODELS[model]
    K = numbers(_entry(content, "K"), 9, "camera_matrix", path).reshape(3, 3)
    P = numbers(_entry(content, "P"), 12, "projection_matrix", path).reshape(3, 4)
    if K[0, 0] <= 0 or P[0, 0] <= 0:
        raise DataError("K and P are zero: the camera was not calibrated", path)
    D = numbers(_entry(content, "D"), (0, *counts), f"distortion_coefficients of {model}", path)
    values = numbers(_entry(content, "R"), 9, "rectification_matrix", path)
    sides = [_entry(content, "width"), _entry(content, "height")]
    size = image_size(sides, "image_width, image_height", path)
    _refuse_cropped(content, size, path)
    return CameraInfo(
        K,
        D if len(D) else np.zeros(counts[0]),
        rotation(values, "rectification_matrix", path),
        P,
        size,
        Lens(lens),
        path,
        str(content.get("camera_name", "")),
    )


def _refuse_cropped(content: dict[Any, Any], size: tuple[int, int], path: Path) -> None:
    """Raise `DataError` for a camera that reads only a part of its sensor, or joins its pixels."""
    # Zeros stand for the whole image.
    roi = content.get("roi")
    if not isinstance(roi, dict):
        roi = {}
    part = (roi.get("width") or size[0], roi.get("height") or size[1])
    is_shifted = bool(roi.get("x_offset") or roi.get("y_offset"))
    binning = (content.get("binning_x") or 1, content.get("binning_y") or 1)
    if is_shifted or part != size or binning != (1, 1):
        raise DataError("binning or roi: expected a calibration of the whole image", path)


def read_camera_infos(cameras: list[CameraInfo]) -> FileCalibration:
    """The calibration of two cameras; the right one has Tx below 0 in P, whatever the order of the files."""
    if len(cameras) != 2:
        path = cameras[0].path
        raise DataError(f"camera_info of {len(cameras)} camera: give the files of both, left and right", path)
    tx = [camera.P[0, 3] for camera in cameras]
    shift = tx[0] - tx[1]
    if abs(shift) < SAME_CAMERA * cameras[0].P[0, 0]:
        raise DataError(
            f"projection_matrix: Tx is {tx[0]:g} in both cameras, expected -f times the baseline in the "
            "right one: these are two single calibrations, not a stereo calibration",
            cameras[1].path,
        )
    left = cameras[0] if shift > 0 else cameras[1]
    right = cameras[1] if shift > 0 else cameras[0]
    notes = []
    for camera, side in ((left, 0), (right, 1)):
        named = side_of(camera.path.stem)
        if named is None:
            named = side_of(camera.name)
        if named is not None and named != side:
            place = "left" if side == 0 else "right"
            notes.append(f"by its P, {camera.path} belongs to the {place} camera")
    matrices: dict[str, Array] = {}
    for number, camera in (("1", left), ("2", right)):
        matrices |= {f"K{number}": camera.K, f"D{number}": camera.D}
        matrices |= {f"R{number}": camera.R, f"P{number}": camera.P}
    size = common_size([left.size, right.size], right.path)
    return FileCalibration(matrices, left.path, size, 1.0, (left.lens, right.lens), tuple(notes))


def is_ost(text: str) -> bool:
    """Whether a text is an ost.txt (INI) of camera_calibration."""
    return "[image]" in text and "camera matrix" in text and "projection" in text


def parse_ost(text: str, path: Path) -> list[CameraInfo]:
    """The cameras of an ost.txt, which has a section for each camera after the section [image].

    Raises `DataError` for a file without a section of a camera, or with an invalid one.
    """
    sections = re.split(r"^\[([^\]\n]+)\]\s*$", text, flags=re.MULTILINE)
    blocks = dict(zip(sections[1::2], sections[2::2], strict=True))
    head = blocks.pop("image", "")
    if not blocks:
        raise DataError("has no camera: expected lines such as [narrow_stereo/left], each by itself", path)
    image = {name: _after(head, name)[:1] for name in ("width", "height")}
    cameras = []
    for name, block in blocks.items():
        words = {"K": "camera matrix", "D": "distortion", "R": "rectification", "P": "projection"}
        values: dict[Any, Any] = {key: _after(block, word) for key, word in words.items()}
        values |= {key: value[0] if value else None for key, value in image.items()}
        model = MODEL_OF_COUNT.get(len(values["D"]), "rational_polynomial")
        cameras.append(parse_camera_info({**values, "distortion_model": model, "camera_name": name}, path))
    return cameras


def _after(block: str, word: str) -> list[str]:
    """The words in the lines after a line with this word, up to an empty line."""
    found = re.search(rf"^{word}[ \t]*\n((?:[^\n]*\S[^\n]*\n?)*)", block, re.MULTILINE)
    return found[1].split() if found else []
