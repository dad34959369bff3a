"""Trajectory files with a header that names the columns, or in the formats of KITTI, TUM and EuRoC.

A trajectory is an array (N, 4, 4) of poses `T_w_c`, which transform points from camera c to the world (for
KITTI, the first left camera). Positions are in metres, times in seconds.
"""

from __future__ import annotations

import csv
import math
import re
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..errors import DataError
from ..files import read_text, write_atomic
from ..geometry.motion import quaternion_from_rotation, rotation_from_quaternion
from ..geometry.types import Array
from .pose_columns import (
    HEADER_EXAMPLE,
    NANOSECONDS,
    PoseColumns,
    TimeColumn,
    find_header,
    is_comment,
    read_columns,
    separator_of,
    split_cells,
)
from .pose_times import (
    UNIT_NAMES,
    epoch_unit,
    is_plausible,
    likely_unit,
    median_interval,
    nearest_indices,
)

KITTI_ROW = "12 numbers, the upper 3×4 of a pose, row by row"
TUM_ROW = "8 numbers, t x y z qx qy qz qw"
EUROC_ORDER = "separated by commas, t in ns, x y z, qw qx qy qz"
EUROC_ROW = f"8 or more numbers {EUROC_ORDER}"
OF_BODY = "EuRoC's poses are those of the body (IMU), not of a camera: compare them with paths of the body."
POSE_NUMBERS = 7  # of a position and a quaternion
SEPARATOR_NAMES = {",": "commas", ";": "semicolons", "\t": "tabulators"}
_WHOLE_NUMBER = re.compile(r"\s*\d+(\.0*)?\s*,")  # the time in nanoseconds at the beginning of a row
_DECIMAL_COMMA = re.compile(r"\s*[-+]?\d*,\d+(?:[eE][-+]?\d+)?\s*")
# Numbers in a row: time and pose; with the velocity, as VINS writes them; with velocity and biases, as EuRoC.
EUROC_COLUMNS = (8, 11, 17)
# Largest deviation of an entry of R Rᵀ from the identity, and of a quaternion's length from 1: large enough
# for files with three digits, small enough to detect rows in another format.
ROTATION_TOLERANCE = 1e-2
TIME_TOLERANCE_S = 0.01  # largest time difference between corresponding poses
MAX_COORDINATE_M = 1e9  # a larger coordinate is not a position on Earth and overflows in later computations
TOO_FAR = f"a position beyond {MAX_COORDINATE_M:g} m"


def from_first(T: Array) -> Array:
    """The trajectory T_w_c (N, 4, 4) in the axes of its first pose, which becomes the identity."""
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
    rows, lines = read_number_rows(path, KITTI_ROW, 12)
    T = np.tile(np.eye(4), (len(rows), 1, 1))
    T[:, :3] = rows.reshape(-1, 3, 4)
    not_a_rotation = f"the 3×3 part is not a rotation; expected {KITTI_ROW}"
    _refuse_rows(~is_rotation(T[:, :3, :3]), not_a_rotation, path, lines)
    _refuse_rows(_is_too_far(T), TOO_FAR, path, lines)
    return T


def _is_too_far(T: Array) -> NDArray[np.bool_]:
    """Mask (N,) of the poses (N, 4, 4) with a coordinate that is not one on Earth."""
    return np.asarray(np.abs(T[:, :3, 3]).max(axis=1) > MAX_COORDINATE_M)


def read_tum(path: str | Path) -> tuple[Array, Array]:
    """Increasing times (N,) as written and poses T_w_c (N, 4, 4) in metres, N >= 1, from a TUM file.

    TUM's times are seconds. Lines that start with # are comments. Raises `DataError` with file and line if a
    row is not a time and a pose, or if the time does not increase.
    """
    rows, lines = read_number_rows(path, TUM_ROW, 8, comment="#")
    times = rows[:, 0]
    _refuse_not_increasing(times, lines, path)
    return times, _poses(rows[:, 1:], lines, path, TUM_ROW)


def read_euroc(path: str | Path) -> tuple[Array, Array]:
    """Times (N,) in seconds and body poses (N, 4, 4) from a EuRoC truth file; errors as in `read_tum`.

    A header with names for the columns decides their order and units.
    """
    header = find_header(read_text(path).splitlines())
    if header is not None:
        named = _read_named(path, header)
        if named.times is None:
            raise DataError(
                "the header names no time: expected a column such as timestamp [ns]", path, header
            )
        return named.times, named.poses
    rows, lines = read_number_rows(path, EUROC_ROW, 8, comment="#", separator=",")
    times = NANOSECONDS * rows[:, 0]
    _refuse_not_increasing(times, lines, path)
    qw_last = rows[:, [1, 2, 3, 5, 6, 7, 4]]
    return times, _poses(qw_last, lines, path, EUROC_ROW)


