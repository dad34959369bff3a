"""Label folders from a detector: a YOLO text file per frame, and a record of the detector.

A label folder contains `000000.txt` … and `detector.json`, with the model's SHA-256 and the settings.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from typing import Any

from ..data.drawn import cache_folder
from ..data.kitti import read_image
from ..data.label_files import write_labels
from ..data.sequence import Sequence
from ..errors import DataError
from ..files import file_sha256, only_process, read_mapping, write_atomic
from ..geometry.types import Progress
from ..settings import to_dict
from .models import find_model
from .settings import DetectorConfig
from .yolo import YoloDetector

RECORD = "detector.json"
# Threads, one image each: the network works on one image while another is read or its boxes are selected.
DETECTION_THREADS = 2


def detection_record(model: str | Path, config: DetectorConfig, provider: str = "cpu") -> dict[str, Any]:
    """All inputs that determine a detector's boxes, for JSON: the model and its hash, settings, provider."""
    path = find_model(model)
    settings = to_dict(config)
    del settings["threads"]
    settings["classes"] = list(config.classes)
    return {"model": path.name, "sha256": file_sha256(path), "provider": provider, "settings": settings}


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
    progress: Progress | None = None,
) -> int:
    """Write the missing labels of a folder and return their number; a second call continues the first.

    A label older than its image counts as missing. Raises `DataError` if another process writes labels into
    the folder, or if the folder has labels of another detector and `replace` is false.
    """
    record, images = detection_record(model, config, provider), sequence.folder / "image_0"
    folder.mkdir(parents=True, exist_ok=True)
    with only_process(folder):
        _claim(folder, record, replace)
        files = [(folder / f"{frame}.txt", images / f"{frame}.png") for frame in sequence.frames]
        missing = [(label, image) for label, image in files if not _is_current(label, image)]
        if not missing:
            return 0
        detector = YoloDetector(model, config, provider=provider)

        def detect(label: Path, image_file: Path) -> None:
            image = read_image(image_file)
            write_labels(label, detector.detect(image), image.shape[1], image.shape[0])

        with ThreadPoolExecutor(DETECTION_THREADS) as pool:
            results = pool.map(detect, *zip(*missing, strict=True))
            for number, _ in enumerate(results, start=len(files) - len(missing) + 1):
                if progress:
                    progress(number, len(files))
        return len(missing)


def labelled_sequence(
    sequence: Sequence,
    model: str | Path,
    config: DetectorConfig | None = None,
    *,
    provider: str = "cpu",
    cache: Path | None = None,
    progress: Progress | None = None,
) -> Sequence:
    """The sequence with a detector's labels, which are stored in the cache folder."""
    config = config or DetectorConfig()
    folder = label_folder(sequence, detection_record(model, config, provider), cache)
    write_label_folder(sequence, model, config, folder, provider=provider, replace=True, progress=progress)
    return dataclasses.replace(sequence, labels=folder)


def _claim(folder: Path, record: dict[str, Any], replace: bool) -> None:
    """Write the detector's record if missing; `replace` deletes the labels of another detector."""
    path, labels = folder / RECORD, list(folder.glob("*.txt"))
    with suppress(DataError):  # a missing or damaged record counts as another detector's
        if read_mapping(path, "the record of a detector") == record:
            return
    if labels and not replace:
        raise DataError(
            "contains labels that this detector did not write: choose another folder or add --replace", folder
        )
    # The record is deleted first: a folder never has labels of one detector and the record of another.
    for file in (path, *labels):
        file.unlink(missing_ok=True)
    write_atomic(path, json.dumps(record, indent=1) + "\n")


def _is_current(label: Path, image: Path) -> bool:
    return label.exists() and label.stat().st_mtime_ns >= image.stat().st_mtime_ns
