"""Chapter 1, drawn: detector responses, the loop of four images by hand, matches by what became of them."""

from __future__ import annotations

from itertools import pairwise

import cv2
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from vo_lib.core.matches import StereoMatches
from vo_lib.core.types import Array, Image
from vo_lib.data.sequence import Sequence

from ..ch02.figures import draw_dot, draw_flow
from ..drawing import (
    BAD,
    COARSE,
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
    log_axis,
    photo,
    room,
)
from ..frames import stereo
from .trace import KEPT, LOST, REASONS, Trace

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
WINDOW, LEVELS = 15, 5  # of plain Lucas-Kanade, round the loop by hand
LEAST, MOST = 0.01, 100.0  # pixels shown of an error
NAMES = 0.055  # of a figure's width, for the names of the fates


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


AGES = {1: PALE, 2: "#56B4E9", 4: GOOD, 8: FIFTH, 16: BAD}  # from so many frames on


def ages_picture(image: Image, uv: Array, age: NDArray[np.int64], cell: int, words: str) -> Image:
    """Features on their grid of buckets, coloured by the number of frames for which they were followed."""
    picture = points_picture(image, uv[:0], cell, width=image.shape[1])
    for least, colour in AGES.items():
        for place in uv[age >= least]:
            draw_dot(picture, place, colour, 3)
    shown = caption(photo(picture), words)
    shown[-32:, : 60 * len(AGES) + 6] //= 4  # a dark strip for the legend
    for number, (least, colour) in enumerate(AGES.items()):
        at = np.array([14.0 + 60 * number, len(shown) - 12.0])
        draw_dot(shown, at, colour, 5, f"{least}+")
    return shown


def descriptor_picture(image: Image, uv: Array, offsets: Array, radius: int = 10, size: int = 300) -> Image:
    """The surroundings of a feature, enlarged; arrows are the gradients at the places that describe it."""
    middle = np.rint(uv).astype(int)
    padded = np.pad(image, radius, mode="edge")
    crop = padded[middle[1] : middle[1] + 2 * radius + 1, middle[0] : middle[0] + 2 * radius + 1]
    scale = size / (2 * radius + 1)
    picture = photo(np.asarray(cv2.resize(crop, (size, size), interpolation=cv2.INTER_NEAREST)), size)
    gradients = np.stack([cv2.Sobel(crop, cv2.CV_64F, 1, 0), cv2.Sobel(crop, cv2.CV_64F, 0, 1)], axis=-1)
    at = np.asarray(offsets, np.int64) + radius
    arrows = np.asarray(gradients[at[:, 1], at[:, 0]], np.float64)
    starts = np.asarray((at + 0.5) * scale, np.float64)
    ends = np.asarray(starts + 1.6 * scale * arrows / max(float(np.abs(arrows).max()), 1.0), np.float64)
    draw_flow(picture, starts, ends, [BAD] * len(starts), 2)
    return picture


def pair_of_pictures(left: Image, right: Image) -> Image:
    """Two pictures of half the width beside each other."""
    return np.concatenate([photo(left, HALF, 150), photo(right, HALF, 150)], axis=1)


def four_images(sequence: Sequence, frame: int) -> dict[str, Image]:
    """The images of a frame and the one before, by the names in SIDES."""
    (prev_left, prev_right), (cur_left, cur_right) = stereo(sequence, frame - 1), stereo(sequence, frame)
    return dict(zip(SIDES, (prev_left, prev_right, cur_right, cur_left), strict=True))


def walk(images: dict[str, Image], uv: Array) -> tuple[StereoMatches, Array, NDArray[np.bool_]]:
    """Follow points (N, 2) of the previous left image once round the loop, back to where they started.

    Returns
    -------
    Matches of all N, the places "back" (N, 2) in the previous left image, and which were found in every
    image, (N,) bool.
    """
    places, found = [uv], np.ones(len(uv), np.bool_)
    for here, there in pairwise([*SIDES, SIDES[0]]):
        moved, status, _ = cv2.calcOpticalFlowPyrLK(
            images[here],
            images[there],
            places[-1].astype(np.float32),
            places[-1].astype(np.float32),
            winSize=(WINDOW, WINDOW),
            maxLevel=LEVELS,
        )
        places.append(np.asarray(moved, np.float64).reshape(-1, 2))
        found &= status.ravel() == 1
    prev_left, prev_right, cur_right, cur_left, back = places
    number = np.arange(len(uv))
    matches = StereoMatches(
        prev_left, prev_right, cur_left, cur_right, np.ones_like(number), np.zeros(len(uv)), number
    )
    return matches, back, found


