"""Download of a single file over HTTP, with verification."""

from __future__ import annotations

import hashlib
import shutil
import sys
from pathlib import Path
from urllib.parse import urlsplit

import requests
import urllib3
from requests.adapters import HTTPAdapter

from vo_lib.errors import DataError
from vo_lib.files import write_atomic
from vo_lib.geometry.types import Progress

ATTEMPTS = 5  # attempts without progress before a download fails
PAUSE_S = 1.0  # pause before the second attempt; later pauses are longer
TIMEOUT_S = (10.0, 30.0)  # for the connection, and for the next bytes
CHUNK_BYTES = 1 << 18
MAX_CONNECTIONS = 16  # parallel connections to one server
SPARE_BYTES = 100_000_000  # disk space that must stay free

LOST = (requests.RequestException, urllib3.exceptions.HTTPError)


def open_session() -> requests.Session:
    """A session with persistent connections that repeats failed requests."""
    session = requests.Session()
    retry = urllib3.Retry(
        total=ATTEMPTS - 1,
        backoff_factor=PAUSE_S / 2,
        status_forcelist=(500, 502, 503, 504),
        raise_on_status=False,
    )
    for scheme in ("http://", "https://"):
        session.mount(scheme, HTTPAdapter(max_retries=retry, pool_maxsize=MAX_CONNECTIONS))
    # With compressed responses, ranges and sizes would be wrong.
    session.headers["Accept-Encoding"] = "identity"
    return session


def what_failed(error: BaseException | None, url: str) -> str:
    """The cause of a failed request and the remedy, as text."""
    host = urlsplit(url).hostname
    if (response := getattr(error, "response", None)) is not None:
        return f"{url}: {host} answers with HTTP {response.status_code}"
    if isinstance(error, requests.Timeout):
        return f"{url}: {host} does not answer; try again later"
    if isinstance(error, requests.ConnectionError):
        return f"{url}: no connection to {host}; is this machine online?"
    return f"{url}: the connection was lost; repeat the command"


def in_words(size: int) -> str:
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
        needed = f"{in_words(size)} and {in_words(SPARE_BYTES)} to spare"
        raise DataError(f"needs {needed}, but only {in_words(free)} are free", folder)


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
    data = bytearray()
    try:
        with open_session() as session, session.get(url, stream=True, timeout=TIMEOUT_S) as answer:
            answer.raise_for_status()
            for chunk in answer.iter_content(CHUNK_BYTES):
                data += chunk
                if progress is not None:
                    progress(min(len(data), size), size)
                if len(data) > size:
                    break
    except requests.RequestException as error:
        raise DataError(what_failed(error, url)) from None
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
