"""Sequences by name: KITTI sequences on this machine, drawn scenes, and folders by path."""

from __future__ import annotations

import os
import re
from pathlib import Path

from ..checkout import checkout_folder
from ..errors import DataError, did_you_mean
from ..geometry.types import Progress
from .drawn import ensure_scene, scene_folder
from .kitti import EXPECTED_FRAMES, has_images
from .scene_files import is_drawn
from .scenes import SCENES
from .sequence import Sequence, open_folder

SYNTHETIC = "synthetic/"
KITTI = "kitti/"
DRAWING_PROCESSES = min(os.cpu_count() or 1, 4)
# In the working folder and in the kit's own folder; an installed copy looks in the working folder alone.
KITTI_FOLDERS = (Path("data", "kitti"), (checkout_folder() or Path()) / "data" / "kitti")


def kitti_roots() -> list[Path]:
    """KITTI folders, those with a folder `sequences`, without symbolic links.

    If the environment variable KITTI_ROOT is set, it names the only one. Else they are those of
    `KITTI_FOLDERS` that exist. Raises `DataError` if KITTI_ROOT names no KITTI folder: another data set in
    its place would give other numbers without a word.
    """
    named = os.environ.get("KITTI_ROOT")
    places = [Path(named)] if named else KITTI_FOLDERS
    roots = list(dict.fromkeys(root for root in map(_root_at, places) if root))
    if named and not roots:
        raise DataError(f"KITTI_ROOT is {named}, without a folder `sequences`: correct or unset the variable")
    return roots


def _root_at(place: Path) -> Path | None:
    """The KITTI folder that a person names, if there is one: `place`, or `dataset` in it, as in the archives.

    The person may also name the folder `sequences` itself.
    """
    for sequences in (place / "sequences", place / "dataset" / "sequences", place):
        if sequences.name == "sequences" and sequences.is_dir():
            return sequences.parent.resolve()
    return None


def kitti_root() -> Path:
    """The first KITTI folder or, if there is none, the path for a new one, which KITTI_ROOT may name."""
    named = os.environ.get("KITTI_ROOT")
    if named:
        return _root_at(Path(named)) or Path(named)
    return next(iter(kitti_roots()), KITTI_FOLDERS[-1])


def scene_folders(cache: Path | None = None) -> dict[str, Path]:
    """Folders of the scenes by name, which may not be drawn yet; `cache` as in `known_folder`."""
    return {f"{SYNTHETIC}{name}": scene_folder(config, cache) for name, config in SCENES.items()}


def _kitti_folders() -> dict[str, Path]:
    """Folders of KITTI's sequences by name; raises as `kitti_roots`."""
    folders: dict[str, Path] = {}
    for root in kitti_roots():
        for folder in sorted((root / "sequences").iterdir()):
            if has_images(folder):
                folders.setdefault(f"{KITTI}{folder.name}", folder)
    return folders


def available() -> dict[str, Path | None]:
    """Folders of sequences by name; None for a scene that is not drawn yet. Raises as `kitti_roots`."""
    scenes = {name: folder if is_drawn(folder) else None for name, folder in scene_folders().items()}
    return scenes | _kitti_folders()


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
        chosen = range(int(numbers[1]), int(numbers[2] or numbers[1]) + 1)
        if not chosen or f"{chosen[-1]:02d}" not in EXPECTED_FRAMES:
            raise DataError(f"--sequences {item}: expected numbers from 00 to 21, or a range such as 02-10")
        names += [f"{KITTI}{number:02d}" for number in chosen]
    if not all(names):
        raise DataError(f"--sequences {text!r}: expected names separated by commas")
    return names


def known_folder(name: str, cache: Path | None = None) -> Path | None:
    """Where the sequence of a name or a path is, or where a scene will be drawn; None for an unknown name.

    `cache` : as in `drawn.cache_folder`. Raises as `kitti_roots` if the name is one of KITTI.
    """
    if name.startswith(KITTI):
        return _kitti_folders().get(name)
    return scene_folders(cache).get(name, Path(name) if Path(name).is_dir() else None)


def _not_found(name: str) -> DataError:
    """The error for an unknown name, with what the person probably meant."""
    known = {*scene_folders(), *(f"{KITTI}{number}" for number in EXPECTED_FRAMES)} - {name}
    near = did_you_mean(re.sub(r"\b(\d)$", r"0\1", name), known)
    if name.startswith(KITTI):
        return DataError(f"{name} is not in {kitti_root()}: {near}`vo data get_kitti` downloads 00 to 21")
    fault = "is a file" if Path(name).is_file() else "the folder is missing"
    other = "`vo data from_folder` imports images and videos"
    return DataError(f"{fault}: {near}expected a folder or a name from `vo list`; {other}", name)


def open_sequence(
    where: str | Path,
    labels: str | Path | None = None,
    cache: Path | None = None,
    progress: Progress | None = None,
) -> Sequence:
    """A sequence by name ("kitti/07", "synthetic/traffic") or by the path of a folder in KITTI's layout.

    A missing scene is drawn. Raises the errors of `open_folder`, `DataError` for an unknown name, and as
    `kitti_roots` for a name of KITTI.

    Parameters
    ----------
    labels : folder of YOLO label files; by default `labels` in the sequence's folder, if it exists.
    cache : folder with the kit's cache folder; by default the user's.
    progress : called while a scene is drawn.
    """
    name = str(where)
    folder = known_folder(name, cache)
    if folder is None:
        raise _not_found(name)
    if name in scene_folders():
        folder = ensure_scene(name.removeprefix(SYNTHETIC), cache, progress, jobs=DRAWING_PROCESSES)
    elif not name.startswith(KITTI):
        name = folder.resolve().name
    return open_folder(folder, name, labels)
