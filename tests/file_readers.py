"""All readers of files, each with a folder of valid files. Tests replace these files by damaged copies."""

from __future__ import annotations

import functools
import io
import json
import re
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from conftest import write_bands

from fetch.calibrations.user_files import read_user_calibration
from fetch.kitti_raw import read_raw_drive
from training.dataset import open_set
from training.kitti_set import read_object_set
from vo_lib import open_sequence, preset, run
from vo_lib.data.kitti import read_calibration, read_image, read_part, read_times
from vo_lib.data.label_files import read_labels
from vo_lib.data.poses import read_kitti_poses, read_poses
from vo_lib.data.scenes import scene_config
from vo_lib.data.truth import open_truth
from vo_lib.kit.calibration import read_learnt_calibration
from vo_lib.runs.folder import read_run, write_run
from vo_lib.runs.identity import run_identity
from vo_lib.settings import to_dict

KITTI = "1 0 0 0 0 1 0 0 0 0 1 {}\n"
CALIB = "P0: 300 0 240 0 0 300 120 0 0 0 1 0\nP1: 300 0 240 -150 0 300 120 0 0 0 1 0\n"
LABEL = "2 0.25 0.5 0.3 0.8\n5 0.5 0.5 0.1 0.1 0.75\n"
MATRIX = "{}: !!opencv-matrix\n   rows: {}\n   cols: {}\n   dt: d\n   data: [ {} ]\n"
K, EYE = "400., 0., 318., 0., 400., 203., 0., 0., 1.", "1., 0., 0., 0., 1., 0., 0., 0., 1."
OBJECT = "Car 0.00 0 -1.5 20.00 30.00 60.00 70.00 0 0 0 0 0 0 0\n"
STAMPS = "2011-09-26 13:02:25.964389445\n2011-09-26 13:02:26.064389445\n"


def expanded(text: str) -> str:
    """The text, in which each <words*times> is replaced by `times` copies of `words`."""
    return re.sub(r"<(.+?)\*(\d+)>", lambda run: run[1] * int(run[2]), text)


@dataclass(frozen=True)
class FileReader:
    """A file in a folder, the function that reads the folder, and the content of all files of the folder."""

    file: str
    read: Callable[[Path], Any]
    files: dict[str, str | bytes]

    @property
    def valid(self) -> bytes:
        """The valid bytes of the file."""
        content = self.files[self.file]
        return content.encode() if isinstance(content, str) else content

    def write(self, folder: Path) -> Path:
        """Write the folder, and return the path of the file."""
        for name, content in self.files.items():
            path = folder / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(content.encode() if isinstance(content, str) else content)
        return folder / self.file


def png(height: int = 48, width: int = 64) -> bytes:
    """A grey image."""
    return cv2.imencode(".png", np.arange(height * width, dtype=np.uint8).reshape(height, width))[1].tobytes()


def _alone(file: str, read: Callable[[Path], Any], content: str | bytes) -> FileReader:
    return FileReader(file, lambda folder: read(folder / file), {file: content})


def _opencv() -> str:
    parts = [("K1", 3, 3, K), ("D1", 1, 5, "0., 0., 0., 0., 0."), ("K2", 3, 3, K)]
    parts += [("D2", 1, 5, "0., 0., 0., 0., 0."), ("R", 3, 3, EYE), ("T", 3, 1, "-0.25, 0., 0.")]
    return "%YAML:1.0\n---\n" + "".join(MATRIX.format(*part) for part in parts)


