"""Drives of KITTI's raw data (synced and rectified): images, calibration, times, poses from the GPS/IMU."""

from __future__ import annotations

import re
from contextlib import suppress
from pathlib import Path

import numpy as np

from fetch.stereo_calibration import rig_from_matrices
from fetch.stereo_sources import Drive, pair_images
from vo_lib.data.kitti import read_image
from vo_lib.data.poses import is_rotation, read_rows
from vo_lib.errors import DataError
from vo_lib.files import read_text
from vo_lib.geometry.motion import inverse, nearest_rotation, rigid, rotation_from_vector
from vo_lib.geometry.types import Array

EARTH_RADIUS_M = 6378137.0  # equatorial radius
# Limits of latitude and longitude, degrees (without the poles); altitude, metres; roll, pitch, yaw, radians.
OXTS_LIMITS = np.array([85.0, 180.0, 1e5, 7.0, 7.0, 7.0])
MAX_SENSOR_DISTANCE_M = 100.0  # largest distance of two sensors on one vehicle
MOMENT = re.compile(r"\d{4}-\d\d-\d\d \d\d:\d\d:\d\d(\.\d{1,9})?", re.ASCII)


def read_raw_drive(drive: Path, skip_unpaired: bool = False) -> Drive:
    """The drive in a folder such as 2011_09_26_drive_0005_sync; the calibration may be in the parent folder.

    Raises `DataError` with the name of a missing or invalid file.
    """
    left, right = (drive / f"image_0{camera}" / "data" for camera in (0, 1))
    if not left.is_dir() or not right.is_dir():
        raise DataError("is not a raw drive: expected image_00/data and image_01/data", drive)
    return describe_drive(drive, pair_images(left, right, skip_unpaired=skip_unpaired).paths)


def describe_drive(drive: Path, paths: list[tuple[Path, Path]]) -> Drive:
    """Calibration, times and poses of a drive folder; the images may be in another folder.

    paths : left and right image of each frame, named by the frame's number in the drive.

    Raises `DataError` with the name of a missing or invalid file.
    """
    paths = [pair for pair in paths if pair[0].stem.isdecimal()]
    stems = [left.stem.zfill(10) for left, _ in paths]
    where = drive if (drive / "calib_cam_to_cam.txt").exists() else drive.resolve().parent
    path = where / "calib_cam_to_cam.txt"
    cameras = read_calibration_file(path)
    P = {f"P{camera + 1}": _matrix(cameras, f"P_rect_0{camera}", (3, 4), path) for camera in (0, 1)}
    first, size = paths[0][0], _matrix(cameras, "S_rect_00", (2,), path)
    height, width = read_image(first).shape
    if (width, height) != tuple(size):
        raise DataError(
            f"the image is {width}×{height}, rectified images are {size[0]:.0f}×{size[1]:.0f}: "
            "use the drive's 'synced+rectified data' (_sync), not the unrectified _extract",
            first,
        )
    path_of_times = drive / "image_00" / "timestamps.txt"
    moments = _timestamps(path_of_times)
    if len(moments) <= int(stems[-1]):
        raise DataError(f"expected a row for every image up to {stems[-1]}", path_of_times, len(moments))
    times = moments[[int(stem) for stem in stems]]
    poses, note = _poses(drive, where, cameras, stems)
    rig = rig_from_matrices(P, (0, 0), path, rectified=True)
    return Drive(paths, times - times[0], note, rig=rig, poses=poses)


def read_calibration_file(path: Path) -> dict[str, Array]:
    """The lines `name: numbers` of a KITTI calibration file; other lines are skipped."""
    values = {}
    for line in read_text(path).splitlines():
        name, _, rest = line.partition(":")
        with suppress(ValueError):  # a date
            values[name.strip()] = np.array([float(word) for word in rest.split()])
    return values


def _matrix(matrices: dict[str, Array], name: str, shape: tuple[int, ...], path: Path) -> Array:
    values = matrices.get(name, np.zeros(0))
    if len(values) != np.prod(shape) or not np.isfinite(values).all():
        raise DataError(f"expected a line '{name}: ' with {np.prod(shape)} numbers", path)
    return values.reshape(shape)


