"""Reading files with clear errors; writing them so that a reader never meets a half-written one."""

from __future__ import annotations

import csv
import hashlib
import io
import json
import math
import os
import stat
import threading
import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from filelock import FileLock, Timeout
from numpy.typing import NDArray

from .errors import DataError

LOCK = ".lock"
WRITTEN = ".written_by_vo"  # in a folder of results: names of the files there that the kit wrote, one a line
ABANDONED = 60.0  # seconds; no write takes so long
NUMBER = (int, float)


@contextmanager
def opened(path: str | Path) -> Iterator[BinaryIO]:
    """A file opened to be read; `DataError` where it is missing, unreadable, a folder, a pipe or a device."""
    try:
        # Looked at before it is opened: a pipe would wait for ever, a device may never end.
        kind = os.stat(path).st_mode
        if not stat.S_ISREG(kind):
            raise DataError(f"is {'a folder' if stat.S_ISDIR(kind) else 'no file'}, expected a file", path)
        with open(path, "rb") as file:
            yield file
    except FileNotFoundError:
        raise DataError("the file is missing", path) from None
    except OSError as error:
        raise DataError(f"cannot be read: {error.strerror}", path) from None
    except ValueError:  # a NUL character in it
        raise DataError("no file can be called so", path) from None


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


def parse_json(text: str) -> Any:
    """What a JSON text holds; `ValueError` where it is not JSON, too deep, or a number is not finite."""

    def finite(word: str) -> float:
        if not math.isfinite(value := float(word)):
            raise ValueError(f"{word[:20]} is not a finite number")
        return value

    def whole(word: str) -> int:
        finite(word)  # no more digits than a float can have
        return int(word)

    try:
        return json.loads(text, parse_float=finite, parse_int=whole, parse_constant=finite)
    except RecursionError:
        raise ValueError("is nested too deep") from None


def fits(value: Any, shape: Any) -> bool:
    """Whether what JSON or YAML holds has a shape.

    A shape is a type, a tuple of types, `{"name": shape}` for a mapping with these names and perhaps more,
    `{str: shape}` for one with any names, or `[shape]` for a list of any length. A bool is no number.
    """
    if isinstance(shape, dict):
        if not isinstance(value, dict):
            return False
        if str in shape:
            return all(isinstance(name, str) and fits(entry, shape[str]) for name, entry in value.items())
        return all(name in value and fits(value[name], entry) for name, entry in shape.items())
    if isinstance(shape, list):
        return isinstance(value, list) and all(fits(entry, shape[0]) for entry in value)
    kinds = shape if isinstance(shape, tuple) else (shape,)
    return type(value) in kinds or Any in kinds


def read_json(path: str | Path, shape: Any, expected: str) -> Any:
    """What a JSON file holds; `DataError` saying what was `expected` where it has not the shape of `fits`."""
    text = read_text(path)
    try:
        data = parse_json(text)
    except ValueError as error:
        line = getattr(error, "lineno", None)
        raise DataError(f"is not JSON: expected {expected}", path, line) from None
    if not fits(data, shape):
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
    """A context in which no other process works in the folder; the system's lock ends with the process."""
    lock = FileLock(folder / LOCK, timeout=0)
    try:
        lock.acquire()
    except Timeout:
        raise DataError("another process is working in this folder", folder) from None
    except (OSError, NotImplementedError) as error:
        raise DataError(f"the folder cannot be locked: {error}", folder) from None
    try:
        _clear_abandoned(folder)
        yield
    finally:
        # Removed while it is held: whoever waits for it sees that the name is gone, and starts over.
        with suppress(OSError):
            (folder / LOCK).unlink()
        lock.release()


def _clear_abandoned(folder: Path) -> None:
    """Remove the half-written files of processes that were killed."""
    with suppress(OSError):
        for left in folder.glob(".*.tmp"):
            if time.time() - left.stat().st_mtime > ABANDONED:
                left.unlink()


def write_bytes_atomic(path: str | Path, data: bytes) -> None:
    """Write `data` to `path` by way of a temporary name beside it: the file is the old one or the new, whole.

    Raises `DataError` where the folder is missing, not writable or full; `path` is then as it was before.
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
    """`write_bytes_atomic` of UTF-8 text; line ends stay as they are on every system.

    What is no letter, such as bytes of a file's name that are not UTF-8, becomes a question mark.
    """
    write_bytes_atomic(path, text.encode("utf-8", "replace"))


def require_own(*paths: Path) -> None:
    """`DataError` naming the first of these files that is there and that the kit did not write."""
    for path in paths:
        if path.name.encode("utf-8", "replace") not in _written(path.parent) and os.path.lexists(path):
            raise DataError("is not the kit's, which does not replace it: choose another place", path)


def claim(*paths: Path) -> None:
    """Note these files as the kit's own, to be written and replaced from now on."""
    for path in paths:
        name = path.name.encode("utf-8", "replace")
        if name in _written(path.parent):
            continue
        try:
            # Before the file: killed in between, no file of the kit's is taken for somebody else's.
            # Short lines are appended whole, whoever else does so at the same time.
            with open(path.with_name(WRITTEN), "ab", buffering=0) as ledger:
                ledger.write(name + b"\n")
        except OSError as error:
            raise DataError(f"cannot be written: {error.strerror}", path) from error


def _written(folder: Path) -> frozenset[bytes]:
    ledger = folder / WRITTEN
    return frozenset(read_bytes(ledger).split(b"\n")) if ledger.exists() else frozenset()


def write_result(path: Path, data: bytes | str) -> None:
    """Write a file into a folder of the user's, whole or not at all; what the kit did not write stays.

    Raises `DataError` as `require_own` and `write_bytes_atomic` do.
    """
    require_own(path)
    claim(path)
    write_bytes_atomic(path, data.encode("utf-8", "replace") if isinstance(data, str) else data)


def csv_text(rows: Iterable[Sequence[object]]) -> str:
    """Rows of cells, the heading first, as CSV with one kind of line end."""
    buffer = io.StringIO()
    csv.writer(buffer, lineterminator="\n").writerows(rows)
    return buffer.getvalue()


def written_at(path: Path) -> int:
    """When a file was last written, nanoseconds; -1 where there is none."""
    try:
        return path.stat().st_mtime_ns
    except (FileNotFoundError, NotADirectoryError):
        return -1


def file_sha256(path: str | Path) -> str:
    """SHA-256 of a file, 64 hexadecimal digits; raises as `opened`."""
    digest = hashlib.sha256()
    with opened(path) as file:
        while data := file.read(1 << 18):
            digest.update(data)
    return digest.hexdigest()
