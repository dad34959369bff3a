"""The notebooks in JupyterLab in a real browser: all cells run, and a slider changes a picture."""

from __future__ import annotations

import itertools
import json
import os
import socket
import subprocess
import sys
import time
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from conftest import BROWSERS, find_browser
from playwright.sync_api import BrowserContext, Page, sync_playwright

from course import appendix, ch00, ch01, ch02, ch03, ch04, ch05, ch06, ch07, ch09
from course.appendix import CalibrationPanel
from course.ch04 import TranslationPanel
from course.ch07 import ExplorePanel
from course.drawing import DPI, SMALL_SIZE, WIDTH
from course.panel import ERROR_CLASS, Panel
from course.results import NOT_YET_CLASS, RIGHT_CLASS
from vo_lib.data.sequence import Sequence

NOTEBOOKS = sorted((Path(__file__).resolve().parents[1] / "notebooks").glob("*.ipynb"))
TOKEN = "notebooks-under-test"
LONG = 600_000.0  # time limit of one step, milliseconds
SELDOM = 200.0  # polling interval, milliseconds; the default polls, and draws, every animation frame
SETTINGS = {
    # The page draws every cell, not only those in view.
    "@jupyterlab/notebook-extension/tracker": {"windowingMode": "none"}
}
ALL_DONE = """() => {
    const prompts = [...document.querySelectorAll('.jp-Notebook .jp-CodeCell .jp-InputPrompt')];
    return prompts.length > 0 && prompts.every(prompt => /\\[\\d+\\]/.test(prompt.textContent));
}"""
WRONG_OUTPUT = ".jp-RenderedText[data-mime-type*=stderr], .jp-RenderedText[data-mime-type*=error]"
PICTURES = """() => Promise.all([...document.querySelectorAll('.widget-image')].map(async image =>
    Array.from(new Uint8Array(await (await fetch(image.src)).arrayBuffer())).join()))"""

CHANGED = f"async before => (await ({PICTURES})()).some((picture, i) => picture !== before[i])"


def free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        return int(listener.getsockname()[1])


