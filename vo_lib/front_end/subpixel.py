"""Chapter 1: the sub-pixel finish of a match, round the loop of four images.

Whatever found a match, its last step is the same: bend the window as the surface and the motion demand
(`surface.py`), and let Lucas-Kanade find the place in the second image (`alignment.py`).
"""

from __future__ import annotations

import numpy as np

from ..core.camera import StereoCamera
from ..core.types import Array, Image, Mask
from ..method.matching import is_stereo
from .alignment import FARTHEST, track_warped
from .config import MatchingConfig
from .surface import CoarseDisparity, fit_surface, motion_warp, right_slope, stereo_warp


def refine_stereo(
    pair: tuple[Image, Image], coarse: CoarseDisparity, left: Array, right: Array, config: MatchingConfig
) -> tuple[Array, Array, Mask]:
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
    # NaN, a surface that is not known, compares false. The finish moves no feature by more than FARTHEST.
    ok = np.abs(left[:, 0] - right[:, 0] - surface.disparity) <= config.surface_tolerance + FARTHEST
    ok &= surface.share >= config.surface_share
    found = np.array(right, np.float64)
    found[ok], difference = track_warped(
        *pair, left[ok], right[ok], stereo_warp(surface.slope[ok]), config.finish_window
    )
    ok[ok] = difference <= config.max_difference
    ok &= np.abs(left[:, 0] - found[:, 0] - surface.disparity) <= config.surface_tolerance
    return found, surface.slope, ok & is_stereo(left, found, config)


def refine_over_time(
    camera: StereoCamera,
    before: tuple[Image, Image],
    pair: tuple[Image, Image],
    seen: tuple[Array, Array],
    slope: Array,
    start: tuple[Array, Array],
    motion: tuple[Array, Array],
    config: MatchingConfig,
) -> tuple[Array, Array, Mask]:
    """Sub-pixel places in the current pair, left from left and right from right.

    Parameters
    ----------
    before, pair : images of the previous and the current pair.
    seen : (N, 2) pixels in the previous left and right image; slope : (N, 2) of their surfaces.
    start : (N, 2) pixels in the current left and right image, where to start.
    motion : predicted R_cp and t_cp, metres.

    Returns
    -------
    left (N, 2), right (N, 2) pixels, and whether both windows look alike, (N,) bool.
    """
    R, t = motion
    # The right camera sits one baseline beside the left one.
    t_right = t + camera.baseline * (R[:, 0] - (1.0, 0.0, 0.0))
    disparity = seen[0][:, 0] - seen[1][:, 0]
    places = [np.array(start[side], np.float64) for side in (0, 1)]
    # What is lost in the left images is not looked for in the right ones.
    ok = np.ones(len(slope), np.bool_)
    for side, (side_slope, side_t) in enumerate(((slope, t), (right_slope(slope), t_right))):
        bent = motion_warp(camera, seen[side][ok], disparity[ok], side_slope[ok], R, side_t)
        places[side][ok], difference = track_warped(
            before[side], pair[side], seen[side][ok], start[side][ok], bent, config.finish_window
        )
        ok[ok] = difference <= config.max_difference
    return places[0], places[1], ok
