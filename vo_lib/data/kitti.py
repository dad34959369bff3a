"""Files of a KITTI odometry folder: calib.txt, times.txt, numbered images."""

from __future__ import annotations

import itertools
import os
import re
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from ..errors import DataError
from ..files import read_bytes, read_text
from ..geometry.camera import StereoCamera
from ..geometry.types import Array, Image
from .poses import finite_number, read_number_rows, refuse_intervals

_WITH_TRUTH = (4541, 1101, 4661, 801, 271, 2761, 1101, 1101, 4071, 1591, 1201)  # frames of 00 to 10
_WITHOUT_TRUTH = (921, 1061, 3281, 631, 1901, 1731, 491, 1801, 4981, 831, 2721)  # frames of 11 to 21
EXPECTED_FRAMES = {f"{number:02d}": count for number, count in enumerate(_WITH_TRUTH + _WITHOUT_TRUTH)}

PART = "part.txt"  # in a folder with part of a sequence: the options of `vo data get_kitti` for this part
_RANGE = r"\d{1,6}:\d{1,6}"
_PART_OPTIONS = re.compile(
    rf"(?:--sequences \d\d|--raw [0-9_]+_drive_\d{{4}}) --frames ({_RANGE}(?:,{_RANGE})*)", re.ASCII
)
_EXPECTED_PART = "expected the options of `vo data get_kitti`, such as --sequences 00 --frames 0:201"
_MEANING_OF_PIECE = "A:B has the frames A to B-1"

MAX_FOCAL_PX = 1e6  # also for the principal point; larger numbers overflow in later computations
MIN_BASELINE_M = 1e-5  # no two cameras stand closer
MAX_BASELINE_M = 10.0  # a longer baseline is probably in millimetres
ROWS_OF_P = 3  # of a matrix of calib.txt, whose line has the rows one after the other
COLUMNS_OF_P = 4
SAME_ENTRIES = 1e-6  # largest difference of equal entries of P0 and P1, as a share of the focal length

GREY = ("image_0", "image_1")  # folders of the left and of the right images
COLOUR = ("image_2", "image_3")
IMAGE_BITS = 8  # of the grey values that the kit works with
FILE_BITS = 16  # of the grey values in files that have more than 8
# Cameras write values of 10, 12 or 14 bits into files of 16 bits.
BITS = (IMAGE_BITS, 10, 12, 14, FILE_BITS)
READING_THREADS = min(os.cpu_count() or 1, 8)


def image_folders(folder: Path) -> tuple[str, str]:
    """Names of the folders of the left and the right images: COLOUR if a sequence has no grey images."""
    has_grey = any((folder / name).exists() for name in GREY)
    has_colour = all((folder / name).is_dir() for name in COLOUR)
    if has_colour and not has_grey:
        return COLOUR
    return GREY


def find_truth(folder: Path) -> Path | None:
    """The file of a sequence's true poses; None if there is none.

    In KITTI's layout, it is poses/00.txt beside `sequences`, whatever else is in the sequence's folder: other
    data sets unpack a poses.txt of their own there. A folder that is a link is in the layout if the link or
    what it leads to is. Only without KITTI's own file, it is poses.txt in the folder.
    """
    places = (Path(os.path.abspath(folder)), folder.resolve())
    in_layout = [place for place in places if place.parent.name == "sequences"]
    of_kitti = [place.parent.parent / "poses" / f"{place.name}.txt" for place in in_layout]
    return next(filter(os.path.lexists, [*of_kitti, folder / "poses.txt"]), None)


def has_images(folder: Path) -> bool:
    """Whether a folder has the left images of a sequence."""
    left, _ = image_folders(folder)
    return (folder / left).is_dir()


def projection_names(sides: tuple[str, str]) -> tuple[str, str]:
    """Names of the matrices in calib.txt for these image folders: P0 and P1, or P2 and P3."""
    left, right = sides
    return f"P{left.removeprefix('image_')}", f"P{right.removeprefix('image_')}"


