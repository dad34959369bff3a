"""Controls for declared settings; range, unit and description are from the settings classes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import ipywidgets as widgets

from vo_lib.settings import Setting

COLUMN = {"flex": "0 1 320px", "min_width": "260px", "margin": "0 12px 0 0"}  # of controls
LABEL_WIDTH = "156px"  # of the longest label; aligns the sliders
STEPS = 100  # of a slider, if no step is given


@dataclass(frozen=True)
class Control:
    """One control of a panel.

    Attributes
    ----------
    name : dotted name of a setting: "selection.top_k" for the method, or "view.noise" for the panel.
    label : words beside the control; by default the last part of the name.
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


class Knob:
    """A control. `widget` has the value; `shown` is displayed, with the setting's description as tooltip."""

    def __init__(self, control: Control, setting: Setting, value: Any):
        self.setting = setting
        unit = f" [{setting.unit}]" if setting.unit else ""
        label = (control.label or setting.name.split(".")[-1].replace("_", " ")) + unit
        self.widget = self.shown = _make(control, setting, value, label)
        if control.button:
            self.shown = widgets.Button(description=label, tooltip=setting.text, layout={"width": "auto"})
            self.shown.on_click(self._press)

    def _press(self, _: Any) -> None:
        self.widget.value = self.widget.min if self.widget.value >= self.widget.max else self.widget.value + 1

    @property
    def value(self) -> Any:
        """The value of the setting; `DataError` if typed text is invalid."""
        raw = self.widget.value
        return self.setting.parse(raw) if isinstance(self.widget, widgets.Text) else raw


def labelled(words: str) -> dict[str, Any]:
    """Arguments of a widget for a label in front of it and for the width of the column."""
    style = {"description_width": LABEL_WIDTH}
    return {"description": words, "style": style, "layout": {"width": "auto"}}


def _make(control: Control, setting: Setting, value: Any, label: str) -> Any:
    common = {"tooltip": setting.text, **labelled(label)}
    if setting.kind is bool:
        return widgets.Checkbox(value=value, indent=False, **common)
    if setting.choices:
        return widgets.Dropdown(value=value, options=list(setting.choices), **common)
    if setting.kind not in (int, float):
        words = ",".join(map(str, value)) if isinstance(value, tuple) else str(value)
        return widgets.Text(value=words, continuous_update=False, **common)
    low = setting.low if control.low is None else control.low
    high = setting.high if control.high is None else control.high
    if low is None or high is None:
        raise ValueError(f"{setting.name} has no range: a slider needs one")
    limits = {"min": setting.kind(low), "max": setting.kind(high), "value": setting.kind(value)}
    if control.button:
        return widgets.BoundedIntText(**limits)
    slider = widgets.IntSlider if setting.kind is int else widgets.FloatSlider
    step = control.step or (1 if setting.kind is int else (high - low) / STEPS)
    digits = {} if setting.kind is int else {"readout_format": ".2f" if step < 0.1 else ".1f"}
    return slider(**limits, step=step, continuous_update=False, **digits, **common)
