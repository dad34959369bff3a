"""Matrices of OpenCV: its FileStorage (YAML, XML, JSON) and NumPy archives (.npz) of tutorials.

The matrices are found by their names. As in `cv2.stereoCalibrate`, R and T take points from the first (left)
to the second camera. The unit of T is the one of the calibration target.
"""

from __future__ import annotations

import io
import math
import re
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from fetch.calibrations.values import (
    MAX_SIDE_PX,
    UnknownFile,
    flat_numbers,
    refuse_impossible,
    side_of,
    too_deep,
)
from fetch.rectification import FISHEYE, Lens
from fetch.stereo_calibration import FileCalibration
from vo_lib.data.poses import is_rotation
from vo_lib.errors import DataError
from vo_lib.files import read_bytes, read_text
from vo_lib.geometry.types import Array

SHAPES = {"K": (3, 3), "R": (3, 3), "P": (3, 4), "T": (3,), "D": (-1,)}
DISTORTION_SIZES = (4, 5, 8, 12, 14)
# Names of the matrices of one camera and of the pair in samples of OpenCV, in ORB-SLAM, in tutorials and in
# calibration tools, without capitals, dots, blanks and underscores; the camera is a word before or after.
KINDS = {
    "K": r"k|m|mtx|cm|cam(era)?m(atrix|at|tx)?|intrinsics?(m(atrix|at|tx))?",
    "D": r"d|dist(ortion)?(s|co?eff?s?|coefs?|coefficients?|vec(tor)?)?",
    "R": r"r|rect(ification)?(rot(ation)?|m(atrix|at|tx)|transform)?|rotationrect",
    "P": r"p|proj(ection)?(m(atrix|at|tx))?",
}
SIDES = r"(?:cam(?:era)?)?(0|1|2|l|r|left|right)"
PAIR = {
    "R": r"r|rot(ation)?(m(atrix|at|tx)|vec(tor)?)?|rvec|stereor",
    "T": r"t|tr(a?ns)?|tvec|trans(lation)?(vec(tor)?)?|stereot",
}
SIZE = re.compile(r"(left|right|camera|stereo)?(im(age|g)?(size|shape|dims?)|size|shape|resolution)", re.I)
WIDTH = re.compile(r"(left|right|camera\d?|image|img|im)?width", re.I)
HEIGHT = re.compile(r"(left|right|camera\d?|image|img|im)?height", re.I)
WIDE = re.compile(r"fisheye|equidistant|kannala", re.I)
SAME = 1e-9  # relative difference of one matrix under two names
EXPECTED = "expected OpenCV matrices K1 D1 K2 D2 R T, or P1 P2"


@dataclass(eq=False)
class Entries:
    """Matrices and texts of a file by their names."""

    path: Path
    matrices: dict[str, Array] = field(default_factory=dict)
    texts: dict[str, str] = field(default_factory=dict)


def read_matrices(files: list[Entries], size: tuple[int, int] | None = None) -> FileCalibration:
    """The calibration in one or more files; `DataError` without a known matrix or with two different ones.

    size : size of the images, which decides whether a size in the file is width, height or height, width.
    """
    matrices: dict[str, Array] = {}
    names: dict[str, str] = {}  # as in the files, for messages
    sizes: list[tuple[int, int]] = []
    for entries in files:
        zero_based = _counts_from_zero(entries)
        side = side_of(entries.path.stem)
        for name, values in entries.matrices.items():
            key = _key(_plain(name), zero_based, side)
            if key is None:
                continue
            new = _shaped(key, values, entries.path)
            if key in matrices and not _equal(matrices[key], new):
                words = f"{names[key]} and {name} are both {key} but differ"
                raise DataError(f"{words}: keep one of them", entries.path)
            matrices[key] = new
            names[key] = name
        sizes += _sizes(entries, size)
    path = files[0].path
    if not matrices:
        listed = ", ".join(list(files[0].matrices)[:12])
        also = f"; found {listed}" if listed else ""
        raise UnknownFile(f"no calibration: {EXPECTED}{also}", path)
    if len(set(sizes)) > 1:
        words = " and ".join(f"{width}×{height}" for width, height in dict.fromkeys(sizes))
        raise DataError(f"names images of {words}: expected one size", path)
    lens = Lens(FISHEYE) if any(_names_fisheye(entries) for entries in files) else Lens()
    return FileCalibration(matrices, path, sizes[0] if sizes else None, None, (lens, lens))


