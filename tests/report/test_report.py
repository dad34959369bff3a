"""The HTML page of a report: escaping, order and links."""

from __future__ import annotations

import re
from datetime import date
from pathlib import Path

import cv2
import numpy as np
import pytest
from conftest import find_browser
from playwright.sync_api import sync_playwright

from vo_lib.report.page import Picture, ReportTable, ShownFilm, render_report
from vo_lib.report.plots import jpeg

PNG = bytes(cv2.imencode(".png", np.zeros((4, 4), np.uint8))[1])


def page(problems: tuple[str, ...] = ()) -> str:
    """A report page with markup characters in every text."""
    table = ReportTable(
        "<b>", ["a & b", "solution_selection <TE>"], [["kitti/07, <script> a_b", "1"]], ["1 < 2"]
    )
    pictures = [Picture(PNG, "a <caption>")] * 3
    return render_report(["<said>"], [table], [table], pictures, ["x"], problems)


def test_report_escapes_text() -> None:
    text = page()
    assert "a &amp; b" in text
    assert "solution_<wbr>selection &lt;TE&gt;</th>" in text
    assert "kitti/07, &lt;script&gt; a_<wbr>b</th>" in text
    # A scrolling box has a name and can be reached by the keyboard.
    assert '<div class="scroll" tabindex="0" role="region" aria-label="&lt;b&gt;"><table' in text


def test_report_starts_with_the_result() -> None:
    text = page()
    first, second, third = (match.start() for match in re.finditer("<img", text))
    assert text.index("&lt;said&gt;") < first < second < text.index("<table") < third
    assert text.index('<details id="table2">') < text.rindex("<table")
    links = set(re.findall('href="#([^"]*)"', text))
    assert (
        links == set(re.findall(' id="([^"]*)"', text)) == {"table1", "table2", "more", "methods", "origin"}
    )
    assert date.today().isoformat() in text


def test_problems_follow_the_first_pictures() -> None:
    assert 'class="problems"' not in page()
    text = page(("Not found: <07>",))
    assert text.index("<img") < text.index("Not found: &lt;07&gt;") < text.index("<table")


@pytest.mark.slow  # the browser, which .ci/run installs meanwhile
def test_image_of_a_frame_is_above_the_paths_and_beside_the_errors(tmp_path: Path) -> None:
    browser = find_browser()
    if browser is None:
        pytest.skip("no Chromium or Chrome is installed")
    frame = Picture(jpeg(np.zeros((376, 1241, 3), np.uint8)), "a frame", "wide")
    bars = Picture(bytes(cv2.imencode(".png", np.zeros((896, 768), np.uint8))[1]), "errors", "tall")
    paths = Picture(bytes(cv2.imencode(".png", np.zeros((576, 1536), np.uint8))[1]), "paths", "two")
    film = ShownFilm("film.webm", "a film", jpeg(np.full((90, 160, 3), 200, np.uint8)))
    text = render_report([], [], [], [frame, bars, paths], [], films=[film])
    (tmp_path / "report.html").write_text(text, encoding="utf-8")
    with sync_playwright() as play:
        opened = play.chromium.launch(executable_path=browser, args=["--no-sandbox"])
        view = opened.new_page(viewport={"width": 1366, "height": 768})
        view.goto((tmp_path / "report.html").as_uri())
        boxes = [figure.bounding_box() for figure in view.query_selector_all(".pictures figure")]
        first, beside, below = (box for box in boxes if box is not None)
        assert first["x"] == below["x"] < beside["x"]
        assert first["y"] == beside["y"] < below["y"]
        assert first["width"] == below["width"] > 800
        poster = view.evaluate("document.querySelector('video').poster")
        assert poster.startswith("data:image/jpeg;base64")
        opened.close()


@pytest.mark.slow  # the browser, which .ci/run installs meanwhile
def test_telephone_shows_all_columns_and_one_panel(tmp_path: Path) -> None:
    browser = find_browser()
    if browser is None:
        pytest.skip("no Chromium or Chrome is installed")
    cells = ["feature_selection", "10.505 ± 0.041", "10.477 ± 0.023", "31.6"]
    table = ReportTable("synthetic/jam", ["method", "TE %", "RE deg/100 m", "removed %"], [cells], [])
    wide = Picture(bytes(cv2.imencode(".png", np.zeros((900, 1536), np.uint8))[1]), "paths", "two")
    page = render_report([], [table], [], [wide], [])
    (tmp_path / "report.html").write_text(page, encoding="utf-8")
    with sync_playwright() as play:
        opened = play.chromium.launch(executable_path=browser, args=["--no-sandbox"])
        view = opened.new_page(viewport={"width": 390, "height": 844})
        view.goto((tmp_path / "report.html").as_uri())
        widths = "[document.documentElement, document.querySelector(NAME)].map(e => e.scrollWidth)"
        assert view.evaluate(widths.replace("NAME", "'.scroll'")) == [390, 356]
        assert view.evaluate(widths.replace("NAME", "'figure'")) == [390, 2 * 358]
        opened.close()
