"""Panels answer to each of their controls with another picture, and to bad input with a sentence."""

from __future__ import annotations

import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import cv2
import ipywidgets as widgets
import numpy as np
import pytest

from course import appendix, ch00, ch01, ch02, ch03, ch04, ch05, ch06, ch07, stack
from course.controls import Control, Knob
from course.drawing import COARSE, WIDTH, room
from course.frames import Memory
from course.panel import Drawing, Panel, State
from course.results import Fact
from vo_lib.core.errors import DataError
from vo_lib.core.types import Progress
from vo_lib.data.sequence import Sequence

CHAPTERS = (ch00, ch01, ch02, ch03, ch04, ch05, ch06, ch07, appendix)
PANELS = [kind for chapter in CHAPTERS for kind in vars(chapter).values() if isinstance(kind, type)]
LONG = 300.0  # seconds that a job may take; a safeguard
# What is typed into the controls for text.
TYPED = {
    "filter.classes": ("2,5,7", "7"),
    "view.lengths": ("20", "10,40"),
    "view.methods": ("viso2", "mesvo_f,feature_selection"),
    "view.model": ("street", "labels"),
    "view.points": ("0,20,40,60,80", "1,2,3,4,5"),
}


@pytest.fixture(scope="module", params=PANELS, ids=lambda kind: kind.__name__)
def panel(request: pytest.FixtureRequest, street: Sequence) -> Panel:
    """Each panel once, on the common street."""
    made: Panel = request.param(street)
    made.wait(LONG)
    return made


def stops(knob: Knob) -> list[Any]:
    """Both ends and the middle of a control, or all its choices."""
    widget = knob.widget
    if isinstance(widget, widgets.Checkbox):
        return [False, True]
    if isinstance(widget, widgets.Dropdown):
        return list(widget.options)
    if isinstance(widget, widgets.Text):
        return list(TYPED.get(knob.setting.name, ()))
    middle = (widget.min + widget.max) / 2
    return [widget.min, int(middle) if isinstance(widget.min, int) else middle, widget.max]


