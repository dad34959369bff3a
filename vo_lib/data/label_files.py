"""Label files in YOLO's text format: reading and writing of vehicle boxes (chapter 5)."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..errors import DataError
from ..files import read_text, write_atomic
from ..geometry.boxes import Boxes, no_boxes
from ..geometry.types import Array, BoolArray, IntArray

MAX_CLASS_ID = 10**6  # no data set has more classes; a larger number belongs to another column
SLACK = 1e-3  # values outside 0..1 by at most this are rounding errors of other programs, and are clipped
POLYGON_FIELDS = 7  # number of fields of the shortest polygon: the class and three points
OUTSIDE = 0.01  # a box that reaches further out of the image, as a share, may be corners read as a centre
KITTI_FIELDS = (15, 16)  # of a line of KITTI's object labels, without and with a score
KEYPOINT_SIZES = (2, 3)  # numbers of a keypoint: x, y, and perhaps whether or how surely it is visible
VISIBLE = 2.0  # the largest such number
# The second pair of numbers is the size of a box, not a point of a polygon, if it lies further outside the
# other points than this share of their extent: by the first share it may be, by the second it is.
MAY_BE_SIZE = 0.25
IS_SIZE = 1.0
TRIANGLE = 3  # number of points; too few to tell
SMALLEST_AREA = 1e-6  # of a rotated box, as a share of the image
SAME = 2e-3  # shares of the image; the sides of rotated boxes are parallel up to the rounding of their points


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
    lines = enumerate(read_text(path).splitlines(), start=1)
    rows = [_read_row(line, path, number) for number, line in lines if line.strip()]
    return LabelRows(
        np.array([row.class_id for row in rows], np.int64),
        np.array([row.shares for row in rows], np.float64).reshape(-1, 4),
        np.array([row.score for row in rows], np.float64),
        np.array([row.is_polygon for row in rows], np.bool_),
        np.array([row.may_have_keypoints for row in rows], np.bool_),
    )


class _Row(NamedTuple):
    """A row of `LabelRows`."""

    class_id: int
    shares: list[float]
    score: float
    is_polygon: bool
    may_have_keypoints: bool


def _read_row(line: str, path: str | Path, number: int) -> _Row:
    """A line of a label file that is not empty; errors as in `read_label_rows`."""
    words = line.split()
    _refuse_kitti(words, path, number)
    has_keypoints = len(words) >= POLYGON_FIELDS and _have_keypoints(_numbers(words[1:]))
    if has_keypoints:
        raise DataError(
            "expected class cx cy w h [score], found a box with keypoints, as of a pose model: keep the "
            "first 5 numbers of each line",
            path,
            number,
        )
    is_polygon = len(words) >= POLYGON_FIELDS and len(words) % 2 == 1
    if len(words) not in (5, 6) and not is_polygon:
        raise DataError(
            f"expected class cx cy w h [score], or class x1 y1 x2 y2 x3 y3 … of a polygon, found "
            f"{len(words)} fields",
            path,
            number,
        )
    class_id, *values = _numbers(words) or [math.nan]
    is_valid_class = 0 <= class_id <= MAX_CLASS_ID and class_id == int(class_id)
    if not is_valid_class or not all(-SLACK <= value <= 1.0 + SLACK for value in values):
        start = line.strip()[:60]
        raise DataError(f"expected a class number and values in 0..1, found {start!r}", path, number)
    if len(words) == POLYGON_FIELDS and words[-1].isdecimal():
        raise DataError(
            "expected class cx cy w h [score], found 7 fields, the last of which is a whole number: omit "
            "the number of the track",
            path,
            number,
        )
    values = [min(max(value, 0.0), 1.0) for value in values]
    may_have_keypoints = has_keypoints is None
    if is_polygon:
        return _Row(int(class_id), _bounding_box(values), 1.0, True, may_have_keypoints)
    score = values[4] if len(values) == 5 else 1.0
    return _Row(int(class_id), values[:4], score, False, may_have_keypoints)


def _numbers(words: list[str]) -> list[float]:
    """The numbers of a line; none if a word is not a number."""
    try:
        return [float(word) for word in words]
    except ValueError:
        return []


def _refuse_kitti(words: list[str], path: str | Path, number: int) -> None:
    """Raise `DataError` for a line of KITTI's object labels."""
    if len(words) in KITTI_FIELDS and words[0][0].isalpha():
        raise DataError(
            "is a line of KITTI's object labels, expected YOLO's: vo data kitti_to_yolo converts them",
            path,
            number,
        )


def _have_keypoints(values: list[float]) -> bool | None:
    """Whether numbers without the class are a box and keypoints in it; None if they may be a polygon, too.

    Perhaps a score follows them. Of a polygon, too, the first two points may look like a box around the
    others; but then the second point lies near them, which is rarely true for the size of a box.
    """
    found: bool | None = False
    if len(values) < POLYGON_FIELDS - 1 or not _is_box_in_image(values[:4]):
        return found
    for rest in (values[4:], values[4:-1]):
        for size in KEYPOINT_SIZES:
            if not rest or len(rest) % size:
                continue
            points = list(zip(rest[::size], rest[1::size], strict=True))
            third = rest[2::size] if size == 3 else []
            if not all(0 <= value <= VISIBLE for value in third) or not _are_in_box(values[:4], points):
                continue
            # No polygon has an odd count of numbers, nor a number above 1.
            if len(values) % 2 == 1 or max(rest) > 1.0 + SLACK:
                return True
            is_size = _is_size([(values[0], values[1]), (values[2], values[3]), *points])
            if is_size:
                return True
            found = None if is_size is None else found
    return found


