"""Trajectory files in the formats of KITTI (12 numbers per row), TUM (t x y z qx qy qz qw) and EuRoC.

A trajectory is an array (N, 4, 4) of poses `T_w_c`, which transform points from camera c to the world (for
KITTI, the first left camera). Positions are in metres, times in seconds.
"""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..errors import DataError
from ..files import read_text, write_atomic
from ..geometry.motion import quaternion_from_rotation, rotation_from_quaternion
from ..geometry.types import Array

KITTI_ROW = "12 numbers, the upper 3×4 of a pose, row by row"
TUM_ROW = "8 numbers, t x y z qx qy qz qw"
EUROC_ROW = "8 or more numbers separated by commas, t in ns, x y z, qw qx qy qz"
_EMPTY, _EUROC = re.compile(r"\s*$|#"), re.compile(r"\s*\d+\s*,\s*[^\s,]+\s*,")  # rows of pose files
# Large enough for files with three digits, small enough to detect rows in another format.
ROTATION_TOLERANCE = 1e-2
TIME_TOLERANCE_S = 0.01  # largest time difference between corresponding poses
MAX_COORDINATE_M = 1e9  # a larger coordinate is not a position on Earth and overflows in later computations
TOO_FAR = f"a position beyond {MAX_COORDINATE_M:g} m"


def from_first(T: Array) -> Array:
    """The trajectory (N, 4, 4) in the axes of its first pose, which becomes the identity."""
    return np.asarray(np.linalg.inv(T[0]) @ T)


def is_rotation(R: Array) -> NDArray[np.bool_]:
    """Mask (...) of the matrices (..., 3, 3) that are rotations within `ROTATION_TOLERANCE`."""
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        deviation = np.abs(R @ np.swapaxes(R, -1, -2) - np.eye(3)).max(axis=(-2, -1))
        return np.asarray((deviation < ROTATION_TOLERANCE) & (np.linalg.det(R) > 0))


def read_kitti_poses(path: str | Path) -> Array:
    """Poses T_w_c (N, 4, 4) in metres, N >= 1, from a file in KITTI's format with one row per frame.

    Rotations are returned as written, not made orthonormal: KITTI's files have 7 digits. Raises `DataError`
    with file and line if a row is not a pose.
    """
    rows, lines = read_rows(path, KITTI_ROW, 12)
    T = np.tile(np.eye(4), (len(rows), 1, 1))
    T[:, :3] = rows.reshape(-1, 3, 4)
    _refuse(~is_rotation(T[:, :3, :3]), f"the 3×3 part is not a rotation; expected {KITTI_ROW}", path, lines)
    _refuse(np.abs(T[:, :3, 3]).max(axis=1) > MAX_COORDINATE_M, TOO_FAR, path, lines)
    return T


def read_tum(path: str | Path) -> tuple[Array, Array]:
    """Increasing times (N,) in seconds and poses T_w_c (N, 4, 4) in metres, N >= 1, from a TUM file.

    Lines that start with # are comments. Raises `DataError` with file and line if a row is not a time and a
    pose, or if the time does not increase.
    """
    return _timed_poses(*read_rows(path, TUM_ROW, 8, comment="#"), path, TUM_ROW)


def read_euroc(path: str | Path) -> tuple[Array, Array]:
    """Times (N,) in seconds and body poses (N, 4, 4) from a EuRoC truth file; errors as in `read_tum`."""
    rows, lines = read_rows(path, EUROC_ROW, 8, comment="#", separator=",")
    rows[:, 0] *= 1e-9
    return _timed_poses(rows[:, [0, 1, 2, 3, 5, 6, 7, 4]], lines, path, EUROC_ROW)


def read_path(path: Path) -> tuple[Array | None, Array]:
    """Times (N,) and poses (N, 4, 4) from a file in KITTI, TUM or EuRoC format; times are None for KITTI."""
    rows = (row for row in enumerate(read_text(path).splitlines(), start=1) if not _EMPTY.match(row[1]))
    number, first = next(rows, (1, ""))
    if _EUROC.match(first):
        return read_euroc(path)
    columns = len(first.split())
    if columns not in (0, 8, 12):
        expected = f"expected {KITTI_ROW} (KITTI), {TUM_ROW} (TUM), or {EUROC_ROW} (EuRoC)"
        raise DataError(f"not a pose file: {columns} columns; {expected}", path, number)
    return read_tum(path) if columns == 8 else (None, read_kitti_poses(path))


