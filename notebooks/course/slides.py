"""Pictures for slides: what a notebook shows is also written as PNG, its charts as SVG."""

from __future__ import annotations

import itertools
from pathlib import Path

import matplotlib as mpl
from IPython.display import Image as Shown
from matplotlib.figure import Figure

import course
from vo_lib.core.types import Image

from . import drawing


def export(folder: str | Path, name: str) -> None:
    """From now on `show` also writes its pictures into a folder: NAME_01.png, and NAME_01a.svg a chart."""
    numbers, plain = itertools.count(1), drawing.show
    place = Path(folder)
    place.mkdir(parents=True, exist_ok=True)

    def show(*parts: Image | Figure) -> Shown:
        shown, stem = plain(*parts), f"{name}_{next(numbers):02d}"
        (place / f"{stem}.png").write_bytes(shown.data)
        charts = [part for part in parts if isinstance(part, Figure)]
        for letter, chart in zip("abcdefgh", charts, strict=False):
            with mpl.rc_context({"svg.hashsalt": name}):  # the same bytes each time
                chart.savefig(place / f"{stem}{letter}.svg", metadata={"Date": None})
        return shown

    for module in (course, drawing):
        vars(module)["show"] = show
