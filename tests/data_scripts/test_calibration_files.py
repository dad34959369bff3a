"""Calibration files of other tools: points of a known rig land on the pixels of the imported, rectified rig.

The tests project points with the lens model of the tool, write its file, import it, and look up the rectified
position of each raw pixel in the rectification maps.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import yaml
from test_stereo_calibration import rectified_pixels

from fetch.calibrations.user_files import read_user_calibration
from fetch.stereo_calibration import FileCalibration
from vo_lib.errors import DataError
from vo_lib.geometry.motion import inverse, rigid, rotation_from_vector, transform
from vo_lib.geometry.types import Array

SIZE = (640, 400)
K_L = np.array([[400.0, 0.0, 318.0], [0.0, 402.0, 203.0], [0.0, 0.0, 1.0]])
K_R = np.array([[405.0, 0.0, 325.0], [0.0, 404.0, 196.0], [0.0, 0.0, 1.0]])
T_R_L = rigid(rotation_from_vector(np.array([0.012, -0.02, 0.015])), np.array([-0.25, 0.004, -0.003]))
POINTS = np.array([[0.3, -0.2, 4.0], [-0.8, 0.4, 5.0], [0.1, 0.3, 3.0], [1.0, -0.4, 8.0], [-1.5, -0.9, 6.0]])
RADTAN = ([-0.28, 0.07, 2e-4, 1e-5], [-0.27, 0.06, -1e-4, -3e-4])
PLUMB_BOB = ([-0.28, 0.07, 2e-3, 1e-3, 0.01], [-0.27, 0.06, -1e-3, -3e-3, 0.02])
RATIONAL = ([0.5, 0.1, 1e-3, -5e-4, 0.02, 0.8, 0.15, 0.03], [0.4, 0.12, 5e-4, 1e-3, 0.03, 0.7, 0.2, 0.02])
FISHEYE = ([0.02, -0.015, 0.006, -0.001], [-0.03, 0.01, -0.004, 0.002])


@dataclass(frozen=True)
class TrueRig:
    """A stereo rig, and the pixels (N, 2) of points (N, 3) in the axes of a camera."""

    lens: str
    D: tuple[list[float], list[float]]
    T: Array
    xi: float = 0.0

    def pixels(self, X: Array, side: int) -> Array:
        K, D = (K_L, K_R)[side], np.array(self.D[side])
        if self.lens == "fisheye":
            uv = cv2.fisheye.projectPoints(X[None], np.zeros(3), np.zeros(3), K, D)[0]
        elif self.lens == "omni":
            x, y, z = X.T / np.linalg.norm(X, axis=1)
            flat = np.stack([x / (z + self.xi), y / (z + self.xi), np.ones_like(x)], axis=1)
            uv = cv2.projectPoints(flat, np.zeros(3), np.zeros(3), K, D)[0]
        else:
            uv = cv2.projectPoints(X, np.zeros(3), np.zeros(3), K, D)[0]
        return np.asarray(uv, np.float64).reshape(-1, 2)


def require_true(calibration: FileCalibration, truth: TrueRig, scale: float = 1.0) -> None:
    """The rectified rows and disparities are right to 0.1 px, and the baseline is in metres."""
    rig = calibration.rig(SIZE)
    assert rig.baseline == pytest.approx(np.linalg.norm(truth.T[:3, 3]), rel=1e-4)
    assert rig.maps is not None
    X = POINTS * scale
    left = rectified_pixels(rig.maps[0], truth.pixels(X, 0))
    right = rectified_pixels(rig.maps[1], truth.pixels(transform(truth.T, X), 1))
    in_rig = X @ rig.R1.T
    expected = rig.f * in_rig[:, :2] / in_rig[:, 2:] + [rig.cx, rig.cy]
    np.testing.assert_allclose(left, expected, atol=0.1)
    np.testing.assert_allclose(right[:, 1], left[:, 1], atol=0.1)
    np.testing.assert_allclose(left[:, 0] - right[:, 0], rig.f * rig.baseline / in_rig[:, 2], atol=0.1)


def intrinsics(K: Array) -> list[float]:
    return [float(K[0, 0]), float(K[1, 1]), float(K[0, 2]), float(K[1, 2])]


def write(path: Path, content: Any) -> Path:
    """Write text, or YAML or JSON by the ending of the name."""
    if not isinstance(content, str):
        content = json.dumps(content) if path.suffix == ".json" else yaml.safe_dump(content)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(content, encoding="utf-8")
    return path


def save(path: Path, *parts: dict[str, Any], **arrays: Any) -> None:
    """Write a NumPy archive."""
    everything: Any = {name: value for part in (*parts, arrays) for name, value in part.items()}
    np.savez(path, **everything)


def read(*paths: Path, size: tuple[int, int] = SIZE, folders: tuple[str, ...] = ()) -> FileCalibration:
    return read_user_calibration([*paths], size, folders)


# Kalibr


def chain(truth: TrueRig, model: str, distortion: str) -> dict[str, Any]:
    cameras = {}
    for side, K in enumerate((K_L, K_R)):
        cameras[f"cam{side}"] = {
            "cam_overlaps": [1 - side],
            "camera_model": model,
            "intrinsics": [truth.xi, *intrinsics(K)] if model == "omni" else intrinsics(K),
            "distortion_model": distortion,
            "distortion_coeffs": truth.D[side],
            "resolution": list(SIZE),
            "rostopic": f"/cam{side}/image_raw",
        }
    cameras["cam1"]["T_cn_cnm1"] = truth.T.tolist()
    return cameras


KALIBR = {
    "pinhole radtan": (TrueRig("radtan", RADTAN, T_R_L), "pinhole", "radtan", 1.0),
    "pinhole equidistant": (TrueRig("fisheye", FISHEYE, T_R_L), "pinhole", "equidistant", 1.0),
    "omni radtan": (TrueRig("omni", RADTAN, T_R_L, 0.9), "omni", "radtan", 1.0),
}


@pytest.mark.parametrize("name", KALIBR)
def test_a_kalibr_chain_is_read(tmp_path: Path, name: str) -> None:
    truth, model, distortion, scale = KALIBR[name]
    path = write(tmp_path / "camchain.yaml", chain(truth, model, distortion))
    calibration = read(path)
    require_true(calibration, truth, scale)
    assert (calibration.size, calibration.notes) == (SIZE, ())
    # A wide lens keeps the resolution on the optical axis.
    if model == "pinhole":
        assert calibration.rig(SIZE).f == pytest.approx(400, rel=0.25)


def test_kalibr_chain_without_a_size_is_read(tmp_path: Path) -> None:
    truth = TrueRig("radtan", RADTAN, T_R_L)
    cameras = chain(truth, "pinhole", "radtan")
    for camera in cameras.values():
        del camera["resolution"]
    calibration = read(write(tmp_path / "camchain.yaml", cameras))
    require_true(calibration, truth)
    assert calibration.size is None


def test_a_kalibr_chain_whose_first_camera_is_the_right_one_is_read(tmp_path: Path) -> None:
    truth = TrueRig("radtan", RADTAN, T_R_L)
    cameras = chain(truth, "pinhole", "radtan")
    reverse = {
        "cam0": {**cameras["cam1"], "cam_overlaps": [1]},
        "cam1": {**cameras["cam0"], "cam_overlaps": [0], "T_cn_cnm1": inverse(truth.T).tolist()},
    }
    del reverse["cam0"]["T_cn_cnm1"]
    calibration = read(write(tmp_path / "camchain.yaml", reverse))
    require_true(calibration, truth)
    assert "cam1 is the left camera and cam0 the right one" in calibration.notes[0]


def test_a_kalibr_chain_of_more_cameras_and_with_an_imu_is_read(tmp_path: Path) -> None:
    truth = TrueRig("radtan", RADTAN, T_R_L)
    cameras = chain(truth, "pinhole", "radtan")
    behind = {**cameras["cam0"], "cam_overlaps": []}
    far = rigid(rotation_from_vector(np.array([0.0, 3.0, 0.0])), np.array([0.1, 0.0, -0.4]))
    # Four cameras: 1 and 2 are the pair of the test, 0 and 3 look to the back.
    four = {
        "cam0": behind,
        "cam1": {**cameras["cam0"], "cam_overlaps": [2], "T_cn_cnm1": far.tolist()},
        "cam2": {**cameras["cam1"], "cam_overlaps": [1]},
        "cam3": {**behind, "T_cn_cnm1": far.tolist()},
    }
    calibration = read(write(tmp_path / "four.yaml", four))
    require_true(calibration, truth)
    assert "cam1 is the left camera and cam2 the right one, of cam0, cam1, cam2, cam3" in calibration.notes[0]
    # The folders of the images choose the cameras, also with another camera between them.
    between = {**four["cam1"], "T_cn_cnm1": far.tolist()}
    three = {
        "cam0": {**cameras["cam0"], "cam_overlaps": [1, 2]},
        "cam1": between,
        "cam2": {**cameras["cam1"], "T_cn_cnm1": (truth.T @ inverse(far)).tolist()},
    }
    path = write(tmp_path / "three.yaml", three)
    require_true(read(path, folders=("bag/cam0/data", "bag/cam2/data")), truth)
    # An imucamchain in OpenVINS's form.
    imu = rigid(rotation_from_vector(np.array([1.2, -1.1, 1.3])), np.array([0.07, -0.02, 0.004]))
    del cameras["cam1"]["T_cn_cnm1"]
    cameras["cam0"]["T_cam_imu"] = imu.tolist()
    cameras["cam1"]["T_imu_cam"] = inverse(truth.T @ imu).tolist()
    require_true(read(write(tmp_path / "imu.yaml", "%YAML:1.0\n\n" + yaml.safe_dump(cameras))), truth)


# ROS


def camera_infos(truth: TrueRig, model: str) -> list[dict[str, Any]]:
    """Both cameras as ROS's camera_calibration writes them, after a rectification by OpenCV."""
    none = np.zeros(5)
    R1, R2, P1, P2 = cv2.stereoRectify(
        K_L, none, K_R, none, SIZE, truth.T[:3, :3], truth.T[:3, 3:], flags=cv2.CALIB_ZERO_DISPARITY, alpha=0
    )[:4]
    cameras = []
    for side, (K, R, P) in enumerate(((K_L, R1, P1), (K_R, R2, P2))):
        values = {"camera_matrix": K, "rectification_matrix": R, "projection_matrix": P}
        values["distortion_coefficients"] = np.array([truth.D[side]])
        camera: dict[str, Any] = {
            name: {"rows": matrix.shape[0], "cols": matrix.shape[1], "data": matrix.ravel().tolist()}
            for name, matrix in values.items()
        }
        camera |= {"image_width": SIZE[0], "image_height": SIZE[1], "distortion_model": model}
        cameras.append({**camera, "camera_name": ("narrow_stereo/left", "narrow_stereo/right")[side]})
    return cameras


