"""Matplotlib's figures as pixels; for panels, fast enough to follow the drag of a control."""

from __future__ import annotations

import threading
from collections.abc import Hashable, Mapping
from dataclasses import dataclass
from typing import cast

import numpy as np
from matplotlib import rcParams
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray

from vo_lib.geometry.types import Image

from .memory import Memory

LAYERS = 200  # that are kept, each a strip of about 50 kB
# Settings of a style sheet that change the look of an axis.
STYLE = (
    "font.family",
    "font.sans-serif",
    "xtick.color",
    "ytick.color",
    "xtick.labelcolor",
    "ytick.labelcolor",
)

# Text layout of matplotlib shares state between threads: only one thread draws at a time.
_drawing = threading.RLock()


@dataclass(frozen=True, eq=False)
class Layer:
    """The numbers, marks and name of one side of an axis, on white: RGBA pixels and their place."""

    rows: slice
    columns: slice
    pixels: NDArray[np.uint8]


_layers: Memory[Layer] = Memory(LAYERS)


def raster(chart: Figure) -> Image:
    """A figure as a BGR picture (H, W, 3), drawn by matplotlib alone."""
    with _drawing:
        canvas = FigureCanvasAgg(chart)
        canvas.draw()  # type: ignore[no-untyped-call]
        return _bgr(_pixels(canvas))


def fast_raster(chart: Figure) -> Image:
    """A figure as a BGR picture (H, W, 3), several times faster than `raster` if its axes were drawn before.

    Most of matplotlib's time goes into the numbers and names of the axes, which seldom change while a control
    moves. So they are kept as pixels; matplotlib draws the rest on them. The picture is the one of `raster`,
    but that the axes are below all data.
    """
    if not all(map(_is_plain, chart.axes)) or chart.get_layout_engine() is not None:
        return raster(chart)
    with _drawing:
        canvas = FigureCanvasAgg(chart)
        renderer = canvas.get_renderer()  # type: ignore[no-untyped-call]
        hidden: list[Artist] = [chart.patch]  # white would cover the layers
        layers = []
        for axes in chart.axes:
            axes.apply_aspect()  # may change the limits
            hidden.append(axes.patch)
            if axes.axison:
                for side in (axes.xaxis, axes.yaxis):
                    hidden.append(side)
                    layers.append(_layer(canvas, side))
        pixels = _pixels(canvas)
        pixels[...] = 255
        for layer in layers:
            below = pixels[layer.rows, layer.columns]
            np.minimum(below, layer.pixels, out=below)  # dark on white
        shown = [artist for artist in hidden if artist.get_visible()]
        for artist in shown:
            artist.set_visible(False)
        chart.draw(renderer)
        for artist in shown:
            artist.set_visible(True)
        return _bgr(pixels)


def forget_layers() -> None:
    """Draw all axes anew from now on."""
    _layers.clear()


def _is_plain(axes: Axes) -> bool:
    """Whether the look of an axis depends only on what `_look` knows."""
    return axes.name == "rectilinear" and axes.get_axes_locator() is None


def _layer(canvas: FigureCanvasAgg, side: Axis) -> Layer:
    """One side of an axis as pixels, from memory if it was drawn before."""

    def draw() -> Layer:
        renderer = canvas.get_renderer()  # type: ignore[no-untyped-call]
        pixels = _pixels(canvas)
        pixels[...] = 255
        side.draw(renderer)
        dark = pixels.min(axis=2) < 255
        rows = _extent(dark.any(axis=1))
        columns = _extent(dark.any(axis=0))
        return Layer(rows, columns, pixels[rows, columns].copy())

    return _layers.get(_look(side), draw)


def _look(side: Axis) -> Hashable:
    """All that the pixels of one side of an axis depend on."""
    axes = side.axes
    page = axes.figure.figure
    label = side.get_label()
    style = cast(Mapping[str, object], rcParams)
    parts: list[object] = [side is axes.xaxis, side.get_scale(), *side.get_view_interval()]
    parts += [*page.bbox.bounds, page.dpi, *axes.bbox.bounds, side.get_visible(), side.get_label_position()]
    parts += [label.get_text(), label.get_color(), hash(label.get_fontproperties())]
    parts += [str(side.get_tick_params("major")), str(side.get_tick_params("minor"))]
    parts += [str(style[name]) for name in STYLE]
    for places, formatter in (
        (side.get_majorticklocs(), side.get_major_formatter()),
        (side.get_minorticklocs(), side.get_minor_formatter()),
    ):
        numbers = np.ravel(places).tolist()
        parts += [len(numbers), *numbers, *formatter.format_ticks(numbers), formatter.get_offset()]
    return tuple(parts)


def _extent(marked: NDArray[np.bool_]) -> slice:
    """From the first to the last True."""
    places = np.flatnonzero(marked)
    return slice(int(places[0]), int(places[-1]) + 1) if len(places) else slice(0)


def _pixels(canvas: FigureCanvasAgg) -> NDArray[np.uint8]:
    """The pixels (H, W, 4) of a canvas themselves, not a copy."""
    return np.asarray(canvas.buffer_rgba())  # type: ignore[no-untyped-call]


def _bgr(pixels: NDArray[np.uint8]) -> Image:
    return np.ascontiguousarray(pixels[:, :, 2::-1])
