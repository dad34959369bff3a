"""Figures: functions that draw on a given axis or return a Matplotlib Figure, without pyplot.

The first figure imports Matplotlib: this takes half a second, which --help need not wait for.
"""

from __future__ import annotations

import io
import textwrap
import warnings
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, TypeVar

import cv2
import numpy as np

from ..data.poses import from_first
from ..errors import DataError
from ..evaluation.kitti import trajectory_distances
from ..geometry.boxes import MOVING, PARKED, Boxes
from ..geometry.matches import StereoMatches
from ..geometry.types import Array, BoolArray, Image, IntArray
from .printed import PROPOSAL

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Values = TypeVar("Values")
# Points (length in m or speed in km/h, TE in %, RE in deg/100 m) of a method.
ErrorCurve = Sequence[tuple[float, float | None, float | None]]
SMALL_PAGE = (4.8, 5.6)  # inches; the text is still read on a telephone
TRUTH = "ground truth"
# Okabe and Ito's colours, told apart by colour-blind readers too.
CYCLE = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#F0E442")
STYLED = PROPOSAL, "solution_selection", "viso2", "mesvo_f", "moving_selection"
METHOD_COLOURS = dict(zip(STYLED, CYCLE, strict=False))
METHOD_MARKERS = dict(zip(STYLED, "D^sov", strict=True))
TRUTH_COLOUR = "#222222"
LINE_WIDTHS = {PROPOSAL: 4.0, TRUTH: 0.9}  # points; others between


def page(title: str = "", width: float = SMALL_PAGE[0], height: float = SMALL_PAGE[1]) -> Figure:
    """An empty figure, inches, its parts laid out together; a long title takes several lines.

    Raises `DataError` where the environment names a backend that Matplotlib does not know.
    """
    try:
        from matplotlib.figure import Figure
    except ValueError as error:
        raise DataError(f"Matplotlib: {error}") from None
    made = Figure(figsize=(width, height), dpi=160, layout="constrained")
    if title:
        # Matplotlib's own wrapping takes what stands between dollar signs for a formula.
        lines = [textwrap.fill(line, int(11 * width)) for line in title.split("\n")]
        made.suptitle("\n".join(lines), fontsize="medium")
    return made


def method_colour(name: str, number: int) -> str:
    """The colour of the truth or a method; another name takes the colour of its number."""
    return TRUTH_COLOUR if name == TRUTH else METHOD_COLOURS.get(name, CYCLE[number % len(CYCLE)])


def styled(named: Mapping[str, Values]) -> Iterator[tuple[str, Values, dict[str, Any]]]:
    """Names and values with Matplotlib's style of each line: the proposal first, the truth last.

    Lines get thinner from the first to the last: overlapping ones stay visible.
    """
    for number, name in enumerate(sorted(named, key=lambda name: (name == TRUTH, name != PROPOSAL))):
        width = LINE_WIDTHS.get(name, 1.0 + 0.4 * (len(named) - 1 - number))
        yield name, named[name], {"color": method_colour(name, number), "linewidth": width, "label": name}


def label_axis(axis: Axes, x: str, y: str) -> None:
    """Name what an axis shows, and rule it."""
    axis.set_xlabel(x)
    axis.set_ylabel(y)
    axis.grid(alpha=0.3)


def draw_trajectories(axis: Axes, title: str, truth: Array | None, estimates: Mapping[str, Array]) -> None:
    """Top view of the truth and of named estimates, (N, 4, 4) each, metres; a dot marks the start."""
    # An estimate starts at the identity; the truth of a part of a sequence does not.
    paths = {} if truth is None else {TRUTH: from_first(truth)}
    for _, poses, style in styled({**paths, **estimates}):
        x, z = poses[:, [0, 2], 3].T
        axis.plot(x, z, **style)
        axis.plot(x[0], z[0], "o", color=style["color"], markersize=4)
    axis.set_aspect("equal", adjustable="datalim")
    axis.set_title(title)
    label_axis(axis, "x, right [m]", "z, forward [m]")


def distance_from_truth(poses: Array, truth: Array) -> Array:
    """Distance (N,) of poses from the truth moved to the origin, (N, 4, 4) each, metres."""
    return np.asarray(np.linalg.norm(poses[:, :3, 3] - from_first(truth)[:, :3, 3], axis=1))


