"""The bytes of a PNG file: whether they are complete, and indices of a palette as grey values.

A PNG file is a signature and a series of chunks. A chunk is the length of its content (4 bytes), its kind
(4), the content, and a checksum of kind and content (4).
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from typing import NamedTuple

SIGNATURE = b"\x89PNG\r\n\x1a\n"
CHUNK_BYTES = 12  # of a chunk without content
# Places in the content of the first chunk, IHDR.
DEPTH_AT = 8  # number of bits of a value
COLOUR_TYPE_AT = 9
DEPTH_IN_FILE_AT = len(SIGNATURE) + 8 + DEPTH_AT  # 8 bytes are the length and the kind of IHDR
PALETTE_TYPE = 3  # colour type of an image whose pixels are indices into a palette
MAX_INDEX_BITS = 8


class Chunk(NamedTuple):
    """A chunk: its kind, such as b"IHDR", and its content."""

    kind: bytes
    content: bytes


def valid_chunks(png: bytes) -> Iterator[Chunk]:
    """The chunks of a PNG file up to the first one that is truncated or fails its checksum."""
    start = len(SIGNATURE)
    while len(png) >= start + CHUNK_BYTES:
        length, kind = struct.unpack_from(">I4s", png, start)
        end = start + CHUNK_BYTES + length
        content = png[start + 8 : end - 4]
        if _checksum(kind, content) != png[end - 4 : end]:
            return
        yield Chunk(kind, content)
        start = end


def _checksum(kind: bytes, content: bytes) -> bytes:
    """The last four bytes of a chunk."""
    return zlib.crc32(content, zlib.crc32(kind)).to_bytes(4)


def has_valid_chunks(png: bytes) -> bool:
    """Whether all chunks of a PNG file up to IEND, the last, are present and pass their checksums.

    Indices of a palette must have 8 bits or fewer. In an animated PNG, the image must be one of the frames;
    otherwise, OpenCV returns black or another frame.
    """
    if not png.startswith(SIGNATURE):
        return False
    kinds = set[bytes]()
    for kind, content in valid_chunks(png):
        if kind == b"IHDR" and _has_palette(content) and content[DEPTH_AT] > MAX_INDEX_BITS:
            return False
        if kind == b"IEND":
            return True
        # acTL: the file is animated; fcTL: a frame begins. Without it before IDAT, the image is no frame.
        if kind == b"IDAT" and b"acTL" in kinds and b"fcTL" not in kinds:
            return False
        kinds.add(kind)
    return False


def _has_palette(header: bytes) -> bool:
    """Whether the pixels of an image are indices into a palette, by the content of its chunk IHDR."""
    return len(header) > COLOUR_TYPE_AT and header[COLOUR_TYPE_AT] == PALETTE_TYPE


def has_16_bits(beginning: bytes) -> bool:
    """Whether a PNG file has values of 16 bits, by its first `DEPTH_IN_FILE_AT` + 1 bytes."""
    return beginning.startswith(SIGNATURE) and beginning[DEPTH_IN_FILE_AT:] == b"\x10"


def with_grey_palette(png: bytes) -> bytes:
    """A valid PNG in which index i of the palette, if it has one, is the grey value i; without alpha."""
    chunks = list(valid_chunks(png))
    header = chunks[0].content
    if not _has_palette(header):
        return png
    greys = bytearray()
    for index in range(1 << header[DEPTH_AT]):
        greys += bytes([index, index, index])  # red, green and blue
    parts = [SIGNATURE]
    for kind, content in chunks:
        if kind == b"tRNS":  # the alpha of each index
            continue
        new_content = bytes(greys) if kind == b"PLTE" else content
        parts += [struct.pack(">I", len(new_content)), kind, new_content, _checksum(kind, new_content)]
    return b"".join(parts)
