"""Controls made from declared settings: range, unit and sentence come from the settings classes."""

from __future__ import annotations

import html
from dataclasses import dataclass
from typing import Any

import ipywidgets as widgets

from vo_lib.settings import Setting

CELL_WIDTH = 320  # pixels; three stand side by side
# A little narrower where the window is; below each other where it is much narrower.
CELL = {"flex": "1 1 290px", "max_width": f"{CELL_WIDTH}px"}
INSIDE = {"width": "auto", "max_width": f"{CELL_WIDTH - 12}px"}  # of a cell
PLAIN = {"style": {"description_width": "initial"}, "layout": INSIDE}
HINT = '<div style="font-size:11px;line-height:1.2;opacity:.7">{}</div>'
STEPS = 100  # of a slider for numbers, where no step is given


@dataclass(frozen=True)
class Control:
    """One control of a panel.

    Attributes
    ----------
    name : a setting's dotted name: "selection.keep" of `Config`, or "view.noise" of the panel's own settings.
    label : the words beside it; by default the last part of the name.
    low, high : narrower ends than declared, where the whole range is of no use to the eye.
    step : of a slider.
    button : a button that raises a whole number by one, and starts again after its largest value.
    """

    name: str
    label: str = ""
    low: float | None = None
    high: float | None = None
    step: float | None = None
    button: bool = False


class Knob:
    """A control on the screen: its `widget`, and the `cell` that shows it above the declared sentence."""

    def __init__(self, control: Control, setting: Setting, value: Any):
        self.setting = setting
        unit = f" [{setting.unit}]" if setting.unit else ""
        label = (control.label or setting.name.split(".")[-1].replace("_", " ")) + unit
        self.widget = shown = _make(control, setting, value, label)
        if control.button:
            shown = widgets.Button(description=label, layout=INSIDE)
            shown.on_click(self._press)
        hint = widgets.HTML(HINT.format(html.escape(setting.text)), layout={"margin": "0 8px 4px 2px"})
        self.cell = widgets.VBox([shown, hint], layout=CELL)

    def _press(self, _: Any) -> None:
        self.widget.value = self.widget.min if self.widget.value >= self.widget.max else self.widget.value + 1

    @property
    def value(self) -> Any:
        """The setting's value; `DataError` where typed text is none."""
        raw = self.widget.value
        return self.setting.parse(raw) if isinstance(self.widget, widgets.Text) else raw


def _make(control: Control, setting: Setting, value: Any, label: str) -> Any:
    common = {"description": label, "tooltip": setting.text, **PLAIN}
    if setting.kind is bool:
        return widgets.Checkbox(value=value, indent=False, description=label, layout=INSIDE)
    if setting.choices:
        return widgets.Dropdown(value=value, options=list(setting.choices), **common)
    if setting.kind not in (int, float):
        words = ",".join(map(str, value)) if isinstance(value, tuple) else str(value)
        return widgets.Text(value=words, continuous_update=False, **common)
    low = setting.low if control.low is None else control.low
    high = setting.high if control.high is None else control.high
    if low is None or high is None:
        raise ValueError(f"{setting.name} needs both ends to become a slider")
    limits = {"min": setting.kind(low), "max": setting.kind(high), "value": setting.kind(value)}
    if control.button:
        return widgets.BoundedIntText(**limits)
    slider = widgets.IntSlider if setting.kind is int else widgets.FloatSlider
    step = control.step or (1 if setting.kind is int else (high - low) / STEPS)
    digits = {} if setting.kind is int else {"readout_format": ".2f" if step < 0.1 else ".1f"}
    return slider(**limits, step=step, continuous_update=False, **digits, **common)
