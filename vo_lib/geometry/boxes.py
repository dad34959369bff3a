"""Vehicle boxes of one image."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .rows import Rows
from .types import Array, IntArray

# State of the vehicle in a box (`Removal.state` in `paper.box_removal`).
PARKED = 0
UNKNOWN = 1
MOVING = 2

VEHICLES = "vehicles"  # stands for all classes of vehicles in a list of chosen classes


@dataclass(frozen=True, eq=False)
class Boxes(Rows):
    """K boxes in one image.

    Attributes
    ----------
    xyxy : (K, 4) left, top, right, bottom, pixels (pixel centres at integers).
    class_id : (K,) int. As read: the label file's or model's number of the class; after the choice of
        classes: COCO's number of that kind of vehicle.
    score : (K,) in [0, 1]; 1 for labels without a score.
    """

    xyxy: Array
    class_id: IntArray
    score: Array


def area(xyxy: Array) -> Array:
    """Areas (K,) of boxes (K, 4), pixels²."""
    return np.asarray(np.prod(xyxy[:, 2:] - xyxy[:, :2], axis=1))


def common_area(a: Array, b: Array) -> Array:
    """Areas (M, K), pixels², of the intersections of boxes (M, 4) with boxes (K, 4)."""
    low = np.maximum(a[:, None, :2], b[None, :, :2])
    high = np.minimum(a[:, None, 2:], b[None, :, 2:])
    return np.asarray(np.prod(np.maximum(high - low, 0.0), axis=2))


def overlap(a: Array, b: Array) -> Array:
    """Intersection over union (M, K) of boxes (M, 4) with boxes (K, 4)."""
    common = common_area(a, b)
    return np.asarray(common / np.maximum(area(a)[:, None] + area(b) - common, 1e-9))


def no_boxes() -> Boxes:
    """An empty set of boxes."""
    return Boxes(np.zeros((0, 4)), np.zeros(0, np.int64), np.zeros(0))
