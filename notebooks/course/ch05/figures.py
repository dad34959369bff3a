"""Pictures of chapter 5, part one: candidates and boxes of a network, kept and removed features."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from vo_lib.detection.network_image import letterboxed
from vo_lib.detection.yolo import NetworkOutput
from vo_lib.geometry.boxes import Boxes, no_boxes
from vo_lib.geometry.matches import StereoMatches
from vo_lib.geometry.types import Array, BoolArray, Image
from vo_lib.report.plots import match_image

from ..colours import BAD, GOOD, bgr
from ..drawing import PHOTO_HEIGHT, WIDTH, caption, photo, write
from .real_drives import BoxDistances, farthest_box

MOST_DRAWN = 400  # candidates; more would hide the picture
LEAST_LABELLED = 44  # pixels of a box, for its score above it


def candidates_picture(
    image: Image, output: NetworkOutput, score: float, kept: Array, words: str, height: int = PHOTO_HEIGHT
) -> Image:
    """The network's image with orange candidates above a score, and with the kept boxes (K, 4) in blue."""
    # First enlarged, then drawn on, so that the lines are as thin for a network with a small image.
    seen = letterboxed(image, output.letterbox)
    scale = min(WIDTH / seen.shape[1], height / seen.shape[0])
    picture = photo(seen, round(scale * seen.shape[1]))
    best = output.scores.max(axis=1)
    passed = np.flatnonzero(best >= score)
    passed = passed[np.argsort(-best[passed], kind="stable")][:MOST_DRAWN]
    for boxes, colour, thick in ((output.corners[passed], BAD, 1), (kept, GOOD, 2)):
        places = scale * (np.clip(boxes, -9, 9999) + 0.5) - 0.5  # OpenCV counts from centres
        for x0, y0, x1, y1 in np.rint(places).astype(int).tolist():
            cv2.rectangle(picture, (x0, y0), (x1, y1), bgr(colour), thick, cv2.LINE_AA)
    return caption(photo(picture, WIDTH, height), words)


def filter_picture(
    image: Image,
    matches: StereoMatches,
    keep: BoolArray,
    boxes: Boxes,
    state: NDArray[np.int64] | None,
    words: str,
) -> Image:
    """The image with kept matches in blue, removed matches in orange, and the vehicle boxes.

    keep : (N,) mask of the kept matches. boxes : K vehicle boxes.
    state : (K,) of a `Removal`: parked, unknown or moving boxes; None if the rule does not tell them apart.
    """
    drawn = match_image(image, matches, keep, boxes, state)
    for (x0, y0, x1, _), score in zip(np.rint(boxes.xyxy).astype(int).tolist(), boxes.score, strict=True):
        if x1 - x0 >= LEAST_LABELLED:  # words above small boxes would cover each other
            write(drawn, f"{score:.2f}", max(x0, 0), max(y0 - 4, 16), 0.55)
    return caption(photo(drawn, WIDTH, PHOTO_HEIGHT), words)


def numbered_picture(
    image: Image,
    matches: StereoMatches,
    keep: BoolArray,
    boxes: Boxes,
    rows: list[BoxDistances],
    words: str,
) -> Image:
    """The picture of kept and other features, with boxes that are numbered from left to right.

    The box of `farthest_box` is black, the others are white with a black rim, which shows on every ground.
    """
    drawn = match_image(image, matches, keep, no_boxes())
    far = farthest_box(rows)
    for number, each in enumerate(rows):
        if each.row < 0:
            continue
        x0, y0, x1, y1 = np.rint(boxes.xyxy[each.row]).astype(int).tolist()
        inner = (0, 0, 0) if each is far else (255, 255, 255)
        cv2.rectangle(drawn, (x0, y0), (x1, y1), (0, 0, 0), 4 if each is far else 3, cv2.LINE_AA)
        cv2.rectangle(drawn, (x0, y0), (x1, y1), inner, 1, cv2.LINE_AA)
        write(drawn, str(number), max(x0, 0), max(y0 - 4, 16), 0.6)
    return caption(photo(drawn, WIDTH, PHOTO_HEIGHT), words)
