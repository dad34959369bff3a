"""Figures of the appendix: steps by depth, rows, estimated terms, and maps and arrows of errors over the image."""

from __future__ import annotations

import math
from collections.abc import Mapping

import cv2
import numpy as np
from matplotlib import colormaps
from matplotlib.figure import Figure

from vo_lib.geometry.camera import StereoCamera
from vo_lib.geometry.types import Array, Image
from vo_lib.kit.rig import LENS_PX, RIG_FAULTS, field_at, lens_shapes

from ..colours import BAD, DARK, GOOD, PALE
from ..drawing import DPI, WIDTH, caption, figure, finish, photo, room, round_limits
from .rig_estimate import errors_of_rig

MAP_HEIGHT = 150
BANDS = 10  # colours from no error to the largest
MOST_DOTS = 1500  # rows drawn of a sequence


def steps_figure(Z: Array, seen: Mapping[str, Array]) -> Figure:
    """Measured length of a step of 1 m by the depth of the point Z (N,), metres.

    seen : the measured lengths (N,), metres, by the words for the disparity error.
    """
    made, (axis,) = figure(210)
    axis.axhline(1.0, color=DARK, linewidth=1, linestyle=":", label="true")
    for (name, values), colour in zip(seen.items(), (GOOD, BAD), strict=False):
        axis.plot(Z, values, ".", color=colour, markersize=5, label=f"disparities {name}")
    farthest = float(np.quantile(Z, 0.97))
    axis.set_xlim(0, farthest)
    within = np.concatenate([values[farthest >= Z] for values in seen.values()])
    middle = float(np.median(within))
    spread = max(1.1 * float(np.abs(within - middle).max()), 0.05)
    axis.set_ylim(middle - spread, middle + spread)
    round_limits(axis.yaxis)
    finish(axis, "measured length of a step of 1 m [m]", "depth of the point [m]")
    return made


def rows_figure(fits: Mapping[str, tuple[Array, Array, float]]) -> Figure:
    """Row differences over x, a chart for each sequence: x (N,), rows (N,) and the fitted roll, pixels."""
    made, axes = figure(220, len(fits))
    for axis, (name, (x, rows, roll)) in zip(axes, fits.items(), strict=True):
        some = np.linspace(0, len(x) - 1, min(len(x), MOST_DOTS)).astype(int)
        axis.plot(x[some], rows[some], ".", color=PALE, markersize=3, label="rows")
        ends = np.array([x.min(), x.max()])
        axis.plot(ends, np.median(rows) - roll * ends, color=GOOD, linewidth=2, label=f"roll {roll:+.2f} px")
        axis.set_ylim(-0.75, 0.75)
        finish(axis, f"{name}: row left minus row right [px]", "x")
    return made


def terms_figure(learnt: Array, true: tuple[float, float], y: Array) -> Figure:
    """Estimates (S, 2) of a shift and of a y² term, pixels, and the disparity errors that they mean.

    true : both true sizes. y : normalised rows of the image, from the upper to the lower edge.
    """
    made, (pairs, fields) = figure(220, 2)
    pairs.plot(*learnt.T, "o", color=GOOD, markersize=6, label="a seed")
    pairs.plot(*true, "+", color=DARK, markersize=12, markeredgewidth=2, label="true")
    round_limits(pairs.xaxis, pairs.yaxis)
    finish(pairs, "both estimates", "shift a [px]", "y² term b [px]")
    for shift, other in learnt:
        fields.plot(y, shift + other * y**2, color=GOOD, linewidth=1.2)
    fields.get_lines()[0].set_label("estimated, a line for each seed")
    fields.plot(y, true[0] + true[1] * y**2, color=DARK, linewidth=2, linestyle=":", label="true")
    round_limits(fields.yaxis)
    finish(fields, "error of the disparity [px]", "y, from the upper to the lower edge")
    return made


def shrunk_figure(used: Mapping[str, tuple[Array, Array]]) -> Figure:
    """For each rig, its estimated errors (2,) and the part of them that is used, pixels."""
    made, axes = figure(200, len(used))
    for axis, (name, (estimate, kept)) in zip(axes, used.items(), strict=True):
        places = np.arange(len(estimate))
        axis.axhline(0.0, color=DARK, linewidth=1)
        axis.bar(places - 0.18, estimate, 0.34, color=PALE, label="estimated")
        axis.bar(places + 0.18, kept, 0.34, color=GOOD, label="used")
        axis.set_xticks(places, ["shift", "y²"])
        round_limits(axis.yaxis)
        finish(axis, f"{name} rig: errors [px]")
    return made