class PoseFile(NamedTuple):
    """Content of a pose file.

    Attributes
    ----------
    times : (N,) seconds, or None for a file without times, whose row k is frame k.
    poses : (N, 4, 4) `T_w_c`, metres, as the file has them: those of EuRoC's truth are of the body (IMU), not
        of the camera.
    notes : sentences on how the file was read, where the file itself does not say it.
    """

    times: Array | None
    poses: Array
    notes: tuple[str, ...] = ()


def read_path(path: Path) -> PoseFile:
    """Poses of a file with a header that names the columns, or in the format of KITTI, TUM or EuRoC.

    Without a header, the order of the numbers is known by convention: 12 numbers separated by blanks are
    KITTI's, 8 are TUM's, and a whole number of nanoseconds with 7, 10 or 16 further numbers, separated by
    commas, are EuRoC's (`EUROC_COLUMNS`).

    The size of times since 1970 tells their unit, in TUM's order and where a header names none. Times in
    EuRoC's order are refused if they are probably not nanoseconds. No other interval is checked here: see
    `pose_times.refuse_intervals`.

    Raises `DataError` for every other file, since its order cannot be known, and as `read_tum`.
    """
    lines = read_text(path).splitlines()
    header = find_header(lines)
    if header is not None:
        return _read_named(path, header)
    first = _first_row(lines)
    separator = separator_of(first.text)
    columns = len(first.text.split())
    if separator == "," and _is_euroc_row(first.text):
        times, poses = read_euroc(path)
        _refuse_other_unit(times / NANOSECONDS, path)
        note = f"{path}: no line names the columns; read in EuRoC's order, t in ns, x y z, qw qx qy qz."
        return PoseFile(times, poses, (note, f"{path}: {OF_BODY}"))
    if separator in (None, "\t") and columns in (0, 12):  # 0 for an empty file, refused as KITTI's
        return PoseFile(None, read_kitti_poses(path))
    if separator in (None, "\t") and columns == 8:
        return _with_unit(*read_tum(path), path)
    raise DataError(_unknown_order(first.text, separator), path, first.line)


class _TextRow(NamedTuple):
    """A line of a file, with its number counted from 1."""

    line: int
    text: str


def _first_row(lines: list[str]) -> _TextRow:
    """The first line that is neither empty nor a comment; an empty first line if there is none."""
    for line, text in enumerate(lines, start=1):
        if text.strip() and not is_comment(text):
            return _TextRow(line, text)
    return _TextRow(1, "")


def _with_unit(numbers: Array, poses: Array, path: Path) -> PoseFile:
    """The poses of a TUM file with their times, which become seconds if they count from 1970 in another unit.

    numbers : (N,) the times as written; their size tells the unit.

    Some systems write this order with the times of the images, as ORB-SLAM3 does for EuRoC.
    """
    unit = epoch_unit(numbers)
    interval = median_interval(numbers)
    # An hour in nanoseconds has the size of milliseconds since 1970, but not their interval. Such times stay
    # as written, and `refuse_intervals` refuses them.
    if unit == 1.0 or (interval is not None and not is_plausible(unit * interval)):
        return PoseFile(numbers, poses)
    note = f"{path}: the times are read as {UNIT_NAMES[unit]} since 1970."
    return PoseFile(unit * numbers, poses, (note,))


def _is_euroc_row(row: str) -> bool:
    """Whether a row begins with a whole number and has as many cells as EuRoC's rows."""
    return _WHOLE_NUMBER.match(row) is not None and _count_cells(row) in EUROC_COLUMNS


def _count_cells(row: str) -> int:
    """Number of the cells of a row separated by commas; a comma after the last one does not count."""
    return len(row.rstrip(" ,\r").split(","))


def _refuse_other_unit(numbers: Array, path: Path) -> None:
    """Raise `DataError` if the times (N,) of a file without a header are probably not nanoseconds."""
    interval = median_interval(numbers)
    if interval is None or is_plausible(NANOSECONDS * interval):
        return
    unit = likely_unit(interval)
    words = "" if unit is None else f", and these are probably {UNIT_NAMES.get(unit, 'seconds')}"
    raise DataError(
        f"no line names the columns, and in EuRoC's order the first is the time in nanoseconds{words}: name "
        f"the columns in a first line such as {HEADER_EXAMPLE!r}",
        path,
    )


