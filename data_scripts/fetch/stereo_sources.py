"""Sources of a user's stereo pairs: two folders of images, or a video with both images side by side."""

from __future__ import annotations

import itertools
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import cv2
import numpy as np

from fetch.name_times import frame_numbers, gap_note, times_of_names
from fetch.stereo_calibration import RectifiedRig
from fetch.stereo_check import SAMPLE_PAIRS
from vo_lib.data.kitti import IMAGE_BITS, bits_note, grey_bits, read_image
from vo_lib.data.poses import match_times
from vo_lib.errors import DataError
from vo_lib.files import open_binary
from vo_lib.geometry.types import Array, Image, IntArray

Pair = tuple[Image, Image]

ENDINGS = (".png", ".jpg", ".jpeg", ".bmp", ".pgm", ".ppm", ".tif", ".tiff", ".webp")
MAX_DELAY_S = 0.005  # between left and right image; at 50 km/h a car drives 7 cm in this time
TEXT_AS_VIDEO = cv2.VideoWriter.fourcc(*"ansi")  # FFmpeg shows a text file as a terminal would
VIDEO_SAMPLE_STEP = 10  # frames of a video between pairs of the sample


@dataclass(frozen=True, eq=False)
class FolderSource:
    """N pairs of image files.

    Attributes
    ----------
    paths : left and right image of each pair.
    times : (N,) seconds, if the names are times or the data set has times.
    note : sentences on skipped images, gaps and grey values, or "".
    left : index of each pair's left image among all left images, including skipped images.
    left_count : number of all left images.
    frames : (N,) frame of each pair by the numbers in the names, 0 for the first pair; greater than the
        index after a gap. None if the names have no numbers.
    bits : bits of the grey values in the files (`grey_bits`).
    """

    paths: list[tuple[Path, Path]]
    times: Array | None = None
    note: str = ""
    left: tuple[int, ...] = ()
    left_count: int = 0
    frames: IntArray | None = None
    bits: int = IMAGE_BITS

    def of_pairs(self, rows: Array) -> Array:
        """The rows (N, …) that belong to the N pairs; `rows` has one row per pair or per left image."""
        return rows[[*self.left]] if len(rows) == self.left_count else rows

    def sample(self) -> list[Pair]:
        """Pairs spread over the whole sequence."""
        readers = list(self.pairs())
        places = np.linspace(0, len(readers) - 1, SAMPLE_PAIRS).round()
        return [readers[int(place)]() for place in np.unique(places)]

    def pairs(self) -> Iterator[Callable[[], Pair]]:
        """All pairs; reading raises `DataError` for an image of another size than the first left image."""
        shape = read_image(self.paths[0][0], self.bits).shape
        return (partial(_read_pair, paths, shape, self.bits) for paths in self.paths)

    def size_hint(self) -> int:
        """The number of pairs."""
        return len(self.paths)


@dataclass(frozen=True, eq=False)
class Drive(FolderSource):
    """N pairs of a data set with its own calibration.

    Attributes
    ----------
    times : (N,) seconds. rig : the rectified camera.
    poses : (N, 4, 4) T_w_c of the rectified left camera, identity for the first pair; None without truth.
    """

    times: Array
    rig: RectifiedRig = field(kw_only=True)
    poses: Array | None = field(kw_only=True)