def _counts_from_zero(entries: Entries) -> bool:
    """Whether one of the names counts its cameras 0 and 1, not 1 and 2."""
    pattern = re.compile(r"(?<!\d)0$|^(cam)?0|cam(era)?0")
    return any(pattern.search(_plain(name)) for name in entries.matrices)


def _names_fisheye(entries: Entries) -> bool:
    """Whether a text of the file, or the name of a distortion such as D_LEFT_FE, tells of a fisheye lens."""
    in_texts = any(WIDE.search(f"{name} {text}") for name, text in entries.texts.items())
    plain_names = [_plain(name) for name in entries.matrices]
    return in_texts or any(name.startswith("d") and name.endswith("fe") for name in plain_names)


def _plain(name: str) -> str:
    """A name without capitals, blanks, dots, hyphens and underscores."""
    return re.sub(r"[\s_.\-]", "", name).lower()


def _key(name: str, zero_based: bool, side: int | None) -> str | None:
    """The name of a matrix in `FileCalibration`, or None for other content; `side` is the one of the file."""
    name = name.removesuffix("fe")  # D_LEFT_FE, fisheye
    for kind, words in PAIR.items():
        if re.fullmatch(words, name):
            return kind
    for kind, words in KINDS.items():
        camera = _camera_in(name, words)
        if zero_based and camera == "2":  # a third camera
            return None
        if camera is not None:
            is_second = camera[0] == "r" or camera == ("1" if zero_based else "2")
            return f"{kind}2" if is_second else f"{kind}1"
        if side is not None and kind != "R" and re.fullmatch(words, name):
            return f"{kind}{side + 1}"
    return None


def _camera_in(name: str, words: str) -> str | None:
    """The camera before or after one of the `words` (a pattern) in a plain name: 0, 1, 2, l, right, …"""
    match = re.fullmatch(rf"(?:{words}){SIDES}", name)
    if match is not None and match.lastindex is not None:
        return match[match.lastindex]  # the words have groups of their own, before that of the camera
    match = re.fullmatch(rf"{SIDES}(?:{words})", name)
    return None if match is None else match[1]


def _shaped(name: str, matrix: Array, path: Path) -> Array:
    """A matrix in the shape that its name in `FileCalibration` has, or `DataError`."""
    shape = SHAPES[name[0]]
    sizes = DISTORTION_SIZES if name[0] == "D" else (math.prod(shape),)
    if name == "R" and matrix.size == 3 and (np.abs(matrix) < 7).all():  # a rotation vector, radians
        return np.asarray(cv2.Rodrigues(matrix.reshape(3, 1).astype(np.float64))[0], np.float64)
    if matrix.size not in sizes:
        expected = " or ".join(map(str, sizes))
        raise DataError(f"{name}: expected {expected} numbers, found {matrix.size}", path)
    refuse_impossible(matrix, name, path)
    result = matrix.reshape(shape).astype(np.float64)
    if name[0] == "R" and not is_rotation(result):
        raise DataError(f"{name}: expected a rotation", path)
    return result


def _equal(a: Array, b: Array) -> bool:
    """Whether two matrices are equal but for rounding."""
    return a.shape == b.shape and bool(np.allclose(a, b, rtol=SAME, atol=SAME))


def _sizes(entries: Entries, size: tuple[int, int] | None) -> list[tuple[int, int]]:
    """Image sizes that a file names."""
    found = []
    widths = set()
    heights = set()
    for name, values in entries.matrices.items():
        plain = _plain(name)
        numbers = values.ravel()
        if SIZE.fullmatch(plain):
            found.append(numbers[:2])
        if WIDTH.fullmatch(plain) and len(numbers) == 1:
            widths.add(float(numbers[0]))
        if HEIGHT.fullmatch(plain) and len(numbers) == 1:
            heights.add(float(numbers[0]))
    if len(widths) == len(heights) == 1:
        found.append(np.array([*widths, *heights]))
    result = []
    for pair in found:
        if len(pair) == 2 and all(1 <= side <= MAX_SIDE_PX and side == int(side) for side in pair):
            width = int(pair[0])
            height = int(pair[1])
            if (height, width) == size:  # NumPy's shape is height, width
                result.append((height, width))
            else:
                result.append((width, height))
    return result


