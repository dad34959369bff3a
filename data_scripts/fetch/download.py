"""One file over HTTP, fetched whole, resumable and verified."""

from __future__ import annotations

import errno
import os
import shutil
import sys
import time
from pathlib import Path
from urllib.parse import urlsplit

import requests
import urllib3
from requests.adapters import HTTPAdapter

from vo_lib.core.errors import DataError
from vo_lib.core.files import file_sha256
from vo_lib.core.types import Progress

ATTEMPTS = 5  # tries without a single new byte before a transfer is given up
PAUSE = 1.0  # seconds before the second try; each further one waits longer
TIMEOUT = (10.0, 30.0)  # seconds to connect, and to wait for the next bytes
CHUNK = 1 << 18
CONNECTIONS = 16  # to one server at once, at most
SPARE = 100_000_000  # bytes left free on the disk beside what is written

LOST = (requests.RequestException, urllib3.exceptions.HTTPError)


def open_session() -> requests.Session:
    """A session that keeps connections open and tries again where a server is not there for a moment."""
    session = requests.Session()
    retry = urllib3.Retry(
        total=ATTEMPTS - 1,
        backoff_factor=PAUSE / 2,
        status_forcelist=(500, 502, 503, 504),
        raise_on_status=False,
    )
    for scheme in ("http://", "https://"):
        session.mount(scheme, HTTPAdapter(max_retries=retry, pool_maxsize=CONNECTIONS))
    # Compressed answers would break ranges and sizes.
    session.headers["Accept-Encoding"] = "identity"
    return session


def what_failed(error: BaseException | None, url: str) -> str:
    """A failed request in words a person can act on."""
    host = urlsplit(url).hostname
    response = getattr(error, "response", None)
    if response is not None:
        if response.status_code in (401, 403, 404, 410):
            return f"{url}: {host} does not give this file (HTTP {response.status_code}); has it moved?"
        return f"{url}: {host} answers with HTTP {response.status_code}; try again later"
    if isinstance(error, requests.Timeout):
        return f"{url}: {host} does not answer; try again later"
    if isinstance(error, requests.ConnectionError):
        return f"{url}: no connection to {host}; is this machine online?"
    return f"{url}: the connection was lost again and again; call again to go on where it stopped"


def in_words(size: int) -> str:
    """A number of bytes as a person reads it: "23.4 MB"."""
    value = float(size)
    for unit in ("bytes", "kB", "MB"):
        if value < 1000:
            return f"{value:.0f} {unit}" if unit == "bytes" else f"{value:.1f} {unit}"
        value /= 1000
    return f"{value:.1f} GB"


def require_space(folder: Path, size: int) -> None:
    """`DataError` unless `size` bytes, and some to spare, are free where `folder` is or will be."""
    there = next(place for place in (folder.absolute(), *folder.absolute().parents) if place.exists())
    free = shutil.disk_usage(there).free
    if free < size + SPARE:
        raise DataError(
            f"needs {in_words(size)} and {in_words(SPARE)} to spare, but only {in_words(free)} are free",
            folder,
        )


def confirm(question: str, yes: bool) -> bool:
    """Whether a person agrees; `yes` answers for them.

    Raises `DataError` where nobody can be asked.
    """
    if yes:
        return True
    if not sys.stdin.isatty():
        raise DataError("nobody is there to answer: say --yes to start without a question")
    try:
        answer = input(f"{question} [y/N] ")
    except EOFError:
        return False
    return answer.strip().lower() in ("y", "yes")


def download(url: str, path: Path, size: int, sha256: str, progress: Progress | None = None) -> None:
    """Fetch one file; it appears under its name only when size and hash are right.

    Until then it is `<name>.part`, from which the next call goes on.

    Parameters
    ----------
    size : bytes; sha256 : 64 hexadecimal digits. What is not exactly this is refused.
    progress : called with (bytes done, bytes in all).

    Raises
    ------
    DataError : no connection, a wrong file, a full disk.
    """
    part = path.with_name(path.name + ".part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        require_space(path.parent, size)
        with open_session() as session:
            _fetch(session, url, part, size, progress)
        if part.stat().st_size != size or file_sha256(part) != sha256:
            found = part.stat().st_size
            part.unlink()
            raise DataError(
                f"{url}: what came is not the file expected ({found} bytes, {size} expected, or another "
                "SHA-256); it was thrown away"
            )
        os.replace(part, path)
    except OSError as error:
        words = "the disk is full" if error.errno == errno.ENOSPC else f"cannot be written: {error.strerror}"
        raise DataError(words, path) from None


def _fetch(session: requests.Session, url: str, part: Path, size: int, progress: Progress | None) -> None:
    """Append to `part` until it has `size` bytes; connections that break are opened again."""
    failures = 0
    while (done := part.stat().st_size if part.exists() else 0) < size:
        try:
            _append(session, url, part, done, size, progress)
            if part.stat().st_size < size:
                raise urllib3.exceptions.ProtocolError("the answer ended early")
        except requests.RequestException as error:
            # No answer at all: the session has tried several times already.
            raise DataError(what_failed(error, url)) from None
        except urllib3.exceptions.HTTPError as error:
            failures = failures + 1 if part.stat().st_size <= done else 1
            if failures >= ATTEMPTS:
                raise DataError(what_failed(error, url)) from None
            time.sleep(PAUSE * failures)


def _append(
    session: requests.Session, url: str, part: Path, done: int, size: int, progress: Progress | None
) -> None:
    headers = {"Range": f"bytes={done}-"} if done else {}
    with session.get(url, headers=headers, stream=True, timeout=TIMEOUT) as answer:
        # A server without ranges sends the whole file again.
        resumed = answer.status_code == 206
        offered = answer.headers.get("Content-Range" if resumed else "Content-Length", "")
        whole = offered.rpartition("/")[2]
        if answer.status_code == 416 or (answer.ok and whole.isdecimal() and int(whole) != size):
            part.unlink(missing_ok=True)
            raise DataError(f"{url}: the server has another file there; expected one of {size} bytes")
        answer.raise_for_status()
        done = done if resumed else 0
        with open(part, "ab" if resumed else "wb") as file:
            while done <= size and (data := answer.raw.read(CHUNK)):
                file.write(data)
                done += len(data)
                if progress is not None:
                    progress(done, size)
