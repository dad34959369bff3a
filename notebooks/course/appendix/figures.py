"""Figures of the appendix: steps by depth, rows, two estimated terms, and what is used of an estimate."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure

from vo_lib.geometry.types import Array

from ..colours import BAD, DARK, GOOD, PALE
from ..drawing import figure, finish, round_limits

MOST_DOTS = 1500  # rows drawn of a sequence


def steps_figure(Z: Array, seen: Mapping[str, Array]) -> Figure:
    """Measured length of a step of 1 m by the depth of the point Z (N,), metres.

    seen : the measured lengths (N,), metres, by the words for the disparity error.
    """
    made, (axis,) = figure(210)
    axis.axhline(1.0, color=DARK, linewidth=1, linestyle=":", label="true")
    for (name, values), colour in zip(seen.items(), (GOOD, BAD), strict=False):
        axis.plot(Z, values, ".", color=colour, markersize=5, label=f"disparities {name}")
    farthest = float(np.quantile(Z, 0.97))
    axis.set_xlim(0, farthest)
    within = np.concatenate([values[farthest >= Z] for values in seen.values()])
    middle = float(np.median(within))
    spread = max(1.1 * float(np.abs(within - middle).max()), 0.05)
    axis.set_ylim(middle - spread, middle + spread)
    round_limits(axis.yaxis)
    finish(axis, "measured length of a step of 1 m [m]", "depth of the point [m]")
    return made


def rows_figure(fits: Mapping[str, tuple[Array, Array, float]]) -> Figure:
    """Row differences over x, a chart for each sequence: x (N,), rows (N,) and the fitted roll, pixels."""
    made, axes = figure(220, len(fits))
    for axis, (name, (x, rows, roll)) in zip(axes, fits.items(), strict=True):
        some = np.linspace(0, len(x) - 1, min(len(x), MOST_DOTS)).astype(int)
        axis.plot(x[some], rows[some], ".", color=PALE, markersize=3, label="rows")
        ends = np.array([x.min(), x.max()])
        axis.plot(ends, np.median(rows) - roll * ends, color=GOOD, linewidth=2, label=f"roll {roll:+.2f} px")
        axis.set_ylim(-0.75, 0.75)
        finish(axis, f"{name}: row left minus row right [px]", "x")
    return made


def terms_figure(learnt: Array, true: tuple[float, float], y: Array) -> Figure:
    """Estimates (S, 2) of a shift and of a y² term, pixels, and the disparity errors that they mean.

    true : both true sizes. y : normalised rows of the image, from the upper to the lower edge.
    """
    made, (pairs, fields) = figure(220, 2)
    pairs.plot(*learnt.T, "o", color=GOOD, markersize=6, label="a seed")
    pairs.plot(*true, "+", color=DARK, markersize=12, markeredgewidth=2, label="true")
    round_limits(pairs.xaxis, pairs.yaxis)
    finish(pairs, "both estimates", "shift a [px]", "y² term b [px]")
    for shift, other in learnt:
        fields.plot(y, shift + other * y**2, color=GOOD, linewidth=1.2)
    fields.get_lines()[0].set_label("estimated, a line for each seed")
    fields.plot(y, true[0] + true[1] * y**2, color=DARK, linewidth=2, linestyle=":", label="true")
    round_limits(fields.yaxis)
    finish(fields, "error of the disparity [px]", "y, from the upper to the lower edge")
    return made


def shrunk_figure(used: Mapping[str, tuple[Array, Array]]) -> Figure:
    """For each rig, its estimated errors (2,) and the part of them that is used, pixels."""
    made, axes = figure(200, len(used))
    for axis, (name, (estimate, kept)) in zip(axes, used.items(), strict=True):
        places = np.arange(len(estimate))
        axis.axhline(0.0, color=DARK, linewidth=1)
        axis.bar(places - 0.18, estimate, 0.34, color=PALE, label="estimated")
        axis.bar(places + 0.18, kept, 0.34, color=GOOD, label="used")
        axis.set_xticks(places, ["shift", "y²"])
        round_limits(axis.yaxis)
        finish(axis, f"{name} rig: errors [px]")
    return made
