"""Sequences by name: KITTI sequences on this machine, drawn scenes, and folders by path."""

from __future__ import annotations

import os
import re
from collections.abc import Collection
from pathlib import Path

from ..checkout import checkout_folder, with_install_hint
from ..errors import DataError, did_you_mean
from ..geometry.types import Progress
from .drawn import ensure_scene, scene_folder
from .kitti import EXPECTED_FRAMES, has_images
from .scene_files import is_drawn
from .scenes import SCENES
from .sequence import Sequence, open_folder

SYNTHETIC = "synthetic/"
KITTI = "kitti/"
VIDEO_ENDINGS = (".mp4", ".avi", ".mov", ".mkv", ".webm", ".m4v")
DRAWING_PROCESSES = min(os.cpu_count() or 1, 4)
# The kit's own folder, which may have data/kitti; an installed copy looks in the working folder alone.
PROJECT = checkout_folder() or Path()
KITTI_FOLDER = Path("data", "kitti")  # in the working folder and in the kit's folder
# From a folder that a person names to the one with `sequences`: the archives unpack to dataset/sequences, so
# the person may name the folder above `dataset`, the folder `dataset` itself, or a folder in it.
STEPS_TO_ROOT = ("", "dataset", "..")


def kitti_roots() -> list[Path]:
    """Existing KITTI folders, those with a folder `sequences`, without symbolic links.

    KITTI_ROOT comes first, then data/kitti in the working folder and in the kit's folder.
    """
    candidates = [KITTI_FOLDER, PROJECT / KITTI_FOLDER]
    named = os.environ.get("KITTI_ROOT")
    if named:
        candidates.insert(0, Path(named))
    roots: list[Path] = []
    for candidate in candidates:
        for step in STEPS_TO_ROOT:
            root = (candidate / step).resolve()
            if root not in roots and (root / "sequences").is_dir():
                roots.append(root)
    return roots


def kitti_root() -> Path:
    """The first existing KITTI folder, or the path for a new KITTI folder."""
    roots = kitti_roots()
    if roots:
        return roots[0]
    return Path(os.environ.get("KITTI_ROOT") or PROJECT / KITTI_FOLDER)


def kitti_places() -> str:
    """The existing KITTI folders, or the reason why there is none, for messages."""
    roots = kitti_roots()
    if not roots:
        return f"{kitti_root()}, which has no folder `sequences`; set KITTI_ROOT"
    return ", ".join(map(str, roots))


def available() -> dict[str, Path | None]:
    """Folders of sequences by name; None for a scene that is not drawn yet."""
    folders: dict[str, Path | None] = {}
    for name, config in SCENES.items():
        folder = scene_folder(config)
        folders[f"{SYNTHETIC}{name}"] = folder if is_drawn(folder) else None
    for root in kitti_roots():
        for folder in sorted((root / "sequences").iterdir()):
            if has_images(folder):
                folders.setdefault(f"{KITTI}{folder.name}", folder)
    return folders


def parse_sequences(text: str) -> list[str]:
    """Names and paths in a text such as "00,02-10,synthetic/jam,some/folder"; numbers are KITTI sequences.

    Raises `DataError` for a number that KITTI does not have, and for an empty name.
    """
    names: list[str] = []
    for item in text.split(","):
        numbers = re.fullmatch(r"(\d\d)(?:-(\d\d))?", item)
        if numbers is None:
            names.append(item)
            continue
        first = int(numbers[1])
        last = int(numbers[2] or numbers[1])
        if last < first or f"{last:02d}" not in EXPECTED_FRAMES:
            raise DataError(
                f"sequences {item}: expected numbers from 00 to 21, or a range such as 02-10",
                remedy="sequences",
            )
        names += [f"{KITTI}{number:02d}" for number in range(first, last + 1)]
    if not all(names):
        raise DataError(f"sequences {text!r}: expected names separated by commas", remedy="sequences")
    return names


def known_folder(name: str, cache: Path | None = None) -> Path | None:
    """Where the sequence of a name or a path is, without symbolic links, or where a scene will be drawn.

    Two names with one folder are one sequence. None for a name that nothing here has. `cache` : folder of
    drawn scenes; by default the user's cache folder.
    """
    if Path(name).is_dir():
        return Path(name).resolve()
    scene_name = name.removeprefix(SYNTHETIC)
    if name.startswith(SYNTHETIC) and scene_name in SCENES:
        return scene_folder(SCENES[scene_name], cache).resolve()
    folder = available().get(name)
    return None if folder is None else folder.resolve()


def _find_folder(name: str, cache: Path | None, progress: Progress | None) -> Path:
    """The folder of the sequence with this name; a scene that is not in the cache is drawn."""
    if name.startswith(SYNTHETIC):
        return ensure_scene(name.removeprefix(SYNTHETIC), cache, progress, jobs=DRAWING_PROCESSES)
    folders = available()
    folder = folders.get(name)
    if folder is None:
        raise _not_found(name, folders)
    return folder


def _not_found(name: str, known: Collection[str]) -> DataError:
    """The error for a name that is not among the `known` ones, with what the person probably meant."""
    near = did_you_mean(name, known)
    number = re.fullmatch(r"(?:kitti/)?0*(\d+)", name, re.ASCII | re.IGNORECASE)
    if number is not None:
        sequence = number[1].rjust(2, "0")
        if sequence not in EXPECTED_FRAMES:
            return DataError(
                f"there is no sequence {name}: KITTI has the sequences 00 to {max(EXPECTED_FRAMES)}"
            )
        if f"{KITTI}{sequence}" not in known:
            remedy = with_install_hint(f"to download the sequence: vo data get_kitti --sequences {sequence}")
            return DataError(f"{KITTI}{sequence} was not found in {kitti_places()}; {remedy}")
        near = f"did you mean {KITTI}{sequence}? "
    if name.startswith(KITTI):
        return DataError(f"the sequence {name} was not found; {near}looked in {kitti_places()}")
    if Path(name).is_file():
        video = f"for a video with both images side by side: vo data from_folder --video {name} --out DIR …"
        expected = "expected a folder or a name from `vo list`"
        return DataError(f"is a file: {expected}; {with_install_hint(video)}", name)
    if Path(name).suffix.lower() in VIDEO_ENDINGS:
        video = "a video with both images side by side is imported by: vo data from_folder --video FILE …"
        return DataError(f"the file is missing; {with_install_hint(video)}", name)
    return DataError(f"the folder is missing: {near}expected a folder or a name from `vo list`", name)


def open_sequence(
    where: str | Path,
    labels: str | Path | None = None,
    cache: Path | None = None,
    progress: Progress | None = None,
) -> Sequence:
    """A sequence by name ("kitti/07", "synthetic/traffic") or by the path of a folder in KITTI's layout.

    A missing scene is drawn. Raises the errors of `open_folder`, and `DataError` for an unknown name.

    Parameters
    ----------
    labels : folder of YOLO label files; by default `labels` in the sequence's folder, if it exists.
    cache : folder of drawn scenes; by default the user's cache folder.
    progress : called while a scene is drawn.
    """
    folder = Path(where)
    name = str(where)
    if folder.is_dir():
        return open_folder(folder, folder.resolve().name, labels)
    return open_folder(_find_folder(name, cache, progress), name, labels)
