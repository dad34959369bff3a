"""Exercises of chapter 0: disparity and depth, from motions to poses, the length of a path."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from ...core.camera import StereoCamera
from ...core.geometry import inverse, rigid, rotation_from_vector
from ...data.sequence import Sequence
from ...evaluation.kitti import trajectory_distances
from .verdict import Wrong, as_array, as_number, differs, exercise

DISTANCE = 20.0  # metres, exercise 1


@exercise
def disparity_at_20_m(answer: Any, camera: StereoCamera) -> str:
    """The disparity in pixels of a point 20 m away."""
    value, right = as_number(answer), camera.f * camera.baseline / DISTANCE
    if abs(value - camera.f / DISTANCE) < 0.01 * value:
        raise Wrong("this is f / Z, without a length on top.", "which length stands between the two cameras?")
    if abs(value - DISTANCE / (camera.f * camera.baseline)) < 1e-3:
        raise Wrong("this is the other way round.", "the nearer the point, the larger its disparity.")
    if abs(value - right) > 0.01 * right:
        raise Wrong(f"{value:.3g} px is not it.", "d = f b / Z with camera.f and camera.baseline.")
    return f"d = f b / Z = {right:.2f} px."


@exercise
def back_project(function: Callable[..., Any]) -> str:
    """A function (u, v, d, camera) -> X (3,), metres, left camera frame."""
    camera = StereoCamera(f=700.0, cx=600.0, cy=180.0, baseline=0.5, width=1241, height=376)
    expected = camera.back_project(np.array([[810.0, 250.0]]), np.array([14.0]))[0]
    got = as_array(function(810.0, 250.0, 14.0, camera), (3,), "X")
    if not differs(got, expected, 1e-9):
        return f"X = ({got[0]:.2f}, {got[1]:.2f}, {got[2]:.2f}) m, as `camera.back_project` has it."
    if abs(got[2] - expected[2]) > 1e-9:
        raise Wrong(f"Z is {got[2]:.3f} m, expected {expected[2]:.3f} m.", "Z = f b / d.")
    if not differs(got[:2], np.array([810.0, 250.0]) / 700.0 * got[2], 1e-6):
        raise Wrong("X and Y are measured from the corner of the image.", "subtract cx and cy first.")
    raise Wrong("Z is right, X or Y is not.", "X = (u - cx) / f · Z, and Y likewise.")


@exercise
def depth_error_ratio(answer: Any) -> str:
    """By what factor the depth error of the same disparity error grows from 10 m to 40 m."""
    value = as_number(answer)
    if abs(value - 4.0) < 0.01:
        raise Wrong(
            "the error grows faster than the distance.", "derive Z = f b / d by d, then put d back in."
        )
    if abs(value - 16.0) > 0.8:
        raise Wrong(f"{value:.3g} is not it.", "|dZ/dd| = f b / d² = Z² / (f b): how does it grow with Z?")
    return "the depth error grows with Z²: four times as far, sixteen times as inexact."


@exercise
def chain(function: Callable[..., Any]) -> str:
    """A function: list of motions T_cp (4, 4) -> list of poses T_w_c, the first one the identity."""
    turn = np.array([0.0, 0.3, 0.0])
    motions = [rigid(rotation_from_vector(k * turn), np.array([0.1 * k, 0.0, -1.0])) for k in (1, 2, 3)]
    expected = [np.eye(4)]
    for T_cp in motions:
        expected.append(expected[-1] @ inverse(T_cp))
    got = function([T.copy() for T in motions])
    if got is None or len(got) != 4:
        count = "nothing" if got is None else f"{len(got)} poses"
        raise Wrong(f"got {count} for 3 motions, expected 4 poses.", "the first pose is the identity.")
    poses = [as_array(T, (4, 4), f"pose {i}") for i, T in enumerate(got)]
    if not differs(np.array(poses), np.array(expected), 1e-9):
        return "every motion, inverted, is appended on the right."
    if not differs(poses[1], motions[0], 1e-9):
        raise Wrong(
            "the car drives backwards.", "T_cp takes points into the new camera; the pose needs its inverse."
        )
    if not differs(poses[2], inverse(motions[1]) @ inverse(motions[0]), 1e-9):
        raise Wrong(
            "pose 1 is right, pose 2 is not: the order is reversed.", "T_w_c = T_w_p · inverse(T_cp)."
        )
    raise Wrong(
        "the poses are not those of the motions.", "T_w_c = T_w_p · inverse(T_cp), starting with np.eye(4)."
    )


@exercise
def path_length(answer: Any, sequence: Sequence) -> str:
    """The length of the true path, metres."""
    value = as_number(answer)
    if sequence.truth is None:
        raise Wrong(f"{sequence.name} has no truth.", "take a drawn sequence.")
    right = float(trajectory_distances(sequence.truth)[-1])
    straight = float(np.linalg.norm(sequence.truth[-1, :3, 3] - sequence.truth[0, :3, 3]))
    if abs(value - straight) < 0.05 < abs(value - right):
        raise Wrong(f"{value:.1f} m is the straight way from start to end.", "sum the steps between frames.")
    if abs(value - right) > 0.05:
        raise Wrong(f"{value:.1f} m is not it.", "positions are truth[:, :3, 3]; np.diff gives the steps.")
    return f"{right:.1f} m, of which {straight:.1f} m as the crow flies."


@exercise
def wrong_depth(facts: Mapping[str, float]) -> str:
    """The panel stands at a point whose depth from block matching is more than 20 % off."""
    found, true = facts.get("depth Z", np.nan), facts.get("true depth", np.nan)
    if np.isnan(found):
        raise Wrong(
            "at this point block matching found nothing.", "go where the disparity picture is coloured."
        )
    if np.isnan(true):
        raise Wrong("the true depth here is unknown or infinite.", "take a drawn sequence, and not the sky.")
    if abs(found - true) <= 0.2 * true:
        raise Wrong(
            f"{found:.1f} m against {true:.1f} m is only {100 * abs(found / true - 1):.0f} % off.",
            "look for speckles in the disparity picture, or for outlines with far background beside them.",
        )
    return f"{found:.1f} m instead of {true:.1f} m. Checks that catch such matches are chapter 1's subject."
