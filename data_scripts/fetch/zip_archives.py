"""Zip archives on disk or on a web server: members listed and read, over lost connections too."""

from __future__ import annotations

import threading
import time
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import PurePosixPath
from typing import TypeVar

import requests
from remotezip import RangeNotSupported, RemoteZip, RemoteZipError

from fetch import download
from fetch.download import LOST, open_session, what_failed
from vo_lib.errors import DataError

Answer = TypeVar("Answer")


@dataclass(frozen=True)
class Member:
    """A file of an archive.

    Attributes
    ----------
    archive : the archive's path or URL; name : the member's name in it.
    target : where it goes below the root.
    size, packed : bytes on disk and in the archive; crc : CRC-32 of the content.
    """

    archive: str
    name: str
    target: PurePosixPath
    size: int
    packed: int
    crc: int


class Archives:
    """Archives opened once a thread; members read with their checksums, lost connections opened again."""

    def __init__(self) -> None:
        self._session = open_session()
        self._session.hooks["response"].append(_close_unread)
        self._here = threading.local()
        self._opened: list[zipfile.ZipFile] = []

    def __enter__(self) -> Archives:
        return self

    def __exit__(self, *details: object) -> None:
        for archive in self._opened:
            _close(archive)
        self._session.close()

    def directory(self, place: str) -> list[zipfile.ZipInfo]:
        """All members of an archive; `DataError` where it cannot be read."""
        return self._again(place, lambda: self._open(place).infolist())

    def read(self, member: Member) -> bytes:
        """Content of a member, its checksum verified; `DataError` where it is damaged or cannot be read."""
        return self._again(member.archive, lambda: self._open(member.archive).read(member.name), member.name)

    def _open(self, place: str) -> zipfile.ZipFile:
        mine: dict[str, zipfile.ZipFile] = self._here.__dict__
        if place not in mine:
            remote = partial(RemoteZip, session=self._session, timeout=download.TIMEOUT_S)
            mine[place] = remote(place) if _is_url(place) else zipfile.ZipFile(place)
            self._opened.append(mine[place])
        return mine[place]

    def _again(self, place: str, ask: Callable[[], Answer], member: str = "") -> Answer:
        """The answer of `ask`, which is asked again after a lost connection or a wrong checksum."""
        for attempt in range(download.ATTEMPTS):
            time.sleep(download.PAUSE_S * attempt)
            try:
                return ask()
            except RangeNotSupported:
                raise DataError(
                    "the server gives only whole files (no range requests): download the archive as a whole "
                    "and call again with --from-zip FILE",
                    place,
                ) from None
            except Exception as error:  # those of zip files and of their compressions share no other base
                failure = error.__context__ if isinstance(error, RemoteZipError) else error
                broken = self._here.__dict__.pop(place, None)
                if broken is not None:
                    _close(broken)
                if isinstance(failure, requests.RequestException) or not _is_url(place):
                    break
        if isinstance(failure, LOST):
            raise DataError(what_failed(failure, place)) from None
        what = f"the member {member} is damaged or packed otherwise" if member else "is not a whole zip file"
        raise DataError(f"{what} ({failure})", place) from None


def _close(archive: zipfile.ZipFile) -> None:
    file = archive.fp
    archive.close()
    if file is not None:
        file.close()  # a remote one stays open otherwise, with the rest of the server's answer


def _close_unread(response: requests.Response, *details: object, **options: object) -> None:
    """Close answers that nobody reads: refusals, and a whole file where a part was asked for."""
    if response.status_code >= 400 or (response.status_code == 200 and "Range" in response.request.headers):
        response.close()


def _is_url(place: str) -> bool:
    return place.startswith(("http://", "https://"))
