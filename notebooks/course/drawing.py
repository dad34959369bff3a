"""The style of all pictures of the course: one width, one font, one way to show them."""

from __future__ import annotations

import inspect
import textwrap
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any, Literal

import cv2
import numpy as np
from IPython.display import Code
from IPython.display import Image as Shown
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, LogLocator, NullLocator

from vo_lib.geometry.types import Array, Image

from .raster import fast_raster
from .raster import raster as raster

WIDTH = 980  # pixels of every picture
PHOTO_HEIGHT = 298  # of a photo of this width
HALF_HEIGHT = 150  # of a photo of half this width
DPI = 100
# Margins of an axis for its numbers and names, pixels.
LEFT = 60
RIGHT = 22  # half of the number 10000 at the end of an axis
ABOVE = 26
BELOW = 43

FONT_SIZE = 9.5
TITLE_SIZE = 10.0
SMALL_SIZE = 8.5  # of numbers and legends: 11.8 pixels
NAME_ROOM = 20  # height of a name above a dot, pixels
DOT_ROOM = 6  # height of a dot, pixels
TITLE_NAME = 28  # characters of a sequence's name in the title of a chart of half this width
CAPTION_SIZE = 0.48  # of words in photos, as a scale of OpenCV's font
# Round numbers are these numbers times a power of ten.
COARSE = (1.0, 2.0, 5.0)
FINE = (1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0)

# Half the time of OpenCV's default; the file is a tenth larger.
PNG = (cv2.IMWRITE_PNG_COMPRESSION, 1, cv2.IMWRITE_PNG_FILTER, cv2.IMWRITE_PNG_FILTER_SUB)
# Same look as PNG in a fifth of the time and half the bytes; without subsampling, coloured lines stay sharp.
JPEG_QUALITY = (cv2.IMWRITE_JPEG_QUALITY, 95)
JPEG_SAMPLING = (cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444)
JPEG = JPEG_QUALITY + JPEG_SAMPLING

Place = Literal["best", "upper left", "upper right", "lower left", "lower right", "center", "above", "none"]


def figure(
    height: int, columns: int = 1, widths: tuple[float, ...] = (), width: int = WIDTH
) -> tuple[Figure, list[Axes]]:
    """A figure of `width` × `height` pixels with axes side by side; `widths` are their relative widths.

    The margins are fixed: matplotlib's layout engines would double the drawing time.
    """
    picture = Figure(figsize=(width / DPI, height / DPI), dpi=DPI)
    shares = np.array(widths or (1.0,) * columns)
    inner = (width - len(shares) * (LEFT + RIGHT)) * shares / shares.sum()
    starts = np.cumsum(inner + LEFT + RIGHT) - inner - RIGHT
    bottom = BELOW / height
    high = (height - BELOW - ABOVE) / height
    axes = []
    for start, wide in zip(starts.tolist(), inner.tolist(), strict=True):
        axes.append(picture.add_axes((start / width, bottom, wide / width, high)))
    return picture, axes


def empty(axis: Axes) -> None:
    """Remove lines, legend and limits of an axis with linear scales, so that it can be drawn anew."""
    for line in axis.get_lines():
        line.remove()
    legend = axis.get_legend()
    if legend is not None:
        legend.remove()
    axis.relim()  # of no line
    axis.autoscale()


def finish(
    axis: Axes, title: str, x: str = "", y: str = "", legend: Place = "best", boxed: bool = False
) -> None:
    """Set the title, axis names with units, the common style, and a legend if lines have labels.

    A `boxed` legend hides the data behind it. The legend `above` is beside the title; `none` draws no legend.
    """
    # With a given height, matplotlib does not measure all tick labels.
    axis.set_title(title, fontsize=TITLE_SIZE, loc="left", y=1.0)
    axis.set_xlabel(x, fontsize=FONT_SIZE)
    axis.set_ylabel(y, fontsize=FONT_SIZE)
    axis.tick_params(labelsize=SMALL_SIZE)
    axis.spines[["top", "right"]].set_visible(False)
    if legend != "none" and axis.get_legend_handles_labels()[1]:
        look: dict[str, Any] = {"fontsize": SMALL_SIZE, "frameon": boxed, "framealpha": 0.9}
        if legend == "above":
            axis.legend(loc="lower right", bbox_to_anchor=(1.0, 0.99), borderaxespad=0, ncols=8, **look)
        else:
            axis.legend(loc=legend, **look)


