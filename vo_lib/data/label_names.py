"""Class names of a label folder, from the files that detectors and labelling programs write with labels.

| program | label files | names |
|---|---|---|
| this kit | folder | `detector.json` in it |
| labelImg | folder | `classes.txt` in it |
| Label Studio | `labels` | `classes.txt` and `notes.json` beside `labels` |
| CVAT, Darknet | `obj_train_data` | `obj.names` beside `obj_train_data` |
| Roboflow | `train/labels` | `data.yaml` beside `train`; `_darknet.labels` in the folder |
| Ultralytics | `labels/train` | a YAML file with `names:` beside `labels`, whose images have these labels |

A YAML file of another name may describe something else, so it counts only if one of its paths to images leads
to the label folder, as Ultralytics finds labels: `images` in the path becomes `labels`.
"""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ..errors import DataError
from ..files import read_mapping, read_text
from .class_names import ClassNames

DETECTOR_RECORD = "detector.json"  # in a label folder that the kit's detector wrote
LISTS = ("classes.txt", "obj.names", "_darknet.labels")  # a name in each line
DESCRIPTIONS = ("data.yaml", "data.yml", "dataset.yaml", "dataset.yml")
NOTES = "notes.json"
LEVELS = 3  # the label folder, its parent, and the parent of that
SPLITS = ("train", "val", "test")  # keys of a description, with paths to images
IMAGES = "images"  # in a path to images, the last folder of this name;
LABELS = "labels"  # in the path to their labels, this folder is in its place
MAX_NAMES = 10_000
MAX_PATHS = 100  # of images, in a description or in a list that it refers to
MAX_DESCRIPTION_BYTES = 1_000_000  # a larger YAML file of another name is not read
_NUMBERED = re.compile(r"(\d{1,5})\s*[:,\s]\s*(\S.*)")


def read_class_names(folder: Path) -> ClassNames:
    """The classes of a label folder; without a file of names, there are only numbers.

    A folder written by the kit's detector has its names in the record of the detector. Otherwise the nearest
    files of names count: in the folder, beside it, or one level up. A YAML file of an unusual name above the
    folder counts only if it describes these labels.

    Raises `DataError` for a file of names that cannot be read, or if two files in one place disagree.
    """
    record = folder / DETECTOR_RECORD
    if record.exists():
        return _names_of_detector(record)
    label_folder = Path(os.path.abspath(folder))
    places = [label_folder, *label_folder.parents]
    for place in places[:LEVELS]:
        names_by_file: dict[Path, dict[int, str]] = {}
        for path in _files_of_names(place, label_folder):
            names = _read_names(path)
            if names:
                names_by_file[path] = names
        if not names_by_file:
            continue
        first = next(iter(names_by_file))
        for path, names in names_by_file.items():
            if names != names_by_file[first]:
                raise DataError(
                    f"has other class names than {first.name} beside it: correct one, or write the names of "
                    f"these labels into {label_folder / LISTS[0]}",
                    path,
                )
        return ClassNames(names_by_file[first], str(first))
    return ClassNames()


def is_file_of_names(name: str) -> bool:
    """Whether a file of this name, in a label folder, has class names and no labels."""
    return name in (*LISTS, *DESCRIPTIONS, NOTES)


def _files_of_names(place: Path, label_folder: Path) -> list[Path]:
    """The files in a folder, `place`, that may have the names of the classes of a label folder."""
    files = [place / name for name in (*LISTS, *DESCRIPTIONS, NOTES)]
    # The label folder itself is not searched: it may have thousands of files.
    if place != label_folder:
        yaml_files = [*sorted(place.glob("*.yaml")), *sorted(place.glob("*.yml"))]
        files += [path for path in yaml_files if path not in files and _describes(path, label_folder)]
    if place == label_folder.parent:
        files += [path for path in sorted(place.glob("*.names")) if path not in files]
    return [path for path in files if path.is_file()]


def _describes(path: Path, label_folder: Path) -> bool:
    """Whether a path to images in a YAML file leads to the images of a label folder.

    Paths begin in the folder `path:` of the file, or, if the data set was moved since, in the file's own.
    """
    try:
        if not path.is_file() or path.stat().st_size > MAX_DESCRIPTION_BYTES:
            return False
        description = read_yaml(path)
    except (DataError, OSError):
        return False
    roots = [path.parent]
    named_root = description.get("path")
    if isinstance(named_root, str):
        roots.append(path.parent / named_root)
    for images in _image_paths(description):
        for root in roots:
            for labels in _label_folders_of(root / images):
                if label_folder.is_relative_to(labels):
                    return True
    return False


