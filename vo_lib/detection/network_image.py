"""The input image of a YOLO network: its size, an image's letterbox in it, and the cells of its grids.

As in YOLO, the origin of the network's image is the outer corner of its first pixel.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import cv2
import numpy as np

from ..geometry.types import Array, Image

BORDER_GREY = 114  # the border value in the training of both families
STRIDES = (8, 16, 32)  # cell sizes of YOLOX, pixels, in the order of its output
INPUT_STRIDE_PX = STRIDES[-1]  # the sides of a network's image are multiples of this
MAX_SQUEEZE = 0.1  # a side that is longer than a multiple by at most this, in strides, is scaled down


@dataclass(frozen=True)
class Letterbox:
    """Position of an image in the network's image: scaled by `scale`, with its corner at `left`, `top`.

    `stretch` is the vertical scale over the horizontal one; only a stretched image has another than 1.
    """

    width: int
    height: int
    scale: float
    left: int
    top: int
    stretch: float = field(default=1.0, repr=False)

    def to_image(self, xyxy: Array, width: int, height: int) -> Array:
        """Boxes (K, 4) transformed from the network's image to the original image, and clipped there."""
        corners = (xyxy - (self.left, self.top) * 2) / self._scales
        return np.asarray(np.clip(corners, 0.0, (width, height) * 2) - 0.5)

    def to_network(self, xyxy: Array) -> Array:
        """Boxes (K, 4) transformed from the original image to the network's image; undoes `to_image`."""
        return np.asarray((xyxy + 0.5) * self._scales + (self.left, self.top) * 2)

    @property
    def _scales(self) -> tuple[float, ...]:
        """Scales of x and y, twice, as for the corners of a box."""
        return (self.scale, self.scale * self.stretch) * 2


def fit_size(width: int, height: int, size: int) -> tuple[int, int]:
    """Width and height of a network's image with longer side `size` and the aspect ratio of the image.

    Both sides are multiples of the stride, rounded up if the excess is more than a tenth of a stride.
    """
    scale = size / max(width, height)
    cells = [max(1, math.ceil(side * scale / INPUT_STRIDE_PX - MAX_SQUEEZE)) for side in (width, height)]
    return cells[0] * INPUT_STRIDE_PX, cells[1] * INPUT_STRIDE_PX


def fit_letterbox(
    width: int, height: int, net_width: int, net_height: int, centred: bool = True
) -> Letterbox:
    """The letterbox of an image in the network's image, centred (YOLOv8) or in the corner (YOLOX)."""
    scale = min(net_width / width, net_height / height)
    left = net_width - round(width * scale)
    top = net_height - round(height * scale)
    return Letterbox(net_width, net_height, scale, left // 2 * centred, top // 2 * centred)


def fit_stretched(width: int, height: int, net_width: int, net_height: int) -> Letterbox:
    """The placement of an image that fills the network's image, with two scales and no border (RT-DETR)."""
    scale = net_width / width
    return Letterbox(net_width, net_height, scale, 0, 0, stretch=net_height / height / scale)


def letterboxed(image: Image, letterbox: Letterbox) -> Image:
    """The network's image: the image (H, W) or (H, W, 3), scaled and bordered according to the letterbox."""
    down = letterbox.scale * letterbox.stretch
    size = max(1, round(image.shape[1] * letterbox.scale)), max(1, round(image.shape[0] * down))
    # Area averages keep small, distant cars; linear interpolation would skip pixels.
    interpolation = cv2.INTER_AREA if min(letterbox.scale, down) < 1 else cv2.INTER_LINEAR
    small = cv2.resize(image, size, interpolation=interpolation)
    shape = (letterbox.height, letterbox.width, *image.shape[2:])
    out = np.full(shape, BORDER_GREY, np.uint8)
    out[letterbox.top : letterbox.top + size[1], letterbox.left : letterbox.left + size[0]] = small
    return out


def yolox_cells(width: int, height: int) -> int:
    """Number of rows of a YOLOX output for a network's image of this size."""
    return sum((width // stride) * (height // stride) for stride in STRIDES)