def test_every_control_changes_the_picture(panel: Panel) -> None:
    driven = {key: (knob.widget, stops(knob)) for key, knob in panel.knobs.items()}
    driven["frame"] = panel.frame, [1, panel.frame.max // 2, panel.frame.max]
    for key, (widget, values) in driven.items():
        if not values:  # paths have tests of their own
            continue
        first, seen = widget.value, set()
        for value in [*values, first]:
            widget.value = value
            panel.wait(LONG)
            assert panel.error == "", (key, value)
            seen.add(panel.picture.value)
            picture = cv2.imdecode(np.frombuffer(panel.picture.value, np.uint8), cv2.IMREAD_COLOR)
            assert picture is not None
            assert picture.shape == (panel.height, WIDTH, 3), (key, value)
        assert len(seen) > 1, f"{key} changes nothing"


def test_the_same_state_gives_the_same_picture(panel: Panel) -> None:
    before = panel.draw(panel.state())
    panel.set(frame=3)
    panel.set(frame=60)
    assert panel.draw(panel.state()) == before
    assert before.sentence
    assert before.facts


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


def test_after_a_missing_folder_the_panel_goes_on(panel: Panel, street: Sequence, tmp_path: Path) -> None:
    panel.folder.value = str(tmp_path / "<nowhere>")
    panel.wait(LONG)
    assert "the folder is missing" in panel.error
    assert "&lt;nowhere&gt;" in panel._message.value
    panel.chooser.value = street.name
    panel.wait(LONG)
    assert panel.error == panel._message.value == ""


@pytest.mark.parametrize(
    ("kind", "names"),
    [
        (ch03.SelectionPanel, ["consensus", "selection, k = 2", "k = 1, prior never dropped"]),
        (ch05.FilteringPanel, ["none", "all", "moving"]),
    ],
    ids=["selections", "rules"],
)
def test_ways_are_compared_over_the_frames(kind: type[Panel], names: list[str], bands: Path) -> None:
    panel = kind(str(bands), frame=1)
    panel.wait(LONG)
    before = panel.picture.value
    panel.run()
    panel.wait(LONG)
    assert panel.error == ""
    assert panel.picture.value != before
    assert list(panel.facts) == [f"median, {name}" for name in names]


def test_the_rule_truth_needs_a_drawn_scene(bands: Path) -> None:
    panel = ch05.FilteringPanel(str(bands), frame=1)
    panel.wait(LONG)
    panel.set(filter__rule="truth")
    assert "needs a drawn scene" in panel.error


@pytest.mark.parametrize(
    ("value", "limit"), [(0.3, 0.5), (0.5, 0.5), (5.001, 10), (70, 100), (1000, 1000), (0, 0.01)]
)
def test_limits_are_round_numbers(value: float, limit: float) -> None:
    assert room(value, steps=COARSE, least=0.01) == pytest.approx(limit)


class Example(Panel):
    """A panel with typed input, a mistake at frame 2 and a long job."""

    title = "an example"
    height = 40
    controls = (Control("filter.classes"), Control("selection.keep"))
    long_job = "count"
    started = threading.Event()

    def draw(self, state: State) -> Drawing:
        if state.frame == 2:
            raise ValueError("no second frame")
        shade = np.full((40, WIDTH, 3), 10 * state.config.selection.keep, np.uint8)
        return Drawing(stack([shade], 40), "a shade", (Fact("keep", state.config.selection.keep),))

    def work(self, state: State, progress: Progress) -> Drawing:
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


def test_typed_input_is_checked(example: Example) -> None:
    example.knobs["filter.classes"].widget.value = "two"
    assert (
        example.error == "filter.classes: 'two' is not a comma-separated list of whole numbers of 0 or more"
    )
    example.knobs["filter.classes"].widget.value = "2,7"
    assert example.error == ""
    assert example.state().config.filter.classes == (2, 7)


def test_a_mistake_in_a_panel_is_shown_not_swallowed(example: Example) -> None:
    good = example.picture.value
    example.frame.value = 2
    assert example.error == "ValueError: no second frame"
    example.frame.value = 3
    assert example.error == ""
    assert example.picture.value == good


def test_numbers_say_how_they_changed(example: Example) -> None:
    example.set(selection__keep=5)
    assert "(+3)" in example._text.value
    example.set(selection__keep=4)
    assert "(-1)" in example._text.value


def test_a_long_job_can_be_stopped(example: Example) -> None:
    example.run()
    assert example.started.wait(LONG)
    assert (example.job.running, example.job.box.layout.display) == (True, "")
    example.job.stop()
    example.wait(LONG)
    assert (example.job.running, example.job.box.layout.display) == (False, "none")
    assert example.error == ""
    assert "Stopped" in example._message.value


def test_an_unknown_control_is_named(bands: Path) -> None:
    with pytest.raises(DataError, match=r"selection\.kept"):
        Example(str(bands), selection__kept=3)


def test_memory_forgets_what_was_used_longest_ago() -> None:
    memory: Memory[int] = Memory(2)
    made: list[int] = []
    for number in (1, 2, 1, 3, 1, 2):
        if number not in memory:
            made.append(number)
        assert memory.get(number, lambda number=number: number) == number  # type: ignore[misc]
    assert made == [1, 2, 3, 2]
    assert 3 not in memory


def test_memory_makes_a_thing_once_for_many_threads() -> None:
    memory: Memory[int] = Memory(2)
    made, gate = [], threading.Event()

    def slow() -> int:
        gate.wait(LONG)
        made.append(1)
        return 1

    with ThreadPoolExecutor(4) as pool:
        for _ in range(4):
            pool.submit(memory.get, "key", slow)
        gate.set()
    assert made == [1]