def _timed_poses(rows: Array, lines: list[int], path: str | Path, expected: str) -> tuple[Array, Array]:
    """Checked times (N,) and poses (N, 4, 4) of rows (N, 8) in TUM's order."""
    times = rows[:, 0]
    _refuse(times[1:] <= times[:-1], "the time does not increase", path, lines[1:])
    with np.errstate(over="ignore"):
        invalid = ~(np.abs(np.linalg.norm(rows[:, 4:], axis=1) - 1.0) < ROTATION_TOLERANCE)
    _refuse(invalid, f"the quaternion does not have length 1; expected {expected}", path, lines)
    T = np.tile(np.eye(4), (len(rows), 1, 1))
    T[:, :3, :3] = [rotation_from_quaternion(q) for q in rows[:, 4:]]
    T[:, :3, 3] = rows[:, 1:4]
    _refuse(np.abs(T[:, :3, 3]).max(axis=1) > MAX_COORDINATE_M, TOO_FAR, path, lines)
    return times, T


def match_times(
    times_a: Array, times_b: Array, tolerance: float = TIME_TOLERANCE_S
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Indices into two arrays of increasing times, seconds: the pairs of nearest times within `tolerance`."""
    few, many = (times_a, times_b) if len(times_a) <= len(times_b) else (times_b, times_a)
    after = np.clip(np.searchsorted(many, few), 1, max(len(many) - 1, 1))
    nearest = after - (np.abs(few - many[after - 1]) <= np.abs(few - many[np.minimum(after, len(many) - 1)]))
    close = np.flatnonzero(np.abs(few - many[nearest]) <= tolerance)
    # A pose has one partner at most: the nearest.
    nearest_first = close[np.argsort(np.abs(few - many[nearest])[close], kind="stable")]
    in_many, first = np.unique(nearest[nearest_first], return_index=True)
    in_few = nearest_first[first]
    return (in_few, in_many) if few is times_a else (in_many, in_few)


def format_kitti_poses(T: Array) -> str:
    """Text of poses (N, 4, 4) in KITTI's format, ten significant digits."""
    row = " ".join(["%.9e"] * 12) + "\n"
    # Adding zero turns -0 into 0, so that equal poses give equal text.
    return "".join(row % tuple(values) for values in T[:, :3].reshape(-1, 12) + 0.0)


def write_kitti_poses(path: str | Path, T: Array) -> None:
    """Write poses (N, 4, 4) in KITTI's format, atomically."""
    write_atomic(path, format_kitti_poses(T))


def format_tum(times: Array, T: Array) -> str:
    """Text of times (N,), seconds, and poses (N, 4, 4) in TUM's format: t x y z qx qy qz qw."""
    row = "%.9f" + " %.9e" * 7 + "\n"
    quaternions = [quaternion_from_rotation(R) for R in T[:, :3, :3]]
    return "".join(
        row % (t, *(p + 0.0), *(q + 0.0)) for t, p, q in zip(times, T[:, :3, 3], quaternions, strict=True)
    )


def _refuse(invalid: NDArray[np.bool_], message: str, path: str | Path, lines: list[int]) -> None:
    """Raise `DataError` with the line of the first invalid row, if there is an invalid row."""
    if invalid.any():
        raise DataError(message, path, lines[int(np.argmax(invalid))])


def read_rows(
    path: str | Path, expected: str, columns: int, comment: str | None = None, separator: str | None = None
) -> tuple[Array, list[int]]:
    """Finite numbers of a text table, (N, columns), and the line number of each row, counted from 1.

    Without a `separator`, numbers are separated by blanks. With a separator, a row may have further columns.
    """
    text = read_text(path)
    rows: list[list[float]] = []
    numbers: list[int] = []
    for number, line in enumerate(text.rstrip().split("\n"), start=1):
        words = line.split() if separator is None else line.strip().split(separator)
        if comment is not None and line.lstrip().startswith(comment):
            continue
        if len(words) < columns or (separator is None and len(words) > columns):
            blank = "an empty line" if text.strip() else "an empty file"
            content = f"{len(words)} columns" if any(words) else blank
            raise DataError(f"{content}; expected {expected}", path, number)
        try:
            rows.append([_number(word) for word in words[:columns]])
        except ValueError as error:
            raise DataError(f"{error}; expected {expected}", path, number) from None
        numbers.append(number)
    if not rows:
        raise DataError(f"no rows in the file; expected {expected}", path)
    return np.array(rows), numbers


def _number(word: str) -> float:
    try:
        value = math.nan if "_" in word else float(word)  # Python reads 1_0 as 10, other programs do not
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise ValueError(f"{word[:20]!r} is not a finite number")
    return value
