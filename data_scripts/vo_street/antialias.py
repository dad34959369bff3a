"""Smooth outlines: a pixel on an edge gets a mixture of the brightness of both sides.

A pixel shows the face at its centre. Without smoothing, outlines jump by whole pixels and disturb corner
detectors. The corners of a face give the exact position of its edge between two neighbouring pixels. The
pixel cut by the edge is mixed with the brightness of its neighbour, in proportion to the covered area.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vo_lib.geometry.camera import StereoCamera
from vo_lib.geometry.types import Array

Float32 = NDArray[np.float32]
Int = NDArray[np.int32]


def soften_edges(
    light: Float32, inverse_depth: Float32, faces: Int, edges: Array, camera: StereoCamera
) -> Float32:
    """Brightness (H, W) with smooth outlines.

    Parameters
    ----------
    light, inverse_depth : (H, W) brightness and 1/Z at the pixel centres.
    faces : (H, W) face of each pixel.
    edges : (F, 4, 3) lines; a point (x, y, 1) is inside a face if its products with all four lines are >= 0.
    camera : camera of the image, with f, cx and cy.
    """
    height, width = faces.shape
    change = np.zeros(light.size, np.float32)
    total = np.zeros(light.size, np.float32)
    flat = light.ravel()
    face = faces.ravel()
    inverse = inverse_depth.ravel()
    x: Array = (np.arange(width, dtype=np.float64) - camera.cx) / camera.f
    y: Array = (np.arange(height, dtype=np.float64) - camera.cy) / camera.f
    for axis, stride in ((0, 1), (1, width)):
        # Neighbouring pixels with different faces, `one` to the left of or above `two`.
        one = np.flatnonzero(face[:-stride] != face[stride:])
        if axis == 0:
            one = one[one % width != width - 1]
        two = one + stride
        row, column = np.divmod(one, width)
        # Signed distances are computed only along this axis: one step is 1/f.
        step = 1.0 / camera.f
        at_one = (x[column], y[row])
        at_two = (x[column] + step, y[row]) if axis == 0 else (x[column], y[row] + step)
        # Where the face of `one` and where that of `two` ends, in steps from `one`.
        end_of_one = _way_out(edges[face[one]], at_one, axis, step)
        end_of_two = 1.0 - _way_out(edges[face[two]], at_two, axis, -step)
        # The outline belongs to the nearer face, unless only one of the faces ends here.
        is_of_one = np.isfinite(end_of_one) & (~np.isfinite(end_of_two) | (inverse[one] >= inverse[two]))
        outline = np.where(is_of_one, end_of_one, end_of_two)
        # An outline before the border of the two pixels, at 0.5, gives a part of `one` to the face of `two`.
        for target, other, share in ((one, two, 0.5 - outline), (two, one, outline - 0.5)):
            use = (share > 0) & (share <= 0.5)
            target = target[use]
            other = other[use]
            weight = share[use].astype(np.float32)
            change[target] += weight * (flat[other] - flat[target])
            total[target] += weight
    return np.asarray((flat + change / np.maximum(total, 1.0)).reshape(light.shape))


def _way_out(edges: Array, at: tuple[Array, Array], axis: int, step: float) -> Array:
    """Distance (N,) to the edge of a face, in steps to the next pixel; infinite without an edge on this side.

    Parameters
    ----------
    edges : (N, 4, 3) lines of the faces; at : (N,) x and y of the pixels, normalised.
    axis : 0 for steps along x, 1 along y; step : signed length of a step.

    An edge is used only along the axis closer to its normal, so that no edge is smoothed twice. Along the
    other axis, the result is NaN.
    """
    value = edges[:, :, 0] * at[0][:, None] + edges[:, :, 1] * at[1][:, None] + edges[:, :, 2]
    slope = edges[:, :, axis] * step
    with np.errstate(divide="ignore", invalid="ignore"):
        way = np.where(value + slope < 0, value / -slope, np.inf)
    nearest = np.argmin(way, axis=1)
    rows = np.arange(len(way))
    is_closer_to_normal = np.abs(edges[rows, nearest, axis]) >= np.abs(edges[rows, nearest, 1 - axis])
    out = way[rows, nearest]
    is_used = is_closer_to_normal | ~np.isfinite(out)
    return np.asarray(np.where(is_used, np.clip(out, 0.0, np.inf), np.nan))
