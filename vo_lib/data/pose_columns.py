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
_OTHER_WORDS = {
    *("vel", "velocity", "linear", "angular", "twist", "omega", "acc", "accel", "acceleration"),
    *("gyro", "mag", "bias", "gravity", "cov", "covariance", "std", "sigma", "var", "error"),
}
EUROC_OTHER = ("v_", "b_")  # velocities and biases in EuRoC's files
_ANGLE_WORDS = {"roll", "pitch", "yaw", "euler", "heading", "rotvec", "rx", "ry", "rz"}
_TAIT_OR_MATRIX = re.compile(r"(r|rot|t|m|q) ?\d ?\d?")  # r11, rot_00, T00 or q0, without blanks otherwise
_JOINED = re.compile(
    r"(?:(?P<q>q|quat|quaternion|orientation|ori|rotation|rot)(?P<of_q>[xyzw])"
    r"|(?P<p>t|p|pos|position|trans|translation|loc|location)(?P<of_p>[xyz]))"
)
# Words of names such as t_cw_x, Tcw, qw_cw, w2c or cam_from_world: the world seen from camera, body or IMU.
_PART = r"(?:t|p|q|r|rot|rotation|trans|translation|pos|position|pose|quat|quaternion|orientation|ori)"
_WORLD_TO_CAMERA = re.compile(
    rf"\b{_PART} ?[cbi] ?w\b|\b(?:q[xyzw]|[tp]?[xyz]) [cbi]w\b"
    r"|\b(?:world|w|map) ?(?:to|2) ?(?:cam|camera|c|body|b|imu|i|sensor)\b"
    r"|\b(?:cam|camera|body|imu|sensor) (?:\d )?(?:from )?world\b|\bextrinsics?\b|\bview ?matrix\b"
)
_STATED_WORLD_TO_CAMERA = re.compile(r"\b(?:world (?:to|2) (?:the )?cam(?:era)?|w 2 c|t ?cw)\b")
_CAMERA_TO_WORLD = re.compile(r"\b(?:cam(?:era)? (?:to|2) (?:the )?world|c 2 w|t ?wc)\b")
_AXES = set("xyzw")
_COMMENT = re.compile(r"\s*[\"']?\s*[#%]+")
_UNIT = re.compile(r"[\[(]([^\])]*)[\])]")


class Column(NamedTuple):
    """A column: its place in a row, its name as written, the words of the name, and the unit or ""."""

    place: int
    name: str
    words: tuple[str, ...]
    unit: str


@dataclass(frozen=True)
class PoseColumns:
    """Places of a pose in a row.

    Attributes
    ----------
    line : line of the header, counted from 1. names : all names of the header.
    position : places of x, y, z; metres : factor from the unit of x, y, z to metres.
    quaternion : places of x, y, z, w.
    time : places of the columns whose sum is the time, each with its factor to seconds (None: not named).
    frame : place of a column with frame numbers, in a file without times; otherwise None.
    """

    line: int
    names: tuple[str, ...]
    position: tuple[int, ...]
    metres: float
    quaternion: tuple[int, ...]
    time: tuple[tuple[int, float | None], ...]
    frame: int | None

    @property
    def places(self) -> tuple[int, ...]:
        """Places of the needed columns: the time or the frame number, x y z, then qx qy qz qw."""
        first = [place for place, _ in self.time]
        if self.frame is not None:
            first = [self.frame]
        return (*first, *self.position, *self.quaternion)


def find_header(lines: Sequence[str]) -> int | None:
    """Number, from 1, of the line that names the columns of a pose: a comment, or the first line without #.

    None if no line names columns, so that a convention must decide.
    """
    header = None
    for number, line in enumerate(lines, start=1):
        if not line.strip():
            continue
        if _world_to_camera(_columns(line, None)):
            return number  # whatever a later line names, the poses are refused
        if _names_a_pose(line):
            header = number
        if not _COMMENT.match(line):
            break
    return header


def is_comment(line: str) -> bool:
    """Whether a line is a comment, which begins with # or %."""
    return _COMMENT.match(line) is not None


def separator_of(row: str) -> str | None:
    """The character between the numbers of a row: a semicolon, a comma or a tabulator; None for blanks."""
    return next((separator for separator in SEPARATORS if separator in row), None)


def split_cells(line: str, separator: str | None) -> list[str]:
    """The cells of a line without blanks and quotation marks around them; raises `csv.Error`."""
    if separator is None:
        return [word.strip("\"'") for word in line.split()]
    (cells,) = csv.reader([line.strip(" \r\n")], delimiter=separator, skipinitialspace=True)
    return [cell.strip() for cell in cells]


