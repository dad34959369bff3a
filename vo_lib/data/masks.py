"""Masks: PNG images in which every pixel other than 0 is masked; the only reader of masks."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np

from ..errors import DataError
from ..files import read_bytes
from ..geometry.types import Image
from .kitti import PNG_SIGNATURE, has_valid_chunks, read_image

PALETTE_TYPE = 3  # colour type of a PNG whose pixels are indices into a palette
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
        try:
            flags = cv2.IMREAD_UNCHANGED | cv2.IMREAD_IGNORE_ORIENTATION
            image = cv2.imdecode(np.frombuffer(_with_grey_palette(data), np.uint8), flags)
        except cv2.error:  # for example too many pixels for OpenCV
            pass
    if image is None:
        raise DataError("the image is truncated or damaged: expected a complete PNG file", path)
    if image.ndim == 2:
        masked = image != 0
    else:
        channels = image.shape[2]
        masked = (image[:, :, : COLOUR_CHANNELS.get(channels, channels)] != 0).any(axis=2)
    return np.where(masked, 255, 0).astype(np.uint8)


def _with_grey_palette(png: bytes) -> bytes:
    """The PNG, with a palette (if it has one) in which index i has the grey value i, and without alpha."""
    chunks = list(_chunks(png))
    header = chunks[0][1]
    if len(header) < 10 or header[9] != PALETTE_TYPE:
        return png
    indices = bytes(value for index in range(1 << header[8]) for value in (index, index, index))
    parts = [PNG_SIGNATURE]
    for kind, content in chunks:
        if kind == b"tRNS":
            continue
        body = kind + (indices if kind == b"PLTE" else content)
        parts += [struct.pack(">I", len(body) - 4), body, zlib.crc32(body).to_bytes(4)]
    return b"".join(parts)


def _chunks(png: bytes) -> Iterator[tuple[bytes, bytes]]:
    """Kind and content of the chunks of a valid PNG."""
    start = len(PNG_SIGNATURE)
    while start + 12 <= len(png):
        length, kind = struct.unpack_from(">I4s", png, start)
        yield kind, png[start + 8 : start + 8 + length]
        start += 12 + length
