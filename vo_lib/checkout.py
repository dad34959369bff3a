"""The kit's own folder, with the notebooks and the data scripts, where the kit is installed in place."""

from __future__ import annotations

import json
import re
import tomllib
from importlib import metadata
from pathlib import Path
from urllib.parse import urlsplit
from urllib.request import url2pathname

from .errors import DataError

DISTRIBUTION = "stereo-vo-kit"
SCRIPTS = "data_scripts"


def checkout_folder() -> Path | None:
    """The kit's own folder, if this package lies in it, or None for an installed copy."""
    folder = Path(__file__).resolve().parents[1]
    return folder if _is_kit(folder) else None


def _is_kit(folder: Path) -> bool:
    """Whether a folder is the kit's, by its pyproject.toml; a copy may lie in the folder of any project."""
    try:
        project = tomllib.loads((folder / "pyproject.toml").read_text(encoding="utf-8"))["project"]
        name = str(project["name"])
    except (OSError, ValueError, KeyError, TypeError):
        return False
    return re.sub(r"[-_.]+", "-", name).lower() == DISTRIBUTION


def kit_subfolder(name: str) -> Path:
    """The folder `name` beside the package, such as "notebooks".

    Raises `DataError` if the package is an installed copy, since `pip install .` copies the library alone.
    """
    folder = _folder_beside(name)
    if folder is None:
        raise DataError(missing_folder_text(name))
    return folder


def _folder_beside(name: str) -> Path | None:
    """The folder `name` of the kit's own folder; None if one of the two is missing."""
    checkout = checkout_folder()
    if checkout is None or not (checkout / name).is_dir():
        return None
    return checkout / name


def missing_folder_text(name: str) -> str:
    """What to say where an installed copy lacks the folder `name`: that it does, and how to get it."""
    return f"this copy of the library lacks the folder {name}: run {_install_in_place()}"


def with_install_hint(words: str, folder: str = SCRIPTS) -> str:
    """Words that name a command which needs a folder of the kit, by default that of the commands `vo data`.

    An installed copy, which lacks the folder, adds what must be done before.
    """
    return words if _folder_beside(folder) else f"{words} (after {_install_in_place()})"


def _install_in_place() -> str:
    """The command that installs the kit with all of its folders, and where to run it."""
    return f"`pip install -e .` in {kit_folder_text()}"


def kit_folder_text() -> str:
    """The folder from which pip has installed the copy, or words for it if that is not known or gone."""
    in_words = "the kit's folder (the one with README.md)"
    try:
        text = metadata.distribution(DISTRIBUTION).read_text("direct_url.json")
    except metadata.PackageNotFoundError:
        return in_words
    if text is None:
        return in_words
    origin = json.loads(text)
    address = urlsplit(origin["url"])
    # A wheel is a file, and no folder to install again from.
    if address.scheme != "file" or "dir_info" not in origin:
        return in_words
    folder = url2pathname(address.path)
    if _is_kit(Path(folder)):
        return folder
    return f"the kit's folder (the one with README.md, which is no longer {folder})"
