"""Non-maximum suppression: of the boxes of one object, only that with the highest score stays.

Two boxes are of one object if their IoU, their common area over the area of both together, exceeds a limit.
"""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np

from ..geometry.boxes import Boxes, no_boxes
from ..geometry.types import Array, BoolArray, Index

ONE_OBJECT_IOU = 0.9  # boxes with a larger IoU are of one object, whatever their classes
MAX_SUPPRESSED_BOXES = 3000  # largest number of boxes in the suppression, the best first


def best_boxes(
    corners: Array,
    scores: Array,
    least_score: float,
    largest_iou: float,
    class_mask: BoolArray | None = None,
    *,
    one_to_one: bool = False,
) -> Boxes:
    """Boxes after non-maximum suppression, best first. A box has the class with its highest score.

    Only boxes of the wanted classes compete: a person's box never suppresses that of a car. The IoU limit of
    the suppression is `largest_iou` within a class, and `ONE_OBJECT_IOU` for all boxes. Boxes with a score
    below `least_score`, without an area or with numbers that are not finite are ignored, as are all but the
    best `MAX_SUPPRESSED_BOXES`.

    Parameters
    ----------
    corners : (N, 4) x0, y0, x1, y1, pixels. scores : (N, C); the `class_id` of a box is the column.
    least_score : smallest score of a box. largest_iou : largest IoU of two boxes of one class.
    class_mask : mask of the wanted classes, by column; classes beyond its end are not wanted. By default all.
    one_to_one : the network already gives each object one box, so only `ONE_OBJECT_IOU` counts.
    """
    finite = np.isfinite(corners).all(axis=1)
    corners = corners[finite]
    scores = scores[finite]
    class_id = scores.argmax(axis=1)
    best_score = scores[np.arange(len(scores)), class_id]
    sizes = corners[:, 2:] - corners[:, :2]
    valid = (best_score >= least_score) & (sizes > 0).all(axis=1)
    if class_mask is not None:
        wanted = np.zeros(max(scores.shape[1], len(class_mask)), np.bool_)
        wanted[: len(class_mask)] = class_mask
        valid &= wanted[class_id]
    kept = np.flatnonzero(valid)
    kept = kept[np.argsort(-best_score[kept], kind="stable")][:MAX_SUPPRESSED_BOXES]
    if len(kept) == 0:
        return no_boxes()
    boxes = np.concatenate([corners[:, :2], sizes], axis=1)  # as OpenCV takes them: left, top, width, height
    if not one_to_one:
        rows = cv2.dnn.NMSBoxesBatched(
            boxes[kept].tolist(), best_score[kept].tolist(), class_id[kept].tolist(), 0.0, float(largest_iou)
        )
        kept = _rows_in_order(kept, rows)
    # One object may have boxes of two classes: a van is a car and a truck.
    rows = cv2.dnn.NMSBoxes(boxes[kept].tolist(), best_score[kept].tolist(), 0.0, ONE_OBJECT_IOU)
    kept = _rows_in_order(kept, rows)
    return Boxes(corners[kept], class_id[kept].astype(np.int64), np.clip(best_score[kept], 0.0, 1.0))


def _rows_in_order(indices: Index, rows: Any) -> Index:
    """The `indices` (K,) in the rows that OpenCV returns, in their own order, the best box first."""
    return indices[np.sort(np.asarray(rows, np.intp).ravel())]
