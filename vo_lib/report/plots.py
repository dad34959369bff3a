"""Charts, which Matplotlib draws, and images with features and boxes, which OpenCV draws.

The functions for charts draw on an axis or return a Matplotlib Figure, without pyplot. Matplotlib is imported
only for the first figure, since the import takes half a second.

Estimates are in the axes of the first true camera. The truth may be in others, such as those of the whole
sequence for a part of it: charts show it in the axes of its first camera, too.
"""

from __future__ import annotations

import io
import math
import os
import re
import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from ..data.poses import from_first
from ..errors import DataError
from ..evaluation.kitti_errors import trajectory_distances
from ..evaluation.statistics import standard_deviation
from ..geometry.boxes import MOVING, PARKED, Boxes
from ..geometry.matches import StereoMatches
from ..geometry.types import Array, BoolArray, Image, IntArray
from .breaking import GLUE, broken
from .table1 import PROPOSAL

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Values = TypeVar("Values")
# Points (length in m or speed in km/h, TE in %, RE in deg/100 m) of a method.
ErrorCurve = Sequence[tuple[float, float | None, float | None]]
SMALL_PAGE = (4.8, 5.6)  # inches; the text is legible on a telephone
TRUTH = "ground truth"
# Okabe and Ito's colours, distinct for colour-blind readers too.
CYCLE = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#F0E442")
METHOD_COLOURS = {
    PROPOSAL: CYCLE[0],
    "solution_selection": CYCLE[1],
    "viso2": CYCLE[2],
    "mesvo_f": CYCLE[3],
    "moving_selection": CYCLE[4],
}
METHOD_MARKERS = {
    PROPOSAL: "D",
    "solution_selection": "^",
    "viso2": "s",
    "mesvo_f": "o",
    "moving_selection": "v",
}
TRUTH_COLOUR = "#222222"
LOOP_COLOUR = CYCLE[5]
LINE_WIDTHS = {PROPOSAL: 4.0, TRUTH: 0.9}  # points
# The other lines, points: this width, and one step more for each line that is drawn after it, the truth
# included.
LAST_LINE_WIDTH = 1.0
LINE_WIDTH_STEP = 0.4
TRUTH_EDGE = 0.6  # points, of the white edge on each side of the truth
# A path is straight if its width, divided by its length, is less: then a view from above with equal axes
# would be nearly empty.
STRAIGHT = 0.2
MAGNIFIED = "(the axes have different scales: sideways is magnified)"
# The room that texts need. A width is a number of letters, a height is in inches.
LETTERS = 12  # in an inch, at Matplotlib's font size "medium", which all texts have
TITLE_LETTERS = 11  # in an inch of a title: fewer, so that it ends before the figure does
AXIS_LETTERS = 54  # in a line below an axis
LINE_HEIGHT = 0.18
TITLE_LINE_HEIGHT = 1.3 * LINE_HEIGHT
LEGEND_SIGN = 0.8  # inches in front of a name in a legend, with the line that it explains
USUAL_LEGEND_LINES = 3  # a figure has room for so many
# A name below an axis is broken into at most `MOST_LINES` lines, or into more if these would have more than
# `MOST_LETTERS` letters.
MOST_LINES = 4
MOST_LETTERS = 20
LEAST_LETTERS = 9  # in a line of a name below bars
# Parts of a page, in inches.
STRAIGHT_HEIGHT = 2.6  # of the chart of a straight drive
BELOW_CHARTS = 1.0  # the height that is left for the legend
BESIDE_BARS = 0.8  # the width that is left for the numbers of an axis
BARS_SHARE = 0.85  # the bars of a sequence take this share of its room


def require_matplotlib() -> None:
    """Raise `DataError` if Matplotlib refuses the environment variable MPLBACKEND."""
    try:
        import matplotlib  # noqa: F401  (an invalid variable is an error of the import)
    except ValueError:
        backend = os.environ.get("MPLBACKEND")
        raise DataError(f"MPLBACKEND={backend}: is no backend of Matplotlib; unset this variable") from None


