"""Figures. Functions draw on an axis they are given or return a matplotlib Figure; none uses pyplot."""

from __future__ import annotations

import io

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Okabe and Ito's colours, told apart by colour-blind readers too.
TRUTH_COLOUR = "#000000"
ESTIMATE_COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00")


def draw_trajectory(axis: Axes, poses: Array, label: str, colour: str, style: str = "-") -> None:
    """Top view of poses (N, 4, 4): x to the right, z forward, metres; a dot marks the start."""
    axis.plot(poses[:, 0, 3], poses[:, 2, 3], style, color=colour, label=label, linewidth=1.5)
    axis.plot(poses[0, 0, 3], poses[0, 2, 3], "o", color=colour, markersize=4)


def trajectory_figure(title: str, truth: Array | None, estimates: dict[str, Array]) -> Figure:
    """Top view of the truth and of named estimates, (N, 4, 4) each, with equal axes in metres."""
    figure = Figure(figsize=(6.4, 6.4), dpi=120, layout="constrained")
    axis = figure.add_subplot()
    if truth is not None:
        # An estimate starts at the identity; the truth of a part of a sequence does not.
        draw_trajectory(axis, np.linalg.inv(truth[0]) @ truth, "ground truth", TRUTH_COLOUR, "--")
    for number, (name, poses) in enumerate(estimates.items()):
        draw_trajectory(axis, poses, name, ESTIMATE_COLOURS[number % len(ESTIMATE_COLOURS)])
    axis.set_aspect("equal", adjustable="datalim")
    axis.set_xlabel("x, right [m]")
    axis.set_ylabel("z, forward [m]")
    axis.set_title(title)
    axis.grid(alpha=0.3)
    axis.legend(loc="best")
    return figure


def png(figure: Figure) -> bytes:
    """A figure as PNG bytes, the same for the same figure."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", metadata={"Software": None})
    return buffer.getvalue()
