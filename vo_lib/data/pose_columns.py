"""Columns of a pose file by the names in its header: CSV files of data sets, odometry systems and ROS.

A header decides the order of the numbers and their units. Names of one column are, for example, `tx`,
`p_RS_R_x [m]`, `pose.position.x` or `/odom/pose/pose/orientation/w`.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from ..errors import DataError

HEADER_EXAMPLE = "# timestamp [s] tx ty tz qx qy qz qw"
POSITION = ("x", "y", "z")
QUATERNION = ("qx", "qy", "qz", "qw")
NANOSECONDS = 1e-9
SEPARATORS = (";", ",", "\t")

_SECONDS = {
    1.0: ("s", "sec", "secs", "second", "seconds"),
    1e-3: ("ms", "msec", "msecs", "millis", "millisec", "milliseconds"),
    1e-6: ("us", "µs", "μs", "usec", "usecs", "micros", "microsec", "microseconds"),
    NANOSECONDS: ("ns", "nsec", "nsecs", "nanos", "nanosec", "nanosecs", "nanoseconds"),
}
_METRES = {
    1.0: ("m", "meter", "meters", "metre", "metres"),
    1e-2: ("cm", "centimeters", "centimetres"),
    1e-3: ("mm", "millimeters", "millimetres"),
    1e3: ("km", "kilometers", "kilometres"),
}
TIME_UNITS = {word: factor for factor, words in _SECONDS.items() for word in words}
LENGTH_UNITS = {word: factor for factor, words in _METRES.items() for word in words}
# ROS 1 and 2 write one time in two columns.
_WHOLE_SECONDS = ("sec", "secs")
_REST_NANOSECONDS = ("nsec", "nsecs", "nanosec", "nanosecs")

_TIME_WORDS = {"time", "times", "timestamp", "timestamps", "stamp", "t", "ts"}
_CLOCKS = {"utc", "unix", "epoch", "posix", "gps", "ros"}  # in brackets, but no unit
_LONG_UNITS = {"min", "mins", "minute", "minutes", "h", "hr", "hrs", "hour", "hours", "day", "days"}
_FRAME_WORDS = {"frame", "frames", "id", "idx", "index", "num", "number", "image", "seq"}
_POSITION_WORDS = {"p", "t", "pos", "position", "trans", "translation", "loc", "location", "pose"}
_QUATERNION_WORDS = {"q", "quat", "quaternion", "orientation", "ori", "rotation", "rot"}
# Columns with one of these words have no part of a pose, although they may end in x, y or z.
_VELOCITY_WORDS = {"vel", "velocity", "linear", "angular", "twist", "omega"}
_SENSOR_WORDS = {"acc", "accel", "acceleration", "gyro", "mag", "bias", "gravity"}
_UNCERTAINTY_WORDS = {"cov", "covariance", "std", "sigma", "var", "error"}
_OTHER_WORDS = _VELOCITY_WORDS | _SENSOR_WORDS | _UNCERTAINTY_WORDS
EUROC_OTHER = ("v_", "b_")  # velocities and biases in EuRoC's files
_ANGLE_WORDS = {"roll", "pitch", "yaw", "euler", "heading", "rotvec", "rx", "ry", "rz"}
# Entries of a matrix, r11, rot_00 or T00, and of a quaternion whose order is not said, q0. The pattern is for
# the words of a name, "r 11".
_NUMBERED_ENTRY = re.compile(r"(r|rot|t|m|q) ?\d ?\d?")
# A word with the axis at its end: qx, quatw, tx or posz.
_WORD_WITH_AXIS = re.compile(
    r"(?:q|quat|quaternion|orientation|ori|rotation|rot)(?P<quaternion_axis>[xyzw])"
    r"|(?:t|p|pos|position|trans|translation|loc|location)(?P<position_axis>[xyz])"
)
# Names of poses from the world to the camera (c), the body (b) or the IMU (i), which are refused. The pattern
# is for the words of a name, such as "t cw x" for t_cw_x and "w 2 c" for w2c.
_PART = r"(?:t|p|q|r|rot|rotation|trans|translation|pos|position|pose|quat|quaternion|orientation|ori)"
_WORLD_TO_CAMERA = re.compile(
    rf"\b{_PART} ?[cbi] ?w\b"  # t_cw_x, Tcw, q_bw_w
    r"|\b(?:q[xyzw]|[tp]?[xyz]) [cbi]w\b"  # qw_cw, tx_cw, x_iw
    r"|\b(?:world|w|map) ?(?:to|2) ?(?:cam|camera|c|body|b|imu|i|sensor)\b"  # world_to_cam_x, w2c, map2body
    r"|\b(?:cam|camera|body|imu|sensor) (?:\d )?(?:from )?world\b"  # cam_from_world, cam0_from_world
    r"|\bextrinsics?\b"  # extrinsic_tx
    r"|\bview ?matrix\b"  # view_matrix, viewMatrix
)
# The same said anywhere in the header. It does not count if the header also names the other direction, as in
# "camera to world, not world to camera".
_STATED_WORLD_TO_CAMERA = re.compile(
    r"\b(?:world (?:to|2) (?:the )?cam(?:era)?"  # poses from world to camera
    r"|w 2 c"  # w2c
    r"|t ?cw)\b"  # T_cw or Tcw
)
_CAMERA_TO_WORLD = re.compile(
    r"\b(?:cam(?:era)? (?:to|2) (?:the )?world"  # poses from camera to world
    r"|c 2 w"  # c2w
    r"|t ?wc)\b"  # T_wc or Twc
)
_AXES = set("xyzw")
_COMMENT = re.compile(r"\s*[\"']?\s*[#%]+")  # the beginning of a comment, as in # t x y z or "% t x y z"
_UNIT = re.compile(r"[\[(]([^\])]*)[\])]")  # a unit in brackets, as in time [ns] or x (m)


class Column(NamedTuple):
    """A column: its place in a row, its name as written, the words of the name, and the unit or ""."""

    place: int
    name: str
    words: tuple[str, ...]
    unit: str


class TimeColumn(NamedTuple):
    """A column that is the time or a part of it: its place in a row, and the factor from its unit to seconds.

    The factor is None if the header does not name the unit.
    """

    place: int
    factor: float | None


@dataclass(frozen=True)
class PoseColumns:
    """Places of a pose in a row; a place is counted from 0.

    Attributes
    ----------
    line : line of the header, counted from 1. names : all names of the header.
    position : places of x, y, z. metres : factor from the unit of x, y, z to metres.
    quaternion : places of x, y, z, w.
    time : the columns whose sum is the time; empty without a time.
    frame : place of a column with frame numbers, in a file without times; otherwise None.
    is_euroc : whether the names are those of EuRoC's truth.
    """

    line: int
    names: tuple[str, ...]
    position: tuple[int, ...]
    metres: float
    quaternion: tuple[int, ...]
    time: tuple[TimeColumn, ...]
    frame: int | None
    is_euroc: bool

    @property
    def places(self) -> tuple[int, ...]:
        """Places of the needed columns: the time or the frame number, x y z, then qx qy qz qw."""
        first = [column.place for column in self.time]
        if self.frame is not None:
            first = [self.frame]
        return (*first, *self.position, *self.quaternion)


def find_header(lines: Sequence[str]) -> int | None:
    """Number, from 1, of the line that names the columns of a pose; None if a convention must decide.

    This may be one of the comments at the beginning of a file, or the first line that is no comment. Of
    several such lines, the last counts.
    """
    header = None
    for line_number, line in enumerate(lines, start=1):
        if not line.strip():
            continue
        if _world_to_camera_names(_columns(line, None)):
            return line_number  # whatever a later line names, the poses are refused
        if _names_a_pose(line):
            header = line_number
        if not _COMMENT.match(line):
            break
    return header


def is_comment(line: str) -> bool:
    """Whether a line is a comment, which begins with # or %."""
    return _COMMENT.match(line) is not None


