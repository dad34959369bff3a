"""Download of a vehicle detector by name, or registration from disk."""

from __future__ import annotations

import re
from pathlib import Path
from typing import NamedTuple

from fetch.download import download, write_file
from vo_lib.detection.yolo import YoloDetector
from vo_lib.errors import DataError
from vo_lib.files import file_sha256, read_bytes
from vo_lib.geometry.types import Progress

YOLOX = "https://github.com/Megvii-BaseDetection/YOLOX/releases/download/0.1.1rc0/"
LICENCE = "Apache-2.0"  # of YOLOX
NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]*")

YOLOV8 = (
    "The kit does not download YOLOv8, the paper's detector. Its weights are under AGPL-3.0 (Ultralytics): a",
    "program that is distributed or served with these weights must offer its source code or needs a licence:",
    "https://www.ultralytics.com/license. These commands make the ONNX file; use a separate environment:",
    "  pip install ultralytics onnx",
    "  yolo export model=yolov8n.pt format=onnx",
    "  vo data get_detector yolov8n --from yolov8n.onnx",
)


class Detector(NamedTuple):
    """An ONNX file for download, with name, address, size in bytes, SHA-256 and description."""

    name: str
    url: str
    size: int
    sha256: str
    about: str


# The release publishes no hashes. Several independent projects recorded these sizes and hashes of its files.
# A file with a different size or hash is refused.
NANO = 3_659_407, "c789161ed43c8269fcd4e67c67eeeb4e80c622da2eb296a20bc6007bd18a0b7d"
TINY = 20_219_662, "427cc366d34e27ff7a03e2899b5e3671425c262ea2291f88bb942bc1cc70b0f7"
SMALL = 35_858_002, "c5c2d13e59ae883e6af3b45daea64af4833a4951c92d116ec270d9ddbe998063"
_YOLOX = (
    Detector("yolox-nano", YOLOX + "yolox_nano.onnx", *NANO, "COCO, input 416×416, fastest"),
    Detector("yolox-tiny", YOLOX + "yolox_tiny.onnx", *TINY, "COCO, input 416×416"),
    Detector("yolox-s", YOLOX + "yolox_s.onnx", *SMALL, "COCO, input 640×640, most accurate of the three"),
)
FETCHABLE = {detector.name: detector for detector in _YOLOX}


def fetch_detector(detector: Detector, folder: Path, progress: Progress | None = None) -> Path:
    """Download and verify a detector, unless the folder already has a file with the right hash."""
    path = folder / f"{detector.name}.onnx"
    if not (path.is_file() and file_sha256(path) == detector.sha256):
        download(detector.url, path, detector.size, detector.sha256, progress)
    return path


def register_detector(name: str, source: Path, folder: Path) -> Path:
    """Copy an ONNX file from disk under a new name; the names of downloadable detectors are reserved.

    Raises `DataError` for an invalid name, an unusable model, or a name that another registered model has.
    """
    if not NAME.fullmatch(name):
        raise DataError(f"{name!r} is not a valid name: expected letters, digits, - and _")
    data = read_bytes(source)
    YoloDetector(source)  # raises `DataError` for an unusable model
    if name in FETCHABLE and file_sha256(source) != FETCHABLE[name].sha256:
        raise DataError(f"is not the official {name}; register the file under another name", source)
    path = folder / f"{name}.onnx"
    if path.is_file() and read_bytes(path) != data:
        raise DataError("is another detector: choose another name, or delete this file first", path)
    write_file(path, data)
    return path
