"""Exercises of chapter 6: end of a sub-sequence, its errors, all of them, a yaw error, two averages, RPE."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from vo_lib.core.types import Array
from vo_lib.evaluation.kitti import KITTI_LENGTHS, kitti_errors

from ..checker import Case, Exercise
from ..made_up import block_tour, made_up

YAW, LENGTH = 1.0, 400.0  # deg/100 m and metres, of the straight road
ANGLE = float(np.radians(YAW * LENGTH / 100.0))
TE = 100.0 * float(np.hypot(1.0 - np.sin(ANGLE) / ANGLE, (1.0 - np.cos(ANGLE)) / ANGLE))


def paths() -> list[Case]:
    """A path that stands still once, with starts and lengths; the last length is not reached."""
    path = np.array([0.0, 1.0, 2.0, 3.0, 3.0, 4.5, 6.0, 7.0])
    return [(path, *case) for case in ((0, 2.5), (0, 2.0), (2, 1.0), (1, 5.5), (3, 3.5), (4, 100.0))]


def end(path: Array, first: int, length: float) -> int | None:
    """The first frame farther than `length` from frame `first`, if there is one."""
    beyond = np.flatnonzero(path > path[first] + length)
    return int(beyond[0]) if len(beyond) else None


def judged_pair() -> tuple[Array, Array]:
    """A truth and an estimate (N, 4, 4) that are wrong in every way at once."""
    truth = block_tour(1)
    return truth, made_up(truth, scale=2.0, yaw=3.0, noise=20.0, jitter=0.1, seed=3)


def stretches() -> list[Case]:
    """Two sub-sequences of the pair: first and last frame, length."""
    return [(*judged_pair(), 20, 171, 150.0), (*judged_pair(), 150, 352, 200.0)]


def errors(truth: Array, estimate: Array, first: int, last: int, length: float) -> Array:
    """TE in % and RE in deg/100 m of a sub-sequence, (2,)."""
    motion, true_motion = (np.linalg.inv(T[first]) @ T[last] for T in (estimate, truth))
    return measured(np.linalg.inv(motion) @ true_motion, length)


def measured(error: Array, length: float) -> Array:
    """TE and RE (2,) of an error of motion."""
    angle = np.arccos(np.clip((np.trace(error[:3, :3]) - 1.0) / 2.0, -1.0, 1.0))
    return np.array([np.linalg.norm(error[:3, 3]), np.degrees(angle)]) * 100.0 / length


def te_re(mean: Callable[[Array, Array], Any], every: int | None = None) -> Callable[..., Any]:
    """TE and RE over all sub-sequences by a mean of (errors, lengths), from every so many frames."""

    def both(truth: Array, estimate: Array, lengths: Any, step: int) -> tuple[Any, Any]:
        found = kitti_errors(truth, estimate, lengths, every or step)
        return 100.0 * mean(found.t_err, found.length), 100.0 * np.degrees(mean(found.r_err, found.length))

    return both


def pooled(errors: list[Array]) -> float:
    """The mean of all errors."""
    return float(np.concatenate(errors).mean())


def plain(errors: list[Array]) -> float:
    """The mean of the sequences' means; one without errors has none."""
    return float(np.mean([each.mean() for each in errors if len(each)]))


end_frame = Exercise("ch06.end_frame", end, paths)

part_errors = Exercise("ch06.part_errors", errors, stretches, parts=("te", "re"), atol=1e-6)

yaw_on_a_straight = Exercise("ch06.yaw_on_a_straight", TE, rtol=0.03)

once_round = Exercise("ch06.once_round", 0.0, atol=0.02)

all_errors = Exercise(
    "ch06.all_errors",
    te_re(lambda each, length: each.mean()),
    lambda: [(*judged_pair(), KITTI_LENGTHS[:4], 10)],
    parts=("te", "re"),
    atol=5e-3,
)

averages = Exercise(
    "ch06.averages",
    lambda errors: (pooled(errors), plain(errors)),
    lambda: [([np.ones(4), np.array([3.0]), np.array([])],)],
    parts=("pooled", "plain"),
)

blind_rpe = Exercise("ch06.blind_rpe", {"RPE": 0.1, "TE": 3.0})
