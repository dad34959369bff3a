"""Pose files in the formats of KITTI and TUM, and NumPy arrays of poses.

A trajectory is an array (N, 4, 4) of poses `T_w_c`, which transform points from camera c to the world (for
KITTI, the first left camera). Positions are in metres, times in seconds. evo's `evo_traj` converts the
files of other systems.
"""

from __future__ import annotations

import math
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..errors import DataError
from ..files import open_binary, read_text, write_atomic
from ..geometry.motion import quaternion_from_rotation, rotation_from_quaternion
from ..geometry.types import Array, Index

KITTI_ROW = "12 numbers, the upper 3×4 of a pose, row by row"
POSE_ROW = "12 numbers (KITTI) or 8, t x y z qx qy qz qw (TUM); evo_traj … --save_as_tum converts others"
POSE_ARRAY = "an array (N, 4, 4) of poses; evo_traj … --save_as_tum converts files of other systems"
# Largest deviation of an entry of R Rᵀ from the identity, and of a quaternion's length from 1: large enough
# for files with three digits, small enough to detect rows in another format.
ROTATION_TOLERANCE = 1e-2
TIME_TOLERANCE_S = 0.01  # largest time difference between corresponding poses
FRAME_INTERVALS_S = (1e-3, 10.0)  # of a camera; those of times in nanoseconds or milliseconds are outside
ROUNDING = 0.01  # times since 1970 in seconds have steps of 2e-7 s, so an interval of 1 ms is not exact
MAX_COORDINATE_M = 1e9  # a larger coordinate is not a position on Earth and overflows in later computations


class PoseFile(NamedTuple):
    """Poses (N, 4, 4) `T_w_c`, metres, with times (N,) in seconds, or None where row k is frame k."""

    times: Array | None
    poses: Array


def from_first(T: Array) -> Array:
    """The trajectory T_w_c (N, 4, 4) in the axes of its first pose, which becomes the identity."""
    return np.asarray(np.linalg.inv(T[0]) @ T)


def is_rotation(R: Array) -> NDArray[np.bool_]:
    """Mask (...) of the matrices (..., 3, 3) that are rotations within `ROTATION_TOLERANCE`."""
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        deviation = np.abs(R @ np.swapaxes(R, -1, -2) - np.eye(3)).max(axis=(-2, -1))
        return np.asarray((deviation < ROTATION_TOLERANCE) & (np.linalg.det(R) > 0))


def read_poses(path: str | Path) -> PoseFile:
    """Poses, N >= 1, of a file in KITTI's or TUM's format, or of an array in a `.npy` file.

    Rotations are returned as written, not made orthonormal: KITTI's files have 7 digits. Comments (#) are
    skipped unread. Raises `DataError` with the line of the first row (in an array, the number of the first
    pose) that is no pose or whose time does not increase.
    """
    if Path(path).suffix == ".npy":
        return PoseFile(None, _read_array(path))
    rows, lines = read_number_rows(path, POSE_ROW, 8, 12)
    if rows.shape[1] == 12:
        return PoseFile(None, _kitti_poses(rows, lines, path, POSE_ROW))
    times = rows[:, 0]
    late = f"the time does not increase; expected {POSE_ROW}"
    _refuse(times[1:] <= times[:-1], late, path, lines[1:])
    with np.errstate(over="ignore"):
        length = np.linalg.norm(rows[:, 4:], axis=1)
    # An overflow gives an infinite length, which is refused like any other.
    wrong = f"the quaternion does not have length 1; expected {POSE_ROW}"
    _refuse(~(np.abs(length - 1.0) < ROTATION_TOLERANCE), wrong, path, lines)
    T = np.tile(np.eye(4), (len(rows), 1, 1))
    T[:, :3, :3] = [rotation_from_quaternion(quaternion) for quaternion in rows[:, 4:]]
    T[:, :3, 3] = rows[:, 1:4]
    _refuse_far(T, path, lines)
    return PoseFile(times, T)


def read_kitti_poses(path: str | Path) -> Array:
    """Poses T_w_c (N, 4, 4), N >= 1, of a file in KITTI's format alone; otherwise as `read_poses`."""
    rows, lines = read_number_rows(path, KITTI_ROW, 12)
    return _kitti_poses(rows, lines, path, KITTI_ROW)


def _kitti_poses(rows: Array, lines: list[int], path: str | Path, expected: str) -> Array:
    """Checked poses (N, 4, 4) of rows (N, 12) with these line numbers; `expected` : what a row should be."""
    T = np.tile(np.eye(4), (len(rows), 1, 1))
    T[:, :3] = rows.reshape(-1, 3, 4)
    _refuse(~is_rotation(T[:, :3, :3]), f"the 3×3 part is not a rotation; expected {expected}", path, lines)
    _refuse_far(T, path, lines)
    return T


def _read_array(path: str | Path) -> Array:
    """Checked poses (N, 4, 4) of a `.npy` file."""
    with open_binary(path) as file:
        try:
            array = np.load(file, allow_pickle=False)
            T = np.asarray(array).astype(np.float64, casting="same_kind")
        except Exception:  # NumPy's reader of a damaged header raises errors of many kinds
            raise DataError(f"is no array of numbers: expected {POSE_ARRAY}", path) from None
    if T.ndim != 3 or T.shape[1:] != (4, 4) or len(T) == 0:
        raise DataError(f"the array has the shape {T.shape}: expected {POSE_ARRAY}", path)
    is_pose = (
        is_rotation(T[:, :3, :3]) & np.isfinite(T).all(axis=(1, 2)) & (T[:, 3] == [0, 0, 0, 1]).all(axis=1)
    )
    if not is_pose.all():
        raise DataError(f"element {np.argmin(is_pose)} is no pose: expected {POSE_ARRAY}", path)
    _refuse_far(T, path, list(range(1, len(T) + 1)))
    return T


