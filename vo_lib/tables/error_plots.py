"""Figures of errors: paths coloured by them, curves, grids over settings; position and angles over time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from ..core.poses import from_first
from ..core.types import Array
from .plots import METHOD_MARKERS, SMALL_PAGE, distance_from_truth, label_axis, page, styled

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Points (length in m or speed in km/h, TE in %, RE in deg/100 m) of a method.
Curve = Sequence[tuple[float, float | None, float | None]]


def coloured_paths_figure(title: str, truth: Array, paths: Mapping[str, Array]) -> Figure:
    """Paths (N, 4, 4) from above, one a panel, coloured by the distance from the truth (grey)."""
    from matplotlib.collections import LineCollection

    figure = page(title, width=SMALL_PAGE[0] * len(paths))
    axes = figure.subplots(1, len(paths), squeeze=False)[0]
    off = {name: distance_from_truth(poses, truth) for name, poses in paths.items()}
    largest = max(float(each.max()) for each in off.values()) or 1.0
    true = from_first(truth)[:, [0, 2], 3]
    for axis, (name, poses) in zip(axes, paths.items(), strict=True):
        axis.plot(*true.T, color="0.75", linewidth=1.0)
        at = poses[:, [0, 2], 3]
        lines = LineCollection([*np.stack([at[:-1], at[1:]], axis=1)], cmap="viridis", linewidths=2.5)
        lines.set_array(off[name][1:])
        lines.set_clim(0.0, largest)
        axis.add_collection(lines)
        axis.autoscale_view()
        axis.set_aspect("equal", adjustable="datalim")
        axis.set_title(name)
        label_axis(axis, "x, right [m]", "z, forward [m]" if axis is axes[0] else "")
    figure.colorbar(lines, ax=list(axes), label="distance from the truth [m]", location="bottom", shrink=0.8)
    return figure


def components_figure(title: str, paths: Mapping[str, Array], times: Array | None = None) -> Figure:
    """Position and angles of named paths (N, 4, 4) from their first pose, over `times` (N,) s or frames.

    The camera's axes are x right, y down, z ahead, and R = R_y(yaw) R_x(pitch) R_z(roll).
    """
    figure = page(title, width=2 * SMALL_PAGE[0])
    axes = figure.subplots(3, 2, sharex=True)
    for _, poses, style in styled(paths):
        T = from_first(poses)
        R = T[:, :3, :3]
        pitch = np.arcsin(np.clip(-R[:, 1, 2], -1.0, 1.0))
        roll, yaw = np.arctan2(R[:, 1, 0], R[:, 1, 1]), np.arctan2(R[:, 0, 2], R[:, 2, 2])
        angles = np.degrees(np.unwrap([roll, pitch, yaw]))
        at = np.arange(len(T)) if times is None else times - times[0]
        for axis, values in zip(axes.T.ravel(), [*T[:, :3, 3].T, *angles], strict=True):
            axis.plot(at, values, **style)
    labels = ("x, right [m]", "y, down [m]", "z, forward [m]", "roll [deg]", "pitch [deg]", "yaw [deg]")
    for axis, label in zip(axes.T.ravel(), labels, strict=True):
        label_axis(axis, ("frame" if times is None else "time [s]") * (axis in axes[-1]), label)
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return figure


def error_curves_figure(title: str, by: str, curves: Mapping[str, Curve]) -> Figure:
    """The devkit's curves of named methods, TE and RE `by` sub-sequence "length" or "speed"."""
    figure = page(title)
    axes = figure.subplots(2, sharex=True)
    for name, points, style in styled(curves):
        # A marker on the edge is seen whole, and asks for no room.
        marker = {"marker": METHOD_MARKERS.get(name, "o"), "markerfacecolor": "none", "clip_on": False}
        size = {"markersize": 3 + style["linewidth"], "in_layout": False}
        at, *errors = np.reshape(np.asarray(points, np.float64), (-1, 3)).T
        for axis, values in zip(axes, errors, strict=True):
            axis.plot(at, values, **style, **marker, **size)
    label_axis(axes[0], "", "TE [%]")
    label_axis(axes[1], "sub-sequence length [m]" if by == "length" else "speed [km/h]", "RE [deg/100 m]")
    for axis in axes:
        axis.set_ylim(bottom=0.0)
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=2)
    return figure


def heat_map_figure(
    title: str, down: tuple[str, list[str]], across: tuple[str, list[str]], panels: dict[str, Array]
) -> Figure:
    """Grids of numbers over two settings, one below the other: dark is large, a cross stands where none is.

    Differences of less than a hundredth do not get a colour of their own.

    Parameters
    ----------
    down, across : name of the setting and its values, in words.
    panels : (rows, columns, 2) mean and spread of each cell by the quantity's label; NaN where there is none.
    """
    (row_name, rows), (column_name, columns) = down, across
    width, height = max(SMALL_PAGE[0], 1.5 + 1.1 * len(columns)), len(panels) * (1.2 + 0.55 * len(rows)) + 0.8
    figure = page(title, width, height)
    axes = figure.subplots(len(panels), squeeze=False)[:, 0]
    for axis, (label, cells) in zip(axes, panels.items(), strict=True):
        mean = np.ma.masked_invalid(cells[..., 0])
        middle = float(np.ma.filled((mean.min() + mean.max()) / 2, 0.0))
        half = max(float(np.ma.filled(mean.max() - mean.min(), 0.0)) / 2, 0.01 * abs(middle), 1e-9)
        image = axis.imshow(mean, "YlGnBu", aspect="auto", vmin=middle - half, vmax=middle + half)
        figure.colorbar(image, ax=axis, label=label, format="%.3g")
        axis.set_xticks(range(len(columns)), columns)
        axis.set_yticks(range(len(rows)), rows)
        axis.set(xlabel=column_name, ylabel=row_name)
        for row, column in np.ndindex(mean.shape):
            value, spread = cells[row, column]
            text = f"{value:.3f}\n± {spread:.3f}" if np.isfinite(value) else "×"
            colour = "white" if value > middle + 0.2 * half else "black"
            axis.text(column, row, text, ha="center", va="center", color=colour, fontsize="small")
    return figure
