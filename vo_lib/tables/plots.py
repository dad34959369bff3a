"""Figures. Functions draw on an axis they are given or return a matplotlib Figure; none uses pyplot."""

from __future__ import annotations

import io
import textwrap
import warnings
from collections.abc import Mapping, Sequence
from typing import Any

import cv2
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.text import Text

from ..beyond.box_tracks import MOVING, PARKED
from ..core.boxes import Boxes
from ..core.matches import StereoMatches
from ..core.poses import from_first
from ..core.types import Array, Image, Mask, Whole
from ..evaluation.kitti import trajectory_distances

# Points (length in m or speed in km/h, TE in %, RE in deg/100 m) of a method.
Curve = Sequence[tuple[float, float | None, float | None]]

SMALL_PAGE = (4.8, 5.6)  # inches; the text is still read on a telephone
# The colours of the paper's Figure 4; orange for the method that is not in it.
TRUTH_COLOUR = "#e3000f"
METHOD_COLOURS = {
    "viso2": "#009a3d",
    "mesvo_f": "#000000",
    "solution_selection": "#0038c8",
    "feature_selection": "#5cc3f2",
    "moving_selection": "#e69f00",
}
METHOD_MARKERS = dict(zip(METHOD_COLOURS, "so^Dv", strict=True))
# For other names: Okabe and Ito's colours, told apart by colour-blind readers too.
ESTIMATE_COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00")


def draw_trajectory(
    axis: Axes, poses: Array, label: str, colour: str, style: str = "-", width: float = 1.5
) -> None:
    """Top view of poses (N, 4, 4): x to the right, z forward, metres; a dot marks the start."""
    axis.plot(poses[:, 0, 3], poses[:, 2, 3], style, color=colour, label=label, linewidth=width)
    axis.plot(poses[0, 0, 3], poses[0, 2, 3], "o", color=colour, markersize=4)


def method_colour(name: str, number: int) -> str:
    """The colour of a method's line; of a name that is no method, the one of its number."""
    return METHOD_COLOURS.get(name, ESTIMATE_COLOURS[number % len(ESTIMATE_COLOURS)])


def draw_trajectories(axis: Axes, title: str, truth: Array | None, estimates: dict[str, Array]) -> None:
    """Top view of the truth and of named estimates, (N, 4, 4) each, with equal axes in metres."""
    # Lines get thinner from the first to the last, so that those below still show where they overlap.
    widths = np.linspace(1.0 + 0.9 * len(estimates), 1.0, len(estimates) + 1)
    if truth is not None:
        # An estimate starts at the identity; the truth of a part of a sequence does not.
        draw_trajectory(axis, from_first(truth), "ground truth", TRUTH_COLOUR, width=float(widths[0]))
    for number, (name, poses) in enumerate(estimates.items()):
        draw_trajectory(axis, poses, name, method_colour(name, number), width=float(widths[number + 1]))
    axis.set_aspect("equal", adjustable="datalim")
    axis.set_xlabel("x, right [m]")
    axis.set_ylabel("z, forward [m]")
    axis.set_title(title)
    axis.grid(alpha=0.3)


def distance_from_truth(poses: Array, truth: Array) -> Array:
    """Distance (N,) of poses from the truth moved to the origin, (N, 4, 4) each, metres."""
    return np.asarray(np.linalg.norm(poses[:, :3, 3] - from_first(truth)[:, :3, 3], axis=1))


def draw_drift(axis: Axes, truth: Array, estimates: Mapping[str, Array]) -> None:
    """Distance of estimates from the truth, which is moved to the origin, along the true path, metres both.

    Paths that coincide from above still differ here.
    """
    path = trajectory_distances(truth)
    widths = np.linspace(1.0 + 0.6 * len(estimates), 1.0, max(len(estimates), 1))
    for number, (name, poses) in enumerate(estimates.items()):
        off = distance_from_truth(poses, truth)
        axis.plot(path, off, color=method_colour(name, number), linewidth=widths[number], label=name)
    axis.set_ylim(bottom=0.0)
    axis.set_xlabel("along the path [m]")
    axis.set_ylabel("distance from the truth [m]")
    axis.grid(alpha=0.3)


