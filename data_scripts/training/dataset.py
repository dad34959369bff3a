"""Data sets in YOLO format: `data.yaml`, images in folders or lists, and a label file beside each image.

The paths in data.yaml are read as Ultralytics reads them, where that is clear; where a path has two meanings,
the data set is refused. Neither commands nor addresses under `download:` are used.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import platformdirs

from vo_lib.data.label_names import names_in_description, read_yaml
from vo_lib.errors import DataError
from vo_lib.files import read_text

IMAGE_ENDINGS = (".jpg", ".jpeg", ".png", ".bmp", ".tif", ".tiff", ".webp")
SPLITS = {"train": "train", "valid": "val", "test": "test"}  # our name and the key in data.yaml
OTHER_KEYS = {"val": "validation"}  # which Ultralytics accepts too
LIST_ENDING = ".txt"
MAX_CLASSES = 10_000  # that `nc:` may name
UP = "../"  # with which Roboflow's paths begin, although the folders are next to data.yaml


@dataclass(frozen=True)
class DetectionSet:
    """A data set in YOLO format.

    Attributes
    ----------
    names : class names, in the order of the class numbers in the labels.
    images : image files of each split, absolute paths.
    file : data.yaml.
    """

    names: tuple[str, ...]
    images: dict[str, tuple[Path, ...]]
    file: Path

    def outside(self) -> list[Path]:
        """Folders with images that are not below the folder of data.yaml."""
        own = self.file.absolute().parent
        folders: dict[Path, None] = {}  # each once, in order
        for part in self.images.values():
            folders |= dict.fromkeys(path.parent for path in part)
        return [folder for folder in folders if not folder.is_relative_to(own)]


def open_set(where: Path) -> DetectionSet:
    """The data set of a folder or of its `data.yaml`: drawn streets, converted labels, or somebody's own.

    Raises `DataError` for an invalid file, for a path with two meanings, or if the images for training or
    validation are missing.
    """
    path = where / "data.yaml" if where.is_dir() else where
    about = read_yaml(path)
    names = _class_names(path, about)
    entries = {split: _entries(path, about, key) for split, key in SPLITS.items()}
    root = _root(path, about, [entry for part in entries.values() for entry in part])
    images: dict[str, tuple[Path, ...]] = {}
    for split, key in SPLITS.items():
        found = [image for entry in entries[split] for image in _images(path, root, key, entry)]
        images[split] = tuple(dict.fromkeys(sorted(found)))
        if split != "test" and not images[split]:
            more = "; the kit does not run what is under `download:`" if "download" in about else ""
            expected = f"expected `{key}:` with a folder of images"
            raise DataError(f"{expected}; found {_shown(about.get(key))} in {root}{more}", path)
    return DetectionSet(names, images, path)


def _class_names(path: Path, about: dict[str, Any]) -> tuple[str, ...]:
    """The class names: `names:`, or, with `nc:` alone, class_0, class_1, …"""
    names = names_in_description(about)
    count = about.get("nc")
    if about.get("names") is None and type(count) is int and 0 < count <= MAX_CLASSES:
        return tuple(f"class_{number}" for number in range(count))
    if not names or sorted(names) != list(range(len(names))):
        raise DataError("expected `names:` with a list of class names, or `nc:`", path)
    if count is not None and count != len(names):
        raise DataError(f"nc: {_shown(count)}, but there are {len(names)} names", path)
    return tuple(names[number] for number in range(len(names)))


def _entries(path: Path, about: dict[str, Any], key: str) -> list[str]:
    """The paths of a split: one text, a list of texts, or nothing."""
    entry = about.get(key)
    if entry is None:
        entry = about.get(OTHER_KEYS.get(key, key))
    if entry is None:
        return []
    entries = entry if isinstance(entry, list) else [entry]
    for each in entries:
        if not isinstance(each, str) or not each.strip() or "\0" in each:
            raise DataError(f"expected `{key}:` with a folder of images; found {_shown(each)}", path)
    return entries


def _root(path: Path, about: dict[str, Any], entries: list[str]) -> Path:
    """The folder to which the paths of the splits are relative: `path:`, else the folder of data.yaml.

    A relative `path:` is in the working folder, in the folder of data.yaml, or in Ultralytics' folder of data
    sets, whichever has the images.
    """
    own = Path(os.path.abspath(path)).parent
    value = about.get("path")
    if value is None or value == "":
        return own
    if not isinstance(value, str) or "\0" in value:
        raise DataError(f"path: expected a folder, found {_shown(value)}", path)
    folder = Path(value).expanduser()
    if folder.is_absolute():
        candidates = [folder]
    else:
        candidates = [place / folder for place in (Path.cwd(), own, *_ultralytics_folder())]
    relative = [*entries, *(entry.removeprefix(UP) for entry in entries)]
    usable = [each for each in candidates if any(_exists(each / entry) for entry in relative)]
    different = {os.path.realpath(each): each for each in usable}
    if len(different) > 1:
        raise DataError(f"path: {value[:60]} may be {_either(different.values())}: write the full path", path)
    if not usable:
        places = ", ".join(str(each) for each in candidates)
        raise DataError(f"path: none of the images is in {places}"[:400], path)
    return Path(os.path.abspath(usable[0]))


def _ultralytics_folder() -> list[Path]:
    """Ultralytics' folder of data sets, from its settings, if it has been used on this machine."""
    place = os.environ.get("YOLO_CONFIG_DIR")
    settings = Path(place) if place else platformdirs.user_config_path("Ultralytics", appauthor=False)
    try:
        folder = json.loads((settings / "settings.json").read_text(encoding="utf-8"))["datasets_dir"]
        return [Path(folder)]
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return []


