"""WebM files of VP8 frames: pictures encoded by OpenCV on a thread, and the file around the frames.

WebM with VP8 plays in all current browsers. MDN's guides "Media container formats" and "Web video codec
guide" list it for Chrome, Edge, Firefox and Safari; WebKit's release notes name it since Safari 14.1 on macOS
and 17.4 on iOS. JupyterLab shows it in its browser.

OpenCV's own file of this format contains random numbers; that of this module does not, so the same pictures
give the same bytes.
"""

from __future__ import annotations

import os
import struct
from collections import deque
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

import cv2

from ..errors import DataError
from ..files import locked_draft
from ..geometry.types import Image

# VP8 takes a quarter of VP9's time in OpenCV, which uses one thread and passes no options to the encoder.
CODEC = cv2.VideoWriter.fourcc(*"VP80")
# `cv2.VideoWriter` has no parameter that makes a film small, but it limits the bits per second, and a frame
# gets this limit divided by the frames per second. So the encoder is told a far larger number of frames per
# second, and spends fewer bits on each. `WebmWriter` writes the true number into the film.
ENCODER_FPS = 3000
MOST_WAITING = 8  # pictures that may wait for the encoder, beside the one that it works on
KEY_FRAME = 0x80  # flag of a block
TRACK_1 = 0x81  # the number of a block's track, as a size in one byte (`_size`)
MAX_BLOCK_TIME_MS = 30_000  # after the start of its cluster; a block has 15 bits for it

# Identifiers of EBML and of Matroska, the format that WebM is a part of (RFC 8794 and RFC 9559).
EBML = 0x1A45DFA3
EBML_VERSION = 0x4286
EBML_READ_VERSION = 0x42F7
MAX_ID_LENGTH = 0x42F2
MAX_SIZE_LENGTH = 0x42F3
DOC_TYPE = 0x4282
DOC_TYPE_VERSION = 0x4287
DOC_TYPE_READ_VERSION = 0x4285
SEGMENT_OF_FILE = 0x18538067
SEEK_HEAD = 0x114D9B74
SEEK = 0x4DBB
SEEK_ID = 0x53AB
SEEK_POSITION = 0x53AC
INFO = 0x1549A966
TIMESTAMP_SCALE = 0x2AD7B1
DURATION = 0x4489
MUXING_APP = 0x4D80
WRITING_APP = 0x5741
TRACKS = 0x1654AE6B
TRACK_ENTRY = 0xAE
TRACK_NUMBER = 0xD7
TRACK_UID = 0x73C5
TRACK_TYPE = 0x83
FLAG_LACING = 0x9C
CODEC_ID = 0x86
DEFAULT_DURATION = 0x23E383
VIDEO = 0xE0
PIXEL_WIDTH = 0xB0
PIXEL_HEIGHT = 0xBA
CLUSTER = 0x1F43B675
TIMESTAMP = 0xE7
SIMPLE_BLOCK = 0xA3
CUES = 0x1C53BB6B
CUE_POINT = 0xBB
CUE_TIME = 0xB3
CUE_TRACK_POSITIONS = 0xB7
CUE_TRACK = 0xF7
CUE_CLUSTER_POSITION = 0xF1
VOID = 0xEC

NS_PER_MS = 1_000_000
WRITER = b"stereo-vo-kit"
# At the end of a film, an element that players skip: it shows that the kit may replace the film.
FILM_MARK = bytes([VOID, 0x80 | len(WRITER)]) + WRITER


@contextmanager
def webm_file(path: Path, width: int, height: int, fps: int) -> Iterator[PictureEncoder]:
    """A film for pictures of a size, `fps` frames per second, to which the caller adds pictures.

    The complete file appears at the end of the context; without a picture, there is none.

    Raises `DataError` if the film cannot be written.
    """
    with locked_draft(path) as folder:
        folder.mkdir()
        encoded = folder / "frames.ivf"
        encoder = PictureEncoder(encoded, (width, height), path)
        with encoder.threads:
            yield encoder
            encoder.finish()
        if not encoder.count:
            return
        draft = folder / path.name
        # Both files are the kit's own drafts, so an error of either is one of writing the film.
        with open(encoded, "rb") as source, open(draft, "wb") as file:
            webm = WebmWriter(file, width, height, fps)
            for frame in _frames_of_ivf(source):
                webm.add(frame)
            webm.finish()
        if webm.count != encoder.count:  # OpenCV reports no error of writing
            raise DataError("cannot be written: is the disk full?", path)
        os.replace(draft, path)


