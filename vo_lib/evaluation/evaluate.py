"""All errors of trajectories: KITTI's over sub-sequences, with ATE and RPE beside them."""

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
    RelativeError,
    absolute_error,
    check_pair,
    relative_error,
)
from .kitti import KITTI_LENGTHS, KITTI_STEP, KittiErrors, kitti_errors, trajectory_distances


@dataclass(frozen=True)
class SequenceResult:
    """All errors of a path by its name; `distance` is the length of the true path, metres."""

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
        """Everything but the single sub-sequences, for JSON: no NaN, None where there is no number.

        `key` : what the names are of.
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
) -> Evaluation:
    """KITTI errors, ATE and RPE of (name, truth, estimate) triples, poses (N, 4, 4) each.

    `times` : (N,) seconds of the frames of each name, where they are known.

    Raises
    ------
    DataError : truth and estimate of a sequence differ in length, or an option is out of range.
    """
    results = []
    for name, truth, estimate in pairs:
        check_pair(truth, estimate, f"sequence {name}: ")
        distance = float(trajectory_distances(truth)[-1])
        kitti = kitti_errors(truth, estimate, lengths, step, times.get(name))
        ate, rpe = absolute_error(truth, estimate, alignment), relative_error(truth, estimate)
        results.append(SequenceResult(name, len(truth), distance, kitti, ate, rpe))
    if not results:
        raise DataError("nothing to evaluate: expected at least one truth and estimate")
    return Evaluation(tuple(results), tuple(map(float, lengths)), step)
