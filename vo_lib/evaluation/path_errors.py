"""Errors of trajectories: KITTI's errors over sub-sequences, ATE and RPE."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from ..geometry.types import Array, Index
from .ate_rpe import ONE_FRAME, AbsoluteError, Alignment, Delta, RelativeError, absolute_error, relative_error
from .kitti_errors import KITTI_PROTOCOL, KittiErrors, SubsequenceProtocol, frames_of_truth, kitti_errors
from .path_facts import doubt


@dataclass(frozen=True)
class PathErrors:
    """The errors `kitti` over the sub-sequences of a `protocol`, `ate` and `rpe` of a path with a name.

    doubt : what makes all of them doubtful, from `path_facts.doubt`; "" for nothing.
    """

    name: str
    protocol: SubsequenceProtocol
    kitti: KittiErrors
    ate: AbsoluteError
    rpe: RelativeError
    doubt: str

    def to_dict(self) -> dict[str, Any]:
        """All results for JSON except the single sub-sequences; missing numbers are None."""
        about = {"name": self.name, "frames": len(self.ate.distance), "warning": self.doubt}
        tables = self.protocol.to_dict() | self.kitti.to_tables(self.protocol.lengths)
        return about | tables | {"ate": self.ate.to_dict(), "rpe": self.rpe.to_dict()}


def evaluate(
    truth: Array,
    estimates: Mapping[str, Array],
    protocol: SubsequenceProtocol = KITTI_PROTOCOL,
    times: Array | None = None,
    alignment: Alignment = Alignment.SE3,
    delta: Delta = ONE_FRAME,
    frames: Index | None = None,
) -> list[PathErrors]:
    """KITTI errors, ATE and RPE of named estimates (M, 4, 4) of a true path (N, 4, 4).

    Parameters
    ----------
    protocol : how TE and RE are measured: the lengths and the starts of their sub-sequences.
    times : (N,) seconds, for speeds, or None.
    alignment : of the ATE. delta : interval of the RPE.
    frames : (M,) increasing numbers of the true poses to which the poses of all estimates belong, or None for
        all.

    Raises
    ------
    DataError : truth and an estimate differ in length, a pose is not finite, or a length or the step of the
        protocol is not positive.
    """
    results = list[PathErrors]()
    for name, poses in estimates.items():
        compared = frames_of_truth(truth, poses, frames, f"{name}: ")
        kitti = kitti_errors(truth, poses, protocol.lengths, protocol.step, times, compared)
        ate = absolute_error(truth[compared], poses, alignment)
        rpe = relative_error(truth, poses, delta, compared)
        results.append(PathErrors(name, protocol, kitti, ate, rpe, doubt(truth[compared], poses)))
    return results