def _is_size(points: list[tuple[float, float]]) -> bool | None:
    """Whether the second pair of numbers cannot be a point of a polygon; None if it may be one."""
    if len(points) == 4 and _is_parallelogram(np.array(points)):
        return False  # a rotated box
    second_x, second_y = points[1]
    others = [point for point in (points[0], *points[2:]) if point != (0.0, 0.0)]
    xs = [point[0] for point in others]
    ys = [point[1] for point in others]
    left = min(xs)
    right = max(xs)
    top = min(ys)
    bottom = max(ys)
    outside = max(left - second_x, second_x - right, top - second_y, second_y - bottom)
    extent = max(right - left, bottom - top)
    if outside > IS_SIZE * extent and len(points) > TRIANGLE:
        return True
    return None if outside > MAY_BE_SIZE * extent else False


def _is_parallelogram(points: Array) -> bool:
    """Whether four points (4, 2) are the corners of a parallelogram, as of a rotated box, in their order."""
    side = points[1] - points[0]
    other_side = points[3] - points[0]
    area = abs(side[0] * other_side[1] - side[1] * other_side[0])
    closes = np.allclose(points[0] + points[2], points[1] + points[3], rtol=0, atol=SAME)
    return bool(closes and area > SMALLEST_AREA)


def _is_box_in_image(box: list[float]) -> bool:
    """Whether four numbers are the centre and the size of a box in the image."""
    x, y, width, height = box
    if width <= 0 or height <= 0:
        return False
    ends = (x - width / 2, x + width / 2, y - height / 2, y + height / 2)
    return min(ends) >= -OUTSIDE and max(ends) <= 1.0 + OUTSIDE


def _are_in_box(box: list[float], points: Iterable[tuple[float, float]]) -> bool:
    """Whether a box (centre, size) contains keypoints; one at (0, 0) is not there.

    Plain numbers, since arrays would take longer: this is done for every polygon of every frame.
    """
    centre_x, centre_y, width, height = box
    half_width = width / 2 + OUTSIDE
    half_height = height / 2 + OUTSIDE
    count = 0
    for x, y in points:
        if x == 0 and y == 0:
            continue
        if abs(x - centre_x) > half_width or abs(y - centre_y) > half_height:
            return False
        count += 1
    return count > 0


def _bounding_box(values: list[float]) -> list[float]:
    """Centre and size of the box around the points x1 y1 x2 y2 …"""
    left = min(values[::2])
    right = max(values[::2])
    top = min(values[1::2])
    bottom = max(values[1::2])
    return [(left + right) / 2, (top + bottom) / 2, right - left, bottom - top]


def read_labels(path: str | Path, width: int, height: int) -> Boxes:
    """Boxes, in pixels, of a YOLO label file for an image of this size.

    Raises `DataError` as `read_label_rows` does, and for rows that are corners, not centre and size.
    """
    rows = read_label_rows(path)
    if not len(rows.class_id):
        return no_boxes()
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
    # The height or width of a box that was not clipped may be the whole image; a corner rarely is.
    shares = shares[(shares < 1.0).all(axis=1)]
    low = shares[:, :2] - shares[:, 2:] / 2
    high = shares[:, :2] + shares[:, 2:] / 2
    return bool(np.any(low < -OUTSIDE) or np.any(high > 1.0 + OUTSIDE))


def _are_corners_everywhere(path: Path) -> bool:
    """Whether all boxes in the folder of a label file could be corners."""
    return all(_are_corners(read_label_rows(file)) for file in label_files(path.parent))


def label_files(folder: Path) -> list[Path]:
    """The label files in a folder that are named by a number, as frames are, in the order of their names."""
    return sorted(path for path in folder.glob("*.txt") if path.stem.isdecimal())


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
    keypoints = 0
    corners = True
    for path in files:
        rows = read_label_rows(path)
        boxes.update(rows.class_id.tolist())
        polygons += int(np.count_nonzero(rows.polygon))
        keypoints += int(np.count_nonzero(rows.may_be_keypoints))
        corners = corners and _are_corners(rows)
    plain = boxes.total() - polygons
    return LabelCounts(boxes, polygons, keypoints, corners and plain > 0)


def write_labels(path: str | Path, boxes: Boxes, width: int, height: int, scores: bool = True) -> None:
    """Write a YOLO label file with lines `class cx cy w h [score]`; boxes are clipped at the image border."""
    corners = np.clip((boxes.xyxy + 0.5) / (width, height, width, height), 0.0, 1.0)
    centre = (corners[:, :2] + corners[:, 2:]) / 2
    size = corners[:, 2:] - corners[:, :2]
    values = np.hstack([centre, size, boxes.score[:, None]])[:, : 5 if scores else 4]
    lines = [
        " ".join([str(kind), *(f"{value:.6f}" for value in row)]) + "\n"
        for kind, row in zip(boxes.class_id.tolist(), values.tolist(), strict=True)
    ]
    write_atomic(path, "".join(lines))
