"""Pictures of chapter 5, part two: cells, windows, curves, judged boxes, and the parts of YOLOv8."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from pathlib import Path

import cv2
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import FancyBboxPatch

from vo_lib.evaluation.statistics import mean_and_deviation, one_run_shows, standard_deviation
from vo_lib.geometry.boxes import overlap
from vo_lib.geometry.types import Array, BoolArray, Image

from ..colours import BAD, DARK, GOOD, PALE, THIRD, bgr
from ..drawing import PHOTO_HEIGHT, WIDTH, caption, figure, finish, photo, write
from ..notebook_folder import NOTEBOOKS
from .figures import LEAST_LABELLED
from .layers import CONTRAST, GREY

MEASURED = NOTEBOOKS / "miniature.csv"  # written by `vo data measure_miniature`
RIGHT_IOU = 0.5
WINDOWS_A_ROW = 4
NAMES_ROOM = 0.035  # beside a chart, for names of its rows, as a share of the width
SMOOTH = 25  # steps of a mean of the loss
LINES = (GOOD, BAD, THIRD, DARK)  # colours of curves and of rows of dots, in their order
WHITE = (255, 255, 255)
# Of the drawing of YOLOv8: colours of its parts, and distance of the levels.
IN_MINIATURE = "#d5e6f3"
NOT_IN_MINIATURE = "#ffffff"
ROW = 1.15
# mAP50 of `street` by epoch, counted over its three trainings of 6, 1 and 14 epochs one after the other, as
# vo_lib/detection/models/street.md tells it. Of the third one, only the range is known.
STREET_HISTORY = ((1, 0.66), (6, 0.897), (7, 0.903))
STREET_LATER = (8, 21, 0.911, 0.947)  # first and last epoch, lowest and highest mAP50


def right_boxes(boxes: Array, scores: Array, labels: Array) -> BoolArray:
    """Which boxes (N, 4) are right: the best-scored one on each label, with an IoU of at least ½.

    The rule of the notebook's `judge`: a second box on the same vehicle is wrong.
    """
    right = np.zeros(len(boxes), np.bool_)
    if len(labels) == 0:
        return right
    shares = overlap(boxes, labels)  # a label that has its box counts no more
    for k in np.argsort(-scores, kind="stable").tolist():
        best = int(np.argmax(shares[k]))
        if shares[k, best] >= RIGHT_IOU:
            right[k] = True
            shares[:, best] = 0.0
    return right


def boxes_picture(
    image: Image, boxes: Array, scores: Array, labels: Array | None, words: str, least: float = 0.0
) -> Image:
    """The image with boxes from a score on: right ones blue, wrong ones orange, labels white.

    `right_boxes` decides; of two boxes on one vehicle, one is wrong. Without labels, all boxes are blue.
    """
    drawn = photo(image, image.shape[1])
    boxes = boxes[scores >= least]
    scores = scores[scores >= least]
    right = np.ones(len(boxes), np.bool_)
    if labels is not None:
        right = right_boxes(boxes, scores, labels)
        for x0, y0, x1, y1 in np.rint(labels).astype(int).tolist():
            cv2.rectangle(drawn, (x0, y0), (x1, y1), (0, 0, 0), 5, cv2.LINE_AA)
            cv2.rectangle(drawn, (x0, y0), (x1, y1), WHITE, 3, cv2.LINE_AA)
    corners = np.rint(boxes).astype(int).tolist()
    for (x0, y0, x1, y1), good in zip(corners, right.tolist(), strict=True):
        cv2.rectangle(drawn, (x0, y0), (x1, y1), bgr(GOOD if good else BAD), 2, cv2.LINE_AA)
    for (x0, y0, x1, _), score in zip(corners, scores.tolist(), strict=True):
        if x1 - x0 >= LEAST_LABELLED and score < 1.0:
            write(drawn, f"{score:.2f}", max(x0, 0), max(y0 - 4, 16), 0.55)
    return caption(photo(drawn, WIDTH, PHOTO_HEIGHT), words)


def cells_picture(
    image: Image,
    tint: Array,
    size: float,
    words: str,
    boxes: Array | None = None,
    cell: tuple[int, int] | None = None,
    sides: Array | None = None,
) -> Image:
    """An image with the grid of cells, `size` pixels wide, tinted by numbers from 0 to 1 (h, w).

    boxes : (K, 4), white. cell : row and column of a cell whose centre and four sides (4,), pixels, are drawn.
    """
    drawn = photo(image, WIDTH)
    scale = WIDTH / image.shape[1]
    height, width = drawn.shape[:2]
    step = size * scale
    rows, columns = tint.shape
    cell_row = np.minimum((np.arange(height) / step).astype(int), rows - 1)
    cell_column = np.minimum((np.arange(width) / step).astype(int), columns - 1)
    share = 0.75 * np.clip(tint, 0.0, 1.0)[cell_row][:, cell_column][..., None]
    tinted = (1 - share) * drawn + share * np.array(bgr(BAD))
    drawn = np.ascontiguousarray(tinted, np.uint8)
    for k in range(1, columns):
        cv2.line(drawn, (round(k * step), 0), (round(k * step), height), (150, 150, 150), 1)
    for k in range(1, rows):
        cv2.line(drawn, (0, round(k * step)), (width, round(k * step)), (150, 150, 150), 1)
    scaled = np.zeros((0, 4)) if boxes is None else (boxes + 0.5) * scale
    for box in scaled:
        x0, y0, x1, y1 = np.rint(box).astype(int).tolist()
        cv2.rectangle(drawn, (x0, y0), (x1, y1), WHITE, 2, cv2.LINE_AA)
    if cell is not None and sides is not None:
        row, column = cell
        _draw_sides(drawn, (column + 0.5) * step, (row + 0.5) * step, sides * scale)
    return caption(drawn, words)


def _draw_sides(picture: Image, u: float, v: float, sides: Array) -> None:
    """Draw a box with arrows from (u, v) to its left, upper, right and lower side, `sides` (4,) pixels away."""
    left, top, right, bottom = sides.tolist()
    upper_left = (round(u - left), round(v - top))
    lower_right = (round(u + right), round(v + bottom))
    cv2.rectangle(picture, upper_left, lower_right, bgr(GOOD), 2, cv2.LINE_AA)
    middle = (round(u), round(v))
    for x, y in ((u - left, v), (u, v - top), (u + right, v), (u, v + bottom)):
        cv2.arrowedLine(picture, middle, (round(x), round(y)), bgr(GOOD), 2, cv2.LINE_AA)


def windows_picture(windows: Sequence[tuple[Array, Array]], words: str) -> Image:
    """Training windows, each an input (h, w, 1) with its boxes (K, 4), in rows of four."""
    parts = []
    for values, boxes in windows:
        grey = np.clip(values[..., 0] * CONTRAST + GREY, 0, 255).astype(np.uint8)
        part = photo(grey, WIDTH // WINDOWS_A_ROW)
        scale = part.shape[1] / grey.shape[1]
        for x0, y0, x1, y1 in np.rint(boxes * scale).astype(int).tolist():
            cv2.rectangle(part, (x0, y0), (x1, y1), WHITE, 2, cv2.LINE_AA)
        part[:, -2:] = 255
        part[-2:] = 255
        parts.append(part)
    rows = [
        np.concatenate(parts[start : start + WINDOWS_A_ROW], axis=1)
        for start in range(0, len(parts), WINDOWS_A_ROW)
    ]
    return caption(np.concatenate(rows), words)


def loss_figure(history: Array, height: int = 230) -> Figure:
    """Losses of the scores and of the boxes by step (steps, 2), each point a mean of some steps."""
    made, axes = figure(height, 2)
    width = min(SMOOTH, len(history))
    for axis, values, title in zip(axes, history.T, ("loss of the scores", "loss of the boxes"), strict=True):
        smooth = np.convolve(values, np.full(width, 1 / width), mode="valid")
        axis.plot(np.arange(len(smooth)) + width / 2, smooth, color=GOOD)
        axis.set_ylim(0)
        finish(axis, f"{title}, mean of {width} steps", "step")
    return made


def curves_figure(curves: Mapping[str, tuple[Array, Array]], height: int = 260) -> Figure:
    """Precision by recall of several detectors or streets; each is a pair (precision, recall)."""
    made, (axis,) = figure(height)
    for n, (name, (precision, recall)) in enumerate(curves.items()):
        style = "-" if n < len(LINES) else "--"
        axis.plot(recall, precision, color=LINES[n % len(LINES)], linestyle=style, label=name)
    axis.set(xlim=(0, 1.02), ylim=(0, 1.02))
    finish(axis, "precision and recall of all scores", "recall", "precision", "lower left")
    return made


def measured(path: Path = MEASURED) -> dict[str, dict[str, Array]]:
    """The measured numbers of `vo data measure_miniature`: by experiment, each column's values over the seeds."""
    with path.open(encoding="utf-8", newline="") as lines:
        rows = list(csv.DictReader(lines))
    columns = [name for name in rows[0] if name not in ("experiment", "code")]
    table: dict[str, dict[str, Array]] = {}
    for name in dict.fromkeys(row["experiment"] for row in rows):
        seeds = [row for row in rows if row["experiment"] == name]
        table[name] = {column: np.array([float(row[column]) for row in seeds]) for column in columns}
    return table


