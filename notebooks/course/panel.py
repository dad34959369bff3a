"""The base class of all panels: a column of controls beside a picture of fixed size, a sentence and numbers.

A new panel defines `title`, `controls` and `draw(state)`, and often `view`, the class of its own settings:

    @dataclass(frozen=True)
    class NoiseView(Checked):
        noise: float = setting(0.1, "noise added to each coordinate", unit="px", low=0, high=2)

    class NoisePanel(Panel):
        title = "Noise on the matches"
        view = NoiseView
        kit = preset("solution_selection", variant="kit")
        controls = (Control("view.noise", "noise added", high=0.8), Control("translation.scale", "scale s"))

        def draw(self, state: State) -> Drawing:
            matches = frame_matches(state.sequence, state.frame, state.config)
            ...
            return Drawing([picture, chart], "One sentence.", (Fact("error", error, "mm", 1),))

        def idle(self, state: State) -> set[str]:
            return {"translation.scale"} if state.view.noise == 0 else set()

What it has without a word of its own:

- a slider, menu, tick box, text or button for each control, with range, unit and description of the setting;
- the choice of a sequence or a folder, with a bar while a scene is drawn; the frame, and a button that plays;
- a reset, and, with a configuration `kit`, the switch between the variants `published` and `kit`, which hides
  the controls of settings that a variant lacks; `idle` names further controls that become grey;
- a picture that follows the drag: the browser sends the newest value when the last redraw has ended;
- with `steps`, for a picture of more than 80 ms: while the slider moves, what the first steps give, marked as
  unfinished and without numbers; as soon as it rests, the whole. `set` and other changes by code draw the whole;
- the change of each number since the control was first touched;
- an error as a sentence, in which settings have the names of their controls; the old picture becomes pale;
- after a stop, or for a sequence that cannot be opened, the sequence, picture and numbers shown before;
- the layout for a laptop, keys for each control, names for screen readers, and descriptions as tooltips.

What it has to keep: equal states have equal pictures, so `draw` uses only `state`, and seeds all that is
random. Code that reads what a control names, such as a file, is in a block of `about`, so that an error begins
with the label of the control. A picture takes at most 80 ms of processor time, else it does not follow: what
several states share belongs into a `Memory`, an axis whose limits are round numbers (`room`) and a text at the
same place are drawn only once, `numbers_at` puts the numbers of an axis faster than `set_ticks`, and a method
that runs over many frames yields `steps`. All parts of the picture are `WIDTH` pixels wide; with more than 550
rows, its text becomes too small on a laptop. Callbacks run on another thread than cells, so nothing here uses
pyplot.

`tests/course/test_panels.py` drives every control of every panel that a chapter exports.
"""

from __future__ import annotations

import dataclasses
import html
import json
import re
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from operator import attrgetter
from pathlib import Path
from typing import Any, ClassVar

import ipywidgets as widgets
import numpy as np
from matplotlib.figure import Figure

from vo_lib.config import preset
from vo_lib.data.sequence import Sequence
from vo_lib.errors import DataError
from vo_lib.geometry.types import Image, Progress
from vo_lib.kit.settings import KitConfig
from vo_lib.paper.settings import MethodConfig
from vo_lib.runs.drive import single_threaded
from vo_lib.settings import Setting, declared, replace

from .colours import BAD, DARK
from .controls import Control as Control
from .controls import Knob, WholeSlider, is_dragged, labelled, typed_path
from .drawing import WIDTH, photo, shortened, stack
from .frames import (
    DEFAULT,
    are_same,
    is_open,
    listed,
    long_name,
    opened,
    remember_as,
    remember_sequence,
    stereo,
    why_missing,
)
from .opening import Opening
from .progress import LABEL_LENGTH, Job, Stopped
from .redraws import Redraws
from .results import marked

