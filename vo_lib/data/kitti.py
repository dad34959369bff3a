"""Files of a KITTI odometry folder: calib.txt, times.txt, numbered images."""

from __future__ import annotations

import itertools
import os
import re
import struct
import zlib
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from ..errors import DataError
from ..files import open_binary, read_bytes, read_text
from ..geometry.camera import StereoCamera
from ..geometry.types import Array, Image
from .poses import read_number_rows

_FRAMES = [4541, 1101, 4661, 801, 271, 2761, 1101, 1101, 4071, 1591, 1201]  # 00-10, which have true poses
_FRAMES += [921, 1061, 3281, 631, 1901, 1731, 491, 1801, 4981, 831, 2721]
EXPECTED_FRAMES = {f"{number:02d}": frames for number, frames in enumerate(_FRAMES)}

PART = "part.txt"  # in a folder with part of a sequence: the options of `vo data get_kitti` for this part
_RANGE = r"\d{1,6}:\d{1,6}"
_MARK = re.compile(
    rf"(?:--sequences \d\d|--raw [0-9_]+_drive_\d{{4}}) --frames ({_RANGE}(?:,{_RANGE})*)", re.ASCII
)

MAX_FOCAL_PX = 1e6  # also for the principal point; larger numbers overflow in later computations
MIN_BASELINE_M = 1e-5
MAX_BASELINE_M = 10.0  # a longer baseline is probably in millimetres
PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"

PNG_DEPTH_AT = 24  # place of the number of bits, in the chunk IHDR

GREY = "image_0", "image_1"  # folders of the left and of the right images
COLOUR = "image_2", "image_3"
BITS = 8, 10, 12, 14, 16  # of the grey values that cameras write into images of 8 and 16 bits
READING_THREADS = min(os.cpu_count() or 1, 8)


def image_folders(folder: Path) -> tuple[str, str]:
    """Names of the folders of the left and the right images: COLOUR if a sequence has no grey images."""
    has_colour = all((folder / name).is_dir() for name in COLOUR)
    return COLOUR if has_colour and not any((folder / name).exists() for name in GREY) else GREY


def has_images(folder: Path) -> bool:
    """Whether a folder has the left images of a sequence."""
    return (folder / image_folders(folder)[0]).is_dir()


def camera_names(sides: tuple[str, str]) -> tuple[str, str]:
    """Names of the matrices in calib.txt for these image folders: P0 and P1, or P2 and P3."""
    left, right = sides
    return f"P{left.removeprefix('image_')}", f"P{right.removeprefix('image_')}"


def read_calibration(
    path: Path, width: int = 0, height: int = 0, sides: tuple[str, str] = GREY
) -> StereoCamera:
    """Camera from calib.txt. P0 has f, cx and cy; the baseline is (P0[0,3] - P1[0,3]) / f.

    width, height : image size, pixels; 0 if unknown. sides : image folders; COLOUR has P2 and P3.

    Raises `DataError` with the line number for a missing matrix, wrong numbers, cameras that are not
    rectified, a principal point outside the images, or a baseline that is not positive or longer than 10 m.
    """
    name0, name1 = camera_names(sides)
    (P0, line0), (P1, line1) = _read_projections(path, (name0, name1))
    f = float(P0[0, 0])
    cx = float(P0[0, 2])
    cy = float(P0[1, 2])
    if not 1.0 <= f <= MAX_FOCAL_PX or max(abs(cx), abs(cy)) > MAX_FOCAL_PX:
        values = f"f {f:g}, centre {cx:g},{cy:g}"
        expected = f"expected pixels, a focal length of 1 to {MAX_FOCAL_PX:g}"
        raise DataError(f"{name0}: {values}: {expected}", path, line0)
    if np.abs(P0[:, :3] - [[f, 0, cx], [0, f, cy], [0, 0, 1]]).max() > 1e-6 * f:
        shape = "expected f 0 cx in row 1, 0 f cy in row 2, 0 0 1 in row 3"
        raise DataError(f"{name0}: {shape}", path, line0)
    if np.abs(P0[:, :3] - P1[:, :3]).max() > 1e-6 * f:
        words = f"{name0} and {name1} differ in their first three columns"
        raise DataError(f"{words}: not a rectified pair", path, line1)
    if width and not (0 <= cx < width and 0 <= cy < height):
        expected = f"expected a point inside the images of {width}×{height} px"
        raise DataError(f"{name0}: principal point {cx:g},{cy:g}: {expected}", path, line0)
    baseline = float(P0[0, 3] - P1[0, 3]) / f
    if not MIN_BASELINE_M <= baseline <= MAX_BASELINE_M:
        value = f"the baseline ({name0}[0,3] - {name1}[0,3]) / f is {baseline:g} m"
        raise DataError(
            f"{name1}: {value}, expected more than 0 and at most {MAX_BASELINE_M:g} m", path, line1
        )
    return StereoCamera(f, cx, cy, baseline, width, height)


