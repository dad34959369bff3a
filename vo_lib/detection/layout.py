"""The arithmetic around a YOLO network: input image, decoding of the output, non-maximum suppression.

As in YOLO, the origin of the network's image is the outer corner of its first pixel.
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

BORDER_GREY = 114  # the border value in the training of both families
STRIDES = (8, 16, 32)  # cell sizes of YOLOX, pixels, in the order of its output
INPUT_STRIDE_PX = STRIDES[-1]  # the sides of a network's image are multiples of this
MAX_INPUT_PX = 4096  # a larger size in a model's metadata is ignored
MAX_SQUEEZE = 0.1  # a side that is longer than a multiple by at most this, in strides, is scaled down
ONE_OBJECT_IOU = 0.9  # boxes of different classes with a larger overlap are one object
MAX_SUPPRESSED_BOXES = 3000  # largest number of boxes in the suppression, the best first


@dataclass(frozen=True)
class Letterbox:
    """Position of an image in the network's image: scaled by `scale`, with its corner at `left`, `top`."""

    width: int
    height: int
    scale: float
    left: int
    top: int

    def to_image(self, xyxy: Array, width: int, height: int) -> Array:
        """Boxes (K, 4) transformed from the network's image to the original image, and clipped there."""
        corners = (xyxy - (self.left, self.top) * 2) / self.scale
        return np.asarray(np.clip(corners, 0.0, (width, height) * 2) - 0.5)


def fit_size(width: int, height: int, size: int) -> tuple[int, int]:
    """Width and height of a network's image with longer side `size` and the aspect ratio of the image.

    Both sides are multiples of the stride, rounded up if the excess is more than a tenth of a stride.
    """
    scale = size / max(width, height)
    cells = [max(1, math.ceil(side * scale / INPUT_STRIDE_PX - MAX_SQUEEZE)) for side in (width, height)]
    return cells[0] * INPUT_STRIDE_PX, cells[1] * INPUT_STRIDE_PX


def size_from_metadata(text: str) -> int | None:
    """Longer side, in pixels, from a model's metadata such as "[640, 640]" or "640"; None for other text."""
    sides = [int(side) for side in re.findall(r"[0-9]{1,9}", text)]
    valid = sides and min(sides) >= INPUT_STRIDE_PX and max(sides) <= MAX_INPUT_PX
    return max(sides) if valid else None


def fit_letterbox(
    width: int, height: int, net_width: int, net_height: int, centred: bool = True
) -> Letterbox:
    """The letterbox of an image in the network's image, centred (YOLOv8) or in the corner (YOLOX)."""
    scale = min(net_width / width, net_height / height)
    left, top = net_width - round(width * scale), net_height - round(height * scale)
    return Letterbox(net_width, net_height, scale, left // 2 * centred, top // 2 * centred)


def letterboxed(image: Image, letterbox: Letterbox) -> Image:
    """The network's image: the image (H, W) or (H, W, 3), scaled and bordered according to the letterbox."""
    size = max(1, round(image.shape[1] * letterbox.scale)), max(1, round(image.shape[0] * letterbox.scale))
    # Area averages keep small, distant cars; linear interpolation would skip pixels.
    interpolation = cv2.INTER_AREA if letterbox.scale < 1 else cv2.INTER_LINEAR
    small = cv2.resize(image, size, interpolation=interpolation)
    shape = (letterbox.height, letterbox.width, *image.shape[2:])
    out = np.full(shape, BORDER_GREY, np.uint8)
    out[letterbox.top : letterbox.top + size[1], letterbox.left : letterbox.left + size[0]] = small
    return out


# A network may return numbers that are not finite; `best_boxes` ignores them.
@np.errstate(invalid="ignore")
def read_yolov8(output: Float32) -> tuple[Array, Array]:
    """Corners (N, 4) in pixels and class scores (N, C), from an output (4 + C, N) of YOLOv8."""
    rows = output.T.astype(np.float64)
    return _corners(rows[:, :2], rows[:, 2:4]), rows[:, 4:]


@np.errstate(invalid="ignore")
def read_yolox(output: Float32, width: int, height: int) -> tuple[Array, Array]:
    """Corners (N, 4) in pixels and class scores (N, C), from an output (N, 5 + C) of YOLOX.

    In the output, a centre is relative to its cell, in strides, and a size is the logarithm of a number of
    strides. The score of a class is the class output times the objectness.
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
    """Number of rows of a YOLOX output for a network's image of this size."""
    return sum((width // stride) * (height // stride) for stride in STRIDES)


def _corners(centre: Array, size: Array) -> Array:
    return np.concatenate([centre - size / 2, centre + size / 2], axis=1)


def best_boxes(
    corners: Array, scores: Array, score: float, nms: float, class_mask: BoolArray | None = None
) -> Boxes:
    """Boxes after non-maximum suppression, best first. A box has the class with its highest score.

    The IoU limit of the suppression is `nms` within a class and `ONE_OBJECT_IOU` between classes. Boxes with
    a score below `score` or with numbers that are not finite are ignored.

    corners : (N, 4) x0, y0, x1, y1. scores : (N, C); `class_id` is the column. class_mask : (C,) mask of the
    classes to return; by default all.
    """
    finite = np.isfinite(corners).all(axis=1)
    corners, scores = corners[finite], scores[finite]
    kind = scores.argmax(axis=1)
    best = scores[np.arange(len(scores)), kind]
    sizes = corners[:, 2:] - corners[:, :2]
    valid = (best >= score) & (sizes > 0).all(axis=1)
    index = np.flatnonzero(valid if class_mask is None else valid & class_mask[kind])
    index = index[np.argsort(-best[index], kind="stable")][:MAX_SUPPRESSED_BOXES]
    if not len(index):
        return no_boxes()
    boxes = np.concatenate([corners[:, :2], sizes], axis=1)
    rows = cv2.dnn.NMSBoxesBatched(
        boxes[index].tolist(), best[index].tolist(), kind[index].tolist(), 0.0, float(nms)
    )
    index = index[np.sort(np.asarray(rows, np.intp).ravel())]
    # One object may have boxes of two classes: a van is a car and a truck.
    rows = cv2.dnn.NMSBoxes(boxes[index].tolist(), best[index].tolist(), 0.0, ONE_OBJECT_IOU)
    index = index[np.sort(np.asarray(rows, np.intp).ravel())]
    return Boxes(corners[index], kind[index].astype(np.int64), np.clip(best[index], 0.0, 1.0))
