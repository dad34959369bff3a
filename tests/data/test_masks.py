"""Masks: grey PNG images of 8 bits or fewer, in which every value other than 0 counts; others are refused."""

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


def encoded(image: np.ndarray, kind: str = ".png") -> bytes:
    return cv2.imencode(kind, image)[1].tobytes()


COLOUR = np.repeat(SHAPE[:, :, None], 4, axis=2)
GREY_ALPHA = [b"".join(bytes([value, 255]) for value in row.tolist()) for row in SHAPE]
INDICES = [row.tobytes() for row in SHAPE]
RIGHT = {
    "8 bits": encoded(SHAPE * 255),
    "8 bits, ids of 1": encoded(SHAPE),
    "1 bit": png((1, 0), [np.packbits(row).tobytes() for row in SHAPE]),
}
WRONG = {
    "16 bits": encoded(SHAPE.astype(np.uint16)),
    "dark palette": png((8, 3), INDICES, (b"PLTE", b"\0\0\0" * 2)),
    "colours": encoded(COLOUR[:, :, :3]),
    "colours with alpha": encoded(COLOUR),
    "grey with alpha": png((8, 4), GREY_ALPHA),
    "jpeg": encoded(SHAPE * 255, ".jpg"),
    "empty": b"",
    "truncated": encoded(SHAPE)[:-20],
}


@pytest.mark.parametrize("kind", RIGHT)
def test_everything_but_zero_is_masked(tmp_path: Path, kind: str) -> None:
    (tmp_path / "mask.png").write_bytes(RIGHT[kind])
    assert (read_mask(tmp_path / "mask.png") == 255 * SHAPE).all()


@pytest.mark.parametrize("kind", WRONG)
def test_other_files_are_refused(tmp_path: Path, kind: str) -> None:
    (tmp_path / "mask.png").write_bytes(WRONG[kind])
    with pytest.raises(DataError, match=r"mask\.png: expected a mask as a complete grey PNG image of 8 bits"):
        read_mask(tmp_path / "mask.png")
