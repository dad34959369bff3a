"""Masks: grey PNG images of 8 bits in which every pixel other than 0 is masked; the only reader of masks."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from ..errors import DataError
from ..files import read_bytes
from ..geometry.types import Image
from .kitti import decode_image

PNG_SIGNATURE = b"\x89PNG"  # JPEG does not keep zeros


def read_mask(path: Path) -> Image:
    """The mask (H, W) uint8: 255 where the image is not 0, else 0.

    Raises `DataError` for another format, for a truncated or damaged file, and for an image with 16 bits,
    colours, a palette or alpha, whose numbers may mean something else.
    """
    data = read_bytes(path)
    image = None
    if data.startswith(PNG_SIGNATURE):
        image = decode_image(data, cv2.IMREAD_UNCHANGED | cv2.IMREAD_IGNORE_ORIENTATION)
    if image is None or image.dtype != np.uint8 or image.ndim != 2:
        raise DataError("expected a mask as a complete grey PNG image of 8 bits, in which 0 is allowed", path)
    return np.where(image, 255, 0).astype(np.uint8)
