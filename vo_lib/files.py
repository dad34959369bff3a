"""Reading of files with clear errors, and atomic writing: a reader never sees a partly written file."""

from __future__ import annotations

import hashlib
import io
import json
import os
import secrets
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from filelock import FileLock, Timeout

from .errors import DataError

LOCK = ".lock"  # name, in a folder, and ending of the name, beside a draft, of the file that shows its use
DRAFT = ".vo_draft"  # ending of the name of a partly written file or folder


@contextmanager
def open_binary(path: str | Path) -> Iterator[io.BufferedReader]:
    """A file open for reading; `DataError` if the file is missing, not a file on a disk, or unreadable.

    An `OSError` inside the context counts as one of reading this file. So code in this context that writes
    another file does it with `write_atomic`, whose errors are `DataError` and name that file.
    """
    try:
        # Before the file is opened: a pipe without a writer would wait, and a device may have no end.
        if not Path(path).exists():
            raise DataError("the file is missing", path)
        if not Path(path).is_file():
            raise DataError("is a folder or a device, expected a file", path)
        with open(path, "rb") as file:
            yield file
    except OSError as error:
        raise DataError(f"cannot be read: {error.strerror}", path) from None


def read_bytes(path: str | Path) -> bytes:
    """Content of a file; raises like `open_binary`."""
    with open_binary(path) as file:
        return file.read()


def read_text(path: str | Path) -> str:
    """Text of a file in UTF-8, with line ending \\n; `DataError` for other content, such as UTF-16."""
    text = read_bytes(path).decode("utf-8-sig", "replace")
    # Zeros are those of UTF-16 without a mark, which often decodes as UTF-8.
    if "\0" in text or "\ufffd" in text:
        raise DataError("is not a text file in UTF-8", path)
    return text.replace("\r\n", "\n").replace("\r", "\n")


def read_mapping(path: str | Path, expected: str) -> dict[str, Any]:
    """The object in a JSON file. Any other content raises `DataError` with the text `expected`."""
    try:
        data = json.loads(read_text(path))
    except (ValueError, RecursionError) as error:
        raise DataError(f"is not JSON: expected {expected}", path, getattr(error, "lineno", None)) from None
    if not isinstance(data, dict):
        raise DataError(f"expected {expected}", path)
    return data


@contextmanager
def only_process(folder: Path) -> Iterator[None]:
    """A lock on a folder for this process. If the process ends, the operating system releases the lock.

    Raises `DataError` if another process has the lock. Drafts of files that a killed process has left in the
    folder are deleted. One with a lock of its own (`locked_draft`) stays.
    """
    lock = FileLock(folder / LOCK)
    try:
        lock.acquire(timeout=0)
    except Timeout:
        raise DataError("another process is working in this folder: wait until it ends", folder) from None
    try:
        for draft in folder.glob(f".*{DRAFT}"):
            if draft.is_file() and not Path(f"{draft}{LOCK}").exists():
                draft.unlink()
        yield
    finally:
        _delete(folder / LOCK)  # before the release: a waiting process then finds no file and tries again
        lock.release()


@contextmanager
def locked_draft(path: Path) -> Iterator[Path]:
    """A temporary name for a file or folder `path` that takes long to write, deleted at the end.

    A lock shows that this process uses the draft. Drafts in the same folder whose process was killed are
    deleted first. An `OSError` inside the context becomes a `DataError` on `path`.
    """
    for lock_file in path.parent.glob(f".*{DRAFT}{LOCK}"):
        with suppress(OSError), FileLock(lock_file, timeout=0):
            _delete(lock_file.with_suffix(""))
            _delete(lock_file)
    with _draft_of(path) as draft, FileLock(f"{draft}{LOCK}"):
        yield draft


@contextmanager
def _draft_of(path: Path) -> Iterator[Path]:
    """A temporary name for a file or folder, deleted at the end; an `OSError` becomes a `DataError`."""
    draft = path.with_name(f".{path.name}.{secrets.token_hex(4)}{DRAFT}")
    try:
        yield draft
    except OSError as error:
        raise DataError(f"cannot be written: {error.strerror}", path) from error
    finally:
        _delete(draft)
        _delete(Path(f"{draft}{LOCK}"))


def _delete(path: Path) -> None:
    """Delete a file, or a folder with its files, as far as possible; of a link, the link alone."""
    shutil.rmtree(path, ignore_errors=True)
    with suppress(OSError):
        path.unlink()


def write_atomic(path: str | Path, data: bytes | str) -> None:
    """Write bytes or UTF-8 text to `path`, completely or not at all; line endings are kept.

    A character without a UTF-8 form, such as an undecodable byte of a file name, becomes a question mark.
    Raises `DataError` if the folder is missing, not writable or full.
    """
    with _draft_of(Path(path)) as draft:
        with open(draft, "wb") as file:
            file.write(data.encode("utf-8", "replace") if isinstance(data, str) else data)
            file.flush()
            os.fsync(file.fileno())  # some file systems report a full disk only here
        os.replace(draft, path)


def file_sha256(path: str | Path) -> str:
    """SHA-256 of a file, 64 hexadecimal digits; raises like `open_binary`."""
    return hashlib.sha256(read_bytes(path)).hexdigest()
