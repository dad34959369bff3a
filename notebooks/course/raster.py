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
from matplotlib.transforms import Bbox
from numpy.typing import NDArray

from vo_lib.geometry.types import Image

from .memory import Memory

LAYERS = 200  # that are kept, each a strip of about 50 kB
TEXTS = 400  # that are kept for each size of figures, each of about 5 kB
SIZES = 12  # of figures
WHITE = 0xFFFFFFFF  # a pixel of RGBA bytes as one number
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
        self._sheet = RendererAgg(width, height, dpi)  # type: ignore[no-untyped-call]
        self._empty = _whole(self._sheet)[0, 0]

    # A function of the base class, which is without types.
    def draw_text(  # type: ignore[no-untyped-def]
        self, gc, x, y, s, prop, angle, ismath=False, mtext=None
    ) -> None:
        def draw() -> Words:
            sheet = self._sheet
            sheet.clear()  # type: ignore[no-untyped-call]
            sheet.draw_text(gc, x, y, s, prop, angle, ismath, mtext)  # type: ignore[no-untyped-call]
            rows, columns = _extent(_whole(sheet) != self._empty)
            pixels = np.asarray(sheet.buffer_rgba())  # type: ignore[no-untyped-call]
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
        pixels = np.asarray(renderer.buffer_rgba())  # type: ignore[no-untyped-call]
        pixels[...] = 255
        _draw_side(renderer, side)
        rows, columns = _extent(_whole(renderer) != WHITE)
        return Layer(rows, columns, pixels[rows, columns].copy())

    return _layers.get(_look(side), draw)


def _draw_side(renderer: _Renderer, side: Axis) -> None:
    """Draw one side of an axis as `side.draw` does, in a third of the time.

    Matplotlib makes a tick for each number, and lays out each number three times. Here, one tick moves from
    number to number. It cannot do all that ticks can: then matplotlib draws the side.
    """
    axes = side.axes
    inner = "bottom" if side is axes.xaxis else "left"
    (tick,) = side.get_major_ticks(1)
    places = np.ravel(side.get_majorticklocs())
    formatter = side.get_major_formatter()
    numbers = formatter.format_ticks(places.tolist())
    has_one_tick = len(side.majorTicks) == 1 and len(np.ravel(side.get_minorticklocs())) == 0
    has_one_row = tick.label1.get_visible() and not tick.label2.get_visible()
    is_usual = side.get_visible() and side.get_label_position() == inner and not formatter.get_offset()
    if not (has_one_tick and has_one_row and is_usual):
        side.draw(renderer)
        return
    scale = side.get_transform()
    low, high = sorted(scale.transform(np.array(side.get_view_interval())).tolist())
    tolerance = 1e-10 * (high - low)  # as in matplotlib
    boxes = []
    for place, number, at in zip(places.tolist(), numbers, scale.transform(places).tolist(), strict=True):
        if low - tolerance <= at <= high + tolerance:
            tick.update_position(place)
            tick.label1.set_text(number)
            tick.draw(renderer)
            boxes.append(tick.label1.get_window_extent(renderer))
    # The numbers are farther out than the marks, whose extent takes long.
    numbers_box = Bbox.union(boxes or [axes.spines[inner].get_window_extent()])
    pad = side.labelpad * axes.figure.figure.dpi / 72
    label = side.get_label()
    x, y = label.get_position()
    if inner == "bottom":
        label.set_position((x, numbers_box.y0 - pad))
    else:
        label.set_position((numbers_box.x0 - pad, y))
    label.draw(renderer)


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


def _whole(renderer: RendererAgg) -> NDArray[np.uint32]:
    """A renderer's pixels (H, W), each as one number: four times faster to search than its bytes."""
    pixels = np.asarray(renderer.buffer_rgba())  # type: ignore[no-untyped-call]
    return pixels.view(np.uint32)[:, :, 0]


def _extent(marked: NDArray[np.bool_]) -> tuple[slice, slice]:
    """The rows and the columns of the smallest rectangle with all True of (H, W)."""
    return _range(np.asarray(marked.any(axis=1))), _range(np.asarray(marked.any(axis=0)))


def _range(marked: NDArray[np.bool_]) -> slice:
    """From the first to the last True."""
    places = np.flatnonzero(marked)
    return slice(int(places[0]), int(places[-1]) + 1) if len(places) else slice(0)


def _bgr(pixels: NDArray[np.uint8]) -> Image:
    return np.ascontiguousarray(pixels[:, :, 2::-1])
