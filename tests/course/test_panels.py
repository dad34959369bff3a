"""Each control of a panel changes the picture, and invalid input gives a sentence."""

from __future__ import annotations

import html
import re
import shutil
import threading
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import ipywidgets as widgets
import numpy as np
import pytest
from conftest import with_box
from matplotlib.figure import Figure

from course import appendix, ch00, ch01, ch02, ch03, ch04, ch05, ch06, ch07, ch09
from course.ch01.trace import trace
from course.ch05.claim import ClaimChart, claim_figure, true_path
from course.colours import bgr
from course.controls import Control, Knob
from course.drawing import WIDTH, caption
from course.kept_runs import poses_of, run_by_frame
from course.panel import NAME_LENGTH, STALE_CLASS, UNFINISHED, Drawing, Fact, Panel, State
from course.progress import LABEL_LENGTH
from course.raster import fast_raster, forget_layers, raster
from course.results import marked
from vo_lib.config import change, preset
from vo_lib.data.sequence import Sequence
from vo_lib.errors import DataError
from vo_lib.geometry.types import Array, Image, Progress
from vo_lib.kit.settings import KitConfig
from vo_lib.paper.five_point import Candidates, five_point
from vo_lib.paper.settings import FilterConfig, MethodConfig, PublishedConfig
from vo_lib.runs.drive import run_methods
from vo_lib.runs.match_cache import CachedMatches

