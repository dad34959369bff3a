"""Pictures of chapter 5: scores of the cells, candidates and boxes, kept and removed features, errors."""

from __future__ import annotations

import cv2
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from vo_lib.detection.layout import STRIDES, letterboxed
from vo_lib.detection.settings import DetectorConfig
from vo_lib.detection.yolo import NetworkOutput
from vo_lib.geometry.boxes import Boxes
from vo_lib.geometry.matches import StereoMatches
from vo_lib.geometry.types import Array, BoolArray, Image
from vo_lib.report.plots import match_image

from ..colours import BAD, GOOD, bgr
from ..drawing import PHOTO_HEIGHT, WIDTH, caption, figure, finish, photo, write

MOST_DRAWN = 400  # candidates; more would hide the picture
LEAST_LABELLED = 44  # pixels of a box, for its score above it


def score_picture(image: Image, output: NetworkOutput) -> Image:
    """The network's image once per stride, from left to right; the tint of a cell shows its best score."""
    ground = photo(letterboxed(image, output.letterbox), output.letterbox.width)
    parts = []
    first = 0
    for stride in STRIDES:
        rows = output.letterbox.height // stride
        columns = output.letterbox.width // stride
        best = output.scores[first : first + rows * columns].max(axis=1).reshape(rows, columns)
        first += rows * columns
        share = np.kron(best, np.ones((stride, stride)))[:, :, None]
        tinted = (1 - share) * (0.8 * ground) + share * np.array(bgr(BAD))
        grid = np.asarray(tinted, np.uint8)
        grid[::stride] = grid[::stride] // 4 * 3
        grid[:, ::stride] = grid[:, ::stride] // 4 * 3
        words = f"stride {stride}: {columns} x {rows} cells, best {best.max():.2f}"
        parts.append(caption(photo(grid, WIDTH // 3), words))
    return np.concatenate(parts, axis=1)


def candidates_picture(
    image: Image, output: NetworkOutput, score: float, kept: Array, words: str, height: int = PHOTO_HEIGHT
) -> Image:
    """The network's image with orange candidates above a score, and with the kept boxes (K, 4) in blue."""
    picture = photo(letterboxed(image, output.letterbox), output.letterbox.width)
    best = output.scores.max(axis=1)
    passed = np.flatnonzero(best >= score)
    passed = passed[np.argsort(-best[passed], kind="stable")][:MOST_DRAWN]
    for boxes, colour, thick in ((output.corners[passed], BAD, 1), (kept, GOOD, 2)):
        for x0, y0, x1, y1 in np.rint(np.clip(boxes, -9, 9999)).astype(int).tolist():
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
    """The image with kept matches in blue, removed matches in orange, and the vehicle boxes."""
    drawn = match_image(image, matches, keep, boxes, state)
    for (x0, y0, x1, _), score in zip(np.rint(boxes.xyxy).astype(int).tolist(), boxes.score, strict=True):
        if x1 - x0 >= LEAST_LABELLED:  # words above small boxes would cover each other
            write(drawn, f"{score:.2f}", max(x0, 0), max(y0 - 4, 16), 0.55)
    return caption(photo(drawn, WIDTH, PHOTO_HEIGHT), words)


def precision_figure(scores: Array, precision: Array, recall: Array) -> Figure:
    """Precision and recall for each score as a curve; the default score is marked."""
    made, (axis,) = figure(230)
    default = DetectorConfig().score
    at = max(int(np.sum(scores >= default)) - 1, 0)
    axis.plot(recall, precision, color=GOOD)
    axis.plot(recall[at], precision[at], "o", color=BAD, label=f"score {default:g}")
    axis.set(xlim=(0, 1.02), ylim=(0, 1.02))
    finish(axis, "precision and recall of all scores", "recall", "precision", "lower left")
    return made