def figure_page(title: str = "", width: float = SMALL_PAGE[0], height: float = SMALL_PAGE[1]) -> Figure:
    """An empty figure of a size in inches, with constrained layout; a long title is wrapped."""
    require_matplotlib()
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), dpi=160, layout="constrained")
    if title:
        figure.suptitle(_wrapped(title, width), fontsize="medium")
    return figure


def _wrapped(title: str, width: float) -> str:
    """A title in lines that fit into a width in inches, at Matplotlib's font size "medium".

    Matplotlib's own wrapping would interpret text between dollar signs as a formula.
    """
    with_units = re.sub(r"(?<=\d) ", GLUE, title)  # a number keeps its unit
    return broken(with_units, int(TITLE_LETTERS * width))


def add_legend(figure: Figure, lines: Mapping[str, Any], width: float, side: str = "center") -> None:
    """Put a legend of lines or bars by name below a figure, `width` inches wide; the figure grows for it."""
    columns = 2
    letters = int((width - 2 * LEGEND_SIGN) / 2 * LETTERS)
    if max(map(len, lines), default=0) > letters:  # the longest name has no room beside another
        columns = 1
        letters = int((width - LEGEND_SIGN) * LETTERS)
    names = [broken(name, letters) for name in lines]
    rows = math.ceil(sum(1 + name.count("\n") for name in names) / columns)
    figure.set_figheight(figure.get_figheight() + LINE_HEIGHT * max(0, rows - USUAL_LEGEND_LINES))
    place: Any = f"outside lower {side}"
    figure.legend(lines.values(), names, loc=place, ncols=columns)


def letters_beside(names: Iterable[str], least: int) -> int:
    """The number of letters in a line of names that stand beside each other below an axis.

    It is `least` or, if the longest name would then have more than `MOST_LINES` lines, as many as that name
    needs, but at most `MOST_LETTERS`.
    """
    longest = max(map(len, names), default=0)
    return min(max(least, math.ceil(longest / MOST_LINES)), MOST_LETTERS)


def bgr(colour: str) -> tuple[int, int, int]:
    """OpenCV's form of a colour such as "#0072B2"."""
    red, green, blue = bytes.fromhex(colour[1:])
    return blue, green, red


def method_colour(name: str, number: int) -> str:
    """The colour of the truth or of a method; for another name, colour `number` of `CYCLE`."""
    if name == TRUTH:
        return TRUTH_COLOUR
    return METHOD_COLOURS.get(name, CYCLE[number % len(CYCLE)])


def styled(named: Mapping[str, Values]) -> Iterator[tuple[str, Values, dict[str, Any]]]:
    """Names, values and line styles for Matplotlib, the proposal first, the truth last.

    Of up to nine lines, each is thinner than the one drawn before it, so that both are seen where they
    overlap.
    """
    from matplotlib.patheffects import withStroke

    # A pair of booleans sorts the truth behind all others, and the proposal before them.
    names = sorted(named, key=lambda name: (name == TRUTH, name != PROPOSAL))
    for number, name in enumerate(names):
        lines_after = len(named) - 1 - number
        width = LINE_WIDTHS.get(name, LAST_LINE_WIDTH + LINE_WIDTH_STEP * lines_after)
        style = {"color": method_colour(name, number), "linewidth": width, "label": name}
        if name == TRUTH:  # a white edge, so that the thin line is seen on a path below it
            style["path_effects"] = [withStroke(linewidth=width + 2 * TRUTH_EDGE, foreground="white")]
        yield name, named[name], style


def label_axis(axis: Axes, x: str, y: str) -> None:
    """Set the labels of an axis and draw a grid."""
    axis.set_xlabel(x)
    axis.set_ylabel(y)
    axis.grid(alpha=0.3)


