"""Check of a KITTI folder: frames, pairs, sizes, calibration, times, poses, images."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from vo_lib.data import kitti
from vo_lib.data.catalogue import parse_sequences
from vo_lib.data.poses import read_kitti_poses
from vo_lib.errors import DataError
from vo_lib.geometry.types import Progress

LAST_WITH_POSES = "10"
MAX_NUMBERS_PER_IMAGE = 100  # with more numbers between the images' numbers, the names are times


@dataclass(frozen=True)
class SequenceReport:
    """The result of checking one sequence.

    Attributes
    ----------
    name : the sequence's name.
    part : options of `vo data get_kitti` for this part of a sequence; "" for a whole sequence.
    pairs, expected : numbers of present and of expected stereo pairs (None for a user's own sequence).
    complete : one line for each complete file or image folder.
    problems : one sentence for each missing or invalid file; empty for a complete sequence.
    """

    name: str
    part: str
    pairs: int
    expected: int | None
    complete: tuple[str, ...]
    problems: tuple[str, ...]


def parse_numbers(text: str) -> list[str]:
    """Names of benchmark sequences from text such as "07,04" or "00-10", each once. Raises `DataError`."""
    names = [name.removeprefix("kitti/") for name in parse_sequences(text)]
    for name in names:
        if name not in kitti.EXPECTED_FRAMES:
            raise DataError(f"--sequences {text!r}: unknown sequence {name!r}; expected 00 to 21")
    return list(dict.fromkeys(names))


def check_tree(
    root: Path, names: Iterable[str] | None = None, deep: bool = False, progress: Progress | None = None
) -> list[SequenceReport]:
    """Reports of the named sequences, by default of all sequences in the folder.

    Parameters
    ----------
    deep : decode every image, on all cores; otherwise only file names are checked.
    progress : called with (sequences checked, total sequences).

    Raises `DataError` if the folder is missing.
    """
    root = root / "dataset" if (root / "dataset" / "sequences").is_dir() else root
    if not (root / "sequences").is_dir():
        raise DataError("not a KITTI folder: expected a folder 'sequences' with the folders 00 … 21", root)
    if names is None:
        names = sorted(folder.name for folder in (root / "sequences").iterdir() if folder.is_dir())
    reports = list[SequenceReport]()
    names = list(names)
    for name in names:
        reports.append(_check_sequence(root, root / "sequences" / name, deep))
        if progress is not None:
            progress(len(reports), len(names))
    return reports


def _check_sequence(root: Path, folder: Path, deep: bool) -> SequenceReport:
    """The report of one sequence: its images, calibration, times and poses."""
    has_colour = any((folder / side).is_dir() for side in ("image_2", "image_3"))
    side_count = 4 if has_colour else 2
    sides = {f"image_{side}": _by_number(folder / f"image_{side}") for side in range(side_count)}
    complete = list[str]()
    problems = list[str]()
    part = kitti.read_part(folder)
    mark = "" if part is None else part.text
    if mark:
        complete.append(f"a part: {mark}")
    wanted = kitti.wanted_frames(folder)
    expected = None if wanted is None else len(wanted)
    numbers: Sequence[int]
    if wanted is not None:
        numbers = wanted
    else:
        numbers, fault = _own_numbers(sides)
        problems += fault
    for side, images in sides.items():
        side_complete, side_problems = _check_side(folder / side, images, numbers, deep)
        complete += side_complete
        problems += side_problems
    has_poses = expected is not None and folder.name <= LAST_WITH_POSES
    table_complete, table_problems = _check_tables(root, folder, len(numbers), has_poses)
    complete += table_complete
    problems += table_problems
    pairs = kitti.count_pairs(folder)
    return SequenceReport(folder.name, mark, pairs, expected, tuple(complete), tuple(problems))


def _own_numbers(sides: dict[str, dict[int, str]]) -> tuple[Sequence[int], list[str]]:
    """The numbers that the images of a user's own sequence should have, and a fault of its names.

    These are the numbers from the first to the last image; without a fault, the list of faults is empty.

    sides : file names by number, for each side.
    """
    found = sorted(set().union(*sides.values()))
    if not found:
        return range(0), []
    numbers = range(found[0], found[-1] + 1)
    if len(numbers) > MAX_NUMBERS_PER_IMAGE * len(found):  # a list of these numbers may not fit
        return found, ["the names of the images are times, not numbers: convert with from_folder"]
    return numbers, []


def _check_side(
    folder: Path, images: dict[int, str], numbers: Sequence[int], deep: bool
) -> tuple[list[str], list[str]]:
    """What is complete in an image folder, and its problems.

    images : file names by number; numbers : those that are expected; deep : decode every image.
    """
    side = folder.name
    complete = []
    problems = []
    missing = [number for number in numbers if number not in images]
    if not images:
        problems.append(f"{side}: no images")
    elif missing:
        problems.append(f"{side}: {len(missing)} images missing, the first is {missing[0]:06d}")
    surplus = images.keys() - set(numbers)
    if surplus:
        problems.append(f"{side}: {len(surplus)} images have wrong numbers, such as {min(surplus):06d}")
    size = ""
    if deep:
        size, wrong = _check_images(folder, images)
        problems += [f"{side}/{words}" for words in wrong]
    if images and not missing:
        complete.append(f"{side}: {len(numbers)} images{size}")
    return complete, problems


def _check_tables(root: Path, folder: Path, frames: int, has_poses: bool) -> tuple[list[str], list[str]]:
    """What is complete among calibration, times and poses, and their problems.

    frames : expected number of rows; has_poses : whether the poses must be there.
    """
    readers: dict[Path, Callable[[Path], str]] = {
        folder / "calib.txt": _camera,
        folder / "times.txt": lambda path: _rows(len(kitti.read_times(path)), frames),
    }
    found = kitti.find_truth(folder)
    poses = found or root / "poses" / f"{folder.name}.txt"
    if found or has_poses:
        readers[poses] = lambda path: _rows(len(read_kitti_poses(path)), frames)
    complete = []
    problems = []
    for path, read in readers.items():
        label = path.name if path.parent == folder else f"poses/{path.name}"
        try:
            complete.append(f"{label}: {read(path)}")
        except DataError as error:
            problems.append(f"{label}: " + str(error).removeprefix(f"{path}: "))
    return complete, problems


def _by_number(folder: Path) -> dict[int, str]:
    """File names of the images in a folder by image number; empty for a missing folder."""
    return {int(path.stem): path.name for path in sorted(folder.glob("*.png")) if path.stem.isdecimal()}


def _check_images(folder: Path, images: dict[int, str]) -> tuple[str, list[str]]:
    """The most frequent image size as text, and problems of single images."""

    def size_or_damage(name: str) -> tuple[str, str]:
        try:
            height, width = kitti.read_image(folder / name).shape
        except DataError as error:
            return "", str(error).removeprefix(f"{folder / name}: ")
        return f"{width}×{height}", ""

    with ThreadPoolExecutor(max_workers=os.cpu_count() or 1) as pool:
        found = dict(zip(images.values(), pool.map(size_or_damage, images.values()), strict=True))
    sizes = Counter(size for size, _ in found.values() if size)
    usual = max(sizes, key=sizes.__getitem__, default="")
    problems = [
        f"{name}: {damage or f'{size}, the others are {usual}'}"
        for name, (size, damage) in found.items()
        if damage or size != usual
    ]
    return f", {usual}, all decoded" if usual else "", problems


def _camera(path: Path) -> str:
    """The numbers of a calibration as text."""
    camera = kitti.read_calibration(path)
    return f"f {camera.f:.1f} px, baseline {camera.baseline:.3f} m"


def _rows(rows: int, frames: int) -> str:
    """The number of rows as text; `DataError` if they are fewer than the frames."""
    if rows < frames:
        raise DataError(f"{rows} rows for {frames} frames")
    return f"{rows} rows"
