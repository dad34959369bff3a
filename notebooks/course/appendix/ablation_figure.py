"""The picture of the kit's ideas: what TE and RE become without each of them."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from vo_lib.geometry.types import Array

from ..colours import DARK
from ..drawing import DPI, FONT_SIZE, TITLE_SIZE, WIDTH

ABLATION = Path(__file__).parents[2] / "ablation.csv"  # written by `vo data measure_ablation`
ROW_HEIGHT, NAMES_WIDTH, HEAD_HEIGHT = 17, 265, 100  # pixels
FULL_COLOUR = 2.5  # the ratio of errors that has the darkest colour


def ablation_ratios(path: Path = ABLATION) -> tuple[list[str], list[str], Array]:
    """Ideas, sequences, and ratios (2, ideas, sequences) of TE and RE without an idea to those of the whole
    kit."""
    with path.open(encoding="utf-8", newline="") as lines:
        rows = [*csv.DictReader(lines)]
    whole = {(row["method"], row["sequence"]): row for row in rows if not row["idea"]}
    off = [row for row in rows if row["lines"]]
    ideas, sequences = (list(dict.fromkeys(row[key] for row in off)) for key in ("idea", "sequence"))
    ratios = np.full((2, len(ideas), len(sequences)), np.nan)
    for row in off:
        base = whole[row["method"], row["sequence"]]
        for kind, name in enumerate(("te", "re")):
            place = kind, ideas.index(row["idea"]), sequences.index(row["sequence"])
            ratios[place] = 1.0 + float(row[name]) / float(base[name])
    return ideas, sequences, ratios


def ablation_figure(path: Path = ABLATION) -> Figure:
    """Change of TE and RE without an idea, %; red is worse without it, blue better, a dash not measured."""
    ideas, sequences, ratios = ablation_ratios(path)
    height = HEAD_HEIGHT + ROW_HEIGHT * len(ideas)
    made = Figure(figsize=(WIDTH / DPI, height / DPI), dpi=DPI)
    left, wide = NAMES_WIDTH / WIDTH, 0.5 * (1.0 - NAMES_WIDTH / WIDTH) - 0.01
    for kind, title in enumerate(("TE without it [%]", "RE without it [%]")):
        axis = made.add_axes((left + kind * (wide + 0.01), 0.01, wide, 0.99 - HEAD_HEIGHT / height))
        shade = np.log(ratios[kind]) / np.log(FULL_COLOUR)
        axis.imshow(shade, cmap="RdBu_r", vmin=-1.0, vmax=1.0, aspect="auto")
        for (row, column), ratio in np.ndenumerate(ratios[kind]):
            words = "–" if np.isnan(ratio) else f"{100 * (ratio - 1):+.0f}"
            if words not in ("+0", "-0"):
                colour = "white" if abs(shade[row, column]) > 0.8 else DARK
                look: dict[str, Any] = {"ha": "center", "va": "center", "fontsize": FONT_SIZE - 2}
                axis.text(column, row, words, color=colour, **look)
        axis.set_title(title, fontsize=TITLE_SIZE, loc="left", pad=52)
        axis.tick_params(top=True, labeltop=True, bottom=False, labelbottom=False, length=0)
        names = [name.rpartition("/")[2].removeprefix("drive_") for name in sequences]
        axis.set_xticks(range(len(names)), names, rotation=60, ha="left", fontsize=FONT_SIZE - 1)
        axis.set_yticks(range(len(ideas)), ideas if kind == 0 else [], fontsize=FONT_SIZE - 1)
    return made
