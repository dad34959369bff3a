"""Label folders from a detector: a YOLO text file per frame, and a record of the detector.

A label folder contains `000000.txt` … and `detector.json`, with the model's SHA-256 and the settings.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

from ..data.drawn import cache_folder
from ..data.kitti import list_frames, read_image
from ..data.label_files import write_labels
from ..data.sequence import Sequence
from ..errors import DataError
from ..files import only_process, read_mapping, write_atomic
from ..geometry.boxes import Boxes
from ..geometry.types import BoolArray, Progress
from ..settings import to_dict
from .class_names import COCO, choose_classes, class_numbers
from .model_files import model_sha256
from .models import find_model
from .settings import DetectorConfig
from .yolo import YoloDetector

RECORD = "detector.json"
EXPECTED_RECORD = "the record of the detector that wrote the labels"
# A label folder has none of these: each is part of a sequence or of a run.
FILES_OF_OTHER_FOLDERS = (
    *("image_0", "image_1", "image_2", "image_3", "calib.txt", "times.txt"),
    *("poses.txt", "poses_tum.txt", "frames.csv", "metrics.json"),
)
# Threads, one image each: the network works on one image while another is read or its boxes are selected.
DETECTION_THREADS = 2


def detection_record(model: str | Path, config: DetectorConfig, provider: str = "cpu") -> dict[str, Any]:
    """All inputs that determine a detector's boxes, for JSON: the model and its hash, settings, provider."""
    path = find_model(model)
    settings = to_dict(config)
    del settings["threads"]
    settings["classes"] = list(config.classes)
    return {"model": path.name, "sha256": model_sha256(path), "provider": provider, "settings": settings}


def label_folder(sequence: Sequence, record: dict[str, Any], cache: Path | None = None) -> Path:
    """The folder for the boxes of a detector on a sequence, in `cache` or the user's cache folder."""
    root = cache_folder().parent if cache is None else cache
    text = json.dumps([record, str(sequence.folder.resolve())], sort_keys=True)
    digest = hashlib.sha256(text.encode()).hexdigest()[:12]
    return root / "labels" / f"{sequence.folder.resolve().name}-{Path(record['model']).stem}-{digest}"