def draw_trajectories(axis: Axes, title: str, truth: Array | None, estimates: Mapping[str, Array]) -> None:
    """Draw the truth and named estimates, (N, 4, 4) each, seen from above; a dot marks the start."""
    paths = {} if truth is None else {TRUTH: from_first(truth)}
    for _, poses, style in styled({**paths, **estimates}):
        x, z = poses[:, [0, 2], 3].T
        axis.plot(x, z, **style)
        axis.plot(x[0], z[0], "o", color=style["color"], markersize=4)
    axis.set_aspect("equal", adjustable="datalim")
    axis.set_title(_wrapped(title, SMALL_PAGE[0]), fontsize="medium")
    label_axis(axis, "x, right [m]", "z, forward [m]")


def distance_from_truth(poses: Array, truth: Array) -> Array:
    """Distances (N,) in metres between poses and truth, (N, 4, 4) each.

    The poses are in the axes of the first true camera.
    """
    return np.asarray(np.linalg.norm(poses[:, :3, 3] - from_first(truth)[:, :3, 3], axis=1))


def is_straight(truth: Array | None, estimates: Mapping[str, Array]) -> bool:
    """Whether all paths (N, 4, 4), seen from above, are so narrow that a chart of them is nearly empty."""
    paths = [*estimates.values()] if truth is None else [from_first(truth), *estimates.values()]
    points = np.concatenate([poses[:, [0, 2], 3] for poses in paths])
    centred = points - points.mean(axis=0)
    # The principal axes of the points: the first row is the direction of the drive, the second one is across.
    _, _, axes = np.linalg.svd(centred, full_matrices=False)
    length, width = np.ptp(centred @ axes.T, axis=0)
    return bool(width < STRAIGHT * length)


def sideways_from_truth(poses: Array, truth: Array) -> Array:
    """How far poses are to the right of the true ones, (N,) metres, seen from the true camera.

    Both are (N, 4, 4); the poses are in the axes of the first true camera.
    """
    true = from_first(truth)
    to_right = true[:, :3, 0]  # the x axis of the true camera
    return np.asarray(np.einsum("ni,ni->n", to_right, poses[:, :3, 3] - true[:, :3, 3]))


def draw_sideways(axis: Axes, title: str, truth: Array | None, estimates: Mapping[str, Array]) -> None:
    """Draw how far estimates are beside the truth, in place of a view from above of a straight drive.

    Without a truth, it is how far they are beside the line from the start to the end of the first estimate.
    The axes are not equal: a metre to the side is longer than a metre ahead, and the label says so.
    """
    if truth is not None:
        along = trajectory_distances(truth)
        # The truth is the line of zeros, drawn last as everywhere.
        for _, poses, style in styled({**estimates, TRUTH: from_first(truth)}):
            axis.plot(along, sideways_from_truth(poses, truth), **style)
        label_axis(axis, f"along the path [m]\n{MAGNIFIED}", "to the right of the truth [m]")
    else:
        name, first = next(iter(estimates.items()))
        start, end = first[[0, -1]][:, [0, 2], 3]
        ahead = (end - start) / max(float(np.linalg.norm(end - start)), 1e-9)
        right = ahead[::-1] * [1.0, -1.0]  # ahead, turned by 90° to the right; both are (x, z)
        for _, poses, style in styled(estimates):
            xz = poses[:, [0, 2], 3] - start
            axis.plot(xz @ ahead, xz @ right, **style)
        line = broken(f"along the line from the start to the end of {name} [m]", AXIS_LETTERS)
        label_axis(axis, f"{line}\n{MAGNIFIED}", "to the right of this line [m]")
    axis.set_title(_wrapped(title, SMALL_PAGE[0]), fontsize="medium")
    axis.margins(y=0.1)


def draw_drift(axis: Axes, truth: Array, estimates: Mapping[str, Array]) -> None:
    """Draw the distance of estimates from the truth against the length of the true path, in metres.

    The distance shows differences that are invisible in a view from above.
    """
    path = trajectory_distances(truth)
    for _, poses, style in styled(estimates):
        axis.plot(path, distance_from_truth(poses, truth), **style)
    axis.set_ylim(bottom=0.0)
    label_axis(axis, "along the path [m]", "distance from the truth [m]")