def separator_of(row: str) -> str | None:
    """The character between the numbers of a row: a semicolon, a comma or a tabulator; None for blanks."""
    for separator in SEPARATORS:
        if separator in row:
            return separator
    return None


def split_cells(line: str, separator: str | None) -> list[str]:
    """The cells of a line without blanks and quotation marks around them; raises `csv.Error`."""
    if separator is None:
        return [word.strip("\"'") for word in line.split()]
    rows = csv.reader([line.strip(" \r\n")], delimiter=separator, skipinitialspace=True)
    cells = next(rows)
    return [cell.strip() for cell in cells]


def read_columns(line: str, line_number: int, path: str | Path, separator: str | None) -> PoseColumns:
    """The columns that a header names.

    separator : the character between the cells of the rows below, None for blanks.

    Raises `DataError` with the line if a part of the pose is missing, is named twice, or is given as angles
    or as a matrix; if its poses are from the world to the camera; and for a unit that is not known.
    """
    columns = _columns(line, separator)
    _refuse_colmap(columns, path, line_number)
    _refuse_world_to_camera(columns, path, line_number)
    candidates: dict[str, list[Column]] = {}
    for column in columns:
        role = _role(column)
        if role is not None:
            candidates.setdefault(role, []).append(column)
    missing = [name for name in (*POSITION, *QUATERNION) if name not in candidates]
    if missing:
        raise DataError(_incomplete(columns, missing), path, line_number)
    chosen = _one_trajectory(candidates, path, line_number)
    time = _time_columns(columns, path, line_number)
    return PoseColumns(
        line=line_number,
        names=tuple(column.name for column in columns),
        position=tuple(chosen[name].place for name in POSITION),
        metres=_metres_per_unit([chosen[name] for name in POSITION], path, line_number),
        quaternion=tuple(chosen[name].place for name in QUATERNION),
        time=time,
        frame=None if time else _frame_column(columns),
        is_euroc=_is_euroc(columns),
    )