class PictureEncoder:
    """Encodes pictures (H, W, 3), BGR, as VP8 on a thread, while the caller draws the next ones.

    Attributes
    ----------
    count : number of pictures so far.
    threads : the pool with the thread.
    """

    def __init__(self, encoded: Path, size: tuple[int, int], film: Path):
        """Open the file `encoded`, with the ending .ivf, for pictures of a size (width, height).

        Raises `DataError`, with the name of the film, if OpenCV cannot do it.
        """
        self.count = 0
        self.threads = ThreadPoolExecutor(1)
        self._writer = cv2.VideoWriter(str(encoded), cv2.CAP_FFMPEG, CODEC, ENCODER_FPS, size)
        if not self._writer.isOpened():
            raise DataError("the film cannot be written: no write access, or no VP8 encoder in OpenCV", film)
        self._waiting = deque[Future[None]]()

    def add(self, picture: Image) -> None:
        """Take a picture, which must not change afterwards; wait if too many wait already."""
        if len(self._waiting) > MOST_WAITING:
            self._waiting.popleft().result()
        self._waiting.append(self.threads.submit(self._write, picture))
        self.count += 1

    def _write(self, picture: Image) -> None:
        """Encode a picture and write it, on the thread."""
        self._writer.write(picture)

    def finish(self) -> None:
        """Wait for the last picture, and close the file."""
        while self._waiting:
            self._waiting.popleft().result()
        self._writer.release()


def _frames_of_ivf(file: BinaryIO) -> Iterator[bytes]:
    """The complete frames in an IVF file: after 32 bytes, the length, the time and the data of each frame."""
    file.seek(32)
    while len(head := file.read(12)) == 12:
        (size,) = struct.unpack_from("<I", head)
        frame = file.read(size)
        if len(frame) < size:
            return
        yield frame