def trajectories_figure(
    panels: Mapping[str, tuple[Array | None, dict[str, Array]]], loops: Sequence[tuple[int, int]] = ()
) -> Figure:
    """One row per panel (title, truth, named estimates): paths seen from above, and distances from truth.

    Of a straight drive, the first is how far the paths are beside the truth (`draw_sideways`).

    loops : pairs of frames that a line on the first path joins; it is then always seen from above.
    """
    has_truth = any(truth is not None for truth, _ in panels.values())
    columns = 2 if has_truth else 1
    width, height = SMALL_PAGE
    shows_sideways = {title: not loops and is_straight(*panel) for title, panel in panels.items()}
    heights = [STRAIGHT_HEIGHT if shows_sideways[title] else height - BELOW_CHARTS for title in panels]
    # A title of two lines has room in any case.
    more_lines = sum(max(0, _wrapped(title, width).count("\n") - 1) for title in panels)
    page_height = sum(heights) + BELOW_CHARTS + TITLE_LINE_HEIGHT * more_lines
    figure = figure_page(width=width * columns, height=page_height)
    grid = figure.add_gridspec(len(panels), columns, height_ratios=heights)
    line_of_name: dict[str, Any] = {}
    for row, (title, (truth, estimates)) in enumerate(panels.items()):
        axis = figure.add_subplot(grid[row, 0])
        draw = draw_sideways if shows_sideways[title] else draw_trajectories
        draw(axis, title, truth, estimates)
        if loops:
            first_path = next(iter(estimates.values()))
            _draw_loops(axis, first_path, loops)
        for line in axis.get_lines():
            name = str(line.get_label())
            if not name.startswith("_"):  # Matplotlib's names of lines without a label
                line_of_name[name] = line
        if truth is not None:
            draw_drift(figure.add_subplot(grid[row, 1]), truth, estimates)
    # In the left half, so that a telephone shows the legend with the first panel.
    add_legend(figure, line_of_name, width, "left")
    return figure


def _draw_loops(axis: Axes, poses: Array, loops: Sequence[tuple[int, int]]) -> None:
    """Draw a line between the two places of each loop of a path (N, 4, 4), seen from above."""
    ends = poses[np.array(loops).T, :3, 3]  # (2, number of loops, 3)
    axis.plot(
        ends[:, :, 0],
        ends[:, :, 2],
        "-o",
        color=LOOP_COLOUR,
        markersize=3,
        linewidth=1.2,
        label="loop",
    )


def errors_figure(title: str, errors: Mapping[tuple[str, str], Array]) -> Figure:
    """Bars of TE and RE by sequence and method, with deviations over S seeds.

    errors : TE in % and RE in deg/100 m, (2, S), by sequence and method.
    """
    sequences = list(dict.fromkeys(sequence for sequence, _ in errors))
    methods = list(dict.fromkeys(method for _, method in errors))
    # A line of a sequence's name has the letters that it needs, or more if the page has room for them. If it
    # has no room for all names, it becomes wider.
    letters_on_page = int((SMALL_PAGE[0] - BESIDE_BARS) * LETTERS / len(sequences))
    letters = max(letters_beside(sequences, LEAST_LETTERS), letters_on_page)
    names = [broken(name, letters) for name in sequences]
    width = max(SMALL_PAGE[0], letters / LETTERS * len(sequences) + BESIDE_BARS)
    name_lines = 1 + max(name.count("\n") for name in names)
    figure = figure_page(title, width, SMALL_PAGE[1] + LINE_HEIGHT * (name_lines - 1))
    axes = figure.subplots(2, sharex=True)
    for row, (axis, label) in enumerate(zip(axes, ("TE [%]", "RE [deg/100 m]"), strict=True)):
        _draw_bars(axis, {key: te_and_re[row] for key, te_and_re in errors.items()}, sequences, methods)
        axis.set(axisbelow=True, xticks=range(len(sequences)), xticklabels=names)
        axis.margins(0.02, 0.12)  # room for the labels
        label_axis(axis, "", label)
    handles, of_handles = axes[0].get_legend_handles_labels()
    add_legend(figure, dict(zip(of_handles, handles, strict=True)), width)
    return figure


