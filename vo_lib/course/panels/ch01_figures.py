"""Chapter 1, drawn: detector responses, the loop of four images, matches by what became of them."""

from __future__ import annotations

import cv2
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.transforms import Bbox
from numpy.typing import NDArray

from ...core.types import Array, Image
from .ch01_trace import KEPT, LOST, REASONS, Trace
from .ch02_figures import draw_dot, draw_flow
from .chart import FINE, Chart, room
from .style import (
    BAD,
    CYCLE,
    DARK,
    FIFTH,
    FONT_SIZE,
    FOURTH,
    GOOD,
    PALE,
    THIRD,
    WIDTH,
    bgr,
    caption,
    figure,
    finish,
    photo,
)

HALF = WIDTH // 2
SURPLUS = "bucket is full"
CHOSEN = "kept"
# What becomes of a feature, in the order of the checks, with its colour.
FATES = {
    **dict(zip(REASONS, (PALE, FOURTH, THIRD, FIFTH, BAD), strict=True)),
    SURPLUS: "#56B4E9",
    CHOSEN: GOOD,
}
SIDES = ("previous left", "previous right", "current right", "current left")
LEAST, MOST = 0.01, 100.0  # pixels shown of an error
NAMES = 0.23  # of a chart's width, for the names of the fates


def response_picture(response: NDArray[np.float32], width: int = HALF) -> Image:
    """A detector's response in grey: middle grey is none, white and black are strong."""
    scale = 127.0 / float(np.percentile(np.abs(response), 99.5) + 1e-9)
    return photo(np.clip(128 + scale * response, 0, 255).astype(np.uint8), width)


def strength_picture(strength: NDArray[np.float32], width: int = HALF) -> Image:
    """Corner strength as brightness."""
    scale = 255.0 / float(np.percentile(strength, 99.5) + 1e-9)
    return photo(np.clip(scale * strength, 0, 255).astype(np.uint8), width)


def points_picture(
    image: Image, uv: Array, cell: int = 0, colour: str = GOOD, width: int = WIDTH, words: str = ""
) -> Image:
    """Points on an image, with a grid of squares of `cell` pixels where it is not 0."""
    picture = photo(image, image.shape[1])
    if cell:
        grid = picture.copy()
        grid[cell::cell] = grid[:, cell::cell] = bgr(PALE)
        picture = np.asarray(cv2.addWeighted(picture, 0.65, grid, 0.35, 0.0), np.uint8)
    for place in uv:
        draw_dot(picture, place, colour, 2.5)
    shown = photo(picture, width)
    return caption(shown, words) if words else shown


def pair_of_pictures(left: Image, right: Image) -> Image:
    """Two pictures of half the width beside each other."""
    return np.concatenate([photo(left, HALF, 150), photo(right, HALF, 150)], axis=1)


