"""Zip archives on disk or on a web server: their members listed and read, connections that break reopened."""

from __future__ import annotations

import errno
import lzma
import struct
import threading
import time
import zipfile
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import PurePosixPath, PureWindowsPath
from typing import TypeVar

import requests
from remotezip import RangeNotSupported, RemoteZip, RemoteZipError

from fetch import download
from fetch.download import LOST, open_session, what_failed
from vo_lib.core.errors import DataError
from vo_lib.core.files import opened

Answer = TypeVar("Answer")
NO_DISK = (None, errno.EINVAL)  # numbers of errors that no disk made
# Of members that are encrypted, packed in another way, cut or garbled.
DAMAGED = (
    *(zipfile.BadZipFile, zlib.error, lzma.LZMAError, struct.error),
    *(EOFError, ValueError, RuntimeError, OverflowError),
)


@dataclass(frozen=True)
class Member:
    """A file of an archive that is wanted.

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
        self._session.hooks["response"].append(_close_useless)
        self._here = threading.local()
        self._opened: list[zipfile.ZipFile] = []

    def __enter__(self) -> Archives:
        return self

    def __exit__(self, *details: object) -> None:
        for archive in self._opened:
            _close(archive)
        self._session.close()

    def directory(self, place: str) -> list[zipfile.ZipInfo]:
        """All members of an archive. `DataError` where one of them would leave the folder it is put into."""
        members = self._again(place, lambda: self._open(place).infolist())
        for name in (info.filename for info in members):
            path = PureWindowsPath(name)  # knows what any system takes for a root
            if path.is_absolute() or path.drive or path.root or ".." in path.parts:
                raise DataError(
                    f"the member {name[:80]!r} would leave the folder it is put into: refused", place
                )
        return members

    def read(self, member: Member) -> bytes:
        """Content of a member, its checksum verified."""
        place = member.archive

        def once() -> bytes:
            archive = self._open(place)
            info = archive.NameToInfo.get(member.name)
            if info is None or (info.file_size, info.CRC) != (member.size, member.crc):
                raise DataError("the archive changed meanwhile; call again to use the new one", place)
            data = archive.read(info)
            if len(data) != member.size:
                raise zipfile.BadZipFile(f"{len(data)} bytes, {member.size} declared")
            return data

        return self._again(place, once, member.name)

    def _open(self, place: str) -> zipfile.ZipFile:
        mine: dict[str, zipfile.ZipFile] = self._here.__dict__
        if place not in mine:
            if not _is_url(place):
                with opened(place):
                    pass  # no pipe, no device
            remote = partial(RemoteZip, session=self._session, timeout=download.TIMEOUT)
            mine[place] = remote(place) if _is_url(place) else zipfile.ZipFile(place)
            self._opened.append(mine[place])
        return mine[place]

    def _again(self, place: str, once: Callable[[], Answer], name: str = "") -> Answer:
        """The answer of `once`, tried again after a lost connection or a wrong checksum."""
        failure: BaseException | None = None
        for attempt in range(download.ATTEMPTS):
            time.sleep(download.PAUSE * attempt)
            try:
                return once()
            except RangeNotSupported:
                raise DataError(
                    "the server gives only whole files (no range requests): download the archive as a whole "
                    "and call again with --from-zip FILE",
                    place,
                ) from None
            except (*LOST, RemoteZipError, *DAMAGED, OSError) as error:
                failure = error.__context__ if isinstance(error, RemoteZipError) else error
                broken = self._here.__dict__.pop(place, None)
                if broken is not None:
                    _close(broken)
                if isinstance(failure, requests.RequestException) or not _is_url(place):
                    break
        # What bz2 cannot unpack is an error without a number; a place before the file's start is EINVAL.
        damaged = isinstance(failure, OSError) and failure.errno in NO_DISK and not _is_url(place)
        if isinstance(failure, DAMAGED) or damaged:
            what = f"the member {name} is damaged or packed otherwise" if name else "is not a whole zip file"
            raise DataError(f"{what} ({failure}); nothing of it was written", place) from None
        if not _is_url(place):
            raise DataError(f"cannot be read: {getattr(failure, 'strerror', failure)}", place) from None
        raise DataError(what_failed(failure, place)) from None


def _close(archive: zipfile.ZipFile) -> None:
    file = archive.fp
    archive.close()
    if file is not None:
        file.close()  # a remote one stays open otherwise, with what the server still sends


def _close_useless(response: requests.Response, *details: object, **options: object) -> None:
    """Close answers that nobody will read: refusals, and the whole file where a part was asked for."""
    if response.status_code >= 400 or (response.status_code == 200 and "Range" in response.request.headers):
        response.close()


def _is_url(place: str) -> bool:
    return place.startswith(("http://", "https://"))
