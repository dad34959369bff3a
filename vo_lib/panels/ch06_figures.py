"""Chapter 6, drawn: paths from above, one sub-sequence from its start, errors by length and by speed."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ..ate_rpe import AbsoluteError
from ..evaluation import KITTI_LENGTHS, KittiErrors, trajectory_distances
from ..geometry import Array
from .style import BAD, CYCLE, DARK, FIFTH, FONT_SIZE, GOOD, PALE, THIRD, figure, finish

PER_CENT, PER_100_M = 100.0, 100.0 * 180.0 / np.pi  # of KittiErrors.t_err and .r_err


def draw_paths(
    axis: Axes, truth: Array, estimate: Array | None, title: str, part: tuple[int, int] | None = None
) -> None:
    """Truth and estimate from above; `part`, first and last frame, is marked on the truth."""
    axis.plot(truth[:, 0, 3], truth[:, 2, 3], color=DARK, linewidth=2.5, label="truth")
    if part is not None:
        first, last = part
        piece = truth[first : last + 1]
        axis.plot(piece[:, 0, 3], piece[:, 2, 3], color=FIFTH, linewidth=5, alpha=0.7, label="sub-sequence")
    if estimate is not None:
        axis.plot(estimate[:, 0, 3], estimate[:, 2, 3], color=GOOD, linewidth=1.5, label="estimate")
    axis.plot(*truth[0, [0, 2], 3], "o", color=DARK, markersize=5)
    axis.set_aspect("equal", adjustable="datalim")
    finish(axis, title, "x, right [m]", "z, forward [m]")


def draw_part(axis: Axes, truth: Array, estimate: Array, first: int, last: int) -> None:
    """A sub-sequence: the estimate moved so that both start at the same pose; what is left is the error."""
    moved = truth[first] @ np.linalg.inv(estimate[first]) @ estimate[first : last + 1]
    piece = truth[first : last + 1]
    axis.plot(piece[:, 0, 3], piece[:, 2, 3], color=FIFTH, linewidth=5, alpha=0.7, label="truth")
    axis.plot(moved[:, 0, 3], moved[:, 2, 3], color=GOOD, linewidth=1.5, label="estimate, moved")
    ends = np.stack([piece[-1, [0, 2], 3], moved[-1, [0, 2], 3]])
    axis.plot(ends[:, 0], ends[:, 1], color=BAD, linewidth=2, label="error at the end")
    size = 0.12 * float(np.ptp(piece[:, [0, 2], 3], axis=0).max() + 1e-9)
    for pose, colour in ((piece[-1], FIFTH), (moved[-1], GOOD)):
        tip = pose[[0, 2], 3] + size * pose[[0, 2], 2]
        axis.plot(*tip, alpha=0)  # annotations alone do not widen the axes
        axis.annotate(
            "", tip, pose[[0, 2], 3], arrowprops={"arrowstyle": "-|>", "color": colour, "linewidth": 1.5}
        )
    axis.plot(*piece[0, [0, 2], 3], "o", color=DARK, markersize=5)
    axis.set_aspect("equal", adjustable="datalim")
    finish(axis, f"frames {first} to {last}, starts made equal", "x, right [m]", "z, forward [m]")


def draw_drift(axis: Axes, truth: Array, estimate: Array, first: int, last: int) -> None:
    """How the error grows along a sub-sequence whose starts are made equal, in the axes of its start."""
    moved = truth[first] @ np.linalg.inv(estimate[first]) @ estimate[first : last + 1]
    piece = truth[first : last + 1]
    error = (moved[:, :3, 3] - piece[:, :3, 3]) @ truth[first, :3, :3]
    way = trajectory_distances(piece)
    for values, colour, words in (
        (np.linalg.norm(error, axis=1), BAD, "distance"),
        (error[:, 0], GOOD, "to the right"),
        (error[:, 2], THIRD, "ahead"),
    ):
        axis.plot(way, values, color=colour, linewidth=1.5, label=words)
    axis.axhline(0, color=PALE, linewidth=1)
    finish(axis, f"frames {first} to {last}, starts made equal: error", "way along the path [m]", "m")


def draw_by_length(
    axis: Axes, errors: KittiErrors, others: Mapping[str, KittiErrors], rotation: bool = False
) -> None:
    """Each sub-sequence as a dot over its length, the mean of each length as a line."""
    factor, values = (PER_100_M, errors.r_err) if rotation else (PER_CENT, errors.t_err)
    lengths = np.unique(errors.length)
    apart = np.min(np.diff(lengths), initial=lengths[0] if len(lengths) else 1.0)
    spread = 0.3 * apart * (np.random.default_rng(0).random(len(errors)) - 0.5)
    axis.plot(errors.length + spread, factor * values, ".", color=PALE, markersize=3)
    for number, (name, each) in enumerate({"": errors, **others}.items()):
        places = np.unique(each.length)
        source = each.r_err if rotation else each.t_err
        means = [factor * float(source[each.length == place].mean()) for place in places]
        colour = (GOOD, *CYCLE[1:])[number % len(CYCLE)]
        style = (
            {"linewidth": 1.2, "label": name, "markersize": 3} if name else {"linewidth": 2, "markersize": 6}
        )
        axis.plot(places, means, "-o", color=colour, **style)
    if len(errors) == 0:
        axis.text(0.5, 0.5, "no sub-sequence is so long", ha="center", transform=axis.transAxes)
    elif len(lengths) <= 4:
        axis.set_xticks(lengths)
    axis.set_ylim(0, 1.15 * float(np.max(factor * values, initial=1e-6)))
    unit = "RE [deg/100 m]" if rotation else "TE [%]"
    finish(axis, f"{'rotation' if rotation else 'translation'} error by length", "length [m]", unit)


def paths_figure(pairs: Mapping[str, tuple[Array, Array]], height: int = 300) -> Figure:
    """Truth and estimate of several paths side by side, by title."""
    made, axes = figure(height, len(pairs))
    for axis, (title, (truth, estimate)) in zip(axes, pairs.items(), strict=True):
        draw_paths(axis, truth, estimate, title)
    return made


def part_figure(truth: Array, estimate: Array, first: int, last: int, height: int = 300) -> Figure:
    """The whole path with a sub-sequence marked, and the sub-sequence by itself."""
    made, (whole, part) = figure(height, 2)
    draw_paths(whole, truth, estimate, "the whole path", (first, last))
    draw_part(part, truth, estimate, first, last)
    return made


def starts_figure(truth: Array, lengths: tuple[float, ...], step: int, height: int = 210) -> Figure:
    """All sub-sequences as bars over the path length, one row a start, one colour a nominal length."""
    made, (axis,) = figure(height)
    path = trajectory_distances(truth)
    row = 0
    for start in range(0, len(truth), step):
        for number, length in reversed(list(enumerate(lengths))):
            end = int(np.searchsorted(path, path[start] + length, side="right"))
            if end < len(truth):
                axis.plot(
                    path[[start, end]], [row, row], color=CYCLE[number % len(CYCLE)], linewidth=2,
                    label=f"{length:g} m" if start == 0 else None,
                )  # fmt: skip
        row += 1
    axis.set_ylim(row, -1)
    finish(axis, f"a start every {step} frames", "way along the path [m]", "start")
    axis.set_xlim(-0.02 * path[-1], 1.2 * path[-1])
    axis.legend(loc="upper right", fontsize=FONT_SIZE - 1, frameon=False)
    return made


def curves_figure(errors: Mapping[str, KittiErrors], height: int = 230) -> Figure:
    """Mean TE of named estimates by sub-sequence length and by speed."""
    made, (by_length, by_speed) = figure(height, 2)
    for number, (name, each) in enumerate(errors.items()):
        style = {"color": CYCLE[number % len(CYCLE)], "linewidth": 1.5, "markersize": 5}
        lengths = np.unique(each.length)
        te = [PER_CENT * float(each.t_err[each.length == length].mean()) for length in lengths]
        by_length.plot(lengths, te, "-o", label=name, **style)  # type: ignore[arg-type]
        points = [(at, value) for at, value, _ in each.curve("speed", KITTI_LENGTHS) if value is not None]
        speed, value = np.reshape(points, (-1, 2)).T
        by_speed.plot(speed, value, "-o", **style)  # type: ignore[arg-type]
    for axis, title, x in (
        (by_length, "by length", "length [m]"),
        (by_speed, "by mean speed of the sub-sequence", "speed [km/h]"),
    ):
        axis.set_ylim(0, None)
        finish(axis, title, x, "TE [%]")
    return made


def distances_figure(errors: Mapping[str, AbsoluteError], height: int = 200) -> Figure:
    """Distance from the truth, frame by frame, after each alignment."""
    made, (axis,) = figure(height)
    for number, (name, each) in enumerate(errors.items()):
        colour = (BAD, PALE, GOOD, THIRD)[number % 4]
        rmse = float(np.sqrt(np.mean(each.distance**2)))
        axis.plot(each.distance, color=colour, linewidth=1.5, label=f"{name}: RMSE {rmse:.2f} m")
    axis.set_ylim(0, 1.3 * max(float(each.distance.max()) for each in errors.values()))
    finish(axis, "distance from the truth", "frame", "m")
    axis.legend(loc="upper left", fontsize=FONT_SIZE - 1, frameon=False, ncols=len(errors))
    return made