def draw_drift(axis: Axes, truth: Array, estimates: Mapping[str, Array]) -> None:
    """Distance of estimates from the truth, which is moved to the origin, along the true path, metres both.

    Paths that coincide from above still differ here.
    """
    path = trajectory_distances(truth)
    for _, poses, style in styled(estimates):
        axis.plot(path, distance_from_truth(poses, truth), **style)
    axis.set_ylim(bottom=0.0)
    label_axis(axis, "along the path [m]", "distance from the truth [m]")


def trajectories_figure(panels: Mapping[str, tuple[Array | None, dict[str, Array]]]) -> Figure:
    """Sequences by title, truth and named estimates: a row each, from above and, with truth, the drift."""
    rows, columns = len(panels), 1 + any(truth is not None for truth, _ in panels.values())
    width, height = SMALL_PAGE
    figure = page(width=width * columns, height=(height - 1.0) * rows + 1.0)
    labels: dict[str, Any] = {}
    for row, (title, (truth, estimates)) in enumerate(panels.items()):
        axis = figure.add_subplot(rows, columns, row * columns + 1)
        draw_trajectories(axis, title, truth, estimates)
        lines = {str(line.get_label()): line for line in axis.get_lines()}
        labels |= {name: line for name, line in lines.items() if not name.startswith("_")}
        if truth is not None:
            draw_drift(figure.add_subplot(rows, columns, row * columns + 2), truth, estimates)
    figure.legend(labels.values(), labels, loc="outside lower center", ncols=2 * columns)
    return figure


def draw_errors(axis: Axes, errors: Mapping[tuple[str, str], Array], kind: int) -> None:
    """TE (kind 0) or RE (1) by (sequence, method), (2, S) of S seeds: a bar each, a line for a deviation."""
    sequences, methods = (list(dict.fromkeys(names)) for names in zip(*errors, strict=True))
    share = 0.85 / len(methods)
    for k, method in enumerate(methods):
        values = {n: errors[s, method][kind] for n, s in enumerate(sequences) if (s, method) in errors}
        at = [place + share * (k - (len(methods) - 1) / 2) for place in values]
        means, spreads = ([function(each) for each in values.values()] for function in (np.mean, np.std))
        bars = axis.bar(at, means, share, yerr=spreads, color=method_colour(method, k), label=method)
        if len(sequences) == 1:
            axis.bar_label(bars, fmt="%#.3g")
    axis.set(axisbelow=True, xticks=range(len(sequences)), xticklabels=sequences)
    axis.margins(0.02, 0.12)  # room for the labels


def errors_figure(title: str, errors: Mapping[tuple[str, str], Array]) -> Figure:
    """TE and RE by (sequence, method), (2, S) of S seeds, as `draw_errors` has them."""
    figure = page(title, max(SMALL_PAGE[0], 0.8 * len({sequence for sequence, _ in errors})))
    axes = figure.subplots(2, sharex=True)
    for axis, kind, label in zip(axes, (0, 1), ("TE [%]", "RE [deg/100 m]"), strict=True):
        draw_errors(axis, errors, kind)
        label_axis(axis, "", label)
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=2)
    return figure


def error_curves_figure(title: str, by: str, curves: Mapping[str, ErrorCurve]) -> Figure:
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


# Features in BGR: kept in blue, removed in orange; boxes in white.
KEPT, REMOVED, BOX = (178, 114, 0), (0, 94, 213), (255, 255, 255)
# Kept features from new to old, from blue to green, where their age is shown.
AGE_COLOURS = [(255 - 13 * n, 90 + 11 * n, 12 * n // 2) for n in range(16)]


def match_image(
    image: Image,
    matches: StereoMatches,
    kept: BoolArray,
    boxes: Boxes,
    state: IntArray | None = None,
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
    from matplotlib.text import Text

    for text in figure.findobj(Text):
        text.set_parse_math(False)  # a dollar sign in a folder's name begins no formula
        text.set_text(text.get_text().encode("utf-8", "replace").decode())  # nor is each name UTF-8
    buffer = io.BytesIO()
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph")  # a letter that the font lacks is drawn as a frame
        figure.savefig(buffer, format="png", metadata={"Software": None})
    return buffer.getvalue()