def _draw_bars(
    axis: Axes, errors: Mapping[tuple[str, str], Array], sequences: list[str], methods: list[str]
) -> None:
    """Draw a bar for each method on each sequence: the mean over the seeds, and their standard deviation.

    errors : (S,) over the seeds, by sequence and method. A single sequence has the means above its bars.
    """
    bar_width = BARS_SHARE / len(methods)
    for number, method in enumerate(methods):
        # The bars of a sequence stand side by side, with their middle at the sequence's place.
        from_middle = bar_width * (number - (len(methods) - 1) / 2)
        positions = []
        means = []
        deviations = []
        for place, sequence in enumerate(sequences):
            if (sequence, method) in errors:
                of_seeds = errors[sequence, method]
                positions.append(place + from_middle)
                means.append(of_seeds.mean())
                # One seed has no deviation (NaN), and no error bar.
                deviations.append(float(np.nan_to_num(standard_deviation(of_seeds))))
        colour = method_colour(method, number)
        bars = axis.bar(positions, means, bar_width, yerr=deviations, color=colour, label=method)
        if len(sequences) == 1:
            axis.bar_label(bars, fmt="%#.3g")


def error_curves_figure(title: str, by: str, curves: Mapping[str, ErrorCurve]) -> Figure:
    """The devkit's curves of named methods: TE and RE by "length" or "speed" of the sub-sequences."""
    figure = figure_page(title)
    axes = figure.subplots(2, sharex=True)
    for name, points, style in styled(curves):
        marker_style = {
            "marker": METHOD_MARKERS.get(name, "o"),
            "markerfacecolor": "none",
            "markersize": 3 + style["linewidth"],
            # A marker on the edge is whole, and does not enlarge the axis.
            "clip_on": False,
            "in_layout": False,
        }
        x, te, re_degrees = np.reshape(np.asarray(points, np.float64), (-1, 3)).T
        axes[0].plot(x, te, **style, **marker_style)
        axes[1].plot(x, re_degrees, **style, **marker_style)
    label_axis(axes[0], "", "TE [%]")
    below = "sub-sequence length [m]" if by == "length" else "speed [km/h]"
    label_axis(axes[1], below, "RE [deg/100 m]")
    for axis in axes:
        axis.set_ylim(bottom=0.0)
    handles, of_handles = axes[0].get_legend_handles_labels()
    add_legend(figure, dict(zip(of_handles, handles, strict=True)), figure.get_figwidth())
    return figure


# Images with features and boxes.
JPEG_QUALITY = 85  # per cent
# BGR colours of features that are kept (blue) or removed (orange), and of boxes (white).
KEPT = bgr(CYCLE[0])
REMOVED = bgr(CYCLE[1])
BOX = (255, 255, 255)
# BGR colours of kept features by age in frames, from 1 (cyan) over green to 16 and more (yellow).
AGE_COLOURS = [(255 - 17 * n, 220, 17 * n) for n in range(16)]
# OpenCV draws with sub-pixel precision from fixed-point coordinates with so many binary digits.
FIXED_BITS = 4
FEATURE_RADIUS_PX = 2
WORD_SIZE = 0.4  # of the words above boxes, in OpenCV's scale of its font


def fixed_point(positions: Array) -> NDArray[np.int32]:
    """Positions (..., 2), pixels, as OpenCV's functions take them with `shift=FIXED_BITS`."""
    return np.asarray(np.rint(positions * 2**FIXED_BITS), np.int32)