def read_columns(line: str, number: int, path: str | Path, separator: str | None) -> PoseColumns:
    """The columns that a header names.

    `separator` : the character between the cells of the rows below. Raises `DataError` with the line if a
    part of the pose is missing, is named twice, or is given as angles or as a matrix.
    """
    columns = _columns(line, separator)
    _refuse_colmap(columns, path, number)
    _refuse_world_to_camera(columns, path, number)
    candidates: dict[str, list[Column]] = {}
    for column in columns:
        role = _role(column)
        if role is not None:
            candidates.setdefault(role, []).append(column)
    missing = [name for name in (*POSITION, *QUATERNION) if name not in candidates]
    if missing:
        raise DataError(_incomplete(columns, missing), path, number)
    chosen = _one_path(candidates, path, number)
    time = _time(columns, path, number)
    return PoseColumns(
        line=number,
        names=tuple(column.name for column in columns),
        position=tuple(chosen[name].place for name in POSITION),
        metres=_metres([chosen[name] for name in POSITION], path, number),
        quaternion=tuple(chosen[name].place for name in QUATERNION),
        time=time,
        frame=None if time else _frame(columns),
    )


def _columns(line: str, separator: str | None) -> list[Column]:
    """All columns of a header, whose cells may be separated in another way than those of the rows."""
    text = _COMMENT.sub("", line, count=1) if is_comment(line) else line
    cells = list[str]()
    if separator is not None:
        with suppress(csv.Error):
            cells = split_cells(text, separator)
    if len(cells) < len(POSITION) + len(QUATERNION):
        # A unit belongs to the name before it: "timestamp [ns] tx".
        cells = re.sub(r"\s+(?=[\[(])", "", text).replace(",", " ").replace(";", " ").split()
    return [Column(place, name.strip("\"' "), *_words(name)) for place, name in enumerate(cells)]


def _words(name: str) -> tuple[tuple[str, ...], str]:
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
        joined = _JOINED.fullmatch(word)
        if joined is not None:
            return f"q{joined['of_q']}" if joined["q"] else str(joined["of_p"])
    axes = [word for word in words if word in _AXES]
    if len(axes) != 1 or words[-1] != axes[0]:
        return None
    if _QUATERNION_WORDS.intersection(words):
        return f"q{axes[0]}"
    if axes[0] in POSITION and (len(words) == 1 or _POSITION_WORDS.intersection(words)):
        return axes[0]
    return None


def _names_a_pose(line: str) -> bool:
    """Whether a line has names for a position or for an orientation."""
    for separator in (*SEPARATORS, None):
        columns = _columns(line, separator)
        roles = {_role(column) for column in columns}
        if roles.issuperset(POSITION) or not roles.isdisjoint(QUATERNION) or _is_colmap(columns):
            return True
        if _world_to_camera(columns):
            return True
    return False


def _incomplete(columns: list[Column], missing: list[str]) -> str:
    """The sentence for a header without a part of the pose."""
    rotation = [
        column.name
        for column in columns
        if _ANGLE_WORDS.intersection(column.words) or _TAIT_OR_MATRIX.fullmatch(" ".join(column.words))
    ]
    if rotation and set(missing) <= set(QUATERNION):
        names = ", ".join(rotation[:3])
        return (
            f"the rotation is given as {names}, whose convention the header does not say: convert it to a "
            f"quaternion with the columns {' '.join(QUATERNION)}"
        )
    example = HEADER_EXAMPLE.removeprefix("# ")
    return f"the header does not name {' '.join(missing)}: expected columns such as {example}"


def _one_path(candidates: dict[str, list[Column]], path: str | Path, number: int) -> dict[str, Column]:
    """A column for each part of the pose; `DataError` if the header names several paths."""
    if all(len(columns) == 1 for columns in candidates.values()):
        return {role: columns[0] for role, columns in candidates.items()}
    paths: dict[tuple[str, ...], dict[str, Column]] = {}
    for role, columns in candidates.items():
        for column in columns:
            if role in paths.setdefault(_frame_of(column), {}):
                raise DataError(f"the header names {column.name} twice", path, number)
            paths[_frame_of(column)][role] = column
    complete = {frame: named for frame, named in paths.items() if len(named) == len(candidates)}
    # Positions from the centre of the Earth stand beside positions in the world of the drive.
    local = {frame: named for frame, named in complete.items() if "ecef" not in frame}
    if len(local) != 1:
        two = " and ".join(column.name for column in candidates["x"][:2])
        raise DataError(f"the header names several paths, {two}: keep the columns of one", path, number)
    (chosen,) = local.values()
    return chosen


