"""Each control of a panel changes the picture, and invalid input gives a sentence."""

from __future__ import annotations

import shutil
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import ipywidgets as widgets
import numpy as np
import pytest

from course import appendix, ch00, ch01, ch02, ch03, ch04, ch05, ch06, ch07, ch09
from course.controls import Control, Knob
from course.drawing import WIDTH
from course.panel import Drawing, Fact, Panel, State
from vo_lib.config import preset
from vo_lib.data.sequence import Sequence
from vo_lib.geometry.types import Progress
from vo_lib.kit.settings import KitConfig
from vo_lib.paper.settings import FilterConfig, PublishedConfig

CHAPTERS = (ch00, ch01, ch02, ch03, ch04, ch05, ch06, ch07, ch09, appendix)
PANELS = [kind for chapter in CHAPTERS for kind in vars(chapter).values() if isinstance(kind, type)]
LONG = 300.0  # seconds that a job may take; a safeguard
# Typed values of the controls for text.
TYPED = {
    "filter.classes": ("2,5,7", "7"),
    "view.lengths": ("20", "10,40"),
    "view.methods": ("viso2", "mesvo_f,feature_selection"),
    "view.model": ("street", "labels"),
    "view.points": ("0,20,40,60,80", "1,2,3,4,5"),
}


