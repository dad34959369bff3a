"""Matches, the result of a front end: features in all four images of two stereo pairs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .rows import Rows
from .types import Array, IntArray


@dataclass(frozen=True, eq=False)
class StereoMatches(Rows):
    """N features in all four images of two stereo pairs.

    A corrected calibration (variant `kit`) may leave a disparity of zero or less: such a match has no depth.

    Attributes
    ----------
    prev_left, prev_right, cur_left, cur_right : (N, 2) float, pixels (u, v), sub-pixel.
    age : (N,) int, frames before the current one in which the feature was seen, >= 1.
    strength : (N,) float, the detector's response; larger is better.
    id : (N,) int, number of the feature, equal in all its frames.
    """

    prev_left: Array
    prev_right: Array
    cur_left: Array
    cur_right: Array
    age: IntArray
    strength: Array
    id: IntArray


def empty_matches() -> StereoMatches:
    """An empty set of matches."""
    uv = np.zeros((0, 2))
    numbers = np.zeros(0, np.int64)
    return StereoMatches(uv, uv, uv, uv, numbers, np.zeros(0), numbers)
