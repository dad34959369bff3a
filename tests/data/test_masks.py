"""Masks: every index, value or channel that is not 0 counts, whatever the kind of the PNG."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest

from vo_lib.data.masks import read_mask
from vo_lib.errors import DataError

H, W = 6, 10
SHAPE = np.zeros((H, W), np.uint8)
SHAPE[2:4, 3:8] = 1


def png(header: tuple[int, int], rows: list[bytes], *chunks: tuple[bytes, bytes]) -> bytes:
    """A PNG with this bit depth and colour type, unfiltered rows, and chunks before the pixels."""

    def chunk(kind: bytes, content: bytes) -> bytes:
        return (
            struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))
        )

    parts = [chunk(b"IHDR", struct.pack(">IIBBBBB", W, H, *header, 0, 0, 0))]
    parts += [chunk(kind, content) for kind, content in chunks]
    parts.append(chunk(b"IDAT", zlib.compress(b"".join(b"\0" + row for row in rows))))
    return b"\x89PNG\r\n\x1a\n" + b"".join(parts) + chunk(b"IEND", b"")


def palette(bits: int, colours: bytes, *more: tuple[bytes, bytes]) -> bytes:
    """A palette image with index 1 on the shape, else 0."""
    packed = []
    for row in SHAPE:
        text = "".join(f"{value:0{bits}b}" for value in row)
        text += "0" * (-len(text) % 8)
        packed.append(bytes(int(text[k : k + 8], 2) for k in range(0, len(text), 8)))
    return png((bits, 3), packed, (b"PLTE", colours), *more)


def encoded(image: np.ndarray) -> bytes:
    return cv2.imencode(".png", image)[1].tobytes()


def channels(*values: int, kind: type = np.uint8) -> bytes:
    """A colour image with these values (BGR or BGRA) on the shape; alpha is full everywhere."""
    image: np.ndarray = np.zeros((H, W, len(values)), kind)
    image[SHAPE > 0] = values
    if len(values) == 4:
        image[:, :, 3] = np.iinfo(kind).max
    return encoded(image)


GREY_ALPHA = [b"".join(bytes([value, 255]) for value in row.tolist()) for row in SHAPE]
KINDS = {
    "8 bits": encoded(SHAPE * 255),
    "8 bits, ids of 1": encoded(SHAPE),
    "16 bits, ids of 1": encoded(SHAPE.astype(np.uint16)),
    "16 bits, ids of 256": encoded(SHAPE.astype(np.uint16) * 256),
    "1 bit": png((1, 0), [np.packbits(row).tobytes() for row in SHAPE]),
    "black palette": palette(8, b"\0\0\0" * 2),
    "dark palette of 4 bits": palette(4, b"\0\0\0\0\0\1"),
    "white background": palette(2, b"\xff\xff\xff\0\0\0"),
    "palette with alpha": palette(8, b"\0\0\0\x80\0\0", (b"tRNS", b"\0\0")),
    "blue alone": channels(1, 0, 0),
    "colour with alpha": channels(0, 0, 3, 0),
    "16 bits a channel": channels(0, 1, 0, kind=np.uint16),
    "grey with alpha": png((8, 4), GREY_ALPHA),
}


@pytest.mark.parametrize("kind", KINDS)
def test_everything_but_zero_is_masked(tmp_path: Path, kind: str) -> None:
    (tmp_path / "mask.png").write_bytes(KINDS[kind])
    assert (read_mask(tmp_path / "mask.png") == 255 * SHAPE).all()


def test_other_files_are_refused(tmp_path: Path) -> None:
    for name, data, words in (
        ("a.jpg", cv2.imencode(".jpg", SHAPE)[1].tobytes(), "PNG format: JPEG does not keep zeros"),
        ("a.png", b"", "truncated or damaged"),
        ("b.png", KINDS["black palette"][:-20], "truncated or damaged"),
        ("c.png", png((16, 3), [bytes(2 * W)] * H, (b"PLTE", b"\0\0\0")), "truncated or damaged"),
    ):
        (tmp_path / name).write_bytes(data)
        with pytest.raises(DataError, match=words):
            read_mask(tmp_path / name)
