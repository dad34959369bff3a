"""Errors of trajectories: KITTI's errors over sub-sequences, ATE and RPE."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..geometry.types import Array, Index
from .ate_rpe import (
    AbsoluteError,
    Alignment,
    Delta,
    RelativeError,
    absolute_error,
    check_pair,
    inverses_agree,
    mirrored_axis,
    orientations_disagree,
    quaternions_disagree,
    relative_error,
)
from .kitti_errors import (
    FEW_SUBSEQUENCES,
    KITTI_PROTOCOL,
    KittiErrors,
    SubsequenceProtocol,
    is_as_kitti,
    kitti_errors,
    trajectory_distances,
)

ONE_FRAME = Delta()


@dataclass(frozen=True)
class PathErrors:
    """All errors of one path.

    Attributes
    ----------
    name : name of the path.
    frames : number of compared poses.
    distance : length of the true path from the first to the last compared pose, metres.
    length_ratio : length of the estimated path divided by that of the true path over the compared poses; None
        if the truth does not move.
    kitti, ate, rpe : the errors.
    other_orientations : whether the orientations have another convention than those of the truth.
    other_quaternions : whether the quaternions of the path or of the truth were read in another order.
    mirrored : the axis of which the path or the truth has the sign reversed, or "".
    inverted : whether the path and the truth agree far better if the poses of one of them are inverted.
    """

    name: str
    frames: int
    distance: float
    length_ratio: float | None
    kitti: KittiErrors
    ate: AbsoluteError
    rpe: RelativeError
    other_orientations: bool
    other_quaternions: bool
    inverted: bool
    mirrored: str


@dataclass(frozen=True)
class Evaluation:
    """Errors of several paths over the same frames.

    Attributes
    ----------
    paths : the errors of each path.
    measure : the sub-sequences of TE and RE.
    whole_truth : whether the truth is that of a whole sequence, and every true pose is compared.
    frame_step : usual number of frames of the truth from one compared pose to the next.
    """

    paths: tuple[PathErrors, ...]
    measure: SubsequenceProtocol
    whole_truth: bool
    frame_step: int

    @property
    def subsequences(self) -> int:
        """Number of sub-sequences, equal for all paths."""
        return len(self.paths[0].kitti) if self.paths else 0

    @property
    def as_kitti(self) -> bool:
        """Whether TE and RE are those of KITTI's benchmark."""
        return is_as_kitti(self.measure, self.subsequences, self.whole_truth)

    def to_dict(self, key: str = "sequences") -> dict[str, Any]:
        """All results for JSON except the single sub-sequences; missing numbers are None.

        `key` : key of the list of paths in the result.
        """
        lengths = self.measure.lengths
        return {
            "lengths_m": list(lengths),
            "step_frames": self.measure.step,
            "subsequences": self.subsequences,
            "few_subsequences": self.subsequences < FEW_SUBSEQUENCES,
            "whole_truth": self.whole_truth,
            "as_kitti": self.as_kitti,
            key: [
                {"name": path.name, "frames": path.frames, "distance_m": path.distance}
                | {"length_ratio": path.length_ratio}
                | path.kitti.to_tables(lengths)
                | {"ate": path.ate.to_dict(), "rpe": path.rpe.to_dict()}
                | {"other_orientations": path.other_orientations}
                | {"other_quaternions": path.other_quaternions}
                | {"inverted": path.inverted}
                | {"mirrored_axis": path.mirrored or None}
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
    *,
    frames: Index | None = None,
    is_part: bool = False,
) -> Evaluation:
    """KITTI errors, ATE and RPE of named estimates (M, 4, 4) of a true path (N, 4, 4).

    `times` : (N,) seconds, for speeds, or None. `delta` : interval of the RPE. `frames` : (M,) increasing
    numbers of the true poses to which the poses of all estimates belong, or None for all. `is_part` : whether
    the truth is only a part of that of a sequence.

    Raises
    ------
    DataError : if truth and an estimate differ in length, or an option is out of range.
    """
    path = trajectory_distances(truth)
    compared = np.arange(len(truth)) if frames is None else frames
    by_length = path if delta.unit == "m" else None
    results = list[PathErrors]()
    for name, estimate in estimates.items():
        check_pair(truth[compared], estimate, f"{name}: ")
        results.append(
            PathErrors(
                name=name,
                frames=len(compared),
                distance=float(path[compared[-1]] - path[compared[0]]),
                length_ratio=_length_ratio(truth[compared], estimate),
                kitti=kitti_errors(truth, estimate, measure.lengths, measure.step, times, compared),
                ate=absolute_error(truth[compared], estimate, alignment),
                rpe=relative_error(truth, estimate, delta.size, by_length, compared),
                other_orientations=orientations_disagree(truth[compared], estimate),
                other_quaternions=quaternions_disagree(truth[compared], estimate),
                mirrored=mirrored_axis(truth[compared], estimate),
                inverted=inverses_agree(truth[compared], estimate),
            )
        )
    return Evaluation(
        paths=tuple(results),
        measure=measure,
        whole_truth=not is_part and len(compared) == len(truth),
        frame_step=int(np.median(np.diff(compared))) if len(compared) > 1 else 1,
    )


def _length_ratio(truth: Array, estimate: Array) -> float | None:
    """Length of an estimated path (M, 4, 4) divided by that of the true path (M, 4, 4)."""
    true_length = float(trajectory_distances(truth)[-1])
    return float(trajectory_distances(estimate)[-1]) / true_length if true_length > 0 else None
