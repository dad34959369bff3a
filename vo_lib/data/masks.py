"""Masks: PNG images in which every pixel other than 0 is masked; the only reader of masks."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from ..errors import DataError
from ..files import read_bytes
from ..geometry.types import Image
from .kitti import decode_image, read_image
from .png import has_valid_chunks, with_grey_palette

COLOUR_CHANNELS = {2: 1, 4: 3}  # channels without alpha, by the number of channels with alpha


def read_mask(path: Path) -> Image:
    """The mask (H, W) uint8: 255 where an index, value or channel of the PNG is not 0, else 0.

    The pixels of a palette image are indices, so a dark colour counts too. Alpha does not count. Values may
    have 1 to 16 bits.

    Raises `DataError` for another format, and for a truncated or damaged file.
    """
    if path.suffix.lower() != ".png":
        read_image(path)  # raises `DataError` for a file that is missing or no image
        raise DataError("expected a mask in PNG format: JPEG does not keep zeros", path)
    data = read_bytes(path)
    image = None
    if has_valid_chunks(data):
        flags = cv2.IMREAD_UNCHANGED | cv2.IMREAD_IGNORE_ORIENTATION
        image = decode_image(with_grey_palette(data), flags)
    if image is None:
        raise DataError("the image is truncated or damaged: expected a complete PNG file", path)
    if image.ndim == 2:
        masked = image != 0
    else:
        channels = image.shape[2]
        colours = image[:, :, : COLOUR_CHANNELS.get(channels, channels)]
        masked = (colours != 0).any(axis=2)
    return np.where(masked, 255, 0).astype(np.uint8)
