"""Exercises of chapter 0: disparity and depth, from motions to poses, the length of a path."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from vo_lib.geometry.camera import StereoCamera
from vo_lib.geometry.motion import inverse, rigid, rotation_from_vector
from vo_lib.geometry.types import Array

from ..checker import Case, Condition, Exercise

DISTANCE = 20.0  # metres
CAMERA = StereoCamera(f=700.0, cx=600.0, cy=180.0, baseline=0.54, width=1241, height=376)


def point(u: float, v: float, d: float, camera: StereoCamera) -> Array:
    """The point (3,), metres, of a pixel (u, v) with the disparity d, pixels."""
    return np.asarray(camera.back_project(np.array([[u, v]]), np.array([d]))[0])


def point_of_unit_depth(u: float, v: float, d: float, camera: StereoCamera) -> Array:
    """Wrong answer: X and Y of the ray's point at depth 1, with the right Z."""
    X, Y, Z = point(u, v, d, camera)
    return np.array([X / Z, Y / Z, Z])


def with_floor_division(u: float, v: float, d: float, camera: StereoCamera) -> Array:
    """Wrong answer: the depth is rounded down to whole metres."""
    Z = camera.f * camera.baseline // d
    return point(u, v, camera.f * camera.baseline / Z, camera)


def motions() -> list[Case]:
    """Cases with one, two and three motions (4, 4); the rotation angles increase."""
    turn = np.array([0.0, 0.3, 0.0])
    T_cp = [rigid(rotation_from_vector(k * turn), np.array([0.1 * k, 0.0, -1.0])) for k in (1, 2, 3)]
    return [(T_cp[:1],), (T_cp[:2],), (T_cp,)]


def appended(step: Callable[[Array], Array], before: bool = False) -> Callable[..., list[Array]]:
    """Answer that appends the last pose times `step(motion)`; with `before`, the factors are exchanged."""

    def chained(motions: list[Array]) -> list[Array]:
        path = [np.eye(4)]
        for T_cp in motions:
            pose = step(T_cp) @ path[-1] if before else path[-1] @ step(T_cp)
            path.append(pose)
        return path

    return chained


def only_t_negated(T: Array) -> Array:
    """Wrong inverse of a motion (4, 4): the rotation R, and the translation -t."""
    return rigid(T[:3, :3], -T[:3, 3])


def inverted_separately(T: Array) -> Array:
    """Wrong inverse of a motion (4, 4): the rotation Rᵀ, and the translation -t."""
    return rigid(T[:3, :3].T, -T[:3, 3])


def paths() -> list[Case]:
    """Cases with poses (N, 4, 4) of a turning camera on a rising, widening spiral, with one or more steps."""
    turn = np.array([0.0, 0.5, 0.0])
    path = []
    for k in range(6):
        place = k * np.array([np.cos(k / 2), -0.4, np.sin(k / 2)])
        path.append(rigid(rotation_from_vector(k * turn), place))
    return [(np.array(path[:2]),), (np.array(path),)]


def steps(poses: Array) -> Array:
    """The steps (N - 1, 3) of a path, metres."""
    return np.asarray(np.diff(poses[:, :3, 3], axis=0))


def length_of(poses: Array) -> float:
    """The length of a path, metres."""
    return float(np.linalg.norm(steps(poses), axis=1).sum())


def beeline(poses: Array) -> float:
    """The distance from the start of a path to its end, metres."""
    return float(np.linalg.norm(steps(poses).sum(axis=0)))


right_chain = appended(inverse)

disparity_at_20_m = Exercise(
    lambda camera: camera.f * camera.baseline / DISTANCE,
    rtol=0.01,
    praise="d = f b / Z = {right:.2f} px.",
    hint="the two coloured triangles of the sketch are similar: d / f = b / Z.",
    line="camera.f * camera.baseline / 20",
    mistakes={
        "this is f / Z: which length is missing?": lambda camera: camera.f / DISTANCE,
        "this is b / Z, which is not in pixels: where is f?": lambda camera: camera.baseline / DISTANCE,
    },
    slips={"inverse": "the nearer a point, the larger its d.", "sign": "the sign: which column is larger?"},
)