KALIBR = """cam0:
  cam_overlaps: [1]
  camera_model: pinhole
  intrinsics: [45.8, 45.7, 32.0, 24.0]
  distortion_model: equidistant
  distortion_coeffs: [0.02, -0.01, 0.003, -0.001]
  resolution: [64, 48]
cam1:
  T_cn_cnm1: [[1, 0, 0, -0.11], [0, 1, 0, 0.001], [0, 0, 1, 0], [0, 0, 0, 1]]
  cam_overlaps: [0]
  camera_model: omni
  intrinsics: [0.9, 85.8, 85.7, 31.0, 24.5]
  distortion_model: radtan
  distortion_coeffs: [-0.2, 0.07, 0.0002, 0.00002]
  resolution: [64, 48]
"""
CAMERA_INFO = """image_width: 64
image_height: 48
camera_name: {name}
camera_matrix: {{rows: 3, cols: 3, data: [45.8, 0, 32, 0, 45.7, 24, 0, 0, 1]}}
distortion_model: plumb_bob
distortion_coefficients: {{rows: 1, cols: 5, data: [-0.2, 0.07, 0.0002, 0.00002, 0]}}
rectification_matrix: {{rows: 3, cols: 3, data: [1, 0, 0, 0, 1, 0, 0, 0, 1]}}
projection_matrix: {{rows: 3, cols: 4, data: [45.8, 0, 32, {tx}, 0, 45.8, 24, 0, 0, 0, 1, 0]}}
"""
OST = """[image]

width
64

height
48

""" + "".join(
    f"""[narrow_stereo/{name}]

camera matrix
45.8 0 32
0 45.7 24
0 0 1

distortion
-0.2 0.07 0.0002 0.00002 0

rectification
1 0 0
0 1 0
0 0 1

projection
45.8 0 32 {tx}
0 45.8 24 0
0 0 1 0

"""
    for name, tx in (("left", 0), ("right", -5.0))
)
REALSENSE = """{
 "left": {"width": 64, "height": 48, "fx": 45.8, "fy": 45.7, "ppx": 32, "ppy": 24,
  "model": "kannala_brandt4", "coeffs": [0.02, -0.01, 0.003, -0.001, 0]},
 "right": {"width": 64, "height": 48, "fx": 45.8, "fy": 45.7, "ppx": 32, "ppy": 24,
  "model": "brown_conrady", "coeffs": [0.02, -0.01, 0.003, -0.001, 0]},
 "extrinsics": {"rotation": [1, 0, 0, 0, 1, 0, 0, 0, 1], "translation": [-0.05, 0, 0]}
}
"""
ZED = """[LEFT_CAM_VGA]
fx=350.4
fy=350.3
cx=348.2
cy=193.4
k1=-0.17
k2=0.02
p1=0.001
p2=0

[RIGHT_CAM_VGA]
fx=349.3
fy=349.2
cx=335.5
cy=195.0
k1=-0.17
k2=0.02
p1=0.001
p2=0

[STEREO]
Baseline=119.9
TY=0.1
TZ=-0.2
CV_VGA=0.009
RX_VGA=0.004
RZ_VGA=-0.001
"""


def _archive() -> bytes:
    buffer = io.BytesIO()
    K, D = np.array([[45.8, 0, 32], [0, 45.7, 24], [0, 0, 1]]), np.array([[-0.2, 0.07, 0.0002, 0.00002, 0]])
    np.savez(buffer, mtxL=K, distL=D, mtxR=K, distR=D, R=np.eye(3), T=np.array([-0.1, 0, 0]))
    return buffer.getvalue()


def _array() -> bytes:
    buffer = io.BytesIO()
    np.save(buffer, np.tile(np.eye(4), (2, 1, 1)))
    return buffer.getvalue()


def _calibration(
    name: str, content: str | bytes, size: tuple[int, int] = (64, 48), **others: str
) -> FileReader:
    """A calibration file, with other files of the same calibration."""

    def read(folder: Path) -> Any:
        return read_user_calibration([folder / file for file in (name, *others.values())], size).rig(size)

    contents = {other: CAMERA_INFO.format(name="left", tx=0) for other in others.values()}
    return FileReader(name, read, {name: content, **contents})


def _raw() -> dict[str, str | bytes]:
    rigid = f"R: {EYE.replace(',', '')}\nT: 0.1 0.2 0.3\n"
    cameras = "calib_time: 09-Jan-2012 13:57:47\nS_rect_00: 64 48\nR_rect_00: " + EYE.replace(",", "")
    cameras += "\nP_rect_00: 300 0 32 0 0 300 24 0 0 0 1 0\nP_rect_01: 300 0 32 -150 0 300 24 0 0 0 1 0\n"
    files: dict[str, str | bytes] = {
        "calib_cam_to_cam.txt": cameras,
        "calib_imu_to_velo.txt": rigid,
        "calib_velo_to_cam.txt": rigid,
        "image_00/timestamps.txt": STAMPS,
    }
    for frame in range(2):
        files |= {f"image_0{side}/data/{frame:010d}.png": png() for side in range(2)}
        files[f"oxts/data/{frame:010d}.txt"] = "49.0 8.4 116.0 0.01 0.02 0.7" + 24 * " 0" + "\n"
    return files


