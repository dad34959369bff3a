"""Chapter 7: what a threshold is worth over thirty frames, on matches that are found once and kept."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Any

import numpy as np

from vo_lib.config import METHODS, VARIANTS, change, preset
from vo_lib.data.sequence import Sequence
from vo_lib.evaluation.kitti import SHORT_MEASURE, kitti_errors
from vo_lib.geometry.types import Array, Progress
from vo_lib.paper.settings import PublishedConfig
from vo_lib.report.table1 import VARIANT_WORDS
from vo_lib.runs.drive import run_methods
from vo_lib.runs.matches import CachedMatches
from vo_lib.settings import Checked, setting

from ..ch05.claim import claim_figure, step_errors
from ..controls import Control
from ..drawing import stack
from ..frames import Memory, opened, true_poses
from ..panel import Drawing, Panel, State
from ..results import Fact
from .runs import part_of

FRAMES = 30

_runs: Memory[Array] = Memory(400)


@dataclass(frozen=True)
class ExploreView(Checked):
    """Which method the sliders change."""

    method: str = setting("feature_selection", "the method that follows the sliders", choices=tuple(METHODS))
    variant: str = setting(
        "kit",
        "the paper as published, which refuses the kit's own, or the kit's way",
        choices=tuple(VARIANTS),
    )


class ExplorePanel(Panel):
    """A method with changed settings beside its preset, on the first frames of a sequence."""

    title = f"One threshold at a time, on the first {FRAMES} frames"
    view = ExploreView
    start = preset("feature_selection", variant="kit")
    height = 240
    controls = (
        Control("view.method", "method"),
        Control("view.variant", "variant"),
        Control("selection.sets", "five-point sets", high=400),
        Control("selection.threshold", "inlier threshold", high=5, step=0.05),
        Control("selection.refine_scale", "refinement width", high=10, step=0.1),
        Control("selection.mode", "mode"),
        Control("buckets.features", "features a bucket", high=20),
        Control("filter.margin", "margin of boxes", step=0.05),
        Control("translation.max_depth", "farthest feature", high=200, step=5),
        Control("seed", high=9),
    )

    @property
    def changed(self) -> dict[str, Any]:
        """Settings that differ from those the panel began with, by dotted name."""
        settings = {name: knob.value for name, knob in self.knobs.items() if not name.startswith("view.")}
        begun = {name: functools.reduce(getattr, name.split("."), self.start) for name in settings}
        return {name: value for name, value in settings.items() if value != begun[name]}

    def draw(self, state: State) -> Drawing:
        method, variant, sequence = state.view.method, state.view.variant, state.sequence
        truth, changed = true_poses(sequence), self.changed
        base = preset(method, variant=variant, seed=state.config.seed)
        paths = {"preset": poses_of(sequence, base)}
        # `DataError` where the paper's own has no such setting.
        config = functools.reduce(lambda config, name: change(config, name, changed[name]), changed, base)
        paths["with these settings"] = poses_of(sequence, config)
        (te_preset, re_preset), (te, re) = (errors_of(truth, poses) for poses in paths.values())
        frame = min(state.frame, len(sequence) - 1)
        turn, step = step_errors(sequence, paths["with these settings"])
        facts = (
            Fact("TE", te, "%", 4),
            Fact("TE of the preset", te_preset, "%", 4),
            Fact("RE", re, "deg/100 m", 4),
            Fact("RE of the preset", re_preset, "deg/100 m", 4),
            Fact("five-point sets", state.config.selection.sets),
            Fact("rotation error here", float(turn[frame - 1]), "deg", 4),
            Fact("translation error here", float(step[frame - 1]), "mm", 1),
        )
        # A slider's 0.05 may be 0.04999999999999999.
        words = [f"{n} = {f'{v:g}' if isinstance(v, float) else v}" for n, v in changed.items()]
        sentence = (
            f"{method}, {VARIANT_WORDS[variant]}, {len(sequence)} frames; TE and RE over "
            f"{SHORT_MEASURE.words}, as far as it goes. "
            f"Changed: {', '.join(words) or 'nothing'}."
        )
        picture = claim_figure(sequence, paths, self.height, frame)
        return Drawing(stack([picture], self.height), sentence, facts)

    def _open(self, name: str) -> None:
        """The first frames of a sequence with their matches: seconds the first time, so always a job."""

        def prepare(report: Progress) -> Sequence:
            sequence = part_of(opened(name, report), FRAMES)
            true_poses(sequence)  # or say that there are none
            for done, _ in enumerate(CachedMatches(sequence, self.start), start=1):
                report(done, len(sequence))
            return sequence

        self.job.start(f"matching {FRAMES} frames of {name}", prepare, self._use, self._fail)


def poses_of(sequence: Sequence, config: PublishedConfig) -> Array:
    """Poses (N, 4, 4) of a configuration on the kept matches: the back end alone."""
    key = sequence.folder, sequence.frames[0], len(sequence), sequence.labels, config
    matches = CachedMatches(sequence, config)
    return _runs.get(key, lambda: run_methods(sequence, {"": config}, matches=matches)[""].poses)


def errors_of(truth: Array, poses: Array) -> tuple[float, float]:
    """TE in % and RE in deg/100 m over short sub-sequences; NaN where the path holds none."""
    errors = kitti_errors(truth, poses, SHORT_MEASURE.lengths, SHORT_MEASURE.step)
    return float(errors.te or np.nan), float(errors.re or np.nan)
