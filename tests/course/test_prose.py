"""What chapters 3 to 6 tell the reader to notice in their panels is there, on the street that they name."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import nbformat
import pytest

from course.ch03 import SelectionPanel
from course.ch04 import TranslationPanel
from course.ch05 import FilteringPanel
from course.ch06 import EvaluationPanel
from course.panel import Panel
from vo_lib.data.sequence import Sequence

FOLDER = Path(__file__).resolve().parents[2] / "notebooks"
PANELS: dict[str, type[Panel]] = {
    "03": SelectionPanel,
    "04": TranslationPanel,
    "05": FilteringPanel,
    "06": EvaluationPanel,
}
NONE_MADE_UP = {"view__scale": 0.0, "view__yaw": 0.0, "view__noise": 0.0, "view__jitter": 0.0}
LONG = 300.0  # seconds; a safeguard
Facts = dict[str, float]

# A sentence's beginning, its numbers as groups; settings; a test of (facts, facts before, numbers).
SEEN: list[tuple[str, str, dict[str, Any], Callable[[Facts, Facts, list[float]], bool]]] = [
    (
        "03",
        r"Set \*moving share\* to ([.\d]+) instead",
        {"view__moving": 0.6},
        lambda now, _, said: said == [0.6] and now["error by selection"] > 1.5,
    ),
    (
        "03",
        r"Set \*wrong share\* to ([.\d]+)",
        {"view__wrong": 0.6},
        lambda now, _, said: said == [0.6] and now["error by selection"] < 0.05,
    ),
    (
        "04",
        r"from a fraction of a millimetre to almost a tenth of a metre",
        {"view__weighting": "mean of features"},
        lambda now, before, _: before["σ in z"] < 0.5 and 80 < now["σ in z"] < 100,
    ),
    (
        "04",
        r"to (\d+) m\. A third of the features goes, and the error stays",
        {"translation__max_depth": 20},
        lambda now, before, said: (
            said == [20]
            and abs(now["features used"] / before["features used"] - 2 / 3) < 0.05
            and now["error"] < 1.5 * before["error"]
        ),
    ),
    (
        "04",
        r"At (\d+) m about a dozen are left, and the error jumps",
        {"translation__max_depth": 5},
        lambda now, before, said: (
            said == [5] and 10 <= now["features used"] <= 14 and now["error"] > 4 * before["error"]
        ),
    ),
    (
        "05",
        r"Lower the \*score\* to ([.\d]+): more than twice as many boxes",
        {"filter__score": 0.02},
        lambda now, before, said: said == [0.02] and now["boxes"] > 2 * before["boxes"],
    ),
    (
        "05",
        r"At ([.\d]+) a car swallows its neighbours",
        {"view__nms": 0.05},
        lambda now, before, said: said == [0.05] and now["boxes"] < before["boxes"],
    ),
    (
        "05",
        r"Type (\d) into \*classes\*: .* so no box counts",
        {"filter__classes": "7"},
        lambda now, _, said: said == [7] and now["boxes"] == now["removed"] == 0,
    ),
    (
        "05",
        r"Raise the \*margin\* to (\d): .* the filter goes off",
        {"filter__margin": 1.0},
        lambda now, _, said: said == [1] and now["removed"] == 0,
    ),
    (
        "05",
        r"Choose `labels`: the end of the white car behind the dark one has no box",
        {"view__model": "labels"},
        lambda now, before, _: now["boxes"] == before["boxes"] - 1,
    ),
    (
        "06",
        r"TE is (\d), whatever the length, and RE is (\d)\. With sim3, ATE is nearly 0",
        {**NONE_MADE_UP, "view__scale": 2.0, "view__alignment": "sim3"},
        lambda now, _, said: said == [round(now["TE"], 1), round(now["RE"], 1)] and now["ATE"] < 0.01,
    ),
    (
        "06",
        r"\*Noise\* of (\d+) mm alone: RPE is (\d+) mm a frame, TE ([.\d]+) %",
        {**NONE_MADE_UP, "view__noise": 50.0},
        lambda now, _, said: said == [50, round(now["RPE"]), round(now["TE"], 2)],
    ),
    (
        "06",
        r"\*Jitter\* of ([.\d]+)° alone: RPE is ([.\d]+) mm, and TE is ([.\d]+) %",
        {**NONE_MADE_UP, "view__jitter": 0.1},
        lambda now, _, said: said == [0.1, round(now["RPE"], 2), round(now["TE"], 2)],
    ),
]


@pytest.mark.parametrize(
    ("chapter", "sentence", "settings", "holds"), SEEN, ids=[row[1][:40] for row in SEEN]
)
def test_what_a_chapter_says_of_its_panel_is_seen(
    street: Sequence, chapter: str, sentence: str, settings: dict[str, Any], holds: Callable[..., bool]
) -> None:
    path = next(FOLDER.glob(f"{chapter}_*.ipynb"))
    cells = nbformat.read(path, as_version=4).cells  # type: ignore[no-untyped-call]
    said = re.search(sentence, "\n".join(cell.source for cell in cells))
    assert said is not None
    panel = PANELS[chapter](street, frame=60)
    panel.wait(LONG)
    before = dict(panel.facts)
    panel.set(**settings)
    panel.wait(LONG)
    assert panel.error == ""
    assert holds(panel.facts, before, [float(number) for number in said.groups()])
