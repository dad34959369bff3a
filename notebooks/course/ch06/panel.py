"""Chapter 6: all errors of one trajectory, with one of its sub-sequences in view."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from vo_lib.config import PUBLISHED, preset
from vo_lib.data.poses import from_first, match_times, read_poses
from vo_lib.errors import DataError
from vo_lib.evaluation.ate_rpe import Alignment, absolute_error, align, relative_error, rmse
from vo_lib.evaluation.kitti_errors import KittiErrors, frames_of_truth, kitti_errors, suitable_protocol
from vo_lib.geometry.types import Array, Progress
from vo_lib.report.table1 import te_and_re
from vo_lib.settings import Checked, setting

from ..controls import about, typed_path
from ..drawing import TITLE_NAME, figure, shortened, write_instead
from ..kept_runs import has_run, poses_of
from ..panel import Control, Drawing, Fact, Panel, State
from ..perturbed_path import perturbed_path
from .figures import drift_chart, length_chart, paths_chart

MADE_UP = "made-up errors"
PATH_HEIGHT = 320
CHART_HEIGHT = 220


@dataclass(frozen=True)
class EvaluationView(Checked):
    """Settings of the panel of chapter 6."""

    estimate: str = setting(
        MADE_UP, "the truth with added errors, or the path of a method", choices=(MADE_UP, *PUBLISHED)
    )
    lengths: tuple[float, ...] = setting((), "empty: selected by path length", unit="m", low=1, high=10000)
    step: int = setting(10, "frames from one start to the next", low=1, high=50)
    alignment: str = setting(
        Alignment.SE3.value,
        "alignment before ATE; TE and RE need no alignment",
        choices=tuple(alignment.value for alignment in Alignment),
    )
    scale: float = setting(1.0, "added: excess length of each step", unit="%", low=-5, high=5)
    yaw: float = setting(1.0, "added: excess turn to the right", unit="deg/100 m", low=-5, high=5)
    noise: float = setting(5.0, "added: noise of each step", unit="mm", low=0, high=100)
    jitter: float = setting(0.0, "added: noise of each rotation", unit="deg", low=0, high=0.5)
    file: str = setting("", "path of a pose file (KITTI, TUM or .npy) that replaces the estimate")


class EvaluationPanel(Panel):
    """Paths, the sub-sequence that starts at the frame, and the errors of all sub-sequences."""

    title = "A trajectory and its errors"
    view = EvaluationView
    height = PATH_HEIGHT + CHART_HEIGHT
    needs_truth = True
    long_job = "Run the method"
    controls = (
        Control("view.estimate", "estimate"),
        Control("view.alignment", "alignment"),
        Control("view.file", "a file of your own"),
        Control("view.scale", "scale error", step=0.1),
        Control("view.yaw", "yaw error", step=0.1),
        Control("view.noise", "noise", step=1),
        Control("view.jitter", "jitter", step=0.01),
        Control("view.lengths", "lengths"),
        Control("view.step", "step", high=20),
    )

    def idle(self, state: State) -> set[str]:
        made = {"view.scale", "view.yaw", "view.noise", "view.jitter"}
        if state.view.file.strip():
            return made | {"view.estimate"}
        return set() if state.view.estimate == MADE_UP else made

    def draw(self, state: State) -> Drawing:
        truth = from_first(state.sequence.true_poses)
        estimate = self._estimate(state, truth)
        if estimate is None:
            path, (axis,) = figure(PATH_HEIGHT)
            paths_chart(axis, truth, None, shortened(state.sequence.name, TITLE_NAME))
            sentence = f"{state.view.estimate} has not been run on {state.sequence.name} here: press *Run the method*."
            return Drawing([path], sentence, (Fact("poses", len(truth)),))
        return self._judged(state, truth, estimate)

    def work(self, state: State, progress: Progress) -> None:
        if state.view.file.strip() or state.view.estimate == MADE_UP:
            raise DataError("choose a method under *estimate*, and leave *a file of your own* empty")
        poses_of(state.sequence, preset(state.view.estimate), progress)

    def _estimate(self, state: State, truth: Array) -> Array | None:
        view = state.view
        path = view.file.strip()
        if path:
            with about("a file of your own", "choose another file, or leave the field empty"):
                poses = _poses_of_frames(typed_path(path), state.sequence.times)
                frames_of_truth(truth, poses, where=f"{path}: ")
            return poses
        if view.estimate == MADE_UP:
            return perturbed_path(truth, view.scale, view.yaw, view.noise, view.jitter)
        config = preset(view.estimate)
        if not has_run(state.sequence, config):
            return None
        return poses_of(state.sequence, config)

    def _judged(self, state: State, truth: Array, estimate: Array) -> Drawing:
        """Charts and numbers for an estimate."""
        view = state.view
        sequence = state.sequence
        alignment = Alignment(view.alignment)
        lengths = view.lengths or suitable_protocol(truth).lengths
        errors = kitti_errors(truth, estimate, lengths, view.step)
        part = longest_from(truth, estimate, lengths, state.frame)
        aligned, scale = align(truth, estimate, alignment)
        ate = rmse(absolute_error(truth, estimate, alignment).distance)
        step = relative_error(truth, estimate)
        rpe = rmse(step.translation)
        rpe_turn = rmse(step.rotation)

        paths, (left, right) = figure(PATH_HEIGHT, 2)
        title = f"{shortened(sequence.name, TITLE_NAME)}, alignment {view.alignment}"
        if len(part):
            first = int(part.first[0])
            last = int(part.last[0])
            paths_chart(left, truth, aligned, title, (first, last))
            drift_chart(right, truth, estimate, first, last)
        else:
            paths_chart(left, truth, aligned, title)
            write_instead(right, f"the path after frame {state.frame} is too short")
        others = _errors_of_others(state, truth, lengths)
        by_length, (translation, rotation) = figure(CHART_HEIGHT, 2)
        length_chart(translation, errors, others, rotation=False)
        length_chart(rotation, errors, others, rotation=True)

        (te,), (re,) = te_and_re([errors]).tolist()
        facts = (
            Fact("TE", te, "%", 3),
            Fact("RE", re, "deg/100 m", 3),
            Fact("sub-sequences", len(errors)),
            Fact("ATE", np.nan if ate is None else ate, "m", 3),
            Fact("RPE", np.nan if rpe is None else 1e3 * rpe, "mm", 2),
            Fact("RPE, rotation", np.nan if rpe_turn is None else np.degrees(rpe_turn), "°", 2),
            Fact("scale", scale, "", 4),
        )
        return Drawing([paths, by_length], _sentence(errors, part), facts)


def _errors_of_others(state: State, truth: Array, lengths: tuple[float, ...]) -> dict[str, KittiErrors]:
    """The errors of the methods that were run on the sequence already, without the one that is shown."""
    others = {}
    for name in PUBLISHED:
        config = preset(name)
        if name != state.view.estimate and has_run(state.sequence, config):
            poses = poses_of(state.sequence, config)
            others[name] = kitti_errors(truth, poses, lengths, state.view.step)
    return others


def _poses_of_frames(path: Path, times: Array) -> Array:
    """The poses of a file at the times of the frames (N,), seconds, or all poses of a file without times."""
    file = read_poses(path)
    if file.times is None:
        return file.poses
    rows, pose_rows = match_times(times, file.times)
    if len(rows) < 2:
        ranges = [f"{each[0]:.13g} to {each[-1]:.13g} s" for each in (file.times, times)]
        raise DataError(f"fewer than two poses at times of the sequence: {' and '.join(ranges)}", path)
    return file.poses[pose_rows]


def longest_from(truth: Array, estimate: Array, lengths: tuple[float, ...], first: int) -> KittiErrors:
    """The longest sub-sequence from frame `first` with one of `lengths`; empty if the path is too short."""
    # With a step as long as the path, frame `first` is the only start.
    errors = kitti_errors(truth[first:], estimate[first:], lengths, len(truth))
    longest = errors[np.argsort(errors.length)[-1:]]
    return replace(longest, first=longest.first + first, last=longest.last + first)


def _sentence(errors: KittiErrors, part: KittiErrors) -> str:
    if len(part) == 0:
        return (
            "No sub-sequence of these lengths starts here: choose an earlier *frame*, or shorter *lengths*."
        )
    (te,), (re,) = te_and_re([part])
    length = part.length[0]
    return (
        f"From frame {part.first[0]} to {part.last[0]}, {length:g} m: the error at the end is "
        f"{te * length / 100:.2f} m ({te:.2f} %) and {re * length / 100:.2f}° ({re:.2f} deg/100 m). "
        f"TE and RE are the means over {len(errors)} such sub-sequences."
    )
