"""Figures of chapter 1: windows, descriptors, the loop of four images, and the fates of the matches."""

from __future__ import annotations

import cv2
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from vo_lib.data.sequence import Sequence
from vo_lib.geometry.matches import StereoMatches
from vo_lib.geometry.types import Array, BoolArray, Image
from vo_lib.paper.features import DESCRIPTOR_OFFSETS

from ..colours import BAD, CYCLE, DARK, FIFTH, FOURTH, GOOD, PALE, THIRD, bgr
from ..drawing import (
    PHOTO_HEIGHT,
    SMALL_SIZE,
    WIDTH,
    caption,
    figure,
    finish,
    log_axis,
    numbers_at,
    photo,
    raster,
    room,
)
from ..drawn_matches import draw_dots, draw_flow
from ..frames import stereo
from .exercises import eigenvalues
from .trace import CHECKS, CHOSEN, LOST, OPEN, SURPLUS, Trace
from .wrong_matches import RIGHT, ErrorMeasure

HALF = WIDTH // 2
SQUARE = WIDTH // 4
# The fates of a feature, each with its colour.
FATES = {
    OPEN: "#D8D8D8",
    LOST: PALE,
    **dict(zip(CHECKS, (FOURTH, THIRD, FIFTH, BAD), strict=True)),
    SURPLUS: "#56B4E9",
    CHOSEN: GOOD,
}
SIDES = ("previous left", "previous right", "current right", "current left")
# Pixels shown of an error.
LEAST = 0.01
MOST = 100.0
EDGE = 1 / 3  # ratio of the roots of the eigenvalues, below which a window is an edge
LEGEND_LINE = 18  # height of a line of a legend, pixels
LEGEND_EDGE = 12  # above and below its lines, pixels
NAMES = 0.055  # of a figure's width, for the names of the fates


def grey_picture(response: NDArray[np.float32]) -> Image:
    """A detector's response as brightness; medium grey is zero."""
    scale = 127.0 / float(np.percentile(np.abs(response), 99.5) + 1e-9)
    return photo(np.clip(128.0 + scale * response, 0, 255).astype(np.uint8), HALF)


def windows_picture(image: Image, half: int = 5, reach: int = 10) -> Image:
    """The flattest window, the clearest edge and the clearest corner of an image, (2 half + 1)² pixels each.

    Beside a window: its difference from the image for each shift of up to `reach` pixels; black is zero.
    """
    values = np.sort(cv2.cornerEigenValsAndVecs(image, 2 * half + 1, 3)[:, :, :2], axis=2)
    values = values[half + reach : -half - reach, half + reach : -half - reach]
    small = values[:, :, 0]
    large = values[:, :, 1]
    wanted = {"flat": -large, "edge": np.where(small < 0.002 * large, large, 0.0), "corner": small}
    size = WIDTH // 6 - 4
    gap = ((0, 0), (0, 4), (0, 0))
    parts = []
    for name, score in wanted.items():
        uv = np.array(np.unravel_index(np.argmax(score), score.shape), np.float64)[::-1] + half + reach
        around, _ = surroundings(image, uv, half + reach)
        window, _ = surroundings(image, uv, half)
        gy, gx = np.gradient(window.astype(float))
        difference = np.sqrt(cv2.matchTemplate(around, window, cv2.TM_SQDIFF))
        tones = np.asarray(np.clip(255.0 * difference / (90.0 * len(window)), 0, 255), np.uint8)
        roots = "roots {:.0f} and {:.0f}".format(*np.sqrt(eigenvalues(gx, gy)))
        for each, words in ((around, name), (tones, roots)):
            large_one = np.asarray(cv2.resize(each, (size, size), interpolation=cv2.INTER_NEAREST), np.uint8)
            parts.append(caption(photo(large_one, size), words))
        low = round(size * reach / len(around))
        high = round(size * (reach + len(window)) / len(around))
        cv2.rectangle(parts[-2], (low, low), (high, high), bgr(BAD), 1)
    return np.concatenate([np.pad(part, gap, constant_values=255) for part in parts], axis=1)


def on_edge(image: Image, uv: Array, half: int = 5) -> BoolArray:
    """Mask (N,) of the points (N, 2) on an edge: the smaller root of an eigenvalue is below a third of the larger."""
    mask = []
    for place in uv:
        gy, gx = np.gradient(_window(image, place, half + 1).astype(float))
        small, large = np.sqrt(np.maximum(eigenvalues(gx[1:-1, 1:-1], gy[1:-1, 1:-1]), 0.0)).tolist()
        mask.append(small < EDGE * large)
    return np.array(mask, np.bool_)


def points_picture(image: Image, uv: Array, words: str, cell: int = 0) -> Image:
    """Points (N, 2) on an image, with a grid of squares of `cell` pixels."""
    picture = _with_grid(image, cell)
    draw_dots(picture, uv, [GOOD] * len(uv), 2.5)
    return caption(photo(picture), words)


