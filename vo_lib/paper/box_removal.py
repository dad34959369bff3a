"""Removal of the features in vehicle boxes (chapter 5; paper, section 3).

The paper removes the features in the boxes before the motion is estimated, and leaves the rest open:

- In which image must a feature be in a box? Boxes exist in the left images only, so a match is judged by its
  two left pixels, and one of them in a box is enough.
- Before or after the buckets? Before them (`odometry`).
- Which vehicles? The paper has cars in one place, cars and trucks in another. Here they are cars, buses and
  trucks, unless the setting `classes` names others; parked ones count, too.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..geometry.boxes import Boxes, no_boxes
from ..geometry.matches import StereoMatches
from ..geometry.result import Flag
from ..geometry.types import Array, BoolArray, IntArray
from .settings import FilterConfig


@dataclass(frozen=True, eq=False)
class Removal:
    """What a box rule does to the N matches of a frame.

    Attributes
    ----------
    kept : (N,) mask of the matches that are not removed.
    boxes : the K vehicle boxes in the current left image, with the margin.
    state : (K,) PARKED, UNKNOWN or MOVING (`geometry.boxes`); None for a rule that treats all vehicles alike,
        such as `all`.
    flags : remarks on the frame.
    """

    kept: BoolArray
    boxes: Boxes
    state: IntArray | None = None
    flags: tuple[Flag, ...] = ()


class BoxFilter:
    """The box rule on a sequence: `start` with the first frame, then `step` with each further frame.

    A match has a pixel in the previous left image too, so the filter remembers the boxes of one frame.
    """

    def __init__(self, config: FilterConfig):
        self.config = config
        self._previous_boxes = no_boxes()

    def start(self, boxes: Boxes) -> None:
        """Remember the boxes in the first frame's left image."""
        self._previous_boxes = boxes

    def step(self, matches: StereoMatches, boxes: Boxes) -> Removal:
        """What the rule does to the matches (N) between the previous frame and the frame with these boxes."""
        previous_boxes = self._previous_boxes
        self._previous_boxes = boxes
        if self.config.rule == "none":
            kept = np.ones(len(matches), np.bool_)
        else:
            kept = ~on_vehicles(matches, previous_boxes, boxes, self.config)
        return Removal(kept, vehicles(boxes, self.config))


def vehicles(boxes: Boxes, config: FilterConfig) -> Boxes:
    """The boxes with a sufficient score, enlarged by the margin.

    The setting `classes` is not used here: a sequence gives boxes of the chosen classes only.
    """
    selection = boxes[boxes.score >= config.score]
    top_left = selection.xyxy[:, :2]
    bottom_right = selection.xyxy[:, 2:]
    margin = config.margin * (bottom_right - top_left)
    enlarged = np.concatenate([top_left - margin, bottom_right + margin], axis=1)
    return replace(selection, xyxy=enlarged)


def inside(uv: Array, xyxy: Array) -> BoolArray:
    """For each of N pixels (N, 2) and each of K boxes (K, 4), whether the pixel is in the box, (N, K).

    The borders belong to the box.
    """
    u = uv[:, :1]
    v = uv[:, 1:]
    return (u >= xyxy[:, 0]) & (u <= xyxy[:, 2]) & (v >= xyxy[:, 1]) & (v <= xyxy[:, 3])


def in_boxes(uv: Array, boxes: Boxes, config: FilterConfig) -> BoolArray:
    """Mask (N,) of the pixels (N, 2) that are in any vehicle box of their image."""
    return np.asarray(inside(uv, vehicles(boxes, config).xyxy).any(axis=1))


def on_vehicles(matches: StereoMatches, boxes_p: Boxes, boxes_c: Boxes, config: FilterConfig) -> BoolArray:
    """Mask (N,) of the matches that are in a vehicle box of the previous or of the current left image."""
    return in_boxes(matches.prev_left, boxes_p, config) | in_boxes(matches.cur_left, boxes_c, config)
