"""Chapter 3, drawn: candidates by angle to the prior, image error and true error; errors over frames."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from vo_lib.geometry.types import Array, BoolArray, Image

from ..ch02.figures import draw_flow
from ..colours import BAD, DARK, FIFTH, GOOD, PALE, bgr
from ..drawing import WIDTH, caption, figure, finish, log_axis, photo, say

PHOTO_HEIGHT = 298
LEAST, MOST = 1e-3, 180.0  # degrees shown of a rotation error
SMALLEST = 1e-5  # of a unit; smaller errors over frames are drawn there
ALIKE = 0.02  # curves that nowhere differ by a larger share cannot be told apart


@dataclass(frozen=True)
class Field:
    """All candidates of a frame with their image errors and angles to the prior.

    Attributes
    ----------
    angle : (M,) to the previous essential vector, degrees; NaN without one.
    image_error : (M,) truncated mean squared Sampson distance over all matches, in [0, 1].
    rotation_error : (M,) against the reference rotation, degrees.
    kept : (M,) whether solution selection lets them compete.
    consensus, selected : indices of the two winners; `dropped`: the prior was dropped.
    """

    angle: Array
    image_error: Array
    rotation_error: Array
    kept: BoolArray
    consensus: int
    selected: int
    dropped: bool


def features_picture(
    image: Image,
    start: Array,
    end: Array,
    weight: Array | BoolArray,
    words: str,
    ringed: BoolArray | None = None,
) -> Image:
    """An image with a line from each start (N, 2) to a dot at its end (N, 2): blue counts, orange hardly, grey not.

    weight : (N,) in [0, 1], or a mask of inliers; NaN where a match is not used. ringed : (N,), those in rings.
    """
    picture = photo(image, image.shape[1])
    for place in () if ringed is None else np.rint(16 * end[ringed]).astype(int).tolist():
        cv2.circle(picture, place, 5 * 16, bgr(FIFTH), 1, cv2.LINE_AA, shift=4)
    order = np.argsort(np.nan_to_num(-1.0 * weight, nan=-2.0))  # outliers on top
    colours = np.where(np.isnan(weight), PALE, np.where(weight >= 0.5, GOOD, BAD))[order]
    draw_flow(picture, start[order], end[order], colours.tolist(), 2.5)
    return caption(photo(picture, WIDTH, PHOTO_HEIGHT), words)


def field_figure(field: Field, result: float | None = None, height: int = 260) -> Figure:
    """Image error of each candidate over its angle to the previous vector, and over its rotation error.

    `result`, degrees, is marked on the right: the error of the rotation that the frame gets in the end.
    """
    made, (by_angle, by_error) = figure(height, 2)
    error, known = np.clip(field.rotation_error, LEAST, MOST), bool(np.isfinite(field.rotation_error).any())
    named = by_error if known else by_angle  # one legend is enough
    if result is not None and known:
        by_error.axvline(max(result, LEAST), color=BAD, linewidth=0.8)
    for axis, x in ((by_angle, field.angle), (by_error, error)):
        for chosen, colour, words in (
            (~field.kept, PALE, "left out"),
            (field.kept, GOOD, "every solution" if field.kept.all() else "nearest k of a set"),
        ):
            label = words if axis is named else ""
            axis.plot(x[chosen], field.image_error[chosen], ".", color=colour, markersize=4.5, label=label)
        for at, colour, size, words in (
            (field.consensus, DARK, 9, "winner, consensus"),
            (field.selected, BAD, 5.5, "winner, selection"),
        ):
            label = words if axis is named else ""
            (dot,) = axis.plot(x[at], field.image_error[at], "o", color=colour, markersize=size, label=label)
            dot.set_clip_on(False)  # a winner at the edge is shown whole
        axis.set_ylim(-0.02, 1.02)
    by_angle.set_xlim(0, 90)
    log_axis(by_error.xaxis, LEAST, MOST)
    x_name = "angle to the previous essential vector [deg]"
    finish(by_angle, "the solutions of all sets", x_name, "image error", "lower right", boxed=True)
    if not known:
        by_error.clear()
        say(by_error, "no ground truth: the rotation error of a solution is unknown")
        return made
    # Where the rotation is right the image error is small: nothing stands there.
    x_name = "rotation error [deg]"
    finish(by_error, "image error and rotation error", x_name, "image error", "upper left", boxed=True)
    return made


def errors_figure(
    errors: Mapping[str, Array],
    x: Array | range | None = None,
    title: str = "rotation error",
    x_name: str = "frame",
    unit: str = "deg",
    height: int = 230,
) -> Figure:
    """Errors (N,) by name with their medians, over the frames 1, 2, …, a range of frames, or x (N,).

    Errors (S, N) of several seeds are drawn as their median, with a band from the smallest to the largest.
    Identical curves are drawn as one line with all their names.
    """
    curves: list[tuple[list[str], Array, Array]] = []
    for name, values in errors.items():
        middle = np.median(np.atleast_2d(values), axis=0)
        same = [names for names, _, drawn in curves if np.allclose(middle, drawn, rtol=ALIKE)]
        same[0].append(name) if same else curves.append(([name], values, middle))
    made, (axis,) = figure(height)
    for (names, values, middle), colour, style in zip(
        curves, (DARK, GOOD, BAD, PALE), ("-o", "--s", "-^", "-v"), strict=False
    ):
        over_frames = x is None or isinstance(x, range)
        words = f": median {np.median(values):.3f}" if over_frames else ""
        shown = np.maximum(np.atleast_2d(values), SMALLEST)
        at = np.arange(1, shown.shape[1] + 1) if x is None else np.asarray(x)
        if len(shown) > 1:
            axis.fill_between(at, shown.min(axis=0), shown.max(axis=0), color=colour, alpha=0.2, linewidth=0)
        look: dict[str, Any] = {
            "color": colour,
            "markersize": 5,
            "linewidth": 1.5,
            "label": " / ".join(names) + words,
        }
        axis.plot(at, np.maximum(middle, SMALLEST), style[:-1] if over_frames else style, **look)
    axis.set_yscale("log")
    low, high = axis.get_ylim()
    log_axis(axis.yaxis, min(low, 0.01), max(high, 0.1))
    axis.xaxis.set_major_locator(MaxNLocator(integer=True))
    finish(axis, title, x_name, f"error [{unit}]", "above")
    return made


def turns_figure(angle: Array, turn: Array, length: Array, height: int = 220) -> Figure:
    """How the motion changes along a path, and the length of its steps.

    Parameters
    ----------
    angle : (N - 2,) from each essential vector to the next, degrees; NaN where one step has none.
    turn, length : (N - 1,) of each step, degrees and metres.
    """
    made, (left, right) = figure(height, 2)
    left.plot(1 + np.arange(len(turn)), turn, color=PALE, linewidth=1, label="rotation of a step")
    left.plot(2 + np.arange(len(angle)), angle, color=GOOD, label="change of e")
    right.plot(1 + np.arange(len(length)), length, color=DARK)
    for axis in (left, right):
        whole = axis.get_xaxis_transform()  # from the bottom of the axis to its top
        frames = 2 + np.arange(len(angle))
        axis.fill_between(frames, 0, 1, where=np.isnan(angle), color=PALE, alpha=0.5, transform=whole)
    finish(left, "angles", "frame", "angle [deg]", "above")
    finish(right, "length of a step (grey: standstill, no E)", "frame", "step [m]")
    return made


def stopping_figure(needed: Array, errors: Array, stop: Array, height: int = 230) -> Figure:
    """Adaptive stopping over the number of sets drawn, median and band of several orders of the sets.

    Parameters
    ----------
    needed, errors : (S, N) number of sets needed according to the best candidate so far, and its image error.
    stop : (S,) sets drawn when there are enough.
    """
    made, (left, right) = figure(height, 2)
    drawn = np.arange(1, needed.shape[1] + 1)
    left.plot(drawn, drawn, color=PALE, linewidth=1.5, label="drawn")
    for axis, values, words in ((left, needed, "needed"), (right, errors, "best so far")):
        low, middle, high = np.percentile(values, (0, 50, 100), axis=0)
        axis.fill_between(drawn, low, high, color=GOOD, alpha=0.2, linewidth=0)
        axis.plot(drawn, middle, color=GOOD, linewidth=1.5, label=words)
        axis.axvline(float(np.median(stop)), color=BAD, linewidth=1.2, label="enough: stop")
        axis.set_xscale("log")
        log_axis(axis.xaxis, 1, len(drawn), (1.0, 3.0))
    log_axis(left.yaxis, 1, 1000)
    finish(left, "sets for 99 %", "sets drawn", "sets", "above")
    finish(right, "image error", "sets drawn", "image error", "above")
    return made
