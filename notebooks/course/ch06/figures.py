"""Figures of chapter 6: paths from above, one sub-sequence from its start, errors by length and by speed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from vo_lib.data.poses import from_first
from vo_lib.evaluation.ate_rpe import AbsoluteError, rmse
from vo_lib.evaluation.kitti_errors import KittiErrors, kitti_errors, trajectory_distances
from vo_lib.geometry.types import Array

from ..colours import BAD, CYCLE, DARK, FIFTH, GOOD, PALE, THIRD
from ..drawing import SMALL_SIZE, figure, finish, numbers_at, room, round_limits, write_instead


def paths_chart(
    axis: Axes, truth: Array, estimate: Array | None, title: str, part: tuple[int, int] | None = None
) -> None:
    """Truth and estimate from above; `part` (first and last frame) is marked on the truth."""
    lines: list[tuple[str, Array, str, float, float]] = []
    if part is not None:
        lines.append(("sub-sequence", truth[part[0] : part[1] + 1], FIFTH, 5.0, 0.7))
    if estimate is not None:
        lines.append(("estimate", estimate, GOOD, 2.5, 0.8))
    lines.append(("truth", truth, DARK, 1.0, 1.0))  # thin, on the others
    for name, poses, colour, width, alpha in lines:
        axis.plot(*poses[:, [0, 2], 3].T, color=colour, linewidth=width, alpha=alpha, label=name)
    axis.plot(*truth[0, [0, 2], 3], "o", color=DARK, markersize=5)
    axis.set_aspect("equal", adjustable="datalim")
    round_limits(axis.xaxis, axis.yaxis)
    finish(axis, title, "x, right [m]", "z, forward [m]")


def _at_start(truth: Array, estimate: Array, first: int, last: int) -> tuple[Array, Array]:
    """A sub-sequence of the truth and of the estimate, aligned at the first pose."""
    moved = truth[first] @ np.linalg.inv(estimate[first]) @ estimate[first : last + 1]
    return truth[first : last + 1], moved


def drift_chart(axis: Axes, truth: Array, estimate: Array, first: int, last: int, number: int = 0) -> None:
    """Growth of the error along a sub-sequence from equal starts, in the axes of its first true camera.

    first, last : indices of its frames. number : of the sequence's frame 0, for the title.
    """
    true_part, moved = _at_start(truth, estimate, first, last)
    error = (moved[:, :3, 3] - true_part[:, :3, 3]) @ truth[first, :3, :3]
    along = trajectory_distances(true_part)
    distance = np.linalg.norm(error, axis=1)
    axis.axhline(0, color=PALE, linewidth=1)
    for values, colour, words in (
        (distance, BAD, "distance"),
        (error[:, 0], GOOD, "to the right"),
        (error[:, 2], THIRD, "ahead"),
    ):
        axis.plot(along, values, color=colour, linewidth=1.5, label=words)
    round_limits(axis.yaxis)
    title = f"frames {number + first} to {number + last}, starts made equal: error"
    finish(axis, title, "distance along the path [m]", "error [m]")


def length_chart(axis: Axes, errors: KittiErrors, others: Mapping[str, KittiErrors], rotation: bool) -> None:
    """Errors of sub-sequences by length, as dots; lines: mean errors by length, for `others` too.

    rotation : whether the errors are RE, not TE.
    """
    values = 100.0 * (np.degrees(errors.r_err) if rotation else errors.t_err)
    lengths = np.unique(errors.length).tolist()
    gap = np.min(np.diff(lengths), initial=lengths[0] if lengths else 1.0)
    spread = 0.3 * gap * (np.random.default_rng(0).random(len(errors)) - 0.5)  # so that dots are seen
    axis.plot(errors.length + spread, values, ".", color=PALE, markersize=3)
    for (name, each), colour in zip({"estimate": errors, **others}.items(), (GOOD, *CYCLE[1:]), strict=False):
        means = [part.re if rotation else part.te for part in each.by_length(lengths).values()]
        width = 1.2 if name in others else 2.0
        axis.plot(lengths, np.array(means, float), "-o", color=colour, linewidth=width, label=name)
    highest = max(float(np.max(line.get_ydata(), initial=0.0)) for line in axis.get_lines())
    axis.set_ylim(0, room(1.05 * highest, least=1e-3))
    if not lengths:
        write_instead(axis, "the path is too short for these lengths")
    numbers_at(axis.xaxis, lengths[:8])
    if rotation:
        finish(axis, "rotation error by length", "length [m]", "RE [deg/100 m]")
    else:
        finish(axis, "translation error by length", "length [m]", "TE [%]")


def paths_figure(pairs: Mapping[str, tuple[Array, Array]]) -> Figure:
    """Truth and estimate of several paths side by side, by title."""
    made, axes = figure(300, len(pairs))
    for axis, (title, (truth, estimate)) in zip(axes, pairs.items(), strict=True):
        paths_chart(axis, truth, estimate, title)
    return made


def part_figure(truth: Array, estimate: Array, first: int, last: int) -> Figure:
    """The whole paths, and one sub-sequence with equal first poses."""
    made, (left, right) = figure(300, 2)
    paths_chart(left, from_first(truth), from_first(estimate), "the whole path", (first, last))
    true_part, moved = _at_start(truth, estimate, first, last)
    right.plot(*true_part[:, [0, 2], 3].T, color=FIFTH, linewidth=5, alpha=0.7, label="truth")
    right.plot(*moved[:, [0, 2], 3].T, color=GOOD, linewidth=1.5, label="estimate, moved")
    ends = np.stack([true_part[-1, [0, 2], 3], moved[-1, [0, 2], 3]])
    end_error = np.linalg.norm(moved[-1, :3, 3] - true_part[-1, :3, 3])
    right.plot(*ends.T, color=BAD, linewidth=2, label=f"error at the end: {end_error:.2f} m")
    size = 0.12 * float(np.ptp(true_part[:, [0, 2], 3], axis=0).max() + 1e-9)
    for pose, colour in ((true_part[-1], FIFTH), (moved[-1], GOOD)):
        tip = pose[[0, 2], 3] + size * pose[[0, 2], 2]
        right.plot(*tip, alpha=0)  # annotations alone do not widen the axes
        arrow = {"arrowstyle": "-|>", "color": colour, "linewidth": 1.5}
        right.annotate("", tip, pose[[0, 2], 3], arrowprops=arrow)
    right.plot(*true_part[0, [0, 2], 3], "o", color=DARK, markersize=5)
    right.set_aspect("equal", adjustable="datalim")
    finish(right, f"frames {first} to {last}, starts made equal", "x, right [m]", "z, forward [m]")
    return made


def starts_figure(truth: Array, lengths: tuple[float, ...], step: int) -> Figure:
    """All sub-sequences as bars along the path, with a row per start and a colour per nominal length."""
    made, (axis,) = figure(210)
    path = trajectory_distances(truth)
    every = kitti_errors(truth, truth, lengths, step)
    for length, colour in reversed([*zip(lengths, (*CYCLE, DARK), strict=False)]):
        these = every[every.length == length]
        rows = np.tile(these.first // step, (2, 1))
        axis.plot(path[[these.first, these.last]], rows, color=colour, linewidth=2)
        axis.get_lines()[-1].set_label(f"{length:g} m")
    axis.invert_yaxis()
    finish(axis, f"a start every {step} frames", "distance along the path [m]", "start", "best")
    return made


def curves_figure(errors: Mapping[str, KittiErrors]) -> Figure:
    """Mean TE of each estimate by sub-sequence length and by speed."""
    made, axes = figure(230, 2)
    charts = (
        ("length", "by length", "length [m]"),
        ("speed", "by mean speed of the sub-sequence", "speed [km/h]"),
    )
    for axis, (by, title, x) in zip(axes, charts, strict=True):
        for (name, each), colour in zip(errors.items(), CYCLE, strict=False):
            places, te, _ = np.array(each.curve(by), float).T
            label = name if by == "length" else None
            axis.plot(places, te, "-o", color=colour, linewidth=1.5, markersize=5, label=label)
        axis.set_ylim(0, None)
        finish(axis, title, x, "TE [%]")
    return made


def distances_figure(errors: Mapping[str, AbsoluteError]) -> Figure:
    """Distance from the truth, frame by frame, after each alignment."""
    made, (axis,) = figure(200)
    for (name, each), colour in zip(errors.items(), (BAD, PALE, GOOD, THIRD), strict=True):
        words = f"{name}: RMSE {rmse(each.distance):.2f} m"
        axis.plot(each.distance, color=colour, linewidth=1.5, label=words)
    axis.set_ylim(0, 1.3 * max(float(each.distance.max()) for each in errors.values()))
    finish(axis, "distance from the truth", "frame", "distance [m]")
    axis.legend(loc="upper left", fontsize=SMALL_SIZE, frameon=False, ncols=len(errors))
    return made


def values_figure(
    whose: str,
    own: Mapping[float, float],
    library: Mapping[float, float],
    title: str,
    y: str,
    unit: str = "frame",
    from_zero: bool = True,
) -> Figure:
    """Values by first frame or by length: those of the student's function as dots, the library's as a line.

    whose : "yours", or else the dots come from the library, too, and the legend says so.
    unit : "frame" if the values are by first frame, else the unit of the lengths, "m".
    """
    made, (axis,) = figure(200)
    dots = "your function" if whose == "yours" else "in place of yours"
    axis.plot([*own], [*own.values()], "o", color=GOOD, markersize=6, label=dots)
    axis.plot([*library], [*library.values()], "-", color=DARK, linewidth=1.0, label="the library's")
    if from_zero:
        highest = max(float(np.max([*each.values()])) for each in (own, library))
        lowest = min(0.0, *own.values())
        axis.set_ylim(1.2 * lowest, 1.2 * highest)
    round_limits(axis.yaxis)
    finish(axis, title, "first frame of the piece" if unit == "frame" else f"length [{unit}]", y, "above")
    return made


def changes_chart(axis: Axes, changes: Array, names: Sequence[str], mean: float, half: float) -> None:
    """The change of each pair (N,) as a dot over its name; their mean with its interval ± half, and no change."""
    axis.axhspan(mean - half, mean + half, color=PALE, alpha=0.5, label="95 % interval of the mean")
    axis.axhline(mean, color=DARK, linewidth=1.5, label="mean change")
    axis.axhline(0.0, color=BAD, linewidth=1.0, linestyle="--", label="no change")
    places = np.arange(len(names))
    axis.plot(places, changes, "o", color=GOOD, markersize=6)
    axis.set_xticks(places, names)


def pairs_figure(
    title: str,
    before: tuple[str, Array],
    after: tuple[str, Array],
    interval: tuple[float, float],
    points: Sequence[str] = (),
) -> Figure:
    """Errors of two methods joined by seed or sequence, and their changes with mean and interval.

    before, after : name of a method and its TE (N,), %. interval : mean change and half width.
    points : names of the sequences; by default, the pairs are seeds.
    """
    made, (errors, changes) = figure(240, 2)
    old_name, old = before
    new_name, new = after
    pair = "sequence" if points else "seed"
    names = list(points) if points else [str(seed) for seed in range(len(old))]
    for start, end in zip(old, new, strict=True):
        colour = GOOD if end <= start else BAD
        errors.plot([0, 1], [start, end], "-o", color=colour, linewidth=1.2, markersize=5)
    errors.set_xlim(-0.25, 1.25)
    errors.set_xticks([0, 1], [old_name, new_name])
    finish(errors, f"{title}: TE [%], a line for each {pair}", "", "", "none")
    mean, half = interval
    changes_chart(changes, new - old, names, mean, half)
    highest = float(np.max(np.abs([*(new - old), mean - half, mean + half])))
    changes.set_ylim(-1.5 * highest - 1e-6, 1.5 * highest + 1e-6)
    finish(changes, "change of TE [%] of each pair", pair, "", "best")
    return made
