"""The page "paper and code" and its list of choices agree with the code."""

from __future__ import annotations

import importlib
import inspect
import re
from pathlib import Path
from typing import Any

import pytest

from vo_lib.paper.settings import PublishedConfig
from vo_lib.settings import declared

NOTEBOOKS = Path(__file__).resolve().parents[1] / "notebooks"
PAGE = (NOTEBOOKS / "paper_and_code.md").read_text(encoding="utf-8")
WORDS = ("as said", "changed", "left open")
DOTTED = re.compile(r"`((?:vo_lib|course|fetch|training)(?:\.\w+){2,}|train_detector\.\w+)`")
HELPERS = {"__init__", "settings", "real_roots", "sampson"}  # modules without a stage of the method
GIVEN = {"buckets.size", "selection.top_k"}  # settings with values in the paper


def table_rows(text: str) -> list[list[str]]:
    """Cells of all tables in a text, without the headings."""
    lines = [line for line in text.splitlines() if line.startswith("|")]
    cells = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]
    heads = [number - 1 for number, row in enumerate(cells) if set("".join(row)) <= set("-:")]
    return [row for number, row in enumerate(cells) if number not in heads and number - 1 not in heads]


def named(name: str) -> Any:
    """The object with a dotted name."""
    parts = name.split(".")
    for length in range(len(parts) - 1, 0, -1):
        try:
            result: Any = importlib.import_module(".".join(parts[:length]))
        except ModuleNotFoundError:
            continue
        for part in parts[length:]:
            result = getattr(result, part)
        return result
    raise ModuleNotFoundError(name)


SENTENCES, CHOICES = PAGE.split("## What the paper leaves open")
ROWS = table_rows(SENTENCES)


@pytest.mark.parametrize("name", sorted(set(DOTTED.findall(PAGE))))
def test_names_on_the_page_exist(name: str) -> None:
    result = named(name)
    assert inspect.isfunction(result) or inspect.isclass(result)


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row[0][:40])
def test_statements_have_code_and_one_verdict(row: list[str]) -> None:
    _, where, verdict = row
    assert re.sub(DOTTED, "", where).strip(" ,") == ""
    assert DOTTED.search(where)
    assert verdict.startswith(WORDS)
    assert sum(verdict.count(word) for word in WORDS) == 1


def test_page_names_all_stages() -> None:
    stages = {path.stem for path in (NOTEBOOKS.parent / "vo_lib" / "paper").glob("*.py")} - HELPERS
    assert {name.split(".")[2] for name in DOTTED.findall(PAGE) if ".paper." in name} == stages


def test_choices_are_listed_with_their_values() -> None:
    listed = dict(re.findall(r"`([a-z_]+(?:\.[a-z_]+)?)` = (\d+(?:\.\d+)?)", CHOICES))
    settings = {setting.name: setting.default for setting in declared(PublishedConfig)}
    assert set(listed) == {name for name, default in settings.items() if is_number(default)} - GIVEN
    for name, value in listed.items():
        assert float(value) == settings[name], name


def is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)
