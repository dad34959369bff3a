"""EuRoC folders (mav0): images, calibration, and the true path of the rectified left camera."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from fetch.stereo_calibration import Rig, rig_from_matrices
from fetch.stereo_sources import MAX_DELAY_S, Drive, pair_images
from training.dataset import read_yaml
from vo_lib.data.poses import from_first, is_rotation, match_times, read_euroc
from vo_lib.errors import DataError
from vo_lib.geometry.motion import inverse, rigid
from vo_lib.geometry.types import Array

TRUTH = Path("state_groundtruth_estimate0") / "data.csv"
MAX_POSE_DELAY_S = 0.003  # largest time difference of an image and its pose; the truth has 200 Hz
MAX_CAMERA_NUMBER = 1e5  # largest plausible number in a calibration, pixels or metres


def read_euroc_drive(folder: Path, max_delay: float = MAX_DELAY_S) -> Drive:
    """The drive in a folder mav0 or its parent. Raises `DataError` with the name of an invalid file.

    The names of the images are times in nanoseconds. Images without a partner within `max_delay` seconds are
    skipped, and also pairs before the start or after the end of the ground truth.
    """
    base = folder / "mav0" if (folder / "mav0").is_dir() else folder
    if not (base / "cam0").is_dir():
        raise DataError("is not a EuRoC folder: expected mav0/cam0 and mav0/cam1", folder)
    pairs = pair_images(base / "cam0" / "data", base / "cam1" / "data", max_delay, skip_unpaired=True)
    if pairs.times is None:
        raise DataError("expected images whose names are times in nanoseconds", base / "cam0" / "data")
    rig, T_body_camera = _rig(base)
    notes, chosen, poses = [pairs.note] if pairs.note else [], slice(len(pairs.paths)), None
    if (base / TRUTH).exists():
        true_times, bodies = read_euroc(base / TRUTH)
        at, at_truth = match_times(pairs.times, true_times, MAX_POSE_DELAY_S)
        if len(at) < 2 or len(at) < at[-1] - at[0] + 1:
            notes.append(f"no true poses: {base / TRUTH} does not have a pose for every pair")
        else:
            chosen = slice(int(at[0]), int(at[-1]) + 1)
            poses = from_first(bodies[at_truth] @ T_body_camera)
            left_out = len(pairs.paths) - len(at)
            notes += [f"{left_out} pairs before or after the truth are skipped"] if left_out else []
    else:
        notes.append(f"no true poses: {base / TRUTH} is missing")
    return Drive(pairs.paths[chosen], pairs.times[chosen], "; ".join(notes), rig=rig, poses=poses)


def _rig(base: Path) -> tuple[Rig, Array]:
    """The rig of both cameras, and T_body_camera (4, 4) of the rectified left camera."""
    matrices: dict[str, Array] = {}
    T_body, sizes = [], []
    for number, camera in (("1", "cam0"), ("2", "cam1")):
        path = base / camera / "sensor.yaml"
        sensor = read_yaml(path)
        model = sensor.get("distortion_model", "none")
        if model not in ("radial-tangential", "radtan"):
            raise DataError(f"distortion_model {model}: expected radial-tangential distortion", path)
        fu, fv, cu, cv = _numbers(sensor, "intrinsics", 4, path)
        matrices[f"K{number}"] = np.array([[fu, 0.0, cu], [0.0, fv, cv], [0.0, 0.0, 1.0]])
        matrices[f"D{number}"] = _numbers(sensor, "distortion_coefficients", 4, path)
        sizes.append(_numbers(sensor, "resolution", 2, path))
        if (sizes[-1] < 1).any() or (sizes[-1] % 1).any():
            raise DataError("resolution: expected a width and a height, pixels", path)
        T = _numbers(sensor, "T_BS", 16, path).reshape(4, 4)
        if not is_rotation(T[:3, :3]):
            raise DataError("T_BS is not a pose: expected a rotation and a translation, row by row", path)
        T_body.append(rigid(T[:3, :3], T[:3, 3]))
    if (sizes[0] != sizes[1]).any():
        raise DataError("resolution differs from the resolution of cam0", base / "cam1" / "sensor.yaml")
    T_10 = inverse(T_body[1]) @ T_body[0]
    width, height = (int(side) for side in sizes[0])
    matrices |= {"R": T_10[:3, :3], "T": T_10[:3, 3]}
    rig = rig_from_matrices(matrices, (width, height), base / "cam0" / "sensor.yaml")
    # R1 rotates from the axes of the left camera to the rectified axes.
    return rig, T_body[0] @ rigid(rig.R1.T, np.zeros(3))


def _numbers(sensor: dict[str, Any], name: str, count: int, path: Path) -> Array:
    """The numbers of the entry `name: [a, b, …]`, or of the field `data` of a matrix."""
    value: Any = sensor.get(name)
    try:
        value = value["data"] if isinstance(value, dict) else value
        numbers = np.array([float(word) for word in value])  # PyYAML reads 1e-05 as text
    except (KeyError, TypeError, ValueError, OverflowError):
        numbers = np.zeros(0)
    if len(numbers) != count or not (np.abs(numbers) < MAX_CAMERA_NUMBER).all():
        raise DataError(f"{name}: expected {count} numbers in brackets", path)
    return numbers
