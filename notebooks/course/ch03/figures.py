"""Chapter 3, drawn: candidates by angle to the prior, image error and true error; errors over frames."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from vo_lib.core.geometry import essential_angle, essential_from_motion, essential_vector
from vo_lib.core.types import Array

from ..drawing import BAD, DARK, GOOD, PALE, figure, finish, log_axis

LEAST, MOST = 1e-3, 180.0  # degrees shown of a rotation error


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
            (dots,) = axis.plot(x[chosen], field.image_error[chosen], ".", color=colour, markersize=4.5)
            dots.set_label(words if axis is by_error else "")  # one legend is enough
        for at, colour, size, words in (
            (field.consensus, DARK, 9, "winner, consensus"),
            (field.selected, BAD, 5.5, "winner, selection"),
        ):
            # A winner at the edge is shown whole.
            (dot,) = axis.plot(
                x[at], field.image_error[at], "o", color=colour, markersize=size, clip_on=False
            )
            dot.set_label(words if axis is by_error else "")
        axis.set_ylim(-0.02, 1.02)
    by_angle.set_xlim(0, 90)
    log_axis(by_error.xaxis, LEAST, MOST)
    x_name = "angle to the previous essential vector [deg]"
    finish(by_angle, "the solutions of all sets", x_name, "image error")
    # Where the rotation is right the image error is small: nothing stands there.
    x_name = "rotation error [deg]"
    finish(by_error, "the same against what is true", x_name, "image error", "upper left", boxed=True)
    return made


def errors_figure(errors: dict[str, Array], first: int = 1, height: int = 230) -> Figure:
    """Rotation error of each frame, degrees, for several ways of choosing."""
    made, (axis,) = figure(height)
    named = {f"{name}: median {np.median(values):.3f}°": values for name, values in errors.items()}
    frames = first + np.arange(max(map(len, errors.values())))
    _plot_errors(axis, frames, named, ("-", "--", "-", "-"))
    axis.xaxis.set_major_locator(MaxNLocator(integer=True))
    finish(axis, "rotation error", "frame", "error [deg]", "above")
    return made


def turns_figure(poses: Array, standstill: float = 0.02, height: int = 220) -> Figure:
    """Angle between successive true essential vectors along poses (N, 4, 4), and the speed below it.

    Where a step is shorter than `standstill`, metres, there is no essential matrix: grey.
    """
    T = np.linalg.inv(poses[1:]) @ poses[:-1]
    length = np.linalg.norm(T[:, :3, 3], axis=1)
    e = essential_vector(np.array([essential_from_motion(each[:3, :3], each[:3, 3]) for each in T]))
    angle = np.degrees(essential_angle(e[1:], e[:-1]))
    frames, moves = np.arange(2, len(poses)), (length[1:] > standstill) & (length[:-1] > standstill)
    made, (left, right) = figure(height, 2)
    left.plot(frames, np.where(moves, angle, np.nan), color=GOOD)
    right.plot(np.arange(1, len(poses)), length, color=DARK)
    for axis in (left, right):
        whole = axis.get_xaxis_transform()  # from the bottom of the axis to its top
        axis.fill_between(frames, 0, 1, where=~moves, color=PALE, alpha=0.5, transform=whole)
    finish(left, "angle from each true essential vector to the next", "frame", "angle [deg]")
    finish(right, "length of the step (grey: standing, no E)", "frame", "step [m]")
    return made


def shares_figure(
    shares: list[float], medians: dict[str, list[float]], kind: str, height: int = 230
) -> Figure:
    """Median rotation error over the share of bad matches, for several ways of choosing."""
    made, (axis,) = figure(height)
    named = {name: np.array(values) for name, values in medians.items()}
    _plot_errors(axis, 100 * np.array(shares), named, ("-o", "--s", "-^", "-v"))
    finish(axis, f"median rotation error as {kind} matches grow", f"{kind} matches [%]", "error [deg]")
    return made


def _plot_errors(
    axis: Axes, x: Array | NDArray[np.int64], errors: dict[str, Array], styles: tuple[str, ...]
) -> None:
    """Curves by name, degrees, on a logarithmic axis in plain numbers."""
    for (name, values), colour, style in zip(errors.items(), (DARK, GOOD, BAD, PALE), styles, strict=False):
        shown = np.clip(values, LEAST, MOST)
        axis.plot(x, shown, style, color=colour, markersize=5, linewidth=1.5, label=name)
    axis.set_yscale("log")
    low, high = axis.get_ylim()
    log_axis(axis.yaxis, min(low, 0.01), max(high, 0.1))
