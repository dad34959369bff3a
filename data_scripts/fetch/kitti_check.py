"""Whether a KITTI odometry tree is complete: frames, pairs, sizes, calibration, times, poses, images."""

from __future__ import annotations

import itertools
import os
import struct
from collections import Counter
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from vo_lib.core.errors import DataError
from vo_lib.core.files import opened
from vo_lib.core.poses import read_kitti_poses
from vo_lib.core.types import Progress
from vo_lib.data.kitti import EXPECTED_FRAMES, PNG, numbered, read_calibration, read_image, read_times
from vo_lib.data.sequence import parse_sequences

LAST_WITH_POSES = "10"
RANGES_SHOWN = 4


@dataclass(frozen=True)
class SequenceReport:
    """What was found of one sequence.

    Attributes
    ----------
    name : of the sequence.
    pairs, expected : stereo pairs found, and how many the benchmark has (None for a sequence of one's own).
    parts : (part, what was found) in words, in a fixed order.
    problems : what is missing or wrong, a sentence each; none where the sequence is complete.
    """

    name: str
    pairs: int
    expected: int | None
    parts: tuple[tuple[str, str], ...]
    problems: tuple[str, ...]


def parse_numbers(text: str) -> list[str]:
    """Sequences of the benchmark named as "07,04" or "00-10", each once; `DataError` for any other name."""
    names = [name.removeprefix("kitti/") for name in parse_sequences(text)]
    for name in names:
        if name not in EXPECTED_FRAMES:
            raise DataError(f"--sequences {text!r}: {name!r} is no sequence; expected numbers of 00 … 21")
    return list(dict.fromkeys(names))


def check_tree(
    root: Path, names: Iterable[str] | None = None, deep: bool = False, progress: Progress | None = None
) -> list[SequenceReport]:
    """A report of each sequence named, or of all that are there.

    Parameters
    ----------
    deep : decode every image, on all cores; else only its first bytes are read.
    progress : called with (images looked at, images in all).

    Raises
    ------
    DataError : there is no tree.
    """
    root = root / "dataset" if (root / "dataset" / "sequences").is_dir() else root
    if not (root / "sequences").is_dir():
        raise DataError("no KITTI tree: expected the folder sequences, with 00 … 21, in it", root)
    if names is None:
        names = sorted(p.name for p in (root / "sequences").iterdir() if p.is_dir())
    folders = [root / "sequences" / name for name in names]
    found = [{side: numbered(folder / side) for side in _sides(folder)} for folder in folders]
    total = sum(len(images) for sides in found for images in sides.values())
    done = 0

    def looked() -> None:
        nonlocal done
        done += 1
        if progress is not None and (done % 20 == 0 or done == total):
            progress(done, total)

    return [
        _check_sequence(root, folder, sides, deep, looked)
        for folder, sides in zip(folders, found, strict=True)
    ]


def _sides(folder: Path) -> list[str]:
    colour = [side for side in ("image_2", "image_3") if (folder / side).is_dir()]
    return ["image_0", "image_1", *(["image_2", "image_3"] if colour else [])]