back_project = Exercise(
    point,
    lambda: [(810.0, 250.0, 16.0, CAMERA), (350.0, 90.0, 6.5, CAMERA)],
    praise="X = ({got[0]:.2f}, {got[1]:.2f}, {got[2]:.2f}) m, the result of `camera.back_project`.",
    hint="compute Z from the disparity first. Then X is to Z as u - cx is to f, and Y is to Z as v - cy is to f.",
    line="np.array([(u - camera.cx) / camera.f * Z, (v - camera.cy) / camera.f * Z, Z])",
    library=("back_project", "triangulate"),
    slips={"order": "the right numbers in another order: u is the column and gives X, v gives Y."},
    mistakes={
        "X and Y are measured from the corner of the image, not from the axis at (cx, cy).": (
            lambda u, v, d, camera: point(u + camera.cx, v + camera.cy, d, camera)
        ),
        "Y runs upwards: the camera's y axis points down.": lambda *case: np.array([1, -1, 1]) * point(*case),
        "X runs to the left: the camera's x axis points right.": (
            lambda *case: np.array([-1, 1, 1]) * point(*case)
        ),
        "u and v are swapped: u is the column and gives X.": lambda u, v, d, camera: point(v, u, d, camera),
        "X and Y belong to the point at depth 1 on the ray: how far along the ray is the point?": (
            point_of_unit_depth
        ),
        "`//` rounds the quotient down to a whole number: divide by `/`.": (with_floor_division),
        "Z is {got[2]:.3f} m, expected {right[2]:.3f} m: which depth follows from the disparity?": Condition(
            lambda X, *case: abs(X[2] - point(*case)[2]) > 1e-9
        ),
    },
)

depth_error_ratio = Exercise(
    16.0,
    rtol=0.05,
    praise="the depth error grows with Z²: at four times the depth, the error is 16 times as large.",
    hint="take the derivative of Z = f b / d with respect to d, then replace d by f b / Z.",
    line="(40 / 10) ** 2",
    mistakes={"the error grows faster than the distance.": (4.0, 2.0)},
    slips={"inverse": "this is the inverse of the factor."},
)

chain = Exercise(
    right_chain,
    motions,
    praise="every motion, inverted, is appended on the right.",
    hint="the first pose is the identity; each motion gives one more pose, from the pose before.",
    line="poses.append(poses[-1] @ inverse(T_cp))",
    mistakes={
        "each pose contains only one motion.": lambda motions: [np.eye(4), *map(inverse, motions)],
        "the car drives backwards: T_cp takes points into the new camera, a pose takes them back.": (
            appended(lambda T_cp: T_cp),
            appended(lambda T_cp: T_cp, before=True),
        ),
        "pose 1 is right, pose 2 is not: the order is reversed.": appended(inverse, before=True),
        "R with -t is not the inverse: R must be inverted, too.": appended(only_t_negated),
        "R is inverted, but -t is not rotated: the inverse has -Rᵀ t.": appended(inverted_separately),
        "a motion's inverse is not its transpose: that holds for rotations.": appended(np.transpose),
        "`*` multiplies entry by entry: use `@`.": lambda motions: np.cumprod(
            [np.eye(4), *map(inverse, motions)], axis=0
        ),
        "all poses are the same array: append a new one each time.": lambda motions: (
            [right_chain(motions)[-1]] * (len(motions) + 1)
        ),
        "the first pose, the identity, is missing.": lambda motions: right_chain(motions)[1:],
        "a motion is missing.": (
            lambda motions: right_chain(motions)[:-1],
            lambda motions: right_chain(motions[1:]),
        ),
    },
)

path_length = Exercise(
    length_of,
    paths,
    praise="this is the sum of the lengths of all steps; the height counts, too.",
    hint="positions are poses[:, :3, 3]. How long is each step from one to the next?",
    line="np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1).sum()",
    mistakes={
        "{got:.2f} m is the distance from start to end.": beeline,
        "this is the mean step: sum the steps.": lambda poses: length_of(poses) / len(steps(poses)),
        "the last row of a pose has no position; positions are poses[:, :3, 3].": lambda poses: 0.0,
        "the steps are not added: sum them.": lambda poses: np.linalg.norm(steps(poses), axis=1),
        "compute the norm of each step, along axis 1.": lambda poses: np.linalg.norm(steps(poses)),
        "this adds squared lengths: the root is missing.": lambda poses: (steps(poses) ** 2).sum(),
        "the height y is left out.": lambda poses: np.linalg.norm(steps(poses)[:, [0, 2]], axis=1).sum(),
    },
)

wrong_depth = Exercise(
    {"depth Z": 9.0, "true depth": 12.0},
    praise="{depth Z:.1f} m instead of {true depth:.1f} m. Chapter 1 has the checks that catch such matches.",
    mistakes={
        "block matching found nothing here: choose a coloured place.": lambda now: np.isnan(now["depth Z"]),
        "no true depth here: choose a drawn street, and not the sky.": lambda now: np.isnan(
            now["true depth"]
        ),
        "the depth is {depth Z:.1f} m, the true depth {true depth:.1f} m: the error is at most 20 %. Look for speckles in "
        "the disparity picture, or for outlines in front of a far background.": lambda now: (
            abs(now["depth Z"] - now["true depth"]) <= 0.2 * now["true depth"]
        ),
    },
)
