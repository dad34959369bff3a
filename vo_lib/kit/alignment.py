"""Chapter 1: the sub-pixel finish: Lucas-Kanade on windows that are bent as the surface demands.

A square window compared with a square window is off where the surface slants: by a fifth of a pixel and more
on the street. Here the surroundings of each feature are cut out as a tile, those in the second image bent
back by a known 2×2 matrix (`surface.py`), and the tiles of each image are laid side by side in one picture,
so that OpenCV's Lucas-Kanade compares like with like.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from ..geometry.camera import StereoCamera
from ..geometry.types import Array, BoolArray, Image
from ..paper.matching import is_stereo, track
from .settings import KitMatchingConfig
from .surface import CoarseDisparity, fit_surface, motion_warp, right_slope, stereo_warp

# cv2.remap knows places to 1/32 pixel: tiles are centred there, so that their samples are exact.
GRID_CELL_PX = 32
# A refinement that moves a feature farther is rejected.
MAX_REFINEMENT_PX = 1.5
# The tiles that lie side by side in a picture.
TILES_IN_A_ROW = 32
TILES_IN_A_REMAP_ROW = 8  # a divisor of it: 8 tiles of the widest window have 16928 pixels
# A gain needs features that differ in brightness by this standard deviation, grey levels.
MIN_CONTRAST_LEVELS = 10.0

# (N, tile²) grey levels, row by row.
Tiles = NDArray[np.uint8]
Pair = tuple[Image, Image]


def refine_stereo(
    pair: Pair, coarse: CoarseDisparity, left: Array, right: Array, config: KitMatchingConfig
) -> tuple[Array, Array, BoolArray]:
    """Sub-pixel places in the right image.

    Parameters
    ----------
    pair : left and right image; coarse : their disparity, (H / 2, W / 2), pixels of the full image.
    left : (N, 2) pixels. right : (N, 2) where to start.

    Returns
    -------
    right (N, 2) pixels; slope (N, 2) of the surface, see `Surface`; and which are good, (N,) bool: the
    windows look alike, and the feature lies on a surface that fills its surroundings, not on an outline.
    """
    surface = fit_surface(coarse, left, left[:, 0] - right[:, 0])
    # NaN, an unknown surface, compares false. The refinement moves no feature by more than MAX_REFINEMENT_PX.
    ok = np.abs(left[:, 0] - right[:, 0] - surface.disparity) <= config.surface_tolerance + MAX_REFINEMENT_PX
    ok &= surface.share >= config.surface_share
    places = np.array(right, np.float64)
    places[ok], difference = track_warped(
        *pair, left[ok], right[ok], stereo_warp(surface.slope[ok]), config.finish_window
    )
    ok[ok] = difference <= config.max_difference
    ok &= np.abs(left[:, 0] - places[:, 0] - surface.disparity) <= config.surface_tolerance
    return places, surface.slope, ok & is_stereo(left, places, config)


def refine_over_time(
    camera: StereoCamera,
    before: Pair,
    pair: Pair,
    previous: tuple[Array, Array],
    slope: Array,
    start: tuple[Array, Array],
    motion: tuple[Array, Array],
    config: KitMatchingConfig,
) -> tuple[Array, Array, BoolArray]:
    """Sub-pixel places in the current pair, left from left and right from right.

    Parameters
    ----------
    before, pair : images of the previous and the current pair.
    previous : (N, 2) pixels in the previous left and right image; slope : (N, 2) of their surfaces.
    start : (N, 2) pixels in the current left and right image, where to start.
    motion : predicted R_cp and t_cp, metres.

    Returns
    -------
    left (N, 2), right (N, 2) pixels, and whether both windows look alike, (N,) bool.
    """
    R, t = motion
    # The right camera sits one baseline beside the left one.
    sides = (slope, t), (right_slope(slope), t + camera.baseline * (R[:, 0] - (1.0, 0.0, 0.0)))
    disparity = previous[0][:, 0] - previous[1][:, 0]
    places = [np.array(start[side], np.float64) for side in (0, 1)]
    # What is lost in the left images is not looked for in the right ones.
    ok = np.ones(len(slope), np.bool_)
    for side, (side_slope, side_t) in enumerate(sides):
        bent = motion_warp(camera, previous[side][ok], disparity[ok], side_slope[ok], R, side_t)
        places[side][ok], difference = track_warped(
            before[side], pair[side], previous[side][ok], start[side][ok], bent, config.finish_window
        )
        ok[ok] = difference <= config.max_difference
    return places[0], places[1], ok


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
    tile = window + 2 * int(np.ceil(MAX_REFINEMENT_PX)) + 1
    pixel, anchor = np.rint(uv), np.rint(start * GRID_CELL_PX) / GRID_CELL_PX
    # Every row of a picture is full; what is left of the last one is black.
    place = np.arange(len(uv) + -len(uv) % TILES_IN_A_ROW)
    row, column = np.divmod(place[: len(uv)], TILES_IN_A_ROW)
    centre = np.stack([column, row], axis=1) * float(tile) + tile // 2
    place %= len(uv)
    before, after = _tiles(first, pixel[place], tile), _bent_tiles(second, anchor[place], A[place], tile)
    gain, offset = brightness_change(before[: len(uv)], after[: len(uv)])
    tone = np.clip(np.rint(gain * np.arange(256) + offset), 0, 255).astype(np.uint8)
    after = np.asarray(cv2.LUT(after, tone), np.uint8)
    before[len(uv) :] = after[len(uv) :] = 0
    pictures = _side_by_side(before, tile), _side_by_side(after, tile)
    moved, ok, difference = track(
        *pictures, centre + (uv - pixel), centre, window, MAX_REFINEMENT_PX, ends=(15, 0.01)
    )
    places = anchor + np.einsum("nij,nj->ni", A, moved - centre)
    return np.where(ok[:, None], places, start), difference


def brightness_change(before: Tiles, after: Tiles) -> tuple[float, float]:
    """Gain and offset that make the tiles of the second image as bright as those of the first.

    Two cameras, and two moments, differ in brightness. A straight line through the mean brightness of the
    tiles, fitted twice, the second time without the fifth that lies farthest from it. Where those left
    hardly differ in brightness, the gain is 1.
    """
    a, b = (cv2.reduce(tiles, 1, cv2.REDUCE_AVG, dtype=cv2.CV_32F)[:, 0] for tiles in (before, after))
    kept = np.ones(len(a), np.bool_)
    for _ in range(2):
        x, y = a[kept], b[kept]
        spread = y - y.mean()
        if spread @ spread < len(a) * MIN_CONTRAST_LEVELS**2:
            return 1.0, float(np.median(a - b))
        gain = float(np.clip(spread @ (x - x.mean()) / (spread @ spread), 0.5, 2.0))
        offset = float(x.mean() - gain * y.mean())
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
    # cv2.remap takes less than 32767 rows and columns.
    u, v = (each.reshape(-1, TILES_IN_A_REMAP_ROW * tile * tile) for each in (u, v))
    bent = cv2.remap(image, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(bent.reshape(len(uv), -1), np.uint8)


def _side_by_side(tiles: Tiles, tile: int) -> Image:
    """One picture of the tiles, TILES_IN_A_ROW in a row."""
    return tiles.reshape(-1, TILES_IN_A_ROW, tile, tile).swapaxes(1, 2).reshape(-1, TILES_IN_A_ROW * tile)
