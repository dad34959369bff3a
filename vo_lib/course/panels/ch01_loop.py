"""Chapter 1: a loop by hand: plain Lucas-Kanade through the four images, without a prediction or a finish."""

from __future__ import annotations

from itertools import pairwise

import cv2
import numpy as np
from numpy.typing import NDArray

from ...core.matches import StereoMatches
from ...core.types import Array, Image
from ...data.sequence import Sequence
from .ch01_figures import SIDES
from .data import stereo

WINDOW, LEVELS = 15, 5


def four_images(sequence: Sequence, frame: int) -> dict[str, Image]:
    """The images of a frame and the one before, by the names in SIDES."""
    (prev_left, prev_right), (cur_left, cur_right) = stereo(sequence, frame - 1), stereo(sequence, frame)
    return dict(zip(SIDES, (prev_left, prev_right, cur_right, cur_left), strict=True))


def walk(images: dict[str, Image], uv: Array) -> tuple[StereoMatches, Array, NDArray[np.bool_]]:
    """Follow points (N, 2) of the previous left image once round the loop, back to where they started.

    Returns
    -------
    Matches of all N, the places "back" (N, 2) in the previous left image, and which were found in every
    image, (N,) bool.
    """
    places, found = [uv], np.ones(len(uv), np.bool_)
    for here, there in pairwise([*SIDES, SIDES[0]]):
        moved, status, _ = cv2.calcOpticalFlowPyrLK(
            images[here],
            images[there],
            places[-1].astype(np.float32),
            places[-1].astype(np.float32),
            winSize=(WINDOW, WINDOW),
            maxLevel=LEVELS,
        )
        places.append(np.asarray(moved, np.float64).reshape(-1, 2))
        found &= status.ravel() == 1
    prev_left, prev_right, cur_right, cur_left, back = places
    number = np.arange(len(uv))
    matches = StereoMatches(
        prev_left, prev_right, cur_left, cur_right, np.ones_like(number), np.zeros(len(uv)), number
    )
    return matches, back, found


def places_of(matches: StereoMatches, back: Array, number: int) -> dict[str, Array]:
    """The places of one feature by the names in SIDES, and "back": what `loop_picture` draws."""
    each = matches.prev_left, matches.prev_right, matches.cur_right, matches.cur_left, back
    return dict(zip((*SIDES, "back"), (uv[number] for uv in each), strict=True))
