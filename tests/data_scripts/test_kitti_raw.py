"""A drive of KITTI's raw data: names, times, calibration, and the path from the GPS/IMU."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from fetch.kitti_raw import EARTH_RADIUS_M, read_raw_drive
from vo_lib.errors import DataError
from vo_lib.geometry.motion import inverse, rigid, rotation_from_vector
from vo_lib.geometry.types import Array

P0 = np.array([[720.0, 0, 60, 0], [0, 720, 20, 0], [0, 0, 1, 0]])
P1 = P0 - np.array([[0, 0, 0, 387.0], [0, 0, 0, 0], [0, 0, 0, 0]])
VELO_IMU = rigid(rotation_from_vector(np.array([0.001, -0.002, 0.015])), np.array([-0.81, 0.32, -0.8]))
# From laser axes (x forward, y left, z up) to camera axes (x right, y down, z forward), slightly rotated.
CAM_VELO = rigid(
    np.array([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]]) @ rotation_from_vector(np.array([0.01, -0.005, 0.008])),
    np.array([-0.004, -0.076, -0.27]),
)
R_RECT = rotation_from_vector(np.array([0.004, 0.007, -0.01]))


def path_of_the_camera(frames: int = 8) -> Array:
    """Poses T_w_c of the left camera on a drive through a bend and uphill."""
    T = [np.eye(4)]
    for _ in range(frames - 1):
        T.append(
            T[-1] @ rigid(rotation_from_vector(np.array([0.002, 0.04, -0.001])), np.array([0.0, -0.02, 1.2]))
        )
    return np.stack(T)


def packets(T_w_c: Array) -> list[str]:
    """GPS/IMU rows of a vehicle with the given camera poses, by the inverse Mercator projection."""
    T_cam_imu = rigid(R_RECT, np.zeros(3)) @ CAM_VELO @ VELO_IMU
    start = rigid(rotation_from_vector(np.array([0.0, 0.0, 0.7])), np.array([0.0, 0.0, 116.0]))
    T = start @ inverse(T_cam_imu) @ T_w_c @ T_cam_imu
    lat0, lon0 = np.radians([49.0, 8.4])
    scale = EARTH_RADIUS_M * np.cos(lat0)
    mercator0 = np.array([scale * lon0, scale * np.log(np.tan(np.pi / 4 + lat0 / 2))])
    rows = []
    for pose in T:
        x, y = mercator0 + pose[:2, 3] - T[0, :2, 3]
        lat, lon = 2 * np.arctan(np.exp(y / scale)) - np.pi / 2, x / scale
        R = pose[:3, :3]
        roll, yaw = np.arctan2(R[2, 1], R[2, 2]), np.arctan2(R[1, 0], R[0, 0])
        pitch = np.arcsin(-R[2, 0])
        numbers = [np.degrees(lat), np.degrees(lon), pose[2, 3], roll, pitch, yaw, *([0.0] * 24)]
        rows.append(" ".join(f"{number:.15g}" for number in numbers) + "\n")
    return rows


def numbers(matrix: Array) -> str:
    return " ".join(f"{value:.12e}" for value in matrix.ravel())


@pytest.fixture
def drive(tmp_path: Path) -> Path:
    """A synced and rectified drive of eight pairs, with the calibration in the parent folder."""
    day = tmp_path / "2011_09_26"
    folder = day / "2011_09_26_drive_0005_sync"
    truth = path_of_the_camera()
    for camera in (0, 1):
        (folder / f"image_0{camera}" / "data").mkdir(parents=True)
        for frame in range(len(truth)):
            image = np.full((40, 120), 10 * frame + camera, np.uint8)
            cv2.imwrite(str(folder / f"image_0{camera}" / "data" / f"{frame:010d}.png"), image)
    stamps = [f"2011-09-26 23:59:59.{i}64389445\n" for i in range(6)]
    stamps += [f"2011-09-27 00:00:00.{i}64389445\n" for i in range(2)]
    (folder / "image_00" / "timestamps.txt").write_text("".join(stamps), encoding="utf-8")
    (folder / "oxts" / "data").mkdir(parents=True)
    for frame, row in enumerate(packets(truth)):
        (folder / "oxts" / "data" / f"{frame:010d}.txt").write_text(row, encoding="utf-8")
    lines = ["calib_time: 09-Jan-2012 13:57:47", "S_rect_00: 1.2e2 4.0e1", f"R_rect_00: {numbers(R_RECT)}"]
    lines += [f"P_rect_00: {numbers(P0)}", f"P_rect_01: {numbers(P1)}"]
    (day / "calib_cam_to_cam.txt").write_text("\n".join(lines) + "\n", encoding="utf-8")
    for name, T in (("calib_imu_to_velo", VELO_IMU), ("calib_velo_to_cam", CAM_VELO)):
        text = f"calib_time: 25-May-2012\nR: {numbers(T[:3, :3])}\nT: {numbers(T[:3, 3])}\n"
        (day / f"{name}.txt").write_text(text, encoding="utf-8")
    return folder


def test_path_images_times_and_calibration_are_read(drive: Path) -> None:
    result = read_raw_drive(drive)
    assert result.poses is not None
    assert result.note == ""
    # Over 10 m, the scale of the map changes by a few parts per million.
    np.testing.assert_allclose(result.poses, path_of_the_camera(), atol=1e-4)
    assert [left.stem for left, _ in result.paths] == [f"{i:010d}" for i in range(8)]
    assert result.paths[3][1].parent.parent.name == "image_01"
    rig = result.rig
    assert (rig.f, rig.cx, rig.cy, rig.baseline) == pytest.approx((720.0, 60.0, 20.0, 387.0 / 720.0))
    # Midnight is between the sixth and the seventh frame.
    np.testing.assert_allclose(result.times, [0, 0.1, 0.2, 0.3, 0.4, 0.5, 1.0, 1.1], atol=1e-6)


def test_missing_frames_have_no_times_and_poses(drive: Path) -> None:
    (drive / "image_00" / "data" / "0000000002.png").unlink()
    with pytest.raises(DataError, match="the image has no partner"):
        read_raw_drive(drive)
    (drive / "image_01" / "data" / "0000000002.png").unlink()
    result = read_raw_drive(drive)
    assert result.poses is not None
    np.testing.assert_allclose(result.poses, np.delete(path_of_the_camera(), 2, axis=0), atol=1e-4)
    assert result.times[2] == pytest.approx(0.3)


def test_a_row_of_the_times_belongs_to_each_frame(drive: Path) -> None:
    path = drive / "image_00" / "timestamps.txt"
    rows = path.read_text(encoding="utf-8").splitlines()
    for change, words in (
        ([*rows[:3], "", *rows[4:]], r"timestamps\.txt, line 4: an empty line; expected a time such as"),
        ([*rows[:3], "", *rows[3:]], r"timestamps\.txt, line 4: an empty line"),
        (
            rows[:-1],
            r"timestamps\.txt: 7 rows, but the last image is 0000000007: expected 8 rows, a row per frame",
        ),
        ([*rows, rows[-1]], r"timestamps\.txt: 9 rows, but the last image is 0000000007: expected 8 rows"),
    ):
        path.write_text("\n".join(change) + "\n", encoding="utf-8")
        with pytest.raises(DataError, match=words):
            read_raw_drive(drive)
    path.write_text("\n".join(rows) + "\n\n", encoding="utf-8")  # nothing is moved by an empty last line
    assert len(read_raw_drive(drive).times) == 8


def test_a_raw_drive_with_colour_images_alone_is_read(drive: Path) -> None:
    """The left colour camera is 0.06 m to the right of the grey one, with another baseline."""
    for grey, colour in (("image_00", "image_02"), ("image_01", "image_03")):
        (drive / grey).rename(drive / colour)
    path = drive.parent / "calib_cam_to_cam.txt"
    P2, P3 = P0.copy(), P0.copy()
    P2[0, 3] = -720.0 * 0.06
    P3[0, 3] = -720.0 * 0.59
    lines = [f"S_rect_02: 120 40\nP_rect_02: {numbers(P2)}\nP_rect_03: {numbers(P3)}\n"]
    path.write_text(path.read_text(encoding="utf-8") + "".join(lines), encoding="utf-8")
    result = read_raw_drive(drive)
    assert result.rig.baseline == pytest.approx(0.53)
    assert result.note == "there are only colour images: cameras 2 and 3 are read as grey"
    assert result.poses is not None
    beside = rigid(np.eye(3), np.array([0.06, 0.0, 0.0]))
    expected = inverse(beside) @ path_of_the_camera() @ beside
    np.testing.assert_allclose(result.poses, expected, atol=1e-4)
