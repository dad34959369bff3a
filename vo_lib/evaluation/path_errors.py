"""Errors of trajectories: KITTI's errors over sub-sequences, ATE and RPE."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from ..geometry.types import Array
from .ate_rpe import (
    AbsoluteError,
    Alignment,
    Delta,
    RelativeError,
    absolute_error,
    check_pair,
    relative_error,
)
from .kitti_errors import KITTI_PROTOCOL, KittiErrors, SubsequenceProtocol, kitti_errors, trajectory_distances

ONE_FRAME = Delta()


@dataclass(frozen=True)
class PathErrors:
    """All errors of one path with its name; `distance` is the length of the true path, metres."""

    name: str
    frames: int
    distance: float
    kitti: KittiErrors
    ate: AbsoluteError
    rpe: RelativeError


@dataclass(frozen=True)
class Evaluation:
    """Errors of several paths over the same frames, with the measure of TE and RE."""

    paths: tuple[PathErrors, ...]
    measure: SubsequenceProtocol

    def to_dict(self, key: str = "sequences") -> dict[str, Any]:
        """All results for JSON except the single sub-sequences; missing numbers are None.

        `key` : key of the list of paths in the result.
        """
        lengths = self.measure.lengths
        return {
            "lengths_m": list(lengths),
            "step_frames": self.measure.step,
            key: [
                {"name": path.name, "frames": path.frames, "distance_m": path.distance}
                | path.kitti.to_tables(lengths)
                | {"ate": path.ate.to_dict(), "rpe": path.rpe.to_dict()}
                for path in self.paths
            ],
        }


def evaluate(
    truth: Array,
    estimates: Mapping[str, Array],
    measure: SubsequenceProtocol = KITTI_PROTOCOL,
    times: Array | None = None,
    alignment: Alignment = Alignment.SE3,
    delta: Delta = ONE_FRAME,
) -> Evaluation:
    """KITTI errors, ATE and RPE of named estimates (N, 4, 4) of a true path (N, 4, 4).

    `times` : (N,) seconds, for speeds, or None. `delta` : interval of the RPE.

    Raises
    ------
    DataError : if truth and an estimate differ in length, or an option is out of range.
    """
    path, results = trajectory_distances(truth), []
    for name, estimate in estimates.items():
        check_pair(truth, estimate, f"{name}: ")
        kitti = kitti_errors(truth, estimate, measure.lengths, measure.step, times)
        ate = absolute_error(truth, estimate, alignment)
        rpe = relative_error(truth, estimate, delta.size, path if delta.unit == "m" else None)
        results.append(PathErrors(name, len(truth), float(path[-1]), kitti, ate, rpe))
    return Evaluation(tuple(results), measure)