CHAPTERS = (ch00, ch01, ch02, ch03, ch04, ch05, ch06, ch07, ch09, appendix)
PANELS = [kind for chapter in CHAPTERS for kind in vars(chapter).values() if isinstance(kind, type)]
LONG = 300.0  # seconds that a job may take; a safeguard
# Typed values of the controls for text.
TYPED = {
    "filter.classes": ("vehicles", "truck"),
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


def inner_names(panel: Panel) -> list[str]:
    """Names of settings in the words of a panel, whose reader knows only the labels of the controls."""
    said = html.unescape(panel._text.value + panel._message.value)
    names = {part for name in panel.knobs for part in (name, name.split(".")[-1]) if {".", "_"} & {*part}}
    return sorted(name for name in names if name in said)


def test_controls_change_the_picture_and_equal_states_give_equal_pictures(panel: Panel) -> None:
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
            assert inner_names(panel) == []
            pictures.add(panel.picture.value)
            picture = cv2.imdecode(np.frombuffer(panel.picture.value, np.uint8), cv2.IMREAD_COLOR)
            assert picture is not None
            assert picture.shape == (panel.height, WIDTH, 3), (key, value)
            back = {}
        assert len(pictures) > 1 or not values, f"{key} changes nothing"
        back |= begun
    panel.set(**back)
    assert panel.picture.value == first


def controls_of(widget: Any) -> list[Any]:
    """The widgets that can have the focus, in the order of the page, which is that of the Tab key."""
    if widget.layout.display == "none" or isinstance(widget, widgets.HTML | widgets.Image):
        return []
    if isinstance(widget, widgets.Box):
        assert widget.layout.order is None
        assert widget.layout.flex_flow in (None, "row wrap")
        return [each for child in widget.children for each in controls_of(child)]
    return [widget]


def test_controls_have_names_and_the_tab_key_follows_the_page(panel: Panel) -> None:
    """The page gives names to the two buttons that play; test_browser.py has the names of sliders."""
    for variant in panel.variant.options if panel.kit is not None else [panel.variant.value]:
        panel.set(variant=variant)
        every = controls_of(panel.box)
        names = ["play" if isinstance(each, widgets.Play) else each.description for each in every]
        expected = ["sequence", "or path", "frame", "play", "reset"]
        expected += ["method"] if panel.kit is not None else []
        for control in panel.controls:
            knob = panel.knobs[control.name]
            if knob.shown.layout.display != "none":
                unit = f" [{knob.setting.unit}]" if knob.setting.unit else ""
                expected.append(f"{control.words}{unit}")
                assert knob.shown.tooltip == knob.setting.text
        expected += [panel.long_job] if panel.long_job else []
        assert names == expected
        assert panel.frame.tooltip
        assert len({*names}) == len(names)
    panel.set(variant="published")


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


def is_stale(panel: Panel) -> bool:
    """Whether the picture is shown as one of an earlier state."""
    return STALE_CLASS in panel.picture._dom_classes


@pytest.fixture
def example(bands: Path) -> Example:
    panel = Example(str(bands), frame=1)
    panel.wait(LONG)
    assert panel.error == ""
    return panel


def test_what_is_wrong_is_shown_and_the_panel_goes_on(example: Example) -> None:
    typed, good = example.knobs["filter.classes"].widget, example.picture.value
    typed.value = "-2"
    assert example.error == "classes: '-2' is not a name, or several separated by commas"
    typed.value = "2, big truck"
    assert example.error == ""
    assert example.state().config.filter.classes == ("2", "big truck")
    example.frame.value = 2
    assert example.error == "ValueError: no second frame"
    assert (example.facts, example.picture.value) == ({}, good)
    assert is_stale(example)
    example.frame.value = 3
    assert example.error == ""
    assert example.picture.value == good
    assert not is_stale(example)
    example.set(selection__top_k=5)
    assert "(+3)" in example._text.value


def test_after_a_missing_folder_the_panel_keeps_what_it_shows_and_goes_on(
    example: Example, bands: Path, tmp_path: Path
) -> None:
    missing, good, facts = str(tmp_path / "<nowhere>"), example.picture.value, example.facts
    example.folder.value = missing
    example.wait(LONG)
    for _ in range(2):
        assert "the folder is missing" in example.error
        assert "&lt;nowhere&gt;" in example._message.value
        assert f"still shows {bands}" in example._message.value
        assert (example.facts, example.picture.value) == (facts, good)
        assert not is_stale(example)
        assert example.chooser.value == str(bands)
        example.set(selection__top_k=4)
        assert (example.error, example._message.value) == ("", "")
        assert example.facts == {"keep": 4}
        example.reset()
        example.chooser.value = missing  # the same name again: it is tried again
        example.wait(LONG)


@pytest.mark.parametrize("stopped", [False, True])
def test_without_a_first_sequence_a_panel_says_what_to_do_and_goes_on(
    stopped: bool, bands: Path, tmp_path: Path
) -> None:
    slow = Slow(str(bands) if stopped else str(tmp_path / "nowhere"), frame=1)
    assert slow.started.wait(LONG)
    if stopped:
        slow.job.stop()
    slow.go_on.set()
    slow.wait(LONG)
    assert "Choose a sequence." in slow._message.value
    assert slow.chooser.value is None
    slow.set(selection__top_k=4)
    assert slow.error == "choose a sequence first" if stopped else "the folder is missing" in slow.error
    assert slow.facts == {}
    slow.folder.value = str(bands)
    slow.wait(LONG)
    assert (slow.error, slow._message.value, slow.facts) == ("", "", {"keep": 4})


class Slow(Example):
    """A panel whose sequences, but the one called `fast`, are ready only when the test says so."""

    fast = ""
    fault: Exception | None = None

    def __init__(self, sequence: str, frame: int):
        self.started, self.go_on = threading.Event(), threading.Event()
        super().__init__(sequence, frame)

    def is_ready(self, name: str) -> bool:
        return name == self.fast

    def prepare(self, name: str, progress: Progress) -> Sequence:
        fault = self.fault
        self.started.set()
        self.go_on.wait(LONG)
        if fault is not None:
            raise fault
        return super().prepare(name, progress)


@pytest.fixture
def slow(bands: Path) -> Slow:
    """A panel that shows `bands`, which is ready from now on."""
    panel = Slow(str(bands), frame=1)
    panel.go_on.set()
    panel.wait(LONG)
    assert panel.facts
    panel.fast = str(bands)
    panel.started.clear()
    panel.go_on.clear()
    return panel


def others(bands: Path, folder: Path) -> list[str]:
    """Copies of a sequence, which have 5 and 4 frames."""
    made = []
    for frames in (5, 4):
        copy = folder / f"frames_{frames}"
        shutil.copytree(bands, copy)
        for side in ("image_0", "image_1"):
            for number in range(frames, 6):
                (copy / side / f"{number:06d}.png").unlink()
        made.append(str(copy))
    return made


@pytest.fixture
def long_name(bands: Path, tmp_path: Path) -> Path:
    """A sequence in a folder with a long name without a blank."""
    folder = tmp_path / ("a_very_long_name_of_a_drive_" * 7 + "in_june")
    shutil.copytree(bands, folder)
    return folder


def test_a_long_name_is_shortened_where_there_is_no_room(slow: Slow, long_name: Path) -> None:
    name = str(long_name)
    slow._offer(name)
    assert slow.started.wait(LONG)
    label, value = slow.chooser.options[0]
    assert (len(label), value, slow.chooser.value) == (NAME_LENGTH, name, name)
    assert name.startswith(label.split("…")[0])
    assert name.endswith(label.split("…")[1])
    shown = re.fullmatch('<span title="(.*)">(opening /.*in_june)</span>', slow.job._words.value)
    assert shown is not None
    assert shown[1] == f"opening {name}"
    assert len(shown[2]) == LABEL_LENGTH
    tips = re.findall('data-(tips|names)="([^"]*)"', slow._tips.value)
    assert all(name in html.unescape(data) for _, data in tips)
    slow.go_on.set()
    slow.wait(LONG)
    assert slow.state().sequence.folder == long_name
    assert "Only the panel shows a_very" in slow._text.value
    assert name not in slow._text.value


@pytest.mark.parametrize("kind", [ch06.EvaluationPanel, ch07.ReproducePanel])
def test_titles_of_charts_have_room_for_a_long_name(
    kind: type[Panel], long_name: Path, drawn_charts: list[Figure]
) -> None:
    panel = kind(str(long_name), frame=1)
    panel.wait(LONG)
    assert panel.error == ""
    for left, right in (chart.axes for chart in drawn_charts if len(chart.axes) == 2):
        raster(left.figure.figure)
        title = left.get_title("left")
        assert "a_very" in title or title.startswith(("translation error", "rotation error")), title
        drawn = left._left_title  # type: ignore[attr-defined]
        assert drawn.get_window_extent().x1 < right.get_window_extent().x0, title


def test_a_sequence_that_cannot_be_opened_names_its_control(example: Example, tmp_path: Path) -> None:
    missing = tmp_path / "nowhere"
    example.folder.value = f" {missing}/ "
    example.wait(LONG)
    assert example.error.startswith(f"or path: {missing}: the folder is missing: expected a folder or ")
    example.folder.value = ""
    example.chooser.value = str(missing)
    example.wait(LONG)
    assert example.error.startswith(f"sequence: {missing}: the folder is missing: ")
    example.folder.value = "~no_one_here/x"
    example.wait(LONG)
    assert example.error.startswith("or path: ~no_one_here/x: the folder is missing: ")


@pytest.mark.parametrize("fault", [None, DataError("a bad file")], ids=["opened", "failed"])
@pytest.mark.parametrize("back", [True, False], ids=["back", "another"])
def test_a_late_result_of_an_earlier_choice_is_dropped(
    slow: Slow, fault: Exception | None, back: bool, bands: Path, tmp_path: Path
) -> None:
    late, other = others(bands, tmp_path)
    chosen = str(bands) if back else other
    slow.fast = chosen
    slow.fault = fault
    slow._offer(late)
    assert slow.started.wait(LONG)
    slow._offer(chosen)
    shown, facts = slow.picture.value, slow.facts
    slow.go_on.set()
    slow.wait(LONG)
    assert slow.state().sequence.folder == Path(chosen)
    assert slow.chooser.value == chosen
    assert slow.frame.max == len(slow.state().sequence) - 1
    assert (slow.picture.value, slow.facts, slow.error, slow._message.value) == (shown, facts, "", "")
    slow.knobs["selection.top_k"].widget.value = 5
    assert slow.facts == {"keep": 5}


def test_of_two_slow_choices_the_last_one_is_shown(slow: Slow, bands: Path, tmp_path: Path) -> None:
    first, second = others(bands, tmp_path)
    slow._offer(first)
    assert slow.started.wait(LONG)
    threading.Timer(0.3, slow.go_on.set).start()
    slow._offer(second)
    slow.wait(LONG)
    assert slow.state().sequence.folder == Path(second)
    assert (slow.chooser.value, slow.error) == (second, "")


def test_a_slow_choice_does_not_wait_for_the_one_before(slow: Slow, bands: Path, tmp_path: Path) -> None:
    """The job of the first choice never reports, as one that loads a large file."""
    first, second = others(bands, tmp_path)
    slow._offer(first)
    assert slow.started.wait(LONG)
    waiting = slow.go_on
    slow.go_on = threading.Event()
    slow.go_on.set()
    slow._offer(second)
    slow.wait(LONG)
    assert slow.state().sequence.folder == Path(second)
    slow.started.clear()
    slow.run()  # another job, whose bar the late one leaves alone
    assert slow.started.wait(LONG)
    waiting.set()
    for thread in threading.enumerate():
        if thread is not slow.job._thread and thread.name.endswith("(body)"):
            thread.join(LONG)
    assert (slow.job.running, slow.job.box.layout.display) == (True, "")
    assert (slow.chooser.value, slow.error, slow._message.value) == (second, "", "")
    slow.job.stop()
    slow.wait(LONG)


def test_a_stopped_opening_leaves_the_sequence_and_can_be_tried_again(
    slow: Slow, bands: Path, tmp_path: Path
) -> None:
    other = others(bands, tmp_path)[0]
    good, facts = slow.picture.value, slow.facts
    slow._offer(other)
    assert slow.started.wait(LONG)
    slow.job.stop()
    for _ in range(2):
        assert (slow.chooser.value, slow.picture.value, slow.facts) == (str(bands), good, facts)
        assert f"Stopped: {other} is not opened." in slow._message.value
        slow.go_on.set()
        slow.wait(LONG)
    assert f"still shows {bands}" in slow._message.value
    slow.set(selection__top_k=5)
    assert slow.facts == {"keep": 5}
    slow.chooser.value = other
    slow.wait(LONG)
    assert slow.state().sequence.folder == Path(other)


def test_a_sequence_of_one_frame_is_refused_and_the_panel_goes_on(
    example: Example, bands: Path, tmp_path: Path
) -> None:
    single = tmp_path / "single"
    shutil.copytree(bands, single)
    for side in ("image_0", "image_1"):
        for number in range(1, 6):
            (single / side / f"{number:06d}.png").unlink()
    example.folder.value = str(single)
    example.wait(LONG)
    assert "frame" in example.error
    assert "Error" not in example.error
    assert example.chooser.value == str(bands)
    example.set(selection__top_k=4)
    assert (example.facts, example.error) == ({"keep": 4}, "")


def test_the_switch_changes_the_method_and_greys_what_the_other_one_lacks(example: Example) -> None:
    mode = example.knobs["selection.mode"].widget
    assert mode.disabled
    assert mode.layout.display == "none"  # else it would say "refined", which the variant does not do
    assert example.state().config == PublishedConfig(filter=FilterConfig(rule="none"))
    example.set(variant="kit", selection__mode="literal", frame=4)
    assert not mode.disabled
    assert mode.layout.display != "none"
    assert example.knobs["selection.top_k"].widget.disabled
    config = example.state().config
    assert isinstance(config, KitConfig)
    assert config.selection.mode == "literal"
    example.reset()
    assert example.state() == State(preset("solution_selection"), None, example.state().sequence, 1)


def test_variant_switch_works_with_a_wrong_value_and_without_a_sequence(bands: Path) -> None:
    example = Example(str(bands), frame=1)
    mode = example.knobs["selection.mode"].shown
    assert mode.layout.display == "none"  # even while the sequence is opened
    example.wait(LONG)
    example.knobs["filter.classes"].widget.value = "-2"
    example.variant.value = "kit"
    assert "-2" in example.error
    assert mode.layout.display != "none"


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


def test_stop_does_not_wait_for_a_job_that_never_reports(example: Example) -> None:
    go_on = threading.Event()
    results: list[str] = []

    def work(progress: Progress) -> str:
        go_on.wait(LONG)
        return "too late"

    def fail(error: Exception) -> None:
        results.append(type(error).__name__)

    job = example.job
    job.start("loading", work, results.append, fail)
    thread = job._thread
    job.stop()
    assert (results, job.running, job.box.layout.display) == (["Stopped"], False, "none")
    job.stop()  # once more
    example.run()  # another job, which the late end of the first one leaves alone
    go_on.set()
    thread.join(LONG)
    assert (results, job.running, job.box.layout.display) == (["Stopped"], True, "")
    job.stop()
    assert "Stopped" in example._message.value
    job.start("counting", lambda progress: 1 / 0, results.append, fail)
    job.wait(LONG)
    job.start("counting", lambda progress: 7, lambda seven: [][seven], fail)
    job.wait(LONG)
    assert results == ["Stopped", "ZeroDivisionError", "IndexError"]


def drag(slider: Any, value: float) -> None:
    """Move a slider as the browser does."""
    slider.set_state({"value": value})


def test_pictures_of_a_drag_are_those_drawn_at_once(panel: Panel, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each value of a moving slider; neither kept layers of axes nor unfinished pictures change a pixel."""
    monkeypatch.setattr(type(panel), "first_steps_s", 0.0)
    for name, knob in panel.knobs.items():
        slider = knob.widget
        if not isinstance(slider, widgets.IntSlider | widgets.FloatSlider) or knob.shown.disabled:
            continue
        first = slider.value
        for share in (0.2, 0.3):
            steps = round(share * (slider.max - slider.min) / slider.step)
            drag(slider, slider.min + steps * slider.step)
            assert panel.error == "", (name, slider.value)
            assert slider.value == pytest.approx(slider.min + steps * slider.step, abs=1e-9)
        panel.wait(LONG)
        assert panel._sign.value == ""
        moved, facts, last = panel.picture.value, panel.facts, slider.value
        forget_layers()
        slider.value = first
        panel.set(**{name: last})
        assert panel.picture.value == moved, name
        np.testing.assert_equal(panel.facts, facts)
        panel.set(**{name: first})


class Stepwise(Example):
    """A panel that draws in two steps; it fails in the second one for top_k = 9, and waits there for 8."""

    def __init__(self, sequence: str, frame: int):
        self.reached = threading.Event()
        self.go_on = threading.Event()
        self.drawn: list[int] = []
        super().__init__(sequence, frame)

    def steps(self, state: State) -> Iterator[Callable[[], Drawing]]:
        top_k = state.config.selection.top_k

        def half() -> Drawing:
            return Drawing([np.full((40, WIDTH, 3), 99, np.uint8)], "step 1 of 2", (Fact("keep", 77),))

        yield half
        if top_k == 9:
            raise DataError("nine is too many")
        if top_k == 8:
            self.reached.set()
            self.go_on.wait(LONG)
        yield half

    def draw(self, state: State) -> Drawing:
        self.drawn.append(state.config.selection.top_k)
        return super().draw(state)


@pytest.fixture
def stepwise(bands: Path, monkeypatch: pytest.MonkeyPatch) -> Stepwise:
    monkeypatch.setattr(Stepwise, "first_steps_s", 0.0)
    monkeypatch.setattr("course.redraws.PAUSE_S", 0.0)
    panel = Stepwise(str(bands), frame=1)
    panel.wait(LONG)
    panel.set(selection__top_k=2)
    panel.drawn.clear()
    return panel


def test_a_drag_shows_what_is_done_so_far_and_then_all(stepwise: Stepwise) -> None:
    top_k = stepwise.knobs["selection.top_k"].widget
    drag(top_k, 8)
    assert stepwise._sign.value == UNFINISHED
    assert "step 1 of 2" in stepwise._text.value
    assert "77" not in stepwise._text.value  # a number of half the steps
    assert np.isnan(stepwise.facts["keep"])
    part = stepwise.picture.value
    stepwise.go_on.set()
    stepwise.wait(LONG)
    assert stepwise._sign.value == ""
    assert stepwise.facts == {"keep": 8}
    assert "(+6)" in stepwise._text.value
    drag(top_k, 7)
    stepwise.wait(LONG)
    assert "(+5)" in stepwise._text.value  # since the first touch, not since the unfinished picture
    whole = stepwise.picture.value
    stepwise.set(selection__top_k=7)
    assert stepwise.picture.value == whole != part


def test_code_that_sets_a_slider_reads_finished_facts(stepwise: Stepwise) -> None:
    for value in (3, 5):
        stepwise.knobs["selection.top_k"].widget.value = value
        assert (stepwise.facts, stepwise._sign.value) == ({"keep": value}, "")
    drag(stepwise.knobs["selection.top_k"].widget, 8)
    stepwise.set(selection__top_k=4)
    assert (stepwise.facts, stepwise._sign.value) == ({"keep": 4}, "")
    stepwise.go_on.set()
    stepwise.wait(LONG)
    assert stepwise.facts == {"keep": 4}


@pytest.mark.parametrize("by_drag", [True, False])
def test_an_unfinished_picture_gives_way_to_the_next_value(stepwise: Stepwise, by_drag: bool) -> None:
    top_k = stepwise.knobs["selection.top_k"].widget
    drag(top_k, 8)
    assert stepwise.reached.wait(LONG)
    late = stepwise.redraws._thread
    if by_drag:
        drag(top_k, 6)
    else:
        stepwise.frame.value = 3
        assert stepwise.facts == {"keep": 8}
        stepwise.drawn.clear()
    stepwise.go_on.set()
    late.join(LONG)
    stepwise.wait(LONG)
    assert stepwise.drawn == ([6] if by_drag else [])
    assert stepwise.facts == {"keep": 6 if by_drag else 8}
    assert stepwise._sign.value == ""


def test_an_unfinished_picture_gives_way_to_another_sequence(
    stepwise: Stepwise, bands: Path, tmp_path: Path
) -> None:
    other = others(bands, tmp_path)[0]
    drag(stepwise.knobs["selection.top_k"].widget, 8)
    assert stepwise.reached.wait(LONG)
    late = stepwise.redraws._thread
    stepwise.folder.value = other
    stepwise.job.wait(LONG)
    stepwise.drawn.clear()
    shown = stepwise.picture.value
    stepwise.go_on.set()
    late.join(LONG)
    assert (stepwise.drawn, stepwise.picture.value, stepwise.facts) == ([], shown, {"keep": 8})


def test_an_error_after_the_first_step_is_shown(stepwise: Stepwise) -> None:
    top_k = stepwise.knobs["selection.top_k"].widget
    drag(top_k, 9)
    stepwise.wait(LONG)
    assert stepwise.error == "nine is too many"
    assert is_stale(stepwise)
    assert (stepwise.facts, stepwise._sign.value, stepwise._text.value) == ({}, "", "")
    drag(top_k, 7)
    stepwise.wait(LONG)
    assert (stepwise.error, stepwise.facts) == ("", {"keep": 7})
    assert not is_stale(stepwise)


def test_runs_frame_by_frame_are_those_at_once(street: Sequence) -> None:
    part = street.part(0, 6)
    configs = {
        "one": preset("feature_selection", seed=91),
        "two": preset("feature_selection", seed=92),
    }
    parts = [poses_so_far() for poses_so_far in run_by_frame(part, configs)]
    runs = run_methods(part, configs, matches=CachedMatches(part, configs["one"]))
    for name, run in runs.items():
        assert [len(each[name]) for each in parts] == [2, 3, 4, 5, 6]
        for each in parts:
            np.testing.assert_array_equal(each[name], run.poses[: len(each[name])])
    assert list(run_by_frame(part, configs)) == []  # stored


def test_a_run_with_another_threshold_solves_no_five_point_set_again(
    street: Sequence, monkeypatch: pytest.MonkeyPatch
) -> None:
    solved = []

    def spy(x_p: Array, x_c: Array) -> Candidates:
        solved.append(len(x_p))
        return five_point(x_p, x_c)

    monkeypatch.setattr("vo_lib.paper.odometry.five_point", spy)
    part = street.part(0, 6)
    first = preset("feature_selection", seed=93)

    def runs_anew(config: MethodConfig) -> int:
        """The number of frames whose sets are solved; the poses are those without any memory."""
        solved.clear()
        for _ in run_by_frame(part, {"": config}):
            pass
        count = len(solved)
        run = run_methods(part, {"": config}, matches=CachedMatches(part, config))[""]
        np.testing.assert_array_equal(poses_of(part, config), run.poses)
        return count

    assert runs_anew(first) == 5
    assert runs_anew(change(first, "selection.threshold", 0.8)) == 0
    assert runs_anew(change(first, "translation.max_depth", 30.0)) == 0
    assert runs_anew(change(first, "selection.sets", 90)) == 5
    assert runs_anew(change(first, "buckets.features", 2)) == 5
    assert runs_anew(change(first, "seed", 94)) == 5
    kit = preset("feature_selection", variant="kit", seed=93)
    assert runs_anew(kit) == 5
    assert runs_anew(change(kit, "selection.threshold", 0.8)) == 5


def test_a_chart_that_is_drawn_anew_is_like_a_new_one(street: Sequence) -> None:
    part = street.part(40, 60)
    poses = true_path(part)

    def path(frames: int, off: float) -> Array:
        made = np.tile(np.eye(4), (frames, 1, 1))
        made[:, :3, 3] = poses[:frames] * (1 + off)
        return made

    runs = [
        {"preset": path(20, 0.01), "with these settings": path(20, 0.3)},
        {"preset": path(3, 0.02), "with these settings": path(2, 0.0)},
        {"one": path(20, -0.9)},
    ]
    chart = ClaimChart()
    for number in (0, 1, 0, 2, 1, 2, 0):
        for frame in (None, 1, 17):
            again = chart.draw(part, runs[number], frame)
            np.testing.assert_array_equal(
                fast_raster(again), fast_raster(claim_figure(part, runs[number], 250, frame))
            )


def test_the_true_path_of_panel_7b_is_in_the_chart(street: Sequence) -> None:
    """Also if the estimate goes straight on, while the truth turns."""
    straight = np.tile(np.eye(4), (100, 1, 1))
    straight[:, 2, 3] = np.arange(100)
    part = street.part(0, 100)
    path = claim_figure(part, {"straight": straight}).axes[-1]
    low, high = path.get_xlim()
    x = true_path(part)[:, 0]
    assert np.abs(x).max() > 0.5  # m, the least half width
    assert low <= x.min() < x.max() <= high


def test_unfinished_pictures_of_the_slow_panels_say_so(
    street: Sequence, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("course.redraws.PAUSE_S", 60.0)
    for kind, name, value, says in (
        (ch07.ExplorePanel, "selection.threshold", 3.35, "The first 2 of "),
        (appendix.CalibrationPanel, "view.tilt", -3.3, "the first 1 of 40 frames"),
    ):
        monkeypatch.setattr(kind, "first_steps_s", 0.0)
        panel = kind(street)
        panel.job.wait(LONG)
        drag(panel.knobs[name].widget, value)
        assert panel.error == ""
        assert says in panel._text.value
        assert np.isnan([*panel.facts.values()]).all()
        drag(panel.knobs[name].widget, panel.first[name])
        assert panel._sign.value == ""  # this value was drawn before
        assert not np.isnan([*panel.facts.values()]).all()


def test_sliders_show_the_value_that_runs(panel: Panel) -> None:
    """Else the browser shows another number than the one that runs."""
    sliders = {name: knob.widget for name, knob in panel.knobs.items()}
    for name, slider in sliders.items():
        if isinstance(slider, widgets.FloatSlider):
            steps = (panel.first[name] - slider.min) / slider.step
            assert abs(steps - round(steps)) < 1e-6, name
            shown = format(panel.first[name], slider.readout_format)
            assert float(shown) == pytest.approx(panel.first[name], abs=1e-9), name
            assert slider.continuous_update


def test_weights_of_no_loops_are_not_stated(street: Sequence) -> None:
    """The street has no place that is visited twice, so it has no true loops."""
    panel = ch09.LoopPanel(street)
    panel.wait(LONG)
    assert (panel.facts["true loops"], panel.facts["false loops"]) == (0, 1)
    assert np.isnan(panel.facts["smallest weight, true"])
    assert panel.facts["largest weight, false"] < 1
    panel.set(view__false=0)
    assert np.isnan(panel.facts["largest weight, false"])


def test_the_rounding_error_of_the_browser_is_no_other_state(street: Sequence) -> None:
    panel = ch04.TranslationPanel(street, frame=20)
    panel.wait(LONG)
    panel._complain(DataError("a message that a redraw would remove"))
    for name, sent in (("translation.max_depth", 99.99999999999999), ("view.noise", 0.10000000000000002)):
        slider = panel.knobs[name].widget
        assert sent != panel.first[name]
        drag(slider, sent)
        assert slider.value == panel.first[name]
    assert "a message" in panel._message.value
    drag(panel.knobs["view.noise"].widget, 0.15000000000000002)
    assert panel.state().view.noise == 0.15
    assert panel._message.value == ""


@pytest.fixture
def drawn_charts(monkeypatch: pytest.MonkeyPatch) -> list[Figure]:
    """The charts that panels draw from now on."""
    charts: list[Figure] = []

    def keep(chart: Figure) -> Image:
        charts.append(chart)
        return fast_raster(chart)

    monkeypatch.setattr("course.drawing.fast_raster", keep)
    return charts


def test_an_axis_needs_no_object_for_each_of_its_numbers(panel: Panel, drawn_charts: list[Figure]) -> None:
    """They took most of the time of a picture with new limits."""
    forget_layers()
    panel.set(frame=21)
    for chart in drawn_charts:
        for axes in chart.axes:
            for side in (axes.xaxis, axes.yaxis):
                assert len(side.majorTicks) == 1, axes.get_title("left")


def test_no_word_of_a_chart_is_cut(panel: Panel, drawn_charts: list[Figure]) -> None:
    """A word that is cut has pixels at the edge of the picture."""
    for frame in (1, 22, panel.frame.max):
        panel.set(frame=frame)
    for chart in drawn_charts:
        pixels = raster(chart)
        edge = np.concatenate([pixels[0], pixels[-1], pixels[:, 0], pixels[:, -1]])
        titles = [axes.get_title("left") for axes in chart.axes]
        assert (edge == 255).all(), titles


def test_axes_from_memory_are_those_that_matplotlib_draws(
    panel: Panel, monkeypatch: pytest.MonkeyPatch
) -> None:
    pairs = []

    def both(chart: Figure) -> Image:
        fast = fast_raster(chart)
        pairs.append((fast, raster(chart)))
        return fast

    monkeypatch.setattr("course.drawing.fast_raster", both)
    panel.set(frame=20)
    for fast, slow in pairs:
        # Where data cross an axis, they are above it here; elsewhere nothing differs.
        assert np.count_nonzero((fast != slow).any(axis=2)) < 0.002 * fast.shape[0] * fast.shape[1]


def test_texts_from_memory_are_those_that_matplotlib_draws() -> None:
    chart = Figure(figsize=(3, 2), dpi=100)
    axis = chart.add_axes((0, 0, 1, 1))
    axis.set_axis_off()
    axis.plot([0, 1], [1, 0], label="a line")
    axis.legend(loc="upper right")
    axis.text(0.2, 0.2, "orange", color="#D55E00")
    axis.text(0.2, 0.5, "orange", alpha=0.5)
    axis.text(0.71, 0.213, "turned, $x^2$", rotation=40)
    axis.text(0.1, 0.9, "cut off by the axis", clip_on=True, fontsize=40)
    axis.text(2.0, 2.0, "outside")
    forget_layers()
    plain = raster(chart)
    for _ in range(2):
        np.testing.assert_array_equal(fast_raster(chart), plain)


def test_words_in_a_photo_leave_the_named_dots_free() -> None:
    white = np.full((298, WIDTH, 3), 255, np.uint8)
    words = "frame 59: five matches"

    def strip(*named: tuple[float, float]) -> str:
        picture = caption(white, words, np.array(named).reshape(-1, 2))
        return "top" if (picture[0, :50] < 255).any() else "bottom"

    assert strip() == strip((100.0, 150.0), (900.0, 10.0)) == "top"
    assert strip((100.0, 18.0)) == strip((100.0, 35.0), (900.0, 290.0)) == "bottom"
    assert strip((100.0, 18.0), (60.0, 290.0)) == "top"


def test_panel_2_shows_the_name_of_a_match_at_the_top(street: Sequence) -> None:
    """The third match, 166, is at the top, where the words were above its name."""
    places = []

    def spy(picture: Image, words: str, named: Array | None = None) -> Image:
        places.append(named)
        return caption(picture, words, named)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("course.ch02.panel.caption", spy)
        panel = ch02.FivePointPanel(street, frame=59)
        panel.wait(LONG)
    assert panel.error == ""
    named = places[-1]
    assert named is not None
    picture = cv2.imdecode(np.frombuffer(panel.picture.value, np.uint8), cv2.IMREAD_COLOR)
    assert picture is not None
    for (u, v), colour in zip(named[:5], ch02.panel.FIVE, strict=True):
        if not (named[5:] == (u, v)).all(axis=1).any():  # the last dot is above
            at = picture[round(v), round(u)].astype(int)
            assert np.abs(at - bgr(colour)).max() < 60


@pytest.mark.parametrize(
    "values",
    [
        {},
        {
            "frame": 201,
            "selection__top_k": 9,
            "selection__threshold": 2.85,
            "view__moving": 0.4,
            "view__wrong": 0.5,
        },
    ],
    ids=["clean", "disturbed"],
)
def test_the_legend_of_panel_3_covers_no_solution(
    values: dict[str, Any], street: Sequence, monkeypatch: pytest.MonkeyPatch
) -> None:
    charts = []

    def keep(chart: Figure) -> Image:
        charts.append(chart)
        return raster(chart)

    monkeypatch.setattr("course.drawing.fast_raster", keep)
    panel = ch03.SelectionPanel(street, **{"frame": 59, **values})
    panel.wait(LONG)
    assert panel.error == ""
    legends = 0
    for axis in charts[-1].axes:
        legend = axis.get_legend()
        if legend is None:
            continue
        legends += 1
        box = legend.get_window_extent()
        for line in axis.get_lines():
            if line.get_marker() in (".", "o"):
                dots = axis.transData.transform(np.asarray(line.get_xydata()))
                assert not any(box.contains(*dot) for dot in dots.tolist()), line.get_label()
    assert legends == 1


def test_changes_are_counted_from_the_first_touch(example: Example) -> None:
    top_k = example.knobs["selection.top_k"].widget
    first = top_k.value
    for value in (first + 1, first + 2, first + 4):
        top_k.value = value
    assert "(+4)" in example._text.value
    example.frame.value = 3  # another control: from here on, its changes
    assert "(+" not in example._text.value
    top_k.value = first + 5
    assert "(+1)" in example._text.value


def test_an_error_during_a_drag_keeps_the_picture_and_the_first_touch(example: Example) -> None:
    example.set(frame=1, selection__top_k=3)
    good = example.picture.value
    frame = example.frame
    frame.value = 2
    assert example.picture.value == good
    assert example.error == "ValueError: no second frame"
    assert (example.facts, example._text.value) == ({}, "")
    frame.value = 3
    assert (example.error, example._message.value) == ("", "")
    assert not is_stale(example)
    assert example.facts == {"keep": 3}


def test_the_picture_of_another_sequence_does_not_stay(example: Example, bands: Path, tmp_path: Path) -> None:
    other = tmp_path / "other"
    shutil.copytree(bands, other)
    example.set(selection__top_k=4)
    example._frames[str(other)] = 2  # where the panel fails
    example.folder.value = str(other)
    example.wait(LONG)
    assert example.error == "ValueError: no second frame"
    assert example.picture.value == example._white()


def test_a_panel_draws_after_two_threads_changed_its_controls(example: Example) -> None:
    """A job that ends while `set` runs used to leave a panel that never drew again."""
    sequence = example.state().sequence
    in_use = threading.Event()
    go_on = threading.Event()
    choice = example.opening.choose("the same one, by another name")
    job = threading.Thread(target=lambda: example._use(sequence, choice), daemon=True)

    def start_job(_: Any) -> None:
        job.start()
        in_use.wait(1.0)  # now or, if it has to wait for the end of `set`, not before

    def wait_in_job(_: Any) -> None:
        if threading.current_thread() is job:
            in_use.set()
            go_on.wait(LONG)

    top_k = example.knobs["selection.top_k"].widget
    top_k.observe(start_job, "value")
    example.frame.observe(wait_in_job, "max")
    example.frame.max = 4
    setter = threading.Thread(target=lambda: example.set(selection__top_k=3), daemon=True)
    setter.start()
    threading.Event().wait(1.5)
    go_on.set()
    setter.join(LONG)
    job.join(LONG)
    top_k.unobserve_all("value")
    top_k.observe(example.redraw, "value")
    top_k.value = 5
    assert example.facts == {"keep": 5}


def test_choices_and_ends_are_those_of_the_state(street: Sequence) -> None:
    filtering = ch05.FilteringPanel(street)
    rule = filtering.knobs["filter.rule"].widget
    assert rule.options == ("none", "all")
    filtering.set(filter__rule="moving", variant="kit")
    assert filtering.state().config.filter.rule == "moving"
    filtering.variant.value = "published"
    assert (rule.options, rule.value, filtering.error) == (("none", "all"), "all", "")

    five = ch02.FivePointPanel(street)
    candidate = five.knobs["view.candidate"].widget
    counts = set()
    for seed in range(4):
        five.set(view__draw=seed, view__candidate=10)
        counts.add(candidate.max)
        assert five.facts["solution"] == candidate.value == candidate.max
        at_once = ch02.FivePointPanel(street, view__draw=seed, view__candidate=10)
        assert five.picture.value == at_once.picture.value
    assert len(counts) > 1


@pytest.mark.parametrize(
    ("kind", "name", "typed", "says"),
    [
        (ch02.FivePointPanel, "view.points", "1,2,x", "your five matches: '1,2,x' is not"),
        (ch02.FivePointPanel, "view.points", "-1,2,3,4,5", "your five matches: '-1,2,3,4,5' is not"),
        (ch02.FivePointPanel, "view.points", "1,2,3,4,4", "your five matches: expected five different"),
        (ch05.FilteringPanel, "filter.classes", "car,flying saucer", "classes: there is no class 'flying"),
        (ch05.FilteringPanel, "filter.classes", "car,-3", "classes: 'car,-3' is not"),
        (ch06.EvaluationPanel, "view.lengths", "10,0", "lengths: '10,0' is not"),
        (
            ch06.EvaluationPanel,
            "view.file",
            "no_such.txt",
            "a file of your own: no_such.txt: the file is missing; ",
        ),
        (
            ch06.EvaluationPanel,
            "view.file",
            "~no_one_here/x",
            "a file of your own: ~no_one_here/x: the file is missing; ",
        ),
        (ch05.FilteringPanel, "view.model", "no_such", "model: unknown detector 'no_such': expected "),
        (ch05.FilteringPanel, "view.model", "no/x.onnx", "model: no/x.onnx: no such file; type `street`"),
        (ch05.FilteringPanel, "view.model", "", "model: the field is empty; type `street`, "),
        (ch07.ReproducePanel, "view.model", " ", "boxes: the field is empty; type `street`, "),
        (ch07.ReproducePanel, "view.model", "yolov8n.pt", "boxes: yolov8n.pt: no such file"),
        (ch07.ReproducePanel, "view.methods", "mesvo_f,a b", "systems: 'a b' is no method"),
        (ch07.ReproducePanel, "view.methods", "viso", "systems: 'viso' is no method"),
    ],
)
def test_errors_name_the_control(
    kind: type[Panel], name: str, typed: str, says: str, street: Sequence
) -> None:
    panel = kind(street)
    panel.wait(LONG)
    panel.knobs[name].widget.value = typed
    assert panel.error.startswith(says), panel.error
    assert "view." not in panel.error


@pytest.mark.parametrize(
    ("kind", "values", "says"),
    [
        (ch01.MatchingPanel, {"features__blob_quality": 500.0}, "lower <i>threshold</i>"),
        (ch04.TranslationPanel, {"translation__max_depth": 5.0}, "<i>depth limit</i> or <i>agreement</i>"),
        (
            ch04.TranslationPanel,
            {"variant": "kit", "translation__max_depth": 5.0},
            "<i>depth limit</i></div>",
        ),
        (ch05.FilteringPanel, {"view__model": "no_such"}, "unknown detector 'no_such'"),
    ],
)
def test_remedies_are_controls_that_are_shown(
    kind: type[Panel], values: dict[str, Any], says: str, bands: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    panel = kind(str(bands), frame=3)
    panel.wait(LONG)
    assert panel.error == ""
    if kind is ch01.MatchingPanel:
        found = trace(panel.state().sequence, 3, preset("solution_selection"))
        monkeypatch.setattr("course.ch01.panel.trace", lambda *_: replace(found, id=found.id[:0]))
    panel.set(**values)
    assert says in html.unescape(panel._message.value)
    assert inner_names(panel) == []


def test_an_error_that_names_a_setting_names_its_control(example: Example) -> None:
    example._complain(DataError("selection.top_k: expected less; see selection.top_k, not filter.classes.x"))
    assert example.error == "top k: expected less; see top k, not filter.classes.x"


@pytest.mark.parametrize(
    ("text", "as_html"),
    [
        ("type `street` under *model*.", "type <code>street</code> under <i>model</i>."),
        ("under *five matches* (*x*) <b>", "under <i>five matches</i> (<i>x</i>) &lt;b&gt;"),
        ("`a *b* c` and *d*", "<code>a *b* c</code> and <i>d</i>"),
        ("a*b*c, 2 * 3 * 4, f(*a, *b), **bold**", "a*b*c, 2 * 3 * 4, f(*a, *b), **bold**"),
    ],
)
def test_marks_of_a_text_become_html(text: str, as_html: str) -> None:
    assert marked(text) == as_html


@pytest.mark.parametrize("model", ["street", "labels"])
@pytest.mark.parametrize(
    ("typed", "says"),
    [
        ("2", "there is no class 2 in the model street; type one of: vehicles, vehicle"),
        ("car", "there is no class 'car' in the model street; "),
        ("banana,truck", "there is no class 'banana' or 'truck' in the model street; "),
        ("flying saucer", "there is no class 'flying saucer' in "),
        ("car, vehicel", "there is no class 'vehicel' in "),
        ("", "classes: type a name, or several separated by commas, such as vehicles"),
        (" , ", "classes: type a name, or several separated by commas, such as vehicles"),
    ],
)
def test_messages_about_classes_name_the_control_of_the_panel(
    model: str, typed: str, says: str, street: Sequence
) -> None:
    panel = ch05.FilteringPanel(street, view__model=model)
    panel.wait(LONG)
    panel.knobs["filter.classes"].widget.value = typed
    said = panel.error or re.sub("<[^>]+>", "", html.unescape(panel._text.value))
    if "the model" in says and model == "labels":
        assert panel.error == ""  # the folder has no names, and these are numbers and names of COCO
        return
    assert says in said
    assert "classes: " in said
    assert "vehicles" in said
    assert "filter." not in said
    assert ".onnx" not in said


def test_classes_of_a_label_folder_are_named(bands: Path) -> None:
    with_box(bands, 6)
    (bands / "labels" / "classes.txt").write_text("tree\nbig, red van\nbus\n")
    panel = ch05.FilteringPanel(str(bands), frame=3, view__model="labels")
    panel.wait(LONG)
    panel.knobs["filter.classes"].widget.value = "trea"
    assert panel.error == (
        "classes: there is no class 'trea' in the label folder; did you mean tree? "
        "type one of: vehicles, tree, bus"
    )


def test_classes_have_names_and_missing_labels_are_named(street: Sequence, bands: Path) -> None:
    panel = ch05.FilteringPanel(street)
    classes = panel.knobs["filter.classes"].widget
    assert classes.value == "vehicles"
    classes.value = "car, truck ,5"
    assert panel.state().config.filter.classes == ("car", "truck", "5")
    panel.set(view__model="labels")
    assert "no label folder" not in panel._text.value
    bare = ch05.FilteringPanel(str(bands), frame=3, view__model="labels")
    bare.wait(LONG)
    assert bare.error == ""
    assert "no label folder" in bare._text.value
    assert "under <i>model</i>" in bare._text.value
