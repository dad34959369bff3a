"""The time of a chapter follows one rule, its head tells it, and its optional sections are folded."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

from course.minutes import FOLDED, LONGEST_CORE, cells_of, minutes_of, text_of, times
from course.notebook_folder import NOTEBOOKS

# Chapters whose core has an end and whose optional part is folded.
DIVIDED = [
    path
    for path in sorted(NOTEBOOKS.glob("*.ipynb"))
    if any(text_of(cell).startswith("## More") for cell in cells_of(path))
]
ROUNDED = 3  # minutes: the head rounds
EXACT = ("00_start_here", "01_feature_matching")  # whose heads don't


def test_minutes_are_words_stars_and_panels() -> None:
    assert minutes_of("word " * 180) == 1.0
    exercise = "### Exercise 2.1 ★: a\n#### Exercise 2.2 ★★: b\n### Exercise 2.3 ★★★: c\n"
    words = len(exercise.split()) / 180
    assert minutes_of(exercise) == pytest.approx(words + 1 + 5 + 20)
    assert minutes_of("## Panel\n") == pytest.approx(2 / 180 + 8)


def test_a_chapter_with_two_summaries_has_two_cores(tmp_path: Path) -> None:
    word = "word " * 180
    parts = [
        "# 2 Title",
        f"## A\n{word}",
        "## Summary of part one\nx",
        f"## B\n{word * 2}",
        "## Summary of part two",
        f"## More\n{word * 3}",
    ]
    cells = [{"cell_type": "markdown", "source": [text]} for text in parts]
    path = tmp_path / "two.ipynb"
    path.write_text(json.dumps({"cells": cells}))
    made = times(path)
    assert made.cores == (1, 2)
    assert made.more == 3


@pytest.mark.parametrize("path", DIVIDED, ids=lambda path: path.stem)
def test_a_core_is_short_enough_and_the_first_cell_has_its_minutes(path: Path) -> None:
    made = times(path)
    head = text_of(cells_of(path)[0])
    found = re.search(r"\*\*Time\*\*: ([^\n]*)", head)
    told = [int(number) for number in re.findall(r"\d+", found[1])] if found else []
    measured = [*made.cores, made.more]
    rounded = 0 if path.stem in EXACT else ROUNDED
    for right in measured:
        assert any(abs(number - right) <= rounded for number in told), (
            f"the rule gives {measured}, told: {told}"
        )
    assert max(made.cores) <= LONGEST_CORE


@pytest.mark.parametrize("path", DIVIDED, ids=lambda path: path.stem)
def test_the_sections_under_more_are_folded(path: Path) -> None:
    under_more = False
    for cell in cells_of(path):
        text = text_of(cell)
        is_heading = cell["cell_type"] == "markdown" and text.startswith("### ")
        if cell["cell_type"] == "markdown" and re.search(r"^## ", text, re.MULTILINE):
            under_more = text.startswith("## More")
        # A heading in the middle of a cell is not folded by JupyterLab.
        if under_more and cell["cell_type"] == "markdown":
            assert not re.search(r"\n### ", text), text[:60]
        assert cell["metadata"] == ({FOLDED: True} if under_more and is_heading else {}), text[:60]


def test_stripping_the_outputs_keeps_folded_headings(tmp_path: Path) -> None:
    cells = [
        {"cell_type": "markdown", "source": ["### Optional"], "metadata": {FOLDED: True}, "id": "a"},
        {
            "cell_type": "code",
            "source": ["1"],
            "metadata": {},
            "id": "b",
            "execution_count": 3,
            "outputs": [
                {
                    "output_type": "execute_result",
                    "data": {"text/plain": "1"},
                    "metadata": {},
                    "execution_count": 3,
                }
            ],
        },
    ]
    path = tmp_path / "chapter.ipynb"
    path.write_text(json.dumps({"cells": cells, "metadata": {}, "nbformat": 4, "nbformat_minor": 5}))
    # The command of .pre-commit-config.yaml.
    command = [sys.executable, "-m", "nbstripout", "--extra-keys", "metadata.widgets", str(path)]
    subprocess.run(command, check=True)
    folded, code = cells_of(path)
    assert folded["metadata"] == {FOLDED: True}
    assert code["outputs"] == []
