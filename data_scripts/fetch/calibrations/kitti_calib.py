"""KITTI's calib.txt and calib_cam_to_cam.txt: cameras 0 and 1 are grey, 2 and 3 colour.

The pair must be the one of the images: the colour cameras have another baseline than the grey ones.
"""

from __future__ import annotations

import re
from contextlib import suppress
from pathlib import Path

import numpy as np

from fetch.calibrations.values import common_size, image_size, refuse_impossible
from fetch.stereo_calibration import FileCalibration
from vo_lib.errors import DataError
from vo_lib.files import read_text
from vo_lib.geometry.types import Array

PAIRS = ((0, 1), (2, 3))
PROJECTION = re.compile(r"^(P[0-3]|P_rect_0[0-3]):", re.MULTILINE)
FOLDER = re.compile(r"image_0?([0-3])")


def is_kitti(text: str) -> bool:
    """Whether a text has the lines `P0:` or `P_rect_00:` of KITTI's calibrations."""
    return PROJECTION.search(text) is not None


def read_calibration_file(path: Path) -> dict[str, Array]:
    """The lines `name: numbers` of a KITTI calibration file; other lines are skipped."""
    values = {}
    for line in read_text(path).splitlines():
        name, _, rest = line.partition(":")
        with suppress(ValueError):  # a date
            values[name.strip()] = np.array([float(word) for word in rest.split()])
    return values


def matrix(matrices: dict[str, Array], name: str, shape: tuple[int, ...], path: Path) -> Array:
    """The matrix of a line, or `DataError`."""
    values = matrices.get(name, np.zeros(0))
    if len(values) != np.prod(shape):
        raise DataError(f"expected a line '{name}: ' with {np.prod(shape)} numbers", path)
    refuse_impossible(values, name, path)
    return values.reshape(shape)


def read_kitti(path: Path, folders: tuple[str, ...], size: tuple[int, int]) -> FileCalibration:
    """The calibration of the grey or the colour cameras, chosen by the folders of the images.

    Raw drives have unrectified images too, of the size S_00; they are rectified with K, D, R and T.
    """
    lines = read_calibration_file(path)
    form = "P{}"
    if any(f"P_rect_0{camera}" in lines for camera in range(4)):
        form = "P_rect_0{}"
    pairs = [pair for pair in PAIRS if any(form.format(camera) in lines for camera in pair)]
    if not pairs:
        pairs = [PAIRS[0]]  # so that the message names its lines
    pair = _pair(pairs, folders, path)
    if pair is None:  # nothing tells whether the images are grey or colour
        options = [_options(lines, form, each, path) for each in pairs]
        if len(set(options)) > 1:
            raise DataError(
                "has grey and colour cameras, and no folder is named image_2: "
                f"use {options[0]} for the grey images, {options[1]} for colour",
                path,
            )
        pair = pairs[0]
    P1, P2 = _projections(lines, form, pair, path)
    matrices = {"P1": P1, "P2": P2}
    rectified = _size(lines, "S_rect_0{}", pair, path)
    raw = _size(lines, "S_0{}", pair, path)
    if raw == size != rectified:
        return FileCalibration(_raw_matrices(lines, pair, path), path, raw, 1.0)
    return FileCalibration(matrices, path, rectified, 1.0)


def _size(lines: dict[str, Array], form: str, pair: tuple[int, int], path: Path) -> tuple[int, int] | None:
    """The size of the images of a pair; `form` : the names of its lines, with {} for the camera's number."""
    sizes = []
    for camera in pair:
        name = form.format(camera)
        if name in lines:
            sizes.append(image_size(lines[name].tolist(), name, path))
    return common_size(sizes, path) if sizes else None


def _pair(pairs: list[tuple[int, int]], folders: tuple[str, ...], path: Path) -> tuple[int, int] | None:
    """The cameras of the image folders; without names such as image_2, the only pair of the file, or None."""
    cameras = []
    for folder in folders:
        matches = [FOLDER.fullmatch(part) for part in Path(folder).parts]
        numbers = [int(match[1]) for match in matches if match is not None]
        cameras += numbers[-1:]
    if not cameras:
        return pairs[0] if len(pairs) == 1 else None
    pair = next((each for each in PAIRS if set(cameras) <= set(each)), None)
    if pair is None or (len(cameras) == 2 and len(set(cameras)) == 1):
        words = "are not a pair: image_0 goes with image_1, image_2 with image_3"
        raise DataError(f"{' and '.join(folders)} {words}", path)
    if pair not in pairs:
        raise DataError(f"expected lines for the cameras {pair[0]} and {pair[1]}", path)
    return pair


def _options(lines: dict[str, Array], form: str, pair: tuple[int, int], path: Path) -> str:
    """The options with the numbers of a rectified pair."""
    P1, P2 = _projections(lines, form, pair, path)
    baseline = (P1[0, 3] - P2[0, 3]) / P1[0, 0] if P1[0, 0] > 0 else 0.0
    return f"--focal {P1[0, 0]:.7g} --centre {P1[0, 2]:.7g},{P1[1, 2]:.7g} --baseline {baseline:.6g}"


def _projections(
    lines: dict[str, Array], form: str, pair: tuple[int, int], path: Path
) -> tuple[Array, Array]:
    """The matrices P (3, 4) of both cameras of a pair; `form` : their names, with {} for the number."""
    left, right = pair
    return matrix(lines, form.format(left), (3, 4), path), matrix(lines, form.format(right), (3, 4), path)


def _raw_matrices(lines: dict[str, Array], pair: tuple[int, int], path: Path) -> dict[str, Array]:
    """K, D of an unrectified pair, and R, T between its cameras; the file has those from camera 0 to each."""
    matrices: dict[str, Array] = {}
    R = []
    T = []
    for number, camera in zip("12", pair, strict=True):
        matrices[f"K{number}"] = matrix(lines, f"K_0{camera}", (3, 3), path)
        matrices[f"D{number}"] = matrix(lines, f"D_0{camera}", (5,), path)
        R.append(matrix(lines, f"R_0{camera}", (3, 3), path))
        T.append(matrix(lines, f"T_0{camera}", (3,), path))
    matrices["R"] = R[1] @ R[0].T
    matrices["T"] = T[1] - matrices["R"] @ T[0]
    return matrices
