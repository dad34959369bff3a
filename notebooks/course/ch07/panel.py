"""Chapter 7: the effect of a threshold on stored matches; Table 1 and Figure 4, from runs started here."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property, partial
from operator import attrgetter
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from vo_lib.config import VARIANTS, change, preset
from vo_lib.data.sequence import Sequence
from vo_lib.detection.label_folders import detection_record, label_folder, labelled_sequence
from vo_lib.detection.settings import DetectorConfig
from vo_lib.evaluation.kitti_errors import (
    SHORT_PROTOCOL,
    kitti_errors,
    suitable_protocol,
    trajectory_distances,
)
from vo_lib.geometry.types import Array, Progress
from vo_lib.kit.settings import KitConfig
from vo_lib.paper.settings import MethodConfig
from vo_lib.report.table1 import group_entries, te_and_re
from vo_lib.report.table1_page import VARIANT_WORDS, sentences_on_proposal
from vo_lib.runs.match_cache import CachedMatches
from vo_lib.settings import Checked, declared, setting

from ..ch05.box_sources import LABELS, MODEL_REMEDY, typed_model
from ..ch05.claim import ClaimChart
from ..controls import about
from ..drawing import TITLE_NAME, shortened
from ..frames import opened
from ..kept_runs import frames_of, poses_of, run_by_frame
from ..panel import Control, Drawing, Fact, Panel, State
from .figures import PATHS_HEIGHT, paths_figure, table_html, tables_of
from .plan import Plan, part_of, run_plan

FRAMES = 30
METHOD = "feature_selection"


class ExplorePanel(Panel):
    """`feature_selection` with changed settings, compared with its preset, on the first frames of a sequence."""

    title = f"One threshold at a time, on the first {FRAMES} frames"
    start = preset(METHOD)
    kit = preset(METHOD, variant="kit")
    height = 240
    needs_truth = True
    # All frames with another inlier threshold are done by then, since their candidates come from memory: a drag of
    # this slider shows no unfinished picture.
    first_steps_s = 0.06
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

    @cached_property
    def chart(self) -> ClaimChart:
        """The chart that is drawn anew for each picture."""
        return ClaimChart(self.height)

    def changed(self, state: State) -> dict[str, Any]:
        """Settings that differ from the panel's start values and have an effect, by dotted name."""
        settings = {item.name for item in declared(type(state.config))}
        changed = {}
        for control in self.controls:
            name = control.name
            if name == "seed" or name not in settings or name in self.idle(state):
                continue
            value = attrgetter(name)(state.config)
            if _shown(value) != _shown(self.first[name]):
                changed[name] = value
        return changed

    def idle(self, state: State) -> set[str]:
        literal = isinstance(state.config, KitConfig) and state.config.selection.mode == "literal"
        return {"selection.refine_scale"} if literal else set()

    def compared(self, state: State) -> dict[str, MethodConfig]:
        """The configurations of a state by name: the preset, and the preset with the changed settings."""
        base = preset(METHOD, variant=state.config.variant, seed=state.config.seed)
        config = base
        for name, value in self.changed(state).items():
            config = change(config, name, value)
        return {"preset": base, "with these settings": config}

    def steps(self, state: State) -> Iterator[Callable[[], Drawing]]:
        for poses_so_far in run_by_frame(state.sequence, self.compared(state)):
            yield partial(self._part, state, poses_so_far)

    def draw(self, state: State) -> Drawing:
        sequence = state.sequence
        truth = sequence.true_poses
        # Do the runs here, frame by frame, with shared candidates; then `poses_of` has them in memory.
        for _ in run_by_frame(sequence, self.compared(state)):
            pass
        paths = {name: poses_of(sequence, config) for name, config in self.compared(state).items()}
        errors = [
            kitti_errors(truth, poses, SHORT_PROTOCOL.lengths, SHORT_PROTOCOL.step)
            for poses in paths.values()
        ]
        facts = self._facts(state, te_and_re(errors))
        sentence = (
            f"{METHOD}, {VARIANT_WORDS[state.config.variant]}, {len(sequence)} frames; TE and RE over "
            f"{SHORT_PROTOCOL.words}, as far as the path goes. Changed: {self._changes(state)}."
        )
        return Drawing([self._picture(state, paths)], sentence, facts)

    def _part(self, state: State, poses_so_far: Callable[[], dict[str, Array]]) -> Drawing:
        """What is known before all frames are done."""
        paths = poses_so_far()
        done = min(len(poses) for poses in paths.values())
        sentence = (
            f"The first {done} of {len(state.sequence)} frames; TE and RE follow with the last frame. "
            f"Changed: {self._changes(state)}."
        )
        return Drawing([self._picture(state, paths)], sentence, self._facts(state, np.full((2, 2), np.nan)))

    def _picture(self, state: State, paths: dict[str, Array]) -> Figure:
        frame = min(state.frame, len(state.sequence) - 1)
        return self.chart.draw(state.sequence, paths, frame)

    def _changes(self, state: State) -> str:
        words = []
        for name, value in self.changed(state).items():
            knob = self.knobs[name]
            words.append(f"{knob.control.words} = {_shown(value)} {knob.setting.unit}".rstrip())
        return ", ".join(words) or "nothing"

    def _facts(self, state: State, errors: Array) -> tuple[Fact, ...]:
        """The numbers; `errors` (2, 2) are TE and RE, each of the preset and of the changed settings."""
        (te_preset, te), (re_preset, re) = errors.tolist()
        return (
            Fact("TE", te, "%", 4),
            Fact("TE of the preset", te_preset, "%", 4),
            Fact("RE", re, "deg/100 m", 4),
            Fact("RE of the preset", re_preset, "deg/100 m", 4),
            Fact("five-point sets", state.config.selection.sets),
            Fact("settings changed", len(self.changed(state))),
        )

    def is_ready(self, name: str) -> bool:
        return False

    def prepare(self, name: str, progress: Progress) -> Sequence:
        """The first frames of a sequence with their matches: the first call takes seconds."""
        sequence = part_of(opened(name, progress), FRAMES)
        for done, _ in enumerate(CachedMatches(sequence, self.start), start=1):
            progress(done, len(sequence))
        frames_of(sequence, self.start)
        return sequence


