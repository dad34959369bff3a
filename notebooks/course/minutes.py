"""How long a chapter takes, by one rule for all chapters.

    python -m course.minutes

Reading: words / 180 minutes. An exercise: 1 minute for one star, 5 for two, 20 for three. A panel: 8 minutes.
A core ends with its section "Summary" (chapters 2 and 5 have two cores); what follows "More" is optional.
"""

from __future__ import annotations

import json
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from .notebook_folder import NOTEBOOKS

WORDS_A_MINUTE = 180
EXERCISE_MINUTES = {1: 1, 2: 5, 3: 20}  # by the number of stars
PANEL_MINUTES = 8
LONGEST_CORE = 75  # minutes

HEADING = re.compile(r"^## (.*)", re.MULTILINE)
EXERCISE = re.compile(r"^#+ Exercise \S+ (★+)", re.MULTILINE)
PANEL = re.compile(r"^#+ (?:The )?panel\b", re.MULTILINE | re.IGNORECASE)
FOLDED = "jp-MarkdownHeadingCollapsed"  # JupyterLab's metadata of a heading whose section is folded


@dataclass(frozen=True)
class Times:
    """Minutes of a chapter, by the rule of this module."""

    cores: tuple[int, ...]
    more: int


def minutes_of(text: str) -> float:
    """Minutes for some Markdown of a chapter."""
    reading = len(text.split()) / WORDS_A_MINUTE
    exercises = sum(EXERCISE_MINUTES[len(stars)] for stars in EXERCISE.findall(text))
    panels = PANEL_MINUTES * len(PANEL.findall(text))
    return reading + exercises + panels


def times(path: Path) -> Times:
    """Minutes of the cores and of the optional part of a notebook, each rounded to a whole number."""
    prose = "\n\n".join(text_of(cell) for cell in cells_of(path) if cell["cell_type"] == "markdown")
    core, _, more = prose.partition("\n## More")
    ends = [found.start() for found in HEADING.finditer(core) if found[1].startswith("Summary")]
    # The lines below a summary belong to it, up to the next heading of this level.
    starts = [0]
    for end in ends[:-1]:
        following = HEADING.search(core, end + 1)
        starts.append(following.start() if following else len(core))
    parts = [core[start:stop] for start, stop in zip(starts, [*starts[1:], len(core)], strict=True)]
    return Times(tuple(round(minutes_of(part)) for part in parts), round(minutes_of(more)))


def cells_of(path: Path) -> list[dict[str, Any]]:
    """The cells of a notebook."""
    return list(json.loads(path.read_text(encoding="utf-8"))["cells"])


def text_of(cell: dict[str, Any]) -> str:
    """The text of a cell."""
    return "".join(cell["source"])


def main() -> None:
    """Print the minutes of all chapters."""
    print(f"{'chapter':32} {'core':>9} {'more':>5}")
    for path in sorted(NOTEBOOKS.glob("*.ipynb")):
        made = times(path)
        print(f"{path.stem:32} {' + '.join(map(str, made.cores)):>9} {made.more:>5}")


if __name__ == "__main__":
    main()
