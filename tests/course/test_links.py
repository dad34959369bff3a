"""Each anchor in a link leads to a heading, in the pages of the kit and in the notebooks."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
LINK = re.compile(r"\]\((?!\w+://)([^)#\s]*)#([^)\s]+)\)")
PAGES = [
    ROOT / "README.md",
    ROOT / "CONTRIBUTING.md",
    *sorted((ROOT / "notebooks").glob("*.md")),
    *sorted((ROOT / "notebooks").rglob("*.ipynb")),
]


def prose(path: Path) -> str:
    """The Markdown of a page or a notebook, without its blocks of code."""
    text = path.read_text(encoding="utf-8")
    if path.suffix == ".ipynb":
        cells = json.loads(text)["cells"]
        text = "\n\n".join("".join(cell["source"]) for cell in cells if cell["cell_type"] == "markdown")
    return re.sub(r"^```.*?^```", "", text, flags=re.MULTILINE | re.DOTALL)


def anchors(markdown: str) -> set[str]:
    """The anchors of the headings, as GitHub makes them: small letters, a hyphen for each space."""
    found = set[str]()
    for heading in re.findall(r"^#+ +(.*?)\s*$", markdown, re.MULTILINE):
        words = re.sub(r"\]\([^)]*\)", "", heading)
        name = re.sub(r"[^\w\- ]", "", words).lower().replace(" ", "-")
        number = 0
        while (f"{name}-{number}" if number else name) in found:
            number += 1
        found.add(f"{name}-{number}" if number else name)
    return found


def dead_links(path: Path) -> list[str]:
    """The links of a page whose anchor is no heading of the page that they name."""
    dead = list[str]()
    for target, anchor in LINK.findall(prose(path)):
        page = path.parent / target if target else path
        if not page.is_file() or anchor not in anchors(prose(page)):
            dead.append(f"{target}#{anchor}")
    return dead


@pytest.mark.parametrize("path", PAGES, ids=lambda path: str(path.relative_to(ROOT)))
def test_every_anchor_is_a_heading(path: Path) -> None:
    assert dead_links(path) == []


def test_a_dead_anchor_is_found(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text("## Hand in, and mark\n\n[a](#hand-in-and-mark) [b](#hand-in) [c](other.md#x)\n")
    assert dead_links(page) == ["#hand-in", "other.md#x"]


def test_the_page_for_teachers_has_what_the_commands_refer_to() -> None:
    """The page for teachers has the words that students and commands lead to."""
    page = prose(ROOT / "notebooks" / "teaching.md")
    words = ("vo lab --hand-in", "course.marks", "course.strict()", "nbgrader", "**Four classes.**")
    assert [word for word in (*words, "**Eleven to thirteen classes.**") if word not in page] == []
