"""Colours of the course, distinguishable for colour-blind readers."""

from __future__ import annotations

from vo_lib.report import plots

CYCLE, DARK, PALE, bgr = plots.CYCLE, plots.TRUTH_COLOUR, "#B0B0B0", plots.bgr
GOOD, BAD, THIRD, FOURTH, FIFTH = CYCLE[:5]
