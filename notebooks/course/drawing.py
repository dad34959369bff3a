"""The style of all pictures of the course: one width, one font, one way to show them."""

from __future__ import annotations

import inspect
import textwrap
import threading
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal

import cv2
import numpy as np
from IPython.display import Code
from IPython.display import Image as Shown
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullLocator

from vo_lib.geometry.types import Image

WIDTH = 980  # pixels of every picture
PHOTO_HEIGHT, HALF_HEIGHT = 298, 150  # of photos of this width and of half the width
DPI = 100
LEFT, RIGHT, ABOVE, BELOW = 58, 14, 26, 42  # margins of an axis for its numbers and names, pixels

FONT_SIZE, TITLE_SIZE = 9.0, 10.0
COARSE = (1.0, 2.0, 5.0)  # mantissas of round numbers
FINE = (1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0)

# Half the time of OpenCV's default; the file is a tenth larger.
PNG = (cv2.IMWRITE_PNG_COMPRESSION, 1, cv2.IMWRITE_PNG_FILTER, cv2.IMWRITE_PNG_FILTER_SUB)
# Same look as PNG in a fifth of the time and half the bytes; without subsampling, coloured lines stay sharp.
JPEG = (
    *(cv2.IMWRITE_JPEG_QUALITY, 95),
    *(cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444),
)

Place = Literal["best", "upper left", "upper right", "lower left", "lower right", "center", "above", "none"]

# Text layout of matplotlib shares state between threads: only one thread draws at a time.
_drawing = threading.RLock()


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
    bottom, high = BELOW / height, (height - BELOW - ABOVE) / height
    boxes = zip((starts / width).tolist(), (inner / width).tolist(), strict=True)
    return picture, [picture.add_axes((x, bottom, wide, high)) for x, wide in boxes]


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
    axis.tick_params(labelsize=FONT_SIZE - 1)
    axis.spines[["top", "right"]].set_visible(False)
    if legend != "none" and axis.get_legend_handles_labels()[1]:
        look: dict[str, Any] = {"fontsize": FONT_SIZE - 1, "frameon": boxed, "framealpha": 0.9}
        if legend == "above":
            axis.legend(loc="lower right", bbox_to_anchor=(1.0, 0.99), borderaxespad=0, ncols=8, **look)
        else:
            axis.legend(loc=legend, **look)


def log_axis(axis: Axis, low: float, high: float, steps: tuple[float, ...] = (1.0,)) -> None:
    """Make an axis logarithmic from `low` to `high`, with plain numbers at `steps` × 10ⁿ."""
    name = "x" if axis is axis.axes.xaxis else "y"
    axis.axes.set(**{f"{name}scale": "log", f"{name}lim": (low, high)})
    axis.set_major_locator(LogLocator(subs=steps, numticks=20))
    axis.set_major_formatter("{x:g}")
    axis.set_minor_locator(NullLocator())


def room(value: float, *, steps: tuple[float, ...] = FINE, least: float = 0.0) -> float:
    """The smallest round number (steps × 10ⁿ) that is not below a value, for axis limits that seldom change."""
    value = max(value, least, 1e-9)
    whole = 10.0 ** np.floor(np.log10(value))
    rounded = [float(whole * step) for step in (*steps, 10 * steps[0])]
    # With a tolerance: 0.3 is 0.30000000000000004 in some sums.
    return next(each for each in rounded if each >= value * (1 - 1e-9))


def say(axis: Axes, words: str) -> None:
    """Show text in place of a chart."""
    axis.text(0.5, 0.5, words, ha="center", transform=axis.transAxes)
    axis.set_axis_off()


def raster(chart: Figure) -> Image:
    """A figure as a BGR picture (H, W, 3)."""
    with _drawing:
        canvas = FigureCanvasAgg(chart)
        canvas.draw()  # type: ignore[no-untyped-call]
        return np.ascontiguousarray(np.asarray(canvas.buffer_rgba())[:, :, 2::-1])  # type: ignore[no-untyped-call]


def photo(image: Image, width: int = WIDTH, height: int | None = None) -> Image:
    """A grey or BGR picture as BGR of `width` pixels or, with white margins, `width` × `height` pixels."""
    colour = cv2.cvtColor(image, cv2.COLOR_GRAY2BGR) if image.ndim == 2 else image
    scale = width / colour.shape[1]
    if height is not None:
        scale = min(scale, height / colour.shape[0])
    size = (max(round(colour.shape[1] * scale), 1), max(round(colour.shape[0] * scale), 1))
    way = cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR
    small = np.asarray(cv2.resize(colour, size, interpolation=way), np.uint8)
    if height is None:
        return small
    left, top = (width - size[0]) // 2, (height - size[1]) // 2
    border = ((top, height - size[1] - top), (left, width - size[0] - left), (0, 0))
    return np.pad(small, border, constant_values=255)


def caption(picture: Image, words: str) -> Image:
    """A BGR picture with words on a dark strip in its upper left corner; ASCII only."""
    font, size, white = cv2.FONT_HERSHEY_SIMPLEX, 0.48, (255, 255, 255)
    (w, h), _ = cv2.getTextSize(words, font, size, 1)
    out = picture.copy()
    out[: h + 10, : w + 12] = out[: h + 10, : w + 12] // 4
    return np.asarray(cv2.putText(out, words, (6, h + 5), font, size, white, 1, cv2.LINE_AA), np.uint8)


def beside(left: Image, right: Image, left_words: str, right_words: str) -> Image:
    """Two pictures side by side, each with half the width and a label."""
    halves = (photo(each, WIDTH // 2, HALF_HEIGHT) for each in (left, right))
    return np.concatenate([*map(caption, halves, (left_words, right_words))], axis=1)


def stack(parts: Sequence[Image | Figure], height: int) -> bytes:
    """Pictures and figures of the common width, one below the other, as JPEG bytes for a panel.

    The result has exactly `height` rows: white is added below, or the surplus is cut off.
    """
    whole = _joined(parts)[:height]
    whole = np.pad(whole, ((0, height - len(whole)), (0, 0), (0, 0)), constant_values=255)
    return bytes(cv2.imencode(".jpg", whole, JPEG)[1])


def show(*parts: Image | Figure) -> Shown:
    """Pictures and figures, one below the other, for a notebook cell."""
    whole = _joined(parts)
    png = bytes(cv2.imencode(".png", whole, PNG)[1])
    titles = [axis.get_title("left") for part in parts if isinstance(part, Figure) for axis in part.axes]
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


def _joined(parts: Sequence[Image | Figure]) -> Image:
    return np.concatenate([raster(part) if isinstance(part, Figure) else photo(part) for part in parts])
