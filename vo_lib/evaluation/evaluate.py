"""All errors of trajectories: KITTI's over sub-sequences, with ATE and RPE beside them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np

from ..core.errors import DataError
from ..core.rows import joined
from ..core.types import Array
from .ate_rpe import AbsoluteError, Alignment, RelativeError, absolute_error, check_pair, relative_error
from .axes import TurnedErrors, fit_axes
from .kitti import KITTI_LENGTHS, KITTI_STEP, KittiErrors, kitti_errors, trajectory_distances


@dataclass(frozen=True)
class SequenceResult:
    """All errors of one sequence; `distance` is the length of its true path, metres.

    `turned` : KITTI's with the axes turned, where that was asked for.
    """

    name: str
    frames: int
    distance: float
    kitti: KittiErrors
    ate: AbsoluteError
    rpe: RelativeError
    turned: TurnedErrors | None = None


@dataclass(frozen=True)
class Evaluation:
    """Errors of several sequences, with the lengths (metres) and the step (frames) they were made with."""

    sequences: tuple[SequenceResult, ...]
    lengths: tuple[float, ...]
    step: int

    @property
    def pooled(self) -> KittiErrors:
        """All sub-sequences of all sequences: long sequences count more."""
        return joined(sequence.kitti for sequence in self.sequences)

    def mean(self) -> dict[str, Any]:
        """Plain mean over the sequences that have sub-sequences: each counts the same."""
        counted = [s for s in self.sequences if len(s.kitti)]
        errors = np.array([(s.kitti.te, s.kitti.re) for s in counted], float)
        te, re = errors.mean(axis=0).tolist() if counted else (None, None)
        return {"sequences": [s.name for s in counted], "te_percent": te, "re_deg_per_100m": re}

    def to_dict(self) -> dict[str, Any]:
        """Everything but the single sub-sequences, for JSON: no NaN, None where there is no number."""
        return {
            "lengths_m": list(self.lengths),
            "step_frames": self.step,
            "sequences": [
                {"name": s.name, "frames": s.frames, "distance_m": s.distance}
                | s.kitti.to_tables(self.lengths)
                | {"ate": s.ate.to_dict(), "rpe": s.rpe.to_dict()}
                | ({"axes": s.turned.to_dict()} if s.turned else {})
                for s in self.sequences
            ],
            "pooled": self.pooled.to_tables(self.lengths),
            "mean": self.mean(),
        }


def evaluate(
    pairs: Iterable[tuple[str, Array, Array]],
    lengths: Sequence[float] = KITTI_LENGTHS,
    step: int = KITTI_STEP,
    alignment: Alignment = Alignment.SE3,
    times: Mapping[str, Array] = MappingProxyType({}),
    axes: bool = False,
) -> Evaluation:
    """KITTI errors, ATE and RPE of (name, truth, estimate) triples, poses (N, 4, 4) each.

    `times` : (N,) seconds of the frames of each name, where they are known. `axes` : KITTI errors with the
    axes turned, too.

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
        turned = fit_axes(truth, estimate, lengths, step) if axes else None
        results.append(SequenceResult(name, len(truth), distance, kitti, ate, rpe, turned))
    if not results:
        raise DataError("nothing to evaluate: expected at least one truth and estimate")
    return Evaluation(tuple(results), tuple(map(float, lengths)), step)
