"""Sub-pixel refinement by Lucas-Kanade, with windows warped to follow the surface (chapter 1).

On a slanted surface such as the street, the comparison of square windows has an error of 0.2 px or more. Here
the neighbourhood of each feature is cut out as a tile. The tile of the second image is warped back by a 2×2
matrix (`surface.py`). The tiles of each image are placed side by side in one picture for OpenCV's
Lucas-Kanade.
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

# Tiles are centred on a grid of 1/32 pixel, to which cv2.remap rounds positions in OpenCV 4. OpenCV 5
# interpolates exactly and would not need it, but without the grid every measured path would change a little.
GRID_CELLS_PER_PX = 32
# A refinement that moves a feature farther is rejected.
MAX_REFINEMENT_PX = 1.5
REFINEMENT_CRITERIA = (15, 0.01)  # iterations, and step in pixels, at which a refinement ends
# Number of tiles side by side in a picture.
TILES_IN_A_ROW = 32
TILES_IN_A_REMAP_ROW = 8  # a divisor of TILES_IN_A_ROW; 8 tiles of the widest window have 16928 pixels
# Smallest standard deviation of the features' brightness from which a gain is estimated.
MIN_CONTRAST_LEVELS = 10.0
# Smallest and largest gain that is estimated, and share of the tiles that are fitted in the second round.
GAINS = (0.5, 2.0)
FITTED_SHARE = 0.8

# (N, tile²) grey levels, row by row.
Tiles = NDArray[np.uint8]
Pair = tuple[Image, Image]


def refine_stereo(
    pair: Pair, coarse: CoarseDisparity, left: Array, right: Array, config: KitMatchingConfig
) -> tuple[Array, Array, BoolArray]:
    """Sub-pixel positions in the right image.

    Parameters
    ----------
    pair : left and right image; coarse : their disparity, (H / 2, W / 2), pixels of the full image.
    left : (N, 2) pixels. right : (N, 2) start positions.

    Returns
    -------
    right (N, 2) pixels; slope (N, 2) of the surface, see `Surface`; and a mask (N,) of good features: the
    windows are similar, and the feature is on a surface that fills its neighbourhood, not on an outline.
    """
    surface = fit_surface(coarse, left, left[:, 0] - right[:, 0])
    # NaN (unknown surface) fails the comparison. The refinement may still change the disparity by
    # MAX_REFINEMENT_PX, so more is allowed here than after it.
    ok = np.abs(left[:, 0] - right[:, 0] - surface.disparity) <= config.surface_tolerance + MAX_REFINEMENT_PX
    ok &= surface.share >= config.surface_share
    positions = right
    if "stereo-fit" not in config.without:
        warp = stereo_warp(surface.slope[ok])
        if "stereo-warp" in config.without:
            warp = _no_warp(len(warp))
        positions, ok = _refined(pair[0], pair[1], left, right, ok, warp, config)
    ok &= np.abs(left[:, 0] - positions[:, 0] - surface.disparity) <= config.surface_tolerance
    return positions, surface.slope, ok & is_stereo(left, positions, config)


def refine_over_time(
    camera: StereoCamera,
    before: Pair,
    pair: Pair,
    previous: tuple[Array, Array],
    slope: Array,
    start: tuple[Array, Array],
    motion: Array,
    config: KitMatchingConfig,
) -> tuple[Array, Array, BoolArray]:
    """Sub-pixel positions in the current pair: each image is compared with the previous image of its camera.

    Parameters
    ----------
    before, pair : images of the previous and the current pair.
    previous : (N, 2) pixels in the previous left and right image; slope : (N, 2) slope of the surfaces.
    start : (N, 2) start positions in the current left and right image, pixels.
    motion : predicted T_cp (4, 4).

    Returns
    -------
    left (N, 2), right (N, 2) pixels, and a mask (N,) of features with similar windows in both images.
    """
    start_left, start_right = start
    if "motion-fit" in config.without:
        return start_left, start_right, np.ones(len(slope), np.bool_)
    previous_left, previous_right = previous
    disparity = previous_left[:, 0] - previous_right[:, 0]
    R = motion[:3, :3]
    t = motion[:3, 3]
    ok = np.ones(len(slope), np.bool_)
    warp = motion_warp(camera, previous_left, disparity, slope, R, t)
    if "motion-warp" in config.without:
        warp = _no_warp(len(warp))
    cur_left, ok = _refined(before[0], pair[0], previous_left, start_left, ok, warp, config)
    # Features lost in the left images are not tracked in the right images. Their camera is one baseline b to
    # the right: X_c = R X_p + t for the left camera is X_c - b e1 = R (X_p - b e1) + t + b (R e1 - e1).
    t_right = t + camera.baseline * (R[:, 0] - (1.0, 0.0, 0.0))
    warp = motion_warp(camera, previous_right[ok], disparity[ok], right_slope(slope)[ok], R, t_right)
    if "motion-warp" in config.without:
        warp = _no_warp(len(warp))
    cur_right, ok = _refined(before[1], pair[1], previous_right, start_right, ok, warp, config)
    return cur_left, cur_right, ok


def _refined(
    first: Image,
    second: Image,
    uv: Array,
    start: Array,
    ok: BoolArray,
    warp: Array,
    config: KitMatchingConfig,
) -> tuple[Array, BoolArray]:
    """Refined positions (N, 2) in the second image, and a mask (N,) of those whose windows are similar.

    Only the M features in the mask `ok` (N,) are refined; the others stay at `start`, and are not in the new
    mask.

    Parameters
    ----------
    uv, start : (N, 2) pixels in the first image, and start positions in the second.
    warp : (M, 2, 2) of a window of these features, from the first to the second image.
    """
    refined, difference = track_warped(
        first,
        second,
        uv[ok],
        start[ok],
        warp,
        config.subpixel_window,
        equal_brightness="brightness" not in config.without,
    )
    positions = start.astype(np.float64)
    positions[ok] = refined
    similar = np.zeros(len(uv), np.bool_)
    similar[ok] = difference <= config.max_difference
    return positions, similar


def _no_warp(number: int) -> Array:
    """Warps (N, 2, 2) that leave N = `number` windows as they are."""
    return np.tile(np.eye(2), (number, 1, 1))


def track_warped(
    first: Image,
    second: Image,
    uv: Array,
    start: Array,
    warp: Array,
    window: int,
    equal_brightness: bool = True,
) -> tuple[Array, Array]:
    """Positions in the second image of small windows of the first image.

    Parameters
    ----------
    first, second : (H, W) uint8, of the same size.
    uv, start : (N, 2) pixels in the first image, and start positions in the second.
    warp : (N, 2, 2) of a window, from the first to the second image; window : its side, pixels, odd.
    equal_brightness : whether the second image's windows first get the brightness of the first image's.

    Returns
    -------
    Positions (N, 2), pixels, and mean absolute differences (N,) of the windows, grey levels; infinite
    differences for a lost feature or a refinement larger than MAX_REFINEMENT_PX.
    """
    count = len(uv)
    if count == 0:
        return np.zeros((0, 2)), np.zeros(0)
    # A tile contains the window at its largest displacement, and the border that Lucas-Kanade needs.
    tile = window + 2 * int(np.ceil(MAX_REFINEMENT_PX)) + 1
    # The tile of the first image is centred on a whole pixel, so its window is off this centre by a fraction.
    # That of the second image is centred on the start, rounded to the grid: the search begins at its centre.
    pixel = np.rint(uv)
    anchor = np.rint(start * GRID_CELLS_PER_PX) / GRID_CELLS_PER_PX
    row, column = np.divmod(np.arange(count), TILES_IN_A_ROW)
    centre = np.stack([column, row], axis=1) * float(tile) + tile // 2
    # Every row of a picture must be full, so copies of the first tiles fill the last row; they are made black
    # before the tracking.
    unused = -count % TILES_IN_A_ROW
    index = np.arange(count + unused) % count
    before = _tiles(first, pixel[index], tile)
    after = _warped_tiles(second, anchor[index], warp[index], tile)
    if equal_brightness:
        gain, offset = brightness_change(before[:count], after[:count])
        tone = np.clip(np.rint(gain * np.arange(256) + offset), 0, 255).astype(np.uint8)
        after = np.asarray(cv2.LUT(after, tone), np.uint8)
    before[count:] = 0
    after[count:] = 0
    tracked, ok, difference = track(
        _side_by_side(before, tile),
        _side_by_side(after, tile),
        centre + (uv - pixel),
        centre,
        window,
        MAX_REFINEMENT_PX,
        criteria=REFINEMENT_CRITERIA,
    )
    # A displacement in the tile, which was warped back, is warped to one in the second image.
    positions = anchor + np.einsum("nij,nj->ni", warp, tracked - centre)
    return np.where(ok[:, None], positions, start), difference


def brightness_change(before: Tiles, after: Tiles) -> tuple[float, float]:
    """Gain and offset that map the tile brightness of the second image to the tile brightness of the first.

    Two cameras, and two frames, differ in brightness. The line is fitted to the mean brightness of the tiles,
    then again without the 20 % of tiles that have the largest residuals. If the fitted tiles hardly differ in
    brightness, the gain is 1.
    """
    mean_before = cv2.reduce(before, 1, cv2.REDUCE_AVG, dtype=cv2.CV_32F)[:, 0]
    mean_after = cv2.reduce(after, 1, cv2.REDUCE_AVG, dtype=cv2.CV_32F)[:, 0]
    fitted = np.ones(len(mean_before), np.bool_)
    rank = int(FITTED_SHARE * len(mean_before))
    for _ in range(2):
        x = mean_after[fitted]
        y = mean_before[fitted]
        spread = x - x.mean()
        squared_spread = spread @ spread
        if squared_spread < len(mean_before) * MIN_CONTRAST_LEVELS**2:
            return 1.0, float(np.median(mean_before - mean_after))
        gain = float(np.clip(spread @ (y - y.mean()) / squared_spread, *GAINS))
        offset = float(y.mean() - gain * x.mean())
        residual = np.abs(mean_before - gain * mean_after - offset)
        # The quantile of the fitted share; np.quantile would take longer than the rest of this function.
        fitted = residual <= np.partition(residual, rank)[rank]
    return gain, offset


def _tiles(image: Image, pixel: Array, tile: int) -> Tiles:
    """Neighbourhoods of integer pixels (N, 2), squares with a side of `tile` pixels."""
    half = tile // 2
    padded = cv2.copyMakeBorder(image, half, half, half, half, cv2.BORDER_REPLICATE)
    u, v = pixel.astype(np.intp).T
    windows = np.lib.stride_tricks.sliding_window_view(padded, (tile, tile))
    return np.asarray(windows[v, u].reshape(len(u), -1), np.uint8)


def _warped_tiles(image: Image, uv: Array, warp: Array, tile: int) -> Tiles:
    """Neighbourhoods of pixels (N, 2), warped back by `warp` (N, 2, 2); N is a multiple of TILES_IN_A_ROW."""
    dv, du = np.indices((tile, tile)).reshape(2, -1) - tile // 2
    offset = np.stack([du, dv, np.ones_like(du)]).astype(np.float32)
    # u = warp_11 du + warp_12 dv + u of the feature; v likewise.
    u = np.column_stack([warp[:, 0], uv[:, 0]]).astype(np.float32) @ offset
    v = np.column_stack([warp[:, 1], uv[:, 1]]).astype(np.float32) @ offset
    # cv2.remap is limited to 32767 rows and columns.
    pixels_in_row = TILES_IN_A_REMAP_ROW * tile * tile
    warped = cv2.remap(
        image,
        u.reshape(-1, pixels_in_row),
        v.reshape(-1, pixels_in_row),
        cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_REPLICATE,
    )
    return np.asarray(warped.reshape(len(uv), -1), np.uint8)


def _side_by_side(tiles: Tiles, tile: int) -> Image:
    """One picture of all tiles, TILES_IN_A_ROW in a row."""
    return tiles.reshape(-1, TILES_IN_A_ROW, tile, tile).swapaxes(1, 2).reshape(-1, TILES_IN_A_ROW * tile)