def places_of(matches: StereoMatches, back: Array, number: int) -> dict[str, Array]:
    """The places of one feature by the names in SIDES, and "back": what `loop_picture` draws."""
    each = matches.prev_left, matches.prev_right, matches.cur_right, matches.cur_left, back
    return dict(zip((*SIDES, "back"), (uv[number] for uv in each), strict=True))


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


def fates_chart(axis: Axes, fate: NDArray[np.str_], wrong: NDArray[np.bool_] | None) -> None:
    """How many features met which fate; the dark part is truly wrong, where that is known, (N,) bool."""
    names = list(FATES)
    counts = np.array([np.count_nonzero(fate == name) for name in names])
    axis.barh(range(len(names)), counts, 0.7, color=list(FATES.values()))
    words = [str(count) for count in counts]
    if wrong is not None:
        bad = [np.count_nonzero(wrong[fate == name]) for name in names]
        axis.barh(range(len(names)), bad, 0.7, color=DARK, alpha=0.6)
        words = [
            f"{all_} ({some})" if name != LOST else all_
            for all_, some, name in zip(words, bad, names, strict=True)
        ]
    end = room(1.3 * max(int(counts.max()), 1))
    for row, (count, word) in enumerate(zip(counts, words, strict=True)):
        axis.text(count + 0.01 * end, row, word, va="center", fontsize=FONT_SIZE - 1)
    box = axis.get_position()
    axis.set_position((box.x0 + NAMES, box.y0, box.width - NAMES, box.height))
    axis.set_yticks(range(len(names)), names)
    axis.tick_params(axis="y", length=0)
    axis.set_ylim(len(names) - 0.4, -0.6)
    axis.set_xlim(0, end)
    x = "features" if wrong is None else "features (wrong ones in brackets, and dark)"
    finish(axis, "what became of the features", x)


def errors_chart(axis: Axes, fate: NDArray[np.str_], error: Array) -> None:
    """Share of the matches with an error up to so many pixels, for kept and dropped ones.

    Parameters
    ----------
    fate : (M,) and error : (M,), pixels, of the features found again; NaN where the truth is not known.
    """
    dropped = (fate != CHOSEN) & (fate != SURPLUS)
    for words, chosen, colour in (("kept", fate == CHOSEN, GOOD), ("dropped by a check", dropped, BAD)):
        _shares(axis, error[chosen], colour, words)
    axis.axvline(1.0, color=DARK, linewidth=1, linestyle=":")
    log_axis(axis.xaxis, LEAST, MOST)
    axis.set_ylim(0, 102)
    x = "largest error in three images [px]"
    finish(axis, "how far from the truth", x, "matches up to there [%]", "upper left")


def depths_chart(axis: Axes, depth: Array) -> None:
    """How far away the kept features are; for sequences without truth."""
    edges = np.geomspace(2.0, 200.0, 25)
    counts = np.histogram(np.clip(depth[np.isfinite(depth)], edges[0], edges[-1]), edges)[0]
    axis.stairs(counts, edges, fill=True, color=GOOD)
    log_axis(axis.xaxis, 2.0, 200.0, COARSE)
    axis.set_ylim(0, room(1.05 * float(counts.max()), least=1))
    finish(axis, "how far away the kept ones are", "depth [m]", "features")


def errors_figure(errors: dict[str, Array], height: int = 230) -> Figure:
    """Share of the matches with an error up to so many pixels, by name."""
    made, (axis,) = figure(height)
    for (name, values), colour in zip(errors.items(), CYCLE, strict=False):
        _shares(axis, values, colour, f"{name}: median {np.nanmedian(values):.2f} px")
    log_axis(axis.xaxis, LEAST, 10.0)
    axis.set_ylim(0, 102)
    finish(axis, "error of the place in the current left image", "error [px]", "matches up to there [%]")
    return made


def _shares(axis: Axes, error: Array, colour: str, words: str) -> None:
    """The share of known errors up to each value, per cent."""
    known = np.sort(error[np.isfinite(error)])
    share = 100 * np.arange(1, len(known) + 1) / max(len(known), 1)
    axis.plot(np.clip(known, LEAST, MOST), share, color=colour, label=words)
