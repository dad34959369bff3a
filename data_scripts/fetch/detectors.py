"""Download of a vehicle detector by name, or registration from disk."""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import NamedTuple

from fetch.download import download, write_file
from vo_lib.detection.model_files import copy_model, model_files, model_sha256
from vo_lib.detection.models import MODELS, list_detectors
from vo_lib.detection.yolo import YoloDetector
from vo_lib.errors import DataError
from vo_lib.files import file_sha256, locked_draft, open_binary, read_bytes
from vo_lib.geometry.types import Progress

YOLOX = "https://github.com/Megvii-BaseDetection/YOLOX/releases/download/0.1.1rc0/"
LICENCE = "Apache-2.0"  # of YOLOX
NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]*")

PAPERS_DETECTOR = "yolov8n"  # the smallest YOLOv8


class Detector(NamedTuple):
    """An ONNX file for download, with name, address, size in bytes, SHA-256 and description."""

    name: str
    url: str
    size: int
    sha256: str
    about: str


# The release publishes no hashes. Several independent projects recorded these sizes and hashes of its files.
# A file with a different size or hash is refused.
_YOLOX = (
    Detector(
        "yolox-nano",
        YOLOX + "yolox_nano.onnx",
        3_659_407,
        "c789161ed43c8269fcd4e67c67eeeb4e80c622da2eb296a20bc6007bd18a0b7d",
        "COCO, input 416×416, fastest",
    ),
    Detector(
        "yolox-tiny",
        YOLOX + "yolox_tiny.onnx",
        20_219_662,
        "427cc366d34e27ff7a03e2899b5e3671425c262ea2291f88bb942bc1cc70b0f7",
        "COCO, input 416×416",
    ),
    Detector(
        "yolox-s",
        YOLOX + "yolox_s.onnx",
        35_858_002,
        "c5c2d13e59ae883e6af3b45daea64af4833a4951c92d116ec270d9ddbe998063",
        "COCO, input 640×640, most accurate of the three",
    ),
)
FETCHABLE = {detector.name: detector for detector in _YOLOX}


def how_to_export(name: str) -> tuple[str, list[str]]:
    """How to make the ONNX file of one of Ultralytics' models: a sentence, and the commands."""
    what = "YOLOv8, the paper's detector" if name.startswith("yolov8") else f"{name}, a model of Ultralytics"
    words = (
        f"The kit does not download {what}. Its weights are under AGPL-3.0 (Ultralytics): a program that is "
        "distributed or served with these weights must offer its source code or needs a licence: "
        "https://www.ultralytics.com/license. These commands make the ONNX file; use a separate environment:"
    )
    commands = [
        "pip install ultralytics onnx",
        f"yolo export model={name}.pt format=onnx",
        f"vo data get_detector {name} --from {name}.onnx",
    ]
    return words, commands


def fetch_detector(detector: Detector, folder: Path, progress: Progress | None = None) -> Path:
    """Download and verify a detector, unless the folder already has a file with the right hash."""
    path = folder / f"{detector.name}.onnx"
    if not (path.is_file() and file_sha256(path) == detector.sha256):
        download(detector.url, path, detector.size, detector.sha256, progress)
    return path


def register_detector(name: str, source: Path, folder: Path) -> Path:
    """Copy a model from disk under a new name, with all its files; the copy is loaded as a test.

    A model of one file becomes NAME.onnx, a model of several files NAME/NAME.onnx. The names of downloadable
    detectors are reserved for these, and the name of the kit's own.

    Raises `DataError` for an invalid name, an unusable model, or a name that another registered model has.
    """
    if not NAME.fullmatch(name):
        raise DataError(f"{name!r} is not a valid name: expected letters, digits, - and _")
    if name in MODELS:
        raise DataError(f"{name} is the kit's own detector: choose another name")
    with open_binary(source):
        YoloDetector(source)  # raises `DataError` for an unusable model
    digest = model_sha256(source)
    if name in FETCHABLE and digest != FETCHABLE[name].sha256:
        raise DataError(f"is not the official {name}; register the file under another name", source)
    registered = list_detectors(folder).get(name)
    if registered is not None:
        if _is_model(registered, digest):
            return registered
        raise DataError("is another detector: choose another name, or delete this file first", registered)
    if len(model_files(source)) == 1:
        path = folder / f"{name}.onnx"
        write_file(path, read_bytes(source))
        return path
    return _register_files(name, source, folder)


def _is_model(path: Path, digest: str) -> bool:
    """Whether a registered model is whole and has this SHA-256."""
    try:
        return model_sha256(path) == digest
    except DataError:
        return False


def _register_files(name: str, source: Path, folder: Path) -> Path:
    """Copy a model of several files into a folder of its own, which gets its name once the copy works."""
    target = folder / name
    if target.exists():
        raise DataError("is in the way of a detector of this name: choose another name", target)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise DataError(f"cannot be written: {error.strerror}", target) from None
    with locked_draft(target) as draft:
        draft.mkdir()
        copy_model(source, draft / f"{name}.onnx")
        YoloDetector(draft / f"{name}.onnx")
        os.rename(draft, target)
    return target / f"{name}.onnx"