def streets_of(table: Mapping[str, Mapping[str, Array]]) -> list[str]:
    """The names of the columns of AP in a table of `measured`, one for each street."""
    return [name for name in next(iter(table.values())) if name.startswith("ap ")]


def experiments_figure(names: Sequence[str], height: int = 230) -> Figure:
    """AP on each unseen street after some of the measured trainings: a dot for each seed."""
    table = measured()
    streets = streets_of(table)
    made, axes = figure(height, len(streets))
    for axis in axes:
        box = axis.get_position()
        axis.set_position((box.x0 + NAMES_ROOM, box.y0, box.width - NAMES_ROOM, box.height))
    for n, (axis, street) in enumerate(zip(axes, streets, strict=True)):
        for place, name in enumerate(names):
            values = table[name][street]
            colour = LINES[place % len(LINES)]
            axis.plot(values, np.full(len(values), -place), "o", color=colour, alpha=0.6)
            mean = values.mean()
            axis.plot([mean, mean], [-place - 0.3, -place + 0.3], color=colour)
        axis.set(xlim=(0, 1), ylim=(0.6 - len(names), 0.6))
        labels = names if n == 0 else [""] * len(names)  # one chart names the rows of all
        axis.set_yticks(-np.arange(len(names)), labels)
        finish(axis, street.removeprefix("ap "), "AP, a dot for each seed")
    return made