def trajectory_figure(title: str, truth: Array | None, estimates: dict[str, Array]) -> Figure:
    """One sequence from above, as `draw_trajectories`, with `draw_drift` beside it."""
    return trajectories_figure({title: (truth, estimates)})


def trajectories_figure(
    panels: Mapping[str, tuple[Array | None, dict[str, Array]]], words: Mapping[str, str] | None = None
) -> Figure:
    """Sequences by title, truth and named estimates: a row each, from above and, with truth, the drift.

    `words` : what the legend says in place of an estimate's name; then each has a line of its own.
    """
    rows, columns = len(panels), 1 + any(truth is not None for truth, _ in panels.values())
    width, height = SMALL_PAGE
    figure = Figure(figsize=(width * columns, (height - 1.0) * rows + 1.0), dpi=160, layout="constrained")
    labels: dict[str, Any] = {}
    for row, (title, (truth, estimates)) in enumerate(panels.items()):
        axis = figure.add_subplot(rows, columns, row * columns + 1)
        draw_trajectories(axis, title, truth, estimates)
        lines = {str(line.get_label()): line for line in axis.get_lines()}
        labels |= {name: line for name, line in lines.items() if not name.startswith("_")}
        if truth is not None:
            draw_drift(figure.add_subplot(rows, columns, row * columns + 2), truth, estimates)
    texts = [(words or {}).get(name, name) for name in labels]
    figure.legend(labels.values(), texts, loc="outside lower center", ncols=1 if words else 2 * columns)
    return figure


def coloured_paths_figure(title: str, truth: Array, paths: Mapping[str, Array]) -> Figure:
    """Paths (N, 4, 4) from above, one a panel, coloured by the distance from the truth (grey)."""
    width, height = SMALL_PAGE
    figure = Figure(figsize=(width * len(paths), height), dpi=160, layout="constrained")
    figure.suptitle(title, fontsize="medium")
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
        axis.set_xlabel("x, right [m]")
        axis.grid(alpha=0.3)
    axes[0].set_ylabel("z, forward [m]")
    figure.colorbar(lines, ax=list(axes), label="distance from the truth [m]", location="bottom", shrink=0.8)
    return figure


def components_figure(title: str, paths: Mapping[str, Array], times: Array | None = None) -> Figure:
    """Position and angles of named paths (N, 4, 4) from their first pose, over `times` (N,) s or frames.

    The camera's axes are x right, y down, z ahead, and R = R_y(yaw) R_x(pitch) R_z(roll).
    """
    width, height = SMALL_PAGE
    figure = Figure(figsize=(2 * width, height), dpi=160, layout="constrained")
    figure.suptitle(title, fontsize="medium")
    axes = figure.subplots(3, 2, sharex=True)
    widths = np.linspace(1.0 + 0.5 * len(paths), 1.0, len(paths))
    for number, (name, poses) in enumerate(paths.items()):
        T = from_first(poses)
        R = T[:, :3, :3]
        pitch = np.arcsin(np.clip(-R[:, 1, 2], -1.0, 1.0))
        roll, yaw = np.arctan2(R[:, 1, 0], R[:, 1, 1]), np.arctan2(R[:, 0, 2], R[:, 2, 2])
        angles = np.degrees(np.unwrap([roll, pitch, yaw]))
        at = np.arange(len(T)) if times is None else times - times[0]
        colour = TRUTH_COLOUR if number == 0 else method_colour(name, number - 1)
        for axis, values in zip(axes.T.ravel(), [*T[:, :3, 3].T, *angles], strict=True):
            axis.plot(at, values, color=colour, linewidth=widths[number], label=name)
    labels = ("x, right [m]", "y, down [m]", "z, forward [m]", "roll [deg]", "pitch [deg]", "yaw [deg]")
    for axis, label in zip(axes.T.ravel(), labels, strict=True):
        axis.set_ylabel(label)
        axis.grid(alpha=0.3)
    for axis in axes[-1]:
        axis.set_xlabel("frame" if times is None else "time [s]")
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return figure


