"""Reports: one page that holds everything, escapes its text and can be read on any screen."""

from __future__ import annotations

import base64
import re
from html.parser import HTMLParser

import cv2
import numpy as np

from vo_lib.tables.report import Picture, ReportTable, render_report

PNG = bytes(cv2.imencode(".png", np.zeros((4, 4), np.uint8))[1])


class Balance(HTMLParser):
    """Counts open elements, and fails where one is closed that is not open."""

    empty = frozenset({"meta", "img", "br", "wbr"})

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.seen: list[tuple[str, dict[str, str | None]]] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.seen.append((tag, dict(attrs)))
        if tag not in self.empty:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


def parsed(page: str) -> Balance:
    parser = Balance()
    parser.feed(page)
    assert parser.open == []
    return parser


def page(problems: tuple[str, ...] = ()) -> str:
    table = ReportTable("<b>", ["a & b", "c"], [["<script>", "1"]], ["1 < 2"])
    picture = Picture(PNG, "a <caption>")
    return render_report("t", ["<i>"], [table], [picture, Picture(PNG, "alone")], ["x"], problems)


def test_text_is_escaped_and_elements_close() -> None:
    text = page()
    assert "<script>" not in text
    assert "&lt;script&gt;" in text
    assert "a &amp; b" in text
    parsed(text)


def test_a_long_name_may_break_at_its_underscores_and_is_escaped() -> None:
    table = ReportTable("t", ["a", "solution_selection <TE>"], [["kitti/07, moving_selection", "1"]], [])
    text = render_report("t", [], [table], [], [])
    assert "solution_<wbr>selection &lt;TE&gt;</th>" in text
    assert "kitti/07, moving_<wbr>selection</th>" in text
    parsed(text)


def test_pictures_are_inside_and_have_words() -> None:
    images = [attributes for tag, attributes in parsed(page()).seen if tag == "img"]
    assert [image["alt"] for image in images] == ["a <caption>", "alone"]
    source = images[0]["src"]
    assert source is not None
    assert base64.b64decode(source.removeprefix("data:image/png;base64,")) == PNG
    assert not re.search(r'(?:src|href)="(?!data:)', page())
    assert Picture(b"\xff\xd8\xff", "x").address == "data:image/jpeg;base64,/9j/"


def test_a_telephone_shows_it_in_its_own_width_and_tables_scroll_in_their_box() -> None:
    seen = parsed(page()).seen
    assert any(a.get("name") == "viewport" and "device-width" in str(a.get("content")) for _, a in seen)
    boxes = [a for tag, a in seen if tag == "div" and a.get("class") == "scroll"]
    assert len(boxes) == sum(tag == "table" for tag, _ in seen) == 1
    # A box that scrolls is reached with the keyboard and has a name.
    assert boxes[0]["tabindex"] == "0"
    assert boxes[0]["aria-label"] == "<b>"


def test_problems_come_first_and_only_where_there_are_any() -> None:
    assert 'class="problems"' not in page()
    text = page(("Not found: <07>",))
    assert text.index("Not found: &lt;07&gt;") < text.index("<table")
    parsed(text)
