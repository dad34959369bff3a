"""Label files in YOLO's text format: reading and writing of vehicle boxes (chapter 5)."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..errors import DataError
from ..files import read_text, write_atomic
from ..geometry.boxes import Boxes, no_boxes

MAX_CLASS_ID = 10**6  # no data set has more classes; a larger number belongs to another column


def read_labels(path: str | Path, width: int, height: int) -> Boxes:
    """Boxes, in pixels, of a YOLO label file: lines `class cx cy w h [score]`, as shares of the image size.

    Raises `DataError` with file and line for a wrong number of fields, a value outside 0..1 or an invalid
    class number.
    """
    rows = []
    for number, line in enumerate(read_text(path).splitlines(), start=1):
        words = line.split()
        if not words:
            continue
        if len(words) not in (5, 6):
            raise DataError(f"expected class cx cy w h [score], found {len(words)} fields", path, number)
        try:
            class_id, values = int(words[0]), [float(word) for word in words[1:]]
        except ValueError:
            class_id, values = -1, []
        if not 0 <= class_id <= MAX_CLASS_ID or not all(0.0 <= value <= 1.0 for value in values):
            start = line.strip()[:60]
            raise DataError(f"expected a class number and values in 0..1, found {start!r}", path, number)
        rows.append([float(class_id), *values, *([1.0] if len(values) == 4 else [])])
    if not rows:
        return no_boxes()
    data = np.array(rows)
    centre, size = data[:, 1:3] * (width, height), data[:, 3:5] * (width, height)
    # YOLO's origin is the outer corner of the first pixel, the kit's origin the pixel's centre.
    xyxy = np.concatenate([centre - size / 2, centre + size / 2], axis=1) - 0.5
    return Boxes(xyxy, data[:, 0].astype(np.int64), data[:, 5])


def write_labels(path: str | Path, boxes: Boxes, width: int, height: int, scores: bool = True) -> None:
    """Write a YOLO label file with lines `class cx cy w h [score]`; boxes are clipped at the image border."""
    corners = np.clip((boxes.xyxy + 0.5) / (width, height, width, height), 0.0, 1.0)
    centre, size = (corners[:, :2] + corners[:, 2:]) / 2, corners[:, 2:] - corners[:, :2]
    values = np.hstack([centre, size, boxes.score[:, None]])[:, : 5 if scores else 4]
    lines = [
        " ".join([str(kind), *(f"{value:.6f}" for value in row)]) + "\n"
        for kind, row in zip(boxes.class_id.tolist(), values.tolist(), strict=True)
    ]
    write_atomic(path, "".join(lines))