def calibration_text(camera: StereoCamera) -> str:
    """Text of calib.txt: P0 to P3; P1 and P3 are right cameras, with -f b at the end of the first row."""
    lines = []
    for k in range(4):
        P = np.hstack([camera.K, np.zeros((3, 1))])
        P[0, 3] = -camera.f * camera.baseline * (k % 2)
        lines.append(f"P{k}: " + " ".join(f"{v:.12e}" for v in P.ravel()) + "\n")
    return "".join(lines)


def left_offset(path: Path, sides: tuple[str, str]) -> Array:
    """Position (3,) of the left camera in the axes of camera 0, metres, from calib.txt: zero for GREY.

    P2 = K [I | t] takes points X + t from camera 0 to camera 2, so camera 2 is at -t.
    """
    P = _read_projections(path, camera_names(sides))[0][0]
    return np.asarray(-np.linalg.solve(P[:, :3], P[:, 3]))


def _read_projections(path: Path, names: tuple[str, str]) -> list[tuple[Array, int]]:
    """Two matrices (3, 4) of calib.txt, such as P0 and P1, each with its line number."""
    matrices: dict[str, tuple[Array, int]] = {}
    for number, line in enumerate(read_text(path).splitlines(), start=1):
        name, _, rest = line.partition(":")
        if (name := name.strip()) not in names:
            continue
        try:
            values = np.array([float(word) for word in rest.split()])
        except ValueError:
            raise DataError(f"{name}: expected 12 numbers", path, number) from None
        if len(values) != 12 or not np.isfinite(values).all():
            raise DataError(f"{name}: expected 12 finite numbers, found {len(values)}", path, number)
        matrices[name] = values.reshape(3, 4), number
    for name in sorted(set(names) - matrices.keys()):
        raise DataError(f"{name} is missing: expected a line '{name}: ' with 12 numbers", path)
    return [matrices[name] for name in names]


def read_times(path: Path) -> Array:
    """Times (N,) of the frames in seconds from a file with one number per line; no time may decrease."""
    rows, lines = read_number_rows(path, "one number, the time of a frame in seconds", 1)
    decreases = rows[1:, 0] < rows[:-1, 0]
    if decreases.any():
        raise DataError("the time decreases", path, lines[int(np.argmax(decreases)) + 1])
    return rows[:, 0]


def list_frames(folder: Path) -> list[str]:
    """File stems of the stereo pairs in `image_folders`, in the order of their numbers.

    Raises `DataError` for a missing folder, an image without its partner, or a gap in the numbers, unless the
    gap is between two pieces of part.txt.
    """
    left, right = image_folders(folder)
    sides = []
    for side in (left, right):
        path = folder / side
        if not path.is_dir():
            raise DataError(
                f"the folder {side} is missing: expected PNG images in {left} and {right}; to import other "
                "images: vo data from_folder --left DIR --right DIR",
                folder,
            )
        sides.append({p.stem for p in path.glob("*.png") if re.fullmatch(r"\d+", p.stem)})
    for stem in sorted(sides[0] ^ sides[1], key=int):
        present, missing = (left, right) if stem in sides[0] else (right, left)
        path = folder / missing / f"{stem}.png"
        raise DataError(f"the image is missing, but its partner is in {present}", path)
    names = sorted(sides[0], key=lambda stem: (int(stem), stem))
    for before, after in itertools.pairwise(names):
        if int(after) != int(before) + 1 and not _gap_is_meant(folder, int(before), int(after)):
            path = folder / left / f"{int(before) + 1:0{len(before)}d}.png"
            raise DataError(f"the image is missing between {before}.png and {after}.png", path)
    return names


def _gap_is_meant(folder: Path, before: int, after: int) -> bool:
    """Whether part.txt has a piece that ends with frame `before`, and the next begins with frame `after`."""
    part = read_part(folder)
    if part is None:
        return False
    pairs = itertools.pairwise(part.pieces)
    return any((one.stop - 1, other.start) == (before, after) for one, other in pairs)


class Part(NamedTuple):
    """The text of part.txt, and the ranges of frame numbers in this text, in order and with gaps between."""

    text: str
    pieces: tuple[range, ...]

    @property
    def numbers(self) -> list[int]:
        """The numbers of all frames."""
        return list(itertools.chain(*self.pieces))


def read_part(folder: Path) -> Part | None:
    """The part of a sequence that part.txt names; None without the file.

    Examples: "--sequences 00 --frames 0:201", "--raw 2011_09_26_drive_0013 --frames 0:80",
    "--sequences 06 --frames 122:139,953:968". Raises `DataError` for any other text.
    """
    path = folder / PART
    if not path.exists():
        return None
    mark = _MARK.fullmatch(read_text(path).strip())
    if mark is None:
        raise DataError("expected a line such as --sequences 00 --frames 0:201", path, 1)
    pieces = []
    for text in mark[1].split(","):
        start, stop = text.split(":")
        pieces.append(range(int(start), int(stop)))
    if not all(pieces):
        raise DataError("expected a line such as --sequences 00 --frames 0:201", path, 1)
    if any(other.start <= one.stop for one, other in itertools.pairwise(pieces)):
        raise DataError("the pieces overlap or are not in order: expected 0:20,50:70", path, 1)
    return Part(mark[0], tuple(pieces))


