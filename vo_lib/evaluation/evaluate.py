"""Errors of trajectories: KITTI's errors over sub-sequences, ATE and RPE."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

from ..errors import DataError
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
from .kitti import KITTI_LENGTHS, KITTI_STEP, KittiErrors, kitti_errors, trajectory_distances

ONE_FRAME = Delta()


@dataclass(frozen=True)
class SequenceResult:
    """All errors of one path with its name; `distance` is the length of the true path, metres."""

    name: str
    frames: int
    distance: float
    kitti: KittiErrors
    ate: AbsoluteError
    rpe: RelativeError


@dataclass(frozen=True)
class Evaluation:
    """Errors of several paths, with the lengths (metres) and the step (frames) of their sub-sequences."""

    sequences: tuple[SequenceResult, ...]
    lengths: tuple[float, ...]
    step: int

    def to_dict(self, key: str = "sequences") -> dict[str, Any]:
        """All results for JSON except the single sub-sequences; missing numbers are None.

        `key` : key of the list of paths in the result.
        """
        return {
            "lengths_m": list(self.lengths),
            "step_frames": self.step,
            key: [
                {"name": s.name, "frames": s.frames, "distance_m": s.distance}
                | s.kitti.to_tables(self.lengths)
                | {"ate": s.ate.to_dict(), "rpe": s.rpe.to_dict()}
                for s in self.sequences
            ],
        }


def evaluate(
    pairs: Iterable[tuple[str, Array, Array]],
    lengths: Sequence[float] = KITTI_LENGTHS,
    step: int = KITTI_STEP,
    alignment: Alignment = Alignment.SE3,
    times: Mapping[str, Array] = MappingProxyType({}),
    delta: Delta = ONE_FRAME,
) -> Evaluation:
    """KITTI errors, ATE and RPE of triples (name, truth, estimate) with poses (N, 4, 4).

    `times` : mapping from the name of a triple to the times (N,) of its frames, seconds; may be empty.
    `delta` : interval of the RPE.

    Raises
    ------
    DataError : if truth and estimate of a sequence differ in length, or an option is out of range.
    """
    results = []
    for name, truth, estimate in pairs:
        check_pair(truth, estimate, f"sequence {name}: ")
        path = trajectory_distances(truth)
        kitti = kitti_errors(truth, estimate, lengths, step, times.get(name))
        ate = absolute_error(truth, estimate, alignment)
        rpe = relative_error(truth, estimate, delta.size, path if delta.unit == "m" else None)
        results.append(SequenceResult(name, len(truth), float(path[-1]), kitti, ate, rpe))
    if not results:
        raise DataError("nothing to evaluate: expected at least one pair of truth and estimate")
    return Evaluation(tuple(results), tuple(map(float, lengths)), step)