def write_label_folder(
    sequence: Sequence,
    model: str | Path,
    config: DetectorConfig,
    folder: Path,
    *,
    provider: str = "cpu",
    replace: bool = False,
    waiting: Callable[[Path], None] | None = None,
    progress: Progress | None = None,
) -> int:
    """Write the missing labels of a folder and return their number; a second call continues the first.

    A label older than its image counts as missing. `replace` deletes the frames' labels of another detector,
    and no other file. `waiting` is called if another process writes labels into the folder (see
    `only_process`).

    Raises `DataError` if the folder belongs to a sequence or a run; if it has labels of another detector and
    `replace` is false; or if another process writes labels into the folder and `waiting` is None.
    """
    record = detection_record(model, config, provider)
    require_label_folder(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise DataError(f"the folder cannot be created: {error.strerror}", folder) from None
    with only_process(folder, waiting):
        _claim(folder, record, sequence, replace)
        files = [(folder / f"{frame}.txt", sequence.left_file(frame)) for frame in sequence.frames]
        missing = [(label, image) for label, image in files if not _is_current(label, image)]
        if not missing:
            return 0
        detector = YoloDetector(model, config, provider=provider)
        wanted = wanted_classes(detector, config.classes)

        def detect(label: Path, image_file: Path) -> None:
            image = read_image(image_file, sequence.bits)
            boxes = with_label_numbers(detector, detector.detect(image, wanted))
            write_labels(label, boxes, image.shape[1], image.shape[0])

        with ThreadPoolExecutor(DETECTION_THREADS) as pool:
            results = pool.map(detect, *zip(*missing, strict=True))
            try:
                for number, _ in enumerate(results, start=len(files) - len(missing) + 1):
                    if progress:
                        progress(number, len(files))
            except BaseException:
                pool.shutdown(cancel_futures=True)  # Ctrl-C does not wait for the other images
                raise
        return len(missing)


def wanted_classes(detector: YoloDetector, classes: tuple[str, ...]) -> BoolArray:
    """Mask of a detector's classes that `classes` lists, by name or number; all if it lists none.

    Raises `DataError` for a name that neither the model nor COCO has, or if the model has none of them.
    """
    names = _names(detector)
    wanted = choose_classes(classes, names)
    if not wanted.any():
        listed = ", ".join(classes)
        known = ", ".join(names)[:200]
        raise DataError(f"the model has none of the classes {listed}, only {known}", detector.path)
    return wanted


def with_label_numbers(detector: YoloDetector, boxes: Boxes) -> Boxes:
    """A detector's boxes with the class numbers of label files: COCO's where COCO has the class."""
    numbers = class_numbers(_names(detector))
    known = boxes[boxes.class_id < len(numbers)]
    return dataclasses.replace(known, class_id=numbers[known.class_id])


def _names(detector: YoloDetector) -> tuple[str, ...]:
    """The class names of a detector, or words with the number for a model without names."""
    count = len(COCO) if detector.class_count is None else detector.class_count
    return detector.names or tuple(f"class {number}" for number in range(count))


def labelled_sequence(
    sequence: Sequence,
    model: str | Path,
    config: DetectorConfig | None = None,
    *,
    provider: str = "cpu",
    cache: Path | None = None,
    waiting: Callable[[Path], None] | None = None,
    progress: Progress | None = None,
) -> Sequence:
    """The sequence with a detector's labels, which are stored in the cache folder.

    If another process detects the same sequence, `waiting` is called with the folder, then the call waits.
    """
    config = config or DetectorConfig()
    folder = label_folder(sequence, detection_record(model, config, provider), cache)
    _delete_damaged_record(folder / RECORD)
    write_label_folder(
        sequence,
        model,
        config,
        folder,
        provider=provider,
        replace=True,
        waiting=waiting or (lambda _: None),
        progress=progress,
    )
    return dataclasses.replace(sequence, labels=folder)


def require_label_folder(folder: Path) -> None:
    """Raise `DataError` if a folder for labels is the folder of a sequence or of a run."""
    for name in FILES_OF_OTHER_FOLDERS:
        if os.path.lexists(folder / name):
            raise DataError(
                f"contains {name}, so it is the folder of a sequence or a run: choose another folder",
                folder,
            )


def is_current_record(record: dict[str, Any]) -> bool:
    """Whether this version of the kit could have written a record, and thus has a use for its labels."""
    names = {field.name for field in dataclasses.fields(DetectorConfig)} - {"threads"}
    settings = record.get("settings")
    return isinstance(settings, dict) and settings.keys() == names


def _claim(folder: Path, record: dict[str, Any], sequence: Sequence, replace: bool) -> None:
    """Write the detector's record if it is missing; `replace` deletes the frames' labels of another detector.

    Every other file is kept. Raises `DataError` for a file that would then seem to be this detector's.
    """
    path = folder / RECORD
    labels = sorted(file for file in folder.glob("*.txt") if file.stem.isdecimal())
    if path.exists():
        present = read_mapping(path, EXPECTED_RECORD)
        if present == record:
            return
        if not record.keys() <= present.keys():
            raise DataError(f"expected {EXPECTED_RECORD}: choose another folder for labels", path)
    if labels and not replace:
        raise DataError(
            "contains labels that this detector did not write: choose another folder",
            folder,
            remedy="replace",
        )
    frames = set(list_frames(sequence.folder))
    for file in labels:
        if file.stem not in frames:
            raise DataError(
                f"is another detector's label, and {sequence.name} has no such frame: choose another folder",
                file,
            )
    # The record is deleted first: a folder never has labels of one detector and the record of another.
    for file in (path, *labels):
        file.unlink(missing_ok=True)
    write_atomic(path, json.dumps(record, indent=1) + "\n")


def _delete_damaged_record(path: Path) -> None:
    """Delete a record that is not JSON from the cache, whose files are the kit's own."""
    try:
        if path.exists():
            read_mapping(path, EXPECTED_RECORD)
    except DataError:
        path.unlink(missing_ok=True)


def _is_current(label: Path, image: Path) -> bool:
    return label.exists() and label.stat().st_mtime_ns >= image.stat().st_mtime_ns
