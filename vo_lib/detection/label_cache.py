"""Boxes of a detector as label folders: written once, frame by frame, ahead of who reads them.

    with detected_sequence(sequence, "street", DetectorConfig()) as sequence:
        run(sequence, config)               # sequence.boxes(i) waits for frame i where it is not there yet

A label folder holds `000000.txt` …, `detector.json`: the model's SHA-256 and the settings that made it, and
`written.csv`: the files' own, so that one that was cut since is noticed.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
from collections.abc import Iterator
from concurrent.futures import CancelledError, Future, ThreadPoolExecutor, wait
from contextlib import closing, contextmanager, nullcontext, suppress
from pathlib import Path
from typing import Any

from ..core.errors import DataError
from ..core.files import file_sha256, only_process, read_json, write_text_atomic
from ..core.settings import to_dict
from ..core.types import Progress
from ..data.drawn import cache_folder
from ..data.kitti import read_image
from ..data.labels import WRITTEN, read_labels, write_labels, written_labels
from ..data.sequence import Sequence
from .config import DetectorConfig
from .detectors import find_model
from .yolo import YoloDetector

RECORD = "detector.json"
DIGITS = 12
# Images detected at once, each in a thread: while one is read or its boxes are chosen, the network is busy
# with the other, and a core that the odometry leaves idle is used.
AT_ONCE = 2


def detection_record(model: str | Path, config: DetectorConfig, provider: str = "cpu") -> dict[str, Any]:
    """What decides a detector's boxes, ready for JSON: model with its hash, settings, provider."""
    path = find_model(model)
    settings = to_dict(config)
    del settings["threads"]
    settings["classes"] = list(config.classes)
    return {"model": path.name, "sha256": file_sha256(path), "provider": provider, "settings": settings}


def label_folder(sequence: Sequence, record: dict[str, Any], cache: Path | None = None) -> Path:
    """Where the boxes of a sequence by a detector are kept; `cache`: in place of the user's cache folder."""
    root = cache_folder().parent if cache is None else cache
    what = json.dumps([record, str(sequence.folder.resolve())], sort_keys=True)
    digest = hashlib.sha256(what.encode()).hexdigest()[:DIGITS]
    return root / "labels" / f"{sequence.folder.resolve().name}-{Path(record['model']).stem}-{digest}"


def claim_folder(folder: Path, record: dict[str, Any], replace: bool = False) -> None:
    """Make a label folder, or check that an existing one was made by the same detector.

    Labels made otherwise, or beside a damaged record, are removed with `replace`; without it `DataError` says
    what they are.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        path, labels, made_by = folder / RECORD, sorted(folder.glob("*.txt")), None
        with suppress(DataError) if replace else nullcontext():
            made_by = read_json(path, {}, "the record of a detector") if path.exists() else None
        if made_by == record:
            return
        if labels and not replace:
            other = (
                "labels that no detector of the kit wrote" if made_by is None else "another detector's labels"
            )
            raise DataError(f"holds {other}: give another folder, or replace them", folder)
        # The record goes first: labels must never stand beside the record of another detector.
        path.unlink(missing_ok=True)
        for label in (*labels, folder / WRITTEN):
            label.unlink(missing_ok=True)
    except OSError as error:
        raise DataError(f"cannot be written: {error.strerror}", folder) from None
    write_text_atomic(path, json.dumps(record, indent=1) + "\n")


def missing_frames(sequence: Sequence, folder: Path) -> list[str]:
    """Frames whose label file is not there, damaged, or older than the image."""
    try:
        written = written_labels(folder)
    except DataError:
        written = {"": ""}  # damaged: nothing is known of any label

    def current(frame: str) -> bool:
        path = folder / f"{frame}.txt"
        try:
            if path.stat().st_mtime_ns < _left(sequence, frame).stat().st_mtime_ns:
                return False
            read_labels(path, sequence.camera.width, sequence.camera.height)
            return not written or written.get(path.name) == file_sha256(path)
        except (OSError, DataError):
            return False

    return [frame for frame in sequence.frames if not current(frame)]


def _left(sequence: Sequence, frame: str) -> Path:
    return sequence.folder / "image_0" / f"{frame}.png"


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
    """Write the labels of a whole sequence; called again it goes on. Returns how many were detected.

    `DataError` where another process writes labels there, or they were made otherwise.
    """
    record = detection_record(model, config, provider)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise DataError(f"cannot be written: {error.strerror}", folder) from None
    with only_process(folder), closing(_writer(sequence, model, config, folder, record, replace)) as writer:
        return writer.wait_for_all(progress)


def labelled_sequence(
    sequence: Sequence,
    model: str | Path,
    config: DetectorConfig | None = None,
    *,
    provider: str = "cpu",
    cache: Path | None = None,
    progress: Progress | None = None,
) -> Sequence:
    """The sequence with a detector's labels from the cache, all written now: for runs in many processes."""
    # Nobody else is kept out: all who write into this folder write the same.
    with detected_sequence(sequence, model, config, provider=provider, cache=cache) as detected:
        for index in range(len(sequence)):
            detected.boxes(index)
            if progress:
                progress(index + 1, len(sequence))
    return dataclasses.replace(sequence, labels=detected.labels)