def _with_grid(image: Image, cell: int) -> Image:
    """An image as BGR with a grid of squares of `cell` pixels; without a grid if `cell` is 0."""
    picture = photo(image, image.shape[1])
    if cell == 0:
        return picture
    grid = picture.copy()
    grid[cell::cell] = bgr(PALE)
    grid[:, cell::cell] = bgr(PALE)
    return np.asarray(cv2.addWeighted(picture, 0.65, grid, 0.35, 0.0), np.uint8)


def compared_picture(image: Image, own: Array, library: Array, words: str, cell: int = 0) -> Image:
    """Points (N, 2) that a student's function finds and points (M, 2) of the library, with a grid as above.

    Blue: in both; orange: only the student's; white rings: only the library's.
    """
    width = image.shape[1]
    inside = np.all((own >= 0) & (own < (width, len(image))), axis=1)
    own = own[inside]
    own_pixels = _pixel_numbers(own, width)
    library_pixels = _pixel_numbers(library, width)
    both = own[np.isin(own_pixels, library_pixels)]
    only_own = own[~np.isin(own_pixels, library_pixels)]
    only_library = library[~np.isin(library_pixels, own_pixels)]
    picture = _with_grid(image, cell)
    draw_dots(picture, both, [GOOD] * len(both), 2.5)
    draw_dots(picture, only_own, [BAD] * len(only_own), 3.5)
    for place in only_library:
        draw_ring(picture, place, 4)
    return caption(photo(picture), words)


def _pixel_numbers(uv: Array, width: int) -> NDArray[np.int64]:
    """The numbers (N,) of the pixels of points (N, 2), counted row by row."""
    pixel = np.rint(uv).astype(np.int64)
    return pixel[:, 1] * width + pixel[:, 0]


def draw_ring(picture: Image, place: Array, radius: float) -> None:
    """Draw a white ring with a dark line around a place (2,) of a BGR picture, in place."""
    centre = np.rint(16 * np.asarray(place)).astype(int).tolist()
    for shade, width in (((255, 255, 255), 3), (bgr(DARK), 1)):
        cv2.circle(picture, centre, round(16 * radius), shade, width, cv2.LINE_AA, shift=4)


def surroundings(image: Image, uv: Array, radius: int) -> tuple[Image, NDArray[np.int64]]:
    """The (2 radius + 1)² pixels around a point, and the point in whole pixels."""
    middle = np.rint(uv).astype(np.int64)
    padded = np.pad(image, radius, mode="edge")
    u, v = middle.tolist()
    side = 2 * radius + 1
    return np.asarray(padded[v : v + side, u : u + side], np.uint8), middle


def descriptor_figure(
    images: dict[str, Image], left: Array, right: Array, difference: Array, best: int
) -> Image:
    """A chart of the `difference` (N,) between a feature `left` (2,) and its candidates `right` (N, 2).

    The pictures show the feature and the candidate number `best`, which is marked in the chart; if there is no
    such candidate, one picture says so.
    """
    made, (axis,) = figure(SQUARE, width=2 * SQUARE)
    disparity = left[0] - right[:, 0]
    axis.plot(disparity, difference / 1000, "o", color=GOOD, markersize=4)
    pictures = [caption(descriptor_picture(images[SIDES[0]], left), SIDES[0])]
    if 0 <= best < len(right):
        axis.plot(disparity[best], difference[best] / 1000, "o", color=BAD, markersize=7)
        pictures.append(caption(descriptor_picture(images[SIDES[1]], right[best]), SIDES[1]))
    else:
        pictures.append(caption(np.full((SQUARE, SQUARE, 3), 255, np.uint8), "no match"))
    axis.set_ylim(bottom=0)
    title = "candidates of the feature; orange: the match"
    finish(axis, title, "disparity [px]", "difference [1000 grey levels]")
    return np.hstack([*pictures, raster(made)])


def descriptor_picture(image: Image, uv: Array, radius: int = 10, size: int = SQUARE) -> Image:
    """The enlarged surroundings of a feature; arrows are the gradients in its descriptor."""
    crop, _ = surroundings(image, uv, radius)
    scale = size / (2 * radius + 1)
    picture = photo(np.asarray(cv2.resize(crop, (size, size), interpolation=cv2.INTER_NEAREST)), size)
    gradients = np.stack([cv2.Sobel(crop, cv2.CV_64F, 1, 0), cv2.Sobel(crop, cv2.CV_64F, 0, 1)], axis=-1)
    at = DESCRIPTOR_OFFSETS + radius
    arrows = np.asarray(gradients[at[:, 1], at[:, 0]], np.float64)
    starts = np.asarray((at + 0.5) * scale, np.float64)
    ends = np.asarray(starts + 1.6 * scale * arrows / max(float(np.abs(arrows).max()), 1.0), np.float64)
    draw_flow(picture, starts, ends, [BAD] * len(starts), 2)
    return picture


