"""Reading of files with clear errors, and atomic writing: a reader never sees a partly written file."""

from __future__ import annotations

import codecs
import csv
import hashlib
import io
import json
import os
import re
import shutil
import stat
import threading
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, BinaryIO

from filelock import FileLock, Timeout

from .errors import DataError

LOCK = ".lock"  # ending of the name of a file that shows that a process uses another file or folder
DRAFT = ".tmp"  # ending of the name of a partly written file
# A name from `_draft_of`, with the name of the file or folder that the draft is for.
DRAFT_NAME = re.compile(r"\.(.+)\.\d+\.\d+" + re.escape(DRAFT))
LOCK_POLL_S = 0.2  # interval at which a waiting process tries the lock again


@contextmanager
def open_binary(path: str | Path) -> Iterator[io.BufferedReader]:
    """A file open for reading; `DataError` if the file is missing, not a file on a disk, or unreadable.

    An `OSError` inside the context counts as one of reading this file. So code in this context that writes
    another file does it with `writing`, whose errors are `DataError` and name that file.
    """
    try:
        # Before the file is opened: a pipe without a writer would wait, and a device may have no end.
        mode = os.stat(path).st_mode
        if not stat.S_ISREG(mode) and not stat.S_ISDIR(mode):
            raise DataError("is a pipe or a device, expected a file", path)
        with open(path, "rb") as file:
            yield file
    except FileNotFoundError:
        raise DataError("the file is missing", path) from None
    except IsADirectoryError:
        raise DataError("is a folder, expected a file", path) from None
    except OSError as error:
        raise DataError(f"cannot be read: {error.strerror}", path) from None
    except ValueError:  # a zero byte in the name
        raise DataError("is not the name of a file", path) from None


def read_bytes(path: str | Path) -> bytes:
    """Content of a file; raises like `open_binary`."""
    with open_binary(path) as file:
        return file.read()


def read_text(path: str | Path) -> str:
    """Text of a file in UTF-8 or UTF-16, with line ending \\n; `DataError` for a file without such text."""
    data = read_bytes(path)
    try:
        return data.decode(_encoding(data)).replace("\r\n", "\n").replace("\r", "\n")
    except UnicodeDecodeError:
        raise DataError("is not a text file", path) from None


def _encoding(data: bytes) -> str:
    """The encoding of a text: by its byte order mark or, in UTF-16 without a mark, by its zero bytes."""
    if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return "utf-16"
    if len(data) >= 2 and len(data) % 2 == 0:
        # The first character of a table or of a setting is in ASCII, so exactly one of its two bytes is zero.
        first_is_zero = data[0] == 0
        second_is_zero = data[1] == 0
        if second_is_zero and not first_is_zero:
            return "utf-16-le"
        if first_is_zero and not second_is_zero:
            return "utf-16-be"
    return "utf-8-sig"


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

    text = read_text(path)
    try:
        content = yaml.safe_load(text)
    # PyYAML raises these errors also for invalid dates and for deep nesting.
    except (yaml.YAMLError, ValueError, TypeError, AttributeError, RecursionError) as error:
        mark = getattr(error, "problem_mark", None)
        raise DataError("is not YAML", path, None if mark is None else mark.line + 1) from None
    return content if isinstance(content, dict) else {}


