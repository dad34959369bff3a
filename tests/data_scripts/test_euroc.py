"""A EuRoC folder: pairs by time, calibration from YAML, and the path of the rectified left camera."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml
from data_command import load
from test_stereo_calibration import rectified_pixels

from fetch.euroc import read_euroc_drive
from vo_lib.commands.cli import main
from vo_lib.core.geometry import inverse, quaternion_from_rotation, rigid, rotation_from_vector, transform
from vo_lib.core.types import Array
from vo_lib.data.sequence import open_sequence

START = 1403636579763555584  # ns
STEP = 50_000_000
# The body's axes are x up and z ahead; the cameras look ahead and are turned a little against each other.
T_B_0 = rigid(
    rotation_from_vector(np.array([0.02, -0.01, 1.56])) @ rotation_from_vector(np.array([0.01, 0.02, 0.0])),
    np.array([-0.02, -0.06, 0.01]),
)
T_0_1 = rigid(rotation_from_vector(np.array([0.01, -0.015, 0.004])), np.array([0.11, 0.001, -0.002]))
INTRINSICS = ([458.0, 457.0, 367.0, 248.0], [457.5, 456.1, 379.0, 255.0])
DISTORTION = ([-0.28, 0.07, 2e-4, 1e-5], [-0.27, 0.06, -1e-4, -3e-5])
SIZE = (752, 480)


def bodies(frames: int) -> Array:
    """Poses T_w_b of a body that climbs and turns, in a world of its own."""
    T = [rigid(rotation_from_vector(np.array([0.4, 1.2, -0.7])), np.array([4.0, -2.0, 1.0]))]
    for _ in range(frames - 1):
        turn = rotation_from_vector(np.array([0.01, -0.02, 0.015]))
        T.append(T[-1] @ rigid(turn, np.array([0.02, 0.03, 0.08])))
    return np.stack(T)


def write_mav0(
    base: Path,
    T_w_b: Array,
    frames: int,
    extrinsics: tuple[Array, Array] = (T_B_0, T_B_0 @ T_0_1),
    intrinsics: tuple[list[float], list[float]] = INTRINSICS,
    distortion: tuple[list[float], list[float]] = DISTORTION,
    size: tuple[int, int] = SIZE,
) -> Path:
    """The folder mav0 with grey images and, ten times as often, the body's truth (four samples a frame)."""
    mav0 = base / "MH_00" / "mav0"
    for camera in range(2):
        folder = mav0 / f"cam{camera}"
        (folder / "data").mkdir(parents=True)
        rows = ["#timestamp [ns],filename"]
        for frame in range(frames):
            name = f"{START + STEP * frame}.png"
            cv2.imwrite(str(folder / "data" / name), np.full(size[::-1], 10 * frame + camera, np.uint8))
            rows.append(f"{START + STEP * frame},{name}")
        (folder / "data.csv").write_text("\r\n".join(rows) + "\r\n", encoding="utf-8")
        sensor = {
            "T_BS": {"cols": 4, "rows": 4, "data": extrinsics[camera].ravel().tolist()},
            "resolution": list(size),
            "camera_model": "pinhole",
            "intrinsics": intrinsics[camera],
            "distortion_model": "radial-tangential",
            "distortion_coefficients": distortion[camera],
        }
        (folder / "sensor.yaml").write_text(yaml.safe_dump(sensor), encoding="utf-8")
    truth = mav0 / "state_groundtruth_estimate0"
    truth.mkdir()
    rows = ["#timestamp, p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], …"]
    for sample, pose in enumerate(T_w_b):
        x, y, z, w = quaternion_from_rotation(pose[:3, :3])
        numbers = ", ".join(f"{number:.15g}" for number in [*pose[:3, 3], w, x, y, z, *np.zeros(9)])
        rows.append(f"{START + STEP * sample}, {numbers}")
    (truth / "data.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")
    return mav0


def test_points_seen_in_the_first_pair_land_where_the_poses_put_them_later(tmp_path: Path) -> None:
    T_w_b = bodies(6)
    drive = read_euroc_drive(write_mav0(tmp_path, T_w_b, 6).parent)
    assert drive.poses is not None
    assert drive.rig.maps is not None
    assert drive.note == ""
    np.testing.assert_allclose(drive.times, 1e-9 * START + 0.05 * np.arange(6), rtol=0, atol=1e-6)
    X = np.array([[-0.6, -0.5, 4.0], [0.9, 0.4, 5.0], [0.2, -0.3, 3.0], [-0.9, 0.6, 6.0], [0.4, 0.8, 4.5]])
    X_w = transform(T_w_b[0] @ T_B_0, X)

    def seen(frame: int, camera: int) -> Array:
        """Rectified pixels of the points, by the cameras as they are."""
        T_c_w = inverse(T_w_b[frame] @ (T_B_0 if camera == 0 else T_B_0 @ T_0_1))
        f_u, f_v, c_u, c_v = INTRINSICS[camera]
        K = np.array([[f_u, 0, c_u], [0, f_v, c_v], [0, 0, 1]])
        points = transform(T_c_w, X_w)
        uv = cv2.projectPoints(points, np.zeros(3), np.zeros(3), K, np.array(DISTORTION[camera]))[0]
        assert drive.rig.maps is not None
        return rectified_pixels(drive.rig.maps[camera], np.asarray(uv.reshape(-1, 2), np.float64))

    left, right = seen(0, 0), seen(0, 1)
    np.testing.assert_allclose(left[:, 1], right[:, 1], atol=0.1)
    rig = drive.rig
    z = rig.f * rig.baseline / (left[:, 0] - right[:, 0])
    first = np.stack([(left[:, 0] - rig.cx) * z / rig.f, (left[:, 1] - rig.cy) * z / rig.f, z], axis=1)
    for frame in (2, 5):
        now = transform(inverse(drive.poses[frame]), first)
        uv = rig.f * now[:, :2] / now[:, 2:] + [rig.cx, rig.cy]
        np.testing.assert_allclose(uv, seen(frame, 0), atol=0.5)
        assert np.abs(uv - left).max() > 5  # so that the test says something


