"""KITTI's object labels as a data set in YOLO format.

Car and Van become car, Truck becomes truck, Tram becomes train. Other objects, and boxes with a height under
8 px, have no label and are background for the detector.
"""

from __future__ import annotations

import os
import re
import shutil
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from training.evaluated import DRIVE, WHY, evaluated_sequence
from training.street_set import data_yaml, start_set
from vo_lib.data.kitti import read_image
from vo_lib.data.label_files import write_labels
from vo_lib.errors import DataError
from vo_lib.files import read_text
from vo_lib.geometry.boxes import Boxes
from vo_lib.geometry.types import Progress

NAMES = ("car", "truck", "train")
CLASS_OF = {"Car": 0, "Van": 0, "Truck": 1, "Tram": 2}
MIN_HEIGHT = 8.0  # px
NUMBER = re.compile(r"[0-9]{1,9}")


@dataclass(frozen=True)
class Labelled:
    """An image with its labels and its raw drive ("" for an unknown drive).

    Attributes
    ----------
    boxes : boxes whose class_id is an index into `NAMES`.
    """

    image: Path
    drive: str
    boxes: Boxes

    @property
    def stem(self) -> str:
        """Name of the image in the data set; contains the drive, so that evaluated drives are recognised."""
        folder = self.image.parent.name
        return f"{self.drive or folder}_{self.image.stem}"


def read_object_set(
    root: Path, mapping: Path | None = None, permutation: Path | None = None
) -> list[Labelled]:
    """KITTI's object images: `image_2` with `label_2`.

    Parameters
    ----------
    root : folder of images and labels, KITTI's `training`.
    mapping, permutation : `train_mapping.txt` and `train_rand.txt` of the object development kit, with the
        raw drive of each image.
    """
    drives = _object_drives(mapping, permutation)
    images = []
    for path in _labels(root / "label_2"):
        number = int(path.stem)
        if drives and number >= len(drives):
            raise DataError(f"the mapping has only {len(drives)} images", path)
        drive = drives[number] if drives else ""
        image = root / "image_2" / f"{path.stem}.png"
        if not image.is_file():
            raise DataError("the image is missing", image)
        images.append(Labelled(image, drive, _boxes(path)))
    return images


def _boxes(path: Path) -> Boxes:
    """Boxes of the vehicles in a label file: lines of type, 3 numbers, left, top, right, bottom, …"""
    vehicles: list[tuple[int, list[float]]] = []
    for number, line in enumerate(read_text(path).splitlines(), 1):
        words = line.split()
        if not words:
            continue
        try:
            corners = [float(word) for word in words[4:8]]
        except ValueError:
            corners = []
        if len(corners) != 4 or not np.isfinite(corners).all():
            raise DataError("expected type, 3 numbers, then left, top, right and bottom", path, number)
        left, top, right, bottom = corners
        is_large = bottom - top >= MIN_HEIGHT and right > left
        if words[0] in CLASS_OF and is_large:
            vehicles.append((CLASS_OF[words[0]], corners))
    xyxy = np.array([corners for _, corners in vehicles], np.float64).reshape(-1, 4)
    return Boxes(xyxy, np.array([kind for kind, _ in vehicles], np.int64), np.ones(len(vehicles)))


def _labels(folder: Path) -> list[Path]:
    """The label files of a folder; their names must be numbers."""
    files = sorted(folder.glob("*.txt"))
    if not files:
        raise DataError("expected label files such as 000000.txt", folder)
    for path in files:
        if not NUMBER.fullmatch(path.stem):
            raise DataError("unexpected file: expected names such as 000000.txt", path)
    return files


def _object_drives(mapping: Path | None, permutation: Path | None) -> list[str]:
    """Raw drive of each object image; image i is in row permutation[i] of the mapping, counted from 1."""
    if mapping is None or permutation is None:
        return []
    names = []  # the drive of each row, "" for a row without one
    for row in read_text(mapping).splitlines():
        if row.strip():
            drive = DRIVE.search(" ".join(row.split()))
            names.append("" if drive is None else drive[0])
    if not all(names):
        line = names.index("") + 1
        raise DataError("expected date, drive and frame, as in train_mapping.txt", mapping, line)
    try:
        order = [int(word) for word in read_text(permutation).replace(",", " ").split()]
        if sorted(order) != list(range(1, len(names) + 1)):
            raise ValueError
    except ValueError:
        raise DataError(f"expected the numbers 1 to {len(names)}, each once", permutation) from None
    return [names[k - 1] for k in order]


def check_origin(images: list[Labelled], allow_evaluated: bool) -> list[Labelled]:
    """The images that are allowed for training: images of evaluated drives are removed.

    Raises `DataError` for images of unknown origin. `allow_evaluated` : whether all images are allowed.
    """
    if allow_evaluated:
        return images
    unknown = next((image for image in images if not image.drive), None)
    if unknown is not None:
        raise DataError(
            f"its raw drive is unknown, so it may belong to an odometry sequence: {WHY}; "
            "give the drives, or allow it with --allow-evaluated",
            unknown.image,
        )
    return [image for image in images if evaluated_sequence(image.drive) is None]


def split(images: list[Labelled], share: float, seed: int) -> dict[str, list[Labelled]]:
    """Training and validation images. All images of one raw drive are in the same part."""
    units = sorted({image.drive or image.stem for image in images})
    order = np.random.default_rng([seed, 30]).permutation(len(units))
    # At least one drive is for each part.
    valid_count = min(max(1, round(share * len(units))), len(units) - 1)
    valid = {units[k] for k in order[:valid_count]}
    parts: dict[str, list[Labelled]] = {"train": [], "valid": []}
    for image in images:
        name = "valid" if (image.drive or image.stem) in valid else "train"
        parts[name].append(image)
    return parts


def write_set(parts: dict[str, list[Labelled]], folder: Path, progress: Progress | None = None) -> None:
    """Write a data set. Images are hard links if possible, otherwise copies."""
    total = sum(len(part) for part in parts.values())
    done = 0
    start_set(folder, parts, data_yaml(NAMES, test=False))
    for name, part in parts.items():
        for labelled in part:
            height, width = read_image(labelled.image).shape[:2]
            _link(labelled.image, folder / name / "images" / f"{labelled.stem}{labelled.image.suffix}")
            label = folder / name / "labels" / f"{labelled.stem}.txt"
            write_labels(label, labelled.boxes, width, height, scores=False)
            done += 1
            if progress:
                progress(done, total)


def _link(source: Path, target: Path) -> None:
    """Make a hard link to an image, or a copy where the file system has none."""
    target.unlink(missing_ok=True)
    try:
        os.link(source, target)
    except OSError:
        shutil.copyfile(source, target)
