"""Exercises of chapter 8: one's own stages, the drift at the end, TE and RE, better than published."""

from __future__ import annotations

import numpy as np

from vo_lib.core.errors import DataError
from vo_lib.core.geometry import inverse
from vo_lib.core.types import Array
from vo_lib.data.sequence import Sequence
from vo_lib.evaluation.kitti import kitti_errors

from ..ch00.exercises import way
from ..checker import Exercise


def drift_of(poses: Array, sequence: Sequence) -> float:
    """How far the last pose is from the true one, in % of the true path."""
    path = way(sequence)  # asks for the truth
    assert sequence.truth is not None
    end = (inverse(sequence.truth[0]) @ sequence.truth[-1])[:3, 3]
    return 100.0 * float(np.linalg.norm((np.linalg.inv(poses[0]) @ poses[-1])[:3, 3] - end)) / path


def measured(
    poses: Array, sequence: Sequence, lengths: tuple[float, ...] = (20.0,), step: int = 1
) -> tuple[float, float]:
    """TE in % and RE in deg/100 m of poses (N, 4, 4)."""
    if sequence.truth is None:
        raise DataError(f"{sequence.name} has no truth; take a drawn sequence")
    found = kitti_errors(sequence.truth, poses, lengths, step)
    return float(found.te or np.nan), float(found.re or np.nan)


all_yours = Exercise("ch08.all_yours", {"borrowed": 0.0})

drift = Exercise("ch08.drift", drift_of, rtol=0.01)

te_and_re = Exercise("ch08.te_and_re", measured, parts=("te", "re"), atol=5e-3)

better = Exercise("ch08.better", {"RE": 0.1, "RE published": 0.5})
