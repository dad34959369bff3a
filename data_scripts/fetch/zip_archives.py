"""Zip archives on disk or on a web server, read member by member; failed requests are repeated."""

from __future__ import annotations

import struct
import zipfile
import zlib
from dataclasses import dataclass
from pathlib import PurePosixPath

from remotezip import RangeNotSupported, RemoteIOError, RemoteZip

from fetch import download
from fetch.download import is_url, open_session, with_retries
from vo_lib.errors import DataError
from vo_lib.files import open_binary

NO_PARTS = "the server does not send parts of files: download the whole archive and add --from-zip FILE"
HEADER_BYTES = 30  # length of a member's header; the last four bytes are the lengths of name and extra field


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

    def __enter__(self) -> Archives:
        return self

    def __exit__(self, *details: object) -> None:
        self._session.close()

    def directory(self, place: str) -> list[tuple[zipfile.ZipInfo, int]]:
        """Entries of an archive, each with the end of its member in the file, bytes. Raises `DataError`."""

        def ask() -> tuple[list[zipfile.ZipInfo], int]:
            if not is_url(place):
                with zipfile.ZipFile(place) as archive:
                    return archive.infolist(), archive.start_dir
            try:
                with RemoteZip(place, session=self._session, timeout=download.TIMEOUT_S) as archive:
                    return archive.infolist(), archive.start_dir
            except RangeNotSupported:
                raise DataError(NO_PARTS, place) from None
            except RemoteIOError as error:
                # The error that it wraps tells whether a further attempt is worth it.
                raise error.__context__ or error from None

        if not is_url(place):
            with open_binary(place):  # raises for a missing file, a folder or a pipe
                pass
        members, end = with_retries(ask, place, "is not a complete zip file")
        members = sorted(members, key=lambda info: info.header_offset)
        ends = [*(info.header_offset for info in members[1:]), end]
        return list(zip(members, ends, strict=False))  # without members, there is one end too many

    def read(self, member: Member) -> bytes:
        """Content of a member with a valid checksum; `DataError` for a damaged or unreadable member."""

        def ask() -> bytes:
            data = self._bytes(member.archive, member.info.header_offset, member.end)
            name_length, extra_length = struct.unpack_from("<HH", data, HEADER_BYTES - 4)
            start = HEADER_BYTES + name_length + extra_length
            content = data[start : start + member.info.compress_size]
            if member.info.compress_type == zipfile.ZIP_DEFLATED:
                content = zlib.decompress(content, -zlib.MAX_WBITS)
            if zlib.crc32(content) != member.info.CRC:
                raise zipfile.BadZipFile("wrong CRC-32")
            return content

        fault = f"the member {member.info.filename} is damaged or unreadable"
        return with_retries(ask, member.archive, fault)

    def _bytes(self, place: str, start: int, end: int) -> bytes:
        """The bytes from start to end of an archive; `DataError` if a server does not send parts."""
        if not is_url(place):
            with open(place, "rb") as file:
                file.seek(start)
                return file.read(end - start)
        headers = {"Range": f"bytes={start}-{end - 1}"}
        with self._session.get(place, headers=headers, stream=True, timeout=download.TIMEOUT_S) as answer:
            answer.raise_for_status()
            if answer.status_code != 206:  # partial content
                raise DataError(NO_PARTS, place)
            return bytes(answer.raw.read())
