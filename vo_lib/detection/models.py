"""Vehicle detectors by name: the included one, and downloaded or registered ones.

`vo data get_detector` downloads a detector, or registers one: it copies an ONNX file from disk under a name
into the folder of detectors.
"""

from __future__ import annotations

import re
from collections.abc import Collection
from pathlib import Path

import platformdirs

from ..errors import DataError, did_you_mean

DOWNLOADABLE = ("yolox-nano", "yolox-tiny", "yolox-s")  # by `vo data get_detector`
# Names of Ultralytics' models, which everybody exports; for example yolov8n, yolo11s, yolo26n, rtdetr-l.
ULTRALYTICS = re.compile("(yolo(v[3-9]|v10|1[0-9]|2[0-9])|rtdetr)[a-z0-9-]{0,12}")
PYTORCH = (".pt", ".pth")  # endings of weights, which the kit cannot run
MODELS = {"street": Path(__file__).parent / "models" / "street.onnx"}  # part of the kit


def detector_folder() -> Path:
    """The default folder of downloaded detectors, in the user's data folder."""
    return platformdirs.user_data_path("stereo-vo-kit", appauthor=False) / "detectors"


def list_detectors(folder: Path | None = None) -> dict[str, Path]:
    """The ONNX files of the detectors in a folder, by name.

    A model of one file is NAME.onnx; a model of several files has a folder, with NAME/NAME.onnx in it.
    """
    folder = folder or detector_folder()
    files = list(folder.glob("*.onnx"))
    files += [file for file in folder.glob("*/*.onnx") if is_in_own_folder(file)]
    files.sort(key=lambda file: file.stem)
    return {file.stem: file for file in files}


def is_in_own_folder(path: Path) -> bool:
    """Whether a model is in a folder of its own name, as a registered model of several files is."""
    return path.parent.name == path.stem


def find_model(name: str | Path, folder: Path | None = None) -> Path:
    """The ONNX file of a model: a path, or the name of an included, downloaded or registered model.

    Raises `DataError` with the available names and the command that downloads models.
    """
    files = list_detectors(folder) | MODELS
    path = files.get(str(name), Path(name))
    if not path.is_file():
        raise _not_found(str(name), path, files)
    if path.suffix.lower() in PYTORCH:
        command = f"yolo export model={path.name} format=onnx"
        raise DataError(f"is a file of PyTorch, expected ONNX; make it with: {command}", path)
    return path


def _not_found(name: str, path: Path, files: Collection[str]) -> DataError:
    """The error for a model that is no file, with what the person probably meant.

    path : what the person typed, as a path. files : names of the detectors on this machine.
    """
    # A word such as "street" is a name, also beside a folder with this name.
    is_path = path.parent != Path()
    if path.exists() and is_path:
        kind = "a folder" if path.is_dir() else "a pipe or a device"
        return DataError(f"is {kind}, expected an ONNX file", path)
    is_obtainable = path.stem in DOWNLOADABLE or ULTRALYTICS.fullmatch(path.stem) is not None
    if is_path or path.suffix.lower() in (".onnx", *PYTORCH):
        remedy = ""
        if path.stem in files:
            remedy = f"; the detector of this name is given as {path.stem}"
        elif is_obtainable:
            remedy = f"; `vo data get_detector {path.stem}` says how to get this model"
        return DataError(f"no such file{remedy}", path)
    if is_obtainable:
        return DataError(f"the detector {name} is not on this machine; use: vo data get_detector {name}")
    near = did_you_mean(path.stem, [*files, *DOWNLOADABLE, "yolov8n"])
    expected = f"expected an ONNX file or one of {', '.join(files)}"
    return DataError(f"unknown detector {name!r}: {near}{expected}; `vo data get_detector` lists more")