def read_calibration(
    path: Path, width: int = 0, height: int = 0, sides: tuple[str, str] = GREY
) -> StereoCamera:
    """Camera from calib.txt. P0 has f, cx and cy; the baseline is (P0[0,3] - P1[0,3]) / f, in metres.

    width, height : image size, pixels; 0 if unknown. sides : image folders; COLOUR has P2 and P3 instead.

    Raises `DataError` with the line number for a missing matrix, wrong numbers, cameras that are not
    rectified, a principal point outside the images, or a baseline outside `MIN_BASELINE_M` to
    `MAX_BASELINE_M`.
    """
    left, right = _read_projections(path, projection_names(sides))
    f = float(left.P[0, 0])
    cx = float(left.P[0, 2])
    cy = float(left.P[1, 2])
    if not 1.0 <= f <= MAX_FOCAL_PX or max(abs(cx), abs(cy)) > MAX_FOCAL_PX:
        values = f"f {f:g}, centre {cx:g},{cy:g}"
        expected = f"expected pixels, a focal length of 1 to {MAX_FOCAL_PX:g}"
        raise DataError(f"{left.name}: {values}: {expected}", path, left.line)
    K = np.array([[f, 0, cx], [0, f, cy], [0, 0, 1]])
    if np.abs(left.P[:, :3] - K).max() > SAME_ENTRIES * f:
        shape = "expected f 0 cx in row 1, 0 f cy in row 2, 0 0 1 in row 3"
        raise DataError(f"{left.name}: {shape}", path, left.line)
    if np.abs(left.P[:, :3] - right.P[:, :3]).max() > SAME_ENTRIES * f:
        words = f"{left.name} and {right.name} differ in their first three columns"
        raise DataError(f"{words}: not a rectified pair", path, right.line)
    if width and not (0 <= cx < width and 0 <= cy < height):
        expected = f"expected a point inside the images of {width}×{height} px"
        raise DataError(f"{left.name}: principal point {cx:g},{cy:g}: {expected}", path, left.line)
    baseline = float(left.P[0, 3] - right.P[0, 3]) / f
    if not MIN_BASELINE_M <= baseline <= MAX_BASELINE_M:
        value = f"the baseline ({left.name}[0,3] - {right.name}[0,3]) / f is {baseline:g} m"
        expected = f"expected {1000 * MIN_BASELINE_M:g} mm to {MAX_BASELINE_M:g} m"
        raise DataError(f"{right.name}: {value}, {expected}", path, right.line)
    return StereoCamera(f, cx, cy, baseline, width, height)


def calibration_text(camera: StereoCamera) -> str:
    """Text of calib.txt: P0 to P3; P1 and P3 are right cameras, with -f b at the end of the first row."""
    lines = []
    for number in range(4):
        baseline = camera.baseline if number in (1, 3) else 0.0
        P = np.hstack([camera.K, np.zeros((3, 1))])
        P[0, 3] = -camera.f * baseline
        values = " ".join(f"{value:.12e}" for value in P.ravel())
        lines.append(f"P{number}: {values}\n")
    return "".join(lines)


def left_offset(path: Path, sides: tuple[str, str]) -> Array:
    """Position (3,) of the left camera in the axes of camera 0, metres, from calib.txt: zero for GREY.

    P2 = K [I | t] takes a point X of camera 0 to the point X + t of camera 2, so camera 2 is at -t. Raises
    `DataError` as `read_calibration` for a matrix that is missing or has wrong numbers.
    """
    left, _ = _read_projections(path, projection_names(sides))
    t = np.linalg.solve(left.P[:, :3], left.P[:, 3])
    return np.asarray(-t)


class _Projection(NamedTuple):
    """A matrix P (3, 4) of calib.txt, with its name and the number of its line."""

    name: str
    P: Array
    line: int


def _read_projections(path: Path, names: tuple[str, str]) -> tuple[_Projection, _Projection]:
    """The left and the right of two matrices of calib.txt, such as P0 and P1."""
    found: dict[str, _Projection] = {}
    for number, line in enumerate(read_text(path).splitlines(), start=1):
        before, _, after = line.partition(":")
        name = before.strip()
        if name not in names:
            continue
        words = after.split()
        if len(words) != ROWS_OF_P * COLUMNS_OF_P:
            expected = "expected 12 numbers separated by blanks"
            raise DataError(f"{name}: {expected}, found {len(words)}", path, number)
        P = np.zeros((ROWS_OF_P, COLUMNS_OF_P))
        for place, word in enumerate(words):
            row, column = divmod(place, COLUMNS_OF_P)
            try:
                P[row, column] = finite_number(word)
            except ValueError as error:
                where = f"{name}, row {row + 1}, column {column + 1}"
                raise DataError(f"{where}: {error}; expected 12 numbers", path, number) from None
        found[name] = _Projection(name, P, number)
    for name in names:
        if name not in found:
            raise DataError(f"{name} is missing: expected a line '{name}: ' with 12 numbers", path)
    left, right = names
    return found[left], found[right]


