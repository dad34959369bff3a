"""Import of a user's stereo pairs: check, rectification, and a folder in KITTI's layout."""

from __future__ import annotations

import itertools
import os
import shutil
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from pathlib import Path

import cv2
import numpy as np

from fetch.stereo_calibration import RectifiedRig
from fetch.stereo_check import complaints, is_rectified, measure_pairs
from fetch.stereo_sources import FolderSource, Pair, Source
from vo_lib.data.catalogue import open_sequence
from vo_lib.data.kitti import IMAGE_BITS, calibration_text
from vo_lib.data.poses import refuse_intervals, write_kitti_poses
from vo_lib.errors import DataError
from vo_lib.files import locked_draft, write_atomic
from vo_lib.geometry.camera import StereoCamera
from vo_lib.geometry.types import Array, Progress

BATCH_PAIRS = 16  # pairs in memory
MEDIAN_DEPTHS_M = 5.0, 100.0  # plausible outdoors; KITTI and the drawn streets have 16 m to 46 m


def check_source(source: Source, rig: RectifiedRig, anyway: bool, outdoors: bool = False) -> list[str]:
    """Check a sample of pairs; return a line for each result. Raises `DataError` for failed checks.

    `anyway` : report problems as warnings, except a wrong sign of the baseline. `outdoors` : require a median
    depth in `MEDIAN_DEPTHS_M`.
    """
    sample = source.sample()
    statistics = measure_pairs(rig.rectify(*pair) for pair in sample)
    wrong = complaints(statistics, rig.baseline)
    if rig.maps is not None and is_rectified(measure_pairs(sample), statistics):
        wrong.append(
            "the rows match better without the rectification, so the images are rectified already: give "
            "--rectified if the file has P1 and P2, or --focal, --centre and --baseline of these images"
        )
    disparity = statistics.disparity
    depth = np.inf
    if disparity > 0:
        depth = rig.f * rig.baseline / disparity
    nearest, farthest = MEDIAN_DEPTHS_M
    if not wrong and outdoors and not nearest <= depth <= farthest:
        wrong.append(
            f"the median depth is {depth:.3g} m with a baseline of {rig.baseline:g} m and a focal length of "
            f"{rig.f:g} px, expected {nearest:g} to {farthest:g} m outdoors: check --baseline, --unit and "
            "--focal, or the calibration file"
        )
    if wrong and rig.baseline <= 0:
        raise DataError("; ".join(wrong))
    if wrong and not anyway:
        raise DataError("; ".join(wrong) + " (--anyway writes the sequence nevertheless)")
    return [
        *(f"warning: {sentence}" for sentence in wrong),
        f"{statistics.matches} matches in {statistics.pairs} pairs: rows differ by {statistics.row:+.2f} ± "
        f"{statistics.row_spread:.2f} px, median disparity {disparity:.1f} px, a depth of {depth:.1f} m",
    ]


def write_sequence(
    source: Source,
    rig: RectifiedRig,
    out: Path,
    times: Array | float,
    poses: Array | None = None,
    copy: bool = False,
    progress: Progress | None = None,
) -> int:
    """Write a sequence in KITTI's layout, and return its number of pairs; the folder appears when complete.

    PNG images that are already rectified are linked, or copied (with `copy`, or without links in the file
    system). Other images are rectified and written as grey PNG. Raises `DataError` for a damaged image, or an
    image of another size than the first left image.

    Parameters
    ----------
    times : (N,) seconds, or the frame rate, Hz. poses : (N, 4, 4) true poses T_w_c, or None.
    """
    with _new_folder(out) as folder:
        count = _write_pairs(source, rig, folder, copy, progress)
        if count < 2:
            raise DataError(f"expected two or more stereo pairs, found {count}")
        rows = np.arange(count) / times if isinstance(times, float) else times
        refuse_intervals(rows, "the times of the images (--times gives others)")
        for name, table in (("times", rows), ("poses", poses)):
            if table is not None and len(table) != count:
                found = f"{len(table)} rows of {name} for {count} pairs"
                raise DataError(f"{found}: expected a row per pair or per left image")
        write_tables(folder, rig, rows, poses)
        try:
            open_sequence(folder)
        except DataError as error:  # an unusable sequence is not kept
            raise DataError(str(error).replace(str(folder), str(out))) from None
    return count


def write_tables(folder: Path, rig: RectifiedRig, times: Array, poses: Array | None) -> None:
    """Write calib.txt, times.txt with times (N,), seconds, and, if there are poses (N, 4, 4), poses.txt."""
    camera = StereoCamera(rig.f, rig.cx, rig.cy, rig.baseline)
    write_atomic(folder / "calib.txt", calibration_text(camera))
    write_atomic(folder / "times.txt", "".join(f"{seconds:.9f}\n" for seconds in times))
    if poses is not None:
        write_kitti_poses(folder / "poses.txt", poses)


def require_new(out: Path) -> None:
    """Raise `DataError` if `out` is a file or a folder that is not empty."""
    if os.path.lexists(out) and (not out.is_dir() or any(out.iterdir())):
        raise DataError("already exists and is not empty; choose another folder", out)


@contextmanager
def _new_folder(out: Path) -> Iterator[Path]:
    """A temporary folder that is renamed to `out` after success and deleted after a failure."""
    require_new(out)
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        with locked_draft(out) as working:
            for side in ("image_0", "image_1"):
                (working / side).mkdir(parents=True)
            yield working
            if out.is_dir():
                out.rmdir()
            os.replace(working, out)
    except OSError as error:
        raise DataError(f"cannot be written: {error.strerror}", out) from None


def _write_pairs(
    source: Source, rig: RectifiedRig, folder: Path, copy: bool, progress: Progress | None
) -> int:
    """Read all pairs, a few of them in parallel, and link, copy or write them."""
    total = source.size_hint()
    files = _files_to_link(source) if rig.maps is None else None

    def write(number: int, read: Callable[[], Pair]) -> None:
        pair = rig.rectify(*read())
        for side, image in enumerate(pair):
            target = folder / f"image_{side}" / f"{number:06d}.png"
            if files is not None:
                _link(files[number][side], target, copy)
            else:
                target.write_bytes(cv2.imencode(".png", image)[1].tobytes())

    count = 0
    readers = source.pairs()
    with ThreadPoolExecutor(max_workers=min(os.cpu_count() or 1, 8)) as pool:
        while True:
            batch = list(itertools.islice(readers, BATCH_PAIRS))  # a video is too large for the memory
            if not batch:
                return count
            numbers = range(count, count + len(batch))
            for _ in pool.map(write, numbers, batch):  # raises the error of a pair
                count += 1
            if progress is not None:
                progress(count, max(total, count))


def _files_to_link(source: Source) -> list[tuple[Path, Path]] | None:
    """The files of all pairs, if they are PNG images of 8 bits and need no change; otherwise None."""
    if not isinstance(source, FolderSource) or source.bits != IMAGE_BITS:
        return None
    are_png = all(path.suffix.lower() == ".png" for pair in source.paths for path in pair)
    return source.paths if are_png else None


def _link(path: Path, target: Path, copy: bool) -> None:
    """Link an image; with `copy`, or without links in the file system, copy the image."""
    if not copy:
        with suppress(OSError):
            target.symlink_to(path.resolve())
            return
    shutil.copyfile(path, target)
