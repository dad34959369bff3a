"""Matches drawn into a picture: dots with names, and lines from start to end."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from vo_lib.geometry.types import Array, BoolArray, Image

from .colours import BAD, FIFTH, GOOD, PALE, bgr
from .drawing import PHOTO_HEIGHT, WIDTH, caption, photo


def draw_dots(
    picture: Image, places: Array, colours: Sequence[str], radius: float, names: Sequence[object] = ()
) -> None:
    """Draw discs at positions (N, 2) of a BGR picture, in place; then names in black boxes over the discs.

    names : one for each of the first positions; there may be fewer names than positions.
    """
    font = cv2.FONT_HERSHEY_SIMPLEX
    size = 0.55
    white = (255, 255, 255)
    # OpenCV draws at fractions of a pixel if it gets whole numbers of sixteenths (shift=4).
    sixteenths = np.rint(np.asarray(places) * 16).astype(int).tolist()
    for place, colour in zip(sixteenths, colours, strict=True):
        cv2.circle(picture, place, round(radius * 16), bgr(colour), -1, cv2.LINE_AA, shift=4)
    for (u, v), each in zip(sixteenths, names, strict=False):
        name = str(each)
        (w, h), _ = cv2.getTextSize(name, font, size, 1)
        x = min(u // 16 + 9, picture.shape[1] - w - 3)
        y = max(v // 16 - 6, h + 3)
        cv2.rectangle(picture, (x - 2, y - h - 3), (x + w + 2, y + 3), (0, 0, 0), -1)
        cv2.putText(picture, name, (x, y), font, size, white, 1, cv2.LINE_AA)


def draw_flow(
    picture: Image, start: Array, end: Array, colours: Sequence[str], radius: float, thickness: int = 1
) -> None:
    """Draw lines from starts (N, 2) to discs at ends (N, 2), pixels, the last line on top, in place."""
    places = np.rint(16 * np.stack([start, end], axis=1)).astype(int).tolist()
    paint = {colour: bgr(colour) for colour in set(colours)}
    for (a, b), colour in zip(places, colours, strict=True):
        cv2.line(picture, a, b, paint[colour], thickness, cv2.LINE_AA, shift=4)
        cv2.circle(picture, b, round(16 * radius), paint[colour], -1, cv2.LINE_AA, shift=4)


def features_picture(
    image: Image,
    start: Array,
    end: Array,
    weight: Array | BoolArray,
    words: str,
    ringed: BoolArray | None = None,
) -> Image:
    """An image with a line from each start (N, 2) to a dot at its end (N, 2), coloured by weight.

    weight : (N,) in [0, 1] or a mask; blue from ½, orange below ½, grey for NaN. ringed : (N,) mask of rings.
    """
    picture = photo(image, image.shape[1])
    if ringed is not None:
        for place in np.rint(16 * end[ringed]).astype(int).tolist():
            cv2.circle(picture, place, 5 * 16, bgr(FIFTH), 1, cv2.LINE_AA, shift=4)
    # What is drawn last is on top: first NaN, then weight 1, and outliers with weight 0 at the end.
    order = np.argsort(np.nan_to_num(-1.0 * weight, nan=-2.0))
    colours = np.where(np.isnan(weight), PALE, np.where(weight >= 0.5, GOOD, BAD))[order]
    draw_flow(picture, start[order], end[order], colours.tolist(), 2.5)
    return caption(photo(picture, WIDTH, PHOTO_HEIGHT), words)
