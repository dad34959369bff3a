"""Colours of the course, distinguishable for colour-blind readers."""

from __future__ import annotations

from vo_lib.report import plots

CYCLE = plots.CYCLE
DARK = plots.TRUTH_COLOUR
PALE = "#B0B0B0"
WHITE = "#FFFFFF"
MANY = (*CYCLE, DARK, "#7F7F7F", "#8C510A")  # for pictures with more lines than a picture should have
bgr = plots.bgr
GOOD, BAD, THIRD, FOURTH, FIFTH = CYCLE[:5]
