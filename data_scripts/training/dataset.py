"""Data sets in YOLO form: `data.yaml`, and for each split a folder of images and one of label files."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from vo_lib.commands.script import install
from vo_lib.core.boxes import Boxes, no_boxes
from vo_lib.core.errors import DataError
from vo_lib.core.files import fits, read_bytes, read_text
from vo_lib.core.types import Image
from vo_lib.data.kitti import decode_image
from vo_lib.data.labels import read_labels

IMAGE_ENDINGS = (".jpg", ".jpeg", ".png", ".bmp")
SPLITS = {"train": "train", "valid": "val", "test": "test"}  # our name and the key in data.yaml


@dataclass(frozen=True)
class Example:
    """One image with its boxes, pixels (pixel centres at integers).

    Attributes
    ----------
    image : (H, W) uint8, grey.
    boxes : class_id is the place in the data set's names.
    ignored : boxes that are neither objects nor background.
    """

    image: Image
    boxes: Boxes
    ignored: Boxes


@dataclass(frozen=True)
class DetectionSet:
    """A data set in YOLO form.

    Attributes
    ----------
    names : of the classes that the labels number.
    images : image files of each split.
    merged : name of the one class that all are taken for, or None.
    """

    names: tuple[str, ...]
    images: dict[str, tuple[Path, ...]]
    merged: str | None = None

    @property
    def classes(self) -> tuple[str, ...]:
        """Names of the classes a network learns."""
        return self.names if self.merged is None else (self.merged,)

    def read(self, path: Path) -> Example:
        """An image, grey as the odometry's are, with its labels; an image without label file has none."""
        image = decode_image(read_bytes(path), path)
        height, width = image.shape
        labels, ignored = beside(path, "labels"), beside(path, "ignored")
        boxes = read_labels(labels, width, height) if labels.exists() else no_boxes()
        if len(boxes) and boxes.class_id.max() >= len(self.names):
            raise DataError(
                f"class {boxes.class_id.max()}: data.yaml names the classes 0 to {len(self.names) - 1}",
                labels,
            )
        other = read_labels(ignored, width, height) if ignored.exists() else no_boxes()
        if self.merged is not None:
            boxes = dataclasses.replace(boxes, class_id=np.zeros(len(boxes), np.int64))
        return Example(image, boxes, other)


def beside(image: Path, kind: str) -> Path:
    """The file of another kind that belongs to an image: …/images/a.jpg to …/labels/a.txt."""
    return image.parent.parent / kind / f"{image.stem}.txt"


def open_set(where: Path, splits: Sequence[str] = ("train", "valid")) -> DetectionSet:
    """The data set of a folder, or of its `data.yaml`: drawn by us, converted, or a Roboflow YOLO export.

    Raises `DataError` where the file is not understood or one of the `splits` asked for has no images.
    """
    path = where / "data.yaml" if where.is_dir() else where
    about = _read_yaml(path)
    names = about.get("names")
    if isinstance(names, dict):
        names = [names.get(k) for k in range(len(names))]
    if not names or not fits(names, [str]):
        raise DataError("expected `names:` with a list of class names", path)
    found = {}
    for split, key in SPLITS.items():
        images = _images(path, about.get(key))
        if split in splits and not images:
            raise DataError(f"expected `{key}:` with a folder of images; found {about.get(key)!r}", path)
        found[split] = images
    return DetectionSet(tuple(names), found)


def _read_yaml(path: Path) -> dict[str, Any]:
    try:
        import yaml
    except ImportError:
        raise DataError("PyYAML is missing: " + install("train")) from None
    text = read_text(path)
    try:
        about = yaml.safe_load(text)
    except (yaml.YAMLError, ValueError, TypeError, AttributeError, RecursionError) as error:  # of dates too
        mark = getattr(error, "problem_mark", None)
        raise DataError("is not YAML", path, None if mark is None else mark.line + 1) from None
    if not fits(about, {}):
        raise DataError("expected the keys train, val and names", path)
    return about


def _images(path: Path, entry: Any) -> tuple[Path, ...]:
    """Image files of a split. Roboflow's entries begin with ../ though the folders are beside the file."""
    if not isinstance(entry, str):
        return ()
    places = [path.parent / entry, path.parent / entry.removeprefix("../")]
    folder = next((place for place in places if os.path.isdir(place)), None)  # of any length
    if folder is None:
        return ()
    return tuple(sorted(file for file in folder.iterdir() if file.suffix.lower() in IMAGE_ENDINGS))