def is_shown(before: Array, after: Array) -> bool:
    """Whether one run would show the change of a number, from its values over the seeds (S,); not for one seed."""
    return bool(one_run_shows(*mean_and_deviation(before), *mean_and_deviation(after)))


def experiment_lines(names: Sequence[str], columns: Sequence[str] = ()) -> str:
    """A line for each measured training: mean ± standard deviation over the seeds of each column.

    A star marks numbers whose difference from the first line one run would show.
    """
    table = measured()
    first = table[names[0]]
    lines = []
    for name in names:
        cells = []
        for column in columns or streets_of(table):
            values = table[name][column]
            star = "*" if name != names[0] and is_shown(first[column], values) else ""
            spread = float(standard_deviation(values))
            cells.append(f"{column.removeprefix('ap ')} {values.mean():.3f} ± {spread:.3f}{star}")
        lines.append(f"{name:16}: {', '.join(cells)}")
    return "\n".join([*lines, f"mean ± standard deviation over {len(first['seed'])} seeds"])


def street_history_figure(height: int = 230) -> Figure:
    """mAP50 of `street` on its validation images by epoch, as its page of the kit tells it."""
    made, (axis,) = figure(height)
    epochs, values = np.array(STREET_HISTORY).T
    axis.plot(
        epochs, values, "o-", color=GOOD, label="windows of 320×160 px; the last one with larger vehicles"
    )
    first, last, low, high = STREET_LATER
    axis.fill_between([first, last], low, high, color=PALE, label="14 epochs on windows of 544×256 px: range")
    axis.set(xlim=(0, 22), ylim=(0, 1.02))
    axis.set_xticks(range(0, 22, 2))
    finish(axis, "`street`: mAP50 on 240 validation images", "epoch", "mAP50", "lower right")
    return made


def _part(axis: Axes, x: float, y: float, width: float, words: str, colour: str, height: float = 0.8) -> None:
    """Draw a part of the network: a box with words; (x, y) is its lower left corner."""
    axis.add_patch(
        FancyBboxPatch((x, y), width, height, boxstyle="round,pad=0.02", facecolor=colour, edgecolor=DARK)
    )
    axis.text(x + width / 2, y + height / 2, words, ha="center", va="center", fontsize=9.0)


