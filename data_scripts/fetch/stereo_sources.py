"""Where a user's stereo pairs come from: two folders of images, or a video with both side by side."""

from __future__ import annotations

import itertools
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import cv2
import numpy as np

from fetch.stereo_calibration import Rig
from fetch.stereo_check import SAMPLE_PAIRS
from vo_lib.data.kitti import read_image
from vo_lib.errors import DataError
from vo_lib.geometry.types import Array, Image

Pair = tuple[Image, Image]

ENDINGS = (".png", ".jpg", ".jpeg", ".bmp", ".pgm", ".ppm", ".tif", ".tiff", ".webp")
VIDEO_SAMPLE_STEP = 10  # frames of a video from one pair of the sample to the next


@dataclass(frozen=True)
class Drive:
    """N stereo pairs of a data set that says itself what its cameras are.

    Attributes
    ----------
    paths : image files, left and right. rig : what rectifies them.
    times : (N,) seconds, as the data set counts them.
    poses : (N, 4, 4) T_w_c of the rectified left camera, the first one the identity; None without truth.
    note : what was left out and why, or "".
    """

    paths: list[tuple[Path, Path]]
    rig: Rig
    times: Array
    poses: Array | None
    note: str


@dataclass(frozen=True)
class FolderSource:
    """Pairs of image files."""

    paths: list[tuple[Path, Path]]

    def sample(self) -> list[Pair]:
        """Pairs spread over the whole sequence."""
        chosen = np.unique(np.linspace(0, len(self.paths) - 1, SAMPLE_PAIRS).round())
        return [_read_pair(self.paths[int(i)]) for i in chosen]

    def pairs(self) -> Iterator[Callable[[], Pair]]:
        """All pairs."""
        return (partial(_read_pair, paths) for paths in self.paths)

    def size_hint(self) -> int:
        """How many there are."""
        return len(self.paths)


@dataclass(frozen=True)
class VideoSource:
    """A video whose frames hold both images side by side."""

    path: Path
    swap: bool = False

    def sample(self) -> list[Pair]:
        """Pairs of the first frames: videos are read in order."""
        some = itertools.islice(self.pairs(), 0, SAMPLE_PAIRS * VIDEO_SAMPLE_STEP, VIDEO_SAMPLE_STEP)
        return [read() for read in some]

    def pairs(self) -> Iterator[Callable[[], Pair]]:
        """All pairs."""
        video = self._open()
        try:
            while True:
                good, frame = video.read()
                if not good:
                    return
                yield partial(self._halves, np.asarray(frame, np.uint8))
        finally:
            video.release()

    def size_hint(self) -> int:
        """As many as the video says it has."""
        return int(self._property(cv2.CAP_PROP_FRAME_COUNT))

    def fps(self) -> float:
        """Frames a second, or 0 where the video does not say."""
        return self._property(cv2.CAP_PROP_FPS)

    def _property(self, number: int) -> float:
        video = self._open()
        value = float(video.get(number))
        video.release()
        return max(value, 0.0) if np.isfinite(value) else 0.0

    def _open(self) -> cv2.VideoCapture:
        if not self.path.is_file():
            raise DataError("the file is missing", self.path)
        video = cv2.VideoCapture(str(self.path))
        if not video.isOpened():
            raise DataError("is no video that OpenCV can read", self.path)
        return video

    def _halves(self, frame: Image) -> Pair:
        if frame.shape[1] % 2:
            raise DataError(
                f"frames are {frame.shape[1]} px wide: two images side by side are even", self.path
            )
        grey = np.asarray(cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY) if frame.ndim == 3 else frame, np.uint8)
        half = grey.shape[1] // 2
        first, second = np.ascontiguousarray(grey[:, :half]), np.ascontiguousarray(grey[:, half:])
        return (second, first) if self.swap else (first, second)


# Stereo pairs in order: a sample to judge them by, all of them, each read when it is called.
Source = FolderSource | VideoSource


def pair_folders(left: Path, right: Path) -> list[tuple[Path, Path]]:
    """Left and right image files that belong together: of the same name, else in the order of their numbers.

    Raises `DataError` for folders without images, or of different length without equal names.
    """
    sides = []
    for folder in (left, right):
        if not folder.is_dir():
            raise DataError("the folder is missing", folder)
        found = sorted((p for p in folder.iterdir() if p.suffix.lower() in ENDINGS), key=_by_number)
        if len(found) < 2:
            raise DataError(f"expected two images or more, found {len(found)}", folder)
        sides.append(found)
    names = [{p.stem for p in side} for side in sides]
    if names[0] & names[1]:
        for stem in sorted(names[0] ^ names[1]):
            lacking = right if stem in names[0] else left
            raise DataError(f"the image {stem} is missing, its partner is there", lacking)
    elif len(sides[0]) != len(sides[1]):
        raise DataError(
            f"has {len(sides[1])} images, {left} has {len(sides[0])}, and their names do not match", right
        )
    return list(zip(*sides, strict=True))


def _by_number(path: Path) -> list[tuple[int, str]]:
    """Sorts img2 before img10."""
    return [(int(part or 0), word) for word, part in re.findall(r"(\D*)(\d*)", path.stem)]


def _read_pair(paths: tuple[Path, Path]) -> Pair:
    return read_image(paths[0]), read_image(paths[1])