def error_curves_figure(title: str, by: str, curves: Mapping[str, Curve]) -> Figure:
    """The devkit's curves of named methods, TE and RE `by` sub-sequence "length" or "speed".

    Parameters
    ----------
    curves : the points of each name.
    """
    figure = Figure(figsize=SMALL_PAGE, dpi=160, layout="constrained")
    figure.suptitle(title)
    axes = figure.subplots(2, sharex=True)
    widths = np.linspace(1.0 + 0.6 * len(curves), 1.0, max(len(curves), 1))
    for number, (name, points) in enumerate(curves.items()):
        style = {
            "color": method_colour(name, number),
            "marker": METHOD_MARKERS.get(name, "o"),
            "markersize": 3 + widths[number],
            "linewidth": widths[number],
            "markerfacecolor": "none",
            "clip_on": False,  # a marker on the edge is seen whole, and asks for no room
            "in_layout": False,
            "label": name,
        }
        at, te, re = np.reshape(np.asarray(points, np.float64), (-1, 3)).T
        axes[0].plot(at, te, **style)
        axes[1].plot(at, re, **style)
    for axis, label in zip(axes, ("TE [%]", "RE [deg/100 m]"), strict=True):
        axis.set_ylabel(label)
        axis.set_ylim(bottom=0.0)
        axis.grid(alpha=0.3)
    axes[1].set_xlabel("sub-sequence length [m]" if by == "length" else "speed [km/h]")
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
    size = max(SMALL_PAGE[0], 1.5 + 1.1 * len(columns)), len(panels) * (1.2 + 0.55 * len(rows)) + 0.8
    figure = Figure(figsize=size, dpi=160, layout="constrained")
    # Matplotlib's own wrapping takes what stands between dollar signs for a formula.
    figure.suptitle(textwrap.fill(title, int(11 * size[0])), fontsize="medium")
    for place, (label, cells) in enumerate(panels.items(), start=1):
        axis = figure.add_subplot(len(panels), 1, place)
        mean = np.ma.masked_invalid(cells[..., 0])
        middle = float(np.ma.filled((mean.min() + mean.max()) / 2, 0.0))
        half = max(float(np.ma.filled(mean.max() - mean.min(), 0.0)) / 2, 0.01 * abs(middle), 1e-9)
        image = axis.imshow(mean, "YlGnBu", aspect="auto", vmin=middle - half, vmax=middle + half)
        figure.colorbar(image, ax=axis, label=label, format="%.3g")
        axis.set_xticks(range(len(columns)), columns)
        axis.set_yticks(range(len(rows)), rows)
        axis.set_xlabel(column_name)
        axis.set_ylabel(row_name)
        for row, column in np.ndindex(mean.shape):
            value, spread = cells[row, column]
            text = f"{value:.3f}\n± {spread:.3f}" if np.isfinite(value) else "×"
            colour = "white" if value > middle + 0.2 * half else "black"
            axis.text(column, row, text, ha="center", va="center", color=colour, fontsize="small")
    return figure


