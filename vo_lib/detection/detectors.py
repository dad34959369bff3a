"""Vehicle detectors known by name, with size, licence and hash: those to be fetched, those registered."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from pathlib import Path

import platformdirs

from ..core.errors import DataError
from ..core.files import read_json

YOLOX = "https://github.com/Megvii-BaseDetection/YOLOX/releases/download/0.1.1rc0/"
REGISTRY = "detectors.json"
MODELS = {"street": Path(__file__).parent / "models" / "street.onnx"}  # shipped with the kit


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


def detector_folder() -> Path:
    """Where fetched detectors are kept unless told otherwise: the user's data folder."""
    return platformdirs.user_data_path("stereo-vo-kit", appauthor=False) / "detectors"


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


def known(folder: Path | None = None) -> dict[str, tuple[Detector, Path | None]]:
    """All detectors by name, with their files where they are on disk with the right size."""
    folder = folder or detector_folder()
    every = {**FETCHABLE, **registered(folder)}
    found: dict[str, tuple[Detector, Path | None]] = {}
    for name, detector in every.items():
        path = folder / detector.file
        there = path.is_file() and path.stat().st_size == detector.size
        found[name] = detector, path if there else None
    return found


def find_model(name: str | Path, folder: Path | None = None) -> Path:
    """The file of a model: shipped, fetched or registered under a name, or the path of an ONNX file.

    `DataError` says how to get one that is not there.
    """
    path = MODELS.get(str(name), Path(name))
    if path.is_file():
        return path
    detectors = known(folder)
    names = ", ".join([*MODELS, *detectors])
    if path.suffix or path.name != str(name):
        raise DataError(f"the model is missing: expected an ONNX file or one of {names}", path)
    if str(name) not in detectors:
        raise DataError(f"no detector is called {str(name)!r}: expected an ONNX file or one of {names}")
    found = detectors[str(name)][1]
    if found is None:
        raise DataError(f"the detector {name} is not on this machine: vo data get_detector {name} fetches it")
    return found


def registered(folder: Path) -> dict[str, Detector]:
    """Detectors registered in a folder, by name; `DataError` where the record of them is damaged."""
    path = folder / REGISTRY
    if not path.exists():
        return {}
    fields = {item.name: int if item.name == "size" else str for item in dataclasses.fields(Detector)}
    expected = "a record of detectors: it is damaged; delete it and register the detectors again"
    entries = read_json(path, {str: fields}, expected)
    if any(Path(entry["file"]).name != entry["file"] for entry in entries.values()):
        raise DataError(f"expected {expected}", path)
    return {key: Detector(**{name: entry[name] for name in fields}) for key, entry in entries.items()}