@pytest.fixture(scope="module", params=PANELS, ids=lambda kind: kind.__name__)
def panel(request: pytest.FixtureRequest, street: Sequence) -> Iterator[Panel]:
    """One instance of each panel on the same street; the explorer runs over a few frames only."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("course.ch07.panel.FRAMES", 12)
        made: Panel = request.param(street)
        made.wait(LONG)
        yield made


def stops(knob: Knob) -> list[Any]:
    """Two values of a control: both ends, the first and the last choice, or two typed values."""
    widget = knob.widget
    if isinstance(widget, widgets.Checkbox):
        return [False, True]
    if isinstance(widget, widgets.Dropdown):
        return [widget.options[0], widget.options[-1]]
    if isinstance(widget, widgets.Text):
        return list(TYPED.get(knob.setting.name, ()))
    return [widget.min, widget.max]


def test_every_control_changes_the_picture_and_the_same_state_gives_the_same_one(panel: Panel) -> None:
    assert panel.facts
    first = panel.picture.value
    widget_of = {key: knob.widget for key, knob in panel.knobs.items()} | {"frame": panel.frame}
    driven = {key: stops(knob) for key, knob in panel.knobs.items()} | {"frame": [1, panel.frame.max]}
    if panel.kit is not None:
        widget_of["variant"], driven["variant"] = panel.variant, [*panel.variant.options]
    grey = {key for key, knob in panel.knobs.items() if knob.shown.disabled}
    back: dict[str, Any] = {}
    for key, values in driven.items():
        awake = {"variant": "kit"} if key in grey else {}  # controls of settings that only the kit has
        begun, pictures = {name: back.get(name, widget_of[name].value) for name in (key, *awake)}, {first}
        if awake:
            panel.set(**{**back, **awake})
            assert not panel.knobs[key].shown.disabled, f"{key} is grey under {awake}"
            back, pictures = {}, {panel.picture.value}
        for value in values:  # none for paths, which have tests of their own
            panel.set(**{**back, key: value})
            assert panel.error == "", (key, value)
            pictures.add(panel.picture.value)
            picture = cv2.imdecode(np.frombuffer(panel.picture.value, np.uint8), cv2.IMREAD_COLOR)
            assert picture is not None
            assert picture.shape == (panel.height, WIDTH, 3), (key, value)
            back = {}
        assert len(pictures) > 1 or not values, f"{key} changes nothing"
        back |= begun
    panel.set(**back)
    assert panel.picture.value == first


def test_another_sequence_can_be_chosen(panel: Panel, street: Sequence, bands: Path) -> None:
    panel.folder.value = str(bands)
    panel.wait(LONG)
    assert panel.error == ""
    assert panel.frame.max == 5
    on_bands = panel.picture.value
    panel.chooser.value = street.name
    panel.wait(LONG)
    assert panel.error == ""
    assert panel.picture.value != on_bands


class Example(Panel):
    """A panel with typed input, a mistake at frame 2 and a long job."""

    title = "an example"
    height = 40
    kit = preset("solution_selection", variant="kit")
    controls = (Control("filter.classes"), Control("selection.top_k"), Control("selection.mode"))
    long_job = "count"
    started = threading.Event()

    def draw(self, state: State) -> Drawing:
        if state.frame == 2:
            raise ValueError("no second frame")
        shade = np.full((40, WIDTH, 3), 10 * state.config.selection.top_k, np.uint8)
        return Drawing([shade], "a shade", (Fact("keep", state.config.selection.top_k),))

    def idle(self, state: State) -> set[str]:
        return {"selection.top_k"} if state.frame == 4 else set()

    def work(self, state: State, progress: Progress) -> None:
        self.started.set()
        for i in range(10**9):
            threading.Event().wait(0.001)
            progress(i, 10**9)
        raise AssertionError("nobody stopped it")


@pytest.fixture
def example(bands: Path) -> Example:
    panel = Example(str(bands), frame=1)
    panel.wait(LONG)
    assert panel.error == ""
    return panel


def test_what_is_wrong_is_shown_and_the_panel_goes_on(example: Example) -> None:
    typed, good = example.knobs["filter.classes"].widget, example.picture.value
    typed.value = "two"
    assert example.error.startswith("filter.classes: 'two' is not a comma-separated list of whole numbers")
    typed.value = "2,7"
    assert example.error == ""
    assert example.state().config.filter.classes == (2, 7)
    example.frame.value = 2
    assert example.error == "ValueError: no second frame"
    assert (example.facts, example.picture.value) == ({}, example._white())
    example.frame.value = 3
    assert example.error == ""
    assert example.picture.value == good
    example.set(selection__top_k=5)
    assert "(+3)" in example._text.value


def test_after_a_missing_folder_the_panel_shows_nothing_and_goes_on(
    example: Example, bands: Path, tmp_path: Path
) -> None:
    white, good = example._white(), example.picture.value
    example.folder.value = str(tmp_path / "<nowhere>")
    example.wait(LONG)
    assert "the folder is missing" in example.error
    assert "&lt;nowhere&gt;" in example._message.value
    assert (example.facts, example.picture.value) == ({}, white)
    example.chooser.value = str(bands)
    example.wait(LONG)
    assert example.error == example._message.value == ""
    assert example.picture.value == good


def test_the_switch_changes_the_method_and_greys_what_the_other_one_lacks(example: Example) -> None:
    mode = example.knobs["selection.mode"].widget
    assert mode.disabled
    assert example.state().config == PublishedConfig(filter=FilterConfig(rule="none"))
    example.set(variant="kit", selection__mode="literal", frame=4)
    assert not mode.disabled
    assert example.knobs["selection.top_k"].widget.disabled
    config = example.state().config
    assert isinstance(config, KitConfig)
    assert config.selection.mode == "literal"
    example.reset()
    assert example.state() == State(preset("solution_selection"), None, example.state().sequence, 1)


def test_each_sequence_has_its_own_frame_and_only_the_panel_changes(
    example: Example, bands: Path, tmp_path: Path
) -> None:
    other = tmp_path / "shorter"
    shutil.copytree(bands, other)
    for side in ("image_0", "image_1"):
        (other / side / "000005.png").unlink()
    example.frame.value = 5
    example.folder.value = str(other)
    example.wait(LONG)
    assert example.frame.value == example.frame.max == 4
    assert "Only the panel shows shorter" in example._text.value
    example.chooser.value = str(bands)
    assert example.frame.value == 5
    assert "Only the panel" not in example._text.value


def test_a_long_job_can_be_stopped(example: Example) -> None:
    example.run()
    assert example.started.wait(LONG)
    assert (example.job.running, example.job.box.layout.display) == (True, "")
    example.job.stop()
    example.wait(LONG)
    assert (example.job.running, example.job.box.layout.display) == (False, "none")
    assert example.error == ""
    assert "Stopped" in example._message.value
