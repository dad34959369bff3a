"""Whether images are those of a rectified stereo pair, seen on a sample: order, rows, disparities."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import cv2
import numpy as np

from ..core.errors import DataError
from ..core.geometry import NORMAL
from ..core.types import Array, Image
from ..front_end.config import MatchingConfig
from .sequence import Sequence

SAMPLE = 6  # pairs looked at
FEATURES = 1500  # in an image
LARGEST = 4096  # pixels; larger images are made smaller: SIFT needs 170 bytes a pixel
RATIO = 0.75  # a match is nearer than the second nearest by this factor (Lowe 2004)
FEW_IN_A_FRAME = 100  # matches of a run's median frame, below which its pairs are looked at
FEWEST = 20  # matches in a pair, on the average, below which nothing can be said
FARTHEST_ROW = 0.25  # rows farther apart than this share of the height are wrong matches
FEW_NEGATIVE, MOST_NEGATIVE = 0.1, 0.7  # shares of negative disparities: wrong matches; the pair is swapped
NEAR_ZERO = 1.0  # pixels; smaller disparities say nothing about the order of the images


@dataclass(frozen=True)
class PairStatistics:
    """What matches between left and right images say, over all pairs of a sample.

    Attributes
    ----------
    pairs, matches : how many were looked at and found.
    disparity : median of u_left - u_right, pixels.
    negative : share of disparities below -1 px, in [0, 1].
    row : median of v_right - v_left, pixels: 0 in a rectified pair.
    row_spread : robust standard deviation of v_right - v_left, pixels.
    """

    pairs: int
    matches: int
    disparity: float
    negative: float
    row: float
    row_spread: float


def sample_of(count: int) -> list[int]:
    """Numbers of a few pairs spread over `count`."""
    return [int(i) for i in np.unique(np.linspace(0, count - 1, SAMPLE).round())]


def doubts(sequence: Sequence, matches: float) -> list[str]:
    """What is wrong with a sequence's pairs, a sentence each, where a run's median frame has few matches.

    Without this, images swapped or not rectified look like any hard sequence: nearly all is left out.
    """
    if not matches < FEW_IN_A_FRAME:
        return []
    pairs = (sequence.stereo(index) for index in sample_of(len(sequence)))
    return complaints(measure_pairs(pairs), sequence.camera.baseline)


def measure_pairs(pairs: Iterable[tuple[Image, Image]]) -> PairStatistics:
    """Match each pair by SIFT in all directions, so that swapped and unrectified pairs match as well."""
    shifts = [_shifts(left, right) for left, right in pairs]
    disparity, row = np.concatenate([np.zeros((0, 2)), *shifts]).T * [[-1.0], [1.0]]
    if not len(row):
        return PairStatistics(len(shifts), 0, 0.0, 0.0, 0.0, 0.0)
    middle = float(np.median(row))
    return PairStatistics(
        pairs=len(shifts),
        matches=len(row),
        disparity=float(np.median(disparity)),
        negative=float(np.mean(disparity < -NEAR_ZERO)),
        row=middle,
        row_spread=float(NORMAL * np.median(np.abs(row - middle))),
    )


def _shifts(left: Image, right: Image) -> Array:
    """Right minus left pixel of matched features, (N, 2)."""
    if left.shape != right.shape:
        sizes = " and ".join(f"{image.shape[1]}×{image.shape[0]}" for image in (left, right))
        raise DataError(f"left and right image have different sizes: {sizes}")
    sift = cv2.SIFT.create(FEATURES)
    scale = min(1.0, LARGEST / max(left.shape))
    (points_l, descriptors_l), (points_r, descriptors_r) = (
        sift.detectAndCompute(cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA), None)
        for image in (left, right)
    )
    if not points_l or not points_r:
        return np.zeros((0, 2))
    nearest = cv2.BFMatcher(cv2.NORM_L2).knnMatch(descriptors_l, descriptors_r, k=2)
    # Images of different scenes have nearest neighbours too, but none that is much nearer than the next.
    good = [pair[0] for pair in nearest if len(pair) == 2 and pair[0].distance < RATIO * pair[1].distance]
    uv_l = np.array([points_l[match.queryIdx].pt for match in good]).reshape(-1, 2)
    shift = (np.array([points_r[match.trainIdx].pt for match in good]).reshape(-1, 2) - uv_l) / scale
    return np.asarray(shift[np.abs(shift[:, 1]) <= FARTHEST_ROW * left.shape[0]], np.float64)


def complaints(found: PairStatistics, baseline: float) -> list[str]:
    """What is wrong with a pair and the sign of its baseline, a sentence each; nothing where all is well.

    Parameters
    ----------
    baseline : metres, as the calibration gives it; negative where it puts the right camera on the left.
    """
    if found.matches < FEWEST * max(found.pairs, 1):
        return [
            f"only {found.matches} matches between left and right in {found.pairs} pairs: do the two show "
            "the same scene at the same time?"
        ]
    if found.disparity == found.row_spread == 0.0:
        return ["left and right are the same images: there is no depth in them"]
    words = []
    seen = f"{100 * found.negative:.0f} % of {found.matches} matches have a negative disparity"
    if found.negative > MOST_NEGATIVE:
        also = ", and the baseline is negative too" if baseline <= 0 else ""
        words.append(f"left and right are swapped: {seen}{also}; exchange the two (--swap)")
    elif baseline <= 0:
        words.append(
            f"the baseline has the wrong sign ({baseline:g} m): the images are in the right order, so it "
            "must be positive (T of the calibration: from the left camera to the right one, its x negative)"
        )
    if FEW_NEGATIVE < found.negative <= MOST_NEGATIVE:
        words.append(
            f"{seen}: the pair is not rectified, or its principal points differ; give the full calibration"
        )
    tolerance = MatchingConfig().row_tolerance
    if found.row_spread > tolerance:
        words.append(
            f"rows do not match: they differ by {found.row:+.1f} ± {found.row_spread:.1f} px over the image, "
            "so one camera is turned against the other; rectify the images or give the full calibration"
        )
    elif abs(found.row) > tolerance:
        side = "lower" if found.row > 0 else "higher"
        words.append(
            f"rows do not match: the right image is {abs(found.row):.1f} px {side} than the left one; "
            "rectify the images or give the full calibration"
        )
    return words