def test_pairs_without_truth_or_partner_are_left_out(tmp_path: Path) -> None:
    mav0 = write_mav0(tmp_path, bodies(4), 6)
    drive = read_euroc_drive(mav0)
    assert len(drive.paths) == 4
    assert drive.note == "2 pairs before or after the truth are left out"
    rows = (mav0 / "cam1" / "data.csv").read_text(encoding="utf-8").splitlines()
    (mav0 / "cam1" / "data.csv").write_text("\n".join(rows[:2] + rows[3:]) + "\n", encoding="utf-8")
    drive = read_euroc_drive(mav0)
    np.testing.assert_allclose(drive.times - 1e-9 * START, [0.0, 0.1, 0.15], atol=1e-6)
    assert "1 images without a partner" in drive.note
    (mav0 / "state_groundtruth_estimate0" / "data.csv").unlink()
    drive = read_euroc_drive(mav0)
    assert drive.poses is None
    assert "is missing" in drive.note
    assert len(drive.paths) == 5
    # Somebody took the first images only: the list is read as far as they go.
    (mav0 / "cam0" / "data" / f"{START + 3 * STEP}.png").unlink()
    drive = read_euroc_drive(mav0)
    assert len(drive.paths) == 2
    assert "data.csv, line 5, names" in drive.note


def test_what_is_wrong_is_one_line_that_names_the_file_and_nothing_is_left(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = write_mav0(tmp_path, bodies(3), 3) / "state_groundtruth_estimate0" / "data.csv"
    path.write_text(path.read_text(encoding="utf-8").replace(f"{START}, ", f"{START}, 1e30"), "utf-8")
    words = ["--euroc", str(tmp_path / "MH_00"), "--out", str(tmp_path / "new" / "out")]
    assert load("from_folder")(words) == 2
    assert capsys.readouterr().err.startswith(f"vo data from_folder: error: {path}, line 2: a position")
    assert not (tmp_path / "new").exists()


def test_a_euroc_folder_becomes_a_sequence_with_truth(
    bands: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    # The bands' camera moves 0.5 m to its right a frame; body axes x ahead, y left, z up.
    T_b_c = rigid(np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]]), np.array([0.3, 0.1, 0.2]))
    T_w_b = np.stack([rigid(np.eye(3), np.array([1.0, -0.5 * i, 2.0])) for i in range(6)])
    right = T_b_c @ rigid(np.eye(3), np.array([0.5, 0.0, 0.0]))
    camera = [300.0, 300.0, 240.0, 120.0]
    no_distortion = ([0.0] * 4,) * 2
    mav0 = write_mav0(tmp_path, T_w_b, 6, (T_b_c, right), (camera, camera), no_distortion, (480, 240))
    for number in range(2):
        pictures = sorted((mav0 / f"cam{number}" / "data").iterdir())
        for path, drawn in zip(pictures, sorted((bands / f"image_{number}").iterdir()), strict=True):
            path.write_bytes(drawn.read_bytes())
    assert load("from_folder")(["--euroc", str(mav0.parent), "--out", str(tmp_path / "mine")]) == 0
    printed = capsys.readouterr().out
    assert "with true poses" in printed
    assert "--vehicle.check off" in printed
    sequence = open_sequence(tmp_path / "mine")
    assert sequence.camera.baseline == pytest.approx(0.5)
    assert sequence.truth is not None
    np.testing.assert_allclose(sequence.truth[:, :3, 3], [[0.5 * i, 0, 0] for i in range(6)], atol=1e-6)
    # Times are those of the images' names: the poses of a run meet EuRoC's own truth.
    out, truth = tmp_path / "out", mav0 / "state_groundtruth_estimate0" / "data.csv"
    assert main(["run", str(tmp_path / "mine"), "--out", str(out), "--features.cell", "10"]) == 0
    capsys.readouterr()
    pair = ["--truth", str(truth), "--estimate", str(out / "poses_tum.txt")]
    assert main(["evaluate", "--format", "euroc", *pair, "--json"]) == 0
    (judged,) = json.loads(capsys.readouterr().out)["sequences"]
    assert judged["frames"] == 6
    assert judged["ate"]["rmse_m"] < 0.1
