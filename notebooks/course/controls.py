"""Controls for declared settings; range, unit and description are from the settings classes."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import ipywidgets as widgets

from vo_lib.errors import DataError
from vo_lib.settings import Setting, as_typed

from .drawing import COARSE, room

MOST_DECIMALS = 9  # of the value of a slider
STEPS = 100  # of a slider at most, if no step is given

_dragged = ContextVar("dragged", default=False)


def is_dragged() -> bool:
    """Whether the change that is handled came from a slider in the browser, and not from code."""
    return _dragged.get()


@contextmanager
def _dragging() -> Iterator[None]:
    token = _dragged.set(True)
    try:
        yield
    finally:
        _dragged.reset(token)


@contextmanager
def about(label: str, remedy: str = "") -> Iterator[None]:
    """A block that uses the value of a control: a `DataError` then begins with its label, and ends with a remedy."""
    try:
        yield
    except DataError as error:
        end = f"; {remedy}" if remedy else ""
        raise DataError(f"{label}: {error}{end}") from None


def typed_path(text: str) -> Path:
    """A path as typed into a control; ~ is the home folder."""
    # Unlike Path.expanduser, this leaves an unknown user's ~ as it is, so that the message names the path.
    return Path(os.path.expanduser(text.strip()))


class WholeSlider(widgets.IntSlider):  # type: ignore[misc]  # ipywidgets has no types
    """A slider of whole numbers; `is_dragged` is true while a change from the browser is handled."""

    def set_state(self, sync_data: Any) -> None:
        """Take a value that the browser has sent."""
        with _dragging():
            super().set_state(sync_data)


class RealSlider(widgets.FloatSlider):  # type: ignore[misc]
    """A slider of real numbers; `is_dragged` is true while a change from the browser is handled."""

    def set_state(self, sync_data: Any) -> None:
        """Take a value that the browser has sent, without its rounding error.

        When the browser shows a slider at 100, it may send 99.99999999999999, which would be another state.
        """
        if "value" in sync_data:
            sync_data = {**sync_data, "value": round(sync_data["value"], MOST_DECIMALS)}
        with _dragging():
            super().set_state(sync_data)


@dataclass(frozen=True)
class Control:
    """One control of a panel.

    Attributes
    ----------
    name : dotted name of a setting: "selection.top_k" for the method, or "view.noise" for the panel.
    label : words at the control; by default the last part of the name.
    low, high : ends of the slider, if narrower than the declared range.
    step : step of the slider.
    button : whether a button replaces the slider; a press adds one, or changes the maximum to the minimum.
    """

    name: str
    label: str = ""
    low: float | None = None
    high: float | None = None
    step: float | None = None
    button: bool = False

    @property
    def words(self) -> str:
        """The label without the unit."""
        return self.label or self.name.split(".")[-1].replace("_", " ")


class Knob:
    """A control. `widget` has the value; `shown` is displayed, with the setting's description as tooltip."""

    def __init__(self, control: Control, setting: Setting, value: Any):
        self.control = control
        self.setting = setting
        label = f"{control.words} [{setting.unit}]" if setting.unit else control.words
        self.widget = _make(control, setting, value, label)
        self.shown = self.widget
        if control.button:
            self.shown = widgets.Button(description=label, tooltip=setting.text, layout={"width": "auto"})
            self.shown.on_click(self._press)
        self._declared_max = getattr(self.widget, "max", None)

    @property
    def value(self) -> Any:
        """The value of the setting; `DataError` if typed text is invalid."""
        raw = self.widget.value
        if not isinstance(self.widget, widgets.Text):
            return raw
        # The reader knows the control by its label, not by the name of the setting.
        setting = dataclasses.replace(self.setting, name=self.control.words)
        try:
            return setting.parse(raw)
        except DataError:
            if raw.strip(" ,"):
                raise
            example = as_typed(setting.default)
            raise DataError(f"{setting.name}: type {setting.describe()}, such as {example}") from None

    def offer(self, setting: Setting, default: Any) -> None:
        """Offer the choices that a variant declares; an impossible choice becomes the default."""
        if not isinstance(self.widget, widgets.Dropdown) or self.widget.options == setting.choices:
            return
        value = self.widget.value
        self.widget.options = setting.choices
        self.widget.value = value if value in setting.choices else default

    def limit(self, most: float | None = None) -> None:
        """End the slider at `most`, or again where it is declared to end."""
        if self._declared_max is not None:
            self.widget.max = self._declared_max if most is None else min(most, self._declared_max)

    def show(self, possible: bool) -> None:
        """Show the control, or hide it if the variant lacks its setting."""
        self.shown.layout.display = None if possible else "none"
        if not possible:
            self.shown.disabled = True

    def activate(self, active: bool) -> None:
        """Make a control grey that has no effect."""
        self.shown.disabled = not active

    def _press(self, _: Any) -> None:
        at_end = self.widget.value >= self.widget.max
        self.widget.value = self.widget.min if at_end else self.widget.value + 1


def labelled(words: str) -> dict[str, Any]:
    """Arguments of a widget for its label and for the width of the column."""
    return {"description": words, "layout": {"width": "auto"}}


def _make(control: Control, setting: Setting, value: Any, label: str) -> Any:
    common = {"tooltip": setting.text, **labelled(label)}
    if setting.kind is bool:
        return widgets.Checkbox(value=value, indent=False, **common)
    if setting.choices:
        return widgets.Dropdown(value=value, options=setting.choices, **common)
    if setting.is_list or setting.kind is str:
        return widgets.Text(value=as_typed(value), continuous_update=False, **common)
    low = setting.low if control.low is None else control.low
    high = setting.high if control.high is None else control.high
    if low is None or high is None:
        raise ValueError(f"{setting.name} has no range: a slider needs one")
    limits = {"min": setting.kind(low), "max": setting.kind(high), "value": setting.kind(value)}
    if control.button:
        return widgets.BoundedIntText(**limits)
    if setting.kind is int:
        return WholeSlider(**limits, step=control.step or 1, **common)
    step = control.step or room((high - low) / STEPS, steps=COARSE)
    return RealSlider(**limits, step=step, readout_format=f".{_decimals(step)}f", **common)


def _decimals(step: float) -> int:
    """Number of decimals that show every step."""
    return next(digits for digits in range(MOST_DECIMALS) if abs(round(step, digits) - step) < 1e-9)
