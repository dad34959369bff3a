"""Colours of the course, distinguishable for colour-blind readers."""

from __future__ import annotations

from vo_lib.report import plots

CYCLE, DARK, PALE = plots.CYCLE, plots.TRUTH_COLOUR, "#B0B0B0"
GOOD, BAD, THIRD, FOURTH, FIFTH = CYCLE[:5]


def bgr(colour: str) -> tuple[int, int, int]:
    """A colour "#RRGGBB" as the tuple (blue, green, red) of OpenCV."""
    return int(colour[5:7], 16), int(colour[3:5], 16), int(colour[1:3], 16)
