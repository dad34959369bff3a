"""Chapter 3, drawn: candidates by angle to the prior, image error and true error; errors over frames."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from ...core.types import Array, Image
from .chart import Chart, beside, boxed_legend
from .style import BAD, DARK, GOOD, PALE, figure, finish

LEAST, MOST = 1e-3, 180.0  # degrees shown of a rotation error
TICKS = [0.001, 0.01, 0.1, 1.0, 10.0, 100.0]


@dataclass(frozen=True)
class Field:
    """All candidates of a frame and what speaks for them.

    Attributes
    ----------
    angle : (M,) to the previous essential vector, degrees; NaN without one.
    image_error : (M,) truncated mean squared Sampson distance over all matches, in [0, 1].
    rotation_error : (M,) against the reference rotation, degrees.
    kept : (M,) whether solution selection lets them compete.
    consensus, selected : indices of the two winners; `dropped`: the prior was dropped.
    """

    angle: Array
    image_error: Array
    rotation_error: Array
    kept: NDArray[np.bool_]
    consensus: int
    selected: int
    dropped: bool


def field_picture(field: Field, result: float | None = None, height: int = 260) -> Image:
    """Image error of each candidate over its angle to the previous vector, and over its rotation error.

    `result`, degrees, is marked on the right: the error of the rotation that the frame gets in the end.
    """
    error = np.clip(field.rotation_error, LEAST, MOST)

    def put(axis: Axes, x: Array) -> None:
        for chosen, colour, words in (
            (~field.kept, PALE, "left out"),
            (field.kept, GOOD, "nearest k of a set"),
        ):
            axis.plot(x[chosen], field.image_error[chosen], ".", color=colour, markersize=4.5, label=words)
        for at, colour, size, words in (
            (field.consensus, DARK, 9, "winner by consensus (the larger dot)"),
            (field.selected, BAD, 5.5, "winner by selection"),
        ):
            (dot,) = axis.plot(x[at], field.image_error[at], "o", color=colour, markersize=size, label=words)
            dot.set_clip_on(False)  # a winner at the edge is shown whole

    def put_true(axis: Axes) -> None:
        if result is not None:
            axis.axvline(max(result, LEAST), color=BAD, linewidth=0.8)
        put(axis, error)

    charts = [
        Chart(("candidates by angle",), lambda axis: put(axis, field.angle), _angle_axis),
        Chart(("candidates by error",), put_true, _error_axis),
    ]
    return beside(charts, height)


def _angle_axis(axis: Axes) -> None:
    axis.set_xlim(0, 90)
    axis.set_ylim(-0.02, 1.02)
    x = "angle to the previous essential vector [deg]"
    finish(axis, "every solution of every set", x, "image error")
    boxed_legend(axis, "lower right")


def _error_axis(axis: Axes) -> None:
    axis.set_xscale("log")
    axis.set_xlim(LEAST, MOST)
    axis.set_xticks(TICKS, [f"{tick:g}" for tick in TICKS])
    axis.minorticks_off()
    axis.set_ylim(-0.02, 1.02)
    finish(axis, "the same against what is true", "rotation error [deg]", "image error")
    axis.legend([], frameon=False)  # the left axis has it


def _decades(axis: Axes) -> None:
    """A logarithmic axis of degrees in plain numbers."""
    axis.set_yscale("log")
    low, high = axis.get_ylim()
    axis.minorticks_off()
    axis.set_yticks(TICKS, [f"{tick:g}" for tick in TICKS])
    axis.set_ylim(min(low, 0.01), max(high, 0.1))


def errors_figure(errors: dict[str, Array], first: int = 1, height: int = 230) -> Figure:
    """Rotation error of each frame, degrees, for several ways of choosing."""
    made, (axis,) = figure(height)
    for (name, values), colour, style in zip(
        errors.items(), (DARK, GOOD, BAD, PALE), ("-", "--", "-", "-"), strict=False
    ):
        axis.plot(
            first + np.arange(len(values)),
            np.clip(values, LEAST, MOST),
            style,
            color=colour,
            linewidth=1.5,
            label=f"{name}: median {np.median(values):.3f}°",
        )
    _decades(axis)
    axis.xaxis.set_major_locator(MaxNLocator(integer=True))
    finish(axis, "rotation error, frame by frame", "frame", "error [deg]")
    return made


def shares_figure(
    shares: list[float], medians: dict[str, list[float]], kind: str, height: int = 230
) -> Figure:
    """Median rotation error over the share of bad matches, for several ways of choosing."""
    made, (axis,) = figure(height)
    for (name, values), colour, style in zip(
        medians.items(), (DARK, GOOD, BAD, PALE), ("-o", "--s", "-^", "-v"), strict=False
    ):
        axis.plot(
            100 * np.array(shares), values, style, color=colour, markersize=5, linewidth=1.5, label=name
        )
    _decades(axis)
    finish(axis, f"median rotation error as {kind} matches grow", f"{kind} matches [%]", "error [deg]")
    return made