# Features in BGR: kept in blue, removed in orange; boxes in white.
KEPT, REMOVED, BOX = (178, 114, 0), (0, 94, 213), (255, 255, 255)
# Kept features from new to old, from blue to green, where their age is shown.
AGE_COLOURS = [(255 - 13 * n, 90 + 11 * n, 12 * n // 2) for n in range(16)]


def match_image(
    image: Image,
    matches: StereoMatches,
    kept: Mask,
    boxes: Boxes,
    state: Whole | None = None,
    words: Sequence[str] = (),
    by_age: bool = False,
) -> Image:
    """The current left image (H, W), each match a line from its previous place to a dot; BGR (H, W, 3).

    Kept matches are blue (`by_age`: greener the older), those removed by boxes orange. With the boxes'
    `state` (K,), as `box_tracks` has it, boxes that move have a thick whole line, parked ones a dashed one,
    unknown ones dots. `words` are written above the boxes.
    """
    picture = np.asarray(cv2.cvtColor(image, cv2.COLOR_GRAY2BGR), np.uint8)
    states = [MOVING] * len(boxes) if state is None else state.tolist()
    places = np.rint(boxes.xyxy).astype(int).tolist()
    for corners, each in zip(places, states, strict=True):
        _draw_box(picture, corners, each, thick=state is not None)
    # Sub-pixel drawing: OpenCV takes fixed-point coordinates with four binary digits.
    ends = np.rint(np.stack([matches.prev_left, matches.cur_left], axis=1) * 16).astype(int)
    ages = np.clip(matches.age, 1, len(AGE_COLOURS)).tolist()
    for (start, end), keep, age in zip(ends.tolist(), kept.tolist(), ages, strict=True):
        colour = (AGE_COLOURS[age - 1] if by_age else KEPT) if keep else REMOVED
        cv2.line(picture, start, end, colour, 1, cv2.LINE_AA, shift=4)
        cv2.circle(picture, end, 2 * 16, colour, -1, cv2.LINE_AA, shift=4)
    for corners, word in zip(places, words, strict=False):  # last, on dark ground: no line crosses them
        x, y = max(corners[0], 0), max(corners[1] - 4, 12)
        (width, high), _ = cv2.getTextSize(word, cv2.FONT_HERSHEY_SIMPLEX, 0.4, 1)
        picture[y - high - 2 : y + 3, x : x + width] //= 4
        cv2.putText(picture, word, (x, y), cv2.FONT_HERSHEY_SIMPLEX, 0.4, BOX, 1, cv2.LINE_AA)
    return np.asarray(picture, np.uint8)


def _draw_box(picture: Image, corners: list[int], state: int, thick: bool) -> None:
    """Draw a box in place in the line style of its state."""
    x0, y0, x1, y1 = corners
    if state == MOVING:
        cv2.rectangle(picture, (x0, y0), (x1, y1), BOX, 2 if thick else 1, cv2.LINE_AA)
        return
    dash, period = (7, 12) if state == PARKED else (1, 5)
    for x in range(x0, x1 + 1, period):
        for y in (y0, y1):
            cv2.line(picture, (x, y), (min(x + dash, x1), y), BOX, 1)
    for y in range(y0, y1 + 1, period):
        for x in (x0, x1):
            cv2.line(picture, (x, y), (x, min(y + dash, y1)), BOX, 1)


def jpeg(picture: Image, quality: int = 85) -> bytes:
    """A BGR picture (H, W, 3) as JPEG bytes."""
    return bytes(cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, quality])[1])


def png(figure: Figure) -> bytes:
    """A figure as PNG bytes, the same for the same figure."""
    return _saved(figure, "png", {"Software": None})


def pdf(figure: Figure) -> bytes:
    """A figure as PDF bytes, the same for the same figure."""
    return _saved(figure, "pdf", {"CreationDate": None})


def _saved(figure: Figure, kind: str, metadata: dict[str, None]) -> bytes:
    for text in figure.findobj(Text):
        text.set_parse_math(False)  # a dollar sign in a folder's name begins no formula
        text.set_text(text.get_text().encode("utf-8", "replace").decode())  # nor is each name UTF-8
    buffer = io.BytesIO()
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph")  # a letter that the font lacks is drawn as a frame
        if figure.get_layout_engine() is not None:
            # Each drawing would lay the parts out again, starting from where they are: once is enough.
            figure.draw_without_rendering()
            figure.set_layout_engine("none")
        figure.savefig(buffer, format=kind, metadata=metadata)
    return buffer.getvalue()
