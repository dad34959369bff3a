"""Chapter 5: which features lie in vehicle boxes, and so are removed (paper, section 3)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..geometry.boxes import Boxes
from ..geometry.matches import StereoMatches
from ..geometry.types import Array, BoolArray
from .settings import FilterConfig


def vehicles(boxes: Boxes, config: FilterConfig) -> Boxes:
    """The boxes of vehicles scored well enough, each grown by the margin."""
    chosen = boxes[np.isin(boxes.class_id, config.classes) & (boxes.score >= config.score)]
    low, high = chosen.xyxy[:, :2], chosen.xyxy[:, 2:]
    grow = config.margin * (high - low)
    return replace(chosen, xyxy=np.concatenate([low - grow, high + grow], axis=1))


def inside(uv: Array, xyxy: Array) -> BoolArray:
    """Which of N pixels (N, 2) lie in which of K boxes (K, 4), borders included. (N, K) bool."""
    u, v = uv[:, :1], uv[:, 1:]
    return (u >= xyxy[:, 0]) & (u <= xyxy[:, 2]) & (v >= xyxy[:, 1]) & (v <= xyxy[:, 3])


def in_boxes(uv: Array, boxes: Boxes, config: FilterConfig) -> BoolArray:
    """Which pixels (N, 2) lie in a vehicle's box. (N,) bool."""
    return np.asarray(inside(uv, vehicles(boxes, config).xyxy).any(axis=1))


def on_vehicles(matches: StereoMatches, boxes_p: Boxes, boxes_c: Boxes, config: FilterConfig) -> BoolArray:
    """Which matches (N,) lie in a vehicle's box, in the previous or in the current left image."""
    return in_boxes(matches.prev_left, boxes_p, config) | in_boxes(matches.cur_left, boxes_c, config)
