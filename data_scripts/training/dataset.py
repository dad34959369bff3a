"""Data sets in YOLO format: `data.yaml`, and a folder of images and a folder of label files per split."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from vo_lib.errors import DataError
from vo_lib.files import read_yaml

IMAGE_ENDINGS = (".jpg", ".jpeg", ".png", ".bmp")
SPLITS = {"train": "train", "valid": "val", "test": "test"}  # our name and the key in data.yaml


@dataclass(frozen=True)
class DetectionSet:
    """A data set in YOLO format.

    Attributes
    ----------
    names : class names, in the order of the class numbers in the labels.
    images : image files of each split.
    """

    names: tuple[str, ...]
    images: dict[str, tuple[Path, ...]]


def open_set(where: Path) -> DetectionSet:
    """The data set of a folder or of its `data.yaml`: drawn streets, converted labels, or a Roboflow export.

    Raises `DataError` for an invalid file, or if the images for training or validation are missing.
    """
    path = where / "data.yaml" if where.is_dir() else where
    about = read_yaml(path)
    names = about.get("names")
    if isinstance(names, dict):
        names = [names.get(k) for k in range(len(names))]
    if not isinstance(names, list) or not names or not all(isinstance(name, str) for name in names):
        raise DataError("expected `names:` with a list of class names", path)
    images_of = {}
    for split, key in SPLITS.items():
        images = _images(path, about.get(key))
        if split != "test" and not images:
            raise DataError(f"expected `{key}:` with a folder of images; found {about.get(key)!r}", path)
        images_of[split] = images
    return DetectionSet(tuple(names), images_of)


def _images(path: Path, entry: Any) -> tuple[Path, ...]:
    """Image files of a split. Roboflow's paths begin with ../, but the folders are next to data.yaml."""
    if not isinstance(entry, str):
        return ()
    for folder in (path.parent / entry, path.parent / entry.removeprefix("../")):
        if os.path.isdir(folder):  # false also for a name that is too long
            return tuple(sorted(file for file in folder.iterdir() if file.suffix.lower() in IMAGE_ENDINGS))
    return ()
