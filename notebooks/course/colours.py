"""Colours of the course, which colour-blind readers tell apart."""

from __future__ import annotations

# Okabe and Ito's colours. The same thing has the same colour in every chapter.
GOOD, BAD, THIRD, FOURTH, FIFTH = "#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00"
DARK, PALE = "#222222", "#B0B0B0"
CYCLE = (GOOD, BAD, THIRD, FOURTH, FIFTH, "#56B4E9", "#F0E442")


def bgr(colour: str) -> tuple[int, int, int]:
    """A colour "#RRGGBB" as OpenCV's (blue, green, red)."""
    return int(colour[5:7], 16), int(colour[3:5], 16), int(colour[1:3], 16)
