"""Chapter 5: which matches stay when features in vehicle boxes are removed."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .config import FilterConfig
from .detection import Boxes
from .matching import StereoMatches

Array = NDArray[np.float64]


def in_boxes(uv: Array, boxes: Boxes, config: FilterConfig) -> NDArray[np.bool_]:
    """Which pixels (N, 2) lie in a vehicle's box of enough score, grown by the margin. (N,) bool."""
    chosen = np.isin(boxes.class_id, config.classes) & (boxes.score >= config.score)
    x0, y0, x1, y1 = boxes.xyxy[chosen].T[:, :, None]
    grow_x, grow_y = config.margin * (x1 - x0), config.margin * (y1 - y0)
    u, v = uv[:, 0], uv[:, 1]
    inside = (u >= x0 - grow_x) & (u <= x1 + grow_x) & (v >= y0 - grow_y) & (v <= y1 + grow_y)
    return np.asarray(inside.any(axis=0))


def static_matches(
    matches: StereoMatches, boxes_p: Boxes, boxes_c: Boxes, config: FilterConfig
) -> tuple[NDArray[np.bool_], bool]:
    """Matches to keep, (N,) bool, and whether the filter had to be off (paper, section 3).

    A match goes when its left point, previous or current, lies in a box. Where too few would be left,
    all stay: a motion from vehicles is better than a motion from a handful of points.
    """
    everything = np.ones(len(matches), np.bool_)
    if config.rule == "none":
        return everything, False
    keep = ~in_boxes(matches.prev_left, boxes_p, config) & ~in_boxes(matches.cur_left, boxes_c, config)
    left = int(np.count_nonzero(keep))
    too_few = left < len(matches) and (left < config.min_matches or left < config.min_share * len(matches))
    return (everything, True) if too_few else (keep, False)
