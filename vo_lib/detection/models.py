"""Vehicle detectors by name: the included detector, and downloaded or registered detectors."""

from __future__ import annotations

import re
from pathlib import Path

import platformdirs

from ..errors import DataError, did_you_mean

DOWNLOADABLE = ("yolox-nano", "yolox-tiny", "yolox-s")  # by `vo data get_detector`
MODELS = {"street": Path(__file__).parent / "models" / "street.onnx"}  # part of the kit


def detector_folder() -> Path:
    """The default folder of downloaded detectors, in the user's data folder."""
    return platformdirs.user_data_path("stereo-vo-kit", appauthor=False) / "detectors"


def list_detectors(folder: Path | None = None) -> dict[str, Path]:
    """The ONNX files of the detectors in a folder, by name."""
    return {path.stem: path for path in sorted((folder or detector_folder()).glob("*.onnx"))}


def find_model(name: str | Path, folder: Path | None = None) -> Path:
    """The ONNX file of a model: a path, or the name of an included, downloaded or registered model.

    Raises `DataError` with the available names and the command that downloads models.
    """
    files = {**list_detectors(folder), **MODELS}
    path = files.get(str(name), Path(name))
    if path.is_file():
        return path
    expected = f"expected an ONNX file or one of {', '.join(files)}"
    if name in DOWNLOADABLE or re.fullmatch("yolov8[a-z]?", str(name)):
        raise DataError(f"the detector {name} is not on this machine; use: vo data get_detector {name}")
    near = did_you_mean(path.stem, [*files, *DOWNLOADABLE, "yolov8n"])
    raise DataError(f"unknown detector {str(name)!r}: {near}{expected}; `vo data get_detector` lists more")
