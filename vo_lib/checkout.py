"""The kit's own folder, with notebooks and data scripts, which an installed copy of the library lacks."""

from __future__ import annotations

import json
from importlib import metadata
from pathlib import Path
from urllib.request import url2pathname

from .errors import DataError


def checkout_folder() -> Path | None:
    """The kit's own folder, if this package lies in it; None for an installed copy."""
    folder = Path(__file__).resolve().parents[1]
    # A copy of the library may lie in the folder of any project.
    return folder if (folder / "data_scripts" / "vo_street").is_dir() else None


def kit_folder_text() -> str:
    """The kit's folder from which pip has installed this copy, or words for it if that is not known."""
    package = next(iter(metadata.distributions(name="stereo-vo-kit")), None)
    note = package and package.read_text("direct_url.json")
    folder = url2pathname(json.loads(note or "{}").get("url", "").removeprefix("file://"))
    return folder if folder and Path(folder, "data_scripts").is_dir() else "the kit's folder (with README.md)"


def kit_subfolder(name: str) -> Path:
    """The folder `name` of the kit's own, such as "notebooks"; `DataError` in an installed copy."""
    folder = checkout_folder()
    if folder is None:
        command = f"run `pip install -e .` in {kit_folder_text()}"
        raise DataError(f"this copy of the library lacks the folder {name}: {command}")
    return folder / name
