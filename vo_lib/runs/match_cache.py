"""Matches kept on disk, so that a changed threshold of the back end re-runs the back end only.

A cache folder has a folder for each sequence and front end, which holds a file for every 50 frames: the
matches, exact to the last bit.
"""

from __future__ import annotations

import dataclasses
import hashlib
import io
import json
import re
import zlib
from collections.abc import Iterator
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.errors import DataError
from ..core.files import read_arrays, write_bytes_atomic, written_at
from ..core.frame import Clock
from ..core.matches import SAME, StereoMatches, empty_matches
from ..core.settings import to_dict
from ..data.drawn import cache_folder
from ..data.sequence import Sequence
from ..method.config import FeatureConfig, MatchingConfig
from .identity import drive_identity
from .runner import FoundMatches, TimedMatches

CHUNK = 50  # frames in a file
CHECK = 4  # bytes of the checksum at the end of a file


def match_folder(cache: Path | None) -> Path:
    """Where matches are kept: `matches` in a cache folder of one's own, or in the user's."""
    return (cache_folder().parent if cache is None else cache) / "matches"


class CachedMatches:
    """Matches of every frame with the one before, read from the cache, or found and kept there.

    A drop-in for `runner.FoundMatches`, with the same matches to the last bit. Where a file is missing or
    damaged all are found and written anew. Two processes that fill the same folder write the same files.

    Attributes
    ----------
    folder : the folder of this sequence and front end in the cache.
    """

    def __init__(
        self,
        sequence: Sequence,
        features: FeatureConfig,
        matching: MatchingConfig,
        cache: Path | None = None,
    ):
        self.sequence = sequence
        self.settings = features, matching
        # All that decides the matches; a sequence is known by its images, not by its name.
        key = drive_identity(sequence) | {"features": to_dict(features), "matching": to_dict(matching)}
        digest = hashlib.sha256(json.dumps(key, sort_keys=True).encode()).hexdigest()[:16]
        name = re.sub(r"[^A-Za-z0-9_-]+", "-", sequence.name)
        self.folder = match_folder(cache) / f"{name}-{digest}"

    def __iter__(self) -> Iterator[TimedMatches]:
        if self.frames_kept() < len(self.sequence):
            yield from self._found()
            return
        for first in range(0, len(self.sequence), CHUNK):
            clock = Clock()
            frames = self._read(first)
            if frames is None:
                yield from islice(self._found(), first, None)
                return
            clock.stage("cached_matches")
            ms = clock.ms["cached_matches"] / len(frames)
            yield from ((matches, {"cached_matches": ms}) for matches in frames)

    def fill(self) -> None:
        """Find and keep all matches that are not there; those there are only checked."""
        for _ in self:
            pass

    def frames_kept(self, since: int = -1) -> int:
        """Frames in the cache, in files written after a time, nanoseconds: they are counted, not read."""
        paths = map(self._path, range(0, len(self.sequence), CHUNK))
        return min(CHUNK * sum(written_at(path) > since for path in paths), len(self.sequence))

    def _path(self, first: int) -> Path:
        return self.folder / f"{first:06d}.npz"

    def _read(self, first: int) -> list[StereoMatches] | None:
        """Matches of the frames of a file; None where it is missing or damaged."""
        try:
            frames = unpack(self._path(first).read_bytes())
        except (OSError, ValueError, KeyError, TypeError, IndexError):
            return None
        return frames if len(frames) == min(CHUNK, len(self.sequence) - first) else None

    def _found(self) -> Iterator[TimedMatches]:
        """Matches of all frames from the images, kept as they come."""
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise DataError(f"the cache cannot be written: {error.strerror}", self.folder) from None
        frames: list[StereoMatches] = []
        for index, frame in enumerate(FoundMatches(self.sequence, *self.settings)):
            frames.append(frame[0])
            if len(frames) == CHUNK or index == len(self.sequence) - 1:
                write_bytes_atomic(self._path(index + 1 - len(frames)), pack(frames))
                frames = []
            yield frame


def pack(frames: list[StereoMatches]) -> bytes:
    """Matches of several frames as bytes: an npz file, each array as small as is exact, and a checksum."""
    arrays: dict[str, Any] = {"counts": np.array([-1 if m is SAME else len(m) for m in frames])}
    for name in _names():
        arrays[name] = _smallest(np.concatenate([getattr(matches, name) for matches in frames]))
    buffer = io.BytesIO()
    np.savez(buffer, **arrays)
    data = buffer.getvalue()
    return data + zlib.crc32(data).to_bytes(CHECK, "little")


def unpack(data: bytes) -> list[StereoMatches]:
    """What `pack` was given; `ValueError` when a byte was changed or lost."""
    content, check = data[:-CHECK], data[-CHECK:]
    # Nothing but zeros would pass: the checksum of no bytes is 0.
    if not content or zlib.crc32(content).to_bytes(CHECK, "little") != check:
        raise ValueError("the checksum is wrong")
    arrays = read_arrays(content)
    ends = np.cumsum(np.maximum(arrays["counts"], 0))
    kinds = {name: getattr(empty_matches(), name).dtype for name in _names()}
    columns = [np.split(arrays[name].astype(kind), ends[:-1]) for name, kind in kinds.items()]
    whole = zip(arrays["counts"], zip(*(column[: len(ends)] for column in columns), strict=True), strict=True)
    return [SAME if count < 0 else StereoMatches(*fields) for count, fields in whole]


def _names() -> list[str]:
    return [item.name for item in dataclasses.fields(StereoMatches)]


def _smallest(array: NDArray[Any]) -> NDArray[Any]:
    """The same numbers in half the bytes or less, where nothing is lost."""
    kinds = (np.float32,) if array.dtype.kind == "f" else (np.int16, np.int32)
    for kind in kinds:
        smaller = array.astype(kind)
        if smaller.astype(array.dtype).tobytes() == array.tobytes():
            return smaller
    return array
