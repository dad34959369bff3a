"""Removal of the features in vehicle boxes (chapter 5; paper, section 3)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..geometry.boxes import Boxes
from ..geometry.matches import StereoMatches
from ..geometry.types import Array, BoolArray
from .settings import FilterConfig


def vehicles(boxes: Boxes, config: FilterConfig) -> Boxes:
    """The boxes of vehicles with a sufficient score, enlarged by the margin."""
    selection = boxes[np.isin(boxes.class_id, config.classes) & (boxes.score >= config.score)]
    low, high = selection.xyxy[:, :2], selection.xyxy[:, 2:]
    grow = config.margin * (high - low)
    return replace(selection, xyxy=np.concatenate([low - grow, high + grow], axis=1))


def inside(uv: Array, xyxy: Array) -> BoolArray:
    """Mask (N, K) of pixels (N, 2) in boxes (K, 4), borders included."""
    u, v = uv[:, :1], uv[:, 1:]
    return (u >= xyxy[:, 0]) & (u <= xyxy[:, 2]) & (v >= xyxy[:, 1]) & (v <= xyxy[:, 3])


def in_boxes(uv: Array, boxes: Boxes, config: FilterConfig) -> BoolArray:
    """Mask (N,) of pixels (N, 2) in vehicle boxes."""
    return np.asarray(inside(uv, vehicles(boxes, config).xyxy).any(axis=1))


def on_vehicles(matches: StereoMatches, boxes_p: Boxes, boxes_c: Boxes, config: FilterConfig) -> BoolArray:
    """Mask (N,) of matches in a vehicle box of the previous or the current left image."""
    return in_boxes(matches.prev_left, boxes_p, config) | in_boxes(matches.cur_left, boxes_c, config)
