"""Calibration files of other tools; after the rectification, rows are equal."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from fetch.calibrations.user_files import read_user_calibration
from fetch.stereo_calibration import rig_from_matrices, rig_from_numbers
from vo_lib.errors import DataError
from vo_lib.geometry.motion import rotation_from_vector
from vo_lib.geometry.types import Array

SIZE = (640, 400)
BASELINE = 0.25
K1 = np.array([[400.0, 0.0, 318.0], [0.0, 402.0, 203.0], [0.0, 0.0, 1.0]])
K2 = np.array([[405.0, 0.0, 325.0], [0.0, 404.0, 196.0], [0.0, 0.0, 1.0]])
D1 = np.array([-0.1, 0.02, 0.0005, -0.0005, 0.0])
D2 = np.array([-0.12, 0.03, -0.0005, 0.0005, 0.0])
R = rotation_from_vector(np.array([0.012, -0.02, 0.015]))
T = R @ np.array([-BASELINE, 0.004, -0.003])
MATRICES = {"K1": K1, "D1": D1, "K2": K2, "D2": D2, "R": R, "T": T}


def write(path: Path, matrices: dict[str, Array]) -> Path:
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    storage.write("image_width", SIZE[0])
    for name, matrix in matrices.items():
        storage.write(name, matrix)
    storage.release()
    return path


def rectified_pixels(maps: tuple[NDArray[np.uint8], NDArray[np.uint8]], uv: Array) -> Array:
    """Positions of raw pixels (N, 2) in the rectified image, by a search in the rectifying map."""
    back = cv2.convertMaps(maps[0], maps[1], cv2.CV_32FC1)[:2]
    source = np.stack(back, axis=-1)
    landed = []
    for point in uv:
        v, u = np.unravel_index(np.argmin(np.linalg.norm(source - point, axis=2)), source.shape[:2])
        # One linear step from the nearest pixel.
        J = np.stack(
            [(source[v, u + 1] - source[v, u - 1]) / 2, (source[v + 1, u] - source[v - 1, u]) / 2], 1
        )
        landed.append(np.array([u, v]) + np.linalg.solve(J, point - source[v, u]))
    return np.array(landed)


def test_rectified_points_have_equal_rows() -> None:
    rig = rig_from_matrices(MATRICES, SIZE, Path("rig.yml"))
    assert rig.baseline == pytest.approx(np.linalg.norm(T), rel=1e-9)
    assert rig.maps is not None
    X = np.array([[0.3, -0.2, 4.0], [-0.8, 0.4, 5.0], [0.1, 0.3, 3.0], [1.0, -0.4, 8.0]])
    left = cv2.projectPoints(X, np.zeros(3), np.zeros(3), K1, D1)[0].reshape(-1, 2)
    right = cv2.projectPoints(X, cv2.Rodrigues(R)[0], T, K2, D2)[0].reshape(-1, 2)
    a, b = (
        rectified_pixels(m, np.asarray(uv, np.float64)) for m, uv in zip(rig.maps, (left, right), strict=True)
    )
    np.testing.assert_allclose(a[:, 1], b[:, 1], atol=0.1)
    depth = rig.f * rig.baseline / (a[:, 0] - b[:, 0])
    # The rectified camera is slightly rotated, so its depths differ from those of X by some percent.
    np.testing.assert_allclose(depth, X[:, 2], rtol=0.04)


def test_names_of_other_tools_are_accepted(tmp_path: Path) -> None:
    inner = {"M1": K1, "dist_coeffs_left": D1, "cameraMatrix2": K2, "D2": D2, "image_points": np.eye(4)}
    outer = {"R": R, "T": 1000 * T}
    paths = [write(tmp_path / "intrinsics.yml", inner), write(tmp_path / "extrinsics.xml", outer)]
    calibration = read_user_calibration(paths, SIZE)
    result = calibration.matrices
    assert set(result) == set(MATRICES)
    for name in ("K1", "D1", "K2", "D2"):
        np.testing.assert_allclose(result[name].ravel(), MATRICES[name].ravel())
    rig = rig_from_matrices(result, SIZE, paths[0], unit=0.001)
    assert rig.baseline == pytest.approx(np.linalg.norm(T), rel=1e-6)


def test_projections_alone_mean_rectified_images() -> None:
    P1 = np.array([[500.0, 0, 320, 0], [0, 500, 200, 0], [0, 0, 1, 0]])
    P2 = P1.copy()
    P2[0, 3] = -500 * BASELINE
    rig = rig_from_matrices({"P1": P1, "P2": P2}, SIZE, Path("p.yml"))
    assert (rig.f, rig.cx, rig.cy, rig.baseline, rig.maps) == (500, 320, 200, BASELINE, None)
    P2[0, 3] *= -1
    assert rig_from_matrices({"P1": P1, "P2": P2}, SIZE, Path("p.yml")).baseline == -BASELINE
    everything = {**MATRICES, "P1": P1, "P2": P2}
    assert rig_from_matrices(everything, SIZE, Path("p.yml"), rectified=True).maps is None
    P2[0, 2] += 5
    with pytest.raises(DataError, match="rectified pair"):
        rig_from_matrices({"P1": P1, "P2": P2}, SIZE, Path("p.yml"))


@pytest.mark.parametrize("baseline", [0.0, 5e-6, -5e-6])
def test_baseline_of_the_wrong_size_is_refused_before_anything_is_written(
    baseline: float,
) -> None:
    with pytest.raises(DataError, match=r"the baseline is .* m: expected .* 0\.01 mm to 10 m"):
        rig_from_numbers(500.0, 320.0, 200.0, baseline)
    assert rig_from_numbers(500.0, 320.0, 200.0, 2e-5).baseline == 2e-5
