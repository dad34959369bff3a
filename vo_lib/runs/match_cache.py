"""The cache of matches on disk: after a change of a back-end threshold, only the back end runs again.

The cache has an npz file for each sequence and front end, with an array for each frame.
"""

from __future__ import annotations

import json
import os
import re
import zipfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from ..data.drawn import cache_folder, make_cache_folder
from ..data.sequence import Sequence
from ..errors import DataError
from ..files import locked_draft
from ..geometry.matches import StereoMatches
from ..geometry.result import Clock
from ..geometry.types import Array
from ..paper.settings import MethodConfig
from .front_end import TimedMatches, find_matches
from .identity import FRONT_END_CODE, made_with, matches_identity, short_digest

LAYOUT_VERSION = 2  # of the npz file; increase with every change of its layout
POSITIONS = 4  # of a match, in the left and right images of the previous and of the current pair


def match_folder(cache: Path | None) -> Path:
    """The folder of matches in the kit's cache folder, which is in `cache` or the user's cache folder."""
    return cache_folder(cache) / "matches"


def code_folder(variant: str, cache: Path | None = None) -> Path:
    """The folder of matches from a variant's front end.

    Each version of the front end's code and of the libraries that it uses has a folder.
    """
    origin = json.dumps(made_with(FRONT_END_CODE[variant]), sort_keys=True)
    return match_folder(cache) / f"{variant}-{short_digest(origin.encode())}"


class CachedMatches:
    """Matches of every frame with the previous frame, read from the cache, or computed and stored there.

    The result is identical to the result of `front_end.find_matches`. If the file is missing or damaged, the
    matches are computed and written again.

    Attributes
    ----------
    path : the file for this sequence and front end.

    Raises `DataError` for an image that cannot be read; iteration and `fill` also as `find_matches`, and if
    the cache cannot be written.
    """

    def __init__(self, sequence: Sequence, config: MethodConfig, cache: Path | None = None):
        self.sequence = sequence
        self.config = config
        identity = json.dumps([LAYOUT_VERSION, matches_identity(sequence, config)], sort_keys=True)
        name = re.sub(r"[^A-Za-z0-9_-]+", "-", sequence.name)
        self.path = code_folder(config.variant, cache) / f"{name}-{short_digest(identity.encode())}.npz"

    def __iter__(self) -> Iterator[TimedMatches]:
        if not self._is_intact():
            yield from self._find_and_store()
            return
        with np.load(self.path, allow_pickle=False) as frames:
            for index in range(len(self.sequence)):
                clock = Clock()
                matches = _from_rows(frames[str(index)])
                clock.stage("cached_matches")
                yield matches, clock.ms

    def fill(self) -> bool:
        """Compute and store the matches unless they are in the cache; return whether they were computed."""
        if self._is_intact():
            return False
        for _ in self._find_and_store():
            pass  # the file is complete after the last frame
        return True

    def _is_intact(self) -> bool:
        """Whether the file exists and passes the checksums of the zip format."""
        try:
            with zipfile.ZipFile(self.path) as file:
                return file.testzip() is None
        except (OSError, ValueError, zipfile.BadZipFile, NotImplementedError, RuntimeError):
            return False

    def _find_and_store(self) -> Iterator[TimedMatches]:
        """Matches of all frames from the images, written frame by frame; the file appears at the end."""
        make_cache_folder(self.path.parents[1])
        try:
            self.path.parent.mkdir(exist_ok=True)
        except OSError as error:
            raise DataError(f"the cache cannot be written: {error.strerror}", self.path.parent) from None
        with locked_draft(self.path) as draft:
            with zipfile.ZipFile(draft, "w") as file:
                for index, (matches, ms) in enumerate(find_matches(self.sequence, self.config)):
                    with file.open(f"{index}.npy", "w") as member:
                        np.lib.format.write_array(member, _to_rows(matches), allow_pickle=False)
                    yield matches, ms
            os.replace(draft, self.path)


def _to_rows(matches: StereoMatches) -> Array:
    """The fields of N matches side by side in their order, (N, 11): four positions, age, strength, id.

    Floats represent the integers among them exactly.
    """
    return np.column_stack([*vars(matches).values()])


def _from_rows(rows: Array) -> StereoMatches:
    """The matches of an array (N, 11) from `_to_rows`."""
    xy = rows[:, : 2 * POSITIONS].reshape(-1, POSITIONS, 2)
    # Each field gets memory of its own without gaps, as matches from the images have it.
    prev_left, prev_right, cur_left, cur_right = np.ascontiguousarray(xy.swapaxes(0, 1))
    age, strength, feature_id = np.ascontiguousarray(rows[:, 2 * POSITIONS :].T)
    return StereoMatches(
        prev_left,
        prev_right,
        cur_left,
        cur_right,
        age.astype(np.int64),
        strength,
        feature_id.astype(np.int64),
    )
