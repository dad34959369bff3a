"""Label files in YOLO's text format: reading and writing of vehicle boxes (chapter 5)."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from enum import IntEnum
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..errors import DataError
from ..files import read_text, write_atomic
from ..geometry.boxes import Boxes, no_boxes
from ..geometry.types import Array, BoolArray, IntArray
from .label_names import is_file_of_names

MAX_CLASS_ID = 10**6  # no data set has more classes; a larger number belongs to another column
SLACK = 1e-3  # values outside 0..1 by at most this are rounding errors of other programs, and are clipped
POLYGON_FIELDS = 7  # number of fields of the shortest polygon: the class and three points
TRACK_FIELDS = 7  # of a tracker's line: the class, the box, its score, and the number of the track
# Share of the image: how far a box may reach out of it, and a keypoint out of its box, by inexact numbers.
MAX_OUTSIDE = 0.01
MAX_UNCLIPPED = 0.1  # share of the image by which a box that nobody clipped may reach out of it
KITTI_FIELDS = (15, 16)  # of a line of KITTI's object labels, without and with a score
KEYPOINT_SIZES = (2, 3)  # numbers of a keypoint: x, y, and perhaps whether or how surely it is visible
MAX_VISIBILITY = 2.0  # the largest such third number
UNSEEN_KEYPOINT = (0.0, 0.0)  # how pose models write x, y of a keypoint that they do not see
# "class cx cy w h x y …" of a box with keypoints and "class x1 y1 x2 y2 x3 y3 …" of a polygon look alike. The
# second pair of numbers tells: in a polygon it is a point near the others, in a box it is the size, which is
# seldom near them. `_is_size` measures how far it is outside the other points, in units of their extent.
MAY_BE_SIZE = 0.25  # beyond this distance, the pair may be a size
IS_SIZE = 1.0  # beyond this one, it is a size
TRIANGLE_POINTS = 3  # with so few points it never is for certain: a long triangle has a corner that far away
SMALLEST_AREA = 1e-6  # of a rotated box, as a share of the image
MAX_GAP = 2e-3  # shares of the image, between the fourth corner of a rotated box and its place by the others


@dataclass(frozen=True, eq=False)
class LabelRows:
    """The N rows of a label file, in shares of the image's size.

    Attributes
    ----------
    class_id : (N,) numbers. shares : (N, 4) centre x, centre y, width, height. score : (N,) in [0, 1].
    polygon : (N,) whether the row was a polygon or a rotated box, whose bounding box is in `shares`.
    may_be_keypoints : (N,) whether the polygon may be a box with keypoints instead.
    """

    class_id: IntArray
    shares: Array
    score: Array
    polygon: BoolArray
    may_be_keypoints: BoolArray


def read_label_rows(path: str | Path) -> LabelRows:
    """The rows of a label file: `class cx cy w h [score]`, or `class x1 y1 x2 y2 x3 y3 …` for a polygon.

    Values are shares of the image's size. A rotated box is a polygon of four points.

    Raises `DataError` with file and line for a wrong number of fields, a value outside 0..1, an invalid class
    number, and for rows with keypoints.
    """
    rows = []
    for line_number, line in enumerate(read_text(path).splitlines(), start=1):
        if line.strip():
            rows.append(_read_row(line, path, line_number))
    return LabelRows(
        np.array([row.class_id for row in rows], np.int64),
        np.array([row.shares for row in rows], np.float64).reshape(-1, 4),
        np.array([row.score for row in rows], np.float64),
        np.array([row.polygon for row in rows], np.bool_),
        np.array([row.may_be_keypoints for row in rows], np.bool_),
    )


class _Row(NamedTuple):
    """A row of `LabelRows`."""

    class_id: int
    shares: list[float]
    score: float
    polygon: bool
    may_be_keypoints: bool


class _Answer(IntEnum):
    """Whether something is so; a greater answer is surer."""

    NO = 0
    MAYBE = 1
    YES = 2


def _read_row(line: str, path: str | Path, line_number: int) -> _Row:
    """A line of a label file that is not empty; errors as in `read_label_rows`."""
    words = line.split()
    _refuse_kitti(words, path, line_number)
    keypoints = _Answer.NO
    if len(words) >= POLYGON_FIELDS:
        keypoints = _have_keypoints(_numbers(words[1:]))
    if keypoints is _Answer.YES:
        raise DataError(
            "expected class cx cy w h [score], found a box with keypoints, as of a pose model: keep the "
            "first 5 numbers of each line",
            path,
            line_number,
        )
    is_polygon = len(words) >= POLYGON_FIELDS and len(words) % 2 == 1
    if len(words) not in (5, 6) and not is_polygon:
        raise DataError(
            f"expected class cx cy w h [score], or class x1 y1 x2 y2 x3 y3 … of a polygon, found "
            f"{len(words)} fields",
            path,
            line_number,
        )
    numbers = _numbers(words)
    _refuse_track(words, numbers, path, line_number)
    if not _are_class_and_shares(numbers):
        start = line.strip()[:60]
        raise DataError(f"expected a class number and values in 0..1, found {start!r}", path, line_number)
    class_id = int(numbers[0])
    values = [min(max(value, 0.0), 1.0) for value in numbers[1:]]
    if is_polygon:
        may_be_keypoints = keypoints is _Answer.MAYBE
        return _Row(class_id, _bounding_box(values), 1.0, polygon=True, may_be_keypoints=may_be_keypoints)
    score = values[4] if len(values) == 5 else 1.0
    return _Row(class_id, values[:4], score, polygon=False, may_be_keypoints=False)


def _refuse_track(words: list[str], numbers: list[float], path: str | Path, line_number: int) -> None:
    """Raise `DataError` for a tracker's line, `class cx cy w h score track`.

    numbers : those of its words.
    """
    if len(words) != TRACK_FIELDS or not words[-1].isdecimal() or not _may_end_with_track(numbers):
        return
    triangle = ""
    if numbers[-1] <= 1:  # a triangle may end so at the image border; written as 1.0, it is no track
        triangle = f"; if this is a triangle, write its last number as {numbers[-1]}"
    raise DataError(
        "expected class cx cy w h [score], found 7 fields, the last of which is a whole number: omit "
        f"the number of the track{triangle}",
        path,
        line_number,
    )


def _may_end_with_track(numbers: list[float]) -> bool:
    """Whether the last of 7 numbers, a whole one, may be that of a track, behind the score of a box.

    A triangle at the image border may end with 0 or 1, so these are tracks only behind a box in the image.
    """
    if not _are_class_and_shares(numbers[:-1]):
        return False
    return numbers[-1] > 1 or _is_box_in_image(numbers[1:5], MAX_UNCLIPPED)


def _are_class_and_shares(numbers: list[float]) -> bool:
    """Whether the first of the numbers is that of a class and the others are in 0..1, up to rounding."""
    if not numbers:
        return False
    class_id, *values = numbers
    if not 0 <= class_id <= MAX_CLASS_ID or class_id != int(class_id):
        return False
    return all(-SLACK <= value <= 1.0 + SLACK for value in values)


def _numbers(words: list[str]) -> list[float]:
    """The numbers of a line; none if a word is not a number."""
    try:
        return [float(word) for word in words]
    except ValueError:
        return []


def _refuse_kitti(words: list[str], path: str | Path, line_number: int) -> None:
    """Raise `DataError` for a line of KITTI's object labels."""
    if len(words) in KITTI_FIELDS and words[0][0].isalpha():
        raise DataError(
            "is a line of KITTI's object labels, expected YOLO's: vo data kitti_to_yolo converts them",
            path,
            line_number,
        )


