"""A EuRoC folder: pairs by time, calibration from YAML, and the path of the rectified left camera."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import yaml
from conftest import write_euroc_truth
from test_stereo_calibration import rectified_pixels

from fetch.euroc import read_euroc_drive
from vo_lib.geometry.motion import inverse, rigid, rotation_from_vector, transform
from vo_lib.geometry.types import Array

START = 1403636579763555584  # ns
STEP = 50_000_000
# The body's axes are x up and z forward; both cameras look forward, at slightly different angles.
T_B_0 = rigid(
    rotation_from_vector(np.array([0.02, -0.01, 1.56])) @ rotation_from_vector(np.array([0.01, 0.02, 0.0])),
    np.array([-0.02, -0.06, 0.01]),
)
T_0_1 = rigid(rotation_from_vector(np.array([0.01, -0.015, 0.004])), np.array([0.11, 0.001, -0.002]))
T_B_C = T_B_0, T_B_0 @ T_0_1
INTRINSICS = ([458.0, 457.0, 367.0, 248.0], [457.5, 456.1, 379.0, 255.0])
DISTORTION = ([-0.28, 0.07, 2e-4, 1e-5], [-0.27, 0.06, -1e-4, -3e-5])
SIZE = (752, 480)


def bodies(frames: int) -> Array:
    """Poses T_w_b of a body that climbs and turns."""
    T = [rigid(rotation_from_vector(np.array([0.4, 1.2, -0.7])), np.array([4.0, -2.0, 1.0]))]
    for _ in range(frames - 1):
        turn = rotation_from_vector(np.array([0.01, -0.02, 0.015]))
        T.append(T[-1] @ rigid(turn, np.array([0.02, 0.03, 0.08])))
    return np.stack(T)


def write_mav0(base: Path, T_w_b: Array, frames: int) -> Path:
    """The folder mav0 with grey images and the true poses of the body, one per STEP."""
    mav0 = base / "MH_00" / "mav0"
    for camera in range(2):
        folder = mav0 / f"cam{camera}"
        (folder / "data").mkdir(parents=True)
        for frame in range(frames):
            path = folder / "data" / f"{START + STEP * frame}.png"
            cv2.imwrite(str(path), np.full(SIZE[::-1], 10 * frame + camera, np.uint8))
        sensor = {
            "T_BS": {"cols": 4, "rows": 4, "data": T_B_C[camera].ravel().tolist()},
            "resolution": list(SIZE),
            "camera_model": "pinhole",
            "intrinsics": INTRINSICS[camera],
            "distortion_model": "radial-tangential",
            "distortion_coefficients": DISTORTION[camera],
        }
        (folder / "sensor.yaml").write_text(yaml.safe_dump(sensor), encoding="utf-8")
    truth = mav0 / "state_groundtruth_estimate0"
    truth.mkdir()
    write_euroc_truth(truth / "data.csv", START + STEP * np.arange(len(T_w_b)), T_w_b)
    return mav0


def test_euroc_points_project_as_the_poses_predict(tmp_path: Path) -> None:
    T_w_b = bodies(6)
    drive = read_euroc_drive(write_mav0(tmp_path, T_w_b, 6).parent)
    assert drive.poses is not None
    assert drive.rig.maps is not None
    assert drive.note == ""
    np.testing.assert_allclose(drive.times, 1e-9 * START + 0.05 * np.arange(6), rtol=0, atol=1e-6)
    X = np.array([[-0.6, -0.5, 4.0], [0.9, 0.4, 5.0], [0.2, -0.3, 3.0], [-0.9, 0.6, 6.0], [0.4, 0.8, 4.5]])
    X_w = transform(T_w_b[0] @ T_B_0, X)

    def rectified(frame: int, camera: int) -> Array:
        """Rectified pixels of the points, computed from the pixels in the distorted image."""
        T_c_w = inverse(T_w_b[frame] @ T_B_C[camera])
        f_u, f_v, c_u, c_v = INTRINSICS[camera]
        K = np.array([[f_u, 0, c_u], [0, f_v, c_v], [0, 0, 1]])
        points = transform(T_c_w, X_w)
        uv = cv2.projectPoints(points, np.zeros(3), np.zeros(3), K, np.array(DISTORTION[camera]))[0]
        assert drive.rig.maps is not None
        return rectified_pixels(drive.rig.maps[camera], np.asarray(uv.reshape(-1, 2), np.float64))

    left, right = rectified(0, 0), rectified(0, 1)
    np.testing.assert_allclose(left[:, 1], right[:, 1], atol=0.1)
    rig = drive.rig
    z = rig.f * rig.baseline / (left[:, 0] - right[:, 0])
    first = np.stack([(left[:, 0] - rig.cx) * z / rig.f, (left[:, 1] - rig.cy) * z / rig.f, z], axis=1)
    for frame in (2, 5):
        now = transform(inverse(drive.poses[frame]), first)
        uv = rig.f * now[:, :2] / now[:, 2:] + [rig.cx, rig.cy]
        np.testing.assert_allclose(uv, rectified(frame, 0), atol=0.5)
        assert np.abs(uv - left).max() > 5  # the points move far enough for a test


def test_equidistant_cameras_have_equal_rows(tmp_path: Path) -> None:
    mav0 = write_mav0(tmp_path, bodies(2), 2)
    coefficients = ([0.02, -0.015, 0.006, -0.001], [-0.03, 0.01, -0.004, 0.002])
    for camera in range(2):
        path = mav0 / f"cam{camera}" / "sensor.yaml"
        sensor = yaml.safe_load(path.read_text(encoding="utf-8"))
        sensor |= {"distortion_model": "equidistant", "distortion_coefficients": coefficients[camera]}
        path.write_text(yaml.safe_dump(sensor), encoding="utf-8")
    rig = read_euroc_drive(mav0).rig
    assert rig.maps is not None
    X = np.array([[-0.6, -0.5, 4.0], [0.9, 0.4, 5.0], [0.2, -0.3, 3.0], [-0.9, 0.6, 6.0]])
    rectified = []
    for camera, points in enumerate((X, transform(inverse(T_0_1), X))):
        f_u, f_v, c_u, c_v = INTRINSICS[camera]
        K = np.array([[f_u, 0, c_u], [0, f_v, c_v], [0, 0, 1]])
        D = np.array(coefficients[camera])
        uv = cv2.fisheye.projectPoints(points[None], np.zeros(3), np.zeros(3), K, D)[0]
        rectified.append(rectified_pixels(rig.maps[camera], np.asarray(uv.reshape(-1, 2), np.float64)))
    left, right = rectified
    np.testing.assert_allclose(left[:, 1], right[:, 1], atol=0.1)
    z = (X @ rig.R1.T)[:, 2]
    np.testing.assert_allclose(left[:, 0] - right[:, 0], rig.f * rig.baseline / z, atol=0.1)


def test_euroc_pairs_without_truth_or_partner_are_omitted(tmp_path: Path) -> None:
    mav0 = write_mav0(tmp_path, bodies(4), 6)
    drive = read_euroc_drive(mav0)
    assert len(drive.paths) == 4
    assert drive.note == "2 pairs before or after the truth are skipped"
    right = mav0 / "cam1" / "data" / f"{START + STEP}.png"
    image = right.read_bytes()
    right.unlink()
    drive = read_euroc_drive(mav0)
    np.testing.assert_allclose(drive.times - 1e-9 * START, [0.0, 0.1, 0.15], atol=1e-6)
    assert "images without a partner, skipped: 1" in drive.note
    # The right camera may be late by `delay`.
    right.with_stem(f"{START + STEP + 4_000_000}").write_bytes(image)
    assert [len(read_euroc_drive(mav0, delay).paths) for delay in (0.001, 0.005)] == [3, 4]
