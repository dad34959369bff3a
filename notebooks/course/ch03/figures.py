"""Chapter 3, drawn: candidates by angle to the prior, image error and true error; errors over frames."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from vo_lib.geometry.types import Array

from ..colours import BAD, DARK, GOOD, PALE
from ..drawing import figure, finish, log_axis

LEAST, MOST = 1e-3, 180.0  # degrees shown of a rotation error
ALIKE = 0.02  # curves that nowhere differ by a larger share cannot be told apart


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


def field_figure(field: Field, result: float | None = None, height: int = 260) -> Figure:
    """Image error of each candidate over its angle to the previous vector, and over its rotation error.

    `result`, degrees, is marked on the right: the error of the rotation that the frame gets in the end.
    """
    made, (by_angle, by_error) = figure(height, 2)
    error = np.clip(field.rotation_error, LEAST, MOST)
    if result is not None:
        by_error.axvline(max(result, LEAST), color=BAD, linewidth=0.8)
    for axis, x in ((by_angle, field.angle), (by_error, error)):
        for chosen, colour, words in (
            (~field.kept, PALE, "left out"),
            (field.kept, GOOD, "every solution" if field.kept.all() else "nearest k of a set"),
        ):
            label = words if axis is by_error else ""  # one legend is enough
            axis.plot(x[chosen], field.image_error[chosen], ".", color=colour, markersize=4.5, label=label)
        for at, colour, size, words in (
            (field.consensus, DARK, 9, "winner, consensus"),
            (field.selected, BAD, 5.5, "winner, selection"),
        ):
            label = words if axis is by_error else ""
            (dot,) = axis.plot(x[at], field.image_error[at], "o", color=colour, markersize=size, label=label)
            dot.set_clip_on(False)  # a winner at the edge is shown whole
        axis.set_ylim(-0.02, 1.02)
    by_angle.set_xlim(0, 90)
    log_axis(by_error.xaxis, LEAST, MOST)
    x_name = "angle to the previous essential vector [deg]"
    finish(by_angle, "the solutions of all sets", x_name, "image error")
    # Where the rotation is right the image error is small: nothing stands there.
    x_name = "rotation error [deg]"
    finish(by_error, "the same against what is true", x_name, "image error", "upper left", boxed=True)
    return made


def errors_figure(
    errors: Mapping[str, Array],
    x: Array | range | None = None,
    title: str = "rotation error",
    x_name: str = "frame",
    unit: str = "deg",
    height: int = 230,
) -> Figure:
    """Errors (N,) by name: of frames 1, 2, …, or a range of them, with their medians, or over x (N,).

    Curves that lie on one another are drawn once, with all their names.
    """
    curves: list[tuple[list[str], Array]] = []
    for name, values in errors.items():
        same = [names for names, drawn in curves if np.allclose(values, drawn, rtol=ALIKE)]
        same[0].append(name) if same else curves.append(([name], values))
    made, (axis,) = figure(height)
    for (names, values), colour, style in zip(
        curves, (DARK, GOOD, BAD, PALE), ("-o", "--s", "-^", "-v"), strict=False
    ):
        over_frames = x is None or isinstance(x, range)
        words = f": median {np.median(values):.3f}" if over_frames else ""
        axis.plot(
            np.arange(1, len(values) + 1) if x is None else x,
            np.clip(values, LEAST, MOST),
            style[:-1] if over_frames else style,
            color=colour, markersize=5, linewidth=1.5, label=", ".join(names) + words,
        )  # fmt: skip
    axis.set_yscale("log")
    low, high = axis.get_ylim()
    log_axis(axis.yaxis, min(low, 0.01), max(high, 0.1))
    axis.xaxis.set_major_locator(MaxNLocator(integer=True))
    finish(axis, title, x_name, f"error [{unit}]", "above")
    return made


def turns_figure(angle: Array, turn: Array, length: Array, height: int = 220) -> Figure:
    """How the motion changes along a path, and the length of its steps.

    Parameters
    ----------
    angle : (N - 2,) from each essential vector to the next, degrees; NaN where one step has none.
    turn, length : (N - 1,) of each step, degrees and metres.
    """
    made, (left, right) = figure(height, 2)
    left.plot(1 + np.arange(len(turn)), turn, color=PALE, linewidth=1, label="turn of a step")
    left.plot(2 + np.arange(len(angle)), angle, color=GOOD, label="change of e")
    right.plot(1 + np.arange(len(length)), length, color=DARK)
    for axis in (left, right):
        whole = axis.get_xaxis_transform()  # from the bottom of the axis to its top
        frames = 2 + np.arange(len(angle))
        axis.fill_between(frames, 0, 1, where=np.isnan(angle), color=PALE, alpha=0.5, transform=whole)
    finish(left, "turn, and change of motion", "frame", "angle [deg]", "above")
    finish(right, "length of the step (grey: standing, no E)", "frame", "step [m]")
    return made
