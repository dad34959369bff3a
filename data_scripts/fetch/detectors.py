"""A vehicle detector fetched by name, or registered from disk."""

from __future__ import annotations

import json
import re
from pathlib import Path

from fetch.download import download, require_space
from vo_lib.core.errors import DataError
from vo_lib.core.files import file_sha256, write_bytes_atomic, write_text_atomic
from vo_lib.core.types import Progress
from vo_lib.detection.detectors import REGISTRY, Detector, detector_folder, registered
from vo_lib.detection.yolo import YoloDetector

YOLOX = "https://github.com/Megvii-BaseDetection/YOLOX/releases/download/0.1.1rc0/"
NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]*")

YOLOV8 = (
    "The kit does not fetch YOLOv8, the paper's detector: its weights are AGPL-3.0 (Ultralytics), which asks",
    "whoever passes on or serves a program with them to publish that program's source, or to buy a licence:",
    "https://www.ultralytics.com/license. To make the ONNX file yourself, in an environment of its own:",
    "  pip install ultralytics onnx",
    "  yolo export model=yolov8n.pt format=onnx",
    "  vo data get_detector yolov8n --from yolov8n.onnx --licence AGPL-3.0",
)


def _yolox(name: str, size: int, sha256: str, about: str) -> Detector:
    file = name.replace("-", "_") + ".onnx"
    return Detector(name, file, YOLOX + file, size, sha256, "Apache-2.0", about)


# The release gives no hashes. Size and SHA-256 are those that several independent projects recorded of the
# release's files; a file that is not exactly that is refused.
_YOLOX = (
    _yolox(
        "yolox-nano",
        3_659_407,
        "c789161ed43c8269fcd4e67c67eeeb4e80c622da2eb296a20bc6007bd18a0b7d",
        "COCO, input 416×416, fastest",
    ),
    _yolox(
        "yolox-tiny",
        20_219_662,
        "427cc366d34e27ff7a03e2899b5e3671425c262ea2291f88bb942bc1cc70b0f7",
        "COCO, input 416×416",
    ),
    _yolox(
        "yolox-s",
        35_858_002,
        "c5c2d13e59ae883e6af3b45daea64af4833a4951c92d116ec270d9ddbe998063",
        "COCO, input 640×640, most exact of the three",
    ),
)
FETCHABLE = {detector.name: detector for detector in _YOLOX}


def fetch_detector(detector: Detector, folder: Path, progress: Progress | None = None) -> Path:
    """Fetch a detector, verified; one that is there with the right hash is left as it is."""
    path = folder / detector.file
    if not (path.is_file() and file_sha256(path) == detector.sha256):
        download(detector.url, path, detector.size, detector.sha256, progress)
    _record(detector, folder)
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
    _record(detector, folder)
    return detector


def _record(detector: Detector, folder: Path) -> None:
    """Note a detector that is in the folder, so that it is found by its name."""
    every = {**registered(folder), detector.name: detector}
    text = json.dumps({name: vars(one) for name, one in every.items()}, indent=2)
    write_text_atomic(folder / REGISTRY, text + "\n")
