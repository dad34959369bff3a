"""The calibration in a user's files: the tool that wrote them is recognised by their content."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

from fetch.calibrations import kalibr, kitti_calib, opencv, realsense, ros, zed
from fetch.calibrations.numbers_in_text import differing_cameras, numbers_in, other_size_in
from fetch.calibrations.values import UnknownFile, side_of, too_deep, yaml_mapping
from fetch.rectification import FISHEYE, RADTAN, Lens
from fetch.stereo_calibration import FileCalibration
from vo_lib.errors import DataError
from vo_lib.files import read_bytes, read_text

ENDINGS = (".yaml", ".yml", ".xml", ".json", ".npz", ".conf", ".txt", ".ini")
UNEQUAL = 1e-3  # relative difference of fx and fy that rectified images do not have
OPTIONS = "--focal, --centre and --baseline"
KNOWN = "OpenCV (YAML, XML, JSON, .npz), Kalibr, ROS camera_info, RealSense (JSON), ZED (.conf), KITTI"


def read_user_calibration(
    paths: list[Path],
    size: tuple[int, int],
    folders: tuple[str, ...] = (),
    fisheye: bool = False,
) -> FileCalibration:
    """The calibration in files of one tool, or in the files of a folder.

    Parameters
    ----------
    paths : one file, several files (intrinsics and extrinsics; left and right camera), or a folder.
    size : width and height of the images, pixels.
    folders : folders of the left and the right images, which may name their cameras.
    fisheye : OpenCV's matrices have the four distortion numbers of `cv2.fisheye`.

    Raises `DataError` with the file and the remedy; for a file of an unknown form that has the numbers of a
    rectified camera, the remedy is the line of options with these numbers.
    """
    files: list[Path] = []
    for path in paths:
        if path.is_dir():
            files += _files_of(path)
        else:
            files.append(path)
    cameras: list[ros.CameraInfo] = []
    entries: list[opencv.Entries] = []
    whole: list[FileCalibration] = []
    for path in files:
        result = _read_file(path, size, folders)
        if isinstance(result, FileCalibration):
            whole.append(result)
        elif isinstance(result, opencv.Entries):
            entries.append(result)
        else:
            cameras += result
    if len(whole) + bool(cameras) + bool(entries) > 1:
        raise DataError(f"{len(files)} files of different tools: give one calibration", files[-1])
    if whole:
        return whole[0]
    if cameras:
        return ros.read_camera_infos(cameras)
    try:
        return _with_lens(opencv.read_matrices(entries, size), fisheye)
    except UnknownFile as error:
        raise _unknown(error, entries[0].path, size) from None


def _files_of(folder: Path) -> list[Path]:
    """The calibration files of a folder: of a left and a right camera if there are such, or else all."""
    files = sorted(path for path in folder.iterdir() if path.suffix.lower() in ENDINGS)
    for ending in (".yaml", ".yml"):
        sides = [path for path in files if path.suffix.lower() == ending and side_of(path.stem) is not None]
        if {side_of(path.stem) for path in sides} == {0, 1}:
            return sides
    if not files:
        raise DataError(f"expected calibration files ({', '.join(ENDINGS)}) in the folder", folder)
    return files


def _read_file(
    path: Path, size: tuple[int, int], folders: tuple[str, ...]
) -> FileCalibration | opencv.Entries | list[ros.CameraInfo]:
    """A whole calibration, cameras of ROS, or the matrices of OpenCV."""
    if path.suffix.lower() in (".npy", ".pkl", ".pickle", ".p"):
        raise DataError("may contain programs and is not read: save the matrices by numpy.savez", path)
    if opencv.is_archive(read_bytes(path)):
        return opencv.read_archive(path)
    text = read_text(path)
    if too_deep(text):
        raise DataError("is not a stereo calibration: too many brackets", path)
    if zed.is_conf(text):
        return zed.read_conf(text, path, size)
    if kitti_calib.is_kitti(text):
        return kitti_calib.read_kitti(path, folders, size)
    if ros.is_ost(text):
        return ros.parse_ost(text, path)
    if text.lstrip().startswith(("{", "[")):
        content = _json(text)
        if realsense.has_cameras(content):
            return realsense.read_realsense(content, path)
        mapping: dict[Any, Any] = content
    else:
        mapping = yaml_mapping(text)
    if kalibr.is_chain(mapping):
        return kalibr.read_chain(mapping, path, folders)
    if ros.is_camera_info(mapping):
        return [ros.parse_camera_info(mapping, path)]
    # A FileStorage has `dt` in each matrix, and is read by OpenCV.
    nested = opencv.nested_entries(mapping, path)
    if opencv.has_matrices(nested) and not re.search(r"\bdt\b", text):
        return nested
    try:
        return opencv.read_storage(path)
    except UnknownFile as error:
        raise _unknown(error, path, size) from None


def _json(text: str) -> dict[str, Any]:
    """The object in a JSON text; a list becomes an object with the one name ""; {} for any other text."""
    try:
        content = json.loads(text)
    except (ValueError, RecursionError):
        return {}
    return content if isinstance(content, dict) else {"": content}


def _with_lens(calibration: FileCalibration, fisheye: bool) -> FileCalibration:
    """The calibration with the lens model of four distortion numbers, which OpenCV's names do not tell."""
    counts = [calibration.matrices[name].size for name in ("D1", "D2") if name in calibration.matrices]
    if fisheye or calibration.lenses[0].model == FISHEYE:
        if any(count != 4 for count in counts):
            raise DataError("a fisheye lens has four distortion numbers (of cv2.fisheye)", calibration.path)
        return replace(calibration, lenses=(Lens(FISHEYE), Lens(FISHEYE)))
    if 4 in counts:
        note = (
            f"the four distortion numbers are read as k1 k2 p1 p2 ({RADTAN}); of cv2.fisheye: add --fisheye"
        )
        return replace(calibration, notes=(*calibration.notes, note))
    return calibration


def _unknown(error: UnknownFile, path: Path, size: tuple[int, int]) -> DataError:
    """The error for a file without known matrices; with the options if its text has the numbers.

    The options have no size, and one principal point for both cameras: a text that names another size than
    `size`, that of the images, or cameras that differ, gets no options.
    """
    try:
        text = read_text(path)
    except DataError:  # an archive
        text = ""
    numbers = numbers_in(text)
    if numbers is None:
        return DataError(f"{error}; files that are read: {KNOWN}; for rectified images: {OPTIONS}")
    fault = other_size_in(text, size)
    if fault:
        return DataError(f"is of an unknown form; {fault}", path)
    difference = differing_cameras(text)
    if difference:
        return DataError(
            f"is of an unknown form, and its cameras differ ({difference}), but {OPTIONS} are one camera's: "
            "write K1, D1, K2, D2, R and T of both cameras into a file of OpenCV",
            path,
        )
    condition = "if the images are rectified"
    if abs(numbers.fx - numbers.fy) > UNEQUAL * numbers.fx:
        condition += f" (then fx and fy are equal; here they are {numbers.fx:g} and {numbers.fy:g})"
    options = numbers.options()
    return DataError(f"is of an unknown form; {condition}, replace --calibration by {options}", path)