def _unknown_order(row: str, separator: str | None) -> str:
    """The sentence for a file whose first row has no known order."""
    columns = f"{len(row.split())} columns"
    if separator is not None and len(row.split(separator)) >= POSE_NUMBERS:
        columns = f"{len(row.split(separator))} columns separated by {SEPARATOR_NAMES[separator]}"
    return (
        f"not a pose file: {columns}; expected {KITTI_ROW} (KITTI), {TUM_ROW} (TUM), 8, 11 or 17 "
        f"numbers {EUROC_ORDER} (EuRoC), or the names of the columns in a first line such as "
        f"{HEADER_EXAMPLE!r}"
    )


def _read_named(path: str | Path, header: int) -> PoseFile:
    """Poses of a file whose line `header`, counted from 1, names the columns."""
    lines = read_text(path).splitlines()
    rows = [
        _TextRow(line, text)
        for line, text in enumerate(lines[header:], start=header + 1)
        if text.strip() and not is_comment(text)
    ]
    if not rows:
        raise DataError("no rows below the header", path, header)
    separator = separator_of(rows[0].text)
    columns = read_columns(lines[header - 1], header, path, separator)
    table = _read_table(rows, separator, columns, path)
    notes = list[str]()
    skipped = len(rows) - len(table.lines)
    if skipped:
        notes.append(f"{path}: {skipped} rows without a pose are skipped.")
    if columns.is_euroc:
        notes.append(f"{path}: {OF_BODY}")
    position = columns.metres * table.pose[:, :3]
    quaternion = table.pose[:, 3:]
    names = " ".join(columns.names[place] for place in columns.quaternion)
    rows_in_metres = np.concatenate([position, quaternion], axis=1)
    poses = _poses(rows_in_metres, table.lines, path, f"{names} of length 1")
    time_columns = columns.time
    if columns.frame is not None and epoch_unit(table.before_pose[:, 0]) != 1.0:
        # Some data sets call the time of a frame, in nanoseconds since 1970, its number.
        time_columns = (TimeColumn(columns.frame, factor=None),)
    if time_columns:
        times, unit_notes = _sum_times(table.before_pose, time_columns, columns.names, path)
        _refuse_not_increasing(times, table.lines, path)
        return PoseFile(times, poses, (*notes, *unit_notes))
    if columns.frame is not None:
        _refuse_missing_frames(table.before_pose[:, 0], table.lines, path)
    elif skipped:
        raise DataError("rows without a pose in a file without times", path, header)
    notes.append(f"{path}: the header names no time, so row k is frame k.")
    return PoseFile(None, poses, tuple(notes))


class _Table(NamedTuple):
    """The N rows with a pose of a file with a header.

    Attributes
    ----------
    before_pose : (N, M) the time, in one or two columns, or the frame number; M is 0 without both.
    pose : (N, 7) x y z qx qy qz qw, positions in the unit of the file.
    lines : the line number of each row.
    """

    before_pose: Array
    pose: Array
    lines: list[int]


def _read_table(
    rows: list[_TextRow], separator: str | None, columns: PoseColumns, path: str | Path
) -> _Table:
    """The numbers of the rows with a pose."""
    lines = list[int]()
    values = list[list[float]]()
    for row in rows:
        words = _words_of_pose(row, separator, columns, path)
        if not any(words[-POSE_NUMBERS:]):
            continue  # a table of several topics has rows without a pose
        try:
            values.append([finite_number(word) for word in words])
        except ValueError as error:
            raise DataError(f"{error}; the header is in line {columns.line}", path, row.line) from None
        lines.append(row.line)
    if not values:
        raise DataError("no row has a pose", path, columns.line)
    numbers = np.array(values)  # in the order of `columns.places`, which ends with the pose
    return _Table(numbers[:, :-POSE_NUMBERS], numbers[:, -POSE_NUMBERS:], lines)


def _sum_times(
    numbers: Array, time_columns: tuple[TimeColumn, ...], names: tuple[str, ...], path: str | Path
) -> tuple[Array, list[str]]:
    """Times (N,) in seconds from the columns (N, M) of the time, and notes on units that were guessed.

    names : of all columns in the header.
    """
    times = np.zeros(len(numbers))
    notes = list[str]()
    for column, (place, factor) in enumerate(time_columns):
        unit = epoch_unit(numbers[:, column]) if factor is None else factor
        times += unit * numbers[:, column]
        if factor is None and unit != 1.0:
            notes.append(f"{path}: the numbers in {names[place]} are read as {UNIT_NAMES[unit]} since 1970.")
    return times, notes


