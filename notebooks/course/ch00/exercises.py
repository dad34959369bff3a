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

from ..checker import Case, Exercise, Mistake

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
    lambda camera: camera.f * camera.baseline / DISTANCE,
    rtol=0.01,
    task="The disparity in pixels of a point 20 m away.",
    praise="d = f b / Z = {right:.2f} px.",
    hint="d = f b / Z with camera.f and camera.baseline.",
    mistakes=(
        Mistake(
            "this is f / Z, without a length on top.",
            "which length stands between the two cameras?",
            lambda camera: camera.f / DISTANCE,
        ),
        Mistake(
            "this is the other way round.",
            "the nearer the point, the larger its disparity.",
            lambda camera: DISTANCE / (camera.f * camera.baseline),
        ),
    ),
)

back_project = Exercise(
    point,
    lambda: [(810.0, 250.0, 14.0, CAMERA)],
    task="A function (u, v, d, camera) -> X (3,), metres, left camera frame.",
    praise="X = ({got[0]:.2f}, {got[1]:.2f}, {got[2]:.2f}) m, as `camera.back_project` has it.",
    hint="Z is right; X = (u - cx) / f · Z, and Y likewise.",
    library=("back_project", "triangulate"),
    mistakes=(
        Mistake(
            "X and Y are measured from the corner of the image.",
            "subtract cx and cy first.",
            lambda u, v, d, camera: point(u + camera.cx, v + camera.cy, d, camera),
        ),
        Mistake(
            "Z is {got[2]:.3f} m, expected {right[2]:.3f} m.",
            "Z = f b / d.",
            lambda u, v, d, camera: point(u, v, 2 * d, camera),
            when=lambda X, *case: abs(X[2] - point(*case)[2]) > 1e-9,
        ),
    ),
)

depth_error_ratio = Exercise(
    16.0,
    rtol=0.05,
    task="By what factor the depth error of the same disparity error grows from 10 m to 40 m.",
    praise="the depth error grows with Z²: four times as far, sixteen times as inexact.",
    hint="|dZ/dd| = f b / d² = Z² / (f b): how does it grow with Z?",
    mistakes=(
        Mistake(
            "the error grows faster than the distance.", "derive Z = f b / d by d, then put d back in.", 4.0
        ),
    ),
)

chain = Exercise(
    lambda motions: poses(motions, lambda T_w_p, T_cp: T_w_p @ inverse(T_cp)),
    motions,
    task="A function: list of motions T_cp (4, 4) -> list of poses T_w_c, the first one the identity.",
    praise="every motion, inverted, is appended on the right.",
    hint="T_w_c = T_w_p · inverse(T_cp), starting with np.eye(4).",
    mistakes=(
        Mistake(
            "each pose is that of one motion alone.",
            "append every motion to the pose before.",
            lambda motions: [np.eye(4), *map(inverse, motions)],
        ),
        Mistake(
            "the car drives backwards.",
            "T_cp takes points into the new camera; the pose needs its inverse.",
            lambda motions: poses(motions, lambda T_w_p, T_cp: T_w_p @ T_cp),
        ),
        Mistake(
            "pose 1 is right, pose 2 is not: the order is reversed.",
            "T_w_c = T_w_p · inverse(T_cp).",
            lambda motions: poses(motions, lambda T_w_p, T_cp: inverse(T_cp) @ T_w_p),
        ),
        Mistake(
            "as many poses as motions; expected is one more.",
            "the first pose is the identity.",
            lambda motions: poses(motions, lambda T_w_p, T_cp: T_w_p @ inverse(T_cp))[1:],
        ),
    ),
)

path_length = Exercise(
    lambda sequence: way(sequence, every=True),
    atol=0.05,
    task="The length of the true path, metres.",
    praise="{right:.1f} m along the path; as the crow flies it is less.",
    hint="positions are truth[:, :3, 3]; np.diff gives the steps.",
    mistakes=(
        Mistake(
            "{got:.1f} m is the straight way from start to end.",
            "sum the steps between frames.",
            lambda sequence: way(sequence, every=False),
        ),
    ),
)

wrong_depth = Exercise(
    {"depth Z": 9.0, "true depth": 12.0},
    task="The panel stands at a point whose depth from block matching is more than 20 % off.",
    praise=(
        "{depth Z:.1f} m instead of {true depth:.1f} m. Checks that catch such matches are chapter 1's "
        "subject."
    ),
    hint="",
    mistakes=(
        Mistake(
            "at this point block matching found nothing.",
            "go where the disparity picture is coloured.",
            {"depth Z": np.nan},
            when=lambda facts: np.isnan(facts["depth Z"]),
        ),
        Mistake(
            "the true depth here is unknown or infinite.",
            "take a drawn sequence, and not the sky.",
            {"true depth": np.nan},
            when=lambda facts: np.isnan(facts["true depth"]),
        ),
        Mistake(
            "{depth Z:.1f} m against {true depth:.1f} m is not even 20 % off.",
            ("look for speckles in the disparity picture, or for outlines with far background beside them."),
            {"depth Z": 11.9},
            when=lambda facts: abs(facts["depth Z"] - facts["true depth"]) <= 0.2 * facts["true depth"],
        ),
    ),
)
