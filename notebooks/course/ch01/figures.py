"""Chapter 1, drawn: detector responses, the loop of four images by hand, matches by what became of them."""

from __future__ import annotations

from itertools import pairwise

import cv2
import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from vo_lib.data.sequence import Sequence
from vo_lib.geometry.matches import StereoMatches
from vo_lib.geometry.types import Array, Image

from ..ch02.figures import draw_dot, draw_flow
from ..colours import BAD, CYCLE, DARK, FIFTH, FOURTH, GOOD, PALE, THIRD, bgr
from ..drawing import COARSE, FONT_SIZE, WIDTH, caption, finish, log_axis, photo, room
from ..frames import stereo
from .trace import KEPT, REASONS, Trace

HALF = WIDTH // 2
AGES = {1: PALE, 2: "#56B4E9", 4: GOOD, 8: FIFTH, 16: BAD}  # from so many frames on
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


def grey_picture(response: NDArray[np.float32], middle: float = 0.0) -> Image:
    """A detector's response as brightness; `middle` is the grey of none."""
    scale = (255.0 - middle) / float(np.percentile(np.abs(response), 99.5) + 1e-9)
    return photo(np.clip(middle + scale * response, 0, 255).astype(np.uint8), HALF)


def points_picture(
    image: Image, uv: Array, cell: int, words: str, age: NDArray[np.int64] | None = None
) -> Image:
    """Points (N, 2) on an image with a grid of squares of `cell` pixels, coloured by their `age` (N,) in frames."""
    picture = photo(image, image.shape[1])
    grid = picture.copy()
    grid[cell::cell] = grid[:, cell::cell] = bgr(PALE)
    picture = np.asarray(cv2.addWeighted(picture, 0.65, grid, 0.35, 0.0), np.uint8)
    ages, colours = (np.ones(len(uv)), {1: GOOD}) if age is None else (age, AGES)
    for least, colour in colours.items():
        for place in uv[ages >= least]:
            draw_dot(picture, place, colour, 2.5)
    shown = caption(photo(picture), words)
    if age is not None:
        shown[-32:, : 60 * len(AGES) + 6] //= 4  # a dark strip for the legend
        for number, (least, colour) in enumerate(AGES.items()):
            draw_dot(shown, np.array([14.0 + 60 * number, len(shown) - 12.0]), colour, 5, f"{least}+")
    return shown


def surroundings(image: Image, uv: Array, radius: int) -> tuple[Image, NDArray[np.int64]]:
    """The pixels around a place, (2 radius + 1)², and the place itself in whole pixels."""
    middle = np.rint(uv).astype(np.int64)
    padded = np.pad(image, radius, mode="edge")
    rows, columns = (slice(at, at + 2 * radius + 1) for at in middle[::-1].tolist())
    return np.asarray(padded[rows, columns], np.uint8), middle


def descriptor_picture(image: Image, uv: Array, offsets: Array, radius: int = 10, size: int = 300) -> Image:
    """The surroundings of a feature, enlarged; arrows are the gradients at the places that describe it."""
    crop, _ = surroundings(image, uv, radius)
    scale = size / (2 * radius + 1)
    picture = photo(np.asarray(cv2.resize(crop, (size, size), interpolation=cv2.INTER_NEAREST)), size)
    gradients = np.stack([cv2.Sobel(crop, cv2.CV_64F, 1, 0), cv2.Sobel(crop, cv2.CV_64F, 0, 1)], axis=-1)
    at = np.asarray(offsets, np.int64) + radius
    arrows = np.asarray(gradients[at[:, 1], at[:, 0]], np.float64)
    starts = np.asarray((at + 0.5) * scale, np.float64)
    ends = np.asarray(starts + 1.6 * scale * arrows / max(float(np.abs(arrows).max()), 1.0), np.float64)
    draw_flow(picture, starts, ends, [BAD] * len(starts), 2)
    return picture


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


def loop_picture(
    images: dict[str, Image], matches: StereoMatches, back: Array, number: int, radius: int = 45
) -> Image:
    """The surroundings of one match in the four images, in the order of the loop, and where the loop ends."""
    scale, parts = HALF // 2 / (2 * radius + 1), []
    places = (matches.prev_left, matches.prev_right, matches.cur_right, matches.cur_left)
    for side, uv in zip(SIDES, places, strict=True):
        crop, middle = surroundings(images[side], uv[number], radius)
        part = photo(crop, HALF // 2)
        for place, colour, size in ((uv[number], GOOD, 4), (back[number], BAD, 3)):
            if colour == GOOD or side == SIDES[0]:
                draw_dot(part, np.asarray((place - middle + radius + 0.5) * scale - 0.5), colour, size)
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
    counts = np.array([np.count_nonzero(fate == name) for name in FATES])
    bars = axis.barh(list(FATES), counts, 0.7, color=list(FATES.values()))
    words, x = [str(count) for count in counts], "features"
    if wrong is not None:
        bad = [np.count_nonzero(wrong[fate == name]) for name in FATES]
        axis.barh(list(FATES), bad, 0.7, color=DARK, alpha=0.6)
        words = [f"{word} ({some})" for word, some in zip(words, bad, strict=True)]
        words[0] = str(counts[0])  # of features that were not found again nothing is right or wrong
        x = "features (wrong ones in brackets, and dark)"
    axis.bar_label(bars, words, padding=4, fontsize=FONT_SIZE - 1)
    box = axis.get_position()
    axis.set_position((box.x0 + NAMES, box.y0, box.width - NAMES, box.height))
    axis.tick_params(axis="y", length=0)
    axis.set(xlim=(0, room(1.3 * max(int(counts.max()), 1))), ylim=(len(FATES) - 0.4, -0.6))
    finish(axis, "what became of the features", x)


def by_fate(fate: NDArray[np.str_], error: Array) -> dict[str, Array]:
    """Errors (M,) of the features found again, kept and dropped ones apart."""
    dropped = (fate != CHOSEN) & (fate != SURPLUS)
    return {"kept": error[fate == CHOSEN], "dropped by a check": error[dropped]}


def errors_chart(axis: Axes, errors: dict[str, Array], title: str = "how far from the truth") -> None:
    """By name, the share of the matches with an error up to so many pixels; NaN where the truth is not known."""
    for (name, values), colour in zip(errors.items(), CYCLE, strict=False):
        known = np.sort(values[np.isfinite(values)])
        share = 100 * np.arange(1, len(known) + 1) / max(len(known), 1)
        words = f"{name}: median {np.median(known):.2f} px" if len(known) else name
        axis.plot(np.clip(known, LEAST, MOST), share, color=colour, label=words)
    axis.axvline(1.0, color=DARK, linewidth=1, linestyle=":")
    log_axis(axis.xaxis, LEAST, MOST)
    axis.set_ylim(0, 102)
    finish(axis, title, "error [px]", "matches up to there [%]", "lower right")


def depths_chart(axis: Axes, depth: Array) -> None:
    """How far away the kept features are; for sequences without truth."""
    edges = np.geomspace(2.0, 200.0, 25)
    counts = np.histogram(np.clip(depth[np.isfinite(depth)], edges[0], edges[-1]), edges)[0]
    axis.stairs(counts, edges, fill=True, color=GOOD)
    log_axis(axis.xaxis, 2.0, 200.0, COARSE)
    axis.set_ylim(0, room(1.05 * float(counts.max()), least=1))
    finish(axis, "how far away the kept ones are", "depth [m]", "features")
