"""Chapter 7: Table 1 and Figure 4, from runs started here."""

from __future__ import annotations

from dataclasses import dataclass, replace

from vo_lib.config import VARIANTS, preset
from vo_lib.detection.labels import detection_record, label_folder, labelled_sequence
from vo_lib.detection.settings import DetectorConfig
from vo_lib.evaluation.kitti import suitable_measure
from vo_lib.geometry.types import Progress
from vo_lib.report.entries import group_entries
from vo_lib.report.table1 import results
from vo_lib.settings import Checked, setting

from ..ch05.panel import LABELS
from ..frames import true_poses
from ..panel import Control, Drawing, Fact, Panel, State
from .figures import PATHS_HEIGHT, paths_figure, table_html, tables_of
from .runs import Plan, part_of, run_plan


@dataclass(frozen=True)
class ReproduceView(Checked):
    """Settings of the runs in the panel of chapter 7."""

    methods: tuple[str, ...] = setting((), "names separated by commas; empty: all systems of the variant")
    model: str = setting(LABELS, "source of boxes: label files, the name of a detector, or an ONNX file")
    frames: int = setting(60, "number of first frames; a part of KITTI's 00 starts at 16", low=20, high=5000)
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
        sequence, truth = plan.sequence, true_poses(plan.sequence)
        frame = min(state.frame, len(sequence) - 1)
        title = f"{sequence.name}, frames {sequence.frames[0]} to {sequence.frames[-1]}"
        if not plan.is_run:
            runs = len(plan.methods) * plan.seeds
            words = (
                f"Not run yet: {len(plan.methods)} methods of {plan.variant}\n× {plan.seeds} seeds on "
                f"{len(sequence)} frames, boxes: {state.view.model},\n{suitable_measure(truth).words}"
            )
            picture = paths_figure(title, truth, {}, frame, words)
            return Drawing([picture], "Press Run.", (Fact("runs", runs),))
        entries = run_plan(plan)
        paths = paths_figure(title, truth, {entry.method: entry.poses for entry in entries}, frame)
        tables = "".join(map(table_html, tables_of(entries)))
        sentence = " ".join(results(group_entries(entries)))
        if not any(entry.labels for entry in entries):
            sentence = "No boxes: feature_selection equals solution_selection. Name a detector under *boxes*."
        return Drawing([paths], sentence, tables=tables)

    def work(self, state: State, progress: Progress) -> None:
        plan = _plan(state)
        if state.view.model != LABELS:
            labelled_sequence(plan.sequence, state.view.model, progress=progress)
        run_plan(plan, progress)


def _plan(state: State) -> Plan:
    view, variant = state.view, state.config.variant
    methods = tuple(dict.fromkeys(name.strip() for name in view.methods)) or tuple(VARIANTS[variant])
    for name in methods:
        preset(name, variant=variant)
    true_poses(state.sequence)  # or say that there are none
    sequence = part_of(state.sequence, view.frames)
    if view.model != LABELS:  # `work` fills the folder
        labels = label_folder(sequence, detection_record(view.model, DetectorConfig()))
        sequence = replace(sequence, labels=labels)
    return Plan(sequence, methods, view.seeds, variant)