def _frame_of(column: Column) -> tuple[str, ...]:
    """The words of a name without its axis and its kind, such as ("odom", "pose")."""
    kinds = _POSITION_WORDS | _QUATERNION_WORDS | _AXES
    return tuple(word for word in column.words if word not in kinds and not _JOINED.fullmatch(word))


def _metres(columns: list[Column], path: str | Path, number: int) -> float:
    """The factor from the unit of the positions to metres."""
    units = {column.unit or "m" for column in columns}
    if len(units) > 1 or not units <= LENGTH_UNITS.keys():
        names = ", ".join(column.name for column in columns)
        raise DataError(f"unit of {names}: expected one of m, cm, mm, km for all three", path, number)
    return LENGTH_UNITS[units.pop()]


def _time(columns: list[Column], path: str | Path, number: int) -> tuple[tuple[int, float | None], ...]:
    """Places of the time and their factors to seconds; empty without a time."""
    named = [column for column in columns if _TIME_WORDS.intersection(column.words) and _role(column) is None]
    named = [column for column in named if not _OTHER_WORDS.intersection(column.words)]
    # In ROS, the stamp of a message is the time of the measurement; other times are those of the recording.
    stamps = [column for column in named if {"header", "stamp"} <= set(column.words)]
    for column in [*stamps, *named]:
        if column.unit in _WHOLE_SECONDS:
            rest = [c for c in named if c.words == column.words and c.unit in _REST_NANOSECONDS]
            if rest:
                return (column.place, 1.0), (rest[0].place, NANOSECONDS)
        if column.unit in _REST_NANOSECONDS and any(
            c.words == column.words and c.unit in _WHOLE_SECONDS for c in named
        ):
            continue  # the second part of a time
        unit = column.unit.split(" ")[0]  # "s since the start"
        if unit in TIME_UNITS:
            return ((column.place, TIME_UNITS[unit]),)
        is_other_unit = bool(column.unit) and _CLOCKS.isdisjoint(column.unit.split())
        if is_other_unit or _LONG_UNITS.intersection(column.words):
            raise DataError(f"unit of {column.name}: expected s, ms, us or ns", path, number)
        nanoseconds = column.name.startswith("field.") or _is_rostopic(columns) or _is_euroc(columns)
        return ((column.place, NANOSECONDS if nanoseconds else None),)
    return ()


def _is_rostopic(columns: list[Column]) -> bool:
    """Whether the file is from `rostopic echo -p`, which writes all times in nanoseconds."""
    return any(column.name.startswith("field.") for column in columns)


def _is_euroc(columns: list[Column]) -> bool:
    """Whether the names are EuRoC's, p_RS_R_x and so on: times are in nanoseconds."""
    return any(column.words[:2] == ("p", "rs") for column in columns)


def _frame(columns: list[Column]) -> int | None:
    """Place of a column with frame numbers."""
    for column in columns:
        if column.words and _FRAME_WORDS.issuperset(column.words):
            return column.place
    return None


def _is_colmap(columns: list[Column]) -> bool:
    """Whether a header is that of COLMAP's images.txt."""
    names = {column.name.upper() for column in columns}
    return {"IMAGE_ID", "CAMERA_ID", "QW"} <= names


def _refuse_colmap(columns: list[Column], path: str | Path, number: int) -> None:
    """Raise `DataError` for COLMAP's images.txt, whose poses are not those of the camera in the world."""
    if _is_colmap(columns):
        raise DataError(
            "COLMAP's images.txt has poses from the world to the camera, and two lines for each image: write "
            f"the inverse poses, one line each, below {HEADER_EXAMPLE!r}",
            path,
            number,
        )


def _world_to_camera(columns: list[Column]) -> list[str]:
    """Names that say that poses are from the world to the camera: of three columns, or in the whole line."""
    names = [column.name for column in columns if _WORLD_TO_CAMERA.search(" ".join(column.words))]
    if len(names) >= len(POSITION):
        return names
    line = " ".join(word for column in columns for word in column.words)
    stated = _STATED_WORLD_TO_CAMERA.search(line)
    return [stated[0]] if stated and not _CAMERA_TO_WORLD.search(line) else []


def _refuse_world_to_camera(columns: list[Column], path: str | Path, number: int) -> None:
    """Raise `DataError` for names such as t_cw_x, whose poses are not those of the camera in the world."""
    names = _world_to_camera(columns)
    if names:
        raise DataError(
            f"{', '.join(names[:3])} name poses from the world to the camera: write the inverse poses below "
            f"{HEADER_EXAMPLE!r}",
            path,
            number,
        )
