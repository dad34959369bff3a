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

MOVES = 0.1  # a step counts as motion if it is longer than this share of a usual step
ONE_WAY = 0.3  # length of the mean of unit vectors from which on they have a common direction
ONE_LINE = 0.6  # share of their squares along one line from which on they have a common line
MAX_SPEED = 100.0  # m/s; no vehicle of a test drive is faster
MAX_STEP = 10.0  # metres from pose to pose without times: that speed at ten frames a second
LEAP_RATIO = 5.0  # of a leap to the path's own median step and speed
SCALELESS_LEAP_RATIO = 30.0  # to nine tenths of the speeds, for a path in a small unit or without scale
FORWARD = 0.9  # mean z component of unit vectors from which on a path clearly moves along +z
NOT_FORWARD = 0.5  # and below which it clearly does not
CAMERA_CONE_DEG = 45.0  # a camera that drives forward moves nearer than this to its z axis


@dataclass(frozen=True, eq=False)
class PathFacts:
    """Facts about one path.

    Attributes
    ----------
    poses : number of poses; length : of the path, metres.
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

    A camera in a vehicle looks ahead, so from pose to pose it moves along its own z axis. Empty for a path of
    which the mean direction of motion, the mean of the unit vectors of inverse(T_i) T_i+1, is nearer to +z
    than `CAMERA_CONE_DEG`. A path that moves to and fro has no mean direction: then the line counts along
    which it moves, and its axis is named without a sign. Empty as well for a path that moves in all
    directions, or not at all.
    """
    steps = np.asarray(np.linalg.inv(poses[:-1]) @ poses[1:])[:, :3, 3]
    lengths = np.linalg.norm(steps, axis=1)
    if not lengths.sum() > 0:
        return ""
    moving = lengths > MOVES * _usual_step(lengths)
    directions = steps[moving] / lengths[moving, None]
    mean = directions.mean(axis=0)
    length = float(np.linalg.norm(mean))
    nearest_to_z = np.cos(np.radians(CAMERA_CONE_DEG))
    if length > ONE_WAY:
        forward = mean[2] / length
        if forward > nearest_to_z:
            return ""
        sizes = np.array([abs(mean[0]), abs(mean[1]), max(-mean[2], 0.0)])  # +z is not the unusual one
        axis = int(np.argmax(sizes))
        return f"{'-' if mean[axis] < 0 else '+'}{'xyz'[axis]}"
    shares, lines = np.linalg.eigh(directions.T @ directions / len(directions))
    line = np.abs(lines[:, -1])  # along which the directions have the largest share
    if shares[-1] < ONE_LINE or line[2] > nearest_to_z:
        return ""
    return "xy"[int(np.argmax(line[:2]))]


@dataclass(frozen=True)
class Leaps:
    """Steps from pose to pose that no vehicle makes.

    Attributes
    ----------
    count : number of them. pose : number of the pose, from 0, at which the largest one ends.
    length : of the largest, metres. usual : median step of the path, metres.
    speed : of the largest, m/s, or None without times.
    """

    count: int
    pose: int
    length: float
    usual: float
    speed: float | None


def leaps(poses: Array, times: Array | None) -> Leaps | None:
    """The leaps of a path (N, 4, 4) with times (N,), seconds, or None; None for a path without leaps.

    A leap is `LEAP_RATIO` times as long and as fast as the median of the steps that are not 0, and faster
    than `MAX_SPEED` (without times, longer than `MAX_STEP`), or `SCALELESS_LEAP_RATIO` times as fast as nine
    tenths of the steps.
    """
    steps = np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1)
    if not steps.any():
        return None
    rates = steps if times is None else steps / np.diff(times)
    limit = MAX_STEP if times is None else MAX_SPEED
    usual = float(np.median(steps[steps > 0]))
    usual_rate = float(np.median(rates[rates > 0]))
    most = float(np.quantile(rates, 0.9))
    too_fast = (rates > limit) | ((rates > SCALELESS_LEAP_RATIO * most) & (most > 0))
    found = np.flatnonzero(too_fast & (steps > LEAP_RATIO * usual) & (rates > LEAP_RATIO * usual_rate))
    if not len(found):
        return None
    largest = int(found[np.argmax(steps[found])])
    speed = None if times is None else float(rates[largest])
    return Leaps(len(found), largest + 1, float(steps[largest]), usual, speed)


def usual_speed(poses: Array, times: Array) -> float:
    """Median speed, m/s, of the steps of a path (N, 4, 4) with times (N,), seconds, that are not 0."""
    rates = np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1) / np.diff(times)
    return float(np.median(rates[rates > 0])) if rates.any() else 0.0


def probably_inverted(poses: Array) -> bool:
    """Whether only the inverses of poses (N, 4, 4) move along their own +z axis, as a camera does.

    Poses that move along -z, and so straight, tell nothing: the camera may have moved backwards.
    """
    forward = _forward_share(poses)
    return -FORWARD < forward < NOT_FORWARD and _forward_share(np.asarray(np.linalg.inv(poses))) > FORWARD


def _forward_share(poses: Array) -> float:
    """Mean z component of the unit vectors of inverse(T_i) T_i+1 of the moving poses; 0 without motion."""
    steps = np.asarray(np.linalg.inv(poses[:-1]) @ poses[1:])[:, :3, 3]
    lengths = np.linalg.norm(steps, axis=1)
    if not lengths.sum() > 0:
        return 0.0
    moving = lengths > MOVES * _usual_step(lengths)
    return float(np.mean(steps[moving, 2] / lengths[moving]))


def _usual_step(lengths: Array) -> float:
    """The length of a step of which the longer ones, and it, are half of a path, from all lengths (M,).

    Neither a long standstill nor a leap that is shorter than half of the path makes it useless.
    """
    descending = np.sort(lengths)[::-1]
    total = np.cumsum(descending)
    return float(descending[np.searchsorted(total, 0.5 * total[-1])])


@dataclass(frozen=True)
class PathDifference:
    """How far two paths are apart at the same frames, when both start at the same pose; metres.

    Attributes
    ----------
    first, second : names of the paths.
    end, largest, rmse : distance at the last frame, largest distance, root of the mean squared distance.
    """

    first: str
    second: str
    end: float
    largest: float
    rmse: float

    def to_dict(self) -> dict[str, Any]:
        """The distances for JSON."""
        return {
            "paths": [self.first, self.second],
            "end_m": self.end,
            "max_m": self.largest,
            "rmse_m": self.rmse,
        }


def path_difference(first: str, poses: Array, second: str, others: Array) -> PathDifference:
    """The distances between the positions of two named paths (N, 4, 4) after a common start.

    Raises `DataError` unless both have the same number of finite poses.
    """
    moved, _ = align(poses, others, Alignment.ORIGIN)
    distance = np.linalg.norm(moved[:, :3, 3] - poses[:, :3, 3], axis=1)
    return PathDifference(
        first, second, float(distance[-1]), float(distance.max()), float(rmse(distance) or 0.0)
    )


def path_differences(paths: Mapping[str, Array]) -> list[PathDifference]:
    """The distances of each pair of named paths (N, 4, 4)."""
    return [
        path_difference(first, paths[first], second, paths[second])
        for first, second in combinations(paths, 2)
    ]