def _have_keypoints(values: list[float]) -> _Answer:
    """Whether a row's numbers behind the class are a box and keypoints in it, perhaps followed by a score.

    Of a polygon, too, the first two points may look like a box around the others; `_is_size` tells then.
    """
    if not values or not _is_box_in_image(values[:4]):  # without values, a word is no number
        return _Answer.NO
    answer = _Answer.NO
    for rest in (values[4:], values[4:-1]):  # without a score, and with one
        for size in KEYPOINT_SIZES:
            answer = max(answer, _are_keypoints(values, rest, size))
    return answer


def _are_keypoints(values: list[float], rest: list[float], size: int) -> _Answer:
    """Whether the numbers `rest` of a row's `values` are keypoints, of `size` numbers each, in its box."""
    if not rest or len(rest) % size != 0:
        return _Answer.NO
    points = list(zip(rest[::size], rest[1::size], strict=True))
    visibilities = rest[2::size] if size == 3 else []
    if not all(0 <= visibility <= MAX_VISIBILITY for visibility in visibilities):
        return _Answer.NO
    if not _are_in_box(values[:4], points):
        return _Answer.NO
    # No polygon has an odd count of numbers, nor a number above 1.
    if len(values) % 2 == 1 or max(rest) > 1.0 + SLACK:
        return _Answer.YES
    return _is_size([(values[0], values[1]), (values[2], values[3]), *points])