def read_times(path: Path) -> Array:
    """Times (N,) of the frames in seconds from a file with one number per line.

    Raises `DataError` with the line for a row that is not a number, or a time that decreases, and for times
    that are not seconds of a camera (`refuse_intervals`).
    """
    rows, lines = read_number_rows(path, "one number, the time of a frame in seconds", 1)
    decreases = rows[1:, 0] < rows[:-1, 0]
    if decreases.any():
        raise DataError("the time decreases", path, lines[int(np.argmax(decreases)) + 1])
    refuse_intervals(rows[:, 0], path)
    return rows[:, 0]


def list_frames(folder: Path) -> list[str]:
    """File stems of the stereo pairs, such as "000000", in the order of their numbers.

    Raises `DataError` for a missing folder, an image without its partner, or a gap in the numbers, unless the
    gap is between two pieces of part.txt.
    """
    left, right = image_folders(folder)
    for side in (left, right):
        if not (folder / side).is_dir():
            remedy = "to import other images: vo data from_folder --left DIR --right DIR"
            raise DataError(
                f"the folder {side} is missing: expected PNG images in {left} and {right}; {remedy}", folder
            )
    left_stems = _numbered_stems(folder / left)
    right_stems = _numbered_stems(folder / right)
    unpaired = left_stems ^ right_stems
    if unpaired:
        stem = min(unpaired, key=int)
        if stem in left_stems:
            raise DataError(
                f"the image is missing, but its partner is in {left}", folder / right / f"{stem}.png"
            )
        raise DataError(f"the image is missing, but its partner is in {right}", folder / left / f"{stem}.png")
    stems = sorted(left_stems, key=lambda stem: (int(stem), stem))
    for before, after in itertools.pairwise(stems):
        if int(after) != int(before) + 1 and not _gap_is_meant(folder, int(before), int(after)):
            missing = f"{int(before) + 1:0{len(before)}d}.png"
            raise DataError(
                f"the image is missing between {before}.png and {after}.png", folder / left / missing
            )
    return stems


def _numbered_stems(folder: Path) -> set[str]:
    """File stems of the PNG images in a folder that are named by a number."""
    return {path.stem for path in folder.glob("*.png") if re.fullmatch(r"\d+", path.stem)}


def _gap_is_meant(folder: Path, last: int, first: int) -> bool:
    """Whether part.txt has a piece that ends with frame `last`, and the next begins with frame `first`."""
    part = read_part(folder)
    if part is None:
        return False
    for before, after in itertools.pairwise(part.pieces):
        if before.stop - 1 == last and after.start == first:
            return True
    return False


class Part(NamedTuple):
    """A part of a sequence: the text of part.txt, and the ranges of frame numbers that it names.

    The ranges are in order, with gaps between them.
    """

    text: str
    pieces: tuple[range, ...]

    @property
    def numbers(self) -> list[int]:
        """The numbers of all frames."""
        return list(itertools.chain.from_iterable(self.pieces))


def read_part(folder: Path) -> Part | None:
    """The part of a sequence that part.txt names; None without the file.

    Examples: "--sequences 00 --frames 0:201", "--raw 2011_09_26_drive_0013 --frames 0:80",
    "--sequences 06 --frames 122:139,953:968". As in Python, a piece A:B has the frames A to B - 1.

    Raises `DataError` for any other text, and for pieces without a gap between them.
    """
    path = folder / PART
    if not path.exists():
        return None
    options = _PART_OPTIONS.fullmatch(read_text(path).strip())
    if options is None:
        raise DataError(_EXPECTED_PART, path, 1)
    pieces = []
    for text in options[1].split(","):
        start, stop = text.split(":")
        piece = range(int(start), int(stop))
        if len(piece) == 0:
            raise DataError(f"the piece {text} has no frame: {_MEANING_OF_PIECE}", path, 1)
        pieces.append(piece)
    for before, after in itertools.pairwise(pieces):
        if after.start <= before.stop:
            raise DataError(_without_gap(before, after), path, 1)
    return Part(options[0], tuple(pieces))


