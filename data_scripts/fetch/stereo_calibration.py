"""Calibration of a user's stereo camera, from numbers or OpenCV files, and rectification."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field, replace
from pathlib import Path

import cv2
import numpy as np

from vo_lib.data.kitti import MAX_BASELINE_M
from vo_lib.errors import DataError
from vo_lib.files import read_text
from vo_lib.geometry.types import Array, Image

# Names of each matrix in files of OpenCV's samples, of ORB-SLAM and of calibration tools, without capitals
# and underscores.
NAMES = {
    "K1": ("k1", "m1", "cameramatrix1", "left.k", "leftcameramatrix", "cameramatrixleft", "kl"),
    "D1": ("d1", "distcoeffs1", "dist1", "left.d", "leftdistcoeffs", "distcoeffsleft", "dl"),
    "R1": ("r1", "left.r", "rectificationleft", "rl"),
    "P1": ("p1", "left.p", "projectionleft", "pl"),
    "K2": ("k2", "m2", "cameramatrix2", "right.k", "rightcameramatrix", "cameramatrixright", "kr"),
    "D2": ("d2", "distcoeffs2", "dist2", "right.d", "rightdistcoeffs", "distcoeffsright", "dr"),
    "R2": ("r2", "right.r", "rectificationright", "rr"),
    "P2": ("p2", "right.p", "projectionright", "pr"),
    "R": ("r", "rotation"),
    "T": ("t", "translation"),
}
SHAPES = {"K": (3, 3), "R": (3, 3), "P": (3, 4), "T": (3,), "D": (-1,)}
DISTORTION_SIZES = (4, 5, 8, 12, 14)
MAX_CAMERA_NUMBER = 1e9  # pixels, millimetres
MAX_BRACKETS = 1000  # opening brackets and dashes in a file; a calibration has a few dozen


@dataclass(frozen=True)
class Rig:
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
    maps: tuple[tuple[Image, Image], tuple[Image, Image]] | None = None
    R1: Array = field(default_factory=lambda: np.eye(3))

    def rectify(self, left: Image, right: Image) -> tuple[Image, Image]:
        """The rectified images, (H, W) uint8 each; `DataError` for a size not in the calibration."""
        if self.maps is None:
            return left, right
        actual, expected = (f"{each.shape[1]}×{each.shape[0]}" for each in (left, self.maps[0][0]))
        if actual != expected:
            raise DataError(f"the images are {actual}, but the calibration is for {expected}")
        rectified = []
        for image, maps in zip((left, right), self.maps, strict=True):
            result = cv2.remap(image, *maps, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
            rectified.append(np.asarray(result, np.uint8))
        return rectified[0], rectified[1]


def read_opencv(paths: list[Path]) -> dict[str, Array]:
    """The matrices of NAMES in one or more OpenCV storage files (YAML, XML or JSON)."""
    matrices: dict[str, Array] = {}
    for path in paths:
        for name, matrix in _matrices(path).items():
            plain = name.lower().replace("_", "")
            for key, names in NAMES.items():
                if plain in names:
                    matrices[key] = _shaped(key, matrix, path)
    if not matrices:
        raise DataError("no calibration: expected OpenCV matrices K1 D1 K2 D2 R T, or P1 P2", paths[0])
    return matrices


def _matrices(path: Path) -> dict[str, Array]:
    text = read_text(path)
    # OpenCV reads nested brackets by recursion and crashes for deep nesting.
    if sum(map(text.count, ("[", "{", "<", "- ", "-\t"))) > MAX_BRACKETS:
        raise DataError("is not a stereo calibration: too many brackets", path)
    try:
        storage = cv2.FileStorage(text, cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY)
        root = storage.root()
        names = root.keys()
        nodes = {name: root.getNode(name) for name in names}
        return {
            name: _read_matrix(name, node, path)
            for name, node in nodes.items()
            if node.isMap() and "data" in node.keys()  # noqa: SIM118  (a FileNode is no dict)
        }
    except (cv2.error, SystemError):
        raise DataError("is not a file of OpenCV's FileStorage (YAML, XML or JSON)", path) from None


def _read_matrix(name: str, node: cv2.FileNode, path: Path) -> Array:
    """Matrix of a node after a check of the size: more than rows × cols numbers overflow OpenCV's buffer."""
    sizes = node.getNode("sizes")  # instead of rows and cols for a vector; in XML, a single size is a number
    if sizes.empty():
        sides = [node.getNode("rows"), node.getNode("cols")]
    else:
        sides = [sizes.at(i) for i in range(sizes.size())] if sizes.isSeq() else [sizes]
    shape = [int(side.real()) if side.isInt() else 0 for side in sides]
    kind = re.fullmatch(r"(\d?)[a-z]", node.getNode("dt").string())  # "2f": two numbers each
    count = node.getNode("data").size()
    if min(shape) < 1 or kind is None or count != math.prod(shape) * int(kind[1] or 1):
        raise DataError(f"{name}: expected rows, cols, dt and rows × cols numbers, found {count}", path)
    return np.asarray(node.mat(), np.float64)