def nested_entries(mapping: dict[Any, Any], path: Path) -> Entries:
    """Matrices that a program dumped as nested lists into JSON or YAML, with the names of their camera."""
    entries = Entries(path)
    for name, value in _leaves(mapping):
        if isinstance(value, str):
            entries.texts[name] = value
            continue
        with suppress(TypeError, ValueError, OverflowError):
            entries.matrices[name] = np.array(list(flat_numbers(value)), np.float64)
    return entries


def _leaves(value: dict[Any, Any], place: str = "") -> Iterator[tuple[str, Any]]:
    """The values of nested mappings, with all names on the way to them; a mapping with `data` is a matrix."""
    for name, item in value.items():
        label = f"{place}_{name}" if place else str(name)
        if isinstance(item, dict) and "data" not in item:
            yield from _leaves(item, label)
        else:
            yield label, item


def has_matrices(entries: Entries) -> bool:
    """Whether one of the names is the one of a calibration matrix."""
    side = side_of(entries.path.stem)
    return any(
        values.size > 1 and _key(_plain(name), False, side) is not None
        for name, values in entries.matrices.items()
    )


def is_archive(data: bytes) -> bool:
    """Whether a file is a NumPy archive (a zip file)."""
    return data.startswith(b"PK\x03\x04")


def read_archive(path: Path) -> Entries:
    """The numeric arrays of a .npz file; objects, which need pickle, are refused."""
    entries = Entries(path)
    try:
        with np.load(io.BytesIO(read_bytes(path)), allow_pickle=False) as archive:
            for name in archive.files:
                array = _array(archive, name)
                if array is not None and array.dtype.kind in "iuf":
                    entries.matrices[name] = np.asarray(array, np.float64)
                elif array is not None and array.dtype.kind == "U" and array.size == 1:
                    entries.texts[name] = str(array.reshape(-1)[0])
    except (OSError, ValueError, EOFError, KeyError, zipfile.BadZipFile, zlib.error, NotImplementedError):
        raise DataError("is not a NumPy archive (.npz) that can be read", path) from None
    return entries


def _array(archive: Any, name: str) -> np.ndarray[Any, Any] | None:
    """An array of an archive; None for an array of objects, such as the corners of all images."""
    try:
        return np.asarray(archive[name])
    except ValueError as error:
        if "pickle" in str(error):
            return None
        raise


def read_storage(path: Path) -> Entries:
    """The matrices, numbers and texts at the top of a FileStorage file."""
    text = read_text(path)
    if too_deep(text):  # OpenCV crashes for deep nesting
        raise DataError("is not a stereo calibration: too many brackets", path)
    entries = Entries(path)
    try:
        storage = cv2.FileStorage(text, cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY)
        root = storage.root()
        for name in root.keys():  # noqa: SIM118  (a FileNode is no dict)
            node = root.getNode(name)
            if node.isMap() and "data" in node.keys():  # noqa: SIM118
                entries.matrices[name] = _read_matrix(name, node, path)
            elif node.isInt() or node.isReal():
                entries.matrices[name] = np.array([node.real()])
            elif _is_short_list(node):
                entries.matrices[name] = np.array([node.at(i).real() for i in range(node.size())])
            elif node.isString():
                entries.texts[name] = node.string()
    except (cv2.error, SystemError):
        raise UnknownFile("is not a file of OpenCV's FileStorage (YAML, XML or JSON)", path) from None
    return entries


def _is_short_list(node: cv2.FileNode) -> bool:
    """Whether a node is a list of up to 16 numbers, as a matrix without rows and cols."""
    if not node.isSeq() or not 0 < node.size() <= 16:
        return False
    return all(node.at(i).isInt() or node.at(i).isReal() for i in range(node.size()))


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
