"""What a detector found, drawn: boxes with class and score."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from vo_lib.core.boxes import Boxes
from vo_lib.core.types import Image
from vo_lib.detection.class_names import COCO

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
