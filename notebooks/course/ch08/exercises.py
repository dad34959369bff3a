"""Exercises of chapter 8: the student's stages, the drift at the end, TE and RE, better than published."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from vo_lib import preset
from vo_lib.data.sequence import Sequence
from vo_lib.evaluation.kitti_errors import kitti_errors
from vo_lib.geometry.types import Array
from vo_lib.runs.drive import run_methods, single_threaded
from vo_lib.runs.match_cache import CachedMatches

from ..ch00.exercises import beeline, length_of
from ..checker import NO_ANSWER, Exercise, raise_if_strict
from ..frames import why_missing
from ..results import Verdict, as_array, result_of, why_unusable
from ..stored_answers import library_call_in

SEEDS = (0, 1, 2)


def end_error(poses: Array, sequence: Sequence) -> float:
    """Distance of the last position from the true last position, metres, after aligning the first poses."""
    return float(np.linalg.norm(_end(poses) - _end(sequence.true_poses)))


def _end(poses: Array) -> Array:
    """The last position (3,) in the axes of the first pose, metres."""
    return np.asarray((np.linalg.inv(poses[0]) @ poses[-1])[:3, 3])


def drift_of(poses: Array, sequence: Sequence) -> float:
    """Distance of the last position from the true last position, in % of the length of the true path."""
    return 100.0 * end_error(poses, sequence) / length_of(sequence.true_poses)


def measured(poses: Array, sequence: Sequence, lengths: tuple[float, ...] = (10.0,), step: int = 2) -> Array:
    """TE in % and RE in deg/100 m, (2,), of poses (N, 4, 4).

    lengths : of the sub-sequences, metres. step : frames from the start of one to the start of the next.
    """
    return _errors(sequence.true_poses, poses, lengths, step)


def _errors(truth: Array, poses: Array, lengths: tuple[float, ...], step: int) -> Array:
    """TE in % and RE in deg/100 m, (2,); NaN if no sub-sequence fits into the path."""
    errors = kitti_errors(truth, poses, lengths, step)
    return np.array([errors.te, errors.re], float)  # float makes NaN of None


def exchanged(poses: Array, sequence: Sequence) -> Array:
    """`measured` with the two paths exchanged: the pieces are then cut by the length of the estimate."""
    return _errors(poses, sequence.true_poses, (10.0,), 2)


all_yours = Exercise(
    {"borrowed": 0.0},
    praise="every stage of this odometry is yours.",
    mistakes={
        "stages that are still the library's: {borrowed:.0f}. The table above names the exercise of each: solve "
        "the exercises in their chapters, then run this notebook again.": lambda now: now["borrowed"] != 0
    },
)

drift = Exercise(
    drift_of,
    rtol=2e-3,
    praise="{right:.2f} % of the path. On a longer path the share is larger: a wrong heading displaces all later positions.",
    hint="estimates start at the identity, this truth does not: take the true motion from the first to the last pose. "
    "Divide the distance of the last positions by the length of the true path.",
    slips={"share": "this is a fraction: multiply by 100."},
    line="100 * np.linalg.norm(yours[-1][:3, 3] - true[:3, 3]) / trajectory_distances(street.truth)[-1]",
    mistakes={
        "{got:.3g} m is the distance; the answer is in % of the true path.": end_error,
        "the starts differ: the truth of this part does not begin at the identity.": lambda poses, sequence: (
            100 * np.linalg.norm((poses - sequence.true_poses)[-1, :3, 3]) / length_of(sequence.true_poses)
        ),
        "this is divided by the number of frames: a step is not a metre.": (
            lambda poses, sequence: 100 * end_error(poses, sequence) / len(poses),
            lambda poses, sequence: 100 * end_error(poses, sequence) / (len(poses) - 1),
        ),
        "this is divided by the straight distance from start to end: the road has a bend.": lambda poses, sequence: (
            100 * end_error(poses, sequence) / beeline(sequence.true_poses)
        ),
    },
)

te_and_re = Exercise(
    measured,
    parts=("te", "re"),
    atol=1e-6,  # with the paths exchanged, RE differs by a few millionths
    slips={"share": "TE is a fraction: multiply by 100.", "radians": "this is in radians; RE is in degrees."},
    praise="TE {right[0]:.3f} %, RE {right[1]:.3f} deg/100 m.",
    hint="call your own `all_errors` with one length and a step of two frames.",
    line="te_re = mine.all_errors(street.truth, yours, (10,), 2)",
    mistakes={
        "the paths are exchanged: the first is the truth, whose length cuts the pieces.": exchanged,
        "these sub-sequences start at other frames: the step is 2.": partial(measured, step=1),
        "these sub-sequences have other lengths than 10 m.": (
            partial(measured, lengths=(20.0,)),
            partial(measured, lengths=(20.0,), step=1),
        ),
    },
)

less_luck = Exercise(
    {"RE": 0.1, "RE published": 0.5},
    praise="RE {RE:.3f} against {RE published:.3f} deg/100 m, means over three seeds. A gain on the "
    "frames that were used to choose the setting proves nothing: try other frames.",
    mistakes={
        "RE is not a number: no sub-sequence of 20 m fits into this path.": lambda now: (
            not np.isfinite(now["RE"] + now["RE published"])
        ),
        "RE {RE:.0f} against {RE published:.3f} deg/100 m: this is not the path of the camera. Are the poses the "
        "chain of all motions, from the camera to the world (chapter 0)?": lambda now: (
            now["RE"] > 10 * now["RE published"]
        ),
        "RE {RE:.3f} deg/100 m is more than half of {RE published:.3f}. The winner fits only five noisy "
        "matches: refine it on its inliers (chapter 3).": lambda now: now["RE"] > 0.5 * now["RE published"],
    },
)


def better(drive: Any, sequence: Sequence) -> Verdict:
    """The verdict on `drive(sequence, matches, seed=…)`, run with `SEEDS` on a sequence without truth."""
    rotation_errors = _rotation_errors(drive, sequence)
    if isinstance(rotation_errors, Verdict):
        return raise_if_strict(rotation_errors)
    return less_luck(rotation_errors)


def _rotation_errors(drive: Any, sequence: Sequence) -> Verdict | dict[str, float]:
    """RE of a drive on the kit's matches, as in the notebook, and of the paper's method on its own matches.

    They are facts for `less_luck`. Instead of them, a verdict says why they cannot be measured.
    """
    if drive is ...:
        return NO_ANSWER
    if lacking := why_missing(sequence):
        return Verdict(False, lacking)
    if not callable(drive):
        return Verdict(False, f"expected your function `drive`, got {type(drive).__name__}.")
    if name := library_call_in(drive, ("run", "run_methods", "make_odometry")):
        return Verdict(False, f"this hands the work to `{name}`.", "change the loop of this chapter.")
    kit = preset("feature_selection", variant="kit")
    unseen = replace(sequence, truth=None)
    matches = list(CachedMatches(sequence, kit))
    with single_threaded():
        paths = [result_of(partial(drive, seed=seed), (unseen, matches)) for seed in SEEDS]
    for path in paths:
        poses = as_array(path)
        hint = "return poses (N, 4, 4), one per frame."
        if fault := why_unusable(poses, sequence.true_poses, "the path", hint):
            return fault
        R = poses[:, :3, :3]
        if not np.allclose(R @ R.transpose(0, 2, 1), np.eye(3), atol=1e-3):
            return Verdict(False, "in some poses, R (3, 3) is not a rotation, or is NaN.")
    configs = {str(seed): preset("feature_selection", variant="published", seed=seed) for seed in SEEDS}
    paper = [run.poses for run in run_methods(sequence, configs).values()]
    return {"RE": _mean_re(paths, sequence), "RE published": _mean_re(paper, sequence)}


def _mean_re(paths: list[Any], sequence: Sequence) -> float:
    """Mean RE of paths over 20 m, deg/100 m."""
    return float(np.mean([measured(np.asarray(path), sequence, (20.0,), 1)[1] for path in paths]))
