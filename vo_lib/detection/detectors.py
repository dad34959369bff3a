"""Vehicle detectors that can be fetched or registered by name, with size, licence and hash."""

from __future__ import annotations

import json
import re
import shutil
from dataclasses import dataclass
from pathlib import Path

from data_scripts.fetch.download import download, require_space

from ..core.errors import DataError
from ..core.files import file_sha256, read_text, write_text_atomic
from ..core.types import Progress
from ..data.places import detector_folder, script_command

YOLOX = "https://github.com/Megvii-BaseDetection/YOLOX/releases/download/0.1.1rc0/"
REGISTRY = "detectors.json"
NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]*")


@dataclass(frozen=True)
class Detector:
    """A detector's file in ONNX form.

    Attributes
    ----------
    name, file : what it is called, and its file's name.
    url : where it is fetched from; "" for one registered from disk.
    size : bytes; sha256 : 64 hexadecimal digits.
    licence : short name, or who must know.
    about : a few words.
    """

    name: str
    file: str
    url: str
    size: int
    sha256: str
    licence: str
    about: str


# The release gives no hashes. Size and SHA-256 are those that several independent projects recorded of the
# release's files; a file that is not exactly that is refused.
FETCHABLE = {
    detector.name: detector
    for detector in (
        Detector(
            "yolox-nano",
            "yolox_nano.onnx",
            YOLOX + "yolox_nano.onnx",
            3_659_407,
            "c789161ed43c8269fcd4e67c67eeeb4e80c622da2eb296a20bc6007bd18a0b7d",
            "Apache-2.0",
            "COCO, input 416×416, fastest",
        ),
        Detector(
            "yolox-tiny",
            "yolox_tiny.onnx",
            YOLOX + "yolox_tiny.onnx",
            20_219_662,
            "427cc366d34e27ff7a03e2899b5e3671425c262ea2291f88bb942bc1cc70b0f7",
            "Apache-2.0",
            "COCO, input 416×416",
        ),
        Detector(
            "yolox-s",
            "yolox_s.onnx",
            YOLOX + "yolox_s.onnx",
            35_858_002,
            "c5c2d13e59ae883e6af3b45daea64af4833a4951c92d116ec270d9ddbe998063",
            "Apache-2.0",
            "COCO, input 640×640, most exact of the three",
        ),
    )
}

YOLOV8 = (
    "The kit does not fetch YOLOv8, the paper's detector: its weights are AGPL-3.0 (Ultralytics), which asks",
    "whoever passes on or serves a program with them to publish that program's source, or to buy a licence:",
    "https://www.ultralytics.com/license. To make the ONNX file yourself, in an environment of its own:",
    "  pip install ultralytics onnx",
    "  yolo export model=yolov8n.pt format=onnx",
)


def known(folder: Path | None = None) -> dict[str, tuple[Detector, Path | None]]:
    """All detectors by name, with their files where they are on disk with the right size."""
    folder = folder or detector_folder()
    every = {**FETCHABLE, **_registered(folder)}
    found: dict[str, tuple[Detector, Path | None]] = {}
    for name, detector in every.items():
        path = folder / detector.file
        there = path.is_file() and path.stat().st_size == detector.size
        found[name] = detector, path if there else None
    return found


def find_detector(name: str, folder: Path | None = None) -> Path:
    """The file of a detector on disk. `DataError` says how to get one that is not there."""
    detectors = known(folder)
    if name not in detectors:
        raise DataError(f"no detector is called {name!r}; there are {', '.join(detectors)}")
    path = detectors[name][1]
    if path is None:
        command = f"{script_command('get_detector.py')} {name}"
        raise DataError(f"the detector {name} is not on this machine: {command} fetches it")
    return path


def fetch_detector(
    name: str, folder: Path | None = None, progress: Progress | None = None, url: str | None = None
) -> Path:
    """Fetch a detector, verified; one that is there with the right hash is left as it is.

    Parameters
    ----------
    url : another place of the same file, a mirror.
    """
    folder = folder or detector_folder()
    if name not in FETCHABLE:
        raise DataError(f"no detector is called {name!r}; expected one of {', '.join(FETCHABLE)}")
    detector = FETCHABLE[name]
    path = folder / detector.file
    if not (path.is_file() and file_sha256(path) == detector.sha256):
        download(url or detector.url, path, detector.size, detector.sha256, progress)
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
    _check_onnx(source)
    sha256, size = file_sha256(source), source.stat().st_size
    official = FETCHABLE.get(name)
    if official is not None:
        if (size, sha256) != (official.size, official.sha256):
            raise DataError(
                f"is not the official {name} ({size} bytes, SHA-256 {sha256[:12]}…; expected {official.size} "
                f"bytes, {official.sha256[:12]}…); register it under another name",
                source,
            )
        detector = official
    else:
        detector = Detector(name, f"{name}.onnx", "", size, sha256, licence or "not stated", "registered")
    path = folder / detector.file
    try:
        folder.mkdir(parents=True, exist_ok=True)
        require_space(folder, size)
        if not (path.is_file() and path.samefile(source)):
            working = path.with_name(f".{path.name}.tmp")
            try:
                shutil.copyfile(source, working)
                working.replace(path)
            finally:
                working.unlink(missing_ok=True)
    except OSError as error:
        raise DataError(f"cannot be written: {error.strerror}", path) from None
    if official is None:
        others = {**_registered(folder), name: detector}
        text = json.dumps({key: vars(value) for key, value in others.items()}, indent=2)
        write_text_atomic(folder / REGISTRY, text + "\n")
    return detector


def _registered(folder: Path) -> dict[str, Detector]:
    path = folder / REGISTRY
    if not path.exists():
        return {}
    try:
        return {name: Detector(**entry) for name, entry in json.loads(read_text(path)).items()}
    except (ValueError, TypeError, AttributeError):
        raise DataError("is damaged; delete it and register the detectors again", path) from None


def _check_onnx(path: Path) -> None:
    """`DataError` unless ONNX Runtime can load the file."""
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.log_severity_level = 4
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    try:
        onnxruntime.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])
    except Exception as error:  # the runtime's exceptions share no other base
        words = str(error).splitlines()[0][:120] if str(error) else type(error).__name__
        raise DataError(f"ONNX Runtime cannot load it: {words}", path) from None
