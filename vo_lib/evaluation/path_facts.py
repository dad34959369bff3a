"""What paths say without ground truth: length and end, and how far two are apart.

These are no errors: two paths may agree and both be wrong. All poses are `T_w_c`, (N, 4, 4), metres.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..geometry.types import Array
from .ate_rpe import Alignment, align, rmse
from .kitti_errors import trajectory_distances

FORWARD = 0.8  # least `forward_share` of a camera that looks ahead: KITTI's paths have 0.99 or more
LENGTH_RATIOS = (0.5, 2.0)  # usual lengths of a path, divided by that of its truth
MIN_MOVING_SHARE = 0.1  # a step counts as motion if it is longer than this share of the mean step


class PathDifference(NamedTuple):
    """How far two paths are apart: at the last frame, the largest distance, and the rmse; metres."""

    end: float
    largest: float
    rmse: float


def path_length(poses: Array) -> float:
    """Length of a path (N, 4, 4), metres."""
    return float(trajectory_distances(poses)[-1])


def end_of(poses: Array) -> Array:
    """Position (3,) of the last pose in the axes of the first, metres: x right, y down, z forward."""
    return np.asarray(np.linalg.inv(poses[0]) @ poses[-1])[:3, 3]


def path_difference(poses: Array, others: Array) -> PathDifference:
    """The distances between the positions of two paths (N, 4, 4) after a common start; raises as `align`."""
    moved, _ = align(poses, others, Alignment.ORIGIN)
    distance = np.linalg.norm(moved[:, :3, 3] - poses[:, :3, 3], axis=1)
    return PathDifference(float(distance[-1]), float(distance.max()), rmse(distance) or 0.0)


def forward_share(poses: Array) -> float:
    """Mean z component, in [-1, 1], of the directions in which a path (N, 4, 4) moves, in each pose's axes.

    A camera that looks ahead has nearly 1. Inverted poses, other axes (of a robot, x is forward) and
    quaternions in another order have less. Poses that hardly move do not count; 0 if none does.
    """
    steps = np.asarray(np.linalg.inv(poses[:-1]) @ poses[1:])[:, :3, 3]
    lengths = np.linalg.norm(steps, axis=1)
    moving = lengths > MIN_MOVING_SHARE * lengths.sum() / max(len(lengths), 1)
    return float(np.mean(steps[moving, 2] / lengths[moving])) if moving.any() else 0.0


def doubt(truth: Array, poses: Array) -> str:
    """Why a path is probably in other axes or another unit than the truth, both (N, 4, 4); "" if it is not.

    It is if the truth moves along its own +z axis, as a camera does, and the path does not, or if the path is
    more than twice as long, or less than half as long.
    """
    if forward_share(truth) >= FORWARD > forward_share(poses):
        return "does not move along its own +z axis as the truth does: other axes, or inverted poses"
    true_length = path_length(truth)
    length = path_length(poses)
    least, most = LENGTH_RATIOS
    if not least * true_length <= length <= most * true_length:
        ratio = length / true_length if true_length > 0 else np.inf
        return f"is {ratio:.3g} times as long as the truth: other frames, another unit, or no scale"
    return ""