@dataclass(frozen=True)
class VideoSource:
    """A video with both images side by side in every frame."""

    path: Path
    swap: bool = False

    def sample(self) -> list[Pair]:
        """Pairs near the beginning of the video, since a video is read in order."""
        some = itertools.islice(self.pairs(), 0, SAMPLE_PAIRS * VIDEO_SAMPLE_STEP, VIDEO_SAMPLE_STEP)
        return [read() for read in some]

    def pairs(self) -> Iterator[Callable[[], Pair]]:
        """All pairs."""
        video = self._open()
        while True:
            is_read, frame = video.read()
            if not is_read:  # the end
                return
            yield partial(self._halves, np.asarray(frame, np.uint8))

    def size_hint(self) -> int:
        """The number of frames in the video's header."""
        return int(self._property(cv2.CAP_PROP_FRAME_COUNT))

    def fps(self) -> float:
        """Frames per second, or 0 if unknown."""
        return self._property(cv2.CAP_PROP_FPS)

    def _property(self, number: int) -> float:
        """A number in the video's header; 0 if it is unknown."""
        value = float(self._open().get(number))
        return max(value, 0.0) if np.isfinite(value) else 0.0

    def _open(self) -> cv2.VideoCapture:
        """The video at its beginning; `DataError` for any other file."""
        with open_binary(self.path):  # raises for a missing file or a folder
            video = cv2.VideoCapture(str(self.path))
        is_text = int(video.get(cv2.CAP_PROP_FOURCC)) == TEXT_AS_VIDEO
        if not video.isOpened() or is_text or cv2.haveImageReader(str(self.path)):
            raise DataError("is not a video that OpenCV can read", self.path)
        return video

    def _halves(self, frame: Image) -> Pair:
        """The left and the right image of a frame, grey."""
        if frame.shape[1] % 2:
            raise DataError(
                f"frames are {frame.shape[1]} px wide: expected an even width, two images side by side",
                self.path,
            )
        grey = frame
        if frame.ndim == 3:
            grey = np.asarray(cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY), np.uint8)
        half = grey.shape[1] // 2
        first = np.ascontiguousarray(grey[:, :half])
        second = np.ascontiguousarray(grey[:, half:])
        return (second, first) if self.swap else (first, second)


# Stereo pairs in order: a sample for the check, and all pairs, read one at a time.
Source = FolderSource | VideoSource


def pair_images(
    left: Path, right: Path, max_delay: float = MAX_DELAY_S, skip_unpaired: bool = False
) -> FolderSource:
    """Pairs of left and right image files; each side is a folder or a pattern such as `S/I1_*.png`.

    If the names are times (`times_of_names`), each left image is paired with the right image nearest in time,
    within `max_delay` seconds. Otherwise, images with equal numbers are paired. The number of an image is the
    only group of digits that differs within its side. Images without such a number are paired if their names,
    or their texts in place of `*`, are equal.

    Raises `DataError` for a side without images, for fewer than two pairs, and, without `skip_unpaired`, for
    an image without a partner.
    """
    sides = [_images(place) for place in (left, right)]
    bits = grey_bits(list(side.values()) for side in sides)
    notes = [bits_note(bits)] if bits > IMAGE_BITS else []
    stamps_l = times_of_names(list(sides[0]), left)
    stamps_r = times_of_names(list(sides[1]), right)
    if stamps_l is not None and stamps_r is not None:
        pairing = _pair_by_time(sides, (stamps_l, stamps_r), max_delay, left)
    else:
        pairing = _pair_by_name(sides, left, right)
    if pairing.delay > 0:
        notes.append(f"left and right images are up to {1e3 * pairing.delay:.1f} ms apart")
    without_partner = []
    for files, chosen in zip(pairing.files, pairing.chosen, strict=True):
        paired = set(chosen)
        without_partner += [path for number, path in enumerate(files) if number not in paired]
    if without_partner and not skip_unpaired:
        raise DataError("the image has no partner; --skip-unpaired skips such images", without_partner[0])
    if without_partner:
        notes.append(f"images without a partner, skipped: {len(without_partner)}")
    files_l, files_r = pairing.files
    chosen_l, chosen_r = pairing.chosen
    paths = [(files_l[n], files_r[m]) for n, m in zip(chosen_l, chosen_r, strict=True)]
    if pairing.frames is not None:
        note = gap_note(pairing.frames, [left_path.name for left_path, _ in paths])
        if note:
            notes.append(note)
    return FolderSource(
        paths,
        pairing.times,
        "; ".join(notes),
        left=tuple(chosen_l),
        left_count=len(files_l),
        frames=pairing.frames,
        bits=bits,
    )


@dataclass(frozen=True, eq=False)
class _Pairing:
    """How the left and the right images make N pairs.

    Attributes
    ----------
    files : all files of each side; chosen : index of each pair's file among them, for each side.
    times : (N,) seconds, if the names are times; frames : (N,) if they are numbers.
    delay : largest time between a left and a right image, seconds.
    """

    files: tuple[list[Path], list[Path]]
    chosen: tuple[list[int], list[int]]
    times: Array | None = None
    frames: IntArray | None = None
    delay: float = 0.0