def four_images(sequence: Sequence, frame: int) -> dict[str, Image]:
    """The images of a frame and of the previous frame, by the names in SIDES."""
    prev_left, prev_right = stereo(sequence, frame - 1)
    cur_left, cur_right = stereo(sequence, frame)
    return dict(zip(SIDES, (prev_left, prev_right, cur_right, cur_left), strict=True))


def loop_picture(
    images: dict[str, Image],
    matches: StereoMatches,
    back: Array,
    number: int,
    measure: ErrorMeasure | None = None,
) -> Image:
    """The surroundings of one match in the four images, in the order of the loop, and the end of the loop.

    With a `measure`: rings at the true places or, where they are not known, the epipolar line.

    back : (N, 2) places in the previous left image where the loops end, the start again if a loop is closed.
    number : index of the match that is shown.
    """
    radius = 45
    scale = SQUARE / (2 * radius + 1)
    one = matches[np.array([number])]
    true = {} if measure is None else measure.true_places(one)
    parts = []
    places = (one.prev_left, one.prev_right, one.cur_right, one.cur_left)
    for side, place in zip(SIDES, places, strict=True):
        crop, middle = surroundings(images[side], place[0], radius)
        part = photo(crop, SQUARE)
        corner = np.asarray(middle - radius - 0.5, np.float64)  # of the crop, in pixels of the image
        if measure is not None and measure.known is None and side == "current left":
            _draw_line(part, measure.lines(one)[0], corner, scale)
        if side in true:
            draw_ring(part, (true[side][0] - corner) * scale - 0.5, 7)
        draw_dots(part, (place - corner) * scale - 0.5, [GOOD], 4)
        if side == SIDES[0]:
            draw_dots(part, (back[number][None] - corner) * scale - 0.5, [BAD], 3)
        parts.append(caption(part, side))
    return np.concatenate(parts, axis=1)


def _draw_line(part: Image, line: Array, corner: Array, scale: float) -> None:
    """Draw a line a u + b v + c = 0 of the image into an enlarged part of it with this corner, in place."""
    normal = line[:2]
    middle = corner + len(part) / scale / 2
    foot = middle - (normal @ middle + line[2]) * normal
    along = len(part) / scale * np.array([-normal[1], normal[0]])
    ends = [(each - corner) * scale - 0.5 for each in (foot - along, foot + along)]
    start, end = np.clip(np.rint(16 * np.array(ends)), -(2**24), 2**24).astype(int).tolist()
    cv2.line(part, start, end, bgr(BAD), 2, cv2.LINE_AA, shift=4)


def steps_picture(pair: tuple[Image, Image], at: Array, guesses: Array, half: int = 5) -> Image:
    """The window around a feature, the windows around the guesses (N, 2), and their differences from the first.

    Grey is no difference, white and black are 60 grey levels.
    """
    shown = guesses[:7]
    size = WIDTH // (len(shown) + 1) - 4
    window = _window(pair[0], at, half)
    above = [caption(_enlarged(window, size), "the window")]
    below = [np.full((size, size + 4, 3), 255, np.uint8)]
    for number, guess in enumerate(shown):
        there = _window(pair[1], guess, half)
        rest = window.astype(float) - there
        tones = np.asarray(np.clip(128 + 127 / 60 * rest, 0, 255), np.uint8)
        above.append(caption(_enlarged(there, size), f"step {number}" if number else "the start"))
        below.append(caption(_enlarged(tones, size), f"mean {np.abs(rest).mean():.1f}"))
    gap = np.full((4, len(above) * (size + 4), 3), 255, np.uint8)
    return np.concatenate([np.concatenate(above, axis=1), gap, np.concatenate(below, axis=1)])


def fading(pair: tuple[Image, Image], at: Array, guesses: Array, half: int = 5) -> float:
    """How much smaller the mean difference of the windows is at the last of the guesses (N, 2) than at the first."""
    window = _window(pair[0], at, half).astype(float)
    start = np.abs(window - _window(pair[1], guesses[0], half)).mean()
    end = np.abs(window - _window(pair[1], guesses[-1], half)).mean()
    return float(start / max(end, 1e-9))


def _window(image: Image, place: Array, half: int) -> Image:
    """The (2 half + 1)² grey levels around a place (2,) between the pixels."""
    side = (2 * half + 1, 2 * half + 1)
    return np.asarray(cv2.getRectSubPix(image, side, (float(place[0]), float(place[1]))), np.uint8)


