"""A vehicle detector fetched by name, or registered from disk."""

from __future__ import annotations

import json
import re
from pathlib import Path

from fetch.download import download, require_space
from vo_lib.core.errors import DataError
from vo_lib.core.files import file_sha256, write_bytes_atomic, write_text_atomic
from vo_lib.core.types import Progress
from vo_lib.detection.detectors import FETCHABLE, REGISTRY, Detector, detector_folder, registered
from vo_lib.detection.yolo import YoloDetector

NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]*")

YOLOV8 = (
    "The kit does not fetch YOLOv8, the paper's detector: its weights are AGPL-3.0 (Ultralytics), which asks",
    "whoever passes on or serves a program with them to publish that program's source, or to buy a licence:",
    "https://www.ultralytics.com/license. To make the ONNX file yourself, in an environment of its own:",
    "  pip install ultralytics onnx",
    "  yolo export model=yolov8n.pt format=onnx",
    "  vo data get_detector yolov8n --from yolov8n.onnx --licence AGPL-3.0",
)


def fetch_detector(detector: Detector, folder: Path, progress: Progress | None = None) -> Path:
    """Fetch a detector, verified; one that is there with the right hash is left as it is."""
    path = folder / detector.file
    if not (path.is_file() and file_sha256(path) == detector.sha256):
        download(detector.url, path, detector.size, detector.sha256, progress)
    return path


def register_detector(name: str, source: Path, folder: Path | None = None, licence: str = "") -> Detector:
    """Copy an ONNX file from disk under a name; its size and SHA-256 are recorded.

    A file called like a fetchable detector must be that detector's.
    """
    folder = folder or detector_folder()
    if not NAME.fullmatch(name):
        raise DataError(f"{name!r} is no name: expected letters, digits, - and _")
    if not source.is_file():
        raise DataError("the file is missing", source)
    YoloDetector(source)  # a `DataError` where the kit cannot run it
    sha256, size = file_sha256(source), source.stat().st_size
    own = Detector(name, f"{name}.onnx", "", size, sha256, licence or "not stated", "registered")
    detector = FETCHABLE.get(name, own)
    if (size, sha256) != (detector.size, detector.sha256):
        raise DataError(
            f"is not the official {name} ({size} bytes, SHA-256 {sha256[:12]}…; expected {detector.size} "
            f"bytes, {detector.sha256[:12]}…); register it under another name",
            source,
        )
    path = folder / detector.file
    try:
        folder.mkdir(parents=True, exist_ok=True)
        require_space(folder, size)
        if not (path.is_file() and path.samefile(source)):
            write_bytes_atomic(path, source.read_bytes())
    except OSError as error:
        raise DataError(f"cannot be written: {error.strerror}", path) from None
    if detector is own:
        others = {**registered(folder), name: detector}
        text = json.dumps({key: vars(value) for key, value in others.items()}, indent=2)
        write_text_atomic(folder / REGISTRY, text + "\n")
    return detector