def loop_picture(images: dict[str, Image], places: dict[str, Array], radius: int = 45) -> Image:
    """The surroundings of one feature in the four images, in the order of the loop, enlarged.

    Parameters
    ----------
    images : by the names in SIDES. places : (2,) pixel by name; "back" is where the loop ends.
    """
    scale, parts = HALF // 2 / (2 * radius + 1), []
    for side in SIDES:
        middle = np.rint(places[side]).astype(int)
        padded = np.pad(images[side], radius, mode="edge")
        crop = padded[middle[1] : middle[1] + 2 * radius + 1, middle[0] : middle[0] + 2 * radius + 1]
        part = photo(np.asarray(crop, np.uint8), HALF // 2)

        def at(uv: Array, middle: NDArray[np.int64] = middle) -> Array:
            return np.asarray((uv - middle + radius + 0.5) * scale - 0.5)

        draw_dot(part, at(places[side]), GOOD, 4)
        if side == SIDES[0]:
            draw_dot(part, at(places["back"]), BAD, 3)
        parts.append(caption(part, side))
    return np.concatenate(parts, axis=1)


def fates(trace: Trace, chosen: NDArray[np.int64]) -> NDArray[np.str_]:
    """In one word what became of each feature (N,); `chosen` are the numbers of those the buckets keep."""
    names = np.array([*REASONS, SURPLUS])[trace.reason]
    names[(trace.reason == KEPT) & np.isin(trace.id, chosen)] = CHOSEN
    return np.asarray(names)


def fates_picture(
    image: Image, trace: Trace, fate: NDArray[np.str_], wrong: NDArray[np.bool_], words: str
) -> Image:
    """The current image with every feature that was found again, coloured by its fate.

    Parameters
    ----------
    fate : (N,) of all features; wrong : (M,) of those found again: kept ones among them get a ring.
    """
    picture = photo(image, image.shape[1])
    found, names = trace.found, fate[trace.index]
    order = np.concatenate([np.flatnonzero(names == name) for name in list(FATES)[::-1]])
    colours = [FATES[name] for name in names[order].tolist()]
    draw_flow(picture, found.prev_left[order], found.cur_left[order], colours, 2.5)
    for place in np.rint(16 * found.cur_left[wrong & (names == CHOSEN)]).astype(int).tolist():
        for shade, width in (((255, 255, 255), 3), (bgr(DARK), 1)):
            cv2.circle(picture, place, 6 * 16, shade, width, cv2.LINE_AA, shift=4)
    return caption(photo(picture, WIDTH, 298), words)


def fates_chart(fate: NDArray[np.str_], wrong: NDArray[np.bool_] | None) -> Chart:
    """How many features met which fate; the dark part is truly wrong, where that is known, (N,) bool."""
    names = list(FATES)
    counts = np.array([np.count_nonzero(fate == name) for name in names])
    bad = None if wrong is None else np.array([np.count_nonzero(wrong[fate == name]) for name in names])
    end = room(1.3 * max(int(counts.max()), 1), steps=FINE)

    def put(axis: Axes) -> None:
        axis.add_collection(PolyCollection(_bars(counts), facecolors=list(FATES.values())))
        if bad is not None:
            axis.add_collection(PolyCollection(_bars(bad), facecolors=DARK, alpha=0.6))
        for row, (name, count) in enumerate(zip(names, counts, strict=True)):
            words = f"{count}" + (f" ({bad[row]})" if bad is not None and name != LOST else "")
            axis.text(count + 0.01 * end, row, words, va="center", fontsize=FONT_SIZE - 1)

    def frame(axis: Axes) -> None:
        axis.set_position(Bbox([[NAMES, axis.get_position().y0], axis.get_position().max]))
        axis.set_yticks(range(len(names)), names)
        axis.tick_params(axis="y", length=0)
        axis.set_ylim(len(names) - 0.4, -0.6)
        axis.set_xlim(0, end)
        x = "features" if bad is None else "features (wrong ones in brackets, and dark)"
        finish(axis, "what became of the features", x)

    return Chart(("fates", end, bad is None), put, frame)


def _bars(counts: NDArray[np.int64]) -> list[Array]:
    """Corners of a bar in each row, (4, 2)."""
    across, along = np.array([0, 1, 1, 0]), np.array([-0.35, -0.35, 0.35, 0.35])
    return [np.stack([count * across, row + along], axis=1) for row, count in enumerate(counts.tolist())]


def errors_chart(fate: NDArray[np.str_], error: Array) -> Chart:
    """Share of the matches with an error up to so many pixels, for kept and dropped ones.

    Parameters
    ----------
    fate : (M,) and error : (M,), pixels, of the features found again; NaN where the truth is not known.
    """
    known = np.isfinite(error)
    groups = {
        "kept": ((fate == CHOSEN) & known, GOOD),
        "dropped by a check": ((fate != CHOSEN) & (fate != SURPLUS) & known, BAD),
    }

    def put(axis: Axes) -> None:
        for words, (chosen, colour) in groups.items():
            values = np.sort(np.clip(error[chosen], LEAST, MOST))
            share = 100 * np.arange(1, len(values) + 1) / max(len(values), 1)
            axis.plot(values, share, color=colour, label=words)
        axis.axvline(1.0, color=DARK, linewidth=1, linestyle=":")

    def frame(axis: Axes) -> None:
        _error_axis(axis)
        x = "largest error in three images [px]"
        finish(axis, "how far from the truth", x, "matches up to there [%]", "upper left")

    return Chart(("errors",), put, frame)


def depths_chart(depth: Array) -> Chart:
    """How far away the kept features are; for sequences without truth."""
    edges = np.geomspace(2.0, 200.0, 25)
    counts = np.histogram(np.clip(depth[np.isfinite(depth)], edges[0], edges[-1]), edges)[0]
    top = room(1.05 * float(counts.max()), steps=FINE, least=1)

    def put(axis: Axes) -> None:
        axis.stairs(counts, edges, fill=True, color=GOOD)

    def frame(axis: Axes) -> None:
        axis.set_xscale("log")
        axis.set_xlim(edges[0], edges[-1])
        axis.set_xticks([2, 5, 10, 20, 50, 100, 200], ["2", "5", "10", "20", "50", "100", "200"])
        axis.minorticks_off()
        axis.set_ylim(0, top)
        finish(axis, "how far away the kept ones are", "depth [m]", "features")

    return Chart(("depths", top), put, frame)


def _error_axis(axis: Axes) -> None:
    axis.set_xscale("log")
    axis.set_xlim(LEAST, MOST)
    axis.set_xticks([0.01, 0.1, 1, 10, 100], ["0.01", "0.1", "1", "10", "100"])
    axis.minorticks_off()
    axis.set_ylim(0, 102)


def errors_figure(errors: dict[str, Array], height: int = 230) -> Figure:
    """Share of the matches with an error up to so many pixels, by name."""
    made, (axis,) = figure(height)
    for (name, values), colour in zip(errors.items(), CYCLE, strict=False):
        known = np.sort(values[np.isfinite(values)])
        share = 100 * np.arange(1, len(known) + 1) / len(known)
        label = f"{name}: median {np.median(known):.2f} px"
        axis.plot(np.clip(known, LEAST, MOST), share, color=colour, linewidth=1.5, label=label)
    _error_axis(axis)
    axis.set_xlim(LEAST, 10)
    axis.set_xticks([0.01, 0.1, 1, 10], ["0.01", "0.1", "1", "10"])
    finish(axis, "error of the place in the current left image", "error [px]", "matches up to there [%]")
    return made
