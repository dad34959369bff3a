"""What paths say without ground truth: length, duration, speed and end, and how far they are apart.

These are no errors: two paths may agree and both be wrong. All poses are `T_w_c`, (N, 4, 4), metres.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np

from ..geometry.types import Array
from .ate_rpe import Alignment, align, rmse
from .kitti_errors import trajectory_distances

MIN_MOVING_SHARE = 0.1  # a step counts as motion if it is longer than this share of a usual step
# Of the directions (unit vectors) in which a path moves from pose to pose, in the axes of each pose:
ONE_DIRECTION = 0.3  # if their mean is longer, they have a direction in common: that of the mean
ONE_LINE = 0.6  # if a line has at least this share of their squares, they have it in common
CAMERA_CONE_DEG = 45.0  # a camera that drives forward moves nearer than this to its z axis
FORWARD = 0.9  # smallest mean z component of a path that clearly moves along +z
NOT_FORWARD = 0.5  # largest mean z component of a path that clearly does not
AXES = ("x", "y", "z")
# Of leaps:
MAX_SPEED = 100.0  # m/s; no vehicle of a test drive is faster
MAX_STEP = 10.0  # metres from pose to pose without times: that speed at ten frames a second
LEAP_RATIO = 5.0  # smallest ratio of a leap to the path's own median step, and to its median speed
# For a path in a small unit or without scale, which never reaches `MAX_SPEED`: the ratio of a leap to the
# speed that nine tenths of the steps stay below.
SCALELESS_LEAP_RATIO = 30.0


@dataclass(frozen=True, eq=False)
class PathFacts:
    """Facts about one path.

    Attributes
    ----------
    poses : number of poses.
    length : of the path, metres.
    duration : seconds from the first to the last pose, or None if the times are unknown.
    end : (3,) position of the last pose in the axes of the first, metres: x right, y down, z forward.
    """

    poses: int
    length: float
    duration: float | None
    end: Array

    @property
    def speed(self) -> float | None:
        """Mean speed, m/s; None without a duration."""
        return self.length / self.duration if self.duration else None

    def to_dict(self) -> dict[str, Any]:
        """The facts for JSON."""
        return {
            "poses": self.poses,
            "length_m": self.length,
            "duration_s": self.duration,
            "mean_speed_m_s": self.speed,
            "end_m": self.end.tolist(),
        }


def path_facts(poses: Array, times: Array | None) -> PathFacts:
    """Facts about a path (N, 4, 4) with times (N,), seconds, or None."""
    return PathFacts(
        poses=len(poses),
        length=float(trajectory_distances(poses)[-1]),
        duration=None if times is None else float(times[-1] - times[0]),
        end=np.asarray(np.linalg.inv(poses[0]) @ poses[-1])[:3, 3],
    )


def unusual_axis(poses: Array) -> str:
    """The own axis, such as "+x", along which a path (N, 4, 4) moves, if a camera would rarely move along it.

    A camera in a vehicle looks ahead, so from pose to pose it moves along its own +z axis. The result is ""
    for a path whose mean direction is nearer to that axis than `CAMERA_CONE_DEG`. A path that moves to and
    fro has no mean direction: there the line counts along which it moves, and the axis has no sign. The
    result is also "" for a path that moves in all directions, or not at all.
    """
    directions = _directions(poses)
    if len(directions) == 0:
        return ""
    mean = directions.mean(axis=0)
    length = float(np.linalg.norm(mean))
    camera_cone = np.cos(np.radians(CAMERA_CONE_DEG))
    if length > ONE_DIRECTION:
        if mean[2] / length > camera_cone:
            return ""
        sizes = np.array([abs(mean[0]), abs(mean[1]), max(-mean[2], 0.0)])  # +z is not the unusual one
        axis = int(np.argmax(sizes))
        sign = "-" if mean[axis] < 0 else "+"
        return sign + AXES[axis]
    # The eigenvectors are lines; the last one has the largest share of the squared directions.
    shares, lines = np.linalg.eigh(directions.T @ directions / len(directions))
    line = np.abs(lines[:, -1])
    if shares[-1] < ONE_LINE or line[2] > camera_cone:
        return ""
    return "x" if line[0] >= line[1] else "y"


def _directions(poses: Array) -> Array:
    """Unit vectors (M, 3) along which a path (N, 4, 4) moves from pose to pose, in each pose's own axes.

    They are the directions of the translations of inverse(T_i) T_i+1. Poses that hardly move have none.
    """
    steps = np.asarray(np.linalg.inv(poses[:-1]) @ poses[1:])[:, :3, 3]
    lengths = np.linalg.norm(steps, axis=1)
    if not lengths.sum() > 0:
        return np.zeros((0, 3))
    moving = lengths > MIN_MOVING_SHARE * _usual_step(lengths)
    return np.asarray(steps[moving] / lengths[moving, None])


@dataclass(frozen=True)
class Leaps:
    """Steps from pose to pose that no vehicle makes.

    Attributes
    ----------
    count : number of them.
    pose : number of the pose, from 0, at which the largest one ends.
    length : of the largest, metres.
    usual : median of the steps of the path that are not 0, metres.
    speed : of the largest, m/s, or None without times.
    """

    count: int
    pose: int
    length: float
    usual: float
    speed: float | None


def leaps(poses: Array, times: Array | None) -> Leaps | None:
    """The leaps of a path (N, 4, 4) with times (N,), seconds, or None; None for a path without leaps.

    A leap is too fast: faster than `MAX_SPEED` (without times, longer than `MAX_STEP`), or faster than
    `SCALELESS_LEAP_RATIO` times the speed that nine tenths of the steps stay below. It is also `LEAP_RATIO`
    times as long, and as fast, as the median of the steps that are not 0.
    """
    steps = np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1)
    if not steps.any():
        return None
    if times is None:
        speeds = steps  # in metres from pose to pose
        limit = MAX_STEP
    else:
        speeds = steps / np.diff(times)
        limit = MAX_SPEED
    median_step = float(np.median(steps[steps > 0]))
    median_speed = float(np.median(speeds[speeds > 0]))
    high_speed = float(np.quantile(speeds, 0.9))
    too_fast = speeds > limit
    if high_speed > 0:
        too_fast |= speeds > SCALELESS_LEAP_RATIO * high_speed
    stands_out = (steps > LEAP_RATIO * median_step) & (speeds > LEAP_RATIO * median_speed)
    found = np.flatnonzero(too_fast & stands_out)
    if not len(found):
        return None
    largest = int(found[np.argmax(steps[found])])
    return Leaps(
        count=len(found),
        pose=largest + 1,
        length=float(steps[largest]),
        usual=median_step,
        speed=None if times is None else float(speeds[largest]),
    )


def usual_speed(poses: Array, times: Array) -> float:
    """Median speed, m/s, of a path (N, 4, 4) with times (N,), seconds, without its standstills."""
    speeds = np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1) / np.diff(times)
    return float(np.median(speeds[speeds > 0])) if speeds.any() else 0.0


def probably_inverted(poses: Array) -> bool:
    """Whether only the inverses of poses (N, 4, 4) move along their own +z axis, as a camera does.

    Poses that move straight along their -z axis tell nothing: the camera may have moved backwards.
    """
    as_given = _mean_forward(poses)
    inverted = _mean_forward(np.asarray(np.linalg.inv(poses)))
    return -FORWARD < as_given < NOT_FORWARD and inverted > FORWARD


def _mean_forward(poses: Array) -> float:
    """Mean z component, in [-1, 1], of the directions in which a path (N, 4, 4) moves; 0 without motion."""
    directions = _directions(poses)
    return float(np.mean(directions[:, 2])) if len(directions) else 0.0


def _usual_step(lengths: Array) -> float:
    """The usual length of a step, from the lengths (M,) of all steps.

    The steps that are at least as long make up half of the path. Unlike the median, it is not 0 after a long
    standstill. A leap does not change it much either, unless it is half of the path.
    """
    descending = np.sort(lengths)[::-1]
    length_so_far = np.cumsum(descending)
    return float(descending[np.searchsorted(length_so_far, 0.5 * length_so_far[-1])])


@dataclass(frozen=True)
class PathDifference:
    """How far two paths are apart at the same frames, when both start at the same pose; metres.

    Attributes
    ----------
    end, largest, rmse : distance at the last frame, largest distance, root of the mean squared distance.
    """

    end: float
    largest: float
    rmse: float

    def to_dict(self) -> dict[str, Any]:
        """The distances for JSON."""
        return {"end_m": self.end, "max_m": self.largest, "rmse_m": self.rmse}


def path_difference(poses: Array, others: Array) -> PathDifference:
    """The distances between the positions of two paths (N, 4, 4) after a common start.

    Raises `DataError` if the paths differ in length, have no poses, or if a pose is not finite.
    """
    moved, _ = align(poses, others, Alignment.ORIGIN)
    distance = np.linalg.norm(moved[:, :3, 3] - poses[:, :3, 3], axis=1)
    return PathDifference(
        end=float(distance[-1]),
        largest=float(distance.max()),
        rmse=rmse(distance) or 0.0,  # never None: `align` refuses paths without poses
    )


def path_differences(paths: Mapping[str, Array]) -> dict[tuple[str, str], PathDifference]:
    """The distances of each pair of named paths (N, 4, 4), by their names."""
    pairs_of_names = combinations(paths, 2)
    return {(first, second): path_difference(paths[first], paths[second]) for first, second in pairs_of_names}