def _truth() -> dict[str, str | bytes]:
    buffer = io.BytesIO()
    np.savez(buffer, kind=np.full(1, 2), poses=np.tile(np.eye(4), (2, 1, 1, 1)))
    scene = json.dumps({"config": to_dict(scene_config("traffic"))})
    poses = KITTI.format(0) + KITTI.format(1)
    return {"truth/scene.json": scene, "truth/objects.npz": buffer.getvalue(), "poses.txt": poses}


@functools.cache
def _run() -> tuple[dict[str, str | bytes], Callable[[Path], Any]]:
    """The files of a run folder, and the function that reads the folder."""
    with tempfile.TemporaryDirectory() as place:
        sequence = open_sequence(write_bands(Path(place, "bands"), frames=3))
        config = preset("solution_selection", variant="kit")
        write_run(Path(place), run(sequence, config), run_identity(sequence, config, "solution_selection"))
        written = [path for path in Path(place).iterdir() if path.is_file()]
        files: dict[str, str | bytes] = {path.name: path.read_bytes() for path in written}
    return files, lambda folder: read_run(folder, sequence).poses


@functools.cache
def readers() -> dict[str, FileReader]:
    """All readers by name."""
    run_files, read_folder = _run()
    drives: dict[str, str | bytes] = {
        "image_2/000000.png": png(),
        "label_2/000000.txt": OBJECT,
        "mapping.txt": "2011_09_26 2011_09_26_drive_0005_sync 0000000000\n",
        "order.txt": "1\n",
    }

    def objects(folder: Path) -> Any:
        return read_object_set(folder, folder / "mapping.txt", folder / "order.txt")

    result = {
        "poses": _alone("poses.txt", read_kitti_poses, KITTI.format(0) + KITTI.format(1)),
        "tum": _alone("poses.txt", read_poses, "# t\n0 0 0 0 0 0 0 1\n1 0 0 1 0 0 0 1\n"),
        "npy": _alone("path.npy", read_poses, _array()),
        "calib": _alone("calib.txt", read_calibration, CALIB),
        "part": FileReader("part.txt", read_part, {"part.txt": "--sequences 00 --frames 0:201\n"}),
        "times": _alone("times.txt", read_times, "0.0\n0.1\n0.2\n"),
        "labels": _alone("000000.txt", lambda path: read_labels(path, 480, 240), LABEL),
        "image": _alone("000000.png", read_image, png()),
        "calibration.json": _alone(
            "calibration.json", read_learnt_calibration, run_files["calibration.json"]
        ),
        "data.yaml": FileReader(
            "data.yaml",
            open_set,
            {"data.yaml": "train: a\nval: b\nnames: [car, bus]\n", "a/0.png": png(), "b/0.png": png()},
        ),
        "opencv": _alone(
            "stereo.yml", lambda path: read_user_calibration([path], (64, 48)).rig((64, 48)), _opencv()
        ),
        "kalibr": _calibration("camchain.yaml", KALIBR),
        "camera_info": _calibration(
            "right.yaml", CAMERA_INFO.format(name="right", tx=-5.0), left="left.yaml"
        ),
        "ost": _calibration("ost.txt", OST),
        "realsense": _calibration("d435.json", REALSENSE),
        "zed": _calibration("SN1.conf", ZED, (672, 376)),
        "npz": _calibration("stereo.npz", _archive()),
        "kitti": _calibration("calib.txt", CALIB),
        "objects": FileReader("label_2/000000.txt", objects, drives),
        "mapping": FileReader("mapping.txt", objects, drives),
        "order": FileReader("order.txt", objects, drives),
        "scene.json": FileReader("truth/scene.json", open_truth, _truth()),
        "objects.npz": FileReader("truth/objects.npz", open_truth, _truth()),
    }
    for name in ("config.json", "frames.csv"):
        result[name] = FileReader(name, read_folder, run_files)
    for name in ("calib_cam_to_cam.txt", "calib_imu_to_velo.txt", "image_00/timestamps.txt"):
        result[name.removeprefix("image_00/")] = FileReader(name, read_raw_drive, _raw())
    result["oxts"] = FileReader("oxts/data/0000000001.txt", read_raw_drive, _raw())
    return result
