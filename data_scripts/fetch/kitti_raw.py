"""Drives of KITTI's raw data (synced and rectified): images, calibration, times, poses from the GPS/IMU."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from fetch.calibrations.kitti_calib import matrix, read_calibration_file
from fetch.stereo_calibration import rig_from_matrices
from fetch.stereo_sources import Drive, FolderSource, pair_images
from vo_lib.data.kitti import read_image
from vo_lib.data.poses import is_rotation, read_number_rows
from vo_lib.errors import DataError
from vo_lib.files import read_text
from vo_lib.geometry.motion import inverse, nearest_rotation, rigid, rotation_from_vector
from vo_lib.geometry.types import Array

EARTH_RADIUS_M = 6378137.0  # equatorial radius
# Limits of latitude and longitude, degrees (without the poles); altitude, metres; roll, pitch, yaw, radians.
OXTS_LIMITS = np.array([85.0, 180.0, 1e5, 7.0, 7.0, 7.0])
CAMERAS = (0, 1), (2, 3)  # grey and colour
CALIBRATION = "calib_cam_to_cam.txt"
MAX_SENSOR_DISTANCE_M = 100.0  # largest distance of two sensors on one vehicle
MOMENT = re.compile(r"\d{4}-\d\d-\d\d \d\d:\d\d:\d\d(\.\d{1,9})?", re.ASCII)


def read_raw_drive(drive: Path, skip_unpaired: bool = False) -> Drive:
    """The drive in a folder such as 2011_09_26_drive_0005_sync; the calibration may be in the parent folder.

    Without the grey images of cameras 0 and 1, the colour images of cameras 2 and 3 are read as grey. Raises
    `DataError` with the name of a missing or invalid file.
    """
    for cameras in CAMERAS:
        left = drive / f"image_0{cameras[0]}" / "data"
        right = drive / f"image_0{cameras[1]}" / "data"
        if left.is_dir() and right.is_dir():
            pairs = pair_images(left, right, skip_unpaired=skip_unpaired)
            return describe_drive(drive, pairs, cameras, whole=True)
    raise DataError("is not a raw drive: expected image_00/data and image_01/data", drive)


def describe_drive(
    drive: Path, pairs: FolderSource, cameras: tuple[int, int] = CAMERAS[0], whole: bool = False
) -> Drive:
    """Calibration, times and poses of a drive folder; the images may be in another folder.

    pairs : left and right image of each frame, named by the frame's number in the drive. cameras : numbers of
    the left and the right camera. whole : the images go to the end of the drive.

    Raises `DataError` with the name of a missing or invalid file.
    """
    paths = [pair for pair in pairs.paths if pair[0].stem.isdecimal()]
    stems = [left.stem.zfill(10) for left, _ in paths]
    if not stems:
        raise DataError("expected images whose names are numbers", pairs.paths[0][0])
    calibrations = drive if (drive / CALIBRATION).exists() else drive.resolve().parent
    path = calibrations / CALIBRATION
    lines = read_calibration_file(path)
    P1 = matrix(lines, f"P_rect_0{cameras[0]}", (3, 4), path)
    P2 = matrix(lines, f"P_rect_0{cameras[1]}", (3, 4), path)
    first = paths[0][0]
    size = matrix(lines, f"S_rect_0{cameras[0]}", (2,), path)
    height, width = read_image(first, pairs.bits).shape
    if (width, height) != tuple(size):
        raise DataError(
            f"the image is {width}×{height}, rectified images are {size[0]:.0f}×{size[1]:.0f}: "
            "use the drive's 'synced+rectified data' (_sync), not the unrectified _extract",
            first,
        )
    times = _times(drive / f"image_0{cameras[0]}" / "timestamps.txt", stems, whole)
    rig = rig_from_matrices({"P1": P1, "P2": P2}, (0, 0), path, rectified=True)
    shift = np.asarray(np.linalg.solve(P1[:, :3], P1[:, 3]), np.float64)
    poses, note = _poses(drive, calibrations, lines, stems, shift)
    notes = [pairs.note] if pairs.note else []
    if cameras != CAMERAS[0]:
        notes.append(f"there are only colour images: cameras {cameras[0]} and {cameras[1]} are read as grey")
    if note:
        notes.append(note)
    return Drive(paths, times, "; ".join(notes), rig=rig, poses=poses, bits=pairs.bits)


def _times(path: Path, stems: list[str], whole: bool) -> Array:
    """Times (N,) of the images with these numbers, seconds after the first image, from timestamps.txt.

    whole : the images go to the end of the drive, so the last image has the last row.
    """
    moments = _timestamps(path)
    count = int(stems[-1]) + 1
    if len(moments) < count or (whole and len(moments) > count):
        raise DataError(
            f"{len(moments)} rows, but the last image is {stems[-1]}: expected {count} rows, a row per frame",
            path,
        )
    times = moments[[int(stem) for stem in stems]]
    return np.asarray(times - times[0])


def _timestamps(path: Path) -> Array:
    """Times (N,) of lines such as `2011-09-26 13:02:25.964389445`, seconds after the first line.

    An empty line, which would move the times of all later frames, is refused; at the end it is ignored.
    """
    moments: list[np.datetime64] = []
    for number, line in enumerate(read_text(path).rstrip().splitlines(), start=1):
        try:
            if not MOMENT.fullmatch(line.strip()):
                raise ValueError
            moments.append(np.datetime64(line.strip(), "ns"))
        except ValueError:
            content = "" if line.strip() else "an empty line; "
            expected = "expected a time such as 2011-09-26 13:02:25.964389445"
            raise DataError(f"{content}{expected}, row k for frame k", path, number) from None
        if len(moments) > 1 and moments[-1] < moments[-2]:
            raise DataError("the time decreases", path, number)
    stamps = np.array(moments, "datetime64[ns]")
    return np.asarray((stamps - stamps[:1]) / np.timedelta64(1, "s"), np.float64)


def _poses(
    drive: Path, calibrations: Path, cameras: dict[str, Array], stems: list[str], shift: Array
) -> tuple[Array | None, str]:
    """True poses (N, 4, 4) of the left camera, or None and the reason.

    Parameters
    ----------
    calibrations : folder of the calibration files; cameras : the lines of `CALIBRATION`.
    stems : numbers of the images; shift : (3,) translation from camera 0 to the left camera, metres.
    """
    imu_file = calibrations / "calib_imu_to_velo.txt"
    velo_file = calibrations / "calib_velo_to_cam.txt"
    packets = [drive / "oxts" / "data" / f"{stem}.txt" for stem in stems]
    for path in (imu_file, velo_file, *packets):
        if not path.exists():
            return None, f"no true poses: {path} is missing"
    T_velo_imu = _rigid(imu_file)
    T_cam_velo = _rigid(velo_file)
    R_rect = _rotation(cameras, "R_rect_00", calibrations / CALIBRATION)
    T_cam_imu = rigid(np.eye(3), shift) @ rigid(R_rect, np.zeros(3)) @ T_cam_velo @ T_velo_imu
    expected = "30 numbers of a GPS/IMU packet"
    rows = np.concatenate([read_number_rows(path, expected, 30)[0] for path in packets])
    wrong = (np.abs(rows[:, :6]) > OXTS_LIMITS).any(axis=1)
    if wrong.any():
        path = packets[int(np.argmax(wrong))]
        raise DataError("invalid latitude, longitude, altitude, roll, pitch or yaw", path, 1)
    T_w_imu = imu_poses(rows)
    # From the first pose of the IMU to each pose, in the axes of the camera.
    poses = T_cam_imu @ inverse(T_w_imu[:1]) @ T_w_imu @ inverse(T_cam_imu)
    return poses, ""


def _rigid(path: Path) -> Array:
    """The transform (4, 4) in a file with the lines R and T, or `DataError`."""
    lines_by_name = read_calibration_file(path)
    T = matrix(lines_by_name, "T", (3,), path)
    if np.abs(T).max() > MAX_SENSOR_DISTANCE_M:
        raise DataError(f"T: expected a translation of at most {MAX_SENSOR_DISTANCE_M:g} m", path)
    return rigid(nearest_rotation(_rotation(lines_by_name, "R", path)), T)


def _rotation(matrices: dict[str, Array], name: str, path: Path) -> Array:
    """The rotation (3, 3) of a line, or `DataError`."""
    R = matrix(matrices, name, (3, 3), path)
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
    forward, left, up = np.eye(3)
    roll = rotation_from_vector(rows[:, 3:4] * forward)
    pitch = rotation_from_vector(rows[:, 4:5] * left)
    yaw = rotation_from_vector(rows[:, 5:6] * up)
    T[:, :3, :3] = yaw @ pitch @ roll
    return T