def _image_paths(description: Mapping[str, Any]) -> list[str]:
    """The paths to images in a description: one for each split, or a list for it."""
    values: list[Any] = []
    for split in SPLITS:
        value = description.get(split)
        if isinstance(value, list):
            values += value[:MAX_PATHS]
        else:
            values.append(value)
    return [value for value in values if isinstance(value, str)]


def _label_folders_of(images: Path) -> list[Path]:
    """The folders of the labels of images: of a folder, or of the files that a text file lists."""
    folders = [images]
    if images.suffix == ".txt":
        try:
            lines = read_text(images).split("\n")[:MAX_PATHS]
        except DataError:
            return []
        folders = [(images.parent / line.strip()).parent for line in lines if line.strip()]
    found = []
    for folder in dict.fromkeys(folders):
        parts = list(Path(os.path.abspath(folder)).parts)
        if IMAGES in parts:
            last = max(index for index, part in enumerate(parts) if part == IMAGES)
            parts[last] = LABELS
            found.append(Path(*parts))
    return found


def _read_names(path: Path) -> dict[int, str]:
    """Class names by number in a file; {} if the file has none.

    Raises `DataError` for a damaged file with one of the usual names; another damaged file has no names.
    """
    try:
        if path.suffix in (".yaml", ".yml"):
            return names_in_description(read_yaml(path))
        if path.name == NOTES:
            return _names_in_notes(read_mapping(path, "the categories of Label Studio"))
        return _names_in_list(read_text(path))
    except DataError:
        if is_file_of_names(path.name):
            raise
        return {}


def names_in_description(description: Mapping[str, Any]) -> dict[int, str]:
    """Class names by number in a description of a data set, a list or a mapping under `names`; {} without."""
    names = description.get("names")
    if isinstance(names, list):
        names = dict(enumerate(names))
    if not isinstance(names, dict) or len(names) > MAX_NAMES:
        return {}
    numbered: dict[int, str] = {}
    for key, name in names.items():
        is_number = isinstance(key, int) or (isinstance(key, str) and re.fullmatch(r"[0-9]{1,5}", key))
        if not is_number or not isinstance(name, str | int | float):
            return {}
        numbered[int(key)] = str(name)
    return numbered


def _names_in_list(text: str) -> dict[int, str]:
    """The names in lines of text; a line may begin with its number, as in "0: car"."""
    lines = [line.strip() for line in text.strip().splitlines()]
    names = _without_numbers(lines) or lines
    return dict(enumerate(names[:MAX_NAMES]))


def _without_numbers(lines: list[str]) -> list[str]:
    """The names in lines that all begin with their number, 0, 1, 2 …; [] for other lines."""
    names = []
    for number, line in enumerate(lines):
        numbered = _NUMBERED.fullmatch(line)
        if numbered is None or int(numbered[1]) != number:
            return []
        names.append(numbered[2])
    return names


def _names_in_notes(notes: Mapping[str, Any]) -> dict[int, str]:
    """The names in Label Studio's list of categories, each with `id` and `name`."""
    categories = notes.get("categories")
    if not isinstance(categories, list):
        return {}
    names: dict[int, str] = {}
    for category in categories:
        if not isinstance(category, dict):
            continue
        number = category.get("id")
        name = category.get("name")
        if isinstance(number, int) and name:
            names[number] = str(name)
    return names


def _names_of_detector(path: Path) -> ClassNames:
    """The classes in the record of a detector; without names, they have COCO's numbers."""
    expected = "the record of the detector that wrote the labels"
    record = read_mapping(path, expected)
    written = _whole_numbers(record.get("written"))
    if written is None:
        raise DataError(f"expected {expected}", path)
    return ClassNames(
        names=names_in_description(record),
        source=str(path),
        written=written,
        of_model=_whole_numbers(record.get("numbers")) or (),
    )


def _whole_numbers(values: Any) -> tuple[int, ...] | None:
    """The values of a JSON list of whole numbers; None for anything else."""
    if not isinstance(values, list) or not all(isinstance(value, int) for value in values):
        return None
    return tuple(values)


def read_yaml(path: str | Path) -> dict[str, Any]:
    """The mapping in a YAML file, or {} for other content; `DataError` for a file that is not YAML."""
    import yaml  # the library reads no YAML when a run starts

    try:
        content = yaml.safe_load(read_text(path))
    # PyYAML raises these errors also for invalid dates and for deep nesting.
    except (yaml.YAMLError, ValueError, TypeError, AttributeError, RecursionError) as error:
        mark = getattr(error, "problem_mark", None)
        raise DataError("is not YAML", path, mark and mark.line + 1) from None
    return content if isinstance(content, dict) else {}
