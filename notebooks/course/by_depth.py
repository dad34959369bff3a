"""A chart of distances that grow with the square of the depth, for chapters 0 and 4."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from vo_lib.geometry.types import Array

from .colours import BAD, GOOD
from .drawing import COARSE, figure, finish, log_axis

DEPTHS = (2.0, 200.0)  # metres shown
DISTANCES = (1e-3, 100.0)  # metres shown


def by_depth_figure(
    depth: Array, distance: Array, labels: tuple[str, str], title: str, factor: float | None = None
) -> Figure:
    """Distances (N,) over depths (N,), metres, as dots on logarithmic axes, and the line `factor` · Z².

    labels : of the dots and of the line. factor : by default, the median of distance / Z² between 5 and 80 m.
    """
    made, (axis,) = figure(260)
    if factor is None:
        near = (depth > 5) & (depth < 80)
        factor = float(np.median(distance[near] / depth[near] ** 2)) if near.any() else 1e-4
    Z = np.array(DEPTHS)
    axis.plot(depth, np.clip(distance, *DISTANCES), ".", color=GOOD, markersize=4, label=labels[0])
    axis.plot(Z, factor * Z**2, color=BAD, linewidth=1.5, label=labels[1])
    log_axis(axis.xaxis, *DEPTHS, COARSE)
    log_axis(axis.yaxis, *DISTANCES)
    finish(axis, f"{title} [m]", "depth Z [m]", "", "upper left")
    return made
