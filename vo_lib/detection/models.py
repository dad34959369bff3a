"""Vehicle detectors by name: the shipped one, and those fetched or registered."""

from __future__ import annotations

from pathlib import Path

import platformdirs

from ..errors import DataError

MODELS = {"street": Path(__file__).parent / "models" / "street.onnx"}  # shipped with the kit


def detector_folder() -> Path:
    """The default folder of fetched detectors, in the user's data folder."""
    return platformdirs.user_data_path("stereo-vo-kit", appauthor=False) / "detectors"


def list_detectors(folder: Path | None = None) -> dict[str, Path]:
    """The ONNX files of all detectors in a folder, by name."""
    return {path.stem: path for path in sorted((folder or detector_folder()).glob("*.onnx"))}


def find_model(name: str | Path, folder: Path | None = None) -> Path:
    """The ONNX file of a model, shipped, fetched or registered under a name, or given by its path.

    Raises `DataError`, which says how to get a model that is missing.
    """
    named = {**list_detectors(folder), **MODELS}
    path = named.get(str(name), Path(name))
    if path.is_file():
        return path
    expected = f"expected an ONNX file or one of {', '.join(named)}"
    if path.suffix or path.name != str(name):
        raise DataError(f"the model is missing: {expected}", path)
    raise DataError(f"no detector is called {str(name)!r}: {expected}; vo data get_detector lists more")
