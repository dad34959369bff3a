"""Pictures of a detector: its boxes with scores, and the curves of its training."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from vo_lib.core.boxes import Boxes
from vo_lib.core.types import Array, Image
from vo_lib.detection.class_names import COCO
from vo_lib.tables.plots import ESTIMATE_COLOURS

DETECTED = (66, 228, 240)  # yellow, BGR


def detection_image(image: Image, boxes: Boxes, names: Sequence[str] = COCO) -> Image:
    """An image (H, W) or BGR with boxes, each with class and score above it; BGR (H, W, 3).

    `names` gives the word of a class number; a label without score counts 1.
    """
    picture = cv2.cvtColor(image, cv2.COLOR_GRAY2BGR) if image.ndim == 2 else image.copy()
    # The best last, so that its words lie on top.
    for k in np.argsort(boxes.score, kind="stable").tolist():
        x0, y0, x1, y1 = np.rint(boxes.xyxy[k]).astype(int).tolist()
        cv2.rectangle(picture, (x0, y0), (x1, y1), DETECTED, 2, cv2.LINE_AA)
        kind = int(boxes.class_id[k])
        words = f"{names[kind] if kind < len(names) else kind} {boxes.score[k]:.2f}"
        (width, height), _ = cv2.getTextSize(words, cv2.FONT_HERSHEY_SIMPLEX, 0.4, 1)
        left = min(max(x0, 0), max(picture.shape[1] - width - 4, 0))
        foot = y0 - 3 if y0 > height + 6 else y0 + height + 3
        cv2.rectangle(picture, (left, foot - height - 2), (left + width + 3, foot + 2), DETECTED, -1)
        cv2.putText(
            picture, words, (left + 2, foot), cv2.FONT_HERSHEY_SIMPLEX, 0.4, (0, 0, 0), 1, cv2.LINE_AA
        )
    return np.asarray(picture, np.uint8)


def training_figure(losses: Array, scores: Array, title: str) -> Figure:
    """Box and class loss (E, 2), and mAP (E,) in [0, 1], after each of E epochs."""
    figure = Figure(figsize=(7.2, 3.2), dpi=120, layout="constrained")
    left, right = figure.subplots(1, 2)
    epochs = np.arange(1, len(scores) + 1)
    for column, name in enumerate(("box loss", "class loss")):
        left.plot(epochs, losses[:, column], ".-", color=ESTIMATE_COLOURS[column], label=name)
    right.plot(epochs, scores, ".-", color=ESTIMATE_COLOURS[2], label="mAP50, validation")
    left.set_ylim(bottom=0.0)
    right.set_ylim(0.0, 1.0)
    for axis in (left, right):
        axis.set_xlabel("epoch")
        axis.set_xlim(0.5, len(scores) + 0.5)
        axis.xaxis.set_major_locator(MaxNLocator(integer=True, min_n_ticks=1))
        axis.grid(alpha=0.3)
        axis.legend(loc="best")
    figure.suptitle(title)
    return figure
