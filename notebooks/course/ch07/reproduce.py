"""Chapter 7: Table 1 and Figure 4, from runs started here or read from run folders."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field
from typing import Any

import ipywidgets as widgets
import numpy as np

from vo_lib.config import METHODS, PUBLISHED
from vo_lib.core.errors import DataError
from vo_lib.core.settings import Checked, setting
from vo_lib.core.types import Image, Progress
from vo_lib.tables.entries import Entry
from vo_lib.tables.paper import read_paper_table

from ..controls import Control
from ..drawing import raster, stack
from ..facts import Fact
from ..frames import Memory
from ..panel import Drawing, Panel, State
from .figures import errors_figure, paths_figure, plan_figure, table_html, table_tables
from .runs import WAYS, Plan, Table, known, load_folder, run_plan, way

PATHS_HEIGHT, ERRORS_HEIGHT = 340, 240
GAIN = ("solution_selection", "feature_selection")  # before and after features in boxes are removed

SHORT, SUITED = "20, 50, 100 m", "as vo reproduce"
LENGTHS = (SHORT, SUITED)

_charts: Memory[Image] = Memory(8)


@dataclass(frozen=True)
class ReproduceView(Checked):
    """What the panel of chapter 7 runs."""

    methods: tuple[str, ...] = setting(tuple(METHODS), "names with commas between")
    frames: int = setting(60, "frames of the sequence, from its first one", low=20, high=5000)
    seeds: int = setting(3, "runs of each method, each with other random sets", low=1, high=10)
    variant: str = setting(
        "kit", "the paper as published, or the kit's way, its winner refined or taken as it is", choices=WAYS
    )
    lengths: str = setting(
        SHORT, "sub-sequences: short ones from every frame, or what vo reproduce takes", choices=LENGTHS
    )
    folder: str = setting("", "path of a folder of finished runs, such as runs/table1, to show instead")
    paper: str = setting("", "path of a corrected CSV, to compare with instead")


@dataclass(frozen=True)
class TableDrawing(Drawing):
    """A drawing with tables, as HTML, below it."""

    tables: str = field(default="")


class ReproducePanel(Panel):
    """Methods over seeds on one sequence, or over all sequences of a folder of runs."""

    title = "Table 1 and Figure 4"
    view = ReproduceView
    height = PATHS_HEIGHT + ERRORS_HEIGHT
    long_job = "Run the methods"
    controls = (
        Control("view.methods", "methods"),
        Control("view.frames", "frames", step=20),
        Control("view.seeds", "seeds", high=5),
        Control("view.variant", "variant"),
        Control("view.lengths", "lengths"),
        Control("view.folder", "run folders"),
        Control("view.paper", "the paper's numbers"),
    )

    def draw(self, state: State) -> Drawing:
        folder = state.view.folder.strip()
        if folder and self._read is not None and self._read[0] == folder:
            return self._table(state, self._read[1], f"Read from {folder}.")
        plan = _plan(state)
        table = known(plan)
        if table is not None:
            return self._table(state, table, f"The run folders are in {plan.folder}.")
        return self._before(state, plan)

    def work(self, state: State, progress: Progress) -> Drawing:
        run_plan(_plan(state), progress)
        # A folder that is typed is shown in place of runs, and the person has asked for runs.
        self._quiet, self.knobs["view.folder"].widget.value = True, ""
        self._quiet = False
        return self.draw(self.state())

    def _before(self, state: State, plan: Plan) -> Drawing:
        truth = plan.sequence.truth
        assert truth is not None
        runs = len(plan.methods) * plan.seeds
        words = (
            f"Not run yet, {plan.variant}:\n{len(plan.methods)} methods × {plan.seeds} seeds = {runs} runs\n"
            f"of {len(plan.sequence)} frames, judged over {state.view.lengths}\n\n" + "\n".join(plan.methods)
        )
        title = f"{plan.sequence.name}, frames 0 to {len(truth) - 1}"
        frame = min(state.frame, len(truth) - 1)
        made = plan_figure(truth, frame, title, words, PATHS_HEIGHT)
        sentence = "Press Run; or type the folder of a finished `vo reproduce`."
        return TableDrawing(stack([made], self.height), sentence, (Fact("runs", runs),))

    def _table(self, state: State, table: Table, sentence: str) -> Drawing:
        entries = table.short if state.view.lengths == SHORT else table.suited
        # A folder of `vo reproduce` holds both variants: the one chosen is drawn.
        variant = "published" if state.view.variant == "published" else "kit"
        entries = [entry for entry in entries if entry.variant == variant] or entries
        paper = read_paper_table(state.view.paper.strip() or None)
        here = [entry for entry in entries if entry.sequence == state.sequence.name]
        if not here:
            here = [entry for entry in entries if entry.sequence == entries[0].sequence]
        digest = hashlib.sha256(b"".join(e.poses.tobytes() + e.method.encode() for e in entries)).hexdigest()
        key = digest, repr(paper), str([entry.te for entry in entries])
        chart = _charts.get(key, lambda: raster(errors_figure(entries, ERRORS_HEIGHT, paper)))
        picture = stack([paths_figure(here, state.frame, PATHS_HEIGHT), chart], self.height)
        tables = "".join(map(table_html, table_tables(entries, paper)))
        return TableDrawing(picture, f"{_gain(here)} {sentence}", _facts(here), tables)

    def _show(self, drawing: Drawing) -> None:
        super()._show(drawing)
        self.tables.value = drawing.tables if isinstance(drawing, TableDrawing) else ""

    def _layout(self) -> Any:
        self._read: tuple[str, Table] | None = None
        self.tables = widgets.HTML()
        box = super()._layout()
        box.children = (*box.children, self.tables)
        return box

    def redraw(self, _: Any = None) -> None:
        """Draw; the folder of runs that is typed is read first, in a job."""
        folder = self.knobs["view.folder"].widget.value.strip() if self._sequence else ""
        if self._quiet or not folder or (self._read and self._read[0] == folder):
            super().redraw()
            return

        def done(table: Table) -> None:
            self._read = folder, table
            super(ReproducePanel, self).redraw()

        self.job.start(
            "reading the runs", lambda report: load_folder(folder, self._sequence, report), done, self._fail
        )


def _plan(state: State) -> Plan:
    methods = tuple(dict.fromkeys(name.strip() for name in state.view.methods))
    if state.view.variant == "published" and methods == tuple(METHODS):
        methods = tuple(PUBLISHED)
    for name in methods:
        way(name, state.view.variant)
    sequence = state.sequence.part(0, min(state.view.frames, len(state.sequence)))
    if sequence.truth is None:
        raise DataError(f"{sequence.name} has no ground truth to compare with")
    return Plan(sequence, methods, state.view.seeds, state.view.variant)


def _facts(entries: list[Entry]) -> tuple[Fact, ...]:
    facts = []
    for entry in entries:
        facts.append(Fact(f"TE {entry.method}", float(entry.te.mean()), "%", 3))
        facts.append(Fact(f"RE {entry.method}", float(entry.re.mean()), "deg/100 m", 3))
    return tuple(facts)


def _gain(entries: list[Entry]) -> str:
    """What removing the features did to the translation error, seed by seed, in words."""
    by_name = {entry.method: entry for entry in entries}
    if not set(GAIN) <= set(by_name) or by_name[GAIN[0]].seeds != by_name[GAIN[1]].seeds:
        return ""
    change = by_name[GAIN[1]].te - by_name[GAIN[0]].te
    if not change.any():
        return (
            f"{by_name[GAIN[0]].sequence}: no boxes, nothing removed. Write labels first: "
            "`vo data write_labels` with a detector (chapter 5)."
        )
    if not np.isfinite(change).all():
        return ""
    return (
        f"{by_name[GAIN[0]].sequence}: removing features in boxes changes TE by {change.mean():+.4f} % "
        f"(± {change.std():.4f} over {len(change)} seeds)."
    )
