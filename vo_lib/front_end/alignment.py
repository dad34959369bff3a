"""Chapter 1: the sub-pixel finish: Lucas-Kanade on windows that are bent as the surface demands.

A square window compared with a square window is off where the surface slants: by a fifth of a pixel and more
on the street. Here the surroundings of each feature are cut out as a tile, those in the second image bent
back by a known 2×2 matrix, and the tiles of each image are laid side by side in one picture, so that OpenCV's
Lucas-Kanade compares like with like.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from ..core.types import Array, Image

MOST_ROWS = 32766  # of what cv2.remap makes at once
# cv2.remap knows places to 1/32 pixel: tiles are centred there, so that their samples are exact.
GRID = 32
# A finish that moves a feature farther is no finish, pixels.
FARTHEST = 1.5
# The tiles that lie side by side in a picture.
COLUMNS = 32
# A gain needs features that differ in brightness by this standard deviation, grey levels.
FEWEST_LEVELS = 10.0

# (N, tile²) grey levels, row by row.
Tiles = NDArray[np.uint8]


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
    if len(uv) == 0:
        return np.zeros((0, 2)), np.zeros(0)
    # The tile holds the window, wherever it may go, and LK's own border.
    tile = window + 2 * int(np.ceil(FARTHEST)) + 1
    pixel, anchor = np.rint(uv), np.rint(start * GRID) / GRID
    before, after = _tiles(first, pixel, tile), _bent_tiles(second, anchor, A, tile)
    gain, offset = brightness_change(before, after)
    tone = np.clip(np.rint(gain * np.arange(256) + offset), 0, 255).astype(np.uint8)
    place = np.arange(len(uv))
    centre = np.stack([place % COLUMNS, place // COLUMNS], axis=1) * tile + tile // 2
    moved, status, difference = cv2.calcOpticalFlowPyrLK(
        _side_by_side(before, tile),
        _side_by_side(np.asarray(cv2.LUT(after, tone), np.uint8), tile),
        (centre + (uv - pixel)).astype(np.float32),
        centre.astype(np.float32),
        winSize=(window, window),
        maxLevel=0,
        criteria=(cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 15, 0.01),
        flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
    )
    shift = np.asarray(moved, np.float64).reshape(-1, 2) - centre
    found = anchor + np.einsum("nij,nj->ni", A, shift)
    ok = (status.ravel() == 1) & (np.abs(shift).max(axis=1) <= FARTHEST)
    return np.where(ok[:, None], found, start), np.where(ok, difference.ravel(), np.inf)


def brightness_change(before: Tiles, after: Tiles) -> tuple[float, float]:
    """Gain and offset that make the tiles of the second image as bright as those of the first.

    Two cameras, and two moments, differ in brightness. A straight line through the mean brightness of the
    tiles, fitted twice, the second time without the fifth that lies farthest from it. Where those left
    hardly differ in brightness, the gain is 1.
    """
    a, b = (cv2.reduce(tiles, 1, cv2.REDUCE_AVG, dtype=cv2.CV_32F)[:, 0] for tiles in (before, after))
    kept = np.ones(len(a), np.bool_)
    for _ in range(2):
        spread = b[kept] - b[kept].mean()
        if spread @ spread < len(a) * FEWEST_LEVELS**2:
            return 1.0, float(np.median(a - b))
        gain = float(np.clip(spread @ (a[kept] - a[kept].mean()) / (spread @ spread), 0.5, 2.0))
        offset = float(a[kept].mean() - gain * b[kept].mean())
        rest = np.abs(a - gain * b - offset)
        # The 80 % quantile; np.quantile itself takes longer than all the rest.
        kept = rest <= np.partition(rest, int(0.8 * len(rest)))[int(0.8 * len(rest))]
    return gain, offset


def _tiles(image: Image, pixel: Array, tile: int) -> Tiles:
    """Surroundings of whole pixels (N, 2)."""
    half = tile // 2
    framed = cv2.copyMakeBorder(image, half, half, half, half, cv2.BORDER_REPLICATE)
    u, v = pixel.astype(np.intp).T
    windows = np.lib.stride_tricks.sliding_window_view(framed, (tile, tile))
    return np.asarray(windows[v, u].reshape(len(u), -1), np.uint8)


def _bent_tiles(image: Image, uv: Array, A: Array, tile: int) -> Tiles:
    """Surroundings of pixels (N, 2), bent back by A (N, 2, 2)."""
    dv, du = np.indices((tile, tile)).reshape(2, -1) - tile // 2
    offset = np.stack([du, dv, np.ones_like(du)]).astype(np.float32)
    u, v = (np.column_stack([A[:, axis], uv[:, axis]]).astype(np.float32) @ offset for axis in (0, 1))
    bent = np.empty(u.shape, np.uint8)
    for at in range(0, len(uv), MOST_ROWS):
        some = slice(at, at + MOST_ROWS)
        bent[some] = cv2.remap(image, u[some], v[some], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return bent


def _side_by_side(tiles: Tiles, tile: int) -> Image:
    """One picture of N tiles, COLUMNS in a row; what is left of the last row is black."""
    rows = -(-len(tiles) // COLUMNS)
    whole = np.zeros((rows * COLUMNS, tile * tile), np.uint8)
    whole[: len(tiles)] = tiles
    laid = whole.reshape(rows, COLUMNS, tile, tile).swapaxes(1, 2)
    return laid.reshape(rows * tile, COLUMNS * tile)