def _shaped(name: str, matrix: Array, path: Path) -> Array:
    shape = SHAPES[name[0]]
    sizes = DISTORTION_SIZES if name[0] == "D" else (math.prod(shape),)
    if matrix.size not in sizes or not (np.abs(matrix) < MAX_CAMERA_NUMBER).all():
        raise DataError(f"{name}: expected {' or '.join(map(str, sizes))} finite numbers", path)
    return matrix.reshape(shape)


def rig_from_matrices(
    matrices: dict[str, Array], size: tuple[int, int], path: Path, rectified: bool = False, unit: float = 1.0
) -> Rig:
    """The rig with the given calibration matrices.

    The rectification is computed from K, D of both cameras and from R, T (`cv2.stereoRectify`, without border
    pixels), or is given by R1, P1, R2, P2. With P1 and P2 alone, the images must already be rectified.

    Parameters
    ----------
    size : width and height of the images, pixels.
    rectified : if true, the images are rectified, and only P1 and P2 are used.
    unit : unit of T, metres.
    """
    raw = {"K1", "D1", "K2", "D2"} <= matrices.keys()
    if not rectified and raw and {"R", "T"} <= matrices.keys():
        K1, D1, K2, D2, R, T = (matrices[name] for name in ("K1", "D1", "K2", "D2", "R", "T"))
        try:
            R1, R2, P1, P2 = cv2.stereoRectify(
                K1, D1, K2, D2, size, R, T.reshape(3, 1), flags=cv2.CALIB_ZERO_DISPARITY, alpha=0
            )[:4]
            computed = {"R1": R1, "R2": R2, "P1": P1, "P2": P2}
            if not all(np.isfinite(matrix).all() for matrix in computed.values()):
                raise ValueError
        except (cv2.error, ValueError):
            raise DataError("these matrices do not define a rectification", path) from None
        matrices = {**matrices, **{name: np.asarray(matrix, np.float64) for name, matrix in computed.items()}}
    if not {"P1", "P2"} <= matrices.keys():
        missing = ", ".join(sorted({"K1", "D1", "K2", "D2", "R", "T"} - matrices.keys()))
        expected_names = "P1 and P2" if rectified else f"{missing} (or P1 and P2 of rectified images)"
        raise DataError(f"the calibration lacks {expected_names}", path)
    P1, P2 = matrices["P1"], matrices["P2"]
    if abs(P2[1, 3]) > abs(P2[0, 3]):
        raise DataError("the second camera is above or below the first camera, not beside it", path)
    f = float(P1[0, 0])
    if f <= 0 or np.abs(P1[:, :3] - P2[:, :3]).max() > 1e-3 * f or abs(P1[1, 1] - f) > 1e-3 * f:
        raise DataError("P1 and P2 do not belong to a rectified pair: f, cx, cy must be equal", path)
    rig = rig_from_numbers(f, float(P1[0, 2]), float(P1[1, 2]), unit * float(-P2[0, 3] / f), path)
    if rectified or not raw or not {"R1", "R2"} <= matrices.keys():
        return rig
    return replace(rig, maps=(_maps(matrices, size, "1"), _maps(matrices, size, "2")), R1=matrices["R1"])


def _maps(matrices: dict[str, Array], size: tuple[int, int], camera: str) -> tuple[Image, Image]:
    K, D, R, P = (matrices[name + camera] for name in "KDRP")
    maps = cv2.initUndistortRectifyMap(K, D, R, P[:, :3], size, cv2.CV_16SC2)
    return maps[0], maps[1]  # type: ignore[return-value]


def rig_from_numbers(f: float, cx: float, cy: float, baseline: float, path: Path | None = None) -> Rig:
    """A rig from numbers in pixels and metres; `DataError` for impossible values."""
    if not np.isfinite([f, cx, cy, baseline]).all() or f <= 0:
        raise DataError(f"focal length {f:g} px, centre {cx:g},{cy:g} px: expected positive numbers", path)
    if baseline == 0:
        raise DataError("the baseline is 0 m: expected the distance between the two cameras", path)
    if abs(baseline) > MAX_BASELINE_M:
        raise DataError(
            f"the baseline is {abs(baseline):g} m: if the unit is millimetres, add --unit mm", path
        )
    return Rig(f, cx, cy, baseline)
