"""The pattern of every panel: controls above, one picture of fixed size, a sentence and numbers below.

A panel gives `title`, `controls` and `draw(state)`; this class does the rest. `draw` is pure: the same state gives
the same picture. Callbacks run on another thread than cells, so nothing here uses pyplot, and pictures are bytes in
one `Image`: no flicker, no jumping, no leaked figures.
"""

from __future__ import annotations

import html
import threading
from dataclasses import dataclass
from operator import attrgetter
from pathlib import Path
from typing import Any, ClassVar

import ipywidgets as widgets
import numpy as np

from vo_lib.config import preset
from vo_lib.data.catalogue import available
from vo_lib.data.sequence import Sequence
from vo_lib.errors import DataError
from vo_lib.geometry.types import Progress
from vo_lib.kit.settings import KitConfig
from vo_lib.runs.drive import single_threaded
from vo_lib.settings import declared, replace

from .colours import BAD
from .controls import CELL, CELL_WIDTH, PLAIN, Control, Knob
from .drawing import WIDTH, stack
from .frames import DEFAULT, is_open, keep, opened
from .progress import Job, Stopped
from .results import Fact, facts_html, marked

ERROR_CLASS = "vo-panel-error"  # tests look for it in saved widget state
ERROR_STYLE = f"max-width:{WIDTH - 20}px;padding:4px 8px;border-left:4px solid {BAD}"


@dataclass(frozen=True)
class State:
    """What a panel's controls say: all settings, the sequence, and the current frame >= 1."""

    config: KitConfig
    view: Any
    sequence: Sequence
    frame: int


@dataclass(frozen=True)
class Drawing:
    """A picture as JPEG bytes, WIDTH pixels wide, a sentence on what it shows, numbers, and tables as HTML."""

    picture: bytes
    sentence: str
    facts: tuple[Fact, ...] = ()
    tables: str = ""