def _enlarged(pixels: Image, size: int) -> Image:
    """A small grey picture, enlarged to `size` pixels, with a white edge on the right."""
    large = cv2.resize(pixels, (size, size), interpolation=cv2.INTER_NEAREST)
    return np.pad(photo(np.asarray(large, np.uint8), size), ((0, 0), (0, 4), (0, 0)), constant_values=255)


def fates_picture(image: Image, trace: Trace, wrong: NDArray[np.bool_], words: str) -> Image:
    """The current image with all matches, coloured by fate; kept matches that are `wrong` (M,) have rings."""
    picture = photo(image, image.shape[1])
    matches = trace.matches
    names = trace.fate[trace.index]
    order = np.concatenate([np.flatnonzero(names == name) for name in list(FATES)[::-1]])
    colours = [FATES[name] for name in names[order].tolist()]
    draw_flow(picture, matches.prev_left[order], matches.cur_left[order], colours, 2.5)
    for place in matches.cur_left[wrong & (names == CHOSEN)]:
        draw_ring(picture, place, 6)
    return caption(photo(picture, WIDTH, PHOTO_HEIGHT), words)


def by_fate(trace: Trace, error: Array, lost: Array | None = None) -> dict[str, Array]:
    """The errors of the kept and of the dropped matches, from the errors (M,) of all matches.

    A match of a full bucket counts as neither.

    lost : errors of `trace.lost`, which count as dropped.
    """
    fate = trace.fate[trace.index]
    dropped = error[~np.isin(fate, (CHOSEN, SURPLUS))]
    if lost is not None:
        dropped = np.concatenate([dropped, lost])
    return {"kept": error[fate == CHOSEN], "dropped": dropped}


def step_figure(
    trace: Trace,
    error: Array,
    height: int = 290,
    lost: Array | None = None,
    measured: str = "error [px]",
) -> Figure:
    """Number of features by fate and the errors (M,) of all matches, pixels (NaN if unknown), if any is known.

    The dark parts of the bars count wrong matches. `lost` : errors of `trace.lost`; without `lost`, the bar of these
    matches has no dark part. `measured` : name of the errors.
    """
    with_truth = bool(np.isfinite(error).any())
    made, axes = figure(height, 2 if with_truth else 1)
    axis = axes[0]
    names = trace.fates
    counts = np.array([np.count_nonzero(trace.fate == name) for name in names])
    bars = axis.barh(names, counts, 0.7, color=[FATES[name] for name in names])
    words = [str(count) for count in counts]
    x = "features"
    if with_truth:
        errors_chart(axes[1], by_fate(trace, error, lost), measured=measured)
        wrong = {name: np.count_nonzero(error[trace.fate[trace.index] == name] > RIGHT) for name in names}
        if lost is not None:
            wrong[LOST] = np.count_nonzero(lost > RIGHT)
        axis.barh(names, [wrong[name] for name in names], 0.7, color=DARK, alpha=0.6)
        # An open loop is no match, and a feature that was not found again has none in fractions of a pixel.
        without_error = {OPEN} if lost is not None else {OPEN, LOST}
        for number, name in enumerate(names):
            if name not in without_error:
                words[number] = f"{counts[number]} ({wrong[name]})"
        x = "features (in brackets and dark: wrong by more than 1 px)"
    axis.bar_label(bars, words, padding=4, fontsize=SMALL_SIZE)
    box = axis.get_position()
    axis.set_position((box.x0 + NAMES, box.y0, box.width - NAMES, box.height))
    axis.tick_params(axis="y", length=0)
    axis.set(xlim=(0, room(1.3 * max(int(np.max(counts)), 1))), ylim=(len(names) - 0.4, -0.6))
    finish(axis, "number of features by step", x)
    return made


def errors_chart(
    axis: Axes,
    errors: dict[str, Array],
    title: str = "errors of the matches",
    measured: str = "error [px]",
) -> None:
    """Cumulative distributions of errors, pixels, by name; an error is NaN if the truth is unknown."""
    for (name, values), colour in zip(errors.items(), CYCLE, strict=False):
        finite = np.sort(values[np.isfinite(values)])
        share = 100 * np.arange(1, len(finite) + 1) / max(len(finite), 1)
        words = f"{name}: median {np.median(finite):.2f} px" if len(finite) else name
        axis.plot(np.clip(finite, LEAST, MOST), share, color=colour, label=words)
    axis.axvline(RIGHT, color=DARK, linewidth=1, linestyle=":")
    log_axis(axis.xaxis, LEAST, MOST)
    # The legend has a band of its own above all curves.
    height = axis.bbox.height
    band = min(LEGEND_EDGE + LEGEND_LINE * len(errors), 0.6 * height)
    axis.set_ylim(0, 102 * height / (height - band))
    numbers_at(axis.yaxis, (0, 25, 50, 75, 100))
    finish(axis, title, measured, "share of matches [%]", "upper left")