@pytest.fixture(scope="module")
def lab(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """Address of a JupyterLab that `vo lab` starts on a copy of the notebooks, without KITTI."""
    folder, port = tmp_path_factory.mktemp("lab"), free_port()
    for plugin, values in SETTINGS.items():
        path = folder / "settings" / f"{plugin}.jupyterlab-settings"
        path.parent.mkdir(parents=True)
        path.write_text(json.dumps(values), encoding="utf-8")
    places = {
        "JUPYTER_TOKEN": TOKEN,
        "JUPYTERLAB_SETTINGS_DIR": str(folder / "settings"),
        "JUPYTERLAB_WORKSPACES_DIR": str(folder / "workspaces"),
        "JUPYTER_CONFIG_DIR": str(folder / "config"),
        "IPYTHONDIR": str(folder / "ipython"),
        "KITTI_ROOT": "",  # test_notebooks.py has the clips
    }
    words = ["lab", "--copy", str(folder / "work"), "--", "--port", str(port), "--no-browser", "--allow-root"]
    log = folder / "server.log"
    with log.open("w") as printed:
        server = subprocess.Popen(
            [sys.executable, "-m", "vo_lib", *words],
            env={**os.environ, **places},
            stdout=printed,
            stderr=subprocess.STDOUT,
        )
    address = f"http://127.0.0.1:{port}"
    while not answers(f"{address}/api?token={TOKEN}"):
        assert server.poll() is None, log.read_text(encoding="utf-8")
        time.sleep(0.3)
    try:
        yield address
    finally:
        end = urllib.request.Request(f"{address}/api/shutdown?token={TOKEN}", method="POST")
        urllib.request.urlopen(end, timeout=30).close()
        server.wait(60)


def answers(address: str) -> bool:
    try:
        urllib.request.urlopen(address, timeout=10).close()
    except OSError:
        return False
    return True


@pytest.fixture(scope="module")
def browser() -> Iterator[BrowserContext]:
    """Headless system Chromium; the pages of one context share a cache."""
    executable = find_browser()
    if executable is None:
        pytest.skip(f"needs one of the browsers {', '.join(BROWSERS)}")
    with sync_playwright() as driver:
        # Root in a container has no sandbox and little shared memory.
        words = ["--no-sandbox", "--disable-dev-shm-usage"]
        started = driver.chromium.launch(executable_path=executable, args=words)
        yield started.new_context(viewport={"width": 1400, "height": 1000})
        started.close()


@pytest.mark.slow
@pytest.mark.usefixtures("street")
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebook_runs_in_a_browser(path: Path, lab: str, browser: BrowserContext) -> None:
    page = browser.new_page()
    page.set_default_timeout(LONG)
    complaints: list[str] = []
    page.on("pageerror", lambda error: complaints.append(str(error)))
    page.on("console", lambda line: complaints.append(line.text) if line.type == "error" else None)
    page.goto(f"{lab}/lab/tree/{path.name}?token={TOKEN}&reset")
    page.locator(".jp-Notebook .jp-CodeCell").first.wait_for()
    page.get_by_text("| Idle").first.wait_for()  # before that, "Run" would open a kernel dialog
    # A notebook that is only opened is not marked as changed.
    assert page.locator(".lm-TabBar-tab.jp-mod-dirty").count() == 0
    page.get_by_role("menuitem", name="Run", exact=True).click()
    page.get_by_role("menuitem", name="Run All Cells", exact=True).click()
    page.wait_for_function(ALL_DONE, polling=SELDOM)
    # Sections under "More" are folded: a slider in one of them could not be moved.
    folded = page.locator(".jp-showHiddenCellsButton:visible")
    while folded.count():
        folded.first.click()
    page.locator(".widget-image").first.wait_for(state="attached")
    before = page.evaluate(PICTURES)
    handle = page.locator(".widget-slider .noUi-handle").last
    handle.scroll_into_view_if_needed()
    handle.focus()
    # A slider may be at one end: move it in one direction, then further in the other.
    for key, times in (("ArrowRight", 3), ("ArrowLeft", 6)):
        for _ in range(times):
            page.keyboard.press(key)
    page.wait_for_function(CHANGED, arg=before, polling=SELDOM)
    if page.locator(".vo-clicks").count():  # of chapter 0: a click in the picture moves the cross
        before = page.evaluate(PICTURES)
        page.locator(".vo-clicks [onclick]").click()
        page.wait_for_function(CHANGED, arg=before, polling=SELDOM)
    judged = page.locator(f".{NOT_YET_CLASS}, .{RIGHT_CLASS}").count()
    assert judged == page.locator(f".{NOT_YET_CLASS}").count()
    assert judged >= 4 or path.name.startswith("appendix")
    assert page.locator(f".{ERROR_CLASS}, {WRONG_OUTPUT}").all_inner_texts() == []
    assert complaints == []
    page.close()


LAYOUT = """number => {
    const panel = document.querySelectorAll('.vo-panel')[number];
    panel.scrollIntoView();
    const visible = selector => [...panel.querySelectorAll(selector)].filter(each => each.offsetParent);
    const box = each => each.getBoundingClientRect();
    const view = box(document.querySelector('.jp-NotebookPanel-notebook'));
    const words = visible('.widget-label, .widget-readout, button, .vo-words');
    return {
        title: panel.querySelector('b').textContent,
        picture: box(visible('.widget-image')[0]).width,
        sliders: Math.min(...visible('.noUi-base').map(each => box(each).width)),
        below: box(panel).bottom - view.bottom,
        scrollable: visible('*').filter(each => ['auto', 'scroll'].includes(getComputedStyle(each).overflowY)
                && (each.scrollHeight > each.clientHeight || each.scrollWidth > each.clientWidth))
            .map(each => each.className),
        cut: words.filter(each => each.scrollWidth > each.clientWidth + 1).map(each => each.textContent),
    };
}"""
NAME = """const name = each => {
    const label = each.labels && each.labels.length ? each.labels[0].textContent : '';
    return each.getAttribute('aria-label') || label || each.textContent.trim();
};"""
# The place in a panel at which the Tab key has stopped, with the name for readers of the screen.
STOP = f"""number => {{
    {NAME}
    const each = document.activeElement, panel = document.querySelectorAll('.vo-panel')[number];
    const box = each.getBoundingClientRect(), whole = panel.getBoundingClientRect();  // the page may scroll
    return {{inside: panel.contains(each), name: name(each),
        x: box.x - whole.x, y: box.y + box.height / 2 - whole.y}};
}}"""
# The names of all controls that can be changed.
CONTROLS = f"""number => {{
    {NAME}
    const panel = document.querySelectorAll('.vo-panel')[number];
    const every = [...panel.querySelectorAll('select, input, button, [role=slider], [role=textbox]')];
    return every.filter(each => each.offsetParent && getComputedStyle(each).visibility === 'visible'
        && !each.disabled && !each.closest('[disabled]')).map(name);
}}"""
# Menus, texts, tick boxes and sliders, by label, without a tooltip.
WITHOUT_TIP = """number => [...document.querySelectorAll('.vo-panel')[number]
    .querySelectorAll('.widget-dropdown, .widget-text, .widget-checkbox, .widget-hslider > label')]
    .filter(each => each.offsetParent && [null, '', 'null'].includes(each.getAttribute('title')))
    .map(each => each.textContent)"""
SOURCE = "number => document.querySelectorAll('.vo-panel')[number].querySelector('.widget-image').src"
MOST_STOPS = 60  # of the Tab key in a panel


def run_cells(lab: str, browser: BrowserContext, codes: list[str]) -> Page:
    """A page of 1366 × 768 pixels with a notebook of these cells, which have been run."""
    cells: list[dict[str, Any]] = [
        {"cell_type": "code", "source": code, "metadata": {}, "outputs": [], "execution_count": None}
        for code in codes
    ]
    kernel = {"name": "python3", "display_name": "Python 3"}
    notebook = {"cells": cells, "metadata": {"kernelspec": kernel}, "nbformat": 4, "nbformat_minor": 4}
    body = json.dumps({"type": "notebook", "content": notebook}).encode()
    address = f"{lab}/api/contents/panels.ipynb?token={TOKEN}"
    urllib.request.urlopen(urllib.request.Request(address, body, method="PUT"), timeout=60).close()
    page = browser.new_page()
    page.set_viewport_size({"width": 1366, "height": 768})
    page.set_default_timeout(LONG)
    page.goto(f"{lab}/lab/tree/panels.ipynb?token={TOKEN}&reset")
    page.locator(".jp-Notebook .jp-CodeCell").first.wait_for()
    page.keyboard.press("Control+b")  # closes the file browser
    page.get_by_text("| Idle").first.wait_for()
    page.get_by_role("menuitem", name="Run", exact=True).click()
    page.get_by_role("menuitem", name="Run All Cells", exact=True).click()
    page.wait_for_function(ALL_DONE, polling=SELDOM)
    return page


def assert_fits(page: Page, number: int) -> None:
    """A panel of a page is in view as a whole, and large enough to be read."""
    layout = page.evaluate(LAYOUT, number)
    assert layout["picture"] >= 800, layout
    assert layout["picture"] / WIDTH * SMALL_SIZE * DPI / 72 >= 10, layout  # pixels of its smallest text
    assert layout["sliders"] >= 180, layout
    assert layout["below"] <= 0, layout
    assert layout["cut"] == [], layout
    assert layout["scrollable"] == [], layout  # Tab would stop there


def assert_tab_order(page: Page, number: int) -> list[str]:
    """The Tab key stops at each control of a panel in the order on the page; return the names."""
    page.locator(".vo-panel").nth(number).get_by_role("combobox", name="sequence", exact=True).focus()
    stops: list[dict[str, Any]] = []
    stop = page.evaluate(STOP, number)
    while stop["inside"] and len(stops) < MOST_STOPS:
        stops.append(stop)
        page.keyboard.press("Tab")
        stop = page.evaluate(STOP, number)
    for one, following in itertools.pairwise(stops):
        below = following["y"] - one["y"]
        assert below > 8 or (abs(below) <= 8 and following["x"] > one["x"]), (one, following)
    names = [stop["name"] for stop in stops]
    assert all(names), names
    assert len({*names}) == len(names), names
    assert sorted(names) == sorted(page.evaluate(CONTROLS, number))
    return names


@pytest.mark.slow
@pytest.mark.usefixtures("street")
def test_all_panels_fit_on_a_laptop(lab: str, browser: BrowserContext) -> None:
    chapters = appendix, ch00, ch01, ch02, ch03, ch04, ch05, ch06, ch07, ch09
    exported = [each for chapter in chapters for each in vars(chapter).values()]
    kinds = [each for each in exported if isinstance(each, type) and issubclass(each, Panel)]
    codes = [
        f"from {kind.__module__} import {kind.__name__}\npanel = {kind.__name__}()\npanel.wait()\npanel"
        for kind in kinds
    ]
    page = run_cells(lab, browser, codes)
    for number in range(len(kinds)):
        panel = page.locator(".vo-panel").nth(number)
        panel.locator(".vo-words div").first.wait_for()
        assert_fits(page, number)
        published = assert_tab_order(page, number)
        assert page.evaluate(WITHOUT_TIP, number) == []
        if kinds[number].kit is not None:
            assert "method" in published
            shown = page.evaluate(SOURCE, number)
            panel.get_by_role("combobox", name="method", exact=True).select_option("kit")
            page.wait_for_function(
                f"([n, shown]) => ({SOURCE})(n) !== shown", arg=[number, shown], polling=SELDOM
            )
            assert_tab_order(page, number)
    assert page.locator(f".{ERROR_CLASS}, {WRONG_OUTPUT}").all_inner_texts() == []
    page.close()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "name", "label", "step", "last"),
    [
        (TranslationPanel, "view.noise", "noise added [px]", 0.05, "draw again"),
        (ExplorePanel, "selection.threshold", "inlier threshold [px]", 0.05, "seed, as a number"),
        (CalibrationPanel, "view.tilt", "tilt [px]", 0.1, "terms learnt"),
    ],
)
def test_a_panel_follows_the_drag(
    kind: type[Panel],
    name: str,
    label: str,
    step: float,
    last: str,
    lab: str,
    browser: BrowserContext,
    street: Sequence,
) -> None:
    """Layout, pictures before the mouse is released, keys and names; `last` is the last control's name."""
    code = f"from {kind.__module__} import {kind.__name__}\npanel = {kind.__name__}()\npanel"
    page = run_cells(lab, browser, [code])
    page.locator(".vo-words div").first.wait_for()  # the first picture is drawn
    assert_fits(page, 0)

    slider = page.get_by_role("slider", name=label, exact=True)
    box = slider.bounding_box()
    assert box is not None
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    before = page.evaluate(PICTURES)
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + 40, y, steps=10)
    page.wait_for_function(CHANGED, arg=before, polling=SELDOM)
    during = page.evaluate(PICTURES)
    page.mouse.move(x + 100, y, steps=10)
    page.wait_for_function(CHANGED, arg=during, polling=SELDOM)
    page.mouse.up()
    number = page.get_by_role("textbox", name=f"{label}, as a number", exact=True)
    value = float(number.inner_text())
    page.keyboard.press("ArrowLeft")
    moved = float(number.inner_text())
    assert moved == pytest.approx(value - step)
    panel = kind(street)
    panel.wait()
    panel.set(**{name: moved})
    at_once = ",".join(str(byte) for byte in panel.picture.value)
    page.wait_for_function(
        f"async wanted => (await ({PICTURES})())[0] === wanted", arg=at_once, polling=SELDOM
    )

    names = assert_tab_order(page, 0)
    assert names[-1] == last
    assert {"frame", label, f"{label}, as a number", "play the frames"} < {*names}
    assert page.get_by_role("img", name=kind.title).count() == 1
    page.close()


