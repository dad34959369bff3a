"""What can be said of a finished run: its errors, whether its path was lost, and warnings."""

from __future__ import annotations

import numpy as np

from ..evaluation.kitti_errors import KITTI_PROTOCOL, SHORT_PROTOCOL
from ..evaluation.path_errors import PathErrors, evaluate
from ..evaluation.path_facts import path_length
from ..geometry.result import MAX_MISSING_FRAMES, Flag
from .drive import Run
from .front_end import exchanged_cameras

LOG = "frames.csv"  # in the folder of a run: a row for each frame but the first; a warning names it

# Limits beyond which a run has a warning.
MAX_CONTRADICTED_SHARE = 0.1  # of the motions: with more of them, the path is probably wrong
USUAL_SHARE_MEASURED = 0.5  # of the motions: with fewer, the order of the cameras is checked
NOTHING_OR_ALL_REMOVED = ("0.0", "100.0")  # % of the features, as printed


def evaluate_run(result: Run) -> dict[str, PathErrors]:
    """Errors of a run, with speeds from the sequence's times; empty without ground truth.

    They are named after the sub-sequences: "kitti" has the benchmark's lengths and starts. For a path that is
    shorter than the longest of these lengths, there is also "short", with shorter ones.
    """
    sequence = result.sequence
    if sequence.truth is None:
        return {}
    protocols = {"kitti": KITTI_PROTOCOL}
    if path_length(sequence.truth) < KITTI_PROTOCOL.lengths[-1]:
        protocols["short"] = SHORT_PROTOCOL
    errors = {}
    for kind, protocol in protocols.items():
        (errors[kind],) = evaluate(sequence.truth, {sequence.name: result.poses}, protocol, sequence.times)
    return errors


def path_lost(result: Run) -> bool:
    """Whether more than `MAX_MISSING_FRAMES` frames in a row have no measured motion."""
    missing_in_a_row = 0
    for motion in result.motions:
        missing_in_a_row = 0 if motion.measured else missing_in_a_row + 1
        if missing_in_a_row > MAX_MISSING_FRAMES:
            return True
    return False


def warnings_of(result: Run) -> list[str]:
    """Warnings about the motions, the cameras and the boxes of a run, one sentence each."""
    possible = [
        _warning_about_stereo(result),
        _warning_about_cameras(result),
        _warning_about_boxes(result),
    ]
    return [warning for warning in possible if warning]


def _warning_about_stereo(result: Run) -> str:
    """A warning if the depths of the stereo pairs contradict many motions; otherwise ""."""
    contradicted = sum(Flag.CONTRADICTS_STEREO in motion.flags for motion in result.motions)
    if contradicted <= MAX_CONTRADICTED_SHARE * len(result.motions):
        return ""
    return (
        f"stereo contradicts the motion of {contradicted} of {len(result.motions)} frames, so the path "
        "is probably wrong: a wall or a repeated pattern fits several motions, a wrong calibration none; "
        f"the frames are marked {Flag.CONTRADICTS_STEREO} in {LOG}"
    )


def _warning_about_cameras(result: Run) -> str:
    """A warning if few motions were measured, since the cameras are exchanged; otherwise ""."""
    few_measured = np.mean([motion.measured for motion in result.motions]) < USUAL_SHARE_MEASURED
    if not few_measured or not exchanged_cameras(result.sequence):
        return ""
    return (
        "the rows of left and right images agree, but the disparities are negative: the cameras are "
        "exchanged, so exchange the left and the right images"
    )


def _warning_about_boxes(result: Run) -> str:
    """A warning if a method with boxes removed no feature, or all of them; otherwise ""."""
    if not result.config.filter.uses_boxes or result.sequence.labels is None:
        return ""
    percent = f"{100 * result.removed_share:.1f}"
    if percent not in NOTHING_OR_ALL_REMOVED:
        return ""
    return (
        f"{percent} % of the features are removed in boxes: do the labels belong to these images, and "
        "do their classes count (filter.classes)?"
    )
