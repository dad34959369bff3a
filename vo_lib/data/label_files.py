"""Label files in YOLO's text format: reading and writing of vehicle boxes (chapter 5)."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..errors import DataError
from ..files import read_text, write_atomic
from ..geometry.boxes import Boxes, no_boxes
from ..geometry.types import Array, BoolArray, IntArray

MAX_CLASS_ID = 10**6  # no data set has more classes; a larger number belongs to another column
SLACK = 1e-3  # values outside 0..1 by at most this are rounding errors of other programs, and are clipped
POLYGON_FIELDS = 7  # number of fields of the shortest polygon: the class and three points
OUTSIDE = 0.01  # a box that reaches further out of the image, as a share, may be corners read as a centre
# With this many boxes, all of which could be corners, a warning is due.
SUSPICIOUS_BOXES = 10


@dataclass(frozen=True, eq=False)
class LabelRows:
    """The N rows of a label file, in shares of the image's size.

    Attributes
    ----------
    class_id : (N,) numbers. shares : (N, 4) centre x, centre y, width, height. score : (N,) in [0, 1].
    polygon : (N,) whether the row was a polygon or a rotated box, whose bounding box is in `shares`.
    """

    class_id: IntArray
    shares: Array
    score: Array
    polygon: BoolArray


def read_rows(path: str | Path) -> LabelRows:
    """The rows of a label file: `class cx cy w h [score]`, or `class x1 y1 x2 y2 x3 y3 …` for a polygon.

    Values are shares of the image's size. A rotated box is a polygon of four points.

    Raises `DataError` with file and line for a wrong number of fields, a value outside 0..1 or an invalid
    class number.
    """
    rows: list[tuple[int, list[float], float, bool]] = []
    for number, line in enumerate(read_text(path).splitlines(), start=1):
        words = line.split()
        if not words:
            continue
        is_polygon = len(words) >= POLYGON_FIELDS and len(words) % 2 == 1
        if len(words) not in (5, 6) and not is_polygon:
            raise DataError(
                f"expected class cx cy w h [score], or class x1 y1 x2 y2 x3 y3 … of a polygon, found "
                f"{len(words)} fields",
                path,
                number,
            )
        try:
            class_id = float(words[0])
            values = [float(word) for word in words[1:]]
        except ValueError:
            class_id = math.nan
            values = []
        valid_class = 0 <= class_id <= MAX_CLASS_ID and class_id == int(class_id)
        if not valid_class or not all(-SLACK <= value <= 1.0 + SLACK for value in values):
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
        if is_polygon:
            rows.append((int(class_id), _bounding_box(values), 1.0, True))
        else:
            score = values[4] if len(values) == 5 else 1.0
            rows.append((int(class_id), values[:4], score, False))
    return LabelRows(
        np.array([row[0] for row in rows], np.int64),
        np.array([row[1] for row in rows], np.float64).reshape(-1, 4),
        np.array([row[2] for row in rows], np.float64),
        np.array([row[3] for row in rows], np.bool_),
    )


def _bounding_box(values: list[float]) -> list[float]:
    """Centre and size of the box around the points x1 y1 x2 y2 …"""
    left = min(values[::2])
    right = max(values[::2])
    top = min(values[1::2])
    bottom = max(values[1::2])
    return [(left + right) / 2, (top + bottom) / 2, right - left, bottom - top]


def read_labels(path: str | Path, width: int, height: int) -> Boxes:
    """Boxes, in pixels, of a YOLO label file for an image of this size.

    Raises `DataError` as `read_rows` does, and for rows that are corners, not centre and size.
    """
    rows = read_rows(path)
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
    return all(_are_corners(read_rows(file)) for file in label_files(path.parent))


def label_files(folder: Path) -> list[Path]:
    """The label files in a folder that are named by a number, as frames are, in the order of their names."""
    return sorted(path for path in folder.glob("*.txt") if path.stem.isdecimal())


@dataclass(frozen=True)
class LabelCounts:
    """Contents of many label files.

    Attributes
    ----------
    boxes : number of boxes of each class. polygons : number of polygons and rotated boxes among them.
    may_be_corners : whether each of many boxes could be corners instead of centre and size.
    """

    boxes: Counter[int]
    polygons: int
    may_be_corners: bool


def count_labels(files: Iterable[Path]) -> LabelCounts:
    """Contents of label files; raises `DataError` as `read_rows` does."""
    boxes = Counter[int]()
    polygons = 0
    corners = True
    for path in files:
        rows = read_rows(path)
        boxes.update(rows.class_id.tolist())
        polygons += int(np.count_nonzero(rows.polygon))
        corners = corners and _are_corners(rows)
    plain = boxes.total() - polygons
    return LabelCounts(boxes, polygons, corners and plain >= SUSPICIOUS_BOXES)


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
