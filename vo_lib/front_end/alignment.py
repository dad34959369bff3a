"""Chapter 1: the sub-pixel finish: Lucas-Kanade on windows that are bent as the surface demands.

A square window compared with a square window is off where the surface slants: by a fifth of a pixel and more
on the street. Here the surroundings of each feature in the second image are first bent back by a known 2×2
matrix, all side by side in one picture, so that OpenCV's Lucas-Kanade compares like with like.
"""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ..core.types import Array, Image

# cv2.remap knows places to 1/32 pixel: tiles are centred there, so that their samples are exact.
GRID = 32
# A finish that moves a feature farther is no finish, pixels.
FARTHEST = 1.5
# The brightness of two images is compared over squares of this side, pixels of the images halved twice; a
# gain needs features that differ in brightness by this standard deviation, grey levels.
HALVINGS, SURROUNDINGS = 2, 5
FEWEST_LEVELS = 10.0


def track_warped(
    first: Image, second: Image, uv: Array, start: Array, A: Array, window: int
) -> tuple[Array, Array]:
    """Places in the second image of small windows of the first one.

    Parameters
    ----------
    first, second : (H, W) uint8, of the same size.
    uv, start : (N, 2) pixels in the first image, and where to start in the second.
    A : (N, 2, 2) how a window of the first image is bent in the second; window : its side, pixels, odd.

    Returns
    -------
    found (N, 2) pixels and difference (N,): mean absolute difference of the windows, grey levels; infinite
    where Lucas-Kanade lost the feature or left the start.
    """
    # The tile holds the window, wherever it may go, and LK's own border.
    tile = window + 2 * int(np.ceil(FARTHEST)) + 1
    room = (first.shape[0] // tile) * (first.shape[1] // tile)
    found, difference = np.array(start, np.float64), np.full(len(uv), np.inf)
    for part in (slice(i, i + room) for i in range(0, len(uv), max(room, 1)) if room):
        found[part], difference[part] = _track_part(
            first, second, uv[part], start[part], A[part], window, tile
        )
    return found, difference


def _track_part(
    first: Image, second: Image, uv: Array, start: Array, A: Array, window: int, tile: int
) -> tuple[Array, Array]:
    anchor = np.rint(start * GRID) / GRID
    columns = first.shape[1] // tile
    rows = -(-len(uv) // columns)
    place = np.arange(len(uv))
    centre = np.stack([place % columns, place // columns], axis=1) * tile + tile // 2
    # LK wants two pictures of one size: the rest stays black.
    picture = np.zeros_like(first)
    gain, offset = brightness_change(first, second, uv, start)
    tone = np.clip(np.rint(gain * np.arange(256) + offset), 0, 255).astype(np.uint8)
    tiles = _tiles(second, anchor, A, tile, rows, columns)
    picture[: rows * tile, : columns * tile] = cv2.LUT(tiles, tone)
    moved, status, difference = cv2.calcOpticalFlowPyrLK(
        first,
        picture,
        uv.astype(np.float32),
        centre.astype(np.float32),
        winSize=(window, window),
        maxLevel=0,
        criteria=(cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 15, 0.01),
        flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
    )
    shift = np.asarray(moved, np.float64).reshape(-1, 2) - centre
    found = anchor + np.einsum("nij,nj->ni", A, shift)
    ok = (status.ravel() == 1) & (np.abs(shift).max(axis=1, initial=0) <= FARTHEST)
    return np.where(ok[:, None], found, start), np.where(ok, difference.ravel(), np.inf)


def brightness_change(first: Image, second: Image, uv: Array, start: Array) -> tuple[float, float]:
    """Gain and offset that make the second image as bright as the first, from features (N, 2) in both.

    Two cameras, and two moments, differ in brightness. A straight line through the mean brightness around the
    features, fitted twice, the second time without the fifth that lies farthest from it.
    """
    a, b = (_brightness(image, place) for image, place in ((first, uv), (second, start)))
    kept = np.ones(len(a), np.bool_)
    gain, offset = 1.0, float(np.median(a - b))
    for _ in range(2):
        spread = b[kept] - b[kept].mean()
        if spread @ spread < len(a) * FEWEST_LEVELS**2:
            break
        gain = float(np.clip(spread @ (a[kept] - a[kept].mean()) / (spread @ spread), 0.5, 2.0))
        offset = float(a[kept].mean() - gain * b[kept].mean())
        rest = np.abs(a - gain * b - offset)
        # The 80 % quantile; np.quantile itself takes longer than all the rest.
        kept = rest <= np.partition(rest, int(0.8 * len(rest)))[int(0.8 * len(rest))]
    return gain, offset


def _brightness(image: Image, uv: Array) -> Array:
    """Mean brightness (N,) of the surroundings of pixels (N, 2)."""
    # Exact halves are by far the fastest; an odd last row or column stays out.
    small: NDArray[Any] = image
    for _ in range(HALVINGS):
        height, width = small.shape[0] // 2, small.shape[1] // 2
        small = cv2.resize(small[: 2 * height, : 2 * width], (width, height), interpolation=cv2.INTER_AREA)
    means = cv2.blur(small.astype(np.float32), (SURROUNDINGS, SURROUNDINGS))
    # The centre of pixel (0, 0) of the small image lies between the pixels that it is the mean of.
    u, v = np.asarray((uv.T + 0.5) / 2**HALVINGS - 0.5, np.float32)[:, None]
    found = cv2.remap(means, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(found[0], np.float64)


def _tiles(image: Image, uv: Array, A: Array, tile: int, rows: int, columns: int) -> Image:
    """Surroundings of pixels (N, 2), bent back by A, as tiles side by side: (rows·tile, columns·tile)."""
    offset = np.arange(tile, dtype=np.float32) - tile // 2
    # Axes: row of tiles, column of tiles, u or v.
    place = np.zeros((rows * columns, 2), np.float32)
    place[: len(uv)] = uv
    warp = np.zeros((rows * columns, 2, 2), np.float32)
    warp[: len(uv)] = A
    maps = []
    for axis in (0, 1):
        along_u = warp[:, axis, 0].reshape(rows, 1, columns, 1) * offset
        along_v = warp[:, axis, 1].reshape(rows, 1, columns, 1) * offset[:, None, None]
        start = place[:, axis].reshape(rows, 1, columns, 1)
        maps.append((along_u + (along_v + start)).reshape(rows * tile, -1))
    bent = cv2.remap(image, maps[0], maps[1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(bent, np.uint8)
