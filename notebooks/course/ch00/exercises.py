"""Exercises of chapter 0: disparity and depth, from motions to poses, the length of a path."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from vo_lib.core.camera import StereoCamera
from vo_lib.core.errors import DataError
from vo_lib.core.geometry import inverse, rigid, rotation_from_vector
from vo_lib.core.types import Array
from vo_lib.data.sequence import Sequence
from vo_lib.evaluation.kitti import trajectory_distances

from ..checker import Case, Exercise

DISTANCE = 20.0  # metres
CAMERA = StereoCamera(f=700.0, cx=600.0, cy=180.0, baseline=0.5, width=1241, height=376)


def point(u: float, v: float, d: float, camera: StereoCamera) -> Array:
    """The point (3,) that a pixel and its disparity stand for."""
    return np.asarray(camera.back_project(np.array([[u, v]]), np.array([d]))[0])


def motions() -> list[Case]:
    """One, two and three motions (4, 4), each turning more than the one before."""
    turn = np.array([0.0, 0.3, 0.0])
    T = [rigid(rotation_from_vector(k * turn), np.array([0.1 * k, 0.0, -1.0])) for k in (1, 2, 3)]
    return [(T[:count],) for count in (1, 2, 3)]


def poses(motions: list[Array], append: Callable[[Array, Array], Array]) -> list[Array]:
    """The identity, and a pose for each motion."""
    path = [np.eye(4)]
    for T_cp in motions:
        path.append(append(path[-1], T_cp))
    return path


def way(sequence: Sequence, every: bool = True) -> float:
    """Metres along the true path, or straight from its start to its end."""
    if sequence.truth is None:
        raise DataError(f"{sequence.name} has no truth; take a drawn sequence")
    return float(trajectory_distances(sequence.truth[:: 1 if every else len(sequence.truth) - 1])[-1])


disparity_at_20_m = Exercise(
    "ch00.disparity_at_20_m", lambda camera: camera.f * camera.baseline / DISTANCE, rtol=0.01
)

back_project = Exercise("ch00.back_project", point, lambda: [(810.0, 250.0, 14.0, CAMERA)])

depth_error_ratio = Exercise("ch00.depth_error_ratio", 16.0, rtol=0.05)

chain = Exercise(
    "ch00.chain", lambda motions: poses(motions, lambda T_w_p, T_cp: T_w_p @ inverse(T_cp)), motions
)

path_length = Exercise("ch00.path_length", lambda sequence: way(sequence, every=True), atol=0.05)

wrong_depth = Exercise("ch00.wrong_depth", {"depth Z": 9.0, "true depth": 12.0})