ROS = {
    "plumb_bob": TrueRig("radtan", PLUMB_BOB, T_R_L),
    "rational_polynomial": TrueRig("radtan", RATIONAL, T_R_L),
    "equidistant": TrueRig("fisheye", FISHEYE, T_R_L),
}


@pytest.mark.parametrize("model", ROS)
def test_ros_camera_info_is_read(tmp_path: Path, model: str) -> None:
    left, right = camera_infos(ROS[model], model)
    paths = [write(tmp_path / "left.yaml", left), write(tmp_path / "right.yaml", right)]
    write(tmp_path / "ost.txt", "not read")
    require_true(read(*paths), ROS[model])
    require_true(read(*reversed(paths)), ROS[model])
    require_true(read(tmp_path), ROS[model])
    assert read(*paths).notes == ()
    # Files with exchanged names: P decides.
    paths[0].rename(tmp_path / "x")
    paths[1].rename(paths[0])
    (tmp_path / "x").rename(paths[1])
    exchanged = read(*paths)
    require_true(exchanged, ROS[model])
    assert exchanged.notes[0] == f"by its P, {paths[1]} belongs to the left camera"


@pytest.mark.parametrize("lower", [False, True])
def test_ros_messages_are_read(tmp_path: Path, lower: bool) -> None:
    """`rostopic echo` of ROS 1 and, with small letters, `ros2 topic echo`."""
    truth, paths = ROS["plumb_bob"], []
    names = {"camera_matrix": "K", "distortion_coefficients": "D"}
    names |= {"rectification_matrix": "R", "projection_matrix": "P"}
    for name, camera in zip(("a", "b"), camera_infos(truth, "plumb_bob"), strict=True):
        message = {
            "header": {"seq": 1, "frame_id": "optical"},
            "height": SIZE[1],
            "width": SIZE[0],
            "distortion_model": "plumb_bob",
            **{(new.lower() if lower else new): camera[old]["data"] for old, new in names.items()},
            "binning_x": 0,
            "binning_y": 0,
            "roi": {"x_offset": 0, "y_offset": 0, "height": 0, "width": 0, "do_rectify": False},
        }
        paths.append(write(tmp_path / f"{name}.yaml", yaml.safe_dump(message) + "---\n"))
    require_true(read(*paths), truth)