def _pair_by_time(
    sides: list[dict[str, Path]], stamps: tuple[Array, Array], max_delay: float, left: Path
) -> _Pairing:
    """Pairs of the images nearest in time, from the times (N,) of both sides, seconds."""
    # By the order of names, 0.3 comes before 0.25.
    order_l = np.argsort(stamps[0], kind="stable")
    order_r = np.argsort(stamps[1], kind="stable")
    times_l = stamps[0][order_l]
    times_r = stamps[1][order_r]
    at_l, at_r = match_times(times_l, times_r, np.inf)
    delays = np.abs(times_l[at_l] - times_r[at_r])
    close = delays <= max_delay
    if np.count_nonzero(close) < 2:
        raise DataError(
            f"expected two or more pairs of images at most --max-delay {max_delay:g} s apart; "
            f"the nearest images are {delays.min():.3g} s apart",
            left,
        )
    files_l = list(sides[0].values())
    files_r = list(sides[1].values())
    return _Pairing(
        ([files_l[n] for n in order_l.tolist()], [files_r[n] for n in order_r.tolist()]),
        (at_l[close].tolist(), at_r[close].tolist()),
        times=times_l[at_l[close]],
        delay=float(delays[close].max()),
    )


def _pair_by_name(sides: list[dict[str, Path]], left: Path, right: Path) -> _Pairing:
    """Pairs of images with equal numbers, or else with equal names."""
    numbered = [_by_number(side) for side in sides]
    if all(numbered):
        sides = numbered
    common = sides[0].keys() & sides[1].keys()
    if len(common) < 2:
        expected = "expected equal names, equal numbers (the digits that differ) or times"
        raise DataError(f"fewer than two names agree with the names in {left}: {expected}", right)
    files_l = list(sides[0].values())
    files_r = list(sides[1].values())
    chosen_l = [place for place, name in enumerate(sides[0]) if name in common]
    chosen_r = [place for place, name in enumerate(sides[1]) if name in common]
    numbers = [int(name) for name in sides[0] if name in common] if all(numbered) else []
    frames = frame_numbers(numbers) if numbers else None
    return _Pairing((files_l, files_r), (chosen_l, chosen_r), frames=frames)


def _images(place: Path) -> dict[str, Path]:
    """Image paths: for a folder, by file stem; for a pattern, by the text that `*` matches."""
    head, star, tail = place.name.partition("*")
    is_pattern = bool(star)
    folder = place.parent if is_pattern else place
    if not folder.is_dir():
        raise DataError("the folder is missing", folder)
    named = {}
    for path in folder.iterdir():
        if path.suffix.lower() not in ENDINGS:
            continue
        if not is_pattern:
            named[path.stem] = path
        elif path.name.startswith(head) and path.name.endswith(tail):
            whole = path.name if tail else path.stem
            named[whole.removeprefix(head).removesuffix(tail)] = path
    if len(named) < 2:
        raise DataError(f"expected two or more images, found {len(named)}", place)
    return {name: named[name] for name in sorted(named, key=_natural)}


def _natural(name: str) -> list[tuple[int, str]]:
    """Sort key that orders img2 before img10."""
    return [(int(part or 0), word) for word, part in re.findall(r"(\D*)(\d*)", name)]


def _by_number(images: dict[str, Path]) -> dict[str, Path]:
    """The images by number, in order; empty unless exactly one group of digits differs between the names."""
    numbers_of = [[int(digits) for digits in re.findall(r"\d+", name)] for name in images]
    if len({len(numbers) for numbers in numbers_of}) > 1:
        return {}
    # Each place in the names, with the numbers of all images there.
    differing = [column for column in zip(*numbers_of, strict=True) if len(set(column)) > 1]
    if len(differing) != 1 or len(set(differing[0])) < len(images):
        return {}
    in_order = sorted(zip(differing[0], images.values(), strict=True))
    return {str(number): path for number, path in in_order}


def _read_pair(paths: tuple[Path, Path], shape: tuple[int, ...], bits: int) -> Pair:
    """The two images; `DataError` for an image of another shape."""
    left = read_image(paths[0], bits)
    right = read_image(paths[1], bits)
    for path, image in zip(paths, (left, right), strict=True):
        if image.shape != shape:
            actual = f"{image.shape[1]}×{image.shape[0]}"
            expected = f"{shape[1]}×{shape[0]}"
            raise DataError(f"the image is {actual}, expected {expected} as in the first left image", path)
    return left, right