def _shown(value: Any) -> str:
    """A setting as rounded text; the value 0.05 of a slider may be 0.04999999999999999."""
    return f"{value:g}" if isinstance(value, float) else str(value)


@dataclass(frozen=True)
class ReproduceView(Checked):
    """Settings of the runs in the panel of chapter 7."""

    methods: tuple[str, ...] = setting((), "names separated by commas; empty: all systems of the variant")
    model: str = setting(LABELS, "source of boxes: label files, the name of a detector, or an ONNX file")
    frames: int = setting(100, "number of first frames; a part of KITTI's 00 starts at 16", low=20, high=5000)
    seeds: int = setting(3, "number of runs of each method, with different random sets", low=1, high=10)


class ReproducePanel(Panel):
    """Methods with several seeds on one sequence."""

    title = "Table 1 and Figure 4"
    view = ReproduceView
    kit = preset("feature_selection", variant="kit")
    height = PATHS_HEIGHT
    needs_truth = True
    long_job = "Run the methods"
    controls = (
        Control("view.methods", "systems"),
        Control("view.model", "boxes"),
        Control("view.frames", "frames", high=1200, step=20),
        Control("view.seeds", "seeds", high=5),
    )

    def draw(self, state: State) -> Drawing:
        plan = _plan(state)
        sequence = plan.sequence
        truth = sequence.true_poses
        frame = min(state.frame, len(sequence) - 1)
        name = shortened(sequence.name, TITLE_NAME)
        title = f"{name}, frames {sequence.frames[0]} to {sequence.frames[-1]}"
        if not plan.is_run:
            runs = len(plan.methods) * plan.seeds
            words = (
                f"Not run yet: {len(plan.methods)} methods of {plan.variant}\n× {plan.seeds} seeds on "
                f"{len(sequence)} frames, boxes: {state.view.model},\n{suitable_protocol(truth).words}"
            )
            picture = paths_figure(title, truth, {}, frame, words)
            return Drawing([picture], "Press *Run the methods*.", (Fact("runs", runs),))
        entries = run_plan(plan)
        paths = paths_figure(title, truth, {entry.method: entry.poses for entry in entries}, frame)
        tables = "".join(table_html(table) for table in tables_of(entries))
        sentence = " ".join(sentences_on_proposal(group_entries(entries)))
        shortest = min(SHORT_PROTOCOL.lengths)
        length = float(trajectory_distances(truth)[-1])
        if length <= shortest:
            sentence = (
                f"The path of {length:.1f} m is shorter than the shortest sub-sequence, {shortest:g} m, so there "
                "are no errors: choose more *frames*."
            )
        elif not any(entry.has_boxes for entry in entries):
            sentence = "No boxes: feature_selection equals solution_selection. Name a detector under *boxes*."
        return Drawing([paths], sentence, tables=tables)

    def work(self, state: State, progress: Progress) -> None:
        plan = _plan(state)
        if state.view.model.strip() != LABELS:
            with about("boxes", MODEL_REMEDY):
                labelled_sequence(plan.sequence, typed_model(state.view.model), progress=progress)
        run_plan(plan, progress)


def _plan(state: State) -> Plan:
    """The runs that the controls describe; `DataError` for an unknown method, a wrong model, or no truth."""
    view = state.view
    variant = state.config.variant
    typed = dict.fromkeys(name.strip() for name in view.methods)  # each once, in this order
    methods = tuple(typed) or tuple(VARIANTS[variant])
    for name in methods:
        with about("systems", "*method* chooses the variant"):
            preset(name, variant=variant)
    _ = state.sequence.true_poses  # without a truth, a `DataError` now, and not after the runs
    sequence = part_of(state.sequence, view.frames)
    if view.model.strip() != LABELS:  # `work` fills the folder
        with about("boxes", MODEL_REMEDY):
            labels = label_folder(sequence, detection_record(typed_model(view.model), DetectorConfig()))
        sequence = replace(sequence, labels=labels)
    return Plan(sequence, methods, view.seeds, variant)