def log_axis(side: Axis, low: float, high: float, steps: tuple[float, ...] = (1.0,)) -> None:
    """Make a side of a chart (`chart.xaxis` or `chart.yaxis`) logarithmic from `low` to `high`.

    It gets plain numbers at `steps` × 10ⁿ.
    """
    name = "x" if side is side.axes.xaxis else "y"
    side.axes.set(**{f"{name}scale": "log", f"{name}lim": (low, high)})
    side.set_major_locator(LogLocator(subs=steps, numticks=20))
    side.set_major_formatter("{x:g}")
    side.set_minor_locator(NullLocator())


def numbers_at(side: Axis, places: Iterable[float]) -> None:
    """Put the numbers of a side of a chart at the given places.

    Unlike `set_ticks`, it makes no object for each number, which would take a quarter of the time of a chart.
    """
    side.set_major_locator(FixedLocator(list(places)))


def room(value: float, *, steps: tuple[float, ...] = FINE, least: float = 0.0) -> float:
    """A value (or `least`, if it is smaller) rounded up to a round number, steps × 10ⁿ.

    As the limit of an axis, it seldom changes while a control moves.
    """
    value = max(value, least, 1e-9)
    whole = 10.0 ** np.floor(np.log10(value))
    rounded = [float(whole * step) for step in (*steps, 10 * steps[0])]
    # With a tolerance: 0.3 is 0.30000000000000004 in some sums.
    return next(each for each in rounded if each >= value * (1 - 1e-9))


def round_limits(*sides: Axis) -> None:
    """Give sides of axes round limits around their data, which seldom change while a control moves."""
    for side in sides:
        low, high = side.get_data_interval()
        step = room((high - low) / 8, steps=COARSE)
        margin = 0.2 * step
        ends = (step * np.floor((low - margin) / step), step * np.ceil((high + margin) / step))
        # As if there were data at the ends, so that an axis with equal scales may still be widened.
        axes = side.axes
        if side is axes.xaxis:
            axes.update_datalim([(end, 0.0) for end in ends], updatey=False)
            axes.margins(x=0.0)
        else:
            axes.update_datalim([(0.0, end) for end in ends], updatex=False)
            axes.margins(y=0.0)


def write_instead(axis: Axes, words: str) -> None:
    """Write text in place of a chart."""
    axis.text(0.5, 0.5, words, ha="center", transform=axis.transAxes)
    axis.set_axis_off()


def photo(image: Image, width: int = WIDTH, height: int | None = None) -> Image:
    """A grey or BGR picture as BGR of `width` pixels or, with white margins, `width` × `height` pixels."""
    colour = cv2.cvtColor(image, cv2.COLOR_GRAY2BGR) if image.ndim == 2 else image
    scale = width / colour.shape[1]
    if height is not None:
        scale = min(scale, height / colour.shape[0])
    size = (max(round(colour.shape[1] * scale), 1), max(round(colour.shape[0] * scale), 1))
    interpolation = cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR
    resized = np.asarray(cv2.resize(colour, size, interpolation=interpolation), np.uint8)
    if height is None:
        return resized
    left = (width - size[0]) // 2
    top = (height - size[1]) // 2
    border = ((top, height - size[1] - top), (left, width - size[0] - left), (0, 0))
    return np.pad(resized, border, constant_values=255)


