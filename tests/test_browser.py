"""The notebooks in JupyterLab in a real browser: all cells run, and a slider changes a picture."""

from __future__ import annotations

import json
import os
import socket
import subprocess
import sys
import time
import urllib.request
from collections.abc import Iterator
from pathlib import Path

import pytest
from conftest import BROWSERS, find_browser
from playwright.sync_api import BrowserContext, sync_playwright

from course.panel import ERROR_CLASS
from course.results import NOT_YET_CLASS, RIGHT_CLASS

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
    page.get_by_role("menuitem", name="Run", exact=True).click()
    page.get_by_role("menuitem", name="Run All Cells", exact=True).click()
    page.wait_for_function(ALL_DONE, polling=SELDOM)
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
    picture = page.locator(".jp-RenderedMarkdown img").first
    picture.scroll_into_view_if_needed()
    assert picture.evaluate("image => image.naturalWidth") > 0
    page.locator(".jp-RenderedMarkdown a", has_text="glossary").first.click()
    page.get_by_role("heading", name="Glossary").wait_for()
    assert tabs.count() == 2
    assert page.locator(".Toastify__toast, .jp-Dialog").count() == 0
    assert [address for address in requests if not address.startswith((lab, "data:", "blob:"))] == []
    page.close()