def _arrow(axis: Axes, start: tuple[float, float], end: tuple[float, float]) -> None:
    """Draw the way of the data from one part to the next."""
    axis.annotate("", end, start, arrowprops={"arrowstyle": "->", "color": DARK, "linewidth": 1.2})


def yolo_figure(height: int = 400) -> Figure:
    """The parts of YOLOv8 and the way of an image through them.

    Tinted parts are in the miniature with three levels, too; a plain layer there counts as a C2f.
    """
    made, (axis,) = figure(height)
    axis.set(xlim=(0, 12.4), ylim=(0.2, 6.4))
    axis.set_axis_off()
    _draw_backbone(axis)
    for row, stride in enumerate((8, 16, 32)):
        _draw_level(axis, 2.7 - ROW * row, stride)
    _arrow(axis, (4.8, 0.8), (4.8, 1.5))  # from coarse to fine
    _arrow(axis, (4.8, 2.4), (4.8, 2.65))
    _arrow(axis, (7.1, 3.1), (7.1, 2.4))  # and back to coarse
    _arrow(axis, (7.1, 1.5), (7.1, 1.25))
    _part(axis, 10.9, 1.15, 1.4, "decode,\nsuppress", IN_MINIATURE, 1.6)
    for row in range(3):
        _arrow(axis, (10.45, 3.1 - ROW * row), (10.85, 2.6 - 0.6 * row))
    for x, words in ((1.45, "backbone"), (5.9, "neck"), (9.45, "head, without anchors")):
        axis.text(x, 6.1, words, ha="center", fontsize=11.0, weight="bold")
    axis.text(
        3.9,
        4.1,
        "loss in training: cross-entropy of the scores, trained towards the\n"
        "quality of the box; CIoU and DFL of the boxes; the cells that count\n"
        "are those with the best score and IoU (task-aligned assignment)",
        fontsize=9.0,
        va="bottom",
    )
    finish(
        axis, "YOLOv8; blue: the miniature with three levels has it, too, with a plain layer in place of C2f"
    )
    return made


def _draw_backbone(axis: Axes) -> None:
    """The image and the layers below it, one below the other."""
    layers = (
        ("image 640 × 640", NOT_IN_MINIATURE),
        ("convolutions, stride 2, 4", IN_MINIATURE),
        ("C2f, stride 8", IN_MINIATURE),
        ("C2f, stride 16", IN_MINIATURE),
        ("C2f, stride 32", IN_MINIATURE),
    )
    for row, (words, colour) in enumerate(layers):
        is_last = row == len(layers) - 1
        _part(axis, 0.1, 5.0 - ROW * row, 1.8 if is_last else 2.7, words, colour)
        if is_last:
            _part(axis, 2.1, 5.0 - ROW * row, 0.7, "SPPF", NOT_IN_MINIATURE)
        if row > 0:
            _arrow(axis, (1.45, 6.15 - ROW * row), (1.45, 5.83 - ROW * row))


def _draw_level(axis: Axes, y: float, stride: int) -> None:
    """The parts of neck and head for one stride, at a height `y`; the coarsest map goes past the first join, the
    finest one past the second.
    """
    is_coarsest = stride == 32
    is_finest = stride == 8
    level = y + 0.4
    if not is_coarsest:
        _part(axis, 3.9, y, 1.8, f"enlarge, join,\nC2f, stride {stride}", IN_MINIATURE)
    if not is_finest:
        _part(axis, 6.3, y, 1.6, f"join, C2f,\nstride {stride}", NOT_IN_MINIATURE)
    _part(axis, 8.5, y + 0.42, 1.9, "box: 4 × 16 numbers", NOT_IN_MINIATURE, 0.38)
    _part(axis, 8.5, y - 0.02, 1.9, "score of each class", NOT_IN_MINIATURE, 0.38)
    _arrow(axis, (2.85, level), (6.25 if is_coarsest else 3.85, level))
    if not is_coarsest:
        _arrow(axis, (5.75, level), (8.45 if is_finest else 6.25, level))
    if not is_finest:
        _arrow(axis, (7.95, level), (8.45, level))
