"""Figures of chapter 3: candidates by angle to the prior and by errors; numbers of sets; errors over frames."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import cv2
import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from vo_lib.geometry.camera import StereoCamera
from vo_lib.geometry.types import Array, BoolArray, Image

from ..colours import BAD, DARK, GOOD, PALE, WHITE, bgr
from ..drawing import PHOTO_HEIGHT, WIDTH, caption, figure, finish, log_axis, photo
from ..drawn_matches import features_picture as features_picture

# Degrees shown of a rotation error.
LEAST = 1e-3
MOST = 180.0
ALIKE = 0.02  # largest relative difference of curves that look the same


@dataclass(frozen=True, eq=False)
class ScoredCandidates:
    """All candidates of a frame with their angles and errors.

    Attributes
    ----------
    angle : (M,) angle to the previous essential vector, degrees; NaN without a previous vector.
    image_error : (M,) truncated mean squared Sampson distance over all matches, in [0, 1].
    rotation_error : (M,) angle to the reference rotation, degrees.
    kept : (M,) candidates that may compete in solution selection.
    consensus, selected : index of the winner without, with the prior. dropped : whether the prior is dropped.
    """

    angle: Array
    image_error: Array
    rotation_error: Array
    kept: BoolArray
    consensus: int
    selected: int
    dropped: bool


def epipoles_picture(image: Image, camera: StereoCamera, E: Array, t_cp: Array | None) -> Image:
    """The current image with the point that each candidate E (M, 3, 3) drives towards or away from.

    This point is the epipole, the image of the other camera; a ring shows the epipole of t_cp (3,), the truth.
    """
    U, _, _ = np.linalg.svd(E)
    t = U[:, :, 2]  # tᵀ E = 0
    depth = np.where(np.abs(t[:, 2]) < 1e-9, 1e-9, t[:, 2])
    uv = t[:, :2] / depth[:, None] * camera.f + (camera.cx, camera.cy)
    inside = (uv >= 0).all(axis=1) & (uv < (image.shape[1], image.shape[0])).all(axis=1)
    picture = photo(image, image.shape[1])
    for place in np.rint(16 * uv[inside]).astype(int).tolist():
        cv2.circle(picture, place, 4 * 16, bgr(DARK), -1, cv2.LINE_AA, shift=4)
        cv2.circle(picture, place, 3 * 16, bgr(BAD), -1, cv2.LINE_AA, shift=4)
    words = f"orange: towards which point the car drives, by each of {len(E)} candidates"
    words += f" ({np.count_nonzero(~inside)} outside)"
    if t_cp is not None:
        true = t_cp[:2] / t_cp[2] * camera.f + (camera.cx, camera.cy)
        place = np.rint(16 * true).astype(int).tolist()
        cv2.circle(picture, place, 16 * 16, bgr(WHITE), 5, cv2.LINE_AA, shift=4)
        cv2.circle(picture, place, 16 * 16, bgr(GOOD), 3, cv2.LINE_AA, shift=4)
        words += "; ring: the truth"
    return caption(photo(picture, WIDTH, PHOTO_HEIGHT), words)


def scores_figure(own: Array, library: Array, rotation_error: Array | None, whose: str) -> Figure:
    """Image errors (M,) of all candidates by the student's function (dots) and by the library's (line).

    Both are in the order of the library's. With rotation errors (M,), degrees, a second chart shows the image errors by
    the student's function over the rotation errors.

    whose : `OwnFunction.whose`, for the legend.
    """
    made, axes = figure(260, 1 if rotation_error is None else 2)
    order = np.argsort(library, kind="stable")
    place = np.arange(len(order))
    axes[0].plot(place, own[order], ".", color=GOOD, markersize=5, label=f"used here: {whose}")
    axes[0].plot(place, library[order], color=BAD, linewidth=1.2, label="the library's")
    finish(axes[0], "image error of each candidate", "candidates, the best first", "", "lower right")
    if rotation_error is not None:
        best = int(np.argmin(own))
        x = np.clip(rotation_error, LEAST, MOST)
        axes[1].plot(x, own, ".", color=GOOD, markersize=4.5, label=f"used here: {whose}")
        axes[1].plot(x[best], own[best], "o", color=BAD, markersize=6, label="smallest image error")
        log_axis(axes[1].xaxis, LEAST, MOST)
        title = "image error and rotation error"
        finish(axes[1], title, "rotation error [deg]", "", "lower right", boxed=True)
    return made


def prior_figure(angle: Array, library: Array, image_error: Array, whose: str) -> Figure:
    """Angles to the previous vector (M,), degrees, by the student's function and by the library's; image errors (M,).

    whose : `OwnFunction.whose`, for the names of the charts.
    """
    made, (left, right) = figure(260, 2)
    left.plot(angle, image_error, ".", color=GOOD, markersize=4.5)
    left.set(ylim=(-0.02, 1.02))
    x_name = "angle to the previous vector [deg]"
    finish(left, f"all candidates; angle: {whose}", x_name, "image error")
    right.plot([0, 90], [0, 90], color=BAD, linewidth=1.2)
    right.plot(library, angle, ".", color=GOOD, markersize=4.5)
    finish(right, "on the line: equal", "angle, the library's [deg]", f"angle, {whose} [deg]")
    return made


def kept_figure(angle: Array, image_error: Array, kept: dict[str, BoolArray]) -> Figure:
    """Charts, one for each mask (M,) by name: candidates by angle to the previous vector, degrees; kept in blue."""
    made, axes = figure(240, len(kept))
    for axis, (name, mask) in zip(axes, kept.items(), strict=True):
        axis.plot(angle[~mask], image_error[~mask], "o", color=PALE, markersize=7, label="left out")
        axis.plot(angle[mask], image_error[mask], "o", color=GOOD, markersize=7, label="kept")
        axis.set(xlim=(-2, 92), ylim=(-0.04, 1.06))
        x_name = "angle to the previous vector [deg]"
        finish(axis, name, x_name, "image error", "lower right", boxed=True)
    return made


def sets_figure(wrong: Array, needed: dict[int, Array], here: float) -> Figure:
    """Sets needed for one without a wrong match, by the share of wrong matches, one curve for each set size.

    wrong : (K,) shares. needed : by the number of matches in a set, numbers of sets (K,). here : share of the
    frame, marked by a line.
    """
    made, (axis,) = figure(250)
    for (size, sets), colour in zip(needed.items(), (GOOD, BAD, DARK), strict=False):
        axis.plot(100 * wrong, sets, color=colour, linewidth=1.8, label=f"sets of {size}")
    axis.axvline(100 * here, color=DARK, linewidth=1, linestyle=":", label="this frame")
    log_axis(axis.yaxis, 1, 1e5)
    axis.set_xlim(0, 100 * float(wrong[-1]))
    finish(axis, "sets needed for 99 %", "wrong matches [%]", "", "above")
    return made


def candidates_figure(scored: ScoredCandidates, result: float | None = None, height: int = 260) -> Figure:
    """Image error of each candidate by angle to the previous vector and, with truth, by rotation error.

    A mark on the right shows `result`, the error of the frame's final rotation, degrees.
    """
    with_truth = bool(np.isfinite(scored.rotation_error).any())
    made, axes = figure(height, 2 if with_truth else 1)
    by_angle = axes[0]
    named = axes[-1]  # one legend is enough
    nearest = "every solution" if scored.kept.all() else "nearest k of a set"
    charts = [(by_angle, scored.angle)]
    if with_truth:
        charts.append((named, np.clip(scored.rotation_error, LEAST, MOST)))
    for axis, x in charts:
        for chosen, colour, marker, size, words in (
            (~scored.kept, PALE, ".", 4.5, "left out"),
            (scored.kept, GOOD, ".", 4.5, nearest),
            (scored.consensus, DARK, "o", 9, "winner, consensus"),
            (scored.selected, BAD, "o", 5.5, "winner, selection"),
        ):
            places = np.atleast_1d(x[chosen])  # of all these candidates, or of the winner
            errors = np.atleast_1d(scored.image_error[chosen])
            label = words if axis is named else ""
            is_winner = marker == "o"  # a winner at the edge is shown whole
            axis.plot(
                places, errors, marker, color=colour, markersize=size, label=label, clip_on=not is_winner
            )
        axis.set_ylim(-0.02, 1.02)
    by_angle.set_xlim(0, 90)
    x_name = "angle to the previous essential vector [deg]"
    finish(by_angle, "the solutions of all sets", x_name, "image error", boxed=True)
    if with_truth:
        if result is not None:
            named.axvline(max(result, LEAST), color=BAD, linewidth=0.8, label="rotation of the frame")
        log_axis(named.xaxis, LEAST, MOST)
        title = "image error and rotation error"
        finish(named, title, "rotation error [deg]", "image error", boxed=True)
    return made


def errors_figure(
    errors: Mapping[str, Array],
    x: Array | None = None,
    title: str = "rotation error [deg]",
    x_name: str = "frame",
) -> Figure:
    """Curves of errors (N,) by name, over the values x (N,); without x, over the frames 1, 2, … with medians.

    Errors (S, N) of several seeds are drawn as their median, with a band from the smallest to the largest.
    Identical curves are drawn as one line with all their names.
    """
    made, (axis,) = figure(230)
    looks = ((DARK, "-", "o"), (GOOD, "--", "s"), (BAD, "-", "^"))
    for (names, seeds), (colour, line, marker) in zip(_different_curves(errors), looks, strict=False):
        middle = np.median(seeds, axis=0)
        label = " / ".join(names)
        if x is None:
            label += f": median {np.median(seeds):.3f}"
            marker = ""
        at = np.arange(1, len(middle) + 1) if x is None else x
        if len(seeds) > 1:
            smallest = seeds.min(axis=0)
            largest = seeds.max(axis=0)
            axis.fill_between(at, smallest, largest, color=colour, alpha=0.2, linewidth=0)
        axis.plot(at, middle, line + marker, color=colour, markersize=5, label=label)
    axis.set_yscale("log")
    low, high = axis.get_ylim()
    log_axis(axis.yaxis, min(low, 0.01), max(high, 0.1))
    axis.xaxis.set_major_locator(MaxNLocator(integer=True))
    finish(axis, title, x_name, "", "above")
    return made


def _different_curves(errors: Mapping[str, Array]) -> list[tuple[list[str], Array]]:
    """The curves that do not look the same: the names of each, and its values (S, N) by seed."""
    curves: list[tuple[list[str], Array]] = []
    for name, values in errors.items():
        seeds = np.atleast_2d(values)
        middle = np.median(seeds, axis=0)
        for names, other in curves:
            if np.allclose(middle, np.median(other, axis=0), rtol=ALIKE):
                names.append(name)
                break
        else:
            curves.append(([name], seeds))
    return curves


def turns_figure(angle: Array, turn: Array) -> Figure:
    """Angles between successive essential vectors of a path, and rotations of the steps, both in degrees.

    angle : (N - 2,) angles, NaN at a standstill. turn : (N - 1,) rotations.
    """
    made, (axis,) = figure(220)
    frames = 2 + np.arange(len(angle))
    axis.plot(1 + np.arange(len(turn)), turn, color=DARK, linewidth=1, label="rotation of a step")
    axis.plot(frames, angle, color=GOOD, label="angle between successive vectors")
    everywhere = axis.get_xaxis_transform()  # from the bottom of the axis to its top
    still = np.isnan(angle)
    words = "standstill, no E"
    axis.fill_between(frames, 0, 1, where=still, color=PALE, alpha=0.5, transform=everywhere, label=words)
    finish(axis, "angles [deg]", "frame", "", "above")
    return made


def stopping_figure(needed: Array, stop: Array) -> Figure:
    """Number of sets that adaptive stopping requires after each drawn set.

    needed : (S, N) required numbers for S orders of the N sets. stop : (S,) numbers of sets at the stop, which is N
    if more are required even then.
    """
    made, (axis,) = figure(230)
    drawn = np.arange(1, needed.shape[1] + 1)
    low, middle, high = np.percentile(needed, (0, 50, 100), axis=0)
    axis.plot(drawn, drawn, color=PALE, linewidth=1.5, label="drawn")
    axis.fill_between(drawn, low, high, color=GOOD, alpha=0.2, linewidth=0)
    axis.plot(drawn, middle, color=GOOD, linewidth=1.5, label="needed")
    axis.axvline(float(np.median(stop)), color=BAD, linewidth=1.2, label="stop")
    log_axis(axis.xaxis, 1, len(drawn), (1.0, 3.0))
    log_axis(axis.yaxis, 1, 1000)
    finish(axis, "sets needed for 99 %", "sets drawn", "", "above")
    return made
