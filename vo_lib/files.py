"""Reading files with clear errors; writing them so that a reader never meets a half-written one."""

from __future__ import annotations

import csv
import hashlib
import io
import json
import os
import threading
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from filelock import FileLock, Timeout
from numpy.typing import NDArray

from .errors import DataError

LOCK = ".lock"
DRAFT = ".tmp"  # how the name of a half-written file ends


@contextmanager
def opened(path: str | Path) -> Iterator[BinaryIO]:
    """A file opened to be read; `DataError` where it is missing, a folder, or unreadable."""
    try:
        with open(path, "rb") as file:
            yield file
    except FileNotFoundError:
        raise DataError("the file is missing", path) from None
    except IsADirectoryError:
        raise DataError("is a folder, expected a file", path) from None
    except OSError as error:
        raise DataError(f"cannot be read: {error.strerror}", path) from None


def read_bytes(path: str | Path) -> bytes:
    """Content of a file; raises as `opened`."""
    with opened(path) as file:
        return file.read()


def read_text(path: str | Path) -> str:
    """Text of a UTF-8 file, line ends as \\n; `DataError` where it is missing, unreadable or not text."""
    data = read_bytes(path)
    try:
        return data.decode("utf-8-sig").replace("\r\n", "\n").replace("\r", "\n")
    except UnicodeDecodeError:
        raise DataError("is not a text file", path) from None


def read_mapping(path: str | Path, expected: str) -> dict[str, Any]:
    """The object in a JSON file; `DataError` saying what was `expected` where there is anything else."""
    try:
        data = json.loads(read_text(path))
    except (ValueError, RecursionError) as error:
        raise DataError(f"is not JSON: expected {expected}", path, getattr(error, "lineno", None)) from None
    if not isinstance(data, dict):
        raise DataError(f"expected {expected}", path)
    return data


def read_csv(path: str | Path) -> list[tuple[int, list[str]]]:
    """Rows of cells of a CSV file, each with the line it ends in; empty ones and those with # are left out.

    Raises `DataError` with file and line where it is no CSV.
    """
    reader = csv.reader(io.StringIO(read_text(path)))
    rows = []
    try:
        for cells in reader:
            if any(cell.strip() for cell in cells) and not cells[0].startswith("#"):
                rows.append((reader.line_num, cells))
    except csv.Error as error:
        raise DataError(f"is no CSV: {error}", path, reader.line_num) from None
    return rows


def read_arrays(data: bytes) -> dict[str, NDArray[Any]]:
    """The arrays of an npz file's bytes; `ValueError` where they are no such file."""
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as found:
            return {name: found[name] for name in found.files}
    except Exception as error:  # those of zip files, of their compressions and of numpy share no other base
        raise ValueError(f"no arrays: {error}") from None


@contextmanager
def only_process(folder: Path) -> Iterator[None]:
    """A context in which no other process works in the folder; the lock ends with the process.

    Half-written files of processes that were killed are removed.
    """
    lock = FileLock(folder / LOCK, timeout=0)
    try:
        lock.acquire()
    except Timeout:
        raise DataError("another process is working in this folder", folder) from None
    try:
        for draft in folder.glob(f".*.*.*{DRAFT}"):
            draft.unlink(missing_ok=True)
        yield
    finally:
        # Removed while it is held: whoever waits for it sees that the name is gone, and starts over.
        with suppress(OSError):
            (folder / LOCK).unlink()
        lock.release()


@contextmanager
def writing(path: str | Path) -> Iterator[BinaryIO]:
    """A binary file to be written under a temporary name beside `path`, which it takes at the end.

    `path` is the old file or the new one, whole. Raises `DataError` where the folder is missing, not writable
    or full.
    """
    path = Path(path)
    draft = path.with_name(f".{path.name}.{os.getpid()}.{threading.get_ident()}{DRAFT}")
    try:
        try:
            with open(draft, "wb") as file:
                yield file
                file.flush()
                os.fsync(file.fileno())  # some file systems report a full disk only here
            os.replace(draft, path)
        finally:
            draft.unlink(missing_ok=True)
    except OSError as error:
        raise DataError(f"cannot be written: {error.strerror}", path) from error


def write_atomic(path: str | Path, data: bytes | str) -> None:
    """Write bytes or UTF-8 text to `path`, whole or not at all, as `writing` does; line ends are kept.

    A character without UTF-8 form, such as a byte of a file's name, becomes a question mark.
    """
    with writing(path) as file:
        file.write(data.encode("utf-8", "replace") if isinstance(data, str) else data)


def csv_text(rows: Iterable[Sequence[object]]) -> str:
    """Rows of cells, the heading first, as CSV with one kind of line end."""
    buffer = io.StringIO()
    csv.writer(buffer, lineterminator="\n").writerows(rows)
    return buffer.getvalue()


def file_sha256(path: str | Path) -> str:
    """SHA-256 of a file, 64 hexadecimal digits; raises as `opened`."""
    digest = hashlib.sha256()
    with opened(path) as file:
        while data := file.read(1 << 18):
            digest.update(data)
    return digest.hexdigest()
