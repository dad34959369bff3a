"""Files of a KITTI odometry folder: calib.txt, times.txt, numbered grey images."""

from __future__ import annotations

import itertools
import os
import re
import struct
import zlib
from pathlib import Path

import cv2
import numpy as np

from ..core.camera import StereoCamera
from ..core.errors import DataError
from ..core.files import read_bytes, read_text
from ..core.poses import read_rows
from ..core.types import Array, Image

# Stereo pairs of each sequence of the benchmark; of 00-10 also the rows of its pose file.
_FRAMES = (
    *(4541, 1101, 4661, 801, 271, 2761, 1101, 1101, 4071, 1591, 1201),
    *(921, 1061, 3281, 631, 1901, 1731, 491, 1801, 4981, 831, 2721),
)
EXPECTED_FRAMES = {f"{number:02d}": frames for number, frames in enumerate(_FRAMES)}

# Far beyond any camera; numbers beyond these overflow later on.
LONGEST = 1e6  # pixels of focal length and principal point, metres of baseline
SHORTEST_BASELINE = 1e-5  # metres
PNG = b"\x89PNG\r\n\x1a\n"  # how such a file begins
NARROWEST, WIDEST = 3.0, 160.0  # degrees, angle of view across the image; KITTI's cameras have 81


def read_calibration(path: Path, width: int = 0, height: int = 0) -> StereoCamera:
    """Camera from calib.txt: f, cx, cy from P0, baseline b = (P0[0,3] - P1[0,3]) / f; KITTI's P0[0,3] is 0.

    width, height : of the images, pixels; 0 where they are not known.

    Raises `DataError` for a missing file or matrix, wrong numbers, cameras that are not rectified, a baseline
    that is not positive, or lengths that no camera has, none that takes images of that size.
    """
    matrices: dict[str, tuple[Array, int]] = {}
    for number, line in enumerate(read_text(path).splitlines(), start=1):
        name, colon, rest = line.partition(":")
        name = name.strip()
        if name not in ("P0", "P1") or not colon:
            continue
        if name in matrices:
            raise DataError(f"{name} stands there twice", path, number)
        try:
            values = np.array([float(word) for word in rest.split()])
        except ValueError:
            raise DataError(f"{name}: expected 12 numbers", path, number) from None
        if len(values) != 12 or not np.isfinite(values).all():
            raise DataError(f"{name}: expected 12 finite numbers, found {len(values)}", path, number)
        matrices[name] = values.reshape(3, 4), number
    for name in ("P0", "P1"):
        if name not in matrices:
            raise DataError(f"{name} is missing: expected a line '{name}: ' with 12 numbers", path)
    (P0, line0), (P1, line1) = matrices["P0"], matrices["P1"]
    f = float(P0[0, 0])
    if f <= 0 or abs(P0[1, 1] - f) > 1e-6 * f:
        raise DataError("P0: expected one positive focal length for both axes", path, line0)
    if np.abs(P0[:, :3] - P1[:, :3]).max() > 1e-6 * f:
        raise DataError("P0 and P1 differ in their first three columns: not a rectified pair", path, line1)
    if not 1.0 <= f <= LONGEST or np.abs(P0[:2, 2]).max() > LONGEST:
        found = f"f {f:g}, centre {P0[0, 2]:g},{P0[1, 2]:g}"
        raise DataError(f"P0: {found}: expected the pixels of a camera, f from 1 to {LONGEST:g}", path, line0)
    baseline = float(P0[0, 3] - P1[0, 3]) / f
    if not SHORTEST_BASELINE <= baseline <= LONGEST:
        raise DataError(
            f"P1: the baseline (P0[0,3] - P1[0,3]) / f is {baseline:g} m, expected a positive one",
            path,
            line1,
        )
    camera = StereoCamera(f, float(P0[0, 2]), float(P0[1, 2]), baseline, width, height)
    said = f"{width}×{height} px images"
    if width and not (0 <= camera.cx < width and 0 <= camera.cy < height):
        centre = f"{camera.cx:g},{camera.cy:g}"
        raise DataError(f"P0: principal point {centre}: expected one inside the {said}", path, line0)
    angle = float(np.degrees(2.0 * np.arctan(0.5 * width / f)))
    if width and not NARROWEST <= angle <= WIDEST:
        expected = f"expected {NARROWEST:g} to {WIDEST:g}"
        found = f"{said} would show {angle:.1f} degrees"
        raise DataError(f"P0: focal length {f:g} px: {found}, {expected}", path, line0)
    return camera


