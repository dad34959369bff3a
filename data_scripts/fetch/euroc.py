"""EuRoC folders (mav0): images, calibration, and the true path of the rectified left camera."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from fetch.calibrations.values import image_size, intrinsic_matrix, numbers, rigid_transform
from fetch.rectification import FISHEYE, RADTAN, Lens
from fetch.stereo_calibration import RectifiedRig, rig_from_matrices
from fetch.stereo_sources import MAX_DELAY_S, Drive, pair_images
from vo_lib.data.poses import from_first, match_times, read_euroc
from vo_lib.errors import DataError
from vo_lib.files import read_yaml
from vo_lib.geometry.motion import inverse, rigid
from vo_lib.geometry.types import Array

TRUTH = Path("state_groundtruth_estimate0") / "data.csv"
MAX_POSE_DELAY_S = 0.003  # largest time difference of an image and its pose; the truth has 200 Hz
LENSES = {"radial-tangential": RADTAN, "radtan": RADTAN, "equidistant": FISHEYE}


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
    notes = [pairs.note] if pairs.note else []
    chosen = slice(len(pairs.paths))
    poses = None
    if (base / TRUTH).exists():
        true_times, bodies = read_euroc(base / TRUTH)
        at, at_truth = match_times(pairs.times, true_times, MAX_POSE_DELAY_S)
        if len(at) < 2 or len(at) < at[-1] - at[0] + 1:
            notes.append(f"no true poses: {base / TRUTH} does not have a pose for every pair")
        else:
            chosen = slice(int(at[0]), int(at[-1]) + 1)
            poses = from_first(bodies[at_truth] @ T_body_camera)
            left_out = len(pairs.paths) - len(at)
            if left_out:
                notes.append(f"{left_out} pairs before or after the truth are skipped")
    else:
        notes.append(f"no true poses: {base / TRUTH} is missing")
    return Drive(
        pairs.paths[chosen], pairs.times[chosen], "; ".join(notes), rig=rig, poses=poses, bits=pairs.bits
    )


def _rig(base: Path) -> tuple[RectifiedRig, Array]:
    """The rig of both cameras, and T_body_camera (4, 4) of the rectified left camera."""
    matrices: dict[str, Array] = {}
    T_body = []
    sizes = []
    lenses = []
    for number, camera in (("1", "cam0"), ("2", "cam1")):
        path = base / camera / "sensor.yaml"
        sensor = read_yaml(path)
        model = str(sensor.get("distortion_model", "none"))
        if model not in LENSES:
            raise DataError(f"distortion_model {model}: expected radial-tangential or equidistant", path)
        lenses.append(Lens(LENSES[model]))
        values = numbers(sensor.get("intrinsics"), 4, "intrinsics", path)
        matrices[f"K{number}"] = intrinsic_matrix(values, path)
        coefficients = sensor.get("distortion_coefficients")
        matrices[f"D{number}"] = numbers(coefficients, 4, "distortion_coefficients", path)
        sizes.append(image_size(sensor.get("resolution"), "resolution", path))
        T_body.append(rigid(*rigid_transform(sensor.get("T_BS"), "T_BS", path)))
    if sizes[0] != sizes[1]:
        raise DataError("resolution differs from the resolution of cam0", base / "cam1" / "sensor.yaml")
    T_10 = inverse(T_body[1]) @ T_body[0]
    matrices |= {"R": T_10[:3, :3], "T": T_10[:3, 3]}
    path = base / "cam0" / "sensor.yaml"
    rig = rig_from_matrices(matrices, sizes[0], path, lenses=(lenses[0], lenses[1]))
    # R1 rotates from the axes of the left camera to the rectified axes.
    return rig, T_body[0] @ rigid(rig.R1.T, np.zeros(3))
