"""How good detections are: recall and precision at one overlap."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from vo_lib.geometry.boxes import Boxes, area, common_area, overlap
from vo_lib.geometry.types import Array

MIN_IOU = 0.5


def recall_precision(
    images: Iterable[tuple[Boxes, Boxes, Array]], min_height: float
) -> tuple[float, float, int]:
    """Recall, precision and number of true boxes, of detections, truth and regions (M, 4) of each image.

    A detection is right when it overlaps a true box, not yet found by a better one, by `MIN_IOU` or more.
    True boxes lower than `min_height`, and detections of them, do not count; neither do wrong detections
    lower than that, or at least half inside one of the regions.
    """
    right = counted = wanted = 0
    for result, truth, regions in images:
        boxes = result.xyxy[np.argsort(-result.score, kind="stable")]
        tall = truth.xyxy[:, 3] - truth.xyxy[:, 1] >= min_height
        shared, free = overlap(boxes, truth.xyxy), np.ones(len(truth), np.bool_)
        aside = (common_area(boxes, regions) >= 0.5 * area(boxes)[:, None]).any(axis=1)
        aside |= boxes[:, 3] - boxes[:, 1] < min_height
        for k in range(len(boxes)):
            # A true box that counts goes before one that does not, then the larger overlap.
            worth = np.where(free & (shared[k] >= MIN_IOU), shared[k] + tall, 0.0)
            best = int(worth.argmax()) if worth.any() else -1
            if best >= 0:
                free[best] = False
                right, counted = right + int(tall[best]), counted + int(tall[best])
            else:
                counted += int(not aside[k])
        wanted += int(tall.sum())
    return right / max(wanted, 1), right / max(counted, 1), wanted