def _timestamps(path: Path) -> Array:
    """Times (N,) of lines such as `2011-09-26 13:02:25.964389445`, seconds after the first line."""
    moments = []
    for number, line in enumerate(read_text(path).splitlines(), start=1):
        try:
            if MOMENT.fullmatch(line.strip()):
                moments.append(np.datetime64(line.strip(), "ns"))
            elif line.strip():
                raise ValueError
        except ValueError:
            raise DataError("expected a time such as 2011-09-26 13:02:25.964389445", path, number) from None
        if moments[-1:] < moments[-2:-1]:
            raise DataError("the time decreases", path, number)
    stamps = np.array(moments, "datetime64[ns]")
    return np.asarray((stamps - stamps[:1]) / np.timedelta64(1, "s"), np.float64)


def _poses(drive: Path, where: Path, cameras: dict[str, Array], stems: list[str]) -> tuple[Array | None, str]:
    needed = [where / "calib_imu_to_velo.txt", where / "calib_velo_to_cam.txt"]
    packets = [drive / "oxts" / "data" / f"{stem}.txt" for stem in stems]
    for path in (*needed, *packets):
        if not path.exists():
            return None, f"no true poses: {path} is missing"
    velo_imu, cam_velo = (_rigid(path) for path in needed)
    R_rect = _rotation(cameras, "R_rect_00", where / "calib_cam_to_cam.txt")
    T_cam_imu = rigid(R_rect, np.zeros(3)) @ cam_velo @ velo_imu
    rows = np.concatenate([read_rows(path, "30 numbers of a GPS/IMU packet", 30)[0] for path in packets])
    wrong = (np.abs(rows[:, :6]) > OXTS_LIMITS).any(axis=1)
    if wrong.any():
        path = packets[int(np.argmax(wrong))]
        raise DataError("invalid latitude, longitude, altitude, roll, pitch or yaw", path, 1)
    T_w_imu = imu_poses(rows)
    T = T_cam_imu @ inverse(T_w_imu[:1]) @ T_w_imu @ inverse(T_cam_imu)
    return T, ""


def _rigid(path: Path) -> Array:
    lines_by_name = read_calibration_file(path)
    T = _matrix(lines_by_name, "T", (3,), path)
    if np.abs(T).max() > MAX_SENSOR_DISTANCE_M:
        raise DataError(f"T: expected a translation of at most {MAX_SENSOR_DISTANCE_M:g} m", path)
    return rigid(nearest_rotation(_rotation(lines_by_name, "R", path)), T)


def _rotation(matrices: dict[str, Array], name: str, path: Path) -> Array:
    R = _matrix(matrices, name, (3, 3), path)
    if not is_rotation(R):
        raise DataError(f"{name}: expected a rotation", path)
    return R


def imu_poses(rows: Array) -> Array:
    """Poses T_w_imu of GPS/IMU packets, by the Mercator projection. World: x east, y north, z up, metres.

    Parameters
    ----------
    rows : (N, 6 or more) latitude and longitude, degrees; altitude, metres; roll, pitch, yaw, radians.

    Returns
    -------
    (N, 4, 4) poses; the projection is true to scale at the first latitude (Geiger et al., IJRR 2013).
    """
    latitude, longitude = np.radians(rows[:, :2]).T
    scale = EARTH_RADIUS_M * np.cos(latitude[0])
    T = np.tile(np.eye(4), (len(rows), 1, 1))
    T[:, 0, 3] = scale * longitude
    T[:, 1, 3] = scale * np.log(np.tan(np.pi / 4 + latitude / 2))
    T[:, 2, 3] = rows[:, 2]
    roll, pitch, yaw = (rotation_from_vector(rows[:, 3 + k, None] * np.eye(3)[k]) for k in range(3))
    T[:, :3, :3] = yaw @ pitch @ roll
    return T
