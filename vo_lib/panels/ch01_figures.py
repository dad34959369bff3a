"""Chapter 1, drawn: detector responses, the loop of four images, matches by what became of them."""

from __future__ import annotations

import cv2
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from ..geometry import Array
from ..kitti import Image
from .ch01_trace import KEPT, LOST, REASONS, Trace
from .ch02_figures import draw_dot
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
    for name in list(FATES)[::-1]:
        for i in np.flatnonzero(names == name).tolist():
            start, end = (
                np.rint(uv[i] * 16).astype(int).tolist() for uv in (found.prev_left, found.cur_left)
            )
            cv2.line(picture, start, end, bgr(FATES[name]), 1, cv2.LINE_AA, shift=4)
            draw_dot(picture, found.cur_left[i], FATES[name], 2.5)
            if name == CHOSEN and wrong[i]:
                cv2.circle(picture, end, 6 * 16, (255, 255, 255), 3, cv2.LINE_AA, shift=4)
                cv2.circle(picture, end, 6 * 16, bgr(DARK), 1, cv2.LINE_AA, shift=4)
    return caption(photo(picture, WIDTH, 298), words)


def draw_fates(axis: Axes, fate: NDArray[np.str_], wrong: NDArray[np.bool_] | None) -> None:
    """How many features met which fate; the hatched part is truly wrong, where that is known, (N,) bool."""
    names = list(FATES)
    counts = np.array([np.count_nonzero(fate == name) for name in names])
    axis.barh(range(len(names)), counts, color=[FATES[name] for name in names], height=0.7)
    bad = np.zeros(len(names), int)
    if wrong is not None:
        bad = np.array([np.count_nonzero(wrong[fate == name]) for name in names])
        axis.barh(range(len(names)), bad, color="none", edgecolor=DARK, hatch="////", height=0.7)
    top = max(int(counts.max()), 1)
    for row, (name, count) in enumerate(zip(names, counts, strict=True)):
        words = f"{name}: {count}" + (f", {bad[row]} wrong" if wrong is not None and name != LOST else "")
        axis.text(count + 0.01 * top, row, words, va="center", fontsize=FONT_SIZE - 1)
    axis.set_yticks([])
    axis.set_ylim(len(names) - 0.4, -0.6)
    axis.set_xlim(0, 1.5 * top)
    finish(
        axis, "what became of the features", "features" + ("; hatched: wrong" if wrong is not None else "")
    )


def draw_errors(axis: Axes, fate: NDArray[np.str_], error: Array) -> None:
    """Share of the matches with an error up to so many pixels, for kept and dropped ones.

    Parameters
    ----------
    fate : (M,) and error : (M,), pixels, of the features found again; NaN where the truth is not known.
    """
    for chosen, colour, words in (
        (fate == CHOSEN, GOOD, "kept"),
        ((fate != CHOSEN) & (fate != SURPLUS), BAD, "dropped by a check"),
    ):
        if (chosen & np.isfinite(error)).any():
            values = np.sort(np.clip(error[chosen & np.isfinite(error)], LEAST, MOST))
            axis.plot(values, 100 * np.arange(1, len(values) + 1) / len(values), color=colour, label=words)
    axis.axvline(1.0, color=DARK, linewidth=1, linestyle=":")
    _error_axis(axis)
    finish(axis, "how far from the truth", "largest error in three images [px]", "matches up to there [%]")


def draw_depths(axis: Axes, depth: Array) -> None:
    """How far away the kept features are; for sequences without truth."""
    edges = np.geomspace(2.0, 200.0, 25)
    axis.hist(np.clip(depth[np.isfinite(depth)], edges[0], edges[-1]), bins=edges.tolist(), color=GOOD)
    axis.set_xscale("log")
    axis.set_xticks([2, 5, 10, 20, 50, 100, 200], ["2", "5", "10", "20", "50", "100", "200"])
    axis.minorticks_off()
    finish(axis, "how far away the kept ones are", "depth [m]", "features")


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
