"""Real KITTI images for the tests: the frames that a test asks for, from wherever this machine has them.

`vo data get_kitti --raw 2011_09_26_drive_0013 --frames 0:80` (45 MB) is enough for most of these tests.
"""

from __future__ import annotations

import os
import shutil
from contextlib import suppress
from pathlib import Path

import pytest

from vo_lib.data.catalogue import kitti_roots, open_sequence
from vo_lib.data.sequence import Sequence, open_folder
from vo_lib.errors import DataError

SHARED = Path(__file__).resolve().parents[2] / "shared" / "data"
# KITTI_ROOT, then data/kitti, then a folder beside the checkout. Tests do not see the first two, so they are
# read here.
ROOTS = [SHARED / "kitti_clips"]
with suppress(DataError):  # a wrong KITTI_ROOT, which only the tests on real images need
    ROOTS = [*kitti_roots(), *ROOTS]
DRIVE_0013 = ("drive_0013", 0, 80)
KITTI_00 = ("00", 0, 201)
COMMANDS = {
    "00": "vo data get_kitti --sequences 00 --frames 0:201",
    "01": "vo data get_kitti --sequences 01 --frames 0:51",
    "drive_0013": "vo data get_kitti --raw 2011_09_26_drive_0013 --frames 0:80",
}


class RealImages:
    """Parts of KITTI sequences, each as a KITTI folder of its own with links to the images."""

    def __init__(self, folder: Path):
        self._folder = folder

    def root(self, name: str, start: int, stop: int) -> Path:
        """A KITTI folder with the frames start … stop - 1 of a sequence alone; skips the test without them.

        However long the sequence on this machine is, the test gets the same frames, times and truth.
        """
        root = self._folder / f"{name}_{start}_{stop}"
        if not root.exists():
            draft = root.with_name(f"{root.name}.draft")
            shutil.rmtree(draft, ignore_errors=True)
            _write_part(_find(name, start, stop), draft / "sequences" / name)
            draft.rename(root)
        return root

    def sequence(self, name: str, start: int, stop: int) -> Sequence:
        """The frames start … stop - 1 of a sequence; skips the test where they are missing."""
        return open_sequence(self.root(name, start, stop) / "sequences" / name)

    def any_part(self) -> tuple[str, Path]:
        """Name and KITTI folder of a part that this machine has: 201 frames of 00, or 80 of drive_0013."""
        part = KITTI_00 if _search(*KITTI_00) is not None else DRIVE_0013
        return f"kitti/{part[0]}", self.root(*part)


def labelled_drive_0005() -> Sequence:
    """Frames 100 … 153 of a raw drive, with boxes of KITTI's tracking benchmark; no command fetches them."""
    folder = SHARED / "kitti_clips" / "sequences" / "drive_0005"
    if not folder.is_dir():
        pytest.skip("the labelled frames of drive_0005 are not beside this checkout")
    return open_folder(folder, "kitti/drive_0005")


def _find(name: str, start: int, stop: int) -> Sequence:
    found = _search(name, start, stop)
    if found is None:
        remedy = COMMANDS.get(name, "no command fetches them")
        pytest.skip(f"needs the frames {start}:{stop} of {name}, with their true poses: {remedy}")
    return found


def _search(name: str, start: int, stop: int) -> Sequence | None:
    """The frames of the first folder that has all of them and their true poses, or None."""
    wanted = tuple(f"{number:06d}" for number in range(start, stop))
    for root in ROOTS:
        folder = root / "sequences" / name
        if not folder.is_dir():
            continue
        try:
            sequence = open_folder(folder, f"kitti/{name}")
        except DataError:  # a broken sequence on this machine is no reason for a test to fail
            continue
        if sequence.truth is not None and set(wanted) <= set(sequence.frames):
            first = sequence.frames.index(wanted[0])
            return sequence.part(first, first + len(wanted))
    return None


def _write_part(sequence: Sequence, folder: Path) -> None:
    """Write a sequence's calibration, times and truth, and link its images."""
    for side in ("image_0", "image_1"):
        (folder / side).mkdir(parents=True)
        for frame in sequence.frames:
            _link(sequence.folder.resolve() / side / f"{frame}.png", folder / side / f"{frame}.png")
    shutil.copy(sequence.folder / "calib.txt", folder / "calib.txt")
    times = "".join(f"{time!r}\n" for time in sequence.times.tolist())
    (folder / "times.txt").write_text(times, encoding="utf-8")
    if sequence.truth is not None:
        rows = [" ".join(map(repr, pose[:3].ravel().tolist())) for pose in sequence.truth]
        (folder / "poses.txt").write_text("\n".join(rows) + "\n", encoding="utf-8")


def _link(source: Path, link: Path) -> None:
    """Make a link to a file, or a copy where links are not allowed, as on many Windows machines."""
    try:
        os.symlink(source, link)
    except OSError:
        shutil.copy(source, link)
