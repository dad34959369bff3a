"""Errors of trajectories: KITTI's errors over sub-sequences, ATE and RPE."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..geometry.types import Array, Index
from .ate_rpe import (
    ONE_FRAME,
    AbsoluteError,
    Alignment,
    Delta,
    RelativeError,
    absolute_error,
    check_pair,
    relative_error,
)
from .conventions import inverses_agree, mirrored_axis, orientations_disagree, quaternions_disagree
from .kitti_errors import (
    FEW_SUBSEQUENCES,
    KITTI_PROTOCOL,
    KittiErrors,
    SubsequenceProtocol,
    is_as_kitti,
    kitti_errors,
    trajectory_distances,
)


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
    other_orientations, other_quaternions, inverted, mirrored : whether the path or the truth has another
        convention: `orientations_disagree`, `quaternions_disagree`, `inverses_agree`, `mirrored_axis`;
        `mirrored` is the axis, "" for none.
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

    def to_dict(self, lengths: Sequence[float]) -> dict[str, Any]:
        """All results for JSON except the single sub-sequences; `lengths`, metres, are those of TE and RE."""
        return {
            "name": self.name,
            "frames": self.frames,
            "distance_m": self.distance,
            "length_ratio": self.length_ratio,
            **self.kitti.to_tables(lengths),
            "ate": self.ate.to_dict(),
            "rpe": self.rpe.to_dict(),
            "other_orientations": self.other_orientations,
            "other_quaternions": self.other_quaternions,
            "inverted": self.inverted,
            "mirrored_axis": self.mirrored or None,
        }


@dataclass(frozen=True)
class Evaluation:
    """Errors of several paths over the same frames.

    Attributes
    ----------
    paths : the errors of each path.
    protocol : how TE and RE are measured: the lengths and the starts of their sub-sequences.
    whole_truth : whether the truth is that of a whole sequence, and every true pose is compared.
    frame_step : usual number of frames of the truth from one compared pose to the next.
    """

    paths: tuple[PathErrors, ...]
    protocol: SubsequenceProtocol
    whole_truth: bool
    frame_step: int

    @property
    def subsequences(self) -> int:
        """Number of sub-sequences, equal for all paths."""
        return len(self.paths[0].kitti) if self.paths else 0

    @property
    def as_kitti(self) -> bool:
        """Whether TE and RE are those of KITTI's benchmark."""
        return is_as_kitti(self.protocol, self.subsequences, self.whole_truth)

    def to_dict(self, key: str = "sequences") -> dict[str, Any]:
        """All results for JSON except the single sub-sequences; missing numbers are None.

        `key` : key of the list of paths in the result.
        """
        return {
            "lengths_m": list(self.protocol.lengths),
            "step_frames": self.protocol.step,
            "subsequences": self.subsequences,
            "few_subsequences": self.subsequences < FEW_SUBSEQUENCES,
            "whole_truth": self.whole_truth,
            "as_kitti": self.as_kitti,
            key: [path.to_dict(self.protocol.lengths) for path in self.paths],
        }


def evaluate(
    truth: Array,
    estimates: Mapping[str, Array],
    protocol: SubsequenceProtocol = KITTI_PROTOCOL,
    times: Array | None = None,
    alignment: Alignment = Alignment.SE3,
    delta: Delta = ONE_FRAME,
    *,
    frames: Index | None = None,
    is_part: bool = False,
) -> Evaluation:
    """KITTI errors, ATE and RPE of named estimates (M, 4, 4) of a true path (N, 4, 4).

    Parameters
    ----------
    protocol : how TE and RE are measured: the lengths and the starts of their sub-sequences.
    times : (N,) seconds, for speeds, or None.
    alignment : of the ATE. delta : interval of the RPE.
    frames : (M,) increasing numbers of the true poses to which the poses of all estimates belong, or None for
        all.
    is_part : whether the truth is only a part of that of a sequence.

    Raises
    ------
    DataError : truth and an estimate differ in length, a pose is not finite, or a length or the step of the
        protocol is not positive.
    """
    distances = trajectory_distances(truth)
    compared = np.arange(len(truth)) if frames is None else frames
    true_poses = truth[compared]
    results = list[PathErrors]()
    for name, estimate in estimates.items():
        check_pair(true_poses, estimate, f"{name}: ")
        results.append(
            PathErrors(
                name=name,
                frames=len(compared),
                distance=float(distances[compared[-1]] - distances[compared[0]]),
                length_ratio=_length_ratio(true_poses, estimate),
                kitti=kitti_errors(truth, estimate, protocol.lengths, protocol.step, times, compared),
                ate=absolute_error(true_poses, estimate, alignment),
                rpe=relative_error(truth, estimate, delta, distances, compared),
                other_orientations=orientations_disagree(true_poses, estimate),
                other_quaternions=quaternions_disagree(true_poses, estimate),
                inverted=inverses_agree(true_poses, estimate),
                mirrored=mirrored_axis(true_poses, estimate),
            )
        )
    return Evaluation(
        paths=tuple(results),
        protocol=protocol,
        whole_truth=not is_part and len(compared) == len(truth),
        frame_step=int(np.median(np.diff(compared))) if len(compared) > 1 else 1,
    )


def _length_ratio(truth: Array, estimate: Array) -> float | None:
    """Length of an estimated path (M, 4, 4) divided by that of the true path (M, 4, 4), which may be 0."""
    true_length = float(trajectory_distances(truth)[-1])
    return float(trajectory_distances(estimate)[-1]) / true_length if true_length > 0 else None
