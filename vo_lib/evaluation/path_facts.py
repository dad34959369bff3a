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
