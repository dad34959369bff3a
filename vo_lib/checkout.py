"""The kit's own folder, with the notebooks and the data scripts, where the kit is installed in place."""

from __future__ import annotations

import json
from importlib import metadata
from pathlib import Path
from urllib.parse import urlsplit
from urllib.request import url2pathname

from .errors import DataError

DISTRIBUTION = "stereo-vo-kit"


def checkout_folder() -> Path | None:
    """The folder with pyproject.toml that this package lies in, or None for an installed copy."""
    folder = Path(__file__).resolve().parents[1]
    return folder if (folder / "pyproject.toml").is_file() else None


def folder_of_checkout(name: str) -> Path:
    """The folder `name` beside the package, such as "notebooks".

    Raises `DataError` if the package is an installed copy, since `pip install .` copies the library alone.
    """
    checkout = checkout_folder()
    if checkout is None:
        raise DataError(missing_folder_text(name))
    return checkout / name


def missing_folder_text(name: str) -> str:
    """What to say where an installed copy lacks the folder `name`: that it does, and how to get it."""
    return f"this copy of the library lacks the folder {name}: run `pip install -e .` in {_source()}"


def _source() -> str:
    """The folder from which pip has installed the copy, or words for it if pip has not written it down."""
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
    is_folder = address.scheme == "file" and "dir_info" in origin
    return url2pathname(address.path) if is_folder else in_words