def _without_gap(before: range, after: range) -> str:
    """The sentence for two pieces of part.txt, one written behind the other, that no gap separates."""
    pieces = f"{before.start}:{before.stop} and {after.start}:{after.stop}"
    if after.stop <= before.start:
        return f"the pieces {pieces} are not in order: expected the smaller frame numbers first"
    together = f"{min(before.start, after.start)}:{max(before.stop, after.stop)}"
    if after.start == before.stop:
        return f"no frame is missing between the pieces {pieces}: {_MEANING_OF_PIECE}, so write {together}"
    return f"the pieces {pieces} overlap: {_MEANING_OF_PIECE}, so both together are {together}"


def wanted_frames(folder: Path) -> list[int] | None:
    """Frame numbers of the complete part (part.txt) or sequence of the benchmark; None if unknown."""
    part = read_part(folder)
    if part is not None:
        return part.numbers
    if folder.name in EXPECTED_FRAMES:
        return list(range(EXPECTED_FRAMES[folder.name]))
    return None


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
    file_format = path.suffix[1:].upper()
    image = decode_image(data, cv2.IMREAD_GRAYSCALE | cv2.IMREAD_IGNORE_ORIENTATION | cv2.IMREAD_ANYDEPTH)
    if image is None:
        raise DataError(f"the image is truncated or damaged: expected a complete {file_format} file", path)
    if image.dtype == np.uint16:
        return np.asarray(image, np.uint16)
    if image.dtype != np.uint8:
        raise DataError(f"the image has values of type {image.dtype}: expected 8 or 16 bits", path)
    return np.asarray(image, np.uint8)


def decode_image(data: bytes, flags: int) -> NDArray[Any] | None:
    """The image in a file's bytes, decoded with OpenCV's flags; None if OpenCV cannot decode it."""
    try:
        return cv2.imdecode(np.frombuffer(data, np.uint8), flags)
    except cv2.error:  # for example too many pixels
        return None


def read_image(path: Path, bits: int | None = None) -> Image:
    """A grey image, (H, W) uint8; raises like `read_stored`.

    bits : bits of the grey values in all images of a sequence, from `grey_bits`; the highest 8 of them are
        kept. `DataError` for an image with more bits, or for one of 8 bits among images with more. With None,
        the high byte of a 16-bit value is kept.
    """
    image = read_stored(path)
    if image.dtype == np.uint8:
        if bits is not None and bits > IMAGE_BITS:
            raise DataError(f"the image has 8 bits, the other images have grey values of {bits} bits", path)
        return np.asarray(image, np.uint8)
    if bits is not None and int(image.max()) >= 2**bits:
        largest = f"the image has 16 bits and grey values up to {image.max()}"
        raise DataError(f"{largest}, but the first image has {bits} bits: expected equal images", path)
    used_bits = FILE_BITS if bits is None else bits
    return np.asarray(image >> (used_bits - IMAGE_BITS), np.uint8)


def grey_bits(files_by_camera: Iterable[list[Path]]) -> int:
    """Bits that the largest grey value of all images needs: one of `BITS`; 8 if the first images have 8 bits.

    With 16 bits in the files, all images are read, since one bright image decides.

    files_by_camera : the images of each camera.
    """
    needed = IMAGE_BITS
    for files in files_by_camera:
        if not files or read_stored(files[0]).dtype == np.uint8:
            continue
        with ThreadPoolExecutor(READING_THREADS) as pool:
            largest = max(pool.map(_largest_value, files))
        needed = max(needed, next(bits for bits in BITS if largest < 2**bits))
    return needed


def _largest_value(path: Path) -> int:
    """The largest grey value of an image, as stored."""
    return int(read_stored(path).max())


def bits_note(bits: int) -> str:
    """A sentence on grey values of more than 8 bits."""
    return f"the grey values need {bits} bits, so they are divided by {2 ** (bits - IMAGE_BITS)}"