ERROR_CLASS = "vo-panel-error"  # of CSS; tests search for it in saved widget state
STALE_CLASS = "vo-stale"  # of CSS: a picture of an earlier state
VARIANTS = "published", "kit"
SWITCH = "the method as published, or the variant kit; each shows the controls of its own settings"
FOLDER = "a folder with a sequence in KITTI's layout"
FRAME = "the frame that is shown; its matches are with the frame before"
PATH = "or path"  # label of the control for a folder
NAME_LENGTH = 19  # characters of a sequence's name in the list
RESET = "set all controls to their first values; the sequence does not change"
SINCE = "in brackets: the change since the control was touched"
NO_SEQUENCE = "choose a sequence first"
WORKING = '<i class="vo-late">working …</i>'
UNFINISHED = "<i>unfinished picture …</i>"
FEWEST_FRAMES = 2  # of a sequence: each picture is about a step between two
MORE_STEPS_S = 0.2  # processor time of the steps before a further unfinished picture
FRAME_MS = 700  # interval of frames that play; slower panels skip frames
STYLE = Path(__file__).with_name("panel.html").read_text(encoding="utf-8")
# Beside the picture, controls are as narrow as sliders of 180 px allow.
COLUMN = {"flex": "0 0 252px", "margin": "0 12px 0 0"}
BESIDE = {"flex": "1 1 480px", "min_width": "0", "max_width": f"{WIDTH}px"}
# The picture is scaled down: on a laptop, the sentence and the numbers below are in view.
SCALED = {"max_width": "100%", "max_height": "max(240px, 100vh - 270px)", "align_self": "flex-start"}
PICTURE = {"width": "auto", "height": "auto", **SCALED}
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
        change_shown = f"({change:+.{self.digits}f})"
        return f'{shown} <span style="color:{DARK};opacity:.6" title="{SINCE}">{change_shown}</span>'


@dataclass(frozen=True, eq=False)
class Drawing:
    """What a panel shows for a state.

    Attributes
    ----------
    parts : pictures and figures, one below the other. sentence : words about them.
    facts : numbers. tables : tables as HTML.
    limits : the largest possible value of a control in this state, by the name of the setting.
    """

    parts: list[Image | Figure]
    sentence: str
    facts: tuple[Fact, ...] = ()
    tables: str = ""
    limits: Mapping[str, float] = field(default_factory=dict)

    @property
    def numbers(self) -> dict[str, float]:
        """The values of the facts by their names."""
        return {fact.name: fact.value for fact in self.facts}