class LabelWriter:
    """Writes missing labels in threads of its own, in the order of the frames."""

    def __init__(self, sequence: Sequence, folder: Path, missing: list[str], detector: YoloDetector | None):
        self._sequence, self._folder, self._missing, self._detector = sequence, folder, missing, detector
        self._pool = ThreadPoolExecutor(AT_ONCE, "detector")
        self._written: dict[str, Future[None]] = {}
        before: Future[None] | None = None
        for frame in self._missing:
            before = self._written[frame] = self._pool.submit(self._write, frame, before)

    def close(self) -> None:
        """End after the frames in work."""
        self._pool.shutdown(cancel_futures=True)

    def wait(self, frame: str) -> None:
        """Return once the label of a frame is there; raises what went wrong with it."""
        if frame in self._written:
            try:
                self._written[frame].result()
            except CancelledError:
                raise DataError(f"the detector was stopped before frame {frame}", self._folder) from None

    def wait_for_all(self, progress: Progress | None) -> int:
        """Return once all labels are there, how many were missing."""
        there = len(self._sequence) - len(self._missing)
        for number, frame in enumerate(self._missing, start=there + 1):
            self.wait(frame)
            if progress:
                progress(number, len(self._sequence))
        return len(self._missing)

    def _write(self, frame: str, before: Future[None] | None) -> None:
        assert self._detector is not None
        image = read_image(_left(self._sequence, frame))
        boxes = self._detector.detect(image)
        path = self._folder / f"{frame}.txt"
        write_labels(path, boxes, image.shape[1], image.shape[0])
        if before is not None:
            wait([before])  # the lines stand in the order of the frames, whichever thread is first
        with open(self._folder / WRITTEN, "a", encoding="utf-8", newline="") as file:
            file.write(f"\n{path.name},{file_sha256(path)}")  # behind what a killed process began


@contextmanager
def detected_sequence(
    sequence: Sequence,
    model: str | Path,
    config: DetectorConfig | None = None,
    *,
    provider: str = "cpu",
    cache: Path | None = None,
) -> Iterator[Sequence]:
    """The sequence with the boxes of a detector, from the cache or detected in threads that run ahead.

    The boxes are always those of the label files, so that a run on cached labels gives the same bytes.
    `cache` keeps the labels, in place of the user's cache folder.
    """
    config = config or DetectorConfig()
    record = detection_record(model, config, provider)
    folder = label_folder(sequence, record, cache)
    identity = hashlib.sha256(json.dumps(record, sort_keys=True).encode()).hexdigest()[:DIGITS]
    with closing(_writer(sequence, model, config, folder, record, replace=True)) as writer:
        yield dataclasses.replace(sequence, labels=folder, wait=writer.wait, labels_identity=identity)


def _writer(
    sequence: Sequence,
    model: str | Path,
    config: DetectorConfig,
    folder: Path,
    record: dict[str, Any],
    replace: bool,
) -> LabelWriter:
    """What writes the labels that a folder lacks."""
    claim_folder(folder, record, replace)
    missing = missing_frames(sequence, folder)
    detector = YoloDetector(model, config, provider=record["provider"]) if missing else None
    return LabelWriter(sequence, folder, missing, detector)
