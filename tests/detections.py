"""How good detections are: recall and precision at one overlap."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vo_lib.core.boxes import Boxes, area, common_area, overlap
from vo_lib.core.types import Array, Mask, Whole


@dataclass(frozen=True)
class Judged:
    """Detections of one image beside its truth.

    Attributes
    ----------
    score, right : (D,) of the detections that count; `right` where one found a true box of its own.
    wanted : (K,) classes of the true boxes that count.
    """

    score: Array
    right: Mask
    wanted: Whole


def judge(found: Boxes, truth: Boxes, regions: Array, min_height: float = 0.0, least: float = 0.5) -> Judged:
    """Compare the detections of one image with its truth.

    A detection is right when it overlaps a true box of its class, not yet found by a better one, by an IoU of
    `least` or more. True boxes lower than `min_height`, and what is found of them, do not count; neither do
    detections lower than that, nor those at least half inside one of the `regions` (M, 4), unless right.
    """
    order = np.argsort(-found.score, kind="stable")
    boxes, kinds = found.xyxy[order], found.class_id[order]
    tall = truth.xyxy[:, 3] - truth.xyxy[:, 1] >= min_height
    shared = np.where(kinds[:, None] == truth.class_id[None], overlap(boxes, truth.xyxy), 0.0)
    free = np.ones(len(truth), np.bool_)
    right, counts = np.zeros(len(boxes), np.bool_), np.ones(len(boxes), np.bool_)
    aside = np.asarray((common_area(boxes, regions) >= 0.5 * area(boxes)[:, None]).any(axis=1))
    low = boxes[:, 3] - boxes[:, 1] < min_height
    for k in range(len(boxes)):
        # A box that counts goes before one that does not, then the larger overlap.
        worth = shared[k] * free * np.where(tall, 2.0, 1.0)
        best = int(worth.argmax()) if len(truth) else -1
        if best >= 0 and shared[k, best] >= least and free[best]:
            free[best] = False
            right[k], counts[k] = tall[best], tall[best]
        else:
            counts[k] = not (aside[k] or low[k])
    return Judged(found.score[order][counts], right[counts], truth.class_id[tall])


def recall_precision(images: list[Judged], score: float = 0.0) -> tuple[float, float]:
    """Recall and precision of all images' detections scored at least `score`; NaN where undefined."""
    above = [part.right[part.score >= score] for part in images]
    right, found = sum(int(part.sum()) for part in above), sum(len(part) for part in above)
    wanted = sum(len(part.wanted) for part in images)
    return (right / wanted if wanted else np.nan), (right / found if found else np.nan)