class WebmWriter:
    """A WebM file with one track of VP8, written frame by frame; a key frame begins a cluster of frames.

    Attributes
    ----------
    count : number of frames so far.
    """

    def __init__(self, file: BinaryIO, width: int, height: int, fps: int):
        self.count = 0
        self._file = file
        self._fps = fps
        self._cluster_start_ms = 0
        self._blocks = list[bytes]()  # of the cluster that is not written yet
        self._cues = list[bytes]()  # the index: the time and the place of each cluster
        file.write(
            _element(
                EBML,
                _number(EBML_VERSION, 1),
                _number(EBML_READ_VERSION, 1),
                _number(MAX_ID_LENGTH, 4),
                _number(MAX_SIZE_LENGTH, 8),
                _element(DOC_TYPE, b"webm"),
                _number(DOC_TYPE_VERSION, 2),
                _number(DOC_TYPE_READ_VERSION, 2),
            )
        )
        # Sizes, the duration and the place of the index are known at the end: until then they are zero.
        self._segment_place = file.tell()
        self._write_segment_size(0)
        self._content_place = file.tell()  # the places of parts are counted from here
        self._tracks = _element(
            TRACKS,
            _element(
                TRACK_ENTRY,
                _number(TRACK_NUMBER, 1),
                _number(TRACK_UID, 1),
                _number(TRACK_TYPE, 1),
                _number(FLAG_LACING, 0),
                _element(CODEC_ID, b"V_VP8"),
                _number(DEFAULT_DURATION, 1000 * NS_PER_MS // fps),
                _element(VIDEO, _number(PIXEL_WIDTH, width), _number(PIXEL_HEIGHT, height)),
            ),
        )
        file.write(self._parts_before_frames(0))

    def add(self, frame: bytes) -> None:
        """Add a VP8 frame."""
        time = self._time_ms(self.count)
        is_key = not frame[0] & 1  # the first bit of a VP8 frame (RFC 6386, section 9.1)
        if is_key or time - self._cluster_start_ms > MAX_BLOCK_TIME_MS:
            self._write_cluster()
            self._cluster_start_ms = time
        flags = KEY_FRAME if is_key else 0
        head = struct.pack(">BhB", TRACK_1, time - self._cluster_start_ms, flags)
        self._blocks.append(_element(SIMPLE_BLOCK, head, frame))
        self.count += 1

    def _write_cluster(self) -> None:
        """Write the frames that were added since the last cluster, and remember its place for the index."""
        if not self._blocks:
            return
        place = _element(
            CUE_TRACK_POSITIONS,
            _number(CUE_TRACK, 1),
            _number(CUE_CLUSTER_POSITION, self._file.tell() - self._content_place),
        )
        self._cues.append(_element(CUE_POINT, _number(CUE_TIME, self._cluster_start_ms), place))
        self._file.write(_element(CLUSTER, _number(TIMESTAMP, self._cluster_start_ms), *self._blocks))
        self._blocks = []

    def finish(self) -> None:
        """Write the index, with which a player finds any time, and what was not known at the start."""
        self._write_cluster()
        cues_place = self._file.tell() - self._content_place
        self._file.write(_element(CUES, *self._cues))
        self._file.write(FILM_MARK)
        size = self._file.tell() - self._content_place
        self._file.seek(self._segment_place)
        self._write_segment_size(size)
        self._file.write(self._parts_before_frames(cues_place))

    def _time_ms(self, number: int) -> int:
        """The time at which a frame begins, milliseconds from the start of the film."""
        return round(1000 * number / self._fps)

    def _write_segment_size(self, size: int) -> None:
        """Write the beginning of the element that has all others, with the size of its content in bytes."""
        self._file.write(SEGMENT_OF_FILE.to_bytes(4, "big") + _size(size, 8))

    def _parts_before_frames(self, cues_place: int) -> bytes:
        """The places of the parts, information on the file, and the track.

        Their length is always the same, so they can be written again over the first ones.
        """
        info = _element(
            INFO,
            _number(TIMESTAMP_SCALE, NS_PER_MS),
            _element(DURATION, struct.pack(">d", self._time_ms(self.count))),
            _element(MUXING_APP, WRITER),
            _element(WRITING_APP, WRITER),
        )
        info_place = len(_seek_head(0, 0, 0))
        tracks_place = info_place + len(info)
        return _seek_head(info_place, tracks_place, cues_place) + info + self._tracks


def _seek_head(info_place: int, tracks_place: int, cues_place: int) -> bytes:
    """The list of the parts' places, each in eight bytes."""
    seeks = []
    for name, place in ((INFO, info_place), (TRACKS, tracks_place), (CUES, cues_place)):
        seek_id = _element(SEEK_ID, name.to_bytes(4, "big"))
        position = _element(SEEK_POSITION, place.to_bytes(8, "big"))
        seeks.append(_element(SEEK, seek_id, position))
    return _element(SEEK_HEAD, *seeks)


def _element(name: int, *parts: bytes) -> bytes:
    """An element: identifier, size and content."""
    content = b"".join(parts)
    return name.to_bytes(_bytes_of(name), "big") + _size(len(content)) + content


def _number(name: int, value: int) -> bytes:
    """An element with a whole number, in as few bytes as it needs."""
    return _element(name, value.to_bytes(_bytes_of(value), "big"))


def _bytes_of(number: int) -> int:
    """How many bytes a whole number needs, at least one."""
    return max(1, (number.bit_length() + 7) // 8)


def _size(value: int, least_length: int = 1) -> bytes:
    """A size in at least `least_length` bytes, of which the first bit that is set tells their number.

    Each byte has 7 bits for the value; a size whose bits are all set would mean "unknown".
    """
    length = least_length
    while value >= (1 << 7 * length) - 1:
        length += 1
    mark = 1 << 7 * length
    return (value | mark).to_bytes(length, "big")
