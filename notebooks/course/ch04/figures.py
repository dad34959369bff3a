"""Figures of chapter 4: rows, answers of single features and of all, elimination, residuals, covariance."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse, Rectangle

from vo_lib.evaluation.statistics import standard_deviation
from vo_lib.geometry.types import Array

from ..by_depth import DEPTHS
from ..by_depth import by_depth_figure as by_depth_figure
from ..colours import BAD, DARK, FIFTH, GOOD, PALE, WHITE
from ..drawing import COARSE, FONT_SIZE, SMALL_SIZE, figure, finish, log_axis, numbers_at, room, round_limits
from .weightings import length_errors

# Pixels shown of a residual.
LEAST = 0.01
MOST = 100.0
MILLI = 1e3  # from metres to millimetres

COLUMNS = ("Qx", "Qy", "Qz", "tx", "ty", "tz", "c")  # of the table [A | B | c]
ROWS = ("pl x", "pl y", "pr x", "pr y", "cl x", "cl y", "cr x", "cr y")  # previous left … current right


def rows_figure(systems: dict[str, Array]) -> Figure:
    """Tables of the eight rows [A | B | c] (8, 7) of one feature, one for each name; zeros are pale."""
    made, axes = figure(230, len(systems))
    for axis, (name, table) in zip(axes, systems.items(), strict=True):
        for (row, column), value in np.ndenumerate(table):
            zero = abs(value) < 5e-4
            colour = PALE if zero else DARK
            words = "0" if zero else f"{value:.3f}"
            axis.text(column, row, words, ha="center", va="center", fontsize=SMALL_SIZE, color=colour)
        for left, right, fill in ((-0.5, 2.5, GOOD), (2.5, 5.5, BAD), (5.5, 6.5, DARK)):
            place = Rectangle(
                (left, -0.5), right - left, 8, facecolor=(*to_rgb(fill), 0.12), edgecolor="none"
            )
            axis.add_patch(place)
        axis.set(xlim=(-0.5, 6.5), ylim=(7.5, -0.5))
        axis.set_xticks(range(7), labels=COLUMNS)
        axis.set_yticks(range(8), labels=ROWS)
        axis.tick_params(length=0)
        finish(axis, name)
        axis.spines[["left", "bottom"]].set_visible(False)
    return made


def _from_above(
    axis: Axes, each: Array, t_reference: Array, step: float, words: tuple[str, str, str]
) -> tuple[Array, Array]:
    """Draw the t (N, 3) of single features from above, round a cross; return the limits of x and z, metres.

    step : length of the step, metres. words : the title, and the names of the dots and of the cross.
    """
    title, dots, cross = words
    half = room(1.2 * step, steps=COARSE, least=0.3)
    low = t_reference[[0, 2]] - half
    high = t_reference[[0, 2]] + half
    places = each[:, [0, 2]]
    inside = ((places > low) & (places < high)).all(axis=1)
    axis.plot(*places[inside].T, ".", color=GOOD, markersize=4, label=dots)
    axis.plot(*t_reference[[0, 2]], "+", color=BAD, markersize=16, markeredgewidth=2, label=cross)
    axis.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))
    outside = f"{title} ({np.count_nonzero(~inside)} outside)"
    finish(axis, outside, "x, right [m]", "z, forward [m]", "lower right", boxed=True)
    axis.yaxis.labelpad = 0
    return low, high


def answers_figure(each: Array, answers: dict[str, Array], t_reference: Array, reference: str) -> Figure:
    """The t of each feature alone, from above in metres, and joint answers relative to the reference, mm.

    each : (N, 3). answers : by name, one or two t (3,); the first is in front. t_reference : (3,).
    """
    made, (wide, close) = figure(300, 2, (1.0, 1.0))
    step = float(np.linalg.norm(t_reference))
    _from_above(wide, each, t_reference, step, ("t of each feature alone", "one feature", reference))
    away = {name: MILLI * (t - t_reference)[[0, 2]] for name, t in answers.items()}
    looks = ((7, FIFTH), (13, DARK))  # sizes and colours; the first answer is drawn last
    for number, (name, place) in reversed([*enumerate(away.items())]):
        size, colour = looks[number]
        close.plot(*place, "o", color=colour, markersize=size, label=name)
    close.plot(0, 0, "+", color=BAD, markersize=16, markeredgewidth=2, label=reference)
    sizes = [float(np.abs(place).max()) for place in away.values() if np.isfinite(place).all()]
    half = room(1.4 * max(sizes, default=0.0), steps=COARSE, least=1.0)
    close.set(xlim=(-half, half), ylim=(-half, half))
    finish(close, "t of all features", "x relative to the cross [mm]", "z [mm]", "best", boxed=True)
    return made


def one_answer_figure(each: Array, t_reference: Array, reference: str) -> Figure:
    """The t of each feature alone (N, 3), metres: from above, and the distribution of its z."""
    made, (above, histogram) = figure(280, 2)
    step = max(float(np.linalg.norm(t_reference)), 0.1)
    low, high = _from_above(above, each, t_reference, step, ("t from above", "by one feature", reference))
    counts, edges = np.histogram(np.clip(each[:, 2], low[1], high[1]), 60, (low[1], high[1]))
    histogram.stairs(counts, edges, fill=True, color=GOOD)
    histogram.axvline(float(t_reference[2]), color=BAD, linewidth=1.5, label=reference)
    finish(
        histogram,
        "features by their z (in the end bars: all beyond)",
        "z, forward [m]",
        "features",
        "upper right",
    )
    return made


def elimination_figure(shown: int = 5) -> Figure:
    """The factor graph of t and the points of some features, before and after the points are eliminated."""
    made, (before, after) = figure(230, 2, (1.35, 1.0))
    middle = (shown - 1) / 2
    for number in range(shown):
        half_way = 0.5 * (number + middle)
        before.plot([number, middle], [0.75, 0.0], color=DARK, linewidth=1, zorder=1)
        before.plot([number, number], [0.75, 1.15], color=DARK, linewidth=1, zorder=1)
        before.plot([half_way, number], [0.375, 1.15], "s", color=DARK, markersize=8, zorder=2)
        before.plot(number, 0.75, "o", color=GOOD, markersize=26, zorder=3)
        after.plot([number, middle], [0.75, 0.0], color=DARK, linewidth=1, zorder=1)
        after.plot(number, 0.75, "s", color=DARK, markersize=8, zorder=2)
        words: dict[str, Any] = {"ha": "center", "va": "center", "fontsize": FONT_SIZE}
        before.text(number, 0.75, f"Q$_{number + 1}$", color=WHITE, zorder=4, **words)
        after.text(number, 0.98, f"N$_{number + 1}$", **words)
    for axis in (before, after):
        axis.plot(middle, 0.0, "o", color=BAD, markersize=26, zorder=3)
        axis.text(middle, 0.0, "t", color=WHITE, zorder=4, ha="center", va="center", fontsize=FONT_SIZE)
        axis.set_ylim(-0.3, 1.3)
    before.set_xlim(-2.7, shown - 0.6)
    after.set_xlim(-0.7, shown - 0.3)
    before.text(-2.65, 1.15, "four rows, previous pair:", fontsize=FONT_SIZE, va="center")
    before.text(-2.65, 0.375, "four rows, current pair:", fontsize=FONT_SIZE, va="center")
    finish(before, "every point meets t and no other point")
    finish(after, "without the points: N (c - B t) of each feature")
    before.set_axis_off()
    after.set_axis_off()
    return made


def metres_and_pixels_figure(
    focal: float, error: float = 0.5, near: float = 8.0, far: float = 40.0
) -> Figure:
    """From above: the same error of a pixel displaces the ray by more metres at a far point than at a near one.

    error : pixels. near, far : depths of two points, metres. The angle is drawn thirty times too large.
    """
    made, (axis,) = figure(190)
    slope = error / focal
    drawn = 30 * slope
    axis.plot([0, 1.05 * far], [0, 0], color=GOOD, linewidth=1.5, label="true ray")
    words = f"measured ray, {error:g} px beside it"
    axis.plot([0, 1.05 * far], [0, 1.05 * far * drawn], color=BAD, linewidth=1.5, label=words)
    for depth in (near, far):
        axis.plot([depth, depth], [0, depth * drawn], color=DARK, linewidth=2.5)
        axis.plot(depth, 0, "o", color=DARK, markersize=7)
        words = f"{depth:g} m away: row wrong by {MILLI * slope * depth:.0f} mm"
        axis.text(depth, -0.08, words, fontsize=FONT_SIZE, ha="center", va="top")
    axis.plot(0, 0, "s", color=DARK, markersize=9)
    axis.set(xlim=(-1, 1.2 * far), ylim=(-0.32, 1.15 * far * drawn))
    axis.set_yticks([])
    finish(
        axis,
        "one error in pixels, two in metres (the angle is drawn 30 times too large)",
        "depth [m]",
        "",
        "above",
    )
    return made


def units_figure(depth: Array, residual: Array, focal: float) -> Figure:
    """Residual norms (N,) of the eight rows by depth (N,): in metres, and divided by the depth, in pixels."""
    made, axes = figure(260, 2)
    charts = (
        (MILLI * residual, "rows in metres: residual [mm]", (0.1, 10_000.0)),
        (focal * residual / depth, "divided by the depth: residual [px]", (LEAST, MOST)),
    )
    edges = np.geomspace(4.0, 100.0, 9)
    for axis, (values, title, limits) in zip(axes, charts, strict=True):
        axis.plot(depth, np.clip(values, *limits), ".", color=GOOD, markersize=4, label="a feature")
        group = np.digitize(depth, edges)
        used = [k for k in range(1, len(edges)) if np.count_nonzero(group == k) >= 5]
        middles = [float(np.median(values[group == k])) for k in used]
        places = [float(np.sqrt(edges[k - 1] * edges[k])) for k in used]
        axis.plot(places, middles, "o-", color=BAD, linewidth=2, markersize=5, label="median at this depth")
        log_axis(axis.xaxis, *DEPTHS, COARSE)
        log_axis(axis.yaxis, *limits)
        finish(axis, title, "depth Z [m]", "", "lower right", boxed=True)
    return made


def residuals_chart(axis: Axes, depth: Array, residual: Array, limit: float | None) -> None:
    """Residual of each feature by depth; the line is the limit at which a weight becomes ½ or zero."""
    used = np.isfinite(residual)
    heavy = used & (residual <= (np.inf if limit is None else limit))
    shown = np.where(used, np.clip(residual, LEAST, MOST), LEAST)
    for chosen, look, colour, words in (
        (heavy, ".", GOOD, "weight of ½ or more"),
        (used & ~heavy, ".", BAD, "weight below ½"),
        (~used, "|", PALE, "not used"),
    ):
        axis.plot(depth[chosen], shown[chosen], look, color=colour, markersize=4, label=words)
    if limit is not None:
        axis.axhline(limit, color=DARK, linewidth=1, linestyle=":")
    log_axis(axis.xaxis, *DEPTHS, COARSE)
    log_axis(axis.yaxis, 0.8 * LEAST, MOST)
    title = "residual of each feature's eight rows"
    finish(axis, title, "depth [m]", "residual [px]", boxed=True)


def ellipse_chart(
    axis: Axes, each: Array, weight: Array, t: Array, covariance: Array, t_reference: Array, reference: str
) -> None:
    """Errors of t_cp in the x-z plane, millimetres: each feature alone, and all features with an ellipse.

    Parameters
    ----------
    each : (N, 3) translation of each feature alone; weight : (N,); t, t_reference : (3,), metres.
    covariance : (3, 3) of t, m²; the ellipse is drawn at two standard deviations.
    """
    dots = MILLI * (each - t_reference)[..., [0, 2]]
    middle = MILLI * (t - t_reference)[..., [0, 2]]
    variances, directions = np.linalg.eigh(MILLI**2 * covariance[np.ix_([0, 2], [0, 2])])
    lengths = 4.0 * np.sqrt(np.maximum(variances, 0.0))  # two standard deviations to each side
    light = ~(weight >= 0.5)
    for chosen, colour in ((light, PALE), (~light, GOOD)):
        axis.plot(*dots[chosen].T, ".", color=colour, markersize=2.5)
    angle = float(np.degrees(np.arctan2(directions[1, 1], directions[0, 1])))
    inside = (*to_rgb(FIFTH), 0.35)
    short, long = lengths.tolist()
    centre = tuple(middle.tolist())
    axis.add_patch(Ellipse(centre, long, short, angle=angle, facecolor=inside, edgecolor=DARK))
    axis.plot(*middle, "o", color=FIFTH, markeredgecolor=DARK, markersize=6, label="all together, 2σ")
    axis.plot(0, 0, "+", color=BAD, markersize=14, markeredgewidth=2, label=reference)
    half = room(1.3 * (float(np.abs(middle).max()) + 0.5 * float(lengths.max())), steps=COARSE, least=0.5)
    ticks = [-half, -half / 2, 0, half / 2, half]
    axis.set(xlim=(-half, half), ylim=(-half, half))
    for side in (axis.xaxis, axis.yaxis):
        numbers_at(side, ticks)
        side.set_major_formatter("{x:g}")
    finish(axis, "t_cp relative to the cross, from above", "x, right [mm]", "z, forward [mm]", boxed=True)


def variants_figure(tables: dict[str, dict[str, Array]]) -> Figure:
    """Error of each frame by variant, millimetres on a logarithmic scale; each table has its own axis."""
    made, axes = figure(290, len(tables))
    for axis, (title, errors) in zip(axes, tables.items(), strict=True):
        for row, (name, values) in enumerate(errors.items()):
            spread = np.linspace(0.05, 0.35, len(values))
            axis.plot(values, row + spread, ".", color=GOOD, markersize=4)
            median = float(np.median(values))
            axis.plot([median, median], [row, row + 0.4], color=BAD, linewidth=3)
            words = f"{name}: {median:.1f} mm"
            axis.text(0.01, row - 0.15, words, fontsize=SMALL_SIZE, transform=axis.get_yaxis_transform())
        axis.set_xscale("log")
        log_axis(axis.xaxis, *axis.get_xlim())
        axis.set_yticks([])
        axis.set_ylim(len(errors) - 0.5, -0.8)
        finish(axis, title, "error of t [mm]; orange: median")
    return made


def bias_figure(noises: Array, tables: dict[str, list[dict[str, Array]]], t_true: Array) -> Figure:
    """Chart of each table: mean length of the answers by noise, with a band of one standard deviation.

    Parameters
    ----------
    noises : (K,) pixels. tables : by chart title, one dictionary of answers (S, 3) per noise. t_true : (3,).
    """
    made, axes = figure(260, len(tables))
    for axis, (title, table) in zip(axes, tables.items(), strict=True):
        for name, colour in zip(table[0], (BAD, GOOD), strict=True):
            off = np.array([length_errors(row[name], t_true) for row in table])  # (K, S), %
            mean = off.mean(axis=1)
            spread = standard_deviation(off.T)
            axis.fill_between(noises, mean - spread, mean + spread, color=colour, alpha=0.2, linewidth=0)
            axis.plot(noises, mean, ".-", color=colour, linewidth=1.5, label=name)
        axis.axhline(0.0, color=DARK, linewidth=1, linestyle=":")
        axis.set_ylim(-6.0, 2.0)
        finish(axis, f"length of the step, {title}", "noise [px]", "error [%]", "lower left")
    return made


def lengths_figure(ratios: dict[str, Array], height: int = 200) -> Figure:
    """Ratio of the length of each frame's step to the true length, by the treatment of the matches."""
    made, (axis,) = figure(height)
    axis.axhline(1.0, color=DARK, linewidth=1, linestyle=":")
    for (name, values), colour in zip(ratios.items(), (BAD, GOOD, FIFTH), strict=False):
        axis.plot(np.arange(1, len(values) + 1), values, color=colour, linewidth=1.5, label=name)
    round_limits(axis.yaxis)
    finish(axis, "length of the step, as a share of the true length", "frame")
    return made
