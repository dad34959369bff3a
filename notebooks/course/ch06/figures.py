"""Chapter 6, drawn: paths from above, one sub-sequence from its start, errors by length and by speed."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from vo_lib.core.types import Array
from vo_lib.evaluation.ate_rpe import AbsoluteError
from vo_lib.evaluation.kitti import KITTI_LENGTHS, KittiErrors, trajectory_distances

from ..drawing import BAD, CYCLE, DARK, FIFTH, FONT_SIZE, GOOD, PALE, THIRD, Place, figure, finish, room

PER_CENT, PER_100_M = 100.0, 100.0 * 180.0 / np.pi  # of KittiErrors.t_err and .r_err
TENTHS = tuple(n / 10 for n in range(10, 100))  # of a length, for a limit not far beyond it


def paths_chart(
    axis: Axes, truth: Array, estimate: Array | None, title: str, part: tuple[int, int] | None = None
) -> None:
    """Truth and estimate from above; `part`, first and last frame, is marked on the truth."""
    paths = {"truth": (truth, DARK, 2.5)}
    if part is not None:
        paths["sub-sequence"] = (truth[part[0] : part[1] + 1], FIFTH, 5.0)
    if estimate is not None:
        paths["estimate"] = (estimate, GOOD, 1.5)
    places = [poses[:, [0, 2], 3] for poses, _, _ in paths.values()]
    for (name, (_, colour, width)), place in zip(paths.items(), places, strict=True):
        alpha = 0.7 if name == "sub-sequence" else 1.0
        axis.plot(*place.T, color=colour, linewidth=width, alpha=alpha, label=name)
    axis.plot(*places[0][0], "o", color=DARK, markersize=5)
    middle = (places[0].min(axis=0) + places[0].max(axis=0)) / 2
    reach = np.abs(np.concatenate(places) - middle).max(axis=0)
    box = axis.get_window_extent()
    size = np.array([box.width, box.height])
    half = size * max(room(1.08 * far, least=1.0) / wide for far, wide in zip(reach, size, strict=True))
    (x, z), (half_x, half_z) = middle, half  # the same scale along both
    axis.set(xlim=(x - half_x, x + half_x), ylim=(z - half_z, z + half_z))
    finish(axis, title, "x, right [m]", "z, forward [m]", _empty_place((places[0] - middle) / half))


def _empty_place(places: Array) -> Place:
    """Where in [-1, 1]² a legend is farthest from places (N, 2)."""
    free: dict[Place, tuple[float, float]] = {
        "upper right": (1, 1), "upper left": (-1, 1), "lower right": (1, -1), "lower left": (-1, -1),
        "center": (0, 0),
    }  # fmt: skip
    return max(free, key=lambda each: float(np.linalg.norm(places - free[each], axis=1).min()))


def _at_start(truth: Array, estimate: Array, first: int, last: int) -> tuple[Array, Array]:
    """A sub-sequence of the truth, and of the estimate moved so that both start at the same pose."""
    moved = truth[first] @ np.linalg.inv(estimate[first]) @ estimate[first : last + 1]
    return truth[first : last + 1], moved


def draw_part(axis: Axes, truth: Array, estimate: Array, first: int, last: int) -> None:
    """A sub-sequence: the estimate moved so that both start at the same pose; what is left is the error."""
    piece, moved = _at_start(truth, estimate, first, last)
    axis.plot(piece[:, 0, 3], piece[:, 2, 3], color=FIFTH, linewidth=5, alpha=0.7, label="truth")
    axis.plot(moved[:, 0, 3], moved[:, 2, 3], color=GOOD, linewidth=1.5, label="estimate, moved")
    ends = np.stack([piece[-1, [0, 2], 3], moved[-1, [0, 2], 3]])
    axis.plot(ends[:, 0], ends[:, 1], color=BAD, linewidth=2, label="error at the end")
    size = 0.12 * float(np.ptp(piece[:, [0, 2], 3], axis=0).max() + 1e-9)
    for pose, colour in ((piece[-1], FIFTH), (moved[-1], GOOD)):
        tip = pose[[0, 2], 3] + size * pose[[0, 2], 2]
        axis.plot(*tip, alpha=0)  # annotations alone do not widen the axes
        arrow = {"arrowstyle": "-|>", "color": colour, "linewidth": 1.5}
        axis.annotate("", tip, pose[[0, 2], 3], arrowprops=arrow)
    axis.plot(*piece[0, [0, 2], 3], "o", color=DARK, markersize=5)
    axis.set_aspect("equal", adjustable="datalim")
    finish(axis, f"frames {first} to {last}, starts made equal", "x, right [m]", "z, forward [m]")


def drift_chart(axis: Axes, truth: Array, estimate: Array, first: int, last: int) -> None:
    """How the error grows along a sub-sequence whose starts are made equal, in the axes of its start."""
    piece, moved = _at_start(truth, estimate, first, last)
    error = (moved[:, :3, 3] - piece[:, :3, 3]) @ truth[first, :3, :3]
    way, distance = trajectory_distances(piece), np.linalg.norm(error, axis=1)
    axis.axhline(0, color=PALE, linewidth=1)
    for values, colour, words in (
        (distance, BAD, "distance"),
        (error[:, 0], GOOD, "to the right"),
        (error[:, 2], THIRD, "ahead"),
    ):
        axis.plot(way, values, color=colour, linewidth=1.5, label=words)
    far = room(1.02 * float(way[-1]), steps=TENTHS)
    high = room(1.05 * float(distance.max()), least=0.001)
    axis.set_xlim(-0.03 * far, far)
    axis.set_ylim(-max(room(-1.05 * float(error.min())), 0.05 * high), high)
    title = f"frames {first} to {last}, starts made equal: error"
    finish(axis, title, "way along the path [m]", "error [m]", "upper left")


def length_chart(
    axis: Axes, errors: KittiErrors, others: Mapping[str, KittiErrors], rotation: bool = False
) -> None:
    """Each sub-sequence as a dot over its length, the mean of each length as a line."""
    factor, values = (PER_100_M, errors.r_err) if rotation else (PER_CENT, errors.t_err)
    lengths = np.unique(errors.length)
    apart = np.min(np.diff(lengths), initial=lengths[0] if len(lengths) else 1.0)
    spread = 0.3 * apart * (np.random.default_rng(0).random(len(errors)) - 0.5)
    axis.plot(errors.length + spread, factor * values, ".", color=PALE, markersize=3)
    highest = factor * float(np.max(values, initial=0.0))
    for (name, each), colour in zip({"": errors, **others}.items(), (GOOD, *CYCLE[1:]), strict=False):
        places, mean = _means(each, rotation)
        width, size = (1.2, 3) if name else (2.0, 6)
        axis.plot(places, mean, "-o", color=colour, linewidth=width, markersize=size, label=name or None)
        highest = float(np.max(mean, initial=highest))
    axis.set_ylim(0, room(1.05 * highest, least=1e-3))
    if len(lengths):
        axis.set_xlim(lengths[0] - 0.2 * apart, lengths[-1] + 0.2 * apart)
    else:
        axis.text(0.5, 0.5, "no sub-sequence is so long", ha="center", transform=axis.transAxes)
    if 0 < len(lengths) <= 4:
        axis.set_xticks(lengths)
    kind, unit = ("rotation", "RE [deg/100 m]") if rotation else ("translation", "TE [%]")
    finish(axis, f"{kind} error by length", "length [m]", unit, "lower right")


def _means(errors: KittiErrors, rotation: bool) -> tuple[Array, Array]:
    """The lengths that occur and the mean error of each, % or deg/100 m."""
    places = np.unique(errors.length)
    each = [errors[errors.length == place] for place in places]
    return places, np.array([part.re if rotation else part.te for part in each], float)


def paths_figure(pairs: Mapping[str, tuple[Array, Array]], height: int = 300) -> Figure:
    """Truth and estimate of several paths side by side, by title."""
    made, axes = figure(height, len(pairs))
    for axis, (title, (truth, estimate)) in zip(axes, pairs.items(), strict=True):
        paths_chart(axis, truth, estimate, title)
    return made


def part_figure(truth: Array, estimate: Array, first: int, last: int, height: int = 300) -> Figure:
    """The whole path with a sub-sequence marked, and the sub-sequence by itself."""
    made, (whole, part) = figure(height, 2)
    paths_chart(whole, truth, estimate, "the whole path", (first, last))
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
                    path[[start, end]], [row, row], color=(*CYCLE, DARK)[number % 8], linewidth=2,
                    label=f"{length:g} m" if start == 0 else None,
                )  # fmt: skip
        row += 1
    axis.set_ylim(row, -1)
    finish(axis, f"a start every {step} frames", "way along the path [m]", "start", "above")
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
    finish(axis, "distance from the truth", "frame", "distance [m]")
    axis.legend(loc="upper left", fontsize=FONT_SIZE - 1, frameon=False, ncols=len(errors))
    return made