def match_image(
    image: Image,
    matches: StereoMatches,
    kept: BoolArray,
    boxes: Boxes,
    state: IntArray | None = None,
    words: Sequence[str] = (),
    by_age: bool = False,
) -> Image:
    """The current left image in BGR (H, W, 3); a match is a line from the previous to the current position.

    Kept matches are blue, removed matches orange.

    Parameters
    ----------
    image : (H, W) uint8.
    kept : (N,) which of the N matches the box rule kept.
    boxes : K boxes.
    state : (K,) state of each box, of a `Removal`: moving boxes then have a thick solid line, parked boxes a
        dashed line, unknown boxes a dotted line.
    words : written above the boxes, in their order.
    by_age : kept matches have the colours `AGE_COLOURS` instead of blue.
    """
    picture = np.asarray(cv2.cvtColor(image, cv2.COLOR_GRAY2BGR), np.uint8)
    states = [MOVING] * len(boxes) if state is None else state.tolist()
    rectangles = np.rint(boxes.xyxy).astype(int).tolist()
    for corners, box_state in zip(rectangles, states, strict=True):
        _draw_box(picture, corners, box_state, thick=state is not None)
    starts = fixed_point(matches.prev_left).tolist()
    ends = fixed_point(matches.cur_left).tolist()
    ages = np.clip(matches.age, 1, len(AGE_COLOURS)).tolist()
    radius = FEATURE_RADIUS_PX * 2**FIXED_BITS
    for start, end, is_kept, age in zip(starts, ends, kept.tolist(), ages, strict=True):
        colour = REMOVED
        if is_kept:
            colour = AGE_COLOURS[age - 1] if by_age else KEPT
        cv2.line(picture, start, end, colour, 1, cv2.LINE_AA, shift=FIXED_BITS)
        cv2.circle(picture, end, radius, colour, -1, cv2.LINE_AA, shift=FIXED_BITS)
    for corners, word in zip(rectangles, words, strict=False):  # last, so that no line covers them
        _write_above(picture, corners, word)
    return np.asarray(picture, np.uint8)


def _write_above(picture: Image, corners: list[int], word: str) -> None:
    """Write a word above a box, on a dark background, inside the picture."""
    x = max(corners[0], 0)
    y = max(corners[1] - 4, 12)
    (width, height), _ = cv2.getTextSize(word, cv2.FONT_HERSHEY_SIMPLEX, WORD_SIZE, 1)
    picture[y - height - 2 : y + 3, x : x + width] //= 4
    cv2.putText(picture, word, (x, y), cv2.FONT_HERSHEY_SIMPLEX, WORD_SIZE, BOX, 1, cv2.LINE_AA)


def _draw_box(picture: Image, corners: list[int], state: int, thick: bool) -> None:
    """Draw a box with corners (x0, y0, x1, y1), pixels, in the line style of its state."""
    x0, y0, x1, y1 = corners
    if state == MOVING:
        cv2.rectangle(picture, (x0, y0), (x1, y1), BOX, 2 if thick else 1, cv2.LINE_AA)
        return
    # Dashes for a parked vehicle, dots for one without a verdict, pixels.
    dash = 7 if state == PARKED else 1
    period = 12 if state == PARKED else 5
    for x in range(x0, x1 + 1, period):
        for y in (y0, y1):
            cv2.line(picture, (x, y), (min(x + dash, x1), y), BOX, 1)
    for y in range(y0, y1 + 1, period):
        for x in (x0, x1):
            cv2.line(picture, (x, y), (x, min(y + dash, y1)), BOX, 1)


def jpeg(picture: Image) -> bytes:
    """A picture (H, W, 3), BGR, as JPEG bytes; equal pictures give equal bytes."""
    return cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])[1].tobytes()


def png(figure: Figure) -> bytes:
    """A figure as PNG bytes; equal figures give equal bytes."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.text import Text

    for text in figure.findobj(Text):
        text.set_parse_math(False)  # a dollar sign in a folder's name does not begin a formula
        text.set_text(text.get_text().encode("utf-8", "replace").decode())  # file names may not be UTF-8
    buffer = io.BytesIO()
    with warnings.catch_warnings():
        # Matplotlib draws a frame for a letter that the font lacks.
        warnings.filterwarnings("ignore", "Glyph")
        # `Figure.savefig` would go through all artists twice.
        FigureCanvasAgg(figure).print_png(buffer, metadata={"Software": None})  # type: ignore[no-untyped-call]
    return buffer.getvalue()