def _check_sequence(
    root: Path, folder: Path, sides: dict[str, dict[int, str]], deep: bool, looked: Callable[[], None]
) -> SequenceReport:
    expected = EXPECTED_FRAMES.get(folder.name)
    everything = set().union(*sides.values())
    # A clip of one's own may start anywhere; the benchmark's sequences start at 0.
    start, stop = 0, expected
    if stop is None:
        start, stop = min(everything, default=0), max(everything, default=-1) + 1
    problems: list[str] = []
    parts: list[tuple[str, str]] = []
    for side, images in sides.items():
        count = f"{len(images)} of {stop}" if expected is not None else str(len(images))
        inside = [number for number in images if start <= number < stop]
        lost = _gaps(inside, start, stop)
        if lost or not images:
            problems.append(f"{side}: missing {in_ranges(lost)}" if images else f"{side}: no images")
        surplus = [(number, number) for number in images.keys() - set(inside)]
        if surplus:
            problems.append(f"{side}: not of this sequence: {in_ranges(surplus)}")
        size, wrong = _look_at_images(folder / side, images, deep, looked)
        problems += [f"{side}/{words}" for words in wrong]
        parts.append((side, f"{count} images{size}"))
    pairs = len(set(sides["image_0"]) & set(sides["image_1"]))
    numbers = stop - start
    files: list[tuple[str, Path, Callable[[Path], str]]] = [
        ("calib.txt", folder / "calib.txt", _camera),
        ("times.txt", folder / "times.txt", lambda path: _rows(len(read_times(path)), numbers)),
    ]
    poses = folder / "poses.txt"
    poses = poses if poses.exists() else root / "poses" / f"{folder.name}.txt"
    if poses.exists() or (expected is not None and folder.name <= LAST_WITH_POSES):
        label = poses.name if poses.parent == folder else f"poses/{poses.name}"
        files.append((label, poses, lambda path: _rows(len(read_kitti_poses(path)), numbers)))
    for label, path, read in files:
        try:
            parts.append((label, read(path)))
        except DataError as error:
            problems.append(f"{label}: " + str(error).removeprefix(f"{path}: "))
            parts.append((label, "missing" if not path.exists() else "not as it should be"))
    return SequenceReport(folder.name, pairs, expected, tuple(parts), tuple(problems))


def _look_at_images(
    folder: Path, images: dict[int, str], deep: bool, looked: Callable[[], None]
) -> tuple[str, list[str]]:
    """The size that most images have, in words, and what is wrong with single images."""

    def outcome(name: str) -> tuple[int, int] | str:
        try:
            return read_image(folder / name).shape[::-1] if deep else _png_size(folder / name)
        except DataError as error:
            return str(error).removeprefix(f"{folder / name}: ")

    sizes: dict[str, tuple[int, int]] = {}
    problems = []
    with ThreadPoolExecutor(max_workers=os.cpu_count() or 1) as pool:
        for name, found in zip(images.values(), pool.map(outcome, images.values()), strict=True):
            if isinstance(found, str):
                problems.append(f"{name}: {found}")
            else:
                sizes[name] = found
            looked()
    if not sizes:
        return "", problems
    usual = Counter(sizes.values()).most_common(1)[0][0]
    problems += [
        f"{name}: {size[0]}×{size[1]}, the others are {usual[0]}×{usual[1]}"
        for name, size in sizes.items()
        if size != usual
    ]
    return f", {usual[0]}×{usual[1]}" + (", all decoded" if deep else ""), problems


def _png_size(path: Path) -> tuple[int, int]:
    """Width and height from the first bytes of a PNG file."""
    with opened(path) as file:
        start = file.read(24)
    if len(start) < 24 or not start.startswith(PNG):
        raise DataError("is empty or no PNG file", path)
    width, height = struct.unpack(">II", start[16:24])
    return int(width), int(height)


def _camera(path: Path) -> str:
    camera = read_calibration(path)
    return f"f {camera.f:.1f} px, baseline {camera.baseline:.3f} m"


def _rows(found: int, frames: int) -> str:
    if found < frames:
        raise DataError(f"{found} rows for {frames} frames")
    return f"{found} rows"


def _gaps(numbers: list[int], start: int, stop: int) -> list[tuple[int, int]]:
    """Ranges (first, last) of start … stop - 1 without any of the numbers, by their edges."""
    edges = [start - 1, *sorted(numbers), stop]
    return [(a + 1, b - 1) for a, b in itertools.pairwise(edges) if b - a > 1]


def in_ranges(ranges: Iterable[tuple[int, int]]) -> str:
    """Ranges of frame numbers (first, last), rising: "3, 7-12 and 40 more"; those that touch are one."""
    runs: list[list[int]] = []
    for first, last in sorted(ranges):
        if runs and first == runs[-1][1] + 1:
            runs[-1][1] = last
        else:
            runs.append([first, last])
    shown = [str(a) if a == b else f"{a}-{b}" for a, b in runs[:RANGES_SHOWN]]
    more = sum(b - a + 1 for a, b in runs[RANGES_SHOWN:])
    return ", ".join(shown) + (f" and {more} more" if more else "")