@contextmanager
def only_process(folder: Path, waiting: Callable[[Path], None] | None = None) -> Iterator[None]:
    """A lock on a folder for this process. If the process ends, the operating system releases the lock.

    Drafts that killed processes have left in the folder are deleted. A draft that another process holds by a
    lock of its own (`locked_draft`) stays, such as a film of the run.

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
        lock.acquire(poll_interval=LOCK_POLL_S)
    try:
        delete_abandoned_drafts(folder)
        # Those without a lock of their own are written in moments, so one that is still here was left behind.
        for draft in folder.iterdir():
            if DRAFT_NAME.fullmatch(draft.name) and not _lock_of(draft).exists():
                delete_tree(draft)
        yield
    finally:
        # The file is removed before the release: a waiting process then finds no file and tries again.
        with suppress(OSError):
            (folder / LOCK).unlink()
        lock.release()


@contextmanager
def writing(path: str | Path, locked: bool = False) -> Iterator[BinaryIO]:
    """A binary file for writing, with a temporary name in the folder of `path` until the context ends.

    `path` always has the complete old or the complete new content. Raises `DataError` if the folder is
    missing, not writable or full.

    locked : for a file that takes long to write; the draft of a killed process is then deleted by a later one
        (see `locked_draft`).
    """
    path = Path(path)
    make_draft = locked_draft if locked else _short_draft
    try:
        with make_draft(path) as draft:
            with open(draft, "wb") as file:
                yield file
                file.flush()
                os.fsync(file.fileno())  # some file systems report a full disk only here
            os.replace(draft, path)
    except OSError as error:
        raise DataError(f"cannot be written: {error.strerror}", path) from error


def _draft_of(path: Path) -> Path:
    """The temporary name of a file or folder `path` that this thread writes."""
    return path.with_name(f".{path.name}.{os.getpid()}.{threading.get_ident()}{DRAFT}")


@contextmanager
def _short_draft(path: Path) -> Iterator[Path]:
    """A temporary name for a file `path`, deleted at the end."""
    draft = _draft_of(path)
    try:
        yield draft
    finally:
        _delete([draft])


@contextmanager
def locked_draft(path: Path) -> Iterator[Path]:
    """A temporary name for a file or folder `path`, deleted at the end, with a lock that shows its use.

    If the process is killed, the draft stays, but the operating system releases the lock. So a later process
    can tell that nobody uses the draft, and `delete_abandoned_drafts` deletes it.
    """
    draft = _draft_of(path)
    lock = FileLock(_lock_of(draft))
    with lock:
        try:
            yield draft
        finally:
            delete_tree(draft)
            _delete([_lock_of(draft)])


def _lock_of(draft: Path) -> Path:
    """The file with the lock of a draft, beside it."""
    return draft.with_name(draft.name + LOCK)


def delete_with_size(path: Path) -> int:
    """`delete_tree`, which returns the number of bytes."""
    size = folder_size(path)
    delete_tree(path)
    return size


def delete_abandoned_drafts(
    folder: Path, name: str | None = None, delete: Callable[[Path], int] = delete_with_size
) -> int:
    """Delete the drafts of killed processes (see `locked_draft`) in a folder; return the number of bytes.

    name : the name of the file or folder that the drafts were for; None for any.
    delete : deletes a draft and returns the number of bytes.
    """
    size = 0
    for lock_file in folder.glob(f".*{DRAFT}{LOCK}"):
        draft = lock_file.with_name(lock_file.name.removesuffix(LOCK))
        found = DRAFT_NAME.fullmatch(draft.name)
        if found is None or name not in (None, found[1]):
            continue
        lock = FileLock(lock_file)
        with suppress(Timeout, OSError):  # in use, or just deleted by another process
            lock.acquire(timeout=0)
            size += delete(draft)
            _delete([lock_file])
        lock.release()
    return size


def folder_size(path: Path) -> int:
    """Size in bytes of a file, or of all files in a folder; 0 if there is none."""
    if not path.is_dir():
        return path.stat().st_size if path.is_file() else 0
    return sum(file.stat().st_size for file in path.rglob("*") if file.is_file())


@contextmanager
def written_together(
    folder: Path, last: str = "", stale: Iterable[str] = (), own: bool = True
) -> Iterator[Path]:
    """A temporary folder, whose files replace those of `folder` when the context ends: all of them, or none.

    Every file is complete on the disk before the first one is replaced, so on a full disk the files from
    before remain. If one of them cannot be replaced, those before it are put back. Only a process that is
    killed while it replaces them leaves files of both results, each of them whole; `last` is then that of the
    earlier result, if there was one. Raises `DataError` like `writing`.

    last : name of the file that is replaced last, the mark of a complete result. In the temporary folder, it
        is written with the ending `DRAFT`, so that a search for complete results does not find it there.
    stale : names of files of an earlier result that are deleted, just before `last` is replaced.
    own : whether files in `folder` may be replaced (see `refuse_foreign`).
    """
    draft = _draft_of(folder / "results")
    try:
        draft.mkdir()
        yield draft
        others = sorted(name for name in os.listdir(draft) if name != last + DRAFT)
        names = [*others, last] if last else others
        refuse_foreign(folder, names, own)
        stale = list(stale)
        with _kept_on_error(folder, [*names, *stale]):
            for name in others:
                os.replace(draft / name, folder / name)
            _delete(folder / name for name in stale)
            if last:
                os.replace(draft / (last + DRAFT), folder / last)
    except OSError as error:
        raise DataError(f"cannot be written: {error.strerror}", folder) from error
    except DataError as error:
        raise DataError(str(error).replace(str(draft), str(folder))) from error
    finally:
        shutil.rmtree(draft, ignore_errors=True)


@contextmanager
def _kept_on_error(folder: Path, names: Iterable[str]) -> Iterator[None]:
    """A context that may replace, make or delete the files of these names; an exception undoes that.

    Until the context ends, the files from before also have names in a temporary folder.
    """
    earlier_files = _draft_of(folder / "earlier")
    earlier_of = {name: earlier_files / (name + DRAFT) for name in names}
    try:
        earlier_files.mkdir()
        for name, earlier in earlier_of.items():
            if os.path.lexists(folder / name):
                _link_or_copy(folder / name, earlier)
        try:
            yield
        except BaseException:
            for name, earlier in earlier_of.items():
                if os.path.lexists(earlier):
                    with suppress(OSError):  # of the file that could not be replaced: it is as before
                        os.replace(earlier, folder / name)
                else:
                    _delete([folder / name])
            raise
    finally:
        shutil.rmtree(earlier_files, ignore_errors=True)


def _link_or_copy(path: Path, target: Path) -> None:
    """Give a file a second name, so that it stays when the first name is replaced."""
    try:
        os.link(path, target, follow_symlinks=False)
    except (OSError, NotImplementedError):
        # The file system has no hard links, or none to symbolic links.
        shutil.copy2(path, target, follow_symlinks=False)


def delete_tree(path: Path) -> None:
    """Delete a file, or a folder with all its files; a link is deleted, not its target."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path, ignore_errors=True)
    else:
        _delete([path])


