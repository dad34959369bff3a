"""Matches kept on disk, so that a changed threshold of the back end re-runs the back end only.

The cache has an npz file for each sequence and front end, with an exact array for each frame.
"""

from __future__ import annotations

import hashlib
import json
import re
import shutil
import zipfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from ..data.drawn import cache_folder
from ..data.sequence import Sequence
from ..errors import DataError
from ..files import writing
from ..geometry.matches import StereoMatches
from ..geometry.result import Clock
from ..geometry.types import Array
from ..paper.settings import MethodConfig
from .front_end import TimedMatches, find_matches
from .identity import FRONT_END_CODE, code_digest, matches_identity

LAYOUT = 2  # of the file; raised when it changes


def match_folder(cache: Path | None) -> Path:
    """Where matches are kept: `matches` in the cache folder given, or in the user's."""
    return (cache_folder().parent if cache is None else cache) / "matches"


def code_folder(variant: str, cache: Path | None = None) -> Path:
    """Where the matches by this code of a variant's front end are kept; other folders are of other code."""
    return match_folder(cache) / f"{variant}-{code_digest(FRONT_END_CODE[variant])}"


class CachedMatches:
    """Matches of every frame with the one before, read from the cache, or found and kept there.

    A drop-in for `front_end.find_matches`, with the same matches to the last bit. Where the file is missing
    or damaged, the matches are found and written anew.

    Attributes
    ----------
    path : the file of this sequence and front end.
    """

    def __init__(self, sequence: Sequence, config: MethodConfig, cache: Path | None = None):
        self.sequence = sequence
        self.config = config
        identity = json.dumps([LAYOUT, matches_identity(sequence, config)], sort_keys=True)
        digest = hashlib.sha256(identity.encode()).hexdigest()[:16]
        name = re.sub(r"[^A-Za-z0-9_-]+", "-", sequence.name)
        self.path = code_folder(config.variant, cache) / f"{name}-{digest}.npz"

    def __iter__(self) -> Iterator[TimedMatches]:
        if not self._is_whole():
            yield from self._find()
            return
        with np.load(self.path, allow_pickle=False) as frames:
            for index in range(len(self.sequence)):
                clock = Clock()
                matches = _from_rows(frames[str(index)])
                clock.stage("cached_matches")
                yield matches, clock.ms

    def fill(self) -> None:
        """Find and keep the matches unless they are there."""
        if not self._is_whole():
            for _ in self._find():
                pass

    def _is_whole(self) -> bool:
        """Whether the file is there and every byte passes the zip format's checksums."""
        try:
            with zipfile.ZipFile(self.path) as file:
                return file.testzip() is None
        except (OSError, ValueError, zipfile.BadZipFile, NotImplementedError, RuntimeError):
            return False

    def _find(self) -> Iterator[TimedMatches]:
        """Matches of all frames from the images, written as they come; the file has its name at the end."""
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise DataError(f"the cache cannot be written: {error.strerror}", self.path.parent) from None
        with writing(self.path) as target, zipfile.ZipFile(target, "w") as file:
            for index, frame in enumerate(find_matches(self.sequence, self.config)):
                with file.open(f"{index}.npy", "w") as member:
                    np.lib.format.write_array(member, _to_rows(frame[0]), allow_pickle=False)
                yield frame


def _to_rows(matches: StereoMatches) -> Array:
    """All columns of N matches side by side, (N, 11); a float holds the whole numbers exactly."""
    return np.column_stack([*vars(matches).values()])


def _from_rows(rows: Array) -> StereoMatches:
    """The matches that `_to_rows` was given."""
    prev_left, prev_right, cur_left, cur_right = np.ascontiguousarray(
        rows[:, :8].reshape(-1, 4, 2).swapaxes(0, 1)
    )
    age, strength, number = np.ascontiguousarray(rows[:, 8:].T)
    whole = age.astype(np.int64), strength, number.astype(np.int64)
    return StereoMatches(prev_left, prev_right, cur_left, cur_right, *whole)


def clean_matches(cache: Path | None = None) -> int:
    """Remove the matches of other code; returns how many bytes that were."""
    current = {code_folder(variant, cache) for variant in FRONT_END_CODE}
    stale = [path for path in match_folder(cache).glob("*") if path not in current]
    size = sum(map(folder_size, stale))
    for path in stale:
        shutil.rmtree(path, ignore_errors=True) if path.is_dir() else path.unlink(missing_ok=True)
    return size


def folder_size(path: Path) -> int:
    """Bytes of a file, or of all files in a folder."""
    files = [path] if path.is_file() else path.rglob("*")
    return sum(file.stat().st_size for file in files if file.is_file())