def caption(picture: Image, words: str, named: Array | None = None) -> Image:
    """A BGR picture with words on a dark strip in its upper left corner.

    named : places (N, 2) of dots with names above, pixels of the picture. If the strip covers any of them, it
        is in the lower left corner, unless it covers more there.
    """
    out = picture.copy()
    width, height = text_size(words, CAPTION_SIZE)
    base = height + 5
    if named is not None:
        beside = named[named[:, 0] < width + 2 * NAME_ROOM]
        above = np.count_nonzero(beside[:, 1] < height + 10 + NAME_ROOM)
        below = np.count_nonzero(beside[:, 1] > len(picture) - height - 10 - DOT_ROOM)
        if below < above:
            base = len(picture) - 5
    write(out, words, 6, base, CAPTION_SIZE)
    return out


def shortened(name: str, most: int) -> str:
    """A name of at most `most` characters: of a longer one, the middle is left out."""
    if len(name) <= most:
        return name
    begin = (most - 1) // 3  # the end of a path says more
    return f"{name[:begin]}…{name[begin + 1 - most :]}"


def text_size(words: str, size: float) -> tuple[int, int]:
    """Width and height of words in a picture, pixels; `size` is OpenCV's scale of its font."""
    (width, height), _ = cv2.getTextSize(words, cv2.FONT_HERSHEY_SIMPLEX, size, 1)
    return width, height


def write(picture: Image, words: str, x: int, y: int, size: float) -> None:
    """Write white words on a dark strip into a BGR picture, in place; (x, y) is where their base line begins."""
    width, height = text_size(words, size)
    strip = picture[max(y - height - 5, 0) : y + 5, max(x - 6, 0) : x + width + 6]
    strip //= 4
    cv2.putText(picture, words, (x, y), cv2.FONT_HERSHEY_SIMPLEX, size, (255, 255, 255), 1, cv2.LINE_AA)


def beside(left: Image, right: Image, left_words: str, right_words: str) -> Image:
    """Two pictures side by side, each with half the width and a label."""
    left_half = caption(photo(left, WIDTH // 2, HALF_HEIGHT), left_words)
    right_half = caption(photo(right, WIDTH // 2, HALF_HEIGHT), right_words)
    return np.concatenate([left_half, right_half], axis=1)


def stack(parts: Sequence[Image | Figure], height: int) -> bytes:
    """Pictures and figures of the common width, one below the other, as JPEG bytes for a panel.

    The result has exactly `height` rows: white is added below, or the surplus is cut off.
    """
    whole = _joined(parts, fast_raster)[:height]
    whole = np.pad(whole, ((0, height - len(whole)), (0, 0), (0, 0)), constant_values=255)
    return bytes(cv2.imencode(".jpg", whole, JPEG)[1])


def show(*parts: Image | Figure) -> Shown:
    """Pictures and figures, one below the other, for a notebook cell."""
    whole = _joined(parts, raster)
    png = bytes(cv2.imencode(".png", whole, PNG)[1])
    titles = []
    for part in parts:
        if isinstance(part, Figure):
            titles += [axis.get_title("left") for axis in part.axes]
    alt = "; ".join(filter(None, titles)) or None  # pages.py describes other pictures by the text above
    return Shown(data=png, width=whole.shape[1], alt=alt)  # type: ignore[no-untyped-call]


def show_source(*things: Any) -> Code:
    """The source code of functions, methods or classes, each below the name of its file."""
    texts = []
    for thing in things:
        file = Path(str(inspect.getsourcefile(thing)))
        root = next(folder for folder in file.parents if folder.name in ("vo_lib", "course")).parent
        source = textwrap.dedent(inspect.getsource(thing))
        texts.append(f"# {file.relative_to(root).as_posix()}\n{source}")
    return Code("\n\n".join(texts), language="python")  # type: ignore[no-untyped-call]


def _joined(parts: Sequence[Image | Figure], pixels_of: Callable[[Figure], Image]) -> Image:
    """Pictures and figures, one below the other, as BGR; `pixels_of` draws a figure."""
    pictures = [pixels_of(part) if isinstance(part, Figure) else photo(part) for part in parts]
    return np.concatenate(pictures)