def _is_size(points: list[tuple[float, float]]) -> _Answer:
    """Whether the second of the pairs of numbers is the size of a box, not a point of a polygon.

    For example, the box `0.70 0.60 0.10 0.20` has keypoints at (0.68, 0.55) and (0.72, 0.65). Its centre and
    keypoints have x from 0.68 to 0.72 and y from 0.55 to 0.65, so their extent is 0.10. The pair (0.10, 0.20)
    is 0.58 to the left of them, almost six extents, so it is a size. But the polygon (0.6, 0.5), (0.8, 0.5),
    (0.9, 0.6), (0.8, 0.7), (0.6, 0.7) has its second point among the others, so it is no size.
    """
    if len(points) == 4 and _is_parallelogram(np.array(points)):
        return _Answer.NO  # a rotated box
    second_x, second_y = points[1]
    others = [point for point in (points[0], *points[2:]) if point != UNSEEN_KEYPOINT]
    xs = [x for x, _ in others]
    ys = [y for _, y in others]
    left = min(xs)
    right = max(xs)
    top = min(ys)
    bottom = max(ys)
    distance_outside = max(left - second_x, second_x - right, top - second_y, second_y - bottom)
    extent = max(right - left, bottom - top)  # the longer side of the box around the other points
    if distance_outside > IS_SIZE * extent and len(points) > TRIANGLE_POINTS:
        return _Answer.YES
    if distance_outside > MAY_BE_SIZE * extent:
        return _Answer.MAYBE
    return _Answer.NO


def _is_parallelogram(points: Array) -> bool:
    """Whether four points (4, 2) are the corners of a parallelogram, as of a rotated box, in their order."""
    side = points[1] - points[0]
    other_side = points[3] - points[0]
    area = abs(side[0] * other_side[1] - side[1] * other_side[0])
    # The diagonals of a parallelogram have the same middle.
    is_closed = np.allclose(points[0] + points[2], points[1] + points[3], rtol=0, atol=MAX_GAP)
    return bool(is_closed and area > SMALLEST_AREA)


def _is_box_in_image(box: list[float], outside: float = MAX_OUTSIDE) -> bool:
    """Whether four numbers are centre and size of a box that reaches at most `outside` beyond the image."""
    x, y, width, height = box
    if width <= 0 or height <= 0:
        return False
    ends = (x - width / 2, x + width / 2, y - height / 2, y + height / 2)
    return min(ends) >= -outside and max(ends) <= 1.0 + outside


def _are_in_box(box: list[float], points: Iterable[tuple[float, float]]) -> bool:
    """Whether a box (centre, size) contains one or more keypoints, and all that were seen.

    Plain numbers, since arrays would take longer: this is done for every polygon of every frame.
    """
    centre_x, centre_y, width, height = box
    half_width = width / 2 + MAX_OUTSIDE
    half_height = height / 2 + MAX_OUTSIDE
    seen = 0
    for x, y in points:
        if (x, y) == UNSEEN_KEYPOINT:
            continue
        if abs(x - centre_x) > half_width or abs(y - centre_y) > half_height:
            return False
        seen += 1
    return seen > 0


def _bounding_box(values: list[float]) -> list[float]:
    """Centre and size of the box around the points x1 y1 x2 y2 …"""
    left = min(values[::2])
    right = max(values[::2])
    top = min(values[1::2])
    bottom = max(values[1::2])
    return [(left + right) / 2, (top + bottom) / 2, right - left, bottom - top]


