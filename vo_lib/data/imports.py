"""Where sequences of the user's own were imported to, so that `vo list` finds them."""

from __future__ import annotations

import hashlib
from pathlib import Path

from ..errors import DataError
from ..files import read_text, write_atomic
from .drawn import cache_folder, make_cache_folder
from .kitti import has_images


def remember_import(folder: Path) -> None:
    """Remember the folder of an imported sequence; nothing happens if the cache cannot be written."""
    path = str(folder.absolute())
    digest = hashlib.sha256(path.encode("utf-8", "surrogateescape")).hexdigest()[:16]
    # A file for each folder: two imports at the same time do not disturb each other.
    record = record_folder() / f"{digest}.txt"
    try:
        make_cache_folder(record.parent)
        write_atomic(record, path)
    except DataError:
        return


def imported_folders() -> list[Path]:
    """The folders of imported sequences that still exist, sorted."""
    folders = map(_folder_of, record_folder().glob("*.txt"))
    return sorted(folder for folder in folders if folder is not None)


def _folder_of(record: Path) -> Path | None:
    """The folder that a record names, if it still has a sequence."""
    try:
        folder = Path(read_text(record))
        exists = folder.is_absolute() and has_images(folder)
    except (DataError, OSError, ValueError):  # a record that was damaged, or a folder that is closed
        return None
    return folder if exists else None


def record_folder() -> Path:
    """The folder with a file for each imported sequence, which has the path of its folder."""
    return cache_folder() / "imported"