class Panel:
    """Base of all panels. Shown by being the last expression of a cell.

    Class attributes
    ----------------
    title : a line above the controls.
    controls : in the order shown; settings of `KitConfig`, or of `view` with the prefix "view.".
    view : class of the panel's own settings, made with `setting` like those of `KitConfig`.
    start : configuration that the controls begin with.
    height : rows of the picture.
    long_job : words on the Run button of a panel whose `work` takes more than a second; empty without.

    Attributes
    ----------
    error : what went wrong with the last change, as a sentence; empty when all is well.
    picture : the Image widget; knobs : controls by the setting's name; facts : the numbers shown, by name.
    """

    title: ClassVar[str] = ""
    controls: ClassVar[tuple[Control, ...]] = ()
    view: ClassVar[type | None] = None
    start: ClassVar[KitConfig] = preset("solution_selection", variant="kit")
    height: ClassVar[int] = 600
    long_job: ClassVar[str] = ""

    def __init__(self, sequence: str | Sequence = DEFAULT, frame: int = 60, **values: Any):
        """`values` are first values of controls, a dot of the name written as two underscores."""
        self._lock = threading.RLock()
        self._quiet = True
        self._sequence: Sequence | None = None
        self.facts: dict[str, float] = {}
        self.error = ""
        self.job = Job()
        white = stack([np.full((2, WIDTH, 3), 255, np.uint8)], self.height)
        # In a narrow window smaller, never cut off.
        fixed = {"width": f"{WIDTH}px", "max_width": "100%", "height": "auto"}
        self.picture = widgets.Image(value=white, format="jpeg", layout=fixed)
        self._message, self._text, self.tables = (widgets.HTML(layout={"width": "100%"}) for _ in range(3))
        self.knobs = self._make_knobs({key.replace("__", "."): value for key, value in values.items()})
        self.chooser = widgets.Dropdown(options=[*available()], value=None, description="sequence", **PLAIN)
        self.folder = widgets.Text(placeholder="or the path of a folder of your own", continuous_update=False)
        self.frame = widgets.IntSlider(
            value=frame, min=1, max=max(frame, 2), continuous_update=False, description="frame", **PLAIN
        )
        self.chooser.observe(self._chosen, "value")
        self.folder.observe(self._typed, "value")
        self.frame.observe(self.redraw, "value")
        self.box = self._layout()
        name = sequence if isinstance(sequence, str) else keep(sequence)
        self._offer(name)
        self._quiet = False
        self._open(name)

    def draw(self, state: State) -> Drawing:
        """What the panel shows for a state; anything it raises becomes the panel's error."""
        raise NotImplementedError

    def work(self, state: State, progress: Progress) -> Drawing:
        """The long job behind the Run button; it calls progress(done, total) several times a second."""
        raise NotImplementedError

    def set(self, **values: Any) -> None:
        """Set controls from code, `frame` and `sequence` among them, and draw once.

        A dot of a setting's name is written as two underscores: panel.set(selection__keep=3, frame=20).
        """
        sequence = values.pop("sequence", None)
        self._quiet = True
        try:
            if sequence is not None:
                self._offer(sequence)
                self.error = ""
                self._open(sequence)
                self.job.wait()
                if self.error:
                    return
            for name, value in values.items():
                widget = self.frame if name == "frame" else self.knobs[name.replace("__", ".")].widget
                widget.value = value
        finally:
            self._quiet = False
        self.redraw()

    def wait(self, seconds: float | None = None) -> None:
        """Block until no job is running."""
        self.job.wait(seconds)

    def redraw(self, _: Any = None) -> None:
        """Draw the present state; what goes wrong is shown in the panel."""
        if self._quiet or self._sequence is None:
            return
        with self._lock, single_threaded():
            try:
                self._show(self.draw(self.state()))
            except Exception as error:
                self._fail(error)

    def state(self) -> State:
        """What the controls say now; `DataError` where a typed value is none."""
        if self._sequence is None:
            raise DataError("choose a sequence first")
        config, view = self.start, None if self.view is None else self.view()
        for name, knob in self.knobs.items():
            if name.startswith("view."):
                view = replace(view, name.removeprefix("view."), knob.value)
            else:
                config = replace(config, name, knob.value)
        return State(config, view, self._sequence, int(self.frame.value))

    def run(self, _: Any = None) -> None:
        """Start the long job, as the Run button does."""
        try:
            state = self.state()
            self.job.start(self.long_job, lambda report: self.work(state, report), self._show, self._fail)
        except DataError as error:
            self._fail(error)

    def _repr_mimebundle_(self, **options: Any) -> Any:
        return self.box._repr_mimebundle_(**options)

    def _show(self, drawing: Drawing) -> None:
        with self._lock:
            self._text.value = facts_html(drawing.sentence, drawing.facts, self.facts)
            self.facts = {fact.name: fact.value for fact in drawing.facts}
            self.picture.value, self.tables.value = drawing.picture, drawing.tables
            self.error = self._message.value = ""

    def _fail(self, error: Exception) -> None:
        if isinstance(error, Stopped):
            self._message.value = "<i>Stopped.</i>"
            return
        # A DataError is written for people; of any other error its kind helps to find the mistake.
        self.error = str(error) if isinstance(error, DataError) else f"{type(error).__name__}: {error}"
        words = f'role="alert" style="{ERROR_STYLE}">{marked(self.error)}'
        self._message.value = f'<div class="{ERROR_CLASS}" {words}</div>'

    def _make_knobs(self, first: dict[str, Any]) -> dict[str, Knob]:
        items = [*declared(type(self.start)), *(declared(self.view, "view.") if self.view else ())]
        settings = {item.name: item for item in items}
        knobs = {}
        for control in self.controls:
            setting = settings[control.name]
            value = (
                setting.default if setting.name.startswith("view.") else attrgetter(setting.name)(self.start)
            )
            knobs[control.name] = Knob(control, setting, first.pop(control.name, value))
            knobs[control.name].widget.observe(self.redraw, "value")
        if first:
            raise DataError(f"{sorted(first)[0]}: the panel has no such control")
        return knobs

    def _layout(self) -> Any:
        cells = [widgets.VBox([each], layout=CELL) for each in (self.chooser, self.frame, self.folder)]
        cells += [knob.cell for knob in self.knobs.values()]
        rows = [widgets.HTML(f"<b>{html.escape(self.title)}</b>")]
        wrapped = {"flex_flow": "row wrap"}
        rows += [widgets.HBox(cells[i : i + 3], layout=wrapped) for i in range(0, len(cells), 3)]
        if self.long_job:
            wide = {"width": f"{CELL_WIDTH - 12}px"}
            rows.append(widgets.Button(description=self.long_job, icon="play", layout=wide))
            rows[-1].on_click(self.run)
        rows += [self.job.box, self._message, self.picture, self._text, self.tables]
        width = {"width": f"{WIDTH + 24}px", "max_width": "100%"}
        return widgets.VBox(rows, layout={**width, "padding": "8px", "border": "1px solid #BBB"})

    def _offer(self, name: str) -> None:
        """Make a sequence the chosen one, also one that the list does not have yet."""
        if name not in self.chooser.options:
            self.chooser.options = [name, *self.chooser.options]
        self.chooser.value = name

    def _chosen(self, change: Any) -> None:
        if not self._quiet:
            self._open(change["new"])

    def _typed(self, change: Any) -> None:
        if change["new"].strip():
            self._offer(str(Path(change["new"].strip()).expanduser()))

    def _open(self, name: str) -> None:
        """Open a sequence and draw; at once where it is known, else as a job with a bar."""
        if is_open(name):
            self._use(opened(name))
        else:
            self.job.start(f"opening {name}", lambda report: opened(name, report), self._use, self._fail)

    def _use(self, sequence: Sequence) -> None:
        with self._lock:
            quiet, self._quiet = self._quiet, True
            self._sequence, self.facts = sequence, {}
            self.frame.max = len(sequence) - 1
            self._quiet = quiet
        self.redraw()
