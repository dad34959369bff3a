"""The arithmetic around a YOLO network: fitting an image into its input, reading its output, suppression.

Coordinates of the network's image are measured from the outer edge of its first pixel, as YOLO does.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from ..geometry.boxes import Boxes, no_boxes
from ..geometry.types import Array, BoolArray, Image

Float32 = NDArray[np.float32]

BORDER_GREY = 114  # the value that both families are trained with
STRIDES = (8, 16, 32)  # of YOLOX's cells, in the order of its output
INPUT_STRIDE_PX = STRIDES[-1]  # sides of a network's image are multiples of it
MAX_INPUT_PX = 4096  # a larger size in a model's metadata is ignored
MAX_SQUEEZE = 0.1  # share of a stride by which an image is scaled down to save a row of cells
ONE_OBJECT_IOU = 0.9  # boxes of different classes that overlap more are one object
MAX_SUPPRESSED_BOXES = 3000  # boxes that enter suppression, the best first


@dataclass(frozen=True)
class Letterbox:
    """An image scaled into the network's image with a border around: at `left`, `top`, times `scale`."""

    width: int
    height: int
    scale: float
    left: int
    top: int

    def to_image(self, xyxy: Array, width: int, height: int) -> Array:
        """Boxes (K, 4) of the network's image in the image (pixel centres at integers), cut at its border."""
        moved = (xyxy - (self.left, self.top) * 2) / self.scale
        return np.asarray(np.clip(moved, 0.0, (width, height) * 2) - 0.5)


def fit_size(width: int, height: int, size: int) -> tuple[int, int]:
    """Width and height of a network's image whose longer side is `size`, in the aspect of the image.

    Both are multiples of the stride: rounded up, unless a tenth of a stride is all that is missing.
    """
    scale = size / max(width, height)
    cells = [max(1, math.ceil(side * scale / INPUT_STRIDE_PX - MAX_SQUEEZE)) for side in (width, height)]
    return cells[0] * INPUT_STRIDE_PX, cells[1] * INPUT_STRIDE_PX


def size_from_metadata(text: str) -> int | None:
    """Longer side, pixels, of the images a model was made for: of "[640, 640]" or "640"; else None."""
    sides = [int(side) for side in re.findall(r"[0-9]{1,9}", text)]
    good = sides and min(sides) >= INPUT_STRIDE_PX and max(sides) <= MAX_INPUT_PX
    return max(sides) if good else None


def letterbox(width: int, height: int, net_width: int, net_height: int, centred: bool = True) -> Letterbox:
    """How an image is fitted whole into the network's; YOLOX puts it into the corner, not the middle."""
    scale = min(net_width / width, net_height / height)
    left, top = net_width - round(width * scale), net_height - round(height * scale)
    return Letterbox(net_width, net_height, scale, left // 2 * centred, top // 2 * centred)


def place(image: Image, plan: Letterbox) -> Image:
    """The image (H, W) or (H, W, 3), scaled and bordered as planned."""
    size = max(1, round(image.shape[1] * plan.scale)), max(1, round(image.shape[0] * plan.scale))
    # Averages over areas keep small far cars; linear interpolation would skip pixels.
    how = cv2.INTER_AREA if plan.scale < 1 else cv2.INTER_LINEAR
    small = cv2.resize(image, size, interpolation=how)
    shape = (plan.height, plan.width, *image.shape[2:])
    out = np.full(shape, BORDER_GREY, np.uint8)
    out[plan.top : plan.top + size[1], plan.left : plan.left + size[0]] = small
    return out


# A network may give numbers that are not finite; `best_boxes` leaves them out.
@np.errstate(invalid="ignore")
def read_yolov8(output: Float32) -> tuple[Array, Array]:
    """Corners (N, 4), pixels, and class scores (N, C) of a YOLOv8 output (4 + C, N): centre, size, scores."""
    rows = output.T.astype(np.float64)
    return _corners(rows[:, :2], rows[:, 2:4]), rows[:, 4:]


@np.errstate(invalid="ignore")
def read_yolox(output: Float32, width: int, height: int) -> tuple[Array, Array]:
    """Corners (N, 4), pixels, and class scores (N, C) of a YOLOX output (N, 5 + C) before decoding.

    Centres are relative to the cell, sizes are logarithms, both in strides; a class counts as much as its
    score times the score that there is any object.
    """
    rows = output.astype(np.float64)
    cells = []
    for stride in STRIDES:
        y, x = np.mgrid[: height // stride, : width // stride]
        cells.append(np.stack([x.ravel(), y.ravel(), np.full(x.size, stride)], axis=1))
    cell = np.concatenate(cells)
    stride_of = cell[:, 2:]
    centre = (rows[:, :2] + cell[:, :2]) * stride_of
    return _corners(centre, np.exp(np.minimum(rows[:, 2:4], 20.0)) * stride_of), rows[:, 5:] * rows[:, 4:5]


def yolox_cells(width: int, height: int) -> int:
    """Rows of a YOLOX output for a network's image of this size."""
    return sum((width // stride) * (height // stride) for stride in STRIDES)


def _corners(centre: Array, size: Array) -> Array:
    return np.concatenate([centre - size / 2, centre + size / 2], axis=1)


def best_boxes(
    corners: Array, scores: Array, score: float, nms: float, wanted: BoolArray | None = None
) -> Boxes:
    """The boxes that remain, best first: each cell's best class, scored at least `score`; suppression at an
    IoU of `nms` within a class, of `ONE_OBJECT_IOU` between classes.

    corners : (N, 4) x0, y0, x1, y1. scores : (N, C); `class_id` becomes the column. Boxes that are not
    finite are left out.
    wanted : (C,) classes that are asked for; by default all.
    """
    finite = np.isfinite(corners).all(axis=1)
    corners, scores = corners[finite], scores[finite]
    kind = scores.argmax(axis=1)
    best = scores[np.arange(len(scores)), kind]
    sizes = corners[:, 2:] - corners[:, :2]
    good = (best >= score) & (sizes > 0).all(axis=1)
    chosen = np.flatnonzero(good if wanted is None else good & wanted[kind])
    chosen = chosen[np.argsort(-best[chosen], kind="stable")][:MAX_SUPPRESSED_BOXES]
    if not len(chosen):
        return no_boxes()
    boxes = np.concatenate([corners[:, :2], sizes], axis=1)
    kept = cv2.dnn.NMSBoxesBatched(
        boxes[chosen].tolist(), best[chosen].tolist(), kind[chosen].tolist(), 0.0, float(nms)
    )
    chosen = chosen[np.sort(np.asarray(kept, np.intp).ravel())]
    # Two classes may claim the same object: a van is a car and a truck.
    kept = cv2.dnn.NMSBoxes(boxes[chosen].tolist(), best[chosen].tolist(), 0.0, ONE_OBJECT_IOU)
    chosen = chosen[np.sort(np.asarray(kept, np.intp).ravel())]
    return Boxes(corners[chosen], kind[chosen].astype(np.int64), np.clip(best[chosen], 0.0, 1.0))
