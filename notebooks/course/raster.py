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
from matplotlib.backends.backend_agg import FigureCanvasAgg, RendererAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray

from vo_lib.geometry.types import Image

from .memory import Memory

LAYERS = 200  # that are kept, each a strip of about 50 kB
TEXTS = 200  # that are kept for each size of figures, each of about 5 kB
SIZES = 12  # of figures
# Settings of a style sheet that change the look of texts and of an axis.
FONTS = ("font.family", "font.sans-serif")
STYLE = (
    *FONTS,
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


@dataclass(frozen=True, eq=False)
class Words:
    """A text without a background: its place, x to the right and y up, and RGBA pixels from the bottom up."""

    x: int
    y: int
    pixels: NDArray[np.uint8]


class _Renderer(RendererAgg):
    """Agg's renderer, but a text is drawn once for each place, then copied: a third of the time of a chart."""

    def __init__(self, width: float, height: float, dpi: float):
        super().__init__(width, height, dpi)  # type: ignore[no-untyped-call]
        self._words: Memory[Words] = Memory(TEXTS)

    # A function of the base class, which is without types.
    def draw_text(  # type: ignore[no-untyped-def]
        self, gc, x, y, s, prop, angle, ismath=False, mtext=None
    ) -> None:
        def draw() -> Words:
            alone = RendererAgg(self.width, self.height, self.dpi)  # type: ignore[no-untyped-call]
            alone.draw_text(gc, x, y, s, prop, angle, ismath, mtext)  # type: ignore[no-untyped-call]
            pixels = np.asarray(alone.buffer_rgba())  # type: ignore[no-untyped-call]
            rows = _extent(pixels[:, :, 3].max(axis=1) > 0)
            columns = _extent(pixels[:, :, 3].max(axis=0) > 0)
            return Words(columns.start, int(self.height) - rows.stop, pixels[rows, columns][::-1].copy())

        if gc.get_clip_rectangle() is not None or gc.get_clip_path()[0] is not None:
            super().draw_text(gc, x, y, s, prop, angle, ismath, mtext)  # type: ignore[no-untyped-call]
            return
        look = hash(prop), angle, ismath, gc.get_rgb(), gc.get_alpha(), gc.get_antialiased()
        words = self._words.get((s, x, y, *look), draw)
        if words.pixels.size:
            plain = self.new_gc()
            self.draw_image(plain, words.x, words.y, words.pixels)
            plain.restore()


class _Canvas(FigureCanvasAgg):
    """A canvas whose renderer is shared by all figures of a size, since it knows the sizes of their texts."""

    def get_renderer(self) -> _Renderer:
        width, height = self.figure.bbox.size
        size = width, height, self.figure.dpi
        return _renderers.get((*size, *_style(FONTS)), lambda: _Renderer(*size))


_layers: Memory[Layer] = Memory(LAYERS)
_renderers: Memory[_Renderer] = Memory(SIZES)


def raster(chart: Figure) -> Image:
    """A figure as a BGR picture (H, W, 3), drawn by matplotlib alone."""
    with _drawing:
        canvas = FigureCanvasAgg(chart)
        canvas.draw()  # type: ignore[no-untyped-call]
        return _bgr(np.asarray(canvas.buffer_rgba()))  # type: ignore[no-untyped-call]


def fast_raster(chart: Figure) -> Image:
    """A figure as a BGR picture (H, W, 3), several times faster than `raster` if its axes were drawn before.

    Most of matplotlib's time goes into the numbers and names of the axes and into other texts, which seldom
    change while a control moves. So they are kept as pixels; matplotlib draws the rest. The picture is the one
    of `raster`, but that the axes are below all data.
    """
    if not all(map(_is_plain, chart.axes)) or chart.get_layout_engine() is not None:
        return raster(chart)
    with _drawing:
        canvas = _Canvas(chart)
        renderer = canvas.get_renderer()
        hidden: list[Artist] = [chart.patch]  # white would cover the layers
        layers = []
        for axes in chart.axes:
            axes.apply_aspect()  # may change the limits
            hidden.append(axes.patch)
            if axes.axison:
                for side in (axes.xaxis, axes.yaxis):
                    hidden.append(side)
                    layers.append(_layer(renderer, side))
        pixels = np.asarray(renderer.buffer_rgba())  # type: ignore[no-untyped-call]
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
    """Draw all axes and texts anew from now on."""
    _layers.clear()
    _renderers.clear()


def _is_plain(axes: Axes) -> bool:
    """Whether the look of an axis depends only on what `_look` knows."""
    return axes.name == "rectilinear" and axes.get_axes_locator() is None


def _layer(renderer: _Renderer, side: Axis) -> Layer:
    """One side of an axis as pixels, from memory if it was drawn before."""

    def draw() -> Layer:
        # Without a memory of texts: these are kept with the layer.
        plain = RendererAgg(renderer.width, renderer.height, renderer.dpi)  # type: ignore[no-untyped-call]
        pixels = np.asarray(plain.buffer_rgba())  # type: ignore[no-untyped-call]
        pixels[...] = 255
        side.draw(plain)
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
    parts: list[object] = [side is axes.xaxis, side.get_scale(), *side.get_view_interval()]
    parts += [*page.bbox.bounds, page.dpi, *axes.bbox.bounds, side.get_visible(), side.get_label_position()]
    parts += [label.get_text(), label.get_color(), hash(label.get_fontproperties())]
    parts += [str(side.get_tick_params("major")), str(side.get_tick_params("minor"))]
    parts += _style(STYLE)
    for places, formatter in (
        (side.get_majorticklocs(), side.get_major_formatter()),
        (side.get_minorticklocs(), side.get_minor_formatter()),
    ):
        numbers = np.ravel(places).tolist()
        parts += [len(numbers), *numbers, *formatter.format_ticks(numbers), formatter.get_offset()]
    return tuple(parts)


def _style(names: tuple[str, ...]) -> list[str]:
    """The values of settings of a style sheet."""
    style = cast(Mapping[str, object], rcParams)
    return [str(style[name]) for name in names]


def _extent(marked: NDArray[np.bool_]) -> slice:
    """From the first to the last True."""
    places = np.flatnonzero(marked)
    return slice(int(places[0]), int(places[-1]) + 1) if len(places) else slice(0)


def _bgr(pixels: NDArray[np.uint8]) -> Image:
    return np.ascontiguousarray(pixels[:, :, 2::-1])