def _columns(line: str, separator: str | None) -> list[Column]:
    """All columns of a header, whose cells may be separated in another way than those of the rows."""
    text = _COMMENT.sub("", line, count=1) if is_comment(line) else line
    cells = list[str]()
    if separator is not None:
        with suppress(csv.Error):
            cells = split_cells(text, separator)
    if len(cells) < len(POSITION) + len(QUATERNION):  # too few: the header has other separators than the rows
        # A unit belongs to the name before it: "timestamp [ns] tx".
        cells = re.sub(r"\s+(?=[\[(])", "", text).replace(",", " ").replace(";", " ").split()
    columns = []
    for place, name in enumerate(cells):
        words, unit = _words_and_unit(name)
        columns.append(Column(place, name.strip("\"' "), words, unit))
    return columns


def _words_and_unit(name: str) -> tuple[tuple[str, ...], str]:
    """The words of a name in lower case, and its unit: from brackets or, as in time_ns, the last word."""
    bracket = _UNIT.search(name)
    unit = ""
    if bracket is not None and not bracket[1].strip().isdigit():  # quaternion[0] is no unit
        unit = bracket[1].strip().lower()
        name = name.replace(bracket[0], " ")
    separate = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", name).lower()
    words = re.findall(r"[a-zµμ]+|\d+", separate)
    if not unit and len(words) > 1 and words[-1] in TIME_UNITS | LENGTH_UNITS:
        unit = words.pop()
    if len(words) == 1 and len(words[0]) > 1 and words[0] in TIME_UNITS:
        return ("time",), words[0]  # columns such as sec and nsec
    return tuple(words), unit


def _role(column: Column) -> str | None:
    """The part of a pose in a column: x, y, z, qx, qy, qz or qw; None for every other column."""
    words = column.words
    if _OTHER_WORDS.intersection(words) or column.name.lower().startswith(EUROC_OTHER):
        return None
    for word in words:
        with_axis = _WORD_WITH_AXIS.fullmatch(word)
        if with_axis is None:
            continue
        if with_axis["quaternion_axis"]:
            return f"q{with_axis['quaternion_axis']}"
        return with_axis["position_axis"]
    # The axis may also be a word of its own, the last one: orientation.w, pos_x or x.
    axes = [word for word in words if word in _AXES]
    if len(axes) != 1 or words[-1] != axes[0]:
        return None
    if _QUATERNION_WORDS.intersection(words):
        return f"q{axes[0]}"
    if axes[0] in POSITION and (len(words) == 1 or _POSITION_WORDS.intersection(words)):
        return axes[0]
    return None