@pytest.mark.slow
def test_lab_opens_the_course_without_dialogs(lab: str, browser: BrowserContext) -> None:
    page = browser.new_page()
    page.set_default_timeout(LONG)
    requests: list[str] = []
    page.on("request", lambda request: requests.append(request.url))
    page.goto(f"{lab}/?token={TOKEN}")
    page.get_by_text("| Idle").first.wait_for()
    assert page.url.startswith(f"{lab}/lab/workspaces/stereo-vo-course/tree/00_start_here.ipynb")
    tabs = page.locator(".lm-DockPanel-tabBar .lm-TabBar-tabLabel")
    assert tabs.all_inner_texts() == ["00_start_here.ipynb"]
    assert not page.locator(".jp-FileBrowser").first.is_visible()  # pictures need the width
    picture = page.locator(".jp-RenderedMarkdown img").first
    picture.scroll_into_view_if_needed()
    assert picture.evaluate("image => image.naturalWidth") > 0
    page.locator(".jp-RenderedMarkdown a", has_text="glossary").first.click()
    page.get_by_role("heading", name="Glossary").wait_for()
    assert tabs.count() == 2
    assert page.locator(".Toastify__toast, .jp-Dialog").count() == 0
    assert [address for address in requests if not address.startswith((lab, "data:", "blob:"))] == []
    page.close()
