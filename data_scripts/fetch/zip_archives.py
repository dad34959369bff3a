"""Zip archives on disk or on a web server, read member by member; failed requests are repeated."""

from __future__ import annotations

import struct
import time
import zipfile
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import PurePosixPath
from typing import TypeVar

import requests
from remotezip import RangeNotSupported, RemoteZip, RemoteZipError

from fetch import download
from fetch.download import LOST, open_session, what_failed
from vo_lib.errors import DataError

Answer = TypeVar("Answer")
HEADER_BYTES = (
    30  # length of the header before a member's name; it ends with the lengths of name and extra field
)


@dataclass(frozen=True)
class Member:
    """A member of an archive that is extracted as a file.

    Attributes
    ----------
    archive : path or URL of the archive. info : entry of the member in the archive's directory.
    end : end of the member in the archive, bytes. target : path of the file below the KITTI folder.
    """

    archive: str
    info: zipfile.ZipInfo
    end: int
    target: PurePosixPath


class Archives:
    """Reader of archives for several threads: one request per member, then a check of the checksum."""

    def __init__(self) -> None:
        self._session = open_session()
        self._session.hooks["response"].append(_close_unread)

    def __enter__(self) -> Archives:
        return self

    def __exit__(self, *details: object) -> None:
        self._session.close()

    def directory(self, place: str) -> list[tuple[zipfile.ZipInfo, int]]:
        """Entries of an archive, each with the end of its member in the file, bytes. Raises `DataError`."""

        def ask() -> tuple[list[zipfile.ZipInfo], int]:
            remote, options = _is_url(place), {"session": self._session, "timeout": download.TIMEOUT_S}
            with RemoteZip(place, **options) if remote else zipfile.ZipFile(place) as archive:
                return archive.infolist(), archive.start_dir

        members, end = self._again(place, ask)
        members = sorted(members, key=lambda info: info.header_offset)
        ends = [*(info.header_offset for info in members[1:]), end]
        return list(zip(members, ends, strict=False))  # without members, there is one end too many

    def read(self, member: Member) -> bytes:
        """Content of a member with a valid checksum; `DataError` for a damaged or unreadable member."""

        def ask() -> bytes:
            data = self._bytes(member.archive, member.info.header_offset, member.end)
            start = HEADER_BYTES + sum(struct.unpack_from("<HH", data, HEADER_BYTES - 4))
            content = data[start : start + member.info.compress_size]
            if member.info.compress_type == zipfile.ZIP_DEFLATED:
                content = zlib.decompress(content, -zlib.MAX_WBITS)
            if zlib.crc32(content) != member.info.CRC:
                raise zipfile.BadZipFile("wrong CRC-32")
            return content

        return self._again(member.archive, ask, member.info.filename)

    def _bytes(self, place: str, start: int, end: int) -> bytes:
        if not _is_url(place):
            with open(place, "rb") as file:
                file.seek(start)
                return file.read(end - start)
        headers = {"Range": f"bytes={start}-{end - 1}"}
        with self._session.get(place, headers=headers, stream=True, timeout=download.TIMEOUT_S) as answer:
            answer.raise_for_status()
            return bytes(answer.raw.read())

    def _again(self, place: str, ask: Callable[[], Answer], member: str = "") -> Answer:
        """The result of `ask`; after a lost connection or a wrong checksum, `ask` is called again."""
        for attempt in range(download.ATTEMPTS):
            time.sleep(download.PAUSE_S * attempt)
            try:
                return ask()
            except RangeNotSupported:
                remedy = "download the whole archive and repeat the command with --from-zip FILE"
                raise DataError(f"the server does not send parts of files: {remedy}", place) from None
            except (
                Exception
            ) as error:  # errors of zipfile and its compressions have no other common base class
                failure = error.__context__ if isinstance(error, RemoteZipError) else error
                if isinstance(failure, requests.RequestException) or not _is_url(place):
                    break
        if isinstance(failure, LOST):
            raise DataError(what_failed(failure, place)) from None
        what = f"the member {member} is damaged or unreadable" if member else "is not a complete zip file"
        raise DataError(f"{what} ({failure})", place) from None


def _close_unread(response: requests.Response, *details: object, **options: object) -> None:
    """Close an unwanted response: an error, or a whole file instead of a range."""
    if response.status_code >= 400 or (response.status_code == 200 and "Range" in response.request.headers):
        response.close()


def _is_url(place: str) -> bool:
    return place.startswith(("http://", "https://"))
