"""RealSense: JSON with the intrinsics of both infrared cameras and their extrinsics, as users dump it.

`rs2_intrinsics` has width, height, fx, fy, ppx, ppy, model and coeffs; `rs2_extrinsics` has a rotation in
column-major order and a translation in metres, which take points from one camera to the other
(librealsense2/h/rs_types.h, rs_sensor.h). Of the lens models, brown_conrady and kannala_brandt4 are OpenCV's
pinhole and fisheye models; inverse_brown_conrady goes from raw to ideal pixels and has no counterpart there,
but its numbers are zero for the rectified infrared images of the D400 cameras.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from fetch.calibrations.values import common_size, image_size, intrinsic_matrix, numbers, rotation, side_of
from fetch.rectification import FISHEYE, RADTAN, Lens
from fetch.stereo_calibration import UNITS, FileCalibration
from vo_lib.errors import DataError
from vo_lib.geometry.types import Array

CENTRE_X = ("ppx", "cx")
CENTRE_Y = ("ppy", "cy")
COEFFICIENTS = ("coeffs", "distortion_coeffs", "coefficients", "distortion", "disto", "dist")
MODELS = [
    "none",
    "modified_brown_conrady",
    "inverse_brown_conrady",
    "ftheta",
    "brown_conrady",
    "kannala_brandt4",
]
ROTATION = ("rotation", "R", "rot")
TRANSLATION = ("translation", "T", "t", "trans")
PARALLEL = 1e-3  # largest element of R - I of cameras whose images are rectified, radians
BASELINE = re.compile(r"(stereo_?)?baseline(_?(?P<unit>m|cm|mm))?", re.IGNORECASE)


def _nodes(value: Any, place: str = "") -> Iterator[tuple[str, dict[str, Any]]]:
    """All objects in a JSON value, each with the names on the way to it."""
    if isinstance(value, dict):
        yield place, value
        for name, item in value.items():
            yield from _nodes(item, f"{place} {name}")
    elif isinstance(value, list):
        for item in value:
            label = item.get("name", "") if isinstance(item, dict) else ""
            yield from _nodes(item, f"{place} {label}")


def _first(node: dict[str, Any], names: tuple[str, ...]) -> Any:
    """The value under the first of these names that is there, or None."""
    return next((node[name] for name in names if name in node), None)


def _is_camera(node: dict[str, Any]) -> bool:
    """Whether an object has the intrinsics of a camera."""
    has_centre = _first(node, CENTRE_X) is not None and _first(node, CENTRE_Y) is not None
    return has_centre and {"fx", "fy"} <= node.keys()


def has_cameras(content: dict[str, Any]) -> bool:
    """Whether a JSON object has the intrinsics of a left and of a right camera."""
    sides = {side_of(place) for place, node in _nodes(content) if _is_camera(node)}
    return {0, 1} <= sides


def read_realsense(content: dict[str, Any], path: Path) -> FileCalibration:
    """The calibration of the left and the right camera; intrinsics of colour and depth are ignored."""
    nodes = list(_nodes(content))
    cameras = [(place, node) for place, node in nodes if _is_camera(node)]
    matrices: dict[str, Array] = {}
    sizes = []
    lenses = []
    for side, word in ((0, "left"), (1, "right")):
        chosen = [node for place, node in cameras if side_of(place) == side]
        if len(chosen) != 1:
            raise DataError(f"expected the intrinsics of one {word} camera, found {len(chosen)}", path)
        name = str(side + 1)
        matrices[f"K{name}"], matrices[f"D{name}"], lens = _camera(chosen[0], word, path)
        lenses.append(lens)
        if "width" in chosen[0]:
            sizes.append(image_size([chosen[0]["width"], chosen[0].get("height")], "width, height", path))
    matrices["R"], matrices["T"], unit = _extrinsics(nodes, path)
    size = common_size(sizes, path) if sizes else None
    return FileCalibration(matrices, path, size, unit, (lenses[0], lenses[1]))


def _camera(node: dict[str, Any], word: str, path: Path) -> tuple[Array, Array, Lens]:
    """K, D and the lens model of a camera; word : left or right, for messages."""
    values = [node["fx"], node["fy"], _first(node, CENTRE_X), _first(node, CENTRE_Y)]
    K = intrinsic_matrix(numbers(values, 4, f"{word}: fx, fy, ppx, ppy", path), path)
    coefficients = _first(node, COEFFICIENTS)
    D = np.zeros(5)
    if coefficients is not None:
        D = numbers(coefficients, (0, 4, 5, 8), f"{word}: coeffs", path)
        D = D if len(D) else np.zeros(5)
    given = node.get("model", node.get("distortion_model", "brown_conrady"))
    if isinstance(given, int) and 0 <= given < len(MODELS):
        given = MODELS[given]
    model = re.sub(r"[\s_]+", "_", str(given).lower().removeprefix("distortion.")).strip("_")
    if not D.any():
        lens = Lens(FISHEYE) if "kannala" in model else Lens(RADTAN)
        return K, np.zeros(5), lens
    if model in ("kannala_brandt4", "equidistant", "fisheye"):
        return K, D[:4], Lens(FISHEYE)
    if model in ("brown_conrady", "plumb_bob", "radtan"):
        return K, D, Lens(RADTAN)
    raise DataError(
        f"{word}: model {model} with coeffs other than 0: expected the rectified infrared images, or a model "
        "of OpenCV (brown_conrady, kannala_brandt4)",
        path,
    )


def _extrinsics(nodes: list[tuple[str, dict[str, Any]]], path: Path) -> tuple[Array, Array, float | None]:
    """R, T of points from the left to the right camera, and the unit of T, metres or None."""
    found = [
        (place, _first(node, ROTATION), _first(node, TRANSLATION))
        for place, node in nodes
        if _first(node, TRANSLATION) is not None
    ]
    # With colour and depth there are more extrinsics; those of the pair name both cameras.
    chosen = found
    if len(found) > 1:
        chosen = [item for item in found if _is_from_left_to_right(item[0])]
    baseline = None if found else _baseline(nodes, path)
    if baseline is not None:
        length, unit = baseline
        return np.eye(3), np.array([-length, 0.0, 0.0]), unit
    if len(chosen) != 1:
        words = "expected the extrinsics (rotation, translation) from the left to the right camera"
        raise DataError(f"{words}, found {len(chosen)}", path)
    _, R_value, t_value = chosen[0]
    t = numbers(t_value, 3, "translation", path)
    R = np.eye(3)
    if R_value is not None:
        nested = isinstance(R_value, list) and any(isinstance(row, list) for row in R_value)
        R = rotation(numbers(R_value, 9, "rotation", path), "rotation", path).T  # column by column
        if nested and np.abs(R - np.eye(3)).max() > PARALLEL:
            raise DataError(
                "rotation: three lists may be its rows or its columns: expected the nine numbers of "
                "rs2_extrinsics in one list (column by column)",
                path,
            )
    if t[0] > 0:  # from the right to the left camera, or the position of the right camera
        R = R.T
        t = -R @ t
    return R, t, 1.0


def _is_from_left_to_right(place: str) -> bool:
    """Whether a name such as `left_to_right` or `infra1_to_infra2` names both cameras in this order."""
    sides = [side_of(part) for part in re.split(r"_to|2_|->|\s", place.lower())]
    return [side for side in sides if side is not None] == [0, 1]


def _baseline(nodes: list[tuple[str, dict[str, Any]]], path: Path) -> tuple[float, float | None] | None:
    """The baseline without extrinsics, and its unit if its name tells."""
    for _, node in nodes:
        for name, value in node.items():
            match = BASELINE.fullmatch(name)
            if match is not None and not isinstance(value, (dict, list)):
                length = abs(float(numbers([value], 1, name, path)[0]))
                unit = UNITS[match["unit"].lower()] if match["unit"] else None
                return length, unit
    return None