def _words_of_pose(row: _TextRow, separator: str | None, columns: PoseColumns, path: str | Path) -> list[str]:
    """The cells of a row in the order of `columns.places`."""
    try:
        cells = split_cells(row.text, separator)
    except csv.Error as error:
        raise DataError(f"is not CSV: {error}", path, row.line) from None
    while len(cells) > len(columns.names) and not cells[-1]:
        cells.pop()  # some programs write a separator after the last number
    if len(cells) > len(columns.names):
        named = f"the header in line {columns.line} names {len(columns.names)}"
        raise DataError(f"{len(cells)} columns, but {named}", path, row.line)
    last = max(columns.places)
    if len(cells) <= last:
        named = f"the header in line {columns.line} names {columns.names[last]} as column {last + 1}"
        raise DataError(f"{len(cells)} columns, but {named}", path, row.line)
    return [cells[place] for place in columns.places]


def _refuse_not_increasing(times: Array, lines: list[int], path: str | Path) -> None:
    """Raise `DataError` with the line if times (N,) do not increase."""
    _refuse_rows(times[1:] <= times[:-1], "the time does not increase", path, lines[1:])


def _refuse_missing_frames(frames: Array, lines: list[int], path: str | Path) -> None:
    """Raise `DataError` with the line unless frame numbers (N,) are 0, 1, 2, …"""
    is_other = frames != np.arange(len(frames))
    expected = "expected 0, 1, 2, … for every frame, or a column with times"
    _refuse_rows(is_other, f"a file without times has other frame numbers: {expected}", path, lines)


def _poses(rows: Array, lines: list[int], path: str | Path, expected: str) -> Array:
    """Checked poses (N, 4, 4) of rows (N, 7): x y z qx qy qz qw.

    lines : line number of each row. expected : what a row should be, for the message.
    """
    with np.errstate(over="ignore"):
        length = np.linalg.norm(rows[:, 3:], axis=1)
    # An overflow gives an infinite length, which is refused like any other.
    has_length_1 = np.abs(length - 1.0) < ROTATION_TOLERANCE
    not_a_rotation = f"the quaternion does not have length 1; expected {expected}"
    _refuse_rows(~has_length_1, not_a_rotation, path, lines)
    T = np.tile(np.eye(4), (len(rows), 1, 1))
    T[:, :3, :3] = [rotation_from_quaternion(quaternion) for quaternion in rows[:, 3:]]
    T[:, :3, 3] = rows[:, :3]
    _refuse_rows(_is_too_far(T), TOO_FAR, path, lines)
    return T


def match_times(
    times_a: Array, times_b: Array, tolerance: float = TIME_TOLERANCE_S
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Indices into two arrays of increasing times, seconds: the pairs of nearest times within `tolerance`."""
    if len(times_a) > len(times_b):
        in_b, in_a = match_times(times_b, times_a, tolerance)
        return in_a, in_b
    nearest = nearest_indices(times_b, times_a)
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
    row_format = "%.9f" + " %.9e" * POSE_NUMBERS + "\n"
    rows = []
    for time, pose in zip(times, T, strict=True):
        # Adding zero turns -0 into 0, as in `format_kitti_poses`.
        position = pose[:3, 3] + 0.0
        quaternion = quaternion_from_rotation(pose[:3, :3]) + 0.0
        rows.append(row_format % (time, *position, *quaternion))
    return "".join(rows)


def _refuse_rows(invalid: NDArray[np.bool_], message: str, path: str | Path, lines: list[int]) -> None:
    """Raise `DataError` with the line of the first invalid row, if there is an invalid row.

    invalid : mask (N,) of rows. lines : line number of each row.
    """
    if invalid.any():
        raise DataError(message, path, lines[int(np.argmax(invalid))])


def read_number_rows(
    path: str | Path, expected: str, columns: int, comment: str | None = None, separator: str | None = None
) -> tuple[Array, list[int]]:
    """Finite numbers of a text table, (N, columns), and the line number of each row, counted from 1.

    Without a `separator`, numbers are separated by blanks. With a separator, a row may have further columns.

    Raises `DataError` with the line for another number of columns and for a word that is no finite number;
    the message ends in what a row should be, `expected`.
    """
    text = read_text(path)
    rows: list[list[float]] = []
    lines: list[int] = []
    for line_number, line in enumerate(text.rstrip().split("\n"), start=1):
        if comment is not None and line.lstrip().startswith(comment):
            continue
        words = line.split() if separator is None else line.strip().split(separator)
        has_further = separator is None and len(words) > columns
        if len(words) < columns or has_further:
            found = f"{len(words)} columns"
            if not any(words):
                found = "an empty line" if text.strip() else "an empty file"
            raise DataError(f"{found}; expected {expected}", path, line_number)
        try:
            rows.append([finite_number(word) for word in words[:columns]])
        except ValueError as error:
            raise DataError(f"{error}; expected {expected}", path, line_number) from None
        lines.append(line_number)
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
        comma = ", with a decimal comma instead of a point," if _DECIMAL_COMMA.fullmatch(word) else ""
        raise ValueError(f"{word[:20]!r}{comma} is not a finite number")
    return value
