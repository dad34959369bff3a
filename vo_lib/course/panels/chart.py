"""Charts that answer fast: axes are drawn once and kept, each picture puts its own data on a copy of them.

matplotlib takes 50 ms to draw one axis with its numbers and names, and 3 ms to draw the data.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable
from dataclasses import dataclass

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg

from ...core.types import Image
from .data import Memory
from .style import DRAWING, FONT_SIZE, MARGIN, TITLE_SIZE, WIDTH, Place, figure, finish

Draw = Callable[[Axes], None]

COARSE = (1.0, 2.0, 5.0)  # mantissas of round numbers
FINE = (1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0)


@dataclass(frozen=True)
class Chart:
    """A chart in two parts: data, which change with every move of a slider, and axes, which seldom do.

    Attributes
    ----------
    key : the chart's name and all that `frame` depends on.
    put : draws the data.
    frame : sets limits, ticks, names and legend, after `put`; it must not look at the data.
    """

    key: tuple[Hashable, ...]
    put: Draw
    frame: Draw

    def draw(self, axis: Axes) -> None:
        """The chart on an axis of a figure of one's own."""
        self.put(axis)
        self.frame(axis)

    def picture(self, height: int, width: int = WIDTH) -> Image:
        """The chart as a picture of `width` × `height` pixels."""
        return _plates.get((self.key, height, width), lambda: _Plate(self, height, width)).picture(self.put)


def beside(charts: list[Chart], height: int, shares: tuple[float, ...] = ()) -> Image:
    """Charts in a row of the common width; `shares` are the relative widths of the axes, as in `figure`."""
    relative = np.array(shares or (1.0,) * len(charts))
    rim = MARGIN.left + MARGIN.right
    room = (WIDTH - len(charts) * rim) * relative / relative.sum()
    ends = np.rint(np.cumsum(room + rim)).astype(int)
    widths = np.diff(ends, prepend=0).tolist()
    return np.concatenate([c.picture(height, w) for c, w in zip(charts, widths, strict=True)], axis=1)


def room(value: float, *, steps: tuple[float, ...] = COARSE, least: float = 0.0) -> float:
    """The smallest of the round numbers steps × 10ⁿ that is not below a value: limits that seldom change."""
    value = max(value, least, 1e-9)
    whole = 10.0 ** np.floor(np.log10(value))
    rounded = [float(whole * step) for step in (*steps, 10 * steps[0])]
    # Not a hair below: 0.3 is 0.30000000000000004 in some sums.
    return next(each for each in rounded if each >= value * (1 - 1e-9))


def millimetres_from_above(axis: Axes, half: float, title: str) -> None:
    """Limits, ticks, names and a boxed legend for errors of a translation in the x-z plane."""
    ticks = [-half, -half / 2, 0, half / 2, half]
    axis.set_xlim(-half, half)
    axis.set_ylim(-half, half)
    words = [f"{tick:g}".replace("-", "−") for tick in ticks]
    axis.set_xticks(ticks, words)
    axis.set_yticks(ticks, words)
    finish(axis, title, "x, right [mm]", "z, forward [mm]")
    boxed_legend(axis, "upper left")


def put_title(axis: Axes, words: str) -> None:
    """A title that changes with the data."""
    axis.annotate(
        words, (0, 1), (0, 6), xycoords="axes fraction", textcoords="offset points", fontsize=TITLE_SIZE
    )


def boxed_legend(axis: Axes, place: Place) -> None:
    """A legend that hides the data below it."""
    axis.legend(loc=place, fontsize=FONT_SIZE - 1, frameon=True, framealpha=0.9)


class _Plate:
    """An axis without data."""

    def __init__(self, chart: Chart, height: int, width: int):
        with DRAWING:
            made, (self._axis,) = figure(height, width=width)
            self._canvas = FigureCanvasAgg(made)
            data = self._add(chart.put)  # the legend is made of them
            chart.frame(self._axis)
            self._remove(data)
            self._axis.set_autoscale_on(False)
            self._spines = [each for each in self._axis.spines.values() if each.get_visible()]
            self._show_spines(False)
            self._canvas.draw()  # type: ignore[no-untyped-call]
            self._show_spines(True)  # with each picture: they belong above bars and lines
            self._blank = self._canvas.copy_from_bbox(made.bbox)  # type: ignore[no-untyped-call]
            self._on_top = self._framed_legend(height)
            self._legend = self._pixels()[self._on_top].copy()

    def picture(self, put: Draw) -> Image:
        """A copy with data."""
        with DRAWING:
            self._canvas.restore_region(self._blank)  # type: ignore[no-untyped-call]
            data = self._add(put)
            renderer = self._canvas.get_renderer()  # type: ignore[no-untyped-call]
            for artist in sorted([*data, *self._spines], key=lambda each: each.get_zorder()):
                artist.draw(renderer)
            self._remove(data)
            picture = np.ascontiguousarray(self._pixels())
        picture[self._on_top] = self._legend
        return picture

    def _show_spines(self, visible: bool) -> None:
        for spine in self._spines:
            spine.set_visible(visible)

    def _add(self, put: Draw) -> list[Artist]:
        """Put data on the axis and say which artists these are."""
        before = set(map(id, self._axis.get_children()))
        put(self._axis)
        return [each for each in self._axis.get_children() if id(each) not in before]

    def _remove(self, data: list[Artist]) -> None:
        for artist in data:
            artist.remove()
        self._axis.containers.clear()  # of bars
        self._axis.set_prop_cycle(None)

    def _pixels(self) -> Image:
        rgba = np.asarray(self._canvas.buffer_rgba())  # type: ignore[no-untyped-call]
        return rgba[:, :, 2::-1]

    def _framed_legend(self, height: int) -> tuple[slice, slice]:
        """Rows and columns of a legend in a box, which is to hide the data below it."""
        legend = self._axis.get_legend()
        if legend is None or not legend.get_frame_on():
            return slice(0), slice(0)
        box = legend.get_window_extent()
        return slice(height - round(box.y1), height - round(box.y0)), slice(round(box.x0), round(box.x1))


_plates: Memory[_Plate] = Memory(32)
