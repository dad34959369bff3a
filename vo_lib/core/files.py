"""Reading text with clear errors; writing files so that a reader never meets a half-written one."""

from __future__ import annotations

import csv
import hashlib
import io
import os
import threading
from collections.abc import Iterable, Sequence
from pathlib import Path

from .errors import DataError


def read_text(path: str | Path) -> str:
    """Text of a UTF-8 file; `DataError` where it is missing, unreadable or not text."""
    try:
        return Path(path).read_text(encoding="utf-8-sig")
    except FileNotFoundError:
        raise DataError("the file is missing", path) from None
    except UnicodeDecodeError:
        raise DataError("is not a text file", path) from None
    except OSError as error:
        raise DataError(f"cannot be read: {error.strerror}", path) from None


def write_bytes_atomic(path: str | Path, data: bytes) -> None:
    """Write `data` to `path`: afterwards the file is either the old one or the new one, whole.

    The bytes go to a temporary name in the same folder, which then replaces `path`.

    Raises
    ------
    DataError : the folder is missing, not writable or full; `path` is then as it was before.
    """
    path = Path(path)
    temporary = path.with_name(f".{path.name}.{os.getpid()}.{threading.get_ident()}.tmp")
    try:
        try:
            with open(temporary, "wb") as file:
                file.write(data)
                file.flush()
                # Some file systems report a full disk only here.
                os.fsync(file.fileno())
            os.replace(temporary, path)
        finally:
            temporary.unlink(missing_ok=True)
    except OSError as error:
        raise DataError(f"cannot be written: {error.strerror}", path) from error


def write_text_atomic(path: str | Path, text: str) -> None:
    """`write_bytes_atomic` of UTF-8 text; line ends stay as they are on every system."""
    write_bytes_atomic(path, text.encode("utf-8"))


def csv_text(rows: Iterable[Sequence[object]]) -> str:
    """Rows of cells, the heading first, as CSV with one kind of line end."""
    buffer = io.StringIO()
    csv.writer(buffer, lineterminator="\n").writerows(rows)
    return buffer.getvalue()


def file_sha256(path: Path) -> str:
    """SHA-256 of a file, 64 hexadecimal digits."""
    digest = hashlib.sha256()
    try:
        with open(path, "rb") as file:
            while data := file.read(1 << 18):
                digest.update(data)
    except OSError as error:
        raise DataError(f"cannot be read: {error.strerror}", path) from None
    return digest.hexdigest()
