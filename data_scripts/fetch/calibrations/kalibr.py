"""Camera chains of Kalibr (camchain.yaml, also with an IMU).

`T_cn_cnm1` takes points from the previous camera of the chain to this one, so for cam1 it is T_c1_c0; lengths
are metres, and the radtan and equidistant coefficients are those of OpenCV's pinhole and fisheye models
(https://github.com/ethz-asl/kalibr/wiki/yaml-formats).
"""

from __future__ import annotations

import re
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from fetch.calibrations.values import common_size, image_size, intrinsic_matrix, numbers, rigid_transform
from fetch.rectification import FISHEYE, OMNI, RADTAN, Lens
from fetch.stereo_calibration import FileCalibration
from vo_lib.errors import DataError
from vo_lib.geometry.motion import inverse, rigid
from vo_lib.geometry.types import Array

CAMERA = re.compile(r"cam(\d+)")


def is_chain(content: dict[Any, Any]) -> bool:
    """Whether the mapping of a YAML file is a camera chain."""
    return any(isinstance(camera, dict) and "intrinsics" in camera for camera in _cameras(content).values())


def read_chain(content: dict[Any, Any], path: Path, folders: tuple[str, ...] = ()) -> FileCalibration:
    """The calibration of two neighbouring cameras that see the same scene; the one on the left is camera 1.

    Parameters
    ----------
    content : mapping of the YAML file.
    folders : paths of the left and the right images; `cam1` in a path chooses the camera of this name.
    """
    cameras = _cameras(content)
    if len(cameras) < 2:
        raise DataError(f"expected two cameras, found {', '.join(cameras) or 'none'}", path)
    first, second = _pair(cameras, folders, path)
    T = _between(cameras, first, second, path)
    left = first
    right = second
    if T[0, 3] > 0:  # the first camera is to the right of the second
        left = second
        right = first
        T = inverse(T)
    matrices: dict[str, Array] = {"R": T[:3, :3], "T": T[:3, 3]}
    sizes = []
    lenses = []
    for number, name in (("1", left), ("2", right)):
        matrices[f"K{number}"], matrices[f"D{number}"], lens = _camera(cameras[name], name, path)
        lenses.append(lens)
        if "resolution" in cameras[name]:
            sizes.append(image_size(cameras[name]["resolution"], f"{name}: resolution", path))
    notes = []
    if len(cameras) > 2 or left != next(iter(cameras)):
        notes.append(
            f"{left} is the left camera and {right} the right one, of {', '.join(cameras)} in {path}"
        )
    return FileCalibration(
        matrices,
        path,
        common_size(sizes, path) if sizes else None,
        1.0,
        (lenses[0], lenses[1]),
        notes=tuple(notes),
    )


def _cameras(content: dict[Any, Any]) -> dict[str, dict[str, Any]]:
    """The cameras by name, in the order of their numbers."""
    found = {
        name: camera
        for name, camera in content.items()
        if isinstance(name, str) and CAMERA.fullmatch(name) and isinstance(camera, dict)
    }
    return dict(sorted(found.items(), key=lambda item: int(item[0][3:])))


def _pair(cameras: dict[str, dict[str, Any]], folders: tuple[str, ...], path: Path) -> tuple[str, str]:
    """Two cameras of the chain: those that the folders name, or else the first two that overlap."""
    named = [[name for name in cameras if name in Path(folder).parts] for folder in folders]
    if len(named) == 2 and all(len(names) == 1 for names in named) and named[0] != named[1]:
        first, second = sorted((named[0][0], named[1][0]), key=list(cameras).index)
        return first, second
    names = list(cameras)
    for first, second in pairwise(names):
        overlaps = cameras[first].get("cam_overlaps")
        if not isinstance(overlaps, list) or int(second[3:]) in overlaps:
            return first, second
    raise DataError("cam_overlaps: no two neighbouring cameras see the same scene", path)


def _between(cameras: dict[str, dict[str, Any]], first: str, second: str, path: Path) -> Array:
    """Transform (4, 4) of points from the first to the second camera."""
    names = list(cameras)
    links = names[names.index(first) + 1 : names.index(second) + 1]
    if all("T_cn_cnm1" in cameras[name] for name in links):
        T = np.eye(4)
        for name in links:
            R, t = rigid_transform(cameras[name]["T_cn_cnm1"], f"{name}: T_cn_cnm1", path)
            T = rigid(R, t) @ T
        return T
    from_imu = []
    for name in (first, second):
        if "T_cam_imu" in cameras[name]:
            from_imu.append(rigid(*rigid_transform(cameras[name]["T_cam_imu"], f"{name}: T_cam_imu", path)))
        elif "T_imu_cam" in cameras[name]:
            to_imu = rigid(*rigid_transform(cameras[name]["T_imu_cam"], f"{name}: T_imu_cam", path))
            from_imu.append(inverse(to_imu))
        else:
            raise DataError(f"{second}: expected T_cn_cnm1, the transform from the camera before it", path)
    return np.asarray(from_imu[1] @ inverse(from_imu[0]))


def _camera(camera: dict[str, Any], name: str, path: Path) -> tuple[Array, Array, Lens]:
    """K, D and the lens model of a camera."""
    model = str(camera.get("camera_model", "pinhole"))
    distortion = str(camera.get("distortion_model", "none"))
    if model not in ("pinhole", "omni"):
        raise DataError(
            f"{name}: camera_model {model}: expected pinhole or omni; calibrate again with one", path
        )
    known = {"radtan": 4, "none": 0} if model == "omni" else {"radtan": 4, "equidistant": 4, "none": 0}
    if distortion not in known:
        raise DataError(f"{name}: distortion_model {distortion}: expected {' or '.join(known)}", path)
    values = numbers(camera.get("intrinsics"), 5 if model == "omni" else 4, f"{name}: intrinsics", path)
    K = intrinsic_matrix(values[-4:], path)
    D = np.zeros(4)
    if known[distortion]:
        D = numbers(camera.get("distortion_coeffs"), 4, f"{name}: distortion_coeffs", path)
    if distortion == "equidistant":
        return K, D, Lens(FISHEYE)
    if model == "omni":
        if values[0] < 0:
            raise DataError(f"{name}: intrinsics: expected xi of 0 or more, found {values[0]:g}", path)
        return K, D, Lens(OMNI, float(values[0]))
    return K, D, Lens(RADTAN)
