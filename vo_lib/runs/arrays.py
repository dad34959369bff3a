"""Named arrays as bytes, without pickle, with a checksum over everything."""

from __future__ import annotations

import io
import zlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

CHECK = 4  # bytes of the checksum at the end


def pack_arrays(arrays: dict[str, NDArray[Any]]) -> bytes:
    """The bytes of an npz file with a CRC-32 behind it; other programs can still open it."""
    buffer = io.BytesIO()
    np.savez(buffer, **arrays)  # type: ignore[arg-type]
    data = buffer.getvalue()
    return data + zlib.crc32(data).to_bytes(CHECK, "little")


def unpack_arrays(data: bytes) -> dict[str, NDArray[Any]]:
    """The arrays that `pack_arrays` was given; `ValueError` when a byte was changed or lost."""
    content, check = data[:-CHECK], data[-CHECK:]
    # Nothing but zeros would pass: the checksum of no bytes is 0.
    if not content or zlib.crc32(content).to_bytes(CHECK, "little") != check:
        raise ValueError("the checksum is wrong")
    with np.load(io.BytesIO(content), allow_pickle=False) as loaded:
        return dict(loaded)