def read_times(path: Path) -> Array:
    """Seconds of each frame, one number a line, never falling. (N,)"""
    rows, lines = read_rows(path, "one number, the seconds of a frame", 1)
    falls = rows[1:, 0] < rows[:-1, 0]
    if falls.any():
        raise DataError("time goes back", path, lines[int(np.argmax(falls)) + 1])
    return rows[:, 0]


def list_frames(folder: Path) -> list[str]:
    """Names without ending of the stereo pairs in image_0 and image_1, in the order of their numbers.

    Raises `DataError` for a missing folder, an image that has no partner, a gap in the numbers or a number
    that stands there twice.
    """
    sides = []
    for side in ("image_0", "image_1"):
        path = folder / side
        if not path.is_dir():
            raise DataError(
                f"the folder {side} is missing: expected PNG images in image_0 and image_1", folder
            )
        sides.append({p.stem for p in path.glob("*.png") if re.fullmatch(r"\d+", p.stem)})
    for stem in sorted(sides[0] ^ sides[1], key=int):
        there, missing = ("image_0", "image_1") if stem in sides[0] else ("image_1", "image_0")
        raise DataError(f"the image is missing; {there} has its partner", folder / missing / f"{stem}.png")
    names = sorted(sides[0], key=lambda stem: (int(stem), stem))
    for before, after in itertools.pairwise(names):
        if int(after) == int(before):
            raise DataError(f"the image has the number of {before}.png", folder / "image_0" / f"{after}.png")
        if int(after) != int(before) + 1:
            lost = str(int(before) + 1).zfill(len(before))
            raise DataError(
                "the image is missing in the middle of the sequence", folder / "image_0" / f"{lost}.png"
            )
    return names


def numbered(folder: Path) -> dict[int, str]:
    """File names of a folder's images by their numbers; none where there is no folder."""
    try:
        names = os.listdir(folder)
    except OSError:
        return {}
    return {int(name[:-4]): name for name in sorted(names) if re.fullmatch(r"\d+\.png", name)}


def count_pairs(folder: Path) -> int:
    """Stereo pairs of a sequence's folder, by their file names only."""
    return len(numbered(folder / "image_0").keys() & numbered(folder / "image_1").keys())


def read_image(path: Path) -> Image:
    """A grey PNG, (H, W) uint8. A truncated or damaged file raises `DataError`, never a half image."""
    data = read_bytes(path)
    if not data.startswith(PNG):
        raise DataError("the image is truncated or damaged: expected a whole PNG file", path)
    return decode_image(data, path)


def decode_image(data: bytes, path: Path) -> Image:
    """A grey image from the bytes of a file, (H, W) uint8; `DataError` where OpenCV cannot decode them."""
    if data.startswith(PNG) and not _png_is_whole(data):  # OpenCV's decoder would say so in words of its own
        raise DataError("the image is truncated or damaged: expected a whole PNG file", path)
    try:
        image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_GRAYSCALE) if data else None
    except cv2.error:  # such as more pixels than OpenCV takes
        image = None
    if image is None:
        raise DataError(f"the image cannot be decoded: expected a whole {path.suffix[1:].upper()} file", path)
    return np.asarray(image, np.uint8)


def _png_is_whole(data: bytes) -> bool:
    """Whether all chunks up to IEND are there with right checksums: decoders fill what is lost with grey."""
    start, view = 8, memoryview(data)
    while start + 12 <= len(data):
        length, kind = struct.unpack_from(">I4s", data, start)
        end = start + 12 + length
        if (
            end > len(data)
            or zlib.crc32(view[start + 4 : end - 4]) != struct.unpack_from(">I", data, end - 4)[0]
        ):
            return False
        if kind == b"IEND":
            return True
        start = end
    return False
