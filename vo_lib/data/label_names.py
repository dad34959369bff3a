"""Class names of a label folder, from the files that detectors and labelling programs write with labels.

| program | label files | names |
|---|---|---|
| this kit | folder | `detector.json` in it |
| labelImg | folder | `classes.txt` in it |
| Label Studio | `labels` | `classes.txt` and `notes.json` beside `labels` |
| CVAT, Darknet | `obj_train_data` | `obj.names` beside `obj_train_data` |
| Roboflow | `train/labels` | `data.yaml` beside `train`; `_darknet.labels` in the folder |
| Ultralytics | `labels/train` | a YAML file with `names:` beside `labels` |
"""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ..errors import DataError
from ..files import read_mapping, read_text, read_yaml
from .class_names import ClassNames

DETECTOR_RECORD = "detector.json"  # in a label folder that the kit's detector wrote
LISTS = ("classes.txt", "obj.names", "_darknet.labels")  # a name in each line
DESCRIPTIONS = ("data.yaml", "data.yml", "dataset.yaml", "dataset.yml")
NOTES = "notes.json"
LEVELS = 3  # the label folder, the folder beside it, and one level up
MAX_NAMES = 10_000
MAX_DESCRIPTION_BYTES = 1_000_000  # a larger YAML file of another name is not read
_NUMBERED = re.compile(r"(\d{1,5})\s*[:,\s]\s*(\S.*)")


def class_names(folder: Path) -> ClassNames:
    """The classes of a label folder; without a file of names, there are only numbers.

    A folder written by the kit's detector has its names in the record of the detector. Otherwise the nearest
    files of names count: in the folder, beside it, or one level up.

    Raises `DataError` for a file of names that cannot be read, or if two files in one place disagree.
    """
    record = folder / DETECTOR_RECORD
    if record.exists():
        return _names_of_detector(record)
    start = Path(os.path.abspath(folder))
    for place in [start, *start.parents][:LEVELS]:
        found = [(path, names) for path in _files_of_names(place, start) if (names := _read_names(path))]
        if not found:
            continue
        (first, names), *others = found
        for path, other_names in others:
            if other_names != names:
                raise DataError(f"has other class names than {first.name} beside it: correct one", path)
        return ClassNames(names, str(first))
    return ClassNames()


def is_file_of_names(name: str) -> bool:
    """Whether a file of this name, in a label folder, has class names and no labels."""
    return name in (*LISTS, *DESCRIPTIONS, NOTES)


def _files_of_names(place: Path, label_folder: Path) -> list[Path]:
    """The files in a folder that may have the names of the classes."""
    files = [place / name for name in (*LISTS, *DESCRIPTIONS, NOTES)]
    if place != label_folder:  # which may have thousands of files
        for pattern in ("*.names", "*.yaml", "*.yml"):
            files += sorted(path for path in place.glob(pattern) if path not in files)
    return [path for path in files if path.is_file()]


def _read_names(path: Path) -> dict[int, str]:
    """Class names by number in a file; {} if the file has none.

    Raises `DataError` for a damaged file with one of the usual names; another damaged file has no names.
    """
    try:
        if path.suffix in (".yaml", ".yml"):
            if path.name not in DESCRIPTIONS and path.stat().st_size > MAX_DESCRIPTION_BYTES:
                return {}
            return names_in_description(read_yaml(path))
        if path.name == NOTES:
            return _names_in_notes(read_mapping(path, "the categories of Label Studio"))
        return _names_in_list(read_text(path))
    except DataError:
        if is_file_of_names(path.name):
            raise
        return {}


def names_in_description(about: Mapping[str, Any]) -> dict[int, str]:
    """Class names by number in a description of a data set, a list or a mapping under `names`; {} without."""
    names = about.get("names")
    if isinstance(names, list):
        names = dict(enumerate(names))
    if not isinstance(names, dict) or len(names) > MAX_NAMES:
        return {}
    numbered: dict[int, str] = {}
    for key, name in names.items():
        valid_key = isinstance(key, int) or (isinstance(key, str) and re.fullmatch(r"[0-9]{1,5}", key))
        if not valid_key or not isinstance(name, str | int | float):
            return {}
        numbered[int(key)] = str(name)
    return numbered


def _names_in_list(text: str) -> dict[int, str]:
    """The names in lines of text; a line may begin with its number, as in "0: car"."""
    lines = [line.strip() for line in text.strip().splitlines()]
    numbered = [_NUMBERED.fullmatch(line) for line in lines]
    if all(line is not None and int(line[1]) == k for k, line in enumerate(numbered)):
        lines = [line[2] for line in numbered if line is not None]
    return dict(enumerate(lines[:MAX_NAMES]))


def _names_in_notes(notes: Mapping[str, Any]) -> dict[int, str]:
    """The names in Label Studio's list of categories, each with `id` and `name`."""
    categories = notes.get("categories")
    if not isinstance(categories, list):
        return {}
    names = {each.get("id"): each.get("name") for each in categories if isinstance(each, dict)}
    return {number: str(name) for number, name in names.items() if isinstance(number, int) and name}


def _names_of_detector(path: Path) -> ClassNames:
    """The classes in the record of a detector; a record of earlier versions has COCO's numbers only."""
    record = read_mapping(path, "the record of the detector that wrote the labels")
    names = names_in_description(record)
    written = _whole_numbers(record.get("written"))
    return ClassNames(names, str(path), written, _whole_numbers(record.get("numbers")) or ())


def _whole_numbers(values: Any) -> tuple[int, ...] | None:
    """The values of a JSON list of whole numbers; None for anything else."""
    if not isinstance(values, list) or not all(isinstance(value, int) for value in values):
        return None
    return tuple(values)