def _images(path: Path, root: Path, key: str, entry: str) -> list[Path]:
    """The images of a path in data.yaml: a folder with sub-folders, or a list of images in a text file.

    A missing path is an error for training and validation; many data sets name a test split that they lack.
    """
    places = [root / entry]
    if entry.startswith(UP):
        places.append(root / entry.removeprefix(UP))
    existing = {os.path.realpath(place): place for place in places if _exists(place)}
    if len(existing) > 1:
        raise DataError(f"{key}: {entry[:60]} may be {_either(existing.values())}: write the full path", path)
    for place in existing.values():
        absolute = Path(os.path.abspath(place))
        if os.path.isdir(absolute):
            return _with_labels(absolute)
        if absolute.suffix == LIST_ENDING:
            return list(_images_in_list(absolute))
    if key != SPLITS["test"]:
        raise DataError(f"expected `{key}:` with a folder of images; found {_shown(entry)} in {root}", path)
    return []


def _with_labels(folder: Path) -> list[Path]:
    """The images in a folder and its sub-folders, by the path beside which the label files are.

    Behind a link, the labels may be beside the link or beside the folder to which it leads.
    """
    images = sorted(_walk(folder))
    resolved = folder.resolve()
    if resolved == folder or any(label_of(image).is_file() for image in images):
        return images
    behind = sorted(_walk(resolved))
    return behind if any(label_of(image).is_file() for image in behind) else images


def label_of(image: Path) -> Path:
    """The label file of an image: in the last folder `images` of its path, `labels` takes its place."""
    parts = list(image.parts)
    folders = [k for k, part in enumerate(parts[:-1]) if part == "images"]
    if folders:
        parts[folders[-1]] = "labels"
    return Path(*parts).with_suffix(".txt")


def _walk(folder: Path) -> Iterator[Path]:
    """The images in a folder and its sub-folders, also behind links, without hidden files."""
    seen = set[str]()
    for place, folders, files in os.walk(folder, followlinks=True):
        real = os.path.realpath(place)
        if real in seen:  # a link that leads back
            folders.clear()
            continue
        seen.add(real)
        folders[:] = sorted(name for name in folders if not name.startswith("."))
        for name in files:
            if Path(name).suffix.lower() in IMAGE_ENDINGS and not name.startswith("."):
                yield Path(place, name)


def _images_in_list(file: Path) -> Iterator[Path]:
    """The images in a text file, one in each line.

    A path that begins with ./ is relative to the file's folder; another relative path to the working folder
    or else to the file's folder.
    """
    for number, line in enumerate(read_text(file).splitlines(), start=1):
        entry = line.strip()
        if not entry:
            continue
        places = [file.parent / entry]
        if not entry.startswith("./"):
            places.insert(0, Path.cwd() / entry)
        existing = {os.path.realpath(place): place for place in places if _exists(place)}
        if len(existing) > 1:
            raise DataError(f"may be {_either(existing.values())}: write the full path", file, number)
        if not existing:
            raise DataError(f"the image is missing: {entry[:80]}", file, number)
        image = Path(os.path.abspath(next(iter(existing.values()))))
        if image.suffix.lower() not in IMAGE_ENDINGS:
            raise DataError(f"expected an image, found {entry[:80]}", file, number)
        yield image


def _exists(path: Path) -> bool:
    """Whether there is a file or folder."""
    return os.path.exists(path)  # false also for a name that is too long


def _either(places: Iterable[Path]) -> str:
    """The first two of several places as text."""
    return " or ".join(str(place) for place in list(places)[:2])


def _shown(value: Any) -> str:
    """The beginning of a value as text, for messages."""
    return repr(value)[:80]