def test_ros_ost_files_are_read(tmp_path: Path) -> None:
    truth = ROS["plumb_bob"]
    lines = ["# oST version 5.0 parameters", "", "", "[image]", "", "width", "640", "", "height", "400", ""]
    for camera in camera_infos(truth, "plumb_bob"):
        lines += [f"[{camera['camera_name']}]", ""]
        for title, name in (
            ("camera matrix", "camera_matrix"),
            ("distortion", "distortion_coefficients"),
            ("rectification", "rectification_matrix"),
            ("projection", "projection_matrix"),
        ):
            rows = np.array(camera[name]["data"]).reshape(camera[name]["rows"], -1)
            lines += [title, *(" ".join(f"{x:.8f}" for x in row) for row in rows), ""]
    require_true(read(write(tmp_path / "ost.txt", "\n".join(lines))), truth)


ROS_FAULTS: dict[str, tuple[Callable[[dict[str, Any]], Any], str]] = {
    "mono": (lambda c: c["projection_matrix"]["data"].__setitem__(3, 0.0), "two single calibrations, not a"),
    "model": (lambda c: c.update(distortion_model="ftheta"), "distortion_model ftheta: expected plumb_bob"),
    "count": (
        lambda c: c["distortion_coefficients"].update(data=[0.0] * 6),
        "of plumb_bob: expected 0 or 4 or",
    ),
    "zero": (lambda c: c["camera_matrix"].update(data=[0.0] * 9), "the camera was not calibrated"),
    "size": (lambda c: c.update(image_width=641), "images of 640×400 and 641×400: expected one size"),
    "binning": (lambda c: c.update(binning_x=2), "binning or roi: expected a calibration of the whole image"),
    "roi": (lambda c: c.update(roi={"width": 320, "height": 200}), "binning or roi"),
}


@pytest.mark.parametrize("fault", ROS_FAULTS)
def test_impossible_camera_infos_are_refused(tmp_path: Path, fault: str) -> None:
    left, right = camera_infos(ROS["plumb_bob"], "plumb_bob")
    spoil, words = ROS_FAULTS[fault]
    spoil(right)
    paths = [write(tmp_path / "left.yaml", left), write(tmp_path / "right.yaml", right)]
    with pytest.raises(DataError, match=words):
        read(*paths)
    with pytest.raises(DataError, match="give the files of both, left and right"):
        read(paths[0])


