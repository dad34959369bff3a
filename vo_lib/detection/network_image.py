"""The input image of a YOLO network: its size, an image's letterbox in it, and the cells of its grids.

An image is scaled until it fits into the network's image, and a grey border fills the rest: its letterbox. As
in YOLO, the origin of the network's image is the outer corner of its first pixel.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import cv2
import numpy as np

from ..geometry.types import Array, Image

BORDER_GREY = 114  # of the border in the training of YOLOX and of Ultralytics' networks
STRIDES = (8, 16, 32)  # cell sizes of YOLOX, pixels, in the order of its output
INPUT_STRIDE_PX = STRIDES[-1]  # the sides of a network's image are multiples of this
MAX_SQUEEZE = 0.1  # a side that is longer than a multiple by at most this, in strides, is scaled down


@dataclass(frozen=True)
class Letterbox:
    """Position of an image in the network's image: scaled by `scale`, with its corner at `left`, `top`.

    Attributes
    ----------
    width, height : size of the network's image, pixels.
    scale : horizontal scale, pixels of the network's image over pixels of the image.
    left, top : upper left corner of the image in the network's image, pixels.
    stretch : vertical scale over the horizontal one; only a stretched image has another than 1.
    """

    width: int
    height: int
    scale: float
    left: int
    top: int
    stretch: float = field(default=1.0, repr=False)

    def to_image(self, xyxy: Array, width: int, height: int) -> Array:
        """Boxes (K, 4) transformed from the network's image to the original image, and clipped there."""
        corners = (xyxy - self._offsets) / self._scales
        # The kit's origin is the centre of the first pixel.
        return np.asarray(np.clip(corners, 0.0, (width, height, width, height)) - 0.5)

    def to_network(self, xyxy: Array) -> Array:
        """Boxes (K, 4) transformed from the original image to the network's image.

        This undoes `to_image`, but for the clipping.
        """
        return np.asarray((xyxy + 0.5) * self._scales + self._offsets)

    @property
    def vertical_scale(self) -> float:
        """Vertical scale, pixels of the network's image over pixels of the image."""
        return self.scale * self.stretch

    @property
    def _scales(self) -> tuple[float, float, float, float]:
        """Scales of the left, upper, right and lower side of a box."""
        return (self.scale, self.vertical_scale, self.scale, self.vertical_scale)

    @property
    def _offsets(self) -> tuple[int, int, int, int]:
        """Offsets of the left, upper, right and lower side of a box in the network's image."""
        return (self.left, self.top, self.left, self.top)


def fit_size(width: int, height: int, size: int) -> tuple[int, int]:
    """Width and height of a network's image with longer side `size` and the aspect ratio of the image.

    Both sides are multiples of the stride, rounded up if the excess is more than a tenth of a stride.
    """
    scale = size / max(width, height)
    return _whole_strides(width * scale), _whole_strides(height * scale)


def _whole_strides(side: float) -> int:
    """The side of a network's image, pixels, for a side of a scaled image."""
    strides = math.ceil(side / INPUT_STRIDE_PX - MAX_SQUEEZE)
    return max(1, strides) * INPUT_STRIDE_PX


def fit_letterbox(
    width: int, height: int, net_width: int, net_height: int, centred: bool = True
) -> Letterbox:
    """The letterbox of an image in the network's image, centred (YOLOv8) or in the corner (YOLOX)."""
    scale = min(net_width / width, net_height / height)
    if not centred:
        return Letterbox(net_width, net_height, scale, 0, 0)
    border_width = net_width - round(width * scale)
    border_height = net_height - round(height * scale)
    return Letterbox(net_width, net_height, scale, border_width // 2, border_height // 2)


def fit_stretched(width: int, height: int, net_width: int, net_height: int) -> Letterbox:
    """The placement of an image that fills the network's image, with two scales and no border (RT-DETR)."""
    scale = net_width / width
    vertical_scale = net_height / height
    return Letterbox(net_width, net_height, scale, 0, 0, stretch=vertical_scale / scale)


def letterboxed(image: Image, letterbox: Letterbox) -> Image:
    """The network's image: the image (H, W) or (H, W, 3), scaled and bordered according to the letterbox."""
    height, width, *channels = image.shape
    scaled_width = max(1, round(width * letterbox.scale))
    scaled_height = max(1, round(height * letterbox.vertical_scale))
    # Area averages keep small, distant cars; linear interpolation would skip pixels.
    is_smaller = min(letterbox.scale, letterbox.vertical_scale) < 1
    interpolation = cv2.INTER_AREA if is_smaller else cv2.INTER_LINEAR
    scaled = cv2.resize(image, (scaled_width, scaled_height), interpolation=interpolation)
    result = np.full((letterbox.height, letterbox.width, *channels), BORDER_GREY, np.uint8)
    bottom = letterbox.top + scaled_height
    right = letterbox.left + scaled_width
    result[letterbox.top : bottom, letterbox.left : right] = scaled
    return result


def yolox_cells(width: int, height: int) -> int:
    """Number of cells of YOLOX's grids, and so of rows of its output, for a network's image of this size."""
    return sum((width // stride) * (height // stride) for stride in STRIDES)
