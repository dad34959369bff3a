"""Download of a single file over HTTP, with verification."""

from __future__ import annotations

import hashlib
import shutil
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar
from urllib.parse import urlsplit

import requests
import urllib3

from vo_lib.errors import DataError
from vo_lib.files import write_atomic
from vo_lib.geometry.types import Progress

ATTEMPTS = 5  # before a download fails
PAUSE_S = 1.0  # pause before the second attempt; later pauses are longer
TIMEOUT_S = (10.0, 30.0)  # for the connection, and for the next bytes
CHUNK_BYTES = 1 << 18
MAX_CONNECTIONS = 10  # parallel connections of a session
SPARE_BYTES = 100_000_000  # disk space that must stay free

LOST = (requests.RequestException, urllib3.exceptions.HTTPError)
Answer = TypeVar("Answer")


def open_session() -> requests.Session:
    """A session with persistent connections."""
    session = requests.Session()
    # With compressed responses, ranges and sizes would be wrong.
    session.headers["Accept-Encoding"] = "identity"
    return session


def with_retries(ask: Callable[[], Answer], place: str, fault: str = "is damaged") -> Answer:
    """The result of `ask`, which is called again after a lost connection, a server's error or damaged data.

    place : URL or path that `ask` reads; a path is read once. fault : fault of damaged data, for the message.

    Raises `DataError` after the last attempt, or at once for HTTP 4xx.
    """
    for attempt in range(ATTEMPTS):
        time.sleep(PAUSE_S * attempt)
        try:
            return ask()
        except DataError:
            raise
        except Exception as error:  # errors of zipfile and its compressions have no other common base class
            failure = error
            status = getattr(getattr(error, "response", None), "status_code", 500)
            if status < 500 or not is_url(place):
                break
    if isinstance(failure, LOST):
        raise DataError(request_error_text(failure, place)) from None
    raise DataError(f"{fault} ({failure})", place) from None


def is_url(place: str) -> bool:
    """Whether a place is a URL, not a path."""
    return place.startswith(("http://", "https://"))


def request_error_text(error: Exception, url: str) -> str:
    """The cause of a failed request and the remedy, as text."""
    host = urlsplit(url).hostname
    response = getattr(error, "response", None)
    if response is not None:
        return f"{url}: {host} answers with HTTP {response.status_code}"
    if isinstance(error, requests.Timeout):
        return f"{url}: {host} does not answer; try again later"
    if isinstance(error, requests.ConnectionError):
        return f"{url}: no connection to {host}; is this machine online?"
    return f"{url}: the connection was lost; repeat the command"


def format_bytes(size: int) -> str:
    """A number of bytes as text, such as "23.4 MB"."""
    value = float(size)
    for unit in ("bytes", "kB", "MB"):
        if value < 1000:
            return f"{value:.0f} {unit}" if unit == "bytes" else f"{value:.1f} {unit}"
        value /= 1000
    return f"{value:.1f} GB"


def require_space(folder: Path, size: int) -> None:
    """Raise `DataError` unless `size` bytes and a reserve are free on the disk of `folder`."""
    existing = next(place for place in (folder.absolute(), *folder.absolute().parents) if place.exists())
    free = shutil.disk_usage(existing).free
    if free < size + SPARE_BYTES:
        needed = f"{format_bytes(size)} and {format_bytes(SPARE_BYTES)} to spare"
        raise DataError(f"needs {needed}, but only {format_bytes(free)} are free", folder)


def confirm(question: str, yes: bool) -> bool:
    """Ask a question with the answers yes and no; with `yes`, return True without a question.

    Raises `DataError` without a terminal.
    """
    if yes:
        return True
    if not sys.stdin.isatty():
        raise DataError("no terminal for the confirmation: add --yes to skip the question")
    try:
        answer = input(f"{question} [y/N] ")
    except EOFError:
        return False
    return answer.strip().lower() in ("y", "yes")


def download(url: str, path: Path, size: int, sha256: str, progress: Progress | None = None) -> None:
    """Download a file into memory, and write it after a check of size and SHA-256.

    size, sha256 : size in bytes and SHA-256 in hexadecimal digits of the expected file.
    progress : called with (bytes done, total bytes).

    Raises `DataError` for a failed connection, a wrong file or a full disk.
    """
    require_space(path.parent, size)

    def ask() -> bytearray:
        data = bytearray()
        with open_session() as session, session.get(url, stream=True, timeout=TIMEOUT_S) as answer:
            answer.raise_for_status()
            for chunk in answer.iter_content(CHUNK_BYTES):
                data += chunk
                if progress is not None:
                    progress(min(len(data), size), size)
                if len(data) > size:
                    break
        return data

    data = with_retries(ask, url)
    if len(data) != size or hashlib.sha256(data).hexdigest() != sha256:
        raise DataError(f"{url}: unexpected file: expected {size} bytes with SHA-256 {sha256[:12]}…")
    write_file(path, bytes(data))


def write_file(path: Path, data: bytes | str) -> None:
    """Write a file with `write_atomic`, and create its folder if missing."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise DataError(f"cannot be written: {error.strerror}", path) from None
    write_atomic(path, data)
