"""Check of a sample of stereo pairs for exchanged images, unequal rows and wrong disparities."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import cv2
import numpy as np

from vo_lib.geometry.motion import DEVIATION_OVER_MEDIAN
from vo_lib.geometry.types import Array, Image
from vo_lib.kit.settings import KitMatchingConfig

SAMPLE_PAIRS = 6
SIFT_FEATURES = 1500  # per image
MAX_SIFT_SIDE_PX = 4096  # larger images are scaled down, since SIFT needs 170 bytes per pixel
NEAREST_RATIO = 0.75  # largest ratio of the nearest to the second nearest descriptor distance (Lowe 2004)
MIN_MATCHES_PER_PAIR = 20  # average number needed for a result
MAX_ROW_SHIFT = 0.25  # share of the image height; matches with a larger shift are wrong
MANY_NEGATIVE = 0.7  # smallest share of negative disparities of a swapped pair
MUCH_SMALLER = 0.5  # of the row error; a rectification of raw images makes the row error smaller
MIN_DISPARITY_PX = 1.0  # smaller disparities do not determine the order of the images


@dataclass(frozen=True)
class PairStatistics:
    """Statistics of matches between left and right images over a sample of pairs.

    Attributes
    ----------
    pairs, matches : numbers of pairs and of matches.
    disparity : median of u_left - u_right, pixels.
    negative : share of disparities below -1 px, in [0, 1].
    row : median of v_right - v_left, pixels; 0 for rectified pairs.
    row_spread : robust standard deviation of v_right - v_left, pixels.
    """

    pairs: int
    matches: int
    disparity: float
    negative: float
    row: float
    row_spread: float


def measure_pairs(pairs: Iterable[tuple[Image, Image]]) -> PairStatistics:
    """Statistics of SIFT matches without geometric constraints; exchanged pairs have such matches too."""
    shifts = [_shifts(left, right) for left, right in pairs]
    all_shifts = np.concatenate([np.zeros((0, 2)), *shifts])
    disparity = -all_shifts[:, 0]
    row = all_shifts[:, 1]
    if not len(row):
        return PairStatistics(len(shifts), 0, 0.0, 0.0, 0.0, 0.0)
    middle = float(np.median(row))
    return PairStatistics(
        pairs=len(shifts),
        matches=len(row),
        disparity=float(np.median(disparity)),
        negative=float(np.mean(disparity < -MIN_DISPARITY_PX)),
        row=middle,
        row_spread=float(DEVIATION_OVER_MEDIAN * np.median(np.abs(row - middle))),
    )


def _shifts(left: Image, right: Image) -> Array:
    """Position in the right image minus position in the left image, (N, 2), of matched features, pixels."""
    sift = cv2.SIFT.create(SIFT_FEATURES)
    scale = min(1.0, MAX_SIFT_SIDE_PX / max(left.shape))
    small_l = cv2.resize(left, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    small_r = cv2.resize(right, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    points_l, descriptors_l = sift.detectAndCompute(small_l, None)
    points_r, descriptors_r = sift.detectAndCompute(small_r, None)
    if not points_l or not points_r:
        return np.zeros((0, 2))
    nearest = cv2.BFMatcher(cv2.NORM_L2).knnMatch(descriptors_l, descriptors_r, k=2)
    # The ratio test rejects nearest neighbours in images of different scenes.
    good = [
        pair[0] for pair in nearest if len(pair) == 2 and pair[0].distance < NEAREST_RATIO * pair[1].distance
    ]
    uv_l = np.array([points_l[match.queryIdx].pt for match in good]).reshape(-1, 2)
    shift = (np.array([points_r[match.trainIdx].pt for match in good]).reshape(-1, 2) - uv_l) / scale
    return np.asarray(shift[np.abs(shift[:, 1]) <= MAX_ROW_SHIFT * left.shape[0]], np.float64)


def is_rectified(raw: PairStatistics, rectified: PairStatistics) -> bool:
    """Whether pairs have clearly more equal rows without than with a rectification by the calibration."""
    if min(raw.matches, rectified.matches) < MIN_MATCHES_PER_PAIR * max(raw.pairs, 1):
        return False
    error_raw = abs(raw.row) + raw.row_spread
    error_rectified = abs(rectified.row) + rectified.row_spread
    tolerance = KitMatchingConfig().row_tolerance
    return error_raw < tolerance and error_raw < MUCH_SMALLER * error_rectified


def complaints(stats: PairStatistics, baseline: float) -> list[str]:
    """One sentence for each problem of the pairs and of the sign of the baseline; empty without problems.

    Parameters
    ----------
    baseline : baseline of the calibration, metres; negative if the right camera is on the left.
    """
    if stats.matches < MIN_MATCHES_PER_PAIR * max(stats.pairs, 1):
        return [
            f"only {stats.matches} matches between left and right in {stats.pairs} pairs: do both show "
            "the same scene at the same time?"
        ]
    if stats.disparity == stats.row_spread == 0.0:
        return [
            "left and right images are identical, so there is no depth; for both cameras in one folder, give "
            "patterns such as 'DIR/I1_*.png'"
        ]
    words = []
    observation = f"{100 * stats.negative:.0f} % of {stats.matches} matches have a negative disparity"
    if stats.negative > MANY_NEGATIVE:
        also = ", and the baseline is negative too" if baseline <= 0 else ""
        words.append(f"left and right are swapped: {observation}{also}; exchange the images (--swap)")
    elif baseline <= 0:
        words.append(
            f"the baseline has the wrong sign ({baseline:g} m): the order of the images is correct, so "
            "the baseline must be positive (T is from the left to the right camera, with a negative x)"
        )
    tolerance = KitMatchingConfig().row_tolerance
    if stats.row_spread > tolerance or abs(stats.row) > tolerance:
        words.append(
            f"rows do not match: the right image is {stats.row:+.1f} ± {stats.row_spread:.1f} px lower than "
            "the left image; rectify the images or give the full calibration"
        )
    return words
