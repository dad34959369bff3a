"""Chapter 5, drawn: scores of the cells, candidates and boxes, kept and removed features, errors by rule."""

from __future__ import annotations

import cv2
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from vo_lib.detection.layout import STRIDES, letterboxed
from vo_lib.detection.settings import DetectorConfig
from vo_lib.detection.yolo import NetworkOutput
from vo_lib.geometry.boxes import Boxes
from vo_lib.geometry.matches import StereoMatches
from vo_lib.geometry.types import Array, BoolArray, Image
from vo_lib.report.plots import match_image

from ..ch04.figures import mark_reference, millimetres_from_above
from ..colours import BAD, DARK, GOOD, PALE, bgr
from ..drawing import COARSE, FONT_SIZE, WIDTH, caption, figure, finish, photo, room

MOST_DRAWN = 400  # candidates; more would hide the picture
LEAST_LABELLED = 44  # pixels of a box, for its score above it
DOTS = (PALE, 9.0), (GOOD, 6.0)  # with all features, with those kept: colour, size in points


def score_picture(image: Image, found: NetworkOutput) -> Image:
    """The network's image three times, left to right its strides: each cell tinted by its best score."""
    ground, parts, first = photo(letterboxed(image, found.letterbox), found.letterbox.width), [], 0
    for stride in STRIDES:
        rows, columns = found.letterbox.height // stride, found.letterbox.width // stride
        best = found.scores[first : first + rows * columns].max(axis=1).reshape(rows, columns)
        first += rows * columns
        share = np.kron(best, np.ones((stride, stride)))[:, :, None]
        tinted = (1 - share) * (0.8 * ground) + share * np.array(bgr(BAD))
        grid = np.asarray(tinted, np.uint8)
        grid[::stride] = grid[::stride] // 4 * 3
        grid[:, ::stride] = grid[:, ::stride] // 4 * 3
        small = photo(grid, WIDTH // 3 - 2)
        parts.append(caption(small, f"stride {stride}: {columns} x {rows} cells, best {best.max():.2f}"))
    rims = ((0, 0), (1, 1), (0, 0))
    joined = np.concatenate([np.pad(part, rims, constant_values=255) for part in parts], axis=1)
    return np.pad(joined, ((0, 0), (0, WIDTH - joined.shape[1]), (0, 0)), constant_values=255)


def candidates_picture(
    image: Image, found: NetworkOutput, score: float, kept: Array, words: str, width: int, height: int
) -> Image:
    """The network's image with all candidates above the score threshold, thin orange, and the final boxes,
    blue.

    Parameters
    ----------
    kept : (K, 4) corners in the network's image, pixels. width, height : of the picture.
    """
    picture = photo(letterboxed(image, found.letterbox), found.letterbox.width)
    best = found.scores.max(axis=1)
    passed = np.flatnonzero(best >= score)
    passed = passed[np.argsort(-best[passed], kind="stable")][:MOST_DRAWN]
    for boxes, colour, thick in ((found.corners[passed], BAD, 1), (kept, GOOD, 2)):
        for x0, y0, x1, y1 in np.rint(np.clip(boxes, -9, 9999)).astype(int).tolist():
            cv2.rectangle(picture, (x0, y0), (x1, y1), bgr(colour), thick, cv2.LINE_AA)
    return caption(photo(picture, width, height), words)


def filter_picture(
    image: Image,
    matches: StereoMatches,
    keep: BoolArray,
    boxes: Boxes,
    state: NDArray[np.int64] | None,
    words: str,
    height: int,
) -> Image:
    """The image with its matches, kept ones blue, removed ones orange, and the vehicle boxes."""
    # Words above small boxes would cover each other.
    wide = np.ptp(boxes.xyxy[:, ::2], axis=1) >= LEAST_LABELLED
    scores = [f"{score:.2f}" if each else "" for score, each in zip(boxes.score, wide, strict=True)]
    return caption(photo(match_image(image, matches, keep, boxes, state, scores), WIDTH, height), words)


def errors_chart(axis: Axes, errors: dict[str, Array], reference: str, title: str) -> None:
    """Distances (3,) of t_cp from the reference, from above, millimetres, by name.

    The first is pale and large, the second blue.
    """
    mark_reference(axis, reference)
    for (name, error), (colour, size) in zip(errors.items(), DOTS, strict=True):
        axis.plot(*error[[0, 2]], "o", color=colour, markeredgecolor=DARK, markersize=size, label=name)
    largest = max(float(np.abs(error[[0, 2]]).max()) for error in errors.values())
    half = room(1.2 * largest, steps=COARSE, least=1)
    millimetres_from_above(axis, half, title)
    axis.set_xlim(-1.9 * half, half)  # the legend is on the left, off the dots
    axis.legend(loc="upper left", fontsize=FONT_SIZE - 1)


def precision_figure(scores: Array, precision: Array, recall: Array) -> Figure:
    """Precision over recall, the preset's score marked, and both over the score."""
    made, (curve, by_score) = figure(230, 2)
    preset = DetectorConfig().score
    at = max(int(np.sum(scores >= preset)) - 1, 0)
    curve.plot(recall, precision, color=GOOD)
    curve.plot(recall[at], precision[at], "o", color=BAD, label=f"score {preset:g}")
    by_score.plot(scores, precision, color=GOOD, label="precision")
    by_score.plot(scores, recall, color=BAD, label="recall")
    for axis in (curve, by_score):
        axis.set(xlim=(0, 1.02), ylim=(0, 1.02))
    finish(curve, "every score is a point", "recall", "precision", "lower left")
    finish(by_score, "both over the smallest score", "score", "", "lower left")
    return made