# RealSense


def intrinsics_dump(K: Array, D: list[float], model: str) -> dict[str, Any]:
    fx, fy, ppx, ppy = intrinsics(K)
    sizes = {"width": SIZE[0], "height": SIZE[1]}
    return {**sizes, "fx": fx, "fy": fy, "ppx": ppx, "ppy": ppy, "model": model, "coeffs": D}


RECTIFIED = TrueRig("radtan", ([0.0] * 5, [0.0] * 5), rigid(np.eye(3), np.array([-0.05, 0.0, 0.0])))


@pytest.mark.parametrize("form", ["left right", "infrared", "nested", "baseline", "position"])
def test_rectified_infrared_cameras_of_realsense_are_read(tmp_path: Path, form: str) -> None:
    """The infrared images of a D435 are rectified: both cameras have the same K, and no distortion."""
    model = "distortion.brown_conrady" if form == "nested" else "Inverse Brown Conrady"
    camera = intrinsics_dump(K_L, [0.0] * 5, model)
    camera["fy"] = camera["fx"]
    eye = np.eye(3).ravel().tolist()
    extrinsics = {"rotation": eye, "translation": [-0.05, 0.0, 0.0]}
    colour = {**camera, "fx": 600.0, "fy": 601.0}
    forms: dict[str, Any] = {
        "left right": {"left": camera, "right": camera, "extrinsics": extrinsics},
        "infrared": {
            "depth": camera,
            "color": colour,
            "infrared1": camera,
            "infrared2": camera,
            "extrinsics": {
                "depth_to_color": {"rotation": eye, "translation": [0.015, 0.0, 0.0]},
                "infrared1_to_infrared2": extrinsics,
                "infrared2_to_infrared1": {"rotation": eye, "translation": [0.05, 0.0, 0.0]},
            },
        },
        "nested": {"intrinsics": {"ir_1": camera, "ir_2": camera, "rgb": colour}, "extrinsics": extrinsics},
        "baseline": {"left": camera, "right": camera, "baseline_mm": 50.0},
        "position": {
            "left": camera,
            "right": camera,
            "extrinsics": {"rotation": np.eye(3).tolist(), "translation": [0.05, 0.0, 0.0]},
        },
    }
    calibration = read(write(tmp_path / "d435.json", forms[form]))
    rig = calibration.rig(SIZE)
    assert (rig.f, rig.cx, rig.cy) == pytest.approx((400.0, 318.0, 203.0))
    assert rig.baseline == pytest.approx(0.05)
    assert rig.maps is None  # rectified images are not changed
    assert calibration.size == SIZE


def test_realsense_fisheye_rotation_is_column_by_column(tmp_path: Path) -> None:
    truth = TrueRig("fisheye", FISHEYE, T_R_L)
    R, t = truth.T[:3, :3], truth.T[:3, 3]
    cameras = {
        name: intrinsics_dump(K, [*D, 0.0], "kannala_brandt4")
        for name, K, D in (("fisheye_left", K_L, FISHEYE[0]), ("fisheye_right", K_R, FISHEYE[1]))
    }
    path = tmp_path / "t265.json"
    to_right = {"rotation": R.ravel(order="F").tolist(), "translation": t.tolist()}
    require_true(read(write(path, {**cameras, "left_to_right": to_right})), truth)
    back = inverse(truth.T)
    to_left = {"rotation": back[:3, :3].ravel(order="F").tolist(), "translation": back[:3, 3].tolist()}
    require_true(read(write(path, {**cameras, "extrinsics": to_left})), truth)
    with pytest.raises(DataError, match=r"three lists may be its rows or its columns"):
        read(write(path, {**cameras, "extrinsics": {**to_right, "rotation": R.tolist()}}))
    for side in ("fisheye_left", "fisheye_right"):
        cameras[side]["model"] = "inverse_brown_conrady"
    with pytest.raises(DataError, match="model inverse_brown_conrady with coeffs other than 0"):
        read(write(path, {**cameras, "extrinsics": to_right}))


# ZED


def conf(truth: TrueRig, other: str = "FHD", newer: bool = False) -> str:
    """A factory calibration with the sections of two resolutions; the other one has wrong numbers."""
    lines = []
    for name, factor in (("SVGA", 1.0), (other, 1.7)):
        for side, K, D in (("LEFT", K_L, truth.D[0]), ("RIGHT", K_R, truth.D[1])):
            values = dict(zip(("fx", "fy", "cx", "cy"), (factor * x for x in intrinsics(K)), strict=True))
            coefficients = dict(zip(("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"), D, strict=False))
            lines.append(f"[{side}_CAM_{name}]")
            lines += [f"{key}={value}" for key, value in (values | ({} if newer else coefficients)).items()]
            if newer and name == "SVGA":
                lines += ["", f"[{side}_DISTO]", *(f"{key}={value}" for key, value in coefficients.items())]
            lines.append("")
    angles = cv2.Rodrigues(truth.T[:3, :3])[0].ravel()
    t = 1000 * truth.T[:3, 3]
    lines += ["[STEREO]", f"Baseline={-t[0]}"]
    suffix = "" if newer else "_SVGA"
    lines += [f"TY{suffix}={t[1]}", f"TZ{suffix}={t[2]}"]
    for key, value in zip(("RX", "CV", "RZ"), angles, strict=True):
        lines += [f"{key}_SVGA={value}", f"{key}_{other}={3 * value}"]
    return "\n".join([*lines, "", "[MISC]", "Sensor_ID=1", ""])