def _delete(paths: Iterable[Path]) -> None:
    """Delete files as far as possible; a missing one is no error."""
    for path in paths:
        with suppress(OSError):
            path.unlink(missing_ok=True)


def refuse_foreign(folder: Path, names: Iterable[str], own: bool) -> None:
    """Raise `DataError` with the first file that a result would replace in a folder that is not the kit's.

    own : whether the folder has results of the kit; a folder with the lock of a process is the kit's too.
    """
    if own or (folder / LOCK).exists():
        return
    for name in names:
        if os.path.lexists(folder / name):
            raise DataError("is not the kit's file: choose another folder for the results", folder / name)


def write_atomic(path: str | Path, data: bytes | str) -> None:
    """Write bytes or UTF-8 text to `path`, completely or not at all; line endings are kept.

    A character without a UTF-8 form, such as an undecodable byte of a file name, becomes a question mark.
    """
    with writing(path) as file:
        file.write(data.encode("utf-8", "replace") if isinstance(data, str) else data)


def csv_text(rows: Iterable[Sequence[object]]) -> str:
    """CSV text of rows, the first of which is the heading; the line ending is \\n."""
    buffer = io.StringIO()
    csv.writer(buffer, lineterminator="\n").writerows(rows)
    return buffer.getvalue()


def file_sha256(path: str | Path) -> str:
    """SHA-256 of a file, 64 hexadecimal digits; raises like `open_binary`."""
    with open_binary(path) as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
