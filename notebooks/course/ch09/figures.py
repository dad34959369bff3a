"""Figures of chapter 9: similar places, compared images, paths with loops, weights."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import cv2
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from vo_lib.geometry.matches import StereoMatches
from vo_lib.geometry.types import Array, BoolArray, Image, IntArray

from ..colours import BAD, DARK, GOOD, PALE
from ..drawing import Place, figure, finish, log_axis, photo, round_limits

BEFORE = BAD
AFTER = GOOD
BAR_COLOURS = (BEFORE, AFTER, DARK)
# A thin line on top of a wide one leaves both to be seen where they coincide.
LINES: Mapping[str, Mapping[str, Any]] = {
    "before": {"color": BEFORE, "linewidth": 1.6, "zorder": 2.1},
    "closed": {"color": AFTER, "linewidth": 3.0, "zorder": 2.0},
    "truth": {"color": DARK, "linewidth": 0.9, "zorder": 2.2},
}
# Metres; smaller residuals are drawn on axes of ±1 m. Streets are not flat, so in the plane even the edges of the path
# itself have residuals of some millimetres.
SMALLEST_M = 0.02
GREEN_BGR = (90, 160, 0)
RED_BGR = (60, 60, 220)


def similarity_figure(
    similarity: Array, frames: IntArray, second: IntArray | None = None, first: IntArray | None = None
) -> Figure:
    """The similarity (N, N) of places, with frame numbers on both axes; a dot for each pair of frames."""
    page, (axis,) = figure(380, width=520)
    extent = (frames[0], frames[-1], frames[-1], frames[0])
    page.colorbar(axis.imshow(similarity, cmap="magma", vmin=0.0, vmax=0.5, extent=extent), ax=axis)
    if first is not None and second is not None:
        axis.plot(first, second, "o", color=GOOD, markersize=4)
    finish(axis, "similarity of places", "frame", "frame")
    return page


def residual_vectors(name: str, residuals: Array, library: Array, title: str) -> Figure:
    """Residuals (N, 3) of edges from above: lines to the distances right and forward; rings: the library's."""
    page, (axis,) = figure(300, width=460)
    for right, forward in residuals[:, :2]:
        axis.plot([0, right], [0, forward], color=BEFORE, linewidth=1.4)
    axis.plot(*residuals[:, :2].T, "o", color=BEFORE, markersize=5, label=name)
    axis.plot(*library[:, :2].T, "o", color=DARK, markersize=9, markerfacecolor="none", label="library")
    axis.plot(0, 0, "+", color=DARK)
    axis.set_aspect("equal", adjustable="datalim")
    if np.abs(residuals[:, :2]).max(initial=0.0) < SMALLEST_M:
        axis.update_datalim([(-1.0, -1.0), (1.0, 1.0)])
    round_limits(axis.xaxis, axis.yaxis)
    finish(axis, title, "right [m]", "forward [m]", "best")
    place = axis.get_position()
    room = 0.03  # of the width: negative numbers with a decimal are wide
    axis.set_position((place.x0 + room, place.y0, place.width - room, place.height))
    return page


def bars_by_loop(sizes: Mapping[str, Array], unit: str, title: str) -> Figure:
    """A bar for each loop and each of several results (N,), in the order of the loops."""
    page, (axis,) = figure(240, width=620)
    for number, (name, values) in enumerate(sizes.items()):
        colour = BAR_COLOURS[number]
        at = np.arange(len(values)) + 0.4 * number
        axis.bar(at, values, 0.35, color=colour, label=name)
    low, high = axis.get_ylim()
    axis.set_ylim(low, high + 0.35 * (high - low))  # room for the names
    finish(axis, title, "loop", unit)
    return page


def plane_figure(paths: Mapping[str, Array], title: str = "the places, from above") -> Figure:
    """Places (N, 3) in the plane as x, z, heading: several paths from above."""
    page, (axis,) = figure(340, width=620)
    for name, places in paths.items():
        axis.plot(places[:, 0], places[:, 1], label=name, **LINES.get(name, LINES["closed"]))
    axis.set_aspect("equal", adjustable="datalim")
    round_limits(axis.xaxis, axis.yaxis)
    finish(axis, title, "x [m]", "z [m]", "best")
    return page


def compared_picture(above: Image, below: Image, matches: StereoMatches, agrees: BoolArray) -> Image:
    """The left images of two places, one below the other; matches that agree with one motion are green."""
    picture = cv2.cvtColor(np.concatenate([above, below]), cv2.COLOR_GRAY2BGR)
    moved = matches.cur_left + np.array([0.0, len(above)])
    for start, end, good in zip(matches.prev_left, moved, agrees, strict=True):
        ends = np.rint([start, end]).astype(int).tolist()
        cv2.line(picture, ends[0], ends[1], GREEN_BGR if good else RED_BGR, 1, cv2.LINE_AA)
    return photo(np.asarray(picture, np.uint8))


def draw_path(
    axis: Axes, paths: Mapping[str, tuple[Array, str]], title: str = "from above", legend: Place = "best"
) -> None:
    """Paths (N, 4, 4) from above, each in its colour."""
    for name, (poses, colour) in paths.items():
        line = {"linewidth": 1.6, **LINES.get(name, {}), "color": colour}
        axis.plot(*poses[:, [0, 2], 3].T, label=name, **line)
    axis.set_aspect("equal", adjustable="datalim")
    round_limits(axis.xaxis, axis.yaxis)
    finish(axis, title, "x [m]", "z [m]", legend)


def draw_edges(axis: Axes, poses: Array, first: IntArray, second: IntArray, weight: Array) -> None:
    """Lines between the two places of each loop on a path; a paler line has a smaller weight."""
    if len(first) == 0:
        return
    ends = np.stack([poses[first], poses[second]], axis=1)[:, :, [0, 2], 3]
    opacity = 0.15 + 0.85 * weight
    # One collection is drawn much faster than a line for each loop.
    axis.add_collection(LineCollection(list(ends), colors=BAD, alpha=opacity, linewidths=1.0, zorder=2))


def closing_figure(truth: Array | None, before: Array, closed: Mapping[str, Array]) -> Figure:
    """The truth if known, a path before closing, and the same path closed in several ways, from above."""
    page, axes = figure(360, len(closed))
    for axis, (name, poses) in zip(axes, closed.items(), strict=True):
        paths = {} if truth is None else {"truth": (truth, DARK)}
        paths |= {"before": (before, BEFORE), "closed": (poses, AFTER)}
        draw_path(axis, paths, name, "best" if axis is axes[0] else "none")
    return page


def weight_chart(axis: Axes, residual: Array, is_false: BoolArray, scale: float) -> None:
    """Cauchy's weight by residual, in standard deviations, with the loops as dots on the curve."""
    r = np.geomspace(0.01, 1e4, 300)
    axis.plot(r, 1.0 / (1.0 + (r / scale) ** 2), color=PALE)
    for name, some, colour in (("true", ~is_false, GOOD), ("false", is_false, BAD)):
        size = np.clip(residual[some], 0.01, 1e4)
        axis.plot(size, 1.0 / (1.0 + (size / scale) ** 2), "o", color=colour, label=name, markersize=5)
    axis.axvline(scale, color=PALE, linestyle=":")
    axis.set_ylim(-0.05, 1.05)
    log_axis(axis.xaxis, 0.01, 1e4)
    finish(axis, "weight of a loop", "residual [standard deviations]", "weight")
