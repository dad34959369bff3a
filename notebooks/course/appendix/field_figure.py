"""The picture of a stereo field: by how much disparities and rows are off, all over the image."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from vo_lib.geometry.camera import StereoCamera
from vo_lib.geometry.types import Array
from vo_lib.kit.rig import field_at

if TYPE_CHECKING:
    from matplotlib.figure import Figure

LEAST = 0.2  # pixels; the colours span at least this to both sides


def field_figure(coefficients: Array, camera: StereoCamera, title: str = "") -> Figure:
    """Errors of disparities and of rows over the left image, pixels; coefficients as `Rig` has them.

    White is right, blue too small, red too large; lines are 0.2 px apart.
    """
    from matplotlib.figure import Figure

    width, height = camera.size
    u, v = np.linspace(0, width - 1, 120), np.linspace(0, height - 1, 40)
    grid = np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2)
    errors = field_at(coefficients, *camera.normalise(grid).T).reshape(2, len(v), len(u))
    limit = max(LEAST, float(np.abs(errors).max()))
    colours: Any = {"cmap": "RdBu_r", "vmin": -limit, "vmax": limit, "interpolation": "bilinear"}
    made = Figure(figsize=(11.0, 2.3), layout="constrained")
    axes = made.subplots(1, 2, sharey=True)
    for axis, error, name in zip(axes, errors, ("disparity", "row"), strict=True):
        image = axis.imshow(error, extent=(0, width, height, 0), **colours)
        step = 0.2 if limit < 2.0 else 0.5
        levels = np.arange(-np.ceil(limit / step), np.ceil(limit / step) + 1) * step
        lines = axis.contour(u, v, error, levels=levels, colors="#333", linewidths=0.6)
        axis.clabel(lines, fontsize=7, fmt="%.1f")
        axis.set_title(f"{name}, left less right [px]", fontsize=10)
        axis.set_xlabel("u [px]")
    axes[0].set_ylabel("v [px]")
    made.colorbar(image, ax=axes, shrink=0.9, label="px")
    if title:
        made.suptitle(title, fontsize=11)
    return made
