"""Matches kept on disk, so that a changed threshold of the back end re-runs the back end only.

A cache folder has a folder for each sequence and front end, which holds a file for every 50 frames: the
matches, exact to the last bit, and the front end's state behind them, from which a stopped search goes on.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import re
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..beyond.odometry import State
from ..config import FeatureConfig, MatchingConfig
from ..core.errors import DataError
from ..core.files import write_bytes_atomic, write_text_atomic
from ..core.frame import Clock
from ..core.matches import StereoMatches, empty_matches
from ..core.settings import to_dict
from ..data.sequence import Sequence
from ..synthetic import cache_folder
from .arrays import pack_arrays, unpack_arrays
from .identity import code_digest, images_digest, versions
from .runner import FoundMatches, TimedMatches

CHUNK = 50  # frames in a file
STATE = "state."
KEY = "key.json"


def match_folder(cache: Path | None) -> Path:
    """Where matches are kept: `matches` in a cache folder of one's own, or in the user's."""
    return (cache_folder().parent if cache is None else cache) / "matches"


def match_key(sequence: Sequence, features: FeatureConfig, matching: MatchingConfig) -> dict[str, Any]:
    """All that decides the matches: settings, camera, images, the front end's code and the libraries."""
    return {
        "sequence": sequence.name,
        "frames": [sequence.frames[0], sequence.frames[-1]],
        "features": to_dict(features),
        "matching": to_dict(matching),
        "camera": to_dict(sequence.camera),
        "images": images_digest(sequence),
        "made_with": versions() | {"code": code_digest()},
    }


class CachedMatches:
    """Matches of every frame with the one before, read from the cache; those not there are found and kept.

    A drop-in for `runner.FoundMatches`, with the same matches to the last bit. A file that is damaged is
    made anew, and all after it. Two processes that fill the same folder write the same files.

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
        start: int = 0,
    ):
        self.sequence = sequence
        self.settings = features, matching
        self.start = start
        self._key: dict[str, Any] = json.loads(json.dumps(match_key(sequence, features, matching)))
        # The name says nothing about the matches: a sequence is known by its images.
        decisive = {name: value for name, value in self._key.items() if name != "sequence"}
        digest = hashlib.sha256(json.dumps(decisive, sort_keys=True).encode()).hexdigest()[:16]
        name = re.sub(r"[^A-Za-z0-9_-]+", "-", sequence.name)
        self.folder = match_folder(cache) / f"{name}-{digest}"

    def state(self) -> State:
        """Nothing: a run on cached matches needs no front end to go on."""
        return {}

    def __iter__(self) -> Iterator[TimedMatches]:
        first = self.start - self.start % CHUNK
        while first < len(self.sequence):
            clock = Clock()
            chunk = self._read(first)
            if chunk is None:
                yield from self._found(first)
                return
            clock.stage("cached_matches")
            frames = chunk[0][max(self.start - first, 0) :]
            ms = clock.ms["cached_matches"] / len(frames)
            yield from ((matches, {"cached_matches": ms}) for matches in frames)
            first += CHUNK

    def fill(self) -> None:
        """Find and keep all matches that are not there; those there are only checked."""
        for _ in self:
            pass

    def frames_kept(self) -> int:
        """Frames in the cache now, for a progress bar: files are counted, not read."""
        count = sum(self._path(first).exists() for first in range(0, len(self.sequence), CHUNK))
        return min(CHUNK * count, len(self.sequence))

    def _path(self, first: int) -> Path:
        return self.folder / f"{first:06d}.npz"

    def _read(self, first: int) -> tuple[list[StereoMatches], State] | None:
        """Matches of the frames of a file and the state behind them; None where it is missing or damaged."""
        try:
            chunk = unpack(self._path(first).read_bytes())
        except (OSError, ValueError):
            return None
        whole = len(chunk[0]) == min(CHUNK, len(self.sequence) - first)
        return chunk if whole else None

    def _found(self, first: int) -> Iterator[TimedMatches]:
        """Matches from the images, from the file of frame `first` on, kept as they come."""
        self._prepare_folder()
        state: State = {}
        while first > 0:
            before = self._read(first - CHUNK)
            if before is not None:
                state = before[1]
                break
            first -= CHUNK
        source = FoundMatches(self.sequence, *self.settings, start=first, state=state)
        chunk: list[StereoMatches] = []
        for index, frame in enumerate(source, start=first):
            chunk.append(frame[0])
            if len(chunk) == CHUNK or index == len(self.sequence) - 1:
                write_bytes_atomic(self._path(index + 1 - len(chunk)), pack(chunk, source.state()))
                chunk = []
            if index >= self.start:
                yield frame

    def _prepare_folder(self) -> None:
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise DataError(f"the cache cannot be written: {error.strerror}", self.folder) from None
        self._drop_outdated()
        write_text_atomic(self.folder / KEY, json.dumps(self._key, indent=2) + "\n")

    def _drop_outdated(self) -> None:
        """Remove the same matches as other code or other libraries found them: the cache does not pile up."""
        for path in self.folder.parent.glob(f"*/{KEY}"):
            try:
                other = json.loads(path.read_text(encoding="utf-8"))
                same = other | {"made_with": None} == self._key | {"made_with": None}
            except (OSError, ValueError, TypeError):
                continue
            if same and path.parent != self.folder:
                shutil.rmtree(path.parent, ignore_errors=True)


def pack(frames: list[StereoMatches], state: State) -> bytes:
    """Matches of several frames and a state as bytes, each array as small as is exact."""
    arrays: dict[str, NDArray[Any]] = {"counts": np.array([len(matches) for matches in frames])}
    for name in _names():
        arrays[name] = _smallest(np.concatenate([getattr(matches, name) for matches in frames]))
    arrays |= {STATE + name: array for name, array in state.items()}
    return pack_arrays(arrays)


def unpack(data: bytes) -> tuple[list[StereoMatches], State]:
    """What `pack` was given; `ValueError` when a byte was changed or lost."""
    arrays = unpack_arrays(data)
    kinds = {name: getattr(empty_matches(), name).dtype for name in _names()}
    ends = np.cumsum(arrays["counts"])
    columns = [np.split(arrays[name].astype(kind), ends[:-1]) for name, kind in kinds.items()]
    state = {name.removeprefix(STATE): a for name, a in arrays.items() if name.startswith(STATE)}
    return [StereoMatches(*fields) for fields in zip(*columns, strict=True)], state


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
