"""Vehicle detectors known by name: the one shipped, and those fetched or registered."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from pathlib import Path

import platformdirs

from ..core.errors import DataError
from ..core.files import read_json

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


def known(folder: Path | None = None) -> dict[str, tuple[Detector, Path | None]]:
    """All detectors in a folder by name, with their files where they are on disk with the right size."""
    folder = folder or detector_folder()
    found: dict[str, tuple[Detector, Path | None]] = {}
    for name, detector in registered(folder).items():
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
    detectors = {known_as: file for known_as, (_, file) in known(folder).items() if file is not None}
    expected = f"expected an ONNX file or one of {', '.join([*MODELS, *detectors])}"
    if path.suffix or path.name != str(name):
        raise DataError(f"the model is missing: {expected}", path)
    if str(name) not in detectors:
        raise DataError(f"no detector is called {str(name)!r}: {expected}; vo data get_detector lists more")
    return detectors[str(name)]


def registered(folder: Path) -> dict[str, Detector]:
    """Detectors fetched or registered, by name; `DataError` where a folder's record of them is damaged."""
    path = folder / REGISTRY
    if not path.exists():
        return {}
    fields = {item.name: int if item.name == "size" else str for item in dataclasses.fields(Detector)}
    expected = "a record of detectors: it is damaged; delete it and register the detectors again"
    entries = read_json(path, {str: fields}, expected)
    if any(Path(entry["file"]).name != entry["file"] for entry in entries.values()):
        raise DataError(f"expected {expected}", path)
    return {key: Detector(**{name: entry[name] for name in fields}) for key, entry in entries.items()}
