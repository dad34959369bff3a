"""The base class of all panels: a column of controls beside a picture of fixed size, a sentence and numbers.

A panel defines `title`, `controls` and `draw(state)`. Equal states have equal pictures. Callbacks run on
another thread than cells, so this module does not use pyplot. Pictures are bytes in one `Image`, so they do
not flicker.

A panel starts with the method of the paper. With a configuration `kit`, the panel has a switch between the
variants `published` and `kit`; controls of settings that the selected variant lacks are grey:

    class TranslationPanel(Panel):
        kit = preset("solution_selection", variant="kit")
        controls = (Control("translation.max_depth"), Control("translation.scale"))

        def idle(self, state: State) -> set[str]:
            return set() if state.view.weighting == "robust" else {"translation.scale"}

`state.config` is a `PublishedConfig` or a `KitConfig`.
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
from matplotlib.figure import Figure

from vo_lib.config import preset
from vo_lib.data.catalogue import available
from vo_lib.data.sequence import Sequence
from vo_lib.errors import DataError
from vo_lib.geometry.types import Image, Progress
from vo_lib.kit.settings import KitConfig
from vo_lib.paper.settings import MethodConfig
from vo_lib.runs.drive import single_threaded
from vo_lib.settings import declared, replace

from .colours import BAD, DARK
from .controls import COLUMN, Knob, labelled
from .controls import Control as Control
from .drawing import WIDTH, photo, stack
from .frames import DEFAULT, is_open, opened, remember_sequence, stereo, why_missing
from .progress import Job, Stopped
from .results import marked

ERROR_CLASS = "vo-panel-error"  # of CSS; tests search for it in saved widget state
VARIANTS = "published", "kit"
SWITCH = "the method as published, or the variant kit; grey controls are settings of the other variant"
RESET = "set all controls to their first values; the sequence does not change"
WORKING = '<i style="opacity:.7">working …</i>'
FRAME_MS = 700  # interval of frames that play; slower panels skip frames
# The picture is scaled down: on a laptop, the sentence and the numbers below are in view.
SCALED = {"max_width": "100%", "max_height": "max(240px, 100vh - 340px)", "align_self": "flex-start"}
PICTURE = {"width": "auto", "height": "auto", **SCALED}
BESIDE = {"flex": "1 1 480px", "min_width": "0", "max_width": f"{WIDTH}px"}
ERROR_STYLE = f"max-width:{WIDTH - 20}px;padding:4px 8px;border-left:4px solid {BAD}"


@dataclass(frozen=True)
class State:
    """State of the controls of a panel: all settings, the sequence, and the current frame >= 1."""

    config: MethodConfig
    view: Any
    sequence: Sequence
    frame: int


@dataclass(frozen=True)
class Fact:
    """A number below a picture, with `digits` decimals."""

    name: str
    value: float
    unit: str = ""
    digits: int = 0

    def text(self, before: float | None) -> str:
        """The number with its unit, and its change since `before`, as HTML."""
        space = "" if self.unit in ("", "°") else "&nbsp;"
        value = round(self.value, self.digits) + 0.0  # no minus before a zero
        shown = "–" if np.isnan(value) else f"{value:.{self.digits}f}{space}{html.escape(self.unit)}"
        change = np.nan if before is None else self.value - before
        if np.isnan(change) or abs(change) < 0.5 * 10.0**-self.digits:
            return shown
        return f'{shown} <span style="color:{DARK};opacity:.6">({change:+.{self.digits}f})</span>'


@dataclass(frozen=True)
class Drawing:
    """Pictures and figures, one below the other, a sentence about them, numbers, and tables as HTML."""

    parts: list[Image | Figure]
    sentence: str
    facts: tuple[Fact, ...] = ()
    tables: str = ""


def facts_html(sentence: str, facts: tuple[Fact, ...], before: dict[str, float]) -> str:
    """A sentence and a row of facts, each with its change since `before`."""
    cells = "".join(
        '<div style="margin:0 26px 4px 0">'
        f'<div style="font-size:11px;opacity:.7">{html.escape(fact.name)}</div>'
        f'<div style="font-size:15px">{fact.text(before.get(fact.name))}</div></div>'
        for fact in facts
    )
    return (
        f'<div style="max-width:{WIDTH}px;line-height:1.35">'
        f'<div style="margin:4px 0 6px">{marked(sentence)}</div>'
        f'<div style="display:flex;flex-wrap:wrap">{cells}</div></div>'
    )


class Panel:
    """Base of all panels. A cell whose last expression is a panel shows the panel.

    Class attributes
    ----------------
    title : a line above the controls.
    controls : controls from top to bottom. Settings with the prefix "view." are in `view`, all others in
        `start` or `kit`.
    view : class of the settings of the panel itself, declared with `setting`.
    start : configuration with the initial values of the controls.
    kit : configuration for the switch "published | kit"; if None, there is no switch.
    height : height of the picture, pixels.
    needs_truth : whether only the image and a sentence are shown for a sequence without poses.
    long_job : label of the Run button, if `work` takes more than a second; else empty.

    Attributes
    ----------
    error : a sentence about the error of the last change; empty without an error.
    picture : the Image widget; knobs : controls by the name of the setting; variant : the switch.
    facts : the numbers of the panel, by name; empty after an error.
    """

    title: ClassVar[str] = ""
    controls: ClassVar[tuple[Control, ...]] = ()
    view: ClassVar[type | None] = None
    start: ClassVar[MethodConfig] = preset("solution_selection")
    kit: ClassVar[KitConfig | None] = None
    height: ClassVar[int] = 600
    needs_truth: ClassVar[bool] = False
    long_job: ClassVar[str] = ""

    def __init__(self, sequence: str | Sequence = DEFAULT, frame: int = 60, **values: Any):
        """`values` are initial values of controls; a dot in a name is written as two underscores."""
        self._lock = threading.RLock()
        self._quiet = True
        self._sequence: Sequence | None = None
        self._home: Sequence | None = None  # the first sequence
        self._frames: dict[str, int] = {}  # last frame of each sequence
        self.facts: dict[str, float] = {}
        self.error = ""
        self.job = Job()
        self.picture = widgets.Image(value=self._white(), format="jpeg", layout=PICTURE)
        self._message, self._text, self.tables = (widgets.HTML(layout={"width": "100%"}) for _ in range(3))
        self._sign = widgets.HTML(layout={"margin": "0 0 0 12px"})
        self.variant = widgets.Dropdown(options=VARIANTS, tooltip=SWITCH, **labelled("method"))
        self.variant.observe(self.redraw, "value")
        self.knobs = self._make_knobs({key.replace("__", "."): value for key, value in values.items()})
        self._first = {"frame": frame, "variant": VARIANTS[0]}
        self._first |= {name: knob.widget.value for name, knob in self.knobs.items()}
        self.chooser = widgets.Dropdown(options=[*available()], value=None, **labelled("sequence"))
        self.folder = widgets.Text(placeholder="path of a folder", continuous_update=False, **labelled("or"))
        self.frame = widgets.IntSlider(
            value=frame, min=1, max=max(frame, 2), continuous_update=False, **labelled("frame")
        )
        self.chooser.observe(self._chosen, "value")
        self.folder.observe(self._typed, "value")
        self.frame.observe(self.redraw, "value")
        self.box = self._layout()
        name = sequence if isinstance(sequence, str) else remember_sequence(sequence)
        self._offer(name)
        self._quiet = False
        self._open(name)

    def draw(self, state: State) -> Drawing:
        """The picture and the words for a state; an exception is shown as the panel's error."""
        raise NotImplementedError

    def idle(self, state: State) -> set[str]:
        """Names of the controls that have no effect in a state; they become grey."""
        return set()

    def surface(self) -> Any:
        """The widget of the picture."""
        return self.picture

    def work(self, state: State, progress: Progress) -> None:
        """The job of the Run button before a redraw; it calls progress(done, total) several times per second."""
        raise NotImplementedError

    def set(self, **values: Any) -> None:
        """Set controls from code, including `frame` and `variant`, and draw once.

        A dot in the name of a setting is written as two underscores: panel.set(selection__top_k=3, frame=20).
        """
        if self._sequence is None:
            self.job.wait()
        self._quiet = True
        try:
            others = {"frame": self.frame, "variant": self.variant}
            for name, value in values.items():
                widget = others.get(name) or self.knobs[name.replace("__", ".")].widget
                widget.value = value
        finally:
            self._quiet = False
        self.redraw()

    def wait(self, seconds: float | None = None) -> None:
        """Wait for the end of the running job."""
        self.job.wait(seconds)

    def redraw(self, _: Any = None) -> None:
        """Draw the current state; an error is shown in the panel."""
        if self._quiet or self._sequence is None:
            return
        with self._lock, single_threaded():
            self._sign.value = WORKING
            try:
                state = self.state()
                idle = self.idle(state)
                for name, knob in self.knobs.items():
                    knob.shown.disabled = name in idle or self._lacks(state.config, name)
                if self.needs_truth and (lacking := why_missing(state.sequence)):
                    image = photo(stereo(state.sequence, state.frame)[0], height=self.height)
                    self._show(Drawing([image], lacking))
                else:
                    self._show(self.draw(state))
            except Exception as error:
                self._fail(error)
            finally:
                self._sign.value = ""

    def state(self) -> State:
        """The current state of the controls; `DataError` for an invalid typed value."""
        if self._sequence is None:
            raise DataError("choose a sequence first")
        view = None if self.view is None else self.view()
        config = self.kit if self.kit and self.variant.value == "kit" else self.start
        for name, knob in self.knobs.items():
            if name.startswith("view."):
                view = replace(view, name.removeprefix("view."), knob.value)
            elif not self._lacks(config, name):
                config = replace(config, name, knob.value)
        return State(config, view, self._sequence, int(self.frame.value))

    def run(self, _: Any = None) -> None:
        """Start the long job, as the Run button does."""
        try:
            state = self.state()
            self.job.start(self.long_job, lambda report: self.work(state, report), self.redraw, self._fail)
        except DataError as error:
            self._fail(error)

    def reset(self, _: Any = None) -> None:
        """Set all controls to their initial values; the sequence does not change."""
        self.set(**self._first)

    def _repr_mimebundle_(self, **options: Any) -> Any:
        return self.box._repr_mimebundle_(**options)

    def _show(self, drawing: Drawing) -> None:
        with self._lock:
            self._text.value = facts_html(drawing.sentence + self._elsewhere(), drawing.facts, self.facts)
            self.facts = {fact.name: fact.value for fact in drawing.facts}
            self.picture.value, self.tables.value = stack(drawing.parts, self.height), drawing.tables
            self.error = self._message.value = ""

    def _elsewhere(self) -> str:
        """A sentence if the sequence differs from the sequence of the cells; else ""."""
        here, home = self._sequence, self._home
        if here is None or home is None or here.folder == home.folder:
            return ""
        return f" (Only the panel shows {here.name}; the cells still use {home.name}.)"

    def _fail(self, error: Exception) -> None:
        if isinstance(error, Stopped):
            self._message.value = "<i>Stopped.</i>"
            return
        # The text of a DataError is for readers; for other errors, the type helps to find the mistake.
        self.error = str(error) if isinstance(error, DataError) else f"{type(error).__name__}: {error}"
        words = f'role="alert" style="{ERROR_STYLE}">{marked(self.error)}'
        self._message.value = f'<div class="{ERROR_CLASS}" {words}</div>'
        self._clear()

    def _not_opened(self, error: Exception) -> None:
        self._sequence = None
        self._clear()
        self._fail(error)

    def _clear(self) -> None:
        """Remove picture, sentence, numbers and tables."""
        self.picture.value, self._text.value, self.tables.value, self.facts = self._white(), "", "", {}

    def _white(self) -> bytes:
        return stack([np.full((2, WIDTH, 3), 255, np.uint8)], self.height)

    @staticmethod
    def _lacks(config: MethodConfig, name: str) -> bool:
        """Whether a configuration lacks a setting."""
        return not name.startswith("view.") and name not in {item.name for item in declared(type(config))}

    def _make_knobs(self, first: dict[str, Any]) -> dict[str, Knob]:
        own = declared(self.view, "view.") if self.view else ()
        settings = {item.name: (item, item.default) for item in own}
        for config in filter(None, (self.kit, self.start)):
            settings |= {item.name: (item, attrgetter(item.name)(config)) for item in declared(type(config))}
        knobs = {}
        for control in self.controls:
            setting, value = settings[control.name]
            knobs[control.name] = Knob(control, setting, first.pop(control.name, value))
            knobs[control.name].widget.observe(self.redraw, "value")
        if first:
            raise DataError(f"{sorted(first)[0]}: the panel has no such control")
        return knobs

    def _layout(self) -> Any:
        reset = widgets.Button(description="reset", icon="undo", tooltip=RESET, layout={"width": "80px"})
        reset.on_click(self.reset)
        play = widgets.Play(min=1, interval=FRAME_MS, show_repeat=False)
        for name in ("max", "value"):  # an earlier value is cut off at the maximum
            widgets.jslink((self.frame, name), (play, name))
        switch = [self.variant] if self.kit else []
        controls = [self.chooser, self.folder, self.frame, widgets.HBox([play, reset]), *switch]
        controls += [knob.shown for knob in self.knobs.values()]
        if self.long_job:
            controls.append(widgets.Button(description=self.long_job, icon="play", layout={"width": "auto"}))
            controls[-1].on_click(self.run)
        shown = [self.job.box, self._message, self.surface(), self._text]
        columns = [widgets.VBox(controls, layout=COLUMN), widgets.VBox(shown, layout=BESIDE)]
        title = widgets.HTML(f"<b>{html.escape(self.title)}</b>")
        rows = [widgets.HBox([title, self._sign]), widgets.HBox(columns, layout={"flex_flow": "row wrap"})]
        return widgets.VBox([*rows, self.tables], layout={"padding": "4px 8px", "border": "1px solid #BBB"})

    def _offer(self, name: str) -> None:
        """Choose a sequence, and add it to the list if necessary."""
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
        """Choose a sequence and draw; a sequence that is not open is opened by a job with a bar."""
        if is_open(name):
            self._use(opened(name))
        else:
            job = f"opening {name}", lambda report: opened(name, report), self._use, self._not_opened
            self.job.start(*job)

    def _use(self, sequence: Sequence) -> None:
        with self._lock:
            quiet, self._quiet = self._quiet, True
            if self._sequence is not None:
                self._frames[self._sequence.name] = self.frame.value
            self._sequence, self._home, self.facts = sequence, self._home or sequence, {}
            self.frame.max = len(sequence) - 1
            self.frame.value = self._frames.get(sequence.name, self.frame.value)  # or its maximum
            self._quiet = quiet
        self.redraw()
