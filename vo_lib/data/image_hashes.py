"""SHA-256 of the images of a sequence; the user's cache folder stores the hashes of images seen before."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path

from ..errors import DataError
from ..files import file_sha256, read_mapping, write_atomic
from .drawn import cache_folder, make_cache_folder


def hash_folder() -> Path:
    """The folder of the stored hashes of images."""
    return cache_folder() / "hashes"


def image_hashes(folder: Path, names: Iterable[str]) -> dict[str, str]:
    """SHA-256 of the images with these names in a folder, by name such as "image_0/000000.png".

    Each image is hashed once. A JSON file per sequence stores the hashes. Their key is a stamp, "name size
    time", so an image that was changed since is hashed again.

    Raises `DataError` for an image that cannot be read.
    """
    folder = folder.resolve()
    stamps: dict[str, str] = {}
    for name in names:
        try:
            stat = (folder / name).stat()
        except OSError as error:
            raise DataError(f"the image cannot be read: {error.strerror}", error.filename) from None
        stamps[name] = f"{name} {stat.st_size} {stat.st_mtime_ns}"
    folder_digest = hashlib.sha256(os.fsencode(folder)).hexdigest()[:16]
    hash_file = hash_folder() / f"{folder_digest}.json"
    hashes = _read_hashes(hash_file)
    new_hashes = {stamp: file_sha256(folder / name) for name, stamp in stamps.items() if stamp not in hashes}
    if new_hashes:
        hashes |= new_hashes
        with suppress(OSError, DataError):  # without a cache, the images are hashed again in the next run
            make_cache_folder(hash_file.parent)
            stored_meanwhile = _read_hashes(hash_file)  # by another process
            write_atomic(hash_file, json.dumps(stored_meanwhile | hashes))
    return {name: hashes[stamp] for name, stamp in stamps.items()}


def _read_hashes(path: Path) -> dict[str, str]:
    """The stored hashes of images by stamp; empty without a valid file of hashes."""
    with suppress(DataError):
        return read_mapping(path, "hashes")
    return {}
