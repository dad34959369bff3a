"""Matching of features in a loop through two stereo pairs (chapter 1; paper, section 2).

    left previous -> right previous -> right current -> left current -> left previous

Each step takes the most similar feature of the same kind, and the loop must end at the feature where it
began. That gives whole pixels, which Lucas-Kanade then refines; the paper names no such step.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from ..geometry.matches import StereoMatches, empty_matches
from ..geometry.types import Array, BoolArray, Image, Index, IntArray
from .features import DescribedFeatures, best_matches, describe, stereo_matches
from .settings import FeatureConfig, MatchingConfig, StereoLimits

MAX_REFINEMENT_MOVE_PX = 2.0  # largest displacement along u and v in the sub-pixel refinement


@dataclass(frozen=True, eq=False)
class DescribedPair:
    """A stereo pair with its features.

    Attributes
    ----------
    left, right : (H, W) uint8 images.
    in_left, in_right : the N features of the left and the M features of the right image.
    to_right : (N,) index of the right feature most similar to each left feature, -1 for none.
    to_left : (M,) index of the left feature most similar to each right feature, -1 for none.
    """

    left: Image
    right: Image
    in_left: DescribedFeatures
    in_right: DescribedFeatures
    to_right: Index
    to_left: Index


def describe_pair(
    images: tuple[Image, Image], features: FeatureConfig, matching: MatchingConfig
) -> DescribedPair:
    """Features of a left and a right image, and indices of the most similar features in the other image."""
    left, right = images
    in_left = describe(left, features)
    in_right = describe(right, features)
    to_right, to_left = stereo_matches(in_left, in_right, matching.max_disparity)
    return DescribedPair(left, right, in_left, in_right, to_right, to_left)


class LoopMatcher:
    """Matcher of blobs and corners in the loop, called with one stereo pair after the other.

    A feature that is matched again is one frame older and keeps its number.
    """

    def __init__(self, features: FeatureConfig, matching: MatchingConfig):
        self.feature_config = features
        self.config = matching
        # The previous pair, and the age and number of each of its left features.
        self._previous: DescribedPair | None = None
        self._age: IntArray = np.zeros(0, np.int64)
        self._id: IntArray = np.zeros(0, np.int64)
        self._next_id = 0

    def prepare(self, pair: tuple[Image, Image]) -> DescribedPair:
        """Features of a left and a right image; may be called before `step`, in other threads."""
        return describe_pair(pair, self.feature_config, self.config)

    def step(self, pair: DescribedPair) -> StereoMatches:
        """Matches between the previous pair and `pair`; empty for the first pair."""
        before = self._previous
        self._previous = pair
        number = len(pair.in_left)
        age = np.ones(number, np.int64)
        identity = np.full(number, -1, np.int64)  # -1: not matched, so the feature gets a new number
        matches = empty_matches()
        if before is not None:
            prev_left, prev_right, cur_left, cur_right = close_loop(before, pair, self.config.search_radius)
            age[cur_left] = self._age[prev_left] + 1
            identity[cur_left] = self._id[prev_left]
            coarse = StereoMatches(
                prev_left=before.in_left.uv[prev_left],
                prev_right=before.in_right.uv[prev_right],
                cur_left=pair.in_left.uv[cur_left],
                cur_right=pair.in_right.uv[cur_right],
                age=self._age[prev_left],
                strength=before.in_left.strength[prev_left],
                id=self._id[prev_left],
            )
            matches = subpixel_matches(before, pair, coarse, self.config)
        new = np.flatnonzero(identity < 0)
        identity[new] = self._next_id + np.arange(len(new))
        self._next_id += len(new)
        self._age = age
        self._id = identity
        return matches


def close_loop(before: DescribedPair, pair: DescribedPair, radius: int) -> tuple[Index, ...]:
    """Features whose loop through the four images is closed.

    Parameters
    ----------
    before, pair : the previous and the current stereo pair.
    radius : of the search from one frame to the next, pixels (`best_matches`).

    Returns
    -------
    Indices (N,) of these features in each image: previous left, previous right, current left, current right.
    """
    # Left to right in the previous pair. Left features with the same right feature share the rest of the
    # loop, so each right feature is followed only once.
    prev_right = np.unique(before.to_right[before.to_right >= 0])
    # Previous to current right image.
    cur_right = best_matches(before.in_right[prev_right], pair.in_right, radius)
    matched = cur_right >= 0
    prev_right = prev_right[matched]
    cur_right = cur_right[matched]
    # Right to left in the current pair.
    cur_left = pair.to_left[cur_right]
    matched = cur_left >= 0
    prev_right = prev_right[matched]
    cur_right = cur_right[matched]
    cur_left = cur_left[matched]
    # Current to previous left image; again, each feature is searched only once.
    distinct, place = np.unique(cur_left, return_inverse=True)
    prev_left = best_matches(pair.in_left[distinct], before.in_left, radius)[place]
    # The loop is closed if it began at the feature where it ends.
    closed = np.flatnonzero((prev_left >= 0) & (before.to_right[prev_left] == prev_right))
    closed = closed[np.argsort(prev_left[closed])]
    return prev_left[closed], prev_right[closed], cur_left[closed], cur_right[closed]


def subpixel_matches(
    before: DescribedPair, pair: DescribedPair, matches: StereoMatches, config: MatchingConfig
) -> StereoMatches:
    """The matches that pass the checks, with sub-pixel positions instead of whole pixels.

    The position in the previous left image is kept. From there, Lucas-Kanade tracks it to the previous right
    and to the current left image, and from both to the current right image, where the two positions must
    agree. A match that fails a check is not tracked further.

    Parameters
    ----------
    before, pair : the previous and the current stereo pair.
    matches : in whole pixels, from `close_loop`.
    """
    side = config.subpixel_window
    # Previous left to previous right.
    prev_right, ok, _ = track(before.left, before.right, matches.prev_left, matches.prev_right, side)
    ok &= is_stereo(matches.prev_left, prev_right, config)
    matches = replace(matches, prev_right=prev_right)[ok]
    # Previous left to current left.
    cur_left, ok, _ = track(before.left, pair.left, matches.prev_left, matches.cur_left, side)
    matches = replace(matches, cur_left=cur_left)[ok]
    # Previous right to current right, and current left to current right.
    over_time, ok, _ = track(before.right, pair.right, matches.prev_right, matches.cur_right, side)
    cur_right, ok_in_pair, _ = track(pair.left, pair.right, matches.cur_left, matches.cur_right, side)
    ok &= ok_in_pair
    ok &= np.linalg.norm(cur_right - over_time, axis=1) <= config.loop_tolerance
    ok &= is_stereo(matches.cur_left, cur_right, config)
    return replace(matches, cur_right=cur_right)[ok]


def is_stereo(left: Array, right: Array, config: StereoLimits) -> BoolArray:
    """Mask (N,) of left and right pixels (N, 2) with nearly equal rows and a sufficient disparity."""
    disparity, row_difference = (left - right).T
    same_row = np.abs(row_difference) <= config.row_tolerance
    return np.asarray((disparity >= config.min_disparity) & same_row)


def track(
    image: Image,
    target: Image,
    uv: Array,
    start: Array,
    side: int,
    max_move: float = MAX_REFINEMENT_MOVE_PX,
    levels: int = 0,
    criteria: tuple[int, float] = (20, 0.005),
) -> tuple[Array, BoolArray, Array]:
    """Where the windows around the pixels of `image` are in `target`, by Lucas-Kanade.

    Parameters
    ----------
    uv : (N, 2) pixels of `image`; start : (N, 2) pixels of `target` at which the iteration starts.
    side : side of a window, pixels.
    max_move : largest distance from the start along u and along v, pixels.
    levels : levels of the image pyramid above the image itself.
    criteria : of the end of the iteration: number of steps, and length of the last step, pixels.

    Returns
    -------
    Pixels (N, 2), a mask (N,) of successes, and mean absolute differences (N,) of the windows, grey levels;
    the difference is infinite without success.
    """
    if len(uv) == 0:
        return start, np.zeros(0, np.bool_), np.zeros(0)
    moved, status, difference = cv2.calcOpticalFlowPyrLK(
        image,
        target,
        uv.astype(np.float32),
        start.astype(np.float32),
        winSize=(side, side),
        maxLevel=levels,
        criteria=(cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, *criteria),
        flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
    )
    positions = np.asarray(moved, np.float64).reshape(-1, 2)
    ok = (status.ravel() == 1) & (np.abs(positions - start).max(axis=1) <= max_move)
    return positions, ok, np.where(ok, difference.ravel(), np.inf)
