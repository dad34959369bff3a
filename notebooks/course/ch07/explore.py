"""Chapter 7: the effect of a threshold over thirty frames, on stored matches."""

from __future__ import annotations

import functools
from typing import Any

from vo_lib.config import change, preset
from vo_lib.data.sequence import Sequence
from vo_lib.evaluation.kitti import SHORT_MEASURE, kitti_errors
from vo_lib.geometry.types import Progress
from vo_lib.kit.settings import KitConfig
from vo_lib.report.entries import te_and_re
from vo_lib.report.table1 import VARIANT_WORDS
from vo_lib.runs.matches import CachedMatches

from ..ch05.claim import claim_figure
from ..frames import opened, true_poses
from ..panel import Control, Drawing, Fact, Panel, State
from .runs import part_of, poses_of

FRAMES, METHOD = 30, "feature_selection"


class ExplorePanel(Panel):
    """`feature_selection` with changed settings, compared with its preset, on the first frames of a sequence."""

    title = f"One threshold at a time, on the first {FRAMES} frames"
    start = preset(METHOD)
    kit = preset(METHOD, variant="kit")
    height = 240
    needs_truth = True
    controls = (
        Control("selection.sets", "five-point sets", high=400),
        Control("selection.threshold", "inlier threshold", high=5, step=0.05),
        Control("selection.refine_scale", "refinement width", high=10, step=0.1),
        Control("selection.mode", "mode"),
        Control("buckets.features", "features a bucket", high=20),
        Control("filter.margin", "margin of boxes", step=0.05),
        Control("translation.max_depth", "farthest feature", high=200, step=5),
        Control("seed", high=9),
    )

    def changed(self) -> dict[str, Any]:
        """Settings that differ from the panel's start values and have an effect, by dotted name."""
        active = {name: knob.value for name, knob in self.knobs.items() if not knob.shown.disabled}
        differ = {name for name, value in active.items() if _shown(value) != _shown(self._first[name])}
        return {name: value for name, value in active.items() if name in differ - {"seed"}}

    def idle(self, state: State) -> set[str]:
        literal = isinstance(state.config, KitConfig) and state.config.selection.mode == "literal"
        return {"selection.refine_scale"} if literal else set()

    def draw(self, state: State) -> Drawing:
        variant, sequence = state.config.variant, state.sequence
        truth, changed = true_poses(sequence), self.changed()
        base = preset(METHOD, variant=variant, seed=state.config.seed)
        config = functools.reduce(lambda config, name: change(config, name, changed[name]), changed, base)
        paths = {"preset": poses_of(sequence, base), "with these settings": poses_of(sequence, config)}
        measure = SHORT_MEASURE.lengths, SHORT_MEASURE.step
        errors = (kitti_errors(truth, poses, *measure) for poses in paths.values())
        (te_preset, te), (re_preset, re) = te_and_re(errors).tolist()
        facts = (
            Fact("TE", te, "%", 4),
            Fact("TE of the preset", te_preset, "%", 4),
            Fact("RE", re, "deg/100 m", 4),
            Fact("RE of the preset", re_preset, "deg/100 m", 4),
            Fact("five-point sets", state.config.selection.sets),
            Fact("settings changed", len(changed)),
        )
        words = [f"{name} = {_shown(value)}" for name, value in changed.items()]
        sentence = (
            f"{METHOD}, {VARIANT_WORDS[variant]}, {len(sequence)} frames; TE and RE over "
            f"{SHORT_MEASURE.words}, as far as the path goes. Changed: {', '.join(words) or 'nothing'}."
        )
        picture = claim_figure(sequence, paths, self.height, min(state.frame, len(sequence) - 1))
        return Drawing([picture], sentence, facts)

    def _open(self, name: str) -> None:
        """Open the first frames of a sequence with their matches, as a job: the first call takes seconds."""

        def prepare(report: Progress) -> Sequence:
            sequence = part_of(opened(name, report), FRAMES)
            for done, _ in enumerate(CachedMatches(sequence, self.start), start=1):
                report(done, len(sequence))
            return sequence

        self._clear()
        self.job.start(f"matching {FRAMES} frames of {name}", prepare, self._use, self._not_opened)


def _shown(value: Any) -> str:
    """A setting as rounded text; the value 0.05 of a slider may be 0.04999999999999999."""
    return f"{value:g}" if isinstance(value, float) else str(value)
