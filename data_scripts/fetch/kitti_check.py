"""Whether a KITTI odometry tree is complete: frames, pairs, sizes, calibration, times, poses, images."""

from __future__ import annotations

import itertools
import os
import re
from collections import Counter
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from vo_lib.data.catalogue import parse_sequences
from vo_lib.data.kitti import EXPECTED_FRAMES, read_calibration, read_image, read_times
from vo_lib.data.poses import read_kitti_poses
from vo_lib.errors import DataError
from vo_lib.geometry.types import Progress

LAST_WITH_POSES = "10"


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
    deep : decode every image, on all cores; else only their names are read.
    progress : called with (sequences looked at, sequences in all).

    Raises
    ------
    DataError : there is no tree.
    """
    root = root / "dataset" if (root / "dataset" / "sequences").is_dir() else root
    if not (root / "sequences").is_dir():
        raise DataError("no KITTI tree: expected the folder sequences, with 00 … 21, in it", root)
    if names is None:
        names = sorted(p.name for p in (root / "sequences").iterdir() if p.is_dir())
    reports, names = list[SequenceReport](), list(names)
    for name in names:
        reports.append(_check_sequence(root, root / "sequences" / name, deep))
        if progress is not None:
            progress(len(reports), len(names))
    return reports


def _by_number(folder: Path) -> dict[int, str]:
    """File names of the images in a folder by image number; empty where the folder is missing."""
    names = sorted(path.name for path in folder.glob("*.png") if re.fullmatch(r"\d+", path.stem))
    return {int(name[:-4]): name for name in names}


def _check_sequence(root: Path, folder: Path, deep: bool) -> SequenceReport:
    colour = [side for side in ("image_2", "image_3") if (folder / side).is_dir()]
    kinds = ["image_0", "image_1", *(["image_2", "image_3"] if colour else [])]
    sides = {side: _by_number(folder / side) for side in kinds}
    expected = EXPECTED_FRAMES.get(folder.name)
    everything = set().union(*sides.values())
    # A clip of one's own may start anywhere; the benchmark's sequences start at 0.
    start, stop = (0, expected) if expected else (min(everything, default=0), max(everything, default=-1) + 1)
    frames = stop - start
    problems: list[str] = []
    parts: list[tuple[str, str]] = []
    for side, images in sides.items():
        count = f"{len(images)} of {frames}" if expected is not None else str(len(images))
        inside = [number for number in images if start <= number < stop]
        if not images:
            problems.append(f"{side}: no images")
        elif len(inside) < frames:
            first = next(number for number in itertools.count(start) if number not in images)
            problems.append(f"{side}: {frames - len(inside)} images missing, the first is {first:06d}")
        if surplus := images.keys() - set(inside):
            problems.append(f"{side}: {len(surplus)} images not of this sequence, such as {min(surplus):06d}")
        size, wrong = _look_at_images(folder / side, images) if deep else ("", [])
        problems += [f"{side}/{words}" for words in wrong]
        parts.append((side, f"{count} images{size}"))
    pairs = len(set(sides["image_0"]) & set(sides["image_1"]))
    files: list[tuple[str, Path, Callable[[Path], str]]] = [
        ("calib.txt", folder / "calib.txt", _camera),
        ("times.txt", folder / "times.txt", lambda path: _rows(len(read_times(path)), frames)),
    ]
    poses = folder / "poses.txt"
    poses = poses if poses.exists() else root / "poses" / f"{folder.name}.txt"
    if poses.exists() or (expected is not None and folder.name <= LAST_WITH_POSES):
        label = poses.name if poses.parent == folder else f"poses/{poses.name}"
        files.append((label, poses, lambda path: _rows(len(read_kitti_poses(path)), frames)))
    for label, path, read in files:
        try:
            parts.append((label, read(path)))
        except DataError as error:
            problems.append(f"{label}: " + str(error).removeprefix(f"{path}: "))
            parts.append((label, "missing" if not path.exists() else "not as it should be"))
    return SequenceReport(folder.name, pairs, expected, tuple(parts), tuple(problems))


def _look_at_images(folder: Path, images: dict[int, str]) -> tuple[str, list[str]]:
    """The size that most images have, in words, and what is wrong with single images."""

    def outcome(name: str) -> tuple[int, int] | str:
        try:
            return read_image(folder / name).shape[::-1]
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
    if not sizes:
        return "", problems
    usual = Counter(sizes.values()).most_common(1)[0][0]
    problems += [
        f"{name}: {size[0]}×{size[1]}, the others are {usual[0]}×{usual[1]}"
        for name, size in sizes.items()
        if size != usual
    ]
    return f", {usual[0]}×{usual[1]}, all decoded", problems


def _camera(path: Path) -> str:
    camera = read_calibration(path)
    return f"f {camera.f:.1f} px, baseline {camera.baseline:.3f} m"


def _rows(found: int, frames: int) -> str:
    if found < frames:
        raise DataError(f"{found} rows for {frames} frames")
    return f"{found} rows"