def _names_a_pose(line: str) -> bool:
    """Whether a line has names for a position or an orientation, also for those that are refused."""
    for separator in (*SEPARATORS, None):
        columns = _columns(line, separator)
        roles = {_role(column) for column in columns}
        if roles.issuperset(POSITION) or not roles.isdisjoint(QUATERNION):
            return True
        # `find_header` has tested names without blanks; between commas, a name may have some.
        if _world_to_camera_names(columns):
            return True
    return False


def _incomplete(columns: list[Column], missing: list[str]) -> str:
    """The sentence for a header without a part of the pose."""
    rotation = [
        column.name
        for column in columns
        if _ANGLE_WORDS.intersection(column.words) or _NUMBERED_ENTRY.fullmatch(" ".join(column.words))
    ]
    if rotation and set(QUATERNION).issuperset(missing):
        names = ", ".join(rotation[:3])
        return (
            f"the rotation is given as {names}, whose convention the header does not say: convert it to a "
            f"quaternion with the columns {' '.join(QUATERNION)}"
        )
    example = HEADER_EXAMPLE.removeprefix("# ")
    return f"the header does not name {' '.join(missing)}: expected columns such as {example}"


def _one_trajectory(
    candidates: dict[str, list[Column]], path: str | Path, line_number: int
) -> dict[str, Column]:
    """The column for each part of the pose; `DataError` if the header names several trajectories.

    candidates : the columns that may be a part, by part.
    """
    if all(len(columns) == 1 for columns in candidates.values()):
        return {role: columns[0] for role, columns in candidates.items()}
    # Columns of one trajectory have the same words beside those for the part, such as `odom` or `ecef`.
    trajectories: dict[tuple[str, ...], dict[str, Column]] = {}
    for role, columns in candidates.items():
        for column in columns:
            trajectory = trajectories.setdefault(_words_of_trajectory(column), {})
            if role in trajectory:
                raise DataError(f"the header names {column.name} twice", path, line_number)
            trajectory[role] = column
    # Positions from the centre of the Earth stand beside positions in the world of the drive.
    complete_local = [
        trajectory
        for words, trajectory in trajectories.items()
        if len(trajectory) == len(candidates) and "ecef" not in words
    ]
    if len(complete_local) != 1:
        two = " and ".join(column.name for column in candidates["x"][:2])
        raise DataError(f"the header names several paths, {two}: keep the columns of one", path, line_number)
    return complete_local[0]


def _words_of_trajectory(column: Column) -> tuple[str, ...]:
    """The words of a name without its axis and its kind, such as ("odom",) of odom.pose.position.x."""
    kinds = _POSITION_WORDS | _QUATERNION_WORDS | _AXES
    return tuple(word for word in column.words if word not in kinds and not _WORD_WITH_AXIS.fullmatch(word))


def _metres_per_unit(columns: list[Column], path: str | Path, line_number: int) -> float:
    """The factor from the unit of the positions to metres."""
    units = {column.unit or "m" for column in columns}
    if len(units) > 1 or not units <= LENGTH_UNITS.keys():
        names = ", ".join(column.name for column in columns)
        raise DataError(f"unit of {names}: expected one of m, cm, mm, km for all three", path, line_number)
    return LENGTH_UNITS[units.pop()]


def _time_columns(columns: list[Column], path: str | Path, line_number: int) -> tuple[TimeColumn, ...]:
    """The column with the time, or the two whose sum it is; empty without a time.

    Raises `DataError` for a unit that is not known.
    """
    times = [column for column in columns if _names_a_time(column)]
    first_parts = [column for column in times if not _is_second_part(column, times)]
    if not first_parts:
        return ()
    # In ROS, the stamp of a message is the time of the measurement; other times are those of the recording.
    stamps = [column for column in first_parts if {"header", "stamp"}.issubset(column.words)]
    time = stamps[0] if stamps else first_parts[0]
    for other in times:
        if time.unit in _WHOLE_SECONDS and other.words == time.words and other.unit in _REST_NANOSECONDS:
            return TimeColumn(time.place, 1.0), TimeColumn(other.place, NANOSECONDS)
    return (TimeColumn(time.place, _seconds_per_unit(time, columns, path, line_number)),)


