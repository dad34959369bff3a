"""Reports: one page that holds everything, escapes its text and can be read on any screen."""

from __future__ import annotations

import base64
import re

import cv2
import numpy as np

from vo_lib.tables.report import Picture, ReportTable, render_report

PNG = bytes(cv2.imencode(".png", np.zeros((4, 4), np.uint8))[1])


def page(problems: tuple[str, ...] = ()) -> str:
    """A page with signs of markup wherever a text may stand, its elements closed in turn."""
    table = ReportTable(
        "<b>", ["a & b", "solution_selection <TE>"], [["kitti/07, <script> a_b", "1"]], ["1 < 2"]
    )
    text = render_report("t", ["<i>"], [table], [Picture(PNG, "a <caption>")], ["x"], problems)
    opened: list[str] = []
    for closing, tag in re.findall(r"<(/?)(\w+)", text.split("</head>")[1].split("</html>")[0]):
        if closing:
            assert opened.pop() == tag
        elif tag not in ("img", "br", "wbr"):
            opened.append(tag)
    assert opened == []
    return text


def test_text_is_escaped_and_a_long_name_may_break_at_its_underscores() -> None:
    text = page()
    assert "a &amp; b" in text
    assert "solution_<wbr>selection &lt;TE&gt;</th>" in text
    assert "kitti/07, &lt;script&gt; a_<wbr>b</th>" in text


def test_pictures_are_inside_and_have_words() -> None:
    ((source, words),) = re.findall(r'<img src="([^"]+)" alt="([^"]+)">', page())
    assert words == "a &lt;caption&gt;"
    assert base64.b64decode(source.removeprefix("data:image/png;base64,")) == PNG
    assert not re.search(r'(?:src|href)="(?!data:)', page())
    assert Picture(b"\xff\xd8\xff", "x").address == "data:image/jpeg;base64,/9j/"


def test_a_telephone_shows_it_in_its_own_width_and_tables_scroll_in_their_box() -> None:
    text = page()
    assert re.search(r'<meta name="viewport" content="[^"]*device-width', text)
    # A box that scrolls is reached with the keyboard and has a name.
    assert '<div class="scroll" tabindex="0" role="region" aria-label="&lt;b&gt;"><table' in text


def test_problems_come_first_and_only_where_there_are_any() -> None:
    assert 'class="problems"' not in page()
    text = page(("Not found: <07>",))
    assert text.index("Not found: &lt;07&gt;") < text.index("<table")