def read_labels(path: str | Path, width: int, height: int) -> Boxes:
    """Boxes of a YOLO label file, in pixels of an image of width × height pixels.

    Raises `DataError` as `read_label_rows` does, and for rows that are corners, not centre and size.
    """
    rows = read_label_rows(path)
    if not len(rows.class_id):
        return no_boxes()
    # The other files of the folder are read only if this one looks like corners.
    if _reaches_outside(rows) and _are_corners(rows) and _are_corners_everywhere(Path(path)):
        raise DataError(
            "the boxes seem to be corners, class x0 y0 x1 y1: expected centre and size, class cx cy w h", path
        )
    centre = rows.shares[:, :2] * (width, height)
    size = rows.shares[:, 2:] * (width, height)
    # YOLO's origin is the outer corner of the first pixel, the kit's origin the pixel's centre.
    xyxy = np.concatenate([centre - size / 2, centre + size / 2], axis=1) - 0.5
    return Boxes(xyxy, rows.class_id, rows.score)


def _are_corners(rows: LabelRows) -> bool:
    """Whether every row that is no polygon could be two corners, the first left above the second."""
    shares = rows.shares[~rows.polygon]
    return bool(np.all(shares[:, 2:] > shares[:, :2]))


def _reaches_outside(rows: LabelRows) -> bool:
    """Whether a box reaches out of the image clearly, which corners read as centre and size often do."""
    shares = rows.shares[~rows.polygon]
    # Rows with a share of 1 prove nothing: a true box as wide or high as the image may reach out of it if
    # nobody clipped it. Few corners are lost with them, since a corner is rarely exactly at 1.
    shares = shares[(shares < 1.0).all(axis=1)]
    low = shares[:, :2] - shares[:, 2:] / 2
    high = shares[:, :2] + shares[:, 2:] / 2
    return bool(np.any(low < -MAX_OUTSIDE) or np.any(high > 1.0 + MAX_OUTSIDE))


def _are_corners_everywhere(path: Path) -> bool:
    """Whether all boxes in the folder of a label file could be corners."""
    return all(_are_corners(read_label_rows(file)) for file in label_files(path.parent))


def label_files(folder: Path) -> list[Path]:
    """The label files in a folder that are named by a number, as frames are, in the order of their names."""
    return sorted(path for path in folder.glob("*.txt") if path.stem.isdecimal())


def label_stems(folder: Path) -> set[str]:
    """The file stems of all text files in a folder that may be label files, whatever their names."""
    return {path.stem for path in folder.glob("*.txt") if not is_file_of_names(path.name)}


@dataclass(frozen=True)
class LabelCounts:
    """Contents of many label files.

    Attributes
    ----------
    boxes : number of boxes of each class. polygons : number of polygons and rotated boxes among them.
    may_be_keypoints : number of polygons that may be boxes with keypoints.
    may_be_corners : whether each box could be corners instead of centre and size.
    """

    boxes: Counter[int]
    polygons: int
    may_be_keypoints: int
    may_be_corners: bool


def count_labels(files: Iterable[Path]) -> LabelCounts:
    """Contents of label files; raises `DataError` as `read_label_rows` does."""
    boxes = Counter[int]()
    polygons = 0
    may_be_keypoints = 0
    may_be_corners = True
    for path in files:
        rows = read_label_rows(path)
        boxes.update(rows.class_id.tolist())
        polygons += int(np.count_nonzero(rows.polygon))
        may_be_keypoints += int(np.count_nonzero(rows.may_be_keypoints))
        may_be_corners = may_be_corners and _are_corners(rows)
    if boxes.total() == polygons:
        may_be_corners = False  # there is no box that could be
    return LabelCounts(boxes, polygons, may_be_keypoints, may_be_corners)


def write_labels(path: str | Path, boxes: Boxes, width: int, height: int, scores: bool = True) -> None:
    """Write a YOLO label file with lines `class cx cy w h [score]`; boxes are clipped at the image border.

    boxes : in pixels of an image of width × height pixels. scores : whether the lines have the scores.
    """
    corners = np.clip((boxes.xyxy + 0.5) / (width, height, width, height), 0.0, 1.0)
    centre = (corners[:, :2] + corners[:, 2:]) / 2
    size = corners[:, 2:] - corners[:, :2]
    columns = [centre, size]
    if scores:
        columns.append(boxes.score[:, None])
    lines = []
    for class_id, values in zip(boxes.class_id.tolist(), np.hstack(columns).tolist(), strict=True):
        words = [str(class_id), *(f"{value:.6f}" for value in values)]
        lines.append(" ".join(words) + "\n")
    write_atomic(path, "".join(lines))
