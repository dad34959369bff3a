"""Figures of chapter 4: answers of single features, residuals by depth, the joint answer and covariance."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse

from vo_lib.geometry.types import Array

from ..colours import BAD, DARK, FIFTH, GOOD, PALE
from ..drawing import COARSE, SMALL_SIZE, figure, finish, log_axis, room, round_limits

DEPTHS, DISTANCES = (2.0, 200.0), (1e-3, 100.0)  # metres shown
LEAST, MOST = 0.01, 100.0  # pixels shown of a residual
MILLI = 1e3


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
    dots, middle = (MILLI * (v - t_reference)[..., [0, 2]] for v in (each, t))
    axes, directions = np.linalg.eigh(MILLI**2 * covariance[np.ix_([0, 2], [0, 2])])
    lengths = 4.0 * np.sqrt(np.maximum(axes, 0.0))
    light = ~(weight >= 0.5)
    for chosen, colour in ((light, PALE), (~light, GOOD)):
        axis.plot(*dots[chosen].T, ".", color=colour, markersize=2.5)
    angle = float(np.degrees(np.arctan2(directions[1, 1], directions[0, 1])))
    inside = (*to_rgb(FIFTH), 0.35)
    size = float(lengths[1]), float(lengths[0])
    axis.add_patch(Ellipse(tuple(middle.tolist()), *size, angle=angle, facecolor=inside, edgecolor=DARK))
    axis.plot(*middle, "o", color=FIFTH, markeredgecolor=DARK, markersize=6, label="all together, 2σ")
    axis.plot(0, 0, "+", color=BAD, markersize=14, markeredgewidth=2, label=reference)
    half = room(1.3 * (float(np.abs(middle).max()) + 0.5 * float(lengths.max())), steps=COARSE, least=0.5)
    ticks = [-half, -half / 2, 0, half / 2, half]
    axis.set(xlim=(-half, half), ylim=(-half, half))
    for side in (axis.xaxis, axis.yaxis):
        side.set_ticks(ticks, labels=[f"{tick:g}" for tick in ticks])
    finish(axis, "t_cp relative to the cross, from above", "x, right [mm]", "z, forward [mm]", boxed=True)


def by_depth_figure(
    depth: Array, distance: Array, labels: tuple[str, str], title: str, factor: float | None = None
) -> Figure:
    """Distances (N,) over depths (N,), metres, as dots on logarithmic axes, and the line `factor` · Z²."""
    made, (axis,) = figure(260)
    if factor is None:  # the line is the median of the distances between 5 and 80 m
        near = (depth > 5) & (depth < 80)
        factor = float(np.median(distance[near] / depth[near] ** 2)) if near.any() else 1e-4
    Z = np.array(DEPTHS)
    axis.plot(depth, np.clip(distance, *DISTANCES), ".", color=GOOD, markersize=4, label=labels[0])
    axis.plot(Z, factor * Z**2, color=BAD, linewidth=1.5, label=labels[1])
    log_axis(axis.xaxis, *DEPTHS, COARSE)
    log_axis(axis.yaxis, *DISTANCES)
    finish(axis, f"{title} [m]", "depth Z [m]", "", "upper left")
    return made


def variants_figure(tables: dict[str, dict[str, Array]]) -> Figure:
    """Error of each frame by variant, millimetres on a logarithmic scale; each table has its own axis."""
    made, axes = figure(290, len(tables))
    for axis, (title, errors) in zip(axes, tables.items(), strict=True):
        for row, (name, values) in enumerate(errors.items()):
            spread = np.linspace(0.05, 0.35, len(values))
            axis.plot(values, row + spread, ".", color=GOOD, markersize=4)
            axis.plot([np.median(values)] * 2, [row, row + 0.4], color=BAD, linewidth=3)
            words = f"{name}: {np.median(values):.1f} mm"
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
            lengths = np.array([np.linalg.norm(row[name], axis=1) for row in table])
            off = 100.0 * (lengths / np.linalg.norm(t_true) - 1.0)
            mean = off.mean(axis=1)
            spread = off.std(axis=1)
            axis.fill_between(noises, mean - spread, mean + spread, color=colour, alpha=0.2, linewidth=0)
            axis.plot(noises, mean, ".-", color=colour, linewidth=1.5, label=name)
        axis.axhline(0.0, color=DARK, linewidth=1, linestyle=":")
        axis.set_ylim(-6.0, 2.0)
        finish(axis, f"length of the step, {title}", "noise [px]", "error [%]", "lower left")
    return made


def lengths_figure(lengths: dict[str, Array], height: int = 200) -> Figure:
    """Ratio of the length of each frame's step to the true length, by the treatment of the matches."""
    made, (axis,) = figure(height)
    axis.axhline(1.0, color=DARK, linewidth=1, linestyle=":")
    for (name, values), colour in zip(lengths.items(), (BAD, GOOD, FIFTH), strict=False):
        axis.plot(np.arange(1, len(values) + 1), values, color=colour, linewidth=1.5, label=name)
    round_limits(axis.yaxis)
    finish(axis, "length of the step, as a share of the true length", "frame")
    return made