def _is_second_part(column: Column, times: list[Column]) -> bool:
    """Whether a time is the nanoseconds to another column of `times` with the whole seconds."""
    if column.unit not in _REST_NANOSECONDS:
        return False
    return any(other.words == column.words and other.unit in _WHOLE_SECONDS for other in times)


def _names_a_time(column: Column) -> bool:
    """Whether a column is a time, and no part of a pose or of another quantity."""
    if _role(column) is not None or _OTHER_WORDS.intersection(column.words):
        return False
    return not _TIME_WORDS.isdisjoint(column.words)


def _seconds_per_unit(
    time: Column, columns: list[Column], path: str | Path, line_number: int
) -> float | None:
    """The factor from the unit of a time to seconds; None if the header does not say it."""
    first_word = time.unit.split(" ")[0]  # of a unit such as "s since the start"
    if first_word in TIME_UNITS:
        return TIME_UNITS[first_word]
    is_other_unit = time.unit != "" and _CLOCKS.isdisjoint(time.unit.split())
    if is_other_unit or _LONG_UNITS.intersection(time.words):
        raise DataError(f"unit of {time.name}: expected s, ms, us or ns", path, line_number)
    if _is_rostopic(columns) or _is_euroc(columns):
        return NANOSECONDS
    return None


def _is_rostopic(columns: list[Column]) -> bool:
    """Whether the file is from `rostopic echo -p`, which writes all times in nanoseconds."""
    return any(column.name.startswith("field.") for column in columns)


def _is_euroc(columns: list[Column]) -> bool:
    """Whether the names are EuRoC's, p_RS_R_x and so on: times are in nanoseconds."""
    return any(column.words[:2] == ("p", "rs") for column in columns)


def _frame_column(columns: list[Column]) -> int | None:
    """Place of a column with frame numbers, or None."""
    for column in columns:
        if column.words and _FRAME_WORDS.issuperset(column.words):
            return column.place
    return None


def _is_colmap(columns: list[Column]) -> bool:
    """Whether a header is that of COLMAP's images.txt."""
    names = {column.name.upper() for column in columns}
    return {"IMAGE_ID", "CAMERA_ID", "QW"} <= names


def _refuse_colmap(columns: list[Column], path: str | Path, line_number: int) -> None:
    """Raise `DataError` for COLMAP's images.txt, whose poses are not those of the camera in the world."""
    if _is_colmap(columns):
        raise DataError(
            "COLMAP's images.txt has poses from the world to the camera, and two lines for each image: write "
            f"the inverse poses, one line each, below {HEADER_EXAMPLE!r}",
            path,
            line_number,
        )


def _world_to_camera_names(columns: list[Column]) -> list[str]:
    """The names that say that poses are from the world to the camera; [] if no name says so.

    These are the names of three or more columns, or words anywhere in the line.
    """
    names = [column.name for column in columns if _WORLD_TO_CAMERA.search(" ".join(column.words))]
    if len(names) >= len(POSITION):
        return names
    line = " ".join(" ".join(column.words) for column in columns)
    stated = _STATED_WORLD_TO_CAMERA.search(line)
    if stated is None or _CAMERA_TO_WORLD.search(line):
        return []
    return [stated[0]]


def _refuse_world_to_camera(columns: list[Column], path: str | Path, line_number: int) -> None:
    """Raise `DataError` for names such as t_cw_x, whose poses are not those of the camera in the world."""
    names = _world_to_camera_names(columns)
    if names:
        raise DataError(
            f"{', '.join(names[:3])} name poses from the world to the camera: write the inverse poses below "
            f"{HEADER_EXAMPLE!r}",
            path,
            line_number,
        )