def _refuse(invalid: NDArray[np.bool_], fault: str, path: str | Path, lines: list[int]) -> None:
    """Raise `DataError` with the line of the first row in a mask (N,) of invalid ones."""
    if invalid.any():
        raise DataError(fault, path, lines[int(np.argmax(invalid))])


def _refuse_far(T: Array, path: str | Path, lines: list[int]) -> None:
    """Raise `DataError` for poses (N, 4, 4) with a coordinate that is not one on Earth."""
    is_far = np.abs(T[:, :3, 3]).max(axis=1) > MAX_COORDINATE_M
    _refuse(is_far, f"a position beyond {MAX_COORDINATE_M:g} m; expected {POSE_ROW}", path, lines)


def refuse_intervals(times: Array, path: str | Path) -> None:
    """Raise `DataError` if the median interval of times (N,) is not one of a camera, in seconds."""
    interval = float(np.median(np.diff(times))) if len(times) > 1 else FRAME_INTERVALS_S[1]
    shortest, longest = FRAME_INTERVALS_S
    if not shortest * (1 - ROUNDING) <= interval <= longest * (1 + ROUNDING):
        expected = f"expected {shortest:g} to {longest:g} s from frame to frame"
        raise DataError(f"the median interval of the times is {interval:.6g} s: {expected}", path)


def match_times(times_a: Array, times_b: Array, tolerance: float = TIME_TOLERANCE_S) -> tuple[Index, Index]:
    """Indices into two arrays of increasing times, seconds: the pairs of nearest times within `tolerance`."""
    if len(times_a) > len(times_b):
        in_b, in_a = match_times(times_b, times_a, tolerance)
        return in_a, in_b
    # The nearest time is one of two neighbours: the last one before a time, or the first one after it.
    after = np.clip(np.searchsorted(times_b, times_a), min(1, len(times_b) - 1), len(times_b) - 1)
    before = np.maximum(after - 1, 0)
    is_before = np.abs(times_a - times_b[before]) <= np.abs(times_a - times_b[after])
    nearest = np.where(is_before, before, after)
    distances = np.abs(times_a - times_b[nearest])
    close = np.flatnonzero(distances <= tolerance)
    # A pose has one partner at most, the nearest: of equal indices, `unique` takes the first.
    by_distance = close[np.argsort(distances[close], kind="stable")]
    in_b, chosen = np.unique(nearest[by_distance], return_index=True)
    return by_distance[chosen], in_b


def format_kitti_poses(T: Array) -> str:
    """Text of poses (N, 4, 4) in KITTI's format, ten significant digits."""
    row_format = " ".join(["%.9e"] * 12) + "\n"
    # Adding zero turns -0 into 0, so that equal poses give equal text.
    rows = T[:, :3].reshape(-1, 12) + 0.0
    return "".join(row_format % tuple(row) for row in rows)


def write_kitti_poses(path: str | Path, T: Array) -> None:
    """Write poses (N, 4, 4) in KITTI's format, atomically."""
    write_atomic(path, format_kitti_poses(T))


def format_tum(times: Array, T: Array) -> str:
    """Text of times (N,), seconds, and poses (N, 4, 4) in TUM's format: t x y z qx qy qz qw."""
    row_format = "%.9f" + " %.9e" * 7 + "\n"
    rows = []
    for time, pose in zip(times, T, strict=True):
        # Adding zero turns -0 into 0, as in `format_kitti_poses`.
        position = pose[:3, 3] + 0.0
        quaternion = quaternion_from_rotation(pose[:3, :3]) + 0.0
        rows.append(row_format % (time, *position, *quaternion))
    return "".join(rows)


def read_number_rows(path: str | Path, expected: str, *counts: int) -> tuple[Array, list[int]]:
    """Finite numbers of a text table (N, M), and the line number of each row, counted from 1.

    counts : possible M; all rows have that of the first. Numbers are separated by blanks, and comments (#)
    are skipped unread. Raises `DataError` with the line for a row of another length and for a word that is
    no finite number; the message ends in what a row should be, `expected`.
    """
    rows: list[list[float]] = []
    lines: list[int] = []
    text = read_text(path).rstrip()
    for number, line in enumerate(text.split("\n") if text else [], start=1):
        if line.lstrip().startswith("#"):
            continue
        words = line.split()
        if len(words) not in counts or (rows and len(words) != len(rows[0])):
            found = f"{len(words)} columns" if words else "an empty line"
            raise DataError(f"{found}; expected {expected}", path, number)
        try:
            rows.append([finite_number(word) for word in words])
        except ValueError as error:
            raise DataError(f"{error}; expected {expected}", path, number) from None
        lines.append(number)
    if not rows:
        raise DataError(f"no rows in the file; expected {expected}", path)
    return np.array(rows), lines


def finite_number(word: str) -> float:
    """The number in a word; `ValueError` for a word that is none, and for NaN and infinity."""
    value = math.nan
    if "_" not in word:  # Python reads 1_0 as 10, other programs do not
        with suppress(ValueError):
            value = float(word)
    if not math.isfinite(value):
        raise ValueError(f"{ascii(word)[:20]} is not a finite number")
    return value