@pytest.mark.parametrize(
    ("truth", "newer"),
    [
        (TrueRig("radtan", RADTAN, T_R_L), False),
        (TrueRig("radtan", RATIONAL, T_R_L), True),
        (
            TrueRig(
                "fisheye",
                ([0.02, -0.015, 0.0, 0.0, 0.006, -0.001], [-0.03, 0.01, 0.0, 0.0, -0.004, 0.002]),
                T_R_L,
            ),
            True,
        ),
    ],
)
def test_a_zed_conf_is_read(
    tmp_path: Path, truth: TrueRig, newer: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    # The size of the test's rig is not one of a ZED camera.
    monkeypatch.setattr("fetch.calibrations.zed.SIZES", {SIZE: "SVGA", (1920, 1080): "FHD"})
    path = write(tmp_path / "SN12345.conf", conf(truth, newer=newer))
    if truth.lens == "fisheye":
        D_L, D_R = (np.array(D)[[0, 1, 4, 5]].tolist() for D in truth.D)
        truth = TrueRig("fisheye", (D_L, D_R), T_R_L)
    require_true(read(path), truth)


def test_zed_conf_needs_images_of_one_of_its_sizes(tmp_path: Path) -> None:
    path = write(tmp_path / "SN12345.conf", conf(TrueRig("radtan", RADTAN, T_R_L)))
    assert read(path, size=(1920, 1080)).matrices["K1"][0, 0] == pytest.approx(1.7 * 400)
    with pytest.raises(DataError, match="images of 1280×720, expected 1920×1080 or 960×600"):
        read(path, size=(1280, 720))
    with pytest.raises(DataError, match="the calibration is for images of 960×600, but these are 640×400"):
        read(path, size=(960, 600)).rig(SIZE)


# OpenCV and NumPy


SPELLINGS = [
    "mtxL distL mtxR distR R T",
    "cameraMatrix1 distCoeffs1 cameraMatrix2 distCoeffs2 R T",
    "K1 D1 K2 D2 R T",
    "K0 D0 K1 D1 R T",
    "camera_matrix_left dist_coeffs_left camera_matrix_right dist_coeffs_right R T",
    "left_camera_matrix left_dist right_camera_matrix right_dist rotation_matrix translation_vector",
    "leftCameraMatrix leftDistortion rightCameraMatrix rightDistortion rotationMatrix translationVector",
    "CamML DistCoefL CamMR DistCoefR Rot Trns",
    "mtx_l dist_l mtx_r dist_r R t",
    "M1 dist1 M2 dist2 R T",
    "intrinsicL distortionL intrinsicR distortionR Rot Trans",
    "Kl Dl Kr Dr R T",
    "LEFT.K LEFT.D RIGHT.K RIGHT.D R T",
]
OPENCV = TrueRig("radtan", PLUMB_BOB, T_R_L)


@pytest.mark.parametrize("spelling", SPELLINGS)
def test_a_numpy_archive_is_read(tmp_path: Path, spelling: str) -> None:
    values = [K_L, np.array([PLUMB_BOB[0]]), K_R, np.array(PLUMB_BOB[1]), T_R_L[:3, :3], T_R_L[:3, 3:]]
    matrices: dict[str, Any] = dict(zip(spelling.split(), values, strict=True))
    # What tutorials store beside: corners as objects, errors, E, F and Q.
    more = {"E": np.eye(3), "F": np.eye(3), "Q": np.eye(4), "ret": 0.4, "newcameramtxL": np.eye(3)}
    more["corners"] = np.array([None, 1], dtype=object)
    save(tmp_path / "stereo.npz", matrices, more)
    calibration = read(tmp_path / "stereo.npz")
    require_true(calibration, OPENCV)
    assert (calibration.size, calibration.unit) == (None, None)


@pytest.mark.parametrize("name", ["stereo.json", "stereo.yaml"])
def test_matrices_dumped_as_lists_are_read(tmp_path: Path, name: str) -> None:
    left = {"camera_matrix": K_L.tolist(), "dist_coeffs": [PLUMB_BOB[0]]}
    right = {"camera_matrix": K_R.tolist(), "dist_coeffs": [PLUMB_BOB[1]]}
    pair = {"R": T_R_L[:3, :3].tolist(), "T": T_R_L[:3, 3:].tolist(), "image_size": list(SIZE)}
    calibration = read(write(tmp_path / name, {"left": left, "right": right, **pair}))
    require_true(calibration, OPENCV)
    assert calibration.size == SIZE
    flat = {"K1": K_L.tolist(), "D1": PLUMB_BOB[0], "K2": K_R.tolist(), "D2": PLUMB_BOB[1]}
    require_true(read(write(tmp_path / name, {**flat, **pair})), OPENCV)


def test_a_numpy_archive_in_millimetres_with_its_size_is_read(tmp_path: Path) -> None:
    values = {"mtxL": K_L, "distL": PLUMB_BOB[0], "mtxR": K_R, "distR": PLUMB_BOB[1]}
    path = tmp_path / "stereo.npz"
    extrinsics = {"R": cv2.Rodrigues(T_R_L[:3, :3])[0], "T": 1000 * T_R_L[:3, 3]}
    save(path, values, extrinsics, img_shape=np.array(SIZE[::-1]))
    calibration = read(path)
    assert calibration.size == SIZE
    with pytest.raises(
        DataError, match=r"the baseline is 250\.\d+ m: if the unit is millimetres, add --unit mm"
    ):
        calibration.rig(SIZE)
    assert calibration.rig(SIZE, unit=0.001).baseline == pytest.approx(0.25, rel=1e-3)
    with pytest.raises(
        DataError, match=r"is for images of 640×400, but these are 320×200: .*by 0\.5 and give"
    ):
        calibration.rig((320, 200))


def test_one_archive_for_each_camera_is_read(tmp_path: Path) -> None:
    for name, K, D in (("left", K_L, PLUMB_BOB[0]), ("right", K_R, PLUMB_BOB[1])):
        save(tmp_path / f"{name}_calib.npz", mtx=K, dist=D)
    save(tmp_path / "stereo.npz", R=T_R_L[:3, :3], T=T_R_L[:3, 3])
    require_true(read(*sorted(tmp_path.iterdir())), OPENCV)
    with pytest.raises(DataError, match="the calibration lacks R, T"):
        read(tmp_path / "left_calib.npz", tmp_path / "right_calib.npz").rig(SIZE)


def test_two_different_matrices_are_refused(tmp_path: Path) -> None:
    save(tmp_path / "a.npz", K1=K_L, cameraMatrix1=K_R, T=T_R_L[:3, 3])
    with pytest.raises(DataError, match="K1 and cameraMatrix1 are both K1 but differ: keep one of them"):
        read(tmp_path / "a.npz")
    save(tmp_path / "b.npz", images=np.zeros((2, 2)), lensA=K_L)
    with pytest.raises(
        DataError, match=r"expected OpenCV matrices K1 .*; found images, lensA; files that are read"
    ):
        read(tmp_path / "b.npz")
    (tmp_path / "c.pkl").write_bytes(b"\x80\x04")
    with pytest.raises(DataError, match=r"is not read: save the matrices by numpy\.savez"):
        read(tmp_path / "c.pkl")


def test_four_distortion_numbers_are_radtan_unless_fisheye_is_given(tmp_path: Path) -> None:
    """OpenCV's names do not tell whether four numbers are of a pinhole or of a fisheye lens."""
    for truth, fisheye in (
        (TrueRig("radtan", RADTAN, T_R_L), False),
        (TrueRig("fisheye", FISHEYE, T_R_L), True),
    ):
        path = tmp_path / f"{fisheye}.npz"
        values = {"K1": K_L, "D1": truth.D[0], "K2": K_R, "D2": truth.D[1]}
        save(path, values, R=T_R_L[:3, :3], T=T_R_L[:3, 3])
        calibration = read_user_calibration([path], SIZE, fisheye=fisheye)
        require_true(calibration, truth)
        note = "" if fisheye else "the four distortion numbers are read as k1 k2 p1 p2 (radial-tangential)"
        assert "".join(calibration.notes).startswith(note)
    save(path, values, {"D1": PLUMB_BOB[0]}, R=T_R_L[:3, :3], T=T_R_L[:3, 3])
    with pytest.raises(DataError, match="a fisheye lens has four distortion numbers"):
        read_user_calibration([path], SIZE, fisheye=True)


def test_opencv_storage_names_its_size(tmp_path: Path) -> None:
    """The calibration that `zed_calibration` writes: a fisheye lens, a rotation vector, and the size."""
    path = tmp_path / "zed_calibration_1.yml"
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    truth = TrueRig("fisheye", FISHEYE, T_R_L)
    for name, K, D in (("LEFT", K_L, FISHEYE[0]), ("RIGHT", K_R, FISHEYE[1])):
        storage.write(f"K_{name}", K)
        storage.write(f"D_{name}_FE", np.array([D]))
    storage.write("R", cv2.Rodrigues(T_R_L[:3, :3])[0])
    storage.write("T", T_R_L[:3, 3:])
    storage.release()
    text = path.read_text(encoding="utf-8").replace("---\n", f"---\nSize: [ {SIZE[0]}, {SIZE[1]} ]\n", 1)
    calibration = read(write(path, text))
    require_true(calibration, truth)
    assert calibration.size == SIZE


# KITTI

GREY_AND_COLOUR = """P0: 718.856 0 607.1928 0 0 718.856 185.2157 0 0 0 1 0
P1: 718.856 0 607.1928 -386.1448 0 718.856 185.2157 0 0 0 1 0
P2: 718.856 0 607.1928 45.38225 0 718.856 185.2157 -0.1130887 0 0 1 0.003779761
P3: 718.856 0 607.1928 -337.2877 0 718.856 185.2157 2.369057 0 0 1 0.004915215
Tr: 1 0 0 0 0 1 0 0 0 0 1 0
"""
KITTI_SIZE = (1241, 376)


def test_kitti_calib_chooses_the_cameras_of_the_images(tmp_path: Path) -> None:
    path = write(tmp_path / "calib.txt", GREY_AND_COLOUR)
    for folders, baseline in (
        (("00/image_0", "00/image_1"), 386.1448 / 718.856),
        (("00/image_2", "00/image_3"), (45.38225 + 337.2877) / 718.856),
    ):
        rig = read(path, size=KITTI_SIZE, folders=folders).rig(KITTI_SIZE)
        assert (rig.f, rig.cx, rig.cy) == (718.856, 607.1928, 185.2157)
        assert rig.baseline == pytest.approx(baseline, rel=1e-12)
        assert rig.maps is None
    with pytest.raises(DataError, match=r"image_0 and .*image_3 are not a pair"):
        read(path, size=KITTI_SIZE, folders=("00/image_0", "00/image_3"))
    line = "--focal 718.856 --centre 607.1928,185.2157 --baseline"
    words = rf"use {line} 0\.537166 for the grey images, {line} 0\.532332 for colour"
    with pytest.raises(DataError, match=words):
        read(path, size=KITTI_SIZE, folders=("L", "R"))
    grey = write(path, "".join(GREY_AND_COLOUR.splitlines(keepends=True)[:2]))
    assert read(grey, size=KITTI_SIZE, folders=("L", "R")).rig(KITTI_SIZE).baseline == pytest.approx(0.537166)
    with pytest.raises(DataError, match="expected lines for the cameras 2 and 3"):
        read(grey, size=KITTI_SIZE, folders=("image_2", "image_3"))


def test_kitti_raw_calibrations_of_rectified_and_raw_images_are_read(tmp_path: Path) -> None:
    truth = TrueRig("radtan", PLUMB_BOB, T_R_L)
    to_left = rigid(rotation_from_vector(np.array([0.004, 0.007, -0.01])), np.array([0.06, 0.001, 0.003]))

    def row(matrix: Array) -> str:
        return " ".join(f"{value:.12e}" for value in np.ravel(matrix))

    lines = ["calib_time: 09-Jan-2012 13:57:47"]
    P = np.array([[390.0, 0, 300.0, 20.0], [0, 390.0, 180.0, 0], [0, 0, 1, 0]])
    for camera, K, D, T in (("2", K_L, PLUMB_BOB[0], to_left), ("3", K_R, PLUMB_BOB[1], truth.T @ to_left)):
        lines += [
            f"S_0{camera}: {row(np.array(SIZE))}",
            f"K_0{camera}: {row(K)}",
            f"D_0{camera}: {row(np.array(D))}",
        ]
        lines += [f"R_0{camera}: {row(T[:3, :3])}", f"T_0{camera}: {row(T[:3, 3])}"]
        lines += [
            f"S_rect_0{camera}: 620 370",
            f"R_rect_0{camera}: {row(np.eye(3))}",
            f"P_rect_0{camera}: {row(P)}",
        ]
        P = P - np.array([[0, 0, 0, 97.5], [0, 0, 0, 0], [0, 0, 0, 0]])
    path = write(tmp_path / "calib_cam_to_cam.txt", "\n".join(lines) + "\n")
    require_true(read(path), truth)
    rig = read(path, size=(620, 370)).rig((620, 370))
    assert (rig.baseline, rig.maps) == (0.25, None)


# Other files


def test_a_calibration_of_another_size_is_refused(tmp_path: Path) -> None:
    path = write(tmp_path / "camchain.yaml", chain(OPENCV_4, "pinhole", "radtan"))
    for size, words in (
        ((320, 200), "use images of the calibration's size, or multiply f, cx and cy in the file by 0.5"),
        ((1280, 800), "multiply f, cx and cy in the file by 2"),
        ((640, 360), "part of the image was cut off, or the file belongs to another camera"),
    ):
        with pytest.raises(DataError, match=words):
            read(path, size=size).rig(size)


OPENCV_4 = TrueRig("radtan", RADTAN, T_R_L)
LINE = "--focal 718.856 --centre 607.1928,185.2157 --baseline "
UNKNOWN = {
    "ini": (
        "[cam]\nfx = 718.856\nfy = 718.856\ncx = 607.1928\ncy = 185.2157\n[rig]\nbaseline = 0.54\n",
        "0.54",
    ),
    "orb_slam": (
        "%YAML:1.0\n---\nCamera.fx: 718.856\nCamera.fy: 718.856\nCamera.cx: 607.1928\nCamera.cy: 185.2157\n"
        "Camera.bf: 386.1448\n",
        "0.537166",
    ),
    "json": (
        '{"fx": 718.856, "fy": 718.856, "cx": 607.1928, "cy": 185.2157, "baseline_mm": 537.2}',
        "537.2 --unit mm",
    ),
    "middlebury": (
        "cam0=[718.856 0 607.1928; 0 718.856 185.2157; 0 0 1]\n"
        "cam1=[718.856 0 607.1928; 0 718.856 185.2157; 0 0 1]\ndoffs=0\nbaseline=193.001\nwidth=1241\n",
        "193.001 --unit cm \\(or --unit mm\\)",
    ),
    "prose": ("fx: 718.856 px, cx: 607.1928 px, cy: 185.2157 px; baseline (cm): 54\n", "54 --unit cm"),
    "rs-enumerate-devices": (
        "Intrinsic of Infrared 1\n PPX: \t607.1928\n PPY: \t185.2157\n Fx: \t718.856\n Fy: \t718.856\n"
        "Baseline: 50.1 mm\n",
        "50.1 --unit mm",
    ),
    "xml": (
        "<rig><fx>718.856</fx><fy>718.856</fy><cx>607.1928</cx><cy>185.2157</cy><baseline>0.54</baseline></rig>",
        "0.54",
    ),
}


@pytest.mark.parametrize("name", UNKNOWN)
def test_an_unknown_file_is_answered_with_the_options(tmp_path: Path, name: str) -> None:
    text, baseline = UNKNOWN[name]
    path = write(tmp_path / "rig.txt", text)
    with pytest.raises(
        DataError, match=f"if the images are rectified, replace --calibration by {LINE}{baseline}"
    ):
        read(path, size=(1241, 376))


NUMBERS = "fx: 539.1\nfy: 539.1\ncx: 455.4\ncy: 138.9\nbaseline: 0.537\n"


@pytest.mark.parametrize(
    "named",
    [
        "Camera.width: 931\nCamera.height: 281\n",
        "width=931\nheight=281\n",
        "width=931\n",
        "image_height: 281\n",
        "resolution: [931, 281]\n",
        "resolution:\n  - 931\n  - 281\n",
        "image_size = (931, 281)\n",
        "ImageSize: [281 931]\n",
        "image shape: 281, 931\n",
        "image size [px]: 931 281\n",
        "# image size (w, h) = (931, 281)\n",
        "S_00: 931 281\n",
        "sensor 931 by 281\n",
        "images of 931x281 pixels\n",
        "resolution: 931 × 281\n",
        "left_width: 931\nleft_height: 281\n",
        "[left]\nimage width\n931\nimage height\n281\n",
        "<image_width>931</image_width><image_height>281</image_height>\n",
        '"cols": 931, "rows": 281\n',
        "w: 931.0\nh: 281.0\nscale width: 1e999\nwidth: 931\n",
        "Width:      \t931\nHeight:     \t281\n",
    ],
)
def test_the_options_are_not_given_for_images_of_another_size(tmp_path: Path, named: str) -> None:
    path = write(tmp_path / "rig.txt", NUMBERS + named)
    with pytest.raises(
        DataError, match=r"the calibration is for images of .*(931|281).*multiply f, cx and cy.* 1.33"
    ) as caught:
        read(path, size=(1242, 375))
    assert "--focal" not in str(caught.value)
    with pytest.raises(DataError, match=r"--focal 539.1 --centre 455.4,138.9 --baseline 0.537"):
        read(path, size=(931, 281))


def test_sizes_of_other_things_are_not_those_of_images(tmp_path: Path) -> None:
    path = write(
        tmp_path / "rig.txt", NUMBERS + "rows: 9\ncols: 6\nboard: 300 x 200 mm\nsquare_size: 100\nrows: 3\n"
    )
    with pytest.raises(DataError, match=r"--focal 539.1"):
        read(path, size=(1242, 375))


@pytest.mark.parametrize(
    ("text", "difference"),
    [
        (
            "cam0=[539.1 0 455.4; 0 539.1 138.9; 0 0 1]\ncam1=[539.1 0 586.511; 0 539.1 138.9; 0 0 1]\n"
            "doffs=131.111\nbaseline=193.001\nwidth=931\nheight=281\n",
            "doffs 131.111",
        ),
        (
            "cam0=[539.1 0 455.4; 0 539.1 138.9; 0 0 1]\ncam1=[539.1 0 586.511; 0 539.1 138.9; 0 0 1]\n"
            "baseline=193.001\n",
            "cx 455.4 and 586.511",
        ),
        (NUMBERS + "doffs: -12.5\n", "doffs -12.5"),
        (NUMBERS + "cx_right: 460.1\n", "cx 455.4 and 460.1"),
        (NUMBERS + "right.cx = 460.1\n", "cx 455.4 and 460.1"),
        (NUMBERS + "cx2: 460.1\n", "cx 455.4 and 460.1"),
        (NUMBERS + "[right]\nfx: 539.1\nfy: 539.1\ncx: 455.4\ncy: 141\n", "cy 138.9 and 141"),
        (NUMBERS + "Camera2.fx: 541\nCamera2.cx: 455.4\n", "fx 539.1 and 541"),
    ],
)
def test_the_options_are_not_given_for_cameras_that_differ(
    tmp_path: Path, text: str, difference: str
) -> None:
    path = write(tmp_path / "rig.txt", text)
    with pytest.raises(DataError, match=f"its cameras differ \\({difference}\\)") as caught:
        read(path, size=(931, 281))
    assert "--focal 5" not in str(caught.value)


def test_a_file_without_numbers_lists_the_tools(tmp_path: Path) -> None:
    path = write(tmp_path / "rig.txt", "fx: 718.856\n")
    with pytest.raises(DataError, match="files that are read: OpenCV"):
        read(path)
    path = write(tmp_path / "rig.txt", "fx: 700\nfy: 710\ncx: 607\ncy: 185\nbaseline: 0.5\n")
    with pytest.raises(DataError, match="then fx and fy are equal; here they are 700 and 710"):
        read(path)
