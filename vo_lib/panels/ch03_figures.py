"""Chapter 3, drawn: candidates by angle to the prior, image error and true error; errors over frames."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from ..geometry import Array
from ..kitti import Image
from .style import BAD, DARK, GOOD, PALE, Plate, figure, finish

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


@functools.cache
def _field_plate(height: int) -> Plate:
    """The two axes of `field_picture`, with the legend."""
    made, axes = figure(height, 2)
    legend = (
        (PALE, ".", "left out"),
        (GOOD, ".", "nearest k of a set"),
        (DARK, "o", "winner by consensus (the larger dot)"),
    )
    for colour, marker, words in (*legend, (BAD, "o", "winner by selection")):
        axes[0].plot([], [], marker, color=colour, markersize=5, label=words)
    axes[0].set_xlim(0, 90)
    axes[1].set_xscale("log")
    axes[1].set_xlim(LEAST, MOST)
    axes[1].set_xticks(TICKS, [f"{tick:g}" for tick in TICKS])
    axes[1].set_xlim(LEAST, MOST)
    axes[1].minorticks_off()
    for axis in axes:
        axis.set_ylim(-0.02, 1.02)
    finish(
        axes[0], "every solution of every set", "angle to the previous essential vector [deg]", "image error"
    )
    axes[0].legend(loc="lower right", fontsize=8, framealpha=0.9)
    finish(axes[1], "the same against what is true", "rotation error [deg]", "image error")
    return Plate(made, axes)


def field_picture(field: Field, result: float | None = None, height: int = 260) -> Image:
    """Image error of each candidate over its angle to the previous vector, and over its rotation error.

    `result`, degrees, is marked on the right: the error of the rotation that the frame gets in the end.
    """
    plate = _field_plate(height)
    picture = plate.blank()
    error = np.clip(field.rotation_error, LEAST, MOST)
    if result is not None:
        plate.column(picture, 1, max(result, LEAST), BAD)
    for number, x in enumerate((field.angle, error)):
        for chosen, colour in ((~field.kept, PALE), (field.kept, GOOD)):
            plate.dots(picture, number, x[chosen], field.image_error[chosen], colour, 1.6)
        for winner, colour, radius in ((field.consensus, DARK, 6.5), (field.selected, BAD, 4.0)):
            plate.dots(picture, number, x[[winner]], field.image_error[[winner]], colour, radius)
    return picture


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
    finish(axis, "rotation error, frame by frame", "frame", "degrees")
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
    finish(axis, f"median rotation error as {kind} matches grow", f"{kind} matches [%]", "degrees")
    return made