def facts_html(sentence: str, facts: tuple[Fact, ...], before: dict[str, float]) -> str:
    """A sentence and a row of facts, each with its change since `before`."""
    cells = "".join(
        '<div style="margin:0 20px 3px 0">'
        f'<div style="font-size:11px;opacity:.7">{html.escape(fact.name)}</div>'
        f'<div style="font-size:15px">{fact.text(before.get(fact.name))}</div></div>'
        for fact in facts
    )
    return (
        f'<div style="max-width:{WIDTH}px;line-height:1.3">'
        f'<div style="margin:2px 0 4px">{marked(sentence)}</div>'
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
    first_steps_s : processor time of the `steps` before the first picture of a drag, which with the picture
        should take 80 ms at most.
    long_job : label of the Run button, if `work` takes more than a second; else empty.

    Attributes
    ----------
    error : a sentence about the error of the last change; empty without an error.
    opening : the sequence that is shown, and the one that is opened.
    picture : the Image widget; knobs : controls by the name of the setting; variant : the switch.
    first : initial values of all controls, by name.
    facts : the numbers of the panel, by name; empty after an error.
    """

    title: ClassVar[str] = ""
    controls: ClassVar[tuple[Control, ...]] = ()
    view: ClassVar[type | None] = None
    start: ClassVar[MethodConfig] = preset("solution_selection")
    kit: ClassVar[KitConfig | None] = None
    height: ClassVar[int] = 550
    needs_truth: ClassVar[bool] = False
    first_steps_s: ClassVar[float] = 0.04
    long_job: ClassVar[str] = ""

    def __init__(self, sequence: str | Sequence = DEFAULT, frame: int = 60, **values: Any):
        """`values` are initial values of controls; a dot in a name is written as two underscores."""
        self.redraws = Redraws()
        self.facts: dict[str, float] = {}
        self.error = ""
        self.job = Job()
        self.opening = Opening()
        self._sequence: Sequence | None = None
        self._home: Sequence | None = None  # the first sequence
        self._given: dict[str, Sequence] = {}  # sequences that were given, by their names in the list
        self._frames: dict[str, int] = {}  # last frame of each sequence, by its name in the list

        self.knobs = self._make_knobs({key.replace("__", "."): value for key, value in values.items()})
        self.variant = widgets.Dropdown(options=VARIANTS, tooltip=SWITCH, **labelled("method"))
        self.frame = WholeSlider(value=frame, min=1, max=max(frame, 2), tooltip=FRAME, **labelled("frame"))
        self.first = {name: knob.widget.value for name, knob in self.knobs.items()}
        self.first |= {"frame": frame, "variant": VARIANTS[0]}
        names = [_named(name) for name in listed()]
        self.chooser = widgets.Dropdown(options=names, value=None, **labelled("sequence"))
        self.folder = widgets.Text(
            placeholder="a folder", tooltip=FOLDER, continuous_update=False, **labelled(PATH)
        )

        self.picture = widgets.Image(value=self._white(), format="jpeg", layout=PICTURE)
        self.tables = widgets.HTML(layout={"width": "100%"})
        self._message = widgets.HTML(layout={"width": "100%"})
        self._text = widgets.HTML(layout={"width": "100%"}).add_class("vo-words")
        self._sign = widgets.HTML(layout={"margin": "0 0 0 12px"})
        self._tips = widgets.HTML(layout={"display": "none"})
        self.box = self._layout()

        if isinstance(sequence, str):
            name = sequence
        else:
            name = remember_sequence(sequence)
            self._given[name] = sequence
        self._offer(name)
        self._give_tips()
        self._follow_variant()
        self._observe()
        self._open(name)

    def draw(self, state: State) -> Drawing:
        """The picture and the words for a state; an exception is shown as the panel's error."""
        raise NotImplementedError

    def steps(self, state: State) -> Iterator[Callable[[], Drawing]]:
        """The work for a state in pieces of at most 20 ms, if a picture takes more than 80 ms.

        The panel stops between two pieces when the control moves on. A piece yields a function that draws what
        is done so far, with a sentence that says what is missing; its numbers are not shown. Results belong
        into a `Memory`, from which `draw` takes them at the end.
        """
        return iter(())

    def idle(self, state: State) -> set[str]:
        """Names of the controls that have no effect in a state; they become grey."""
        return set()

    def surface(self) -> Any:
        """The widget of the picture."""
        return self.picture

    def work(self, state: State, progress: Progress) -> None:
        """The job of the Run button before a redraw; it calls progress(done, total) several times per second."""
        raise NotImplementedError

    def is_ready(self, name: str) -> bool:
        """Whether the panel can show the sequence as `opened` gives it, without a call of `prepare`.

        So a panel with a `prepare` of its own returns False.
        """
        return is_open(name)

    def prepare(self, name: str, progress: Progress) -> Sequence:
        """The sequence that the panel shows, by name or folder; if not ready, it is prepared with a bar."""
        return opened(name, progress)

    def set(self, **values: Any) -> None:
        """Set controls from code, including `frame` and `variant`, and draw once.

        A dot in the name of a setting is written as two underscores: panel.set(selection__top_k=3, frame=20).
        """
        if self._sequence is None:
            self.job.wait()
        named = {name.replace("__", "."): value for name, value in values.items()}
        with self.redraws.held():
            if "variant" in named:
                self.variant.value = named.pop("variant")
            if "frame" in named:
                self.frame.value = named.pop("frame")
            self._follow_variant()  # whose choices the values are among
            for name, value in named.items():
                self.knobs[name].limit()  # the limit of the state before does not hold any more
                self.knobs[name].widget.value = value
        self.redraw()

    def wait(self, seconds: float | None = None) -> None:
        """Wait for the end of the running job, and until the picture is finished."""
        self.job.wait(seconds)
        self.redraws.wait(seconds)

    def redraw(self, change: Any = None) -> None:
        """Draw the current state; an error is shown in the panel.

        change : the change of a control that a widget reports; None for a change by code.
        """
        touched = None if change is None else change["owner"]
        with self.redraws.one() as allowed, single_threaded():
            if not allowed:
                return
            if self._sequence is None:
                if not (self.opening.pending or self.error):  # an error says why there is none
                    self._complain(DataError(NO_SEQUENCE))
                return
            self._sign.value = WORKING
            before = self.redraws.before(touched)
            try:
                self._follow_variant()
                state = self.state()
                self._show_idle(state)
                if is_dragged() and not self._missing(state):
                    self._begin(state, before)
                else:
                    self._finish(state, before)
            except Exception as error:
                self._fail(error)

    def state(self) -> State:
        """The current state of the controls; `DataError` for an invalid typed value."""
        if self._sequence is None:
            raise DataError(NO_SEQUENCE)
        view = None if self.view is None else self.view()
        config = self._config()
        for name, knob in self.knobs.items():
            if name.startswith("view."):
                view = replace(view, name.removeprefix("view."), knob.value)
            elif name in _settings(config):
                config = replace(config, name, knob.value)
        return State(config, view, self._sequence, int(self.frame.value))

    def run(self, _: Any = None) -> None:
        """Start the long job, as the Run button does."""
        try:
            state = self.state()
            self.job.start(
                self.long_job, lambda report: self.work(state, report), lambda _: self.redraw(), self._fail
            )
        except DataError as error:
            self._fail(error)

    def reset(self, _: Any = None) -> None:
        """Set all controls to their initial values; the sequence does not change."""
        self.set(**self.first)

    def _repr_mimebundle_(self, **options: Any) -> Any:
        return self.box._repr_mimebundle_(**options)

    def _config(self) -> MethodConfig:
        """The configuration of the chosen variant, before the values of the controls."""
        if self.kit is not None and self.variant.value == "kit":
            return self.kit
        return self.start

    def _missing(self, state: State) -> str:
        """A sentence if the sequence lacks the truth that the panel needs; else ""."""
        return why_missing(state.sequence) if self.needs_truth else ""

    def _begin(self, state: State, before: dict[str, float]) -> None:
        """Draw what the first steps give; a thread does the other steps, until the control moves on."""
        steps = self.steps(state)
        end = time.thread_time() + self.first_steps_s
        for so_far in steps:
            if time.thread_time() >= end:
                self._show_part(so_far())
                self.redraws.finish_later(lambda is_wanted: self._go_on(steps, state, before, is_wanted))
                return
        self._finish(state, before)

    def _go_on(
        self,
        steps: Iterator[Callable[[], Drawing]],
        state: State,
        before: dict[str, float],
        is_wanted: Callable[[], bool],
    ) -> None:
        """The other steps, with a picture from time to time, and the finished picture."""
        try:
            with single_threaded():
                end = time.thread_time() + MORE_STEPS_S
                for so_far in steps:
                    if not is_wanted():
                        return
                    if time.thread_time() >= end:
                        with self.redraws.still(is_wanted) as wanted:
                            if wanted:
                                self._show_part(so_far())
                        end = time.thread_time() + MORE_STEPS_S
                with self.redraws.still(is_wanted) as wanted:
                    if wanted:
                        self._finish(state, before)
        except Exception as error:
            with self.redraws.still(is_wanted) as wanted:
                if wanted:
                    self._fail(error)

    def _finish(self, state: State, before: dict[str, float]) -> None:
        """Show all of a state; without the truth that the panel needs, the image alone."""
        missing = self._missing(state)
        if missing:
            image = photo(stereo(state.sequence, state.frame)[0], height=self.height)
            drawing = Drawing([image], missing)
        else:
            drawing = self.draw(state)
        self._show(drawing, before)
        self.redraws.shown(drawing.numbers)
        self._sign.value = ""

    def _show_part(self, drawing: Drawing) -> None:
        """Show an unfinished picture, with dashes as numbers."""
        facts = tuple(dataclasses.replace(fact, value=np.nan) for fact in drawing.facts)
        self._show(dataclasses.replace(drawing, facts=facts), {})
        self._sign.value = UNFINISHED

    def _follow_variant(self) -> None:
        """Show the controls and the choices that the variant has, and hide the others.

        A choice that the variant lacks becomes the one of its configuration.
        """
        config = self._config()
        settings = _settings(config)
        with self.redraws.held():
            for name, knob in self.knobs.items():
                knob.show(name.startswith("view.") or name in settings)
                if name in settings:
                    knob.offer(settings[name], attrgetter(name)(config))

    def _show_idle(self, state: State) -> None:
        """Make the controls grey that have no effect in a state."""
        idle = self.idle(state)
        settings = _settings(state.config)
        for name, knob in self.knobs.items():
            if name.startswith("view.") or name in settings:
                knob.activate(name not in idle)

    def _show(self, drawing: Drawing, before: dict[str, float]) -> None:
        self._text.value = facts_html(drawing.sentence + self._elsewhere(), drawing.facts, before)
        self.facts = drawing.numbers
        self.picture.value = stack(drawing.parts, self.height)
        self.picture.remove_class(STALE_CLASS)
        self.tables.value = drawing.tables
        self.error = ""
        self._message.value = ""
        with self.redraws.held():
            for name, most in drawing.limits.items():
                self.knobs[name].limit(most)

    def _elsewhere(self) -> str:
        """A sentence if the sequence differs from the sequence of the cells; else ""."""
        here = self._sequence
        home = self._home
        if here is None or home is None or are_same(here, home):
            return ""
        shown = here.name
        used = home.name
        if shown == used:
            shown = long_name(here)
            used = long_name(home)
        shown = shortened(shown, LABEL_LENGTH)
        used = shortened(used, LABEL_LENGTH)
        return f" (Only the panel shows {shown}; the cells still use {used}.)"

    def _fail(self, error: Exception) -> None:
        """Say what is wrong in place of the words; the old picture stays, but pale."""
        self._sign.value = ""
        if isinstance(error, Stopped):
            self._message.value = "<i>Stopped.</i>"
            return
        self._complain(error)
        self.picture.add_class(STALE_CLASS)
        self._clear_words()

    def _complain(self, error: Exception, remark: str = "") -> None:
        """Show an error, and a remark behind it."""
        sentence = self._error_words(error)
        self.error = sentence
        said = f"{sentence.rstrip('.')}.{remark}" if remark else sentence
        words = f'role="alert" style="{ERROR_STYLE}">{marked(said)}'
        self._message.value = f'<div class="{ERROR_CLASS}" {words}</div>'

    def _error_words(self, error: Exception) -> str:
        """An error as a sentence in which settings have the labels of their controls, as the reader knows them."""
        # The text of a DataError is for readers; for other errors, the type helps to find the mistake.
        sentence = str(error) if isinstance(error, DataError) else f"{type(error).__name__}: {error}"
        for name, knob in self.knobs.items():
            sentence = re.sub(rf"(?<![\w.]){re.escape(name)}(?![\w.])", knob.control.words, sentence)
        return sentence

    def _not_opened(self, choice: int, error: Exception) -> None:
        """Say why the sequence of a choice is not shown; the one shown before stays, also in the list."""
        with self.redraws.held():
            if not self.opening.is_wanted(choice):
                return
            name = self.opening.wanted
            if isinstance(error, DataError):
                label = PATH if name == str(typed_path(self.folder.value)) else "sequence"
                error = DataError(f"{label}: {error}")
            self.opening.give_up()
            shown = self.opening.shown
            self.chooser.value = shown
            remark = f" The panel still shows {shown}." if shown else " Choose a sequence."
            if isinstance(error, Stopped):
                self._message.value = f"<i>Stopped: {html.escape(f'{name} is not opened.{remark}')}</i>"
            else:
                self._complain(error, remark)

    def _clear_words(self) -> None:
        """Remove sentence, numbers and tables."""
        self._text.value = ""
        self.tables.value = ""
        self.facts = {}
        self.redraws.shown({})

    def _clear(self) -> None:
        """Remove also the picture."""
        self._clear_words()
        self.picture.value = self._white()

    def _white(self) -> bytes:
        return stack([np.full((2, WIDTH, 3), 255, np.uint8)], self.height)

    def _make_knobs(self, first: dict[str, Any]) -> dict[str, Knob]:
        """A knob for each control; `first` has initial values that are not those of the configuration."""
        settings: dict[str, tuple[Setting, Any]] = {}
        if self.view is not None:
            settings |= {item.name: (item, item.default) for item in declared(self.view, "view.")}
        for config in (self.kit, self.start):
            if config is not None:
                settings |= {
                    name: (item, attrgetter(name)(config)) for name, item in _settings(config).items()
                }
        unknown = first.keys() - {control.name for control in self.controls}
        if unknown:
            raise DataError(f"{min(unknown)}: the panel has no such control")
        knobs = {}
        for control in self.controls:
            setting, value = settings[control.name]
            knobs[control.name] = Knob(control, setting, first.get(control.name, value))
        return knobs

    def _observe(self) -> None:
        """Draw after each change of a control."""
        for knob in self.knobs.values():
            knob.widget.observe(self.redraw, "value")
        self.variant.observe(self.redraw, "value")
        self.frame.observe(self.redraw, "value")
        self.chooser.observe(self._give_tips, ("value", "options"))
        self.chooser.observe(lambda change: self._open(change["new"]), "value")
        self.folder.observe(self._typed, "value")

    def _layout(self) -> Any:
        """All widgets: the title, then controls beside picture and words, then tables."""
        reset = widgets.Button(description="reset", icon="undo", tooltip=RESET, layout={"width": "80px"})
        reset.on_click(self.reset)
        play = widgets.Play(min=1, interval=FRAME_MS, show_repeat=False)
        for name in ("max", "value"):  # an earlier value is cut off at the maximum
            widgets.jslink((self.frame, name), (play, name))
        controls = [self.chooser, self.folder, self.frame, widgets.HBox([play, reset])]
        if self.kit is not None:
            controls.append(self.variant)
        controls += [knob.shown for knob in self.knobs.values()]
        if self.long_job:
            run = widgets.Button(description=self.long_job, icon="play", layout={"width": "auto"})
            run.on_click(self.run)
            controls.append(run)
        left = widgets.VBox(controls, layout=COLUMN)
        # A message takes the place of the words: the picture does not move.
        right = widgets.VBox([self.job.box, self.surface(), self._message, self._text], layout=BESIDE)
        title = widgets.HTML(f"<b>{html.escape(self.title)}</b>{STYLE}")
        head = widgets.HBox([title, self._sign, self._tips])
        middle = widgets.HBox([left, right], layout={"flex_flow": "row wrap"})
        box = widgets.VBox([head, middle, self.tables])
        box.layout.padding = "2px 8px"
        box.layout.border = "1px solid #BBB"
        return box.add_class("vo-panel")

    def _give_tips(self, _: Any = None) -> None:
        """Tell the page the descriptions of controls, and the whole names of sequences.

        A menu, text or tick box of ipywidgets with a label does not show its tooltip.
        """
        widgets_of = (self.folder, self.variant, *(knob.shown for knob in self.knobs.values()))
        tips = {widget.description: widget.tooltip for widget in widgets_of}
        tips[self.chooser.description] = self.chooser.value or ""
        names = [name for _, name in self.chooser.options]
        tips_data = html.escape(json.dumps(tips))
        names_data = html.escape(json.dumps(names))
        self._tips.value = f'<span data-tips="{tips_data}" data-names="{names_data}"></span>'

    def _offer(self, name: str) -> None:
        """Choose a sequence, and add it to the list if necessary."""
        options = self.chooser.options
        if _named(name) not in options:
            self.chooser.value = None  # else new options choose the first one, before the next line does
            self.chooser.options = [_named(name), *options]
        self.chooser.value = name

    def _typed(self, change: Any) -> None:
        if change["new"].strip():
            self._offer(str(typed_path(change["new"])))

    def _open(self, name: str | None) -> None:
        """Choose a sequence and draw; a sequence that is not ready is prepared by a job with a bar.

        A choice takes the place of one that is still being opened.
        """
        with self.redraws.held():
            if name is None or name == self.opening.wanted:
                return  # the panel itself has set the list
            was_pending = self.opening.pending
            choice = self.opening.choose(name)
            if was_pending:
                self.job.stop()  # after the choice: what it says of the one before is not wanted any more
            self.chooser.value = name  # also if a late error has just set it back
            if not self.opening.pending:
                return  # back to what is shown
        try:
            if name in self._given:
                remember_as(name, self._given[name])  # since then, it may have been forgotten
            if self.is_ready(name):
                self._use(opened(name), choice)
            else:
                self._start_opening(name, choice)
        except Exception as error:
            self._not_opened(choice, error)

    def _start_opening(self, name: str, choice: int) -> None:
        """Start the job that prepares the sequence of a choice."""
        with self.opening.starts:
            if self.opening.is_wanted(choice):
                self.job.start(
                    f"opening {name}",
                    lambda report: self.prepare(name, report),
                    lambda sequence: self._use(sequence, choice),
                    lambda error: self._not_opened(choice, error),
                )

    def _use(self, sequence: Sequence, choice: int) -> None:
        """Show the sequence of a choice, if it is still wanted, at the frame that it had before."""
        if len(sequence) < FEWEST_FRAMES:
            raise DataError(f"{sequence.name}: a panel needs at least {FEWEST_FRAMES} frames")
        with self.redraws.held():
            if not self.opening.is_wanted(choice):
                return
            before = self.opening.shown
            self.opening.succeed()
            if before is not None:
                self._frames[before] = self.frame.value
                self._clear()  # an error must not leave the picture of another sequence
            self._sequence = sequence
            self._home = self._home or sequence
            self.facts = {}
            self.redraws.forget()
            self.frame.max = len(sequence) - 1
            self.frame.value = self._frames.get(self.opening.shown or "", self.frame.value)  # or its maximum
        self.redraw()


def _named(name: str) -> tuple[str, str]:
    """A sequence as an option of the list: the words that are shown, and its name."""
    return shortened(name, NAME_LENGTH), name


def _settings(config: MethodConfig) -> dict[str, Setting]:
    """The declared settings of a configuration, by dotted name."""
    return {item.name: item for item in declared(type(config))}
