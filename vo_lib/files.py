"""Reading of files with clear errors, and atomic writing: a reader never sees a partly written file."""

from __future__ import annotations

import csv
import hashlib
import io
import json
import os
import secrets
import shutil
from collections.abc import Callable, Iterable, Iterator, Sequence
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
    try:
        text = read_bytes(path).decode("utf-8-sig")
    except UnicodeDecodeError:
        text = "\0"
    if "\0" in text:  # so it is in UTF-16 without a mark, which often decodes as UTF-8
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


def read_csv(path: str | Path) -> list[tuple[int, list[str]]]:
    """Rows of a CSV file, each with the number of its last line; empty rows and comments (#) are skipped.

    Raises `DataError` with file and line if the file is not CSV.
    """
    reader = csv.reader(io.StringIO(read_text(path)))
    try:
        return [(reader.line_num, cells) for cells in reader if cells and not cells[0].startswith("#")]
    except csv.Error as error:
        raise DataError(f"is not CSV: {error}", path, reader.line_num) from None


def read_yaml(path: str | Path) -> dict[str, Any]:
    """The mapping in a YAML file, or {} for other content; `DataError` for a file that is not YAML."""
    import yaml  # the library reads no YAML when a run starts

    try:
        content = yaml.safe_load(read_text(path))
    # PyYAML raises these errors also for invalid dates and for deep nesting.
    except (yaml.YAMLError, ValueError, TypeError, AttributeError, RecursionError) as error:
        mark = getattr(error, "problem_mark", None)
        raise DataError("is not YAML", path, mark and mark.line + 1) from None
    return content if isinstance(content, dict) else {}


@contextmanager
def only_process(folder: Path, waiting: Callable[[Path], None] | None = None) -> Iterator[None]:
    """A lock on a folder for this process. If the process ends, the operating system releases the lock.

    Drafts of files that a killed process has left in the folder are deleted. One with a lock of its own
    (`locked_draft`) stays.

    waiting : called with the folder, once, if another process has the lock; the context then begins when that
        process ends. Without `waiting`, such a lock raises `DataError`.
    """
    lock = FileLock(folder / LOCK)
    try:
        lock.acquire(timeout=0)
    except Timeout:
        if waiting is None:
            raise DataError("another process is working in this folder", folder) from None
        waiting(folder)
        lock.acquire()
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


@contextmanager
def written_together(folder: Path) -> Iterator[Path]:
    """A temporary folder, whose files replace those of `folder` one by one when the context ends.

    Every file is complete on the disk before the first one is replaced, so on a full disk the files from
    before remain. A file whose name ends with `DRAFT` is the mark of a complete result: it is the last one,
    and gets its name without the ending only then. Raises `DataError` like `write_atomic`.
    """
    with locked_draft(folder / "results") as draft:
        draft.mkdir()
        yield draft
        for name in sorted(os.listdir(draft), key=lambda name: (name.endswith(DRAFT), name)):
            os.replace(draft / name, folder / name.removesuffix(DRAFT))


def refuse_foreign(folder: Path, names: Iterable[str], own: bool) -> None:
    """Raise `DataError` with the first file that a result would replace in a folder that is not the kit's.

    own : whether the folder has results of the kit; a folder with the lock of a process is the kit's too.
    """
    there = [name for name in names if os.path.lexists(folder / name)]
    if there and not own and not (folder / LOCK).exists():
        raise DataError("is not the kit's file: choose another folder for the results", folder / there[0])


def csv_text(rows: Iterable[Sequence[object]]) -> str:
    """CSV text of rows, the first of which is the heading; the line ending is \\n."""
    buffer = io.StringIO()
    csv.writer(buffer, lineterminator="\n").writerows(rows)
    return buffer.getvalue()


def file_sha256(path: str | Path) -> str:
    """SHA-256 of a file, 64 hexadecimal digits; raises like `open_binary`."""
    with open_binary(path) as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