def image_grid(camera: StereoCamera, columns: int = 13, rows: int = 5) -> Array:
    """Normalised positions (rows · columns, 2) of a grid over the left image."""
    u, v = np.meshgrid(np.linspace(0, camera.width, columns), np.linspace(0, camera.height, rows))
    return camera.normalise(np.stack([u, v], axis=-1).reshape(-1, 2))


def field_maps(image: Image, camera: StereoCamera, fields: dict[str, Array]) -> Image:
    """Maps of errors (ERROR_COUNT,) by name: disparities on top, rows below; red: above 0, blue: below 0."""
    grid = image_grid(camera, 41, 13).T
    errors = {name: field_at(of_rig, *grid).reshape(2, 13, 41) for name, of_rig in fields.items()}
    limit = room(max(float(np.abs(error).max()) for error in errors.values()), least=0.1)
    light = 0.55 + 0.45 * photo(image, WIDTH // len(errors)) / 255.0

    def one(words: str, error: Array) -> Image:
        share = np.round(BANDS * cv2.resize(error / limit, light.shape[1::-1])) / BANDS
        coloured = np.asarray(255 * light * colormaps["RdBu_r"](0.5 + 0.5 * share)[:, :, 2::-1], np.uint8)
        words = f"{words}: {error.min():.2f} to {error.max():.2f} px"
        return caption(photo(coloured, light.shape[1], MAP_HEIGHT), words)

    disparities = [one(f"disparities, {name}", error[0]) for name, error in errors.items()]
    rows = [one(f"rows, {name}", error[1]) for name, error in errors.items()]
    return np.vstack([np.hstack(disparities), np.hstack(rows)])


def arrows_figure(camera: StereoCamera, moved: dict[str, tuple[Array, ...]]) -> Figure:
    """A chart per title: displacements (2, N) of the `image_grid` as arrows, the last array in blue."""
    points = image_grid(camera)
    width = min(len(moved), 4)
    lines = math.ceil(len(moved) / 4)
    made = Figure(figsize=(WIDTH / DPI, lines * 130 / DPI), dpi=DPI, layout="constrained")
    for axis, (title, parts) in zip(made.subplots(lines, width).flat, moved.items(), strict=True):
        axis.plot(*points.T, ".", color=PALE, markersize=1.5)
        for number, arrows in enumerate(parts, start=1):
            colour = GOOD if number == len(parts) else PALE
            scale = {"scale_units": "xy", "scale": 6.0 * np.abs(parts[0]).max()}
            axis.quiver(*points.T, *arrows, color=colour, angles="xy", width=0.006, **scale)
        axis.set(xlim=(-1.1, 1.1), ylim=(0.46, -0.46), xticks=[], yticks=[], aspect="equal")
        axis.set_title(title, fontsize=8, loc="left")
    return made


def faults_figure(camera: StereoCamera) -> Figure:
    """Displacements of the points in the right image, one chart per fault."""
    moved: dict[str, tuple[Array, ...]] = {}
    for name, (columns, rows, _) in RIG_FAULTS.items():
        if not name.startswith(("columns", "rows")):  # those are single terms
            title = f"{name}\ndisparity: {_terms(columns)}; row: {_terms(rows)}"
            moved[title] = (-field_at(errors_of_rig({name: 1.0}), *image_grid(camera).T),)
    return arrows_figure(camera, moved)


def _terms(shape: Mapping[str, float]) -> str:
    """The terms of a shape with their signs, or "none"."""
    signed = [f"−{term}" if factor < 0 else term for term, factor in shape.items()]
    return " ".join(signed) or "none"


def lens_figure(camera: StereoCamera) -> Figure:
    """Displacements by Brown's p1, p2, k1, k2; blue: component across epipolar lines of a straight drive."""
    points = image_grid(camera).T
    across = points[::-1] * [[1], [-1]] / np.maximum(np.linalg.norm(points, axis=0), 1e-6)
    moved: dict[str, tuple[Array, ...]] = {}
    for name, shape in zip(LENS_PX, lens_shapes(points), strict=True):
        part = across * np.sum(across * shape, axis=0)
        share = np.linalg.norm(part, axis=0).max() / np.linalg.norm(shape, axis=0).max()
        moved[f"{name}: {share:.0%} of the largest arrow across"] = shape, part
    return arrows_figure(camera, moved)
