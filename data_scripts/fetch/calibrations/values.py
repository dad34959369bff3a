"""Numbers, sizes and YAML of calibration files, with one-line errors."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from vo_lib.data.poses import is_rotation
from vo_lib.errors import DataError
from vo_lib.geometry.motion import nearest_rotation
from vo_lib.geometry.types import Array

MAX_CAMERA_NUMBER = 1e9  # pixels, millimetres
MAX_SIDE_PX = 100_000
MAX_BRACKETS = 1000  # opening brackets and dashes in a file; a calibration has a few dozen
LEFT = re.compile(r"left|(?<![a-z])l(?![a-z])|infra(red)?[_ ]?1|(?<![a-z])ir[_ ]?1|cam(era)?[_ ]?0", re.I)
RIGHT = re.compile(r"right|(?<![a-z])r(?![a-z])|infra(red)?[_ ]?2|(?<![a-z])ir[_ ]?2|cam(era)?[_ ]?1", re.I)
# PyYAML raises the built-in errors for invalid dates and for deep nesting.
YAML_ERRORS = (yaml.YAMLError, ValueError, TypeError, AttributeError, RecursionError)


class UnknownFile(DataError):
    """A file without anything that a known tool writes."""


class _Loader(yaml.SafeLoader):  # type: ignore[misc]
    """PyYAML's safe loader, which also reads OpenCV's matrices as mappings."""


def _matrix_mapping(loader: _Loader, node: yaml.MappingNode) -> dict[Any, Any]:
    """The mapping of a node with the tag of OpenCV's matrices."""
    mapping: dict[Any, Any] = loader.construct_mapping(node, deep=True)
    return mapping


_Loader.add_constructor("tag:yaml.org,2002:opencv-matrix", _matrix_mapping)


def too_deep(text: str) -> bool:
    """Whether a text has more brackets than a calibration; parsers read nested brackets by recursion."""
    opening = ("[", "{", "<", "- ", "-\t")
    return sum(text.count(bracket) for bracket in opening) > MAX_BRACKETS


def yaml_mapping(text: str) -> dict[Any, Any]:
    """The mapping in the first document of a YAML text; {} for any other text.

    OpenCV's first line `%YAML:1.0` is not YAML, and `rostopic echo` ends every message with `---`.
    """
    lines = text.splitlines()
    start = 1 if lines and lines[0].startswith("%YAML") else 0
    try:
        for document in yaml.load_all("\n".join(lines[start:]), _Loader):
            return document if isinstance(document, dict) else {}
    except YAML_ERRORS:
        pass
    return {}


def flat_numbers(value: Any) -> Iterator[float]:
    """All numbers of nested lists, or of a matrix's field `data`; raises ValueError for other content."""
    if isinstance(value, dict):
        value = value.get("data")
    if isinstance(value, bool) or value is None:
        raise ValueError
    if isinstance(value, (list, tuple)):
        for item in value:
            yield from flat_numbers(item)
    else:
        yield float(value)  # PyYAML reads 1e-05 as text


def numbers(value: Any, counts: int | tuple[int, ...], name: str, path: Path) -> Array:
    """The numbers (N,) of an entry, where N is one of `counts`; `DataError` for anything else."""
    allowed = (counts,) if isinstance(counts, int) else counts
    try:
        result = np.array(list(flat_numbers(value)))
    except (TypeError, ValueError, OverflowError):
        result = np.zeros(0)
    if len(result) not in allowed:
        words = " or ".join(map(str, allowed))
        raise DataError(f"{name}: expected {words} numbers in brackets", path)
    refuse_impossible(result, name, path)
    return result


def refuse_impossible(values: Array, name: str, path: Path) -> None:
    """Raise `DataError` with the first of an entry's numbers that is not finite or belongs to no camera."""
    impossible = values[~(np.abs(values) <= MAX_CAMERA_NUMBER)]  # also NaN
    if impossible.size:
        raise DataError(
            f"{name}: expected finite numbers up to {MAX_CAMERA_NUMBER:g}, found {impossible[0]:g}", path
        )


def image_size(value: Any, name: str, path: Path) -> tuple[int, int]:
    """Width and height from an entry with two whole numbers, or `DataError`."""
    width, height = numbers(value, 2, name, path).tolist()
    if not all(1 <= side <= MAX_SIDE_PX and side == int(side) for side in (width, height)):
        raise DataError(f"{name}: expected a width and a height, pixels", path)
    return int(width), int(height)


def common_size(sizes: list[tuple[int, int]], path: Path) -> tuple[int, int]:
    """The size that all cameras have, or `DataError`."""
    if len(set(sizes)) > 1:
        words = " and ".join(f"{width}×{height}" for width, height in sizes)
        raise DataError(f"the cameras have images of {words}: expected one size", path)
    return sizes[0]


def intrinsic_matrix(values: Array, path: Path) -> Array:
    """K (3, 3) of the numbers fx, fy, cx, cy; `DataError` for a focal length that is not positive."""
    fx, fy, cx, cy = values.tolist()
    if min(fx, fy) <= 0:
        raise DataError(f"fx {fx:g}, fy {fy:g}: expected focal lengths above 0 pixels", path)
    return np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])


def rotation(values: Array, name: str, path: Path) -> Array:
    """The rotation (3, 3) nearest to nine numbers, row by row; `DataError` if they are not a rotation."""
    R = values.reshape(3, 3)
    if not is_rotation(R):
        raise DataError(f"{name}: expected a rotation", path)
    return nearest_rotation(R)


def rigid_transform(value: Any, name: str, path: Path) -> tuple[Array, Array]:
    """Rotation (3, 3) and translation (3,) of a 4×4 matrix, row by row, or `DataError`."""
    T = numbers(value, 16, name, path).reshape(4, 4)
    if not is_rotation(T[:3, :3]) or np.abs(T[3] - [0, 0, 0, 1]).max() > 1e-6:
        raise DataError(f"{name} is not a pose: expected a rotation and a translation, row by row", path)
    return nearest_rotation(T[:3, :3]), T[:3, 3]


def side_of(text: str) -> int | None:
    """0 for a name of the left camera, 1 for the right one, None if the name does not tell."""
    left = bool(LEFT.search(text))
    right = bool(RIGHT.search(text))
    return None if left == right else int(right)