def wanted_frames(folder: Path) -> list[int] | None:
    """Frame numbers of the complete part (part.txt) or sequence of the benchmark; None if unknown."""
    if (part := read_part(folder)) is not None:
        return part.numbers
    return list(range(EXPECTED_FRAMES[folder.name])) if folder.name in EXPECTED_FRAMES else None


def count_pairs(folder: Path) -> int:
    """Number of stereo pairs in a sequence's folder, from the file names only."""
    left, right = image_folders(folder)
    left_names = {path.name for path in (folder / left).glob("*.png")}
    right_names = {path.name for path in (folder / right).glob("*.png")}
    return len(left_names & right_names)


def read_stored(path: Path) -> NDArray[np.uint8] | NDArray[np.uint16]:
    """Grey values (H, W) as stored, of 8 or 16 bits; an orientation in EXIF is ignored.

    Raises `DataError` for a truncated or damaged file; part of an image is never returned.
    """
    data = read_bytes(path)
    kind = path.suffix[1:].upper()
    image = None
    # OpenCV refuses a damaged PNG too, but libpng then writes a line of its own to standard error.
    if data and (kind != "PNG" or has_valid_chunks(data)):
        try:
            flags = cv2.IMREAD_GRAYSCALE | cv2.IMREAD_IGNORE_ORIENTATION | cv2.IMREAD_ANYDEPTH
            image = cv2.imdecode(np.frombuffer(data, np.uint8), flags)
        except cv2.error:  # for example too many pixels for OpenCV
            pass
    if image is None:
        raise DataError(f"the image is truncated or damaged: expected a complete {kind} file", path)
    if image.dtype == np.uint16:
        return np.asarray(image, np.uint16)
    if image.dtype != np.uint8:
        raise DataError(f"the image has values of type {image.dtype}: expected 8 or 16 bits", path)
    return np.asarray(image, np.uint8)


def read_image(path: Path, bits: int | None = None) -> Image:
    """A grey image, (H, W) uint8; raises like `read_stored`.

    bits : bits of the grey values in all images of a sequence, from `grey_bits`; the highest 8 of them are
        kept. `DataError` for an image with more bits, or for one of 8 bits among images with more. With None,
        the high byte of a 16-bit value is kept.
    """
    image = read_stored(path)
    if image.dtype == np.uint8:
        if bits is not None and bits > BITS[0]:
            raise DataError(f"the image has 8 bits, the other images have grey values of {bits} bits", path)
        return np.asarray(image, np.uint8)
    if bits is not None and int(image.max()) >= 2**bits:
        largest = f"the image has 16 bits and grey values up to {image.max()}"
        raise DataError(f"{largest}, but the first image has {bits} bits: expected equal images", path)
    shift = (BITS[-1] if bits is None else bits) - BITS[0]
    return np.asarray(image >> shift, np.uint8)


def grey_bits(sides: Iterable[list[Path]]) -> int:
    """Bits that the largest grey value of all images needs: one of `BITS`; 8 if the first images have 8 bits.

    Cameras write values of 10 or 12 bits into images of 16 bits. All images are read, since one bright image
    decides.

    sides : the images of each camera.
    """
    needed = BITS[0]
    for files in sides:
        if not files or not _has_16_bits(files[0]):
            continue
        with ThreadPoolExecutor(READING_THREADS) as pool:
            largest = max(pool.map(_largest, files))
        needed = max(needed, next(bits for bits in BITS if largest < 2**bits))
    return needed


def _has_16_bits(path: Path) -> bool:
    """Whether the grey values of an image have 16 bits; of a PNG, only the header is read."""
    if path.suffix.lower() != ".png":
        return read_stored(path).dtype == np.uint16
    with open_binary(path) as file:
        header = file.read(PNG_DEPTH_AT + 1)
    return header.startswith(PNG_SIGNATURE) and header[PNG_DEPTH_AT:] == b"\x10"


def _largest(path: Path) -> int:
    return int(read_stored(path).max())


def bits_note(bits: int) -> str:
    """A sentence on grey values of more than 8 bits."""
    return f"the grey values need {bits} bits, so they are divided by {2 ** (bits - BITS[0])}"


def has_valid_chunks(png: bytes) -> bool:
    """Whether all chunks of a PNG file up to IEND are present and pass their checksums.

    In an animated PNG, the image must be one of the frames; otherwise, OpenCV returns black or another frame.
    """
    kinds = set[bytes]()
    if not png.startswith(PNG_SIGNATURE):
        return False
    start = len(PNG_SIGNATURE)
    while len(png) >= start + 12:
        length, kind = struct.unpack_from(">I4s", png, start)
        end = start + 12 + length
        if zlib.crc32(png[start + 4 : end - 4]).to_bytes(4) != png[end - 4 : end]:
            return False
        if kind == b"IEND":
            return True
        if kind == b"IDAT" and b"acTL" in kinds and b"fcTL" not in kinds:
            return False
        kinds.add(kind)
        start = end
    return False
