"""Loop matching through two stereo pairs by Lucas-Kanade (chapter 1)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from ..geometry.camera import StereoCamera
from ..geometry.matches import StereoMatches, empty_matches
from ..geometry.motion import transform
from ..geometry.reprojection import CONVERGED_TRIAL_STEP, MAX_AGREEMENT_RESIDUAL_PX, fit_motion
from ..geometry.rows import Rows, joined
from ..geometry.types import Array, BoolArray, Image, IntArray
from ..paper.buckets import select_by_bucket
from ..paper.matching import is_stereo, track
from ..paper.settings import BucketConfig
from .alignment import Pair, refine_over_time, refine_stereo
from .corners import corner_strength, detect_corners, in_empty_cells
from .settings import KitFeatureConfig, KitMatchingConfig
from .surface import CoarseDisparity, coarse_disparity

NO_MATCHES = empty_matches(), np.zeros((0, 2))  # matches, and the slopes (N, 2) of their surfaces
MAX_CONTRAST_RATIO = 1.25  # a larger change of contrast makes Lucas-Kanade fail
# With smaller shares, the search with a predicted position has failed: of features that are matched, and of
# matches that agree with one motion.
MIN_MATCHED_SHARE = 0.3
MIN_AGREEING_SHARE = 0.5
COARSE_ENDS = (10, 0.03)  # iterations, and step in pixels, at which the coarse search ends
MIN_MOTION_MATCHES = 10  # smallest number of matches for a motion


@dataclass(frozen=True, eq=False)
class _Features(Rows):
    """Features of a stereo pair, for the matching with the next pair; `slope` is the slope of the surface."""

    left: Array
    right: Array
    slope: Array
    age: IntArray
    strength: Array
    id: IntArray


@dataclass(frozen=True, eq=False)
class PreparedPair:
    """A stereo pair with the results that do not depend on the motion, computed ahead in other threads.

    Attributes
    ----------
    images : left and right, (H, W) uint8.
    corners : (N, 2) corners of the left image, pixels; strength : (N,) their strengths.
    disparity : (H / 2, W / 2) coarse disparity, pixels of the full image; negative if unknown.
    """

    images: Pair
    corners: Array
    strength: Array
    disparity: CoarseDisparity


class KltMatcher:
    """Corners tracked in the loop left prev → right prev → right cur → left cur by Lucas-Kanade.

    In the left image the search starts at the position predicted from the previous motion and the stereo
    depth (constant velocity), in the right image at the result of block matching. The matcher estimates the
    motion itself, so the matches depend only on the images and the matching settings, not on method or seed.
    """

    def __init__(self, camera: StereoCamera, features: KitFeatureConfig, matching: KitMatchingConfig):
        self.camera = camera
        self.features = features
        self.config = matching
        self._previous: tuple[PreparedPair, _Features] | None = None
        self._motion: Array | None = None  # T_cp (4, 4) of the last pair
        self._next_id = 0

    def prepare(self, pair: Pair) -> PreparedPair:
        """Corners and coarse disparity of a stereo pair."""
        left, right = pair
        corners, strength = detect_corners(corner_strength(left), self.features)
        disparity = coarse_disparity(left, right, self.config.max_disparity)
        return PreparedPair(pair, corners, strength, disparity)

    def step(self, pair: PreparedPair) -> StereoMatches:
        """Matches between the previous pair and `pair`; empty for the first pair."""
        if self._previous is None:
            matches, slope = NO_MATCHES
        else:
            matches, slope = self._follow(*self._previous, pair)
        one_per_cell = BucketConfig(size=self.features.cell, features=1)
        rows = select_by_bucket(matches.cur_left, matches.age, matches.strength, one_per_cell)
        best = matches[rows]
        features = _Features(best.cur_left, best.cur_right, slope[rows], best.age + 1, best.strength, best.id)
        self._previous = (pair, self._add_corners(pair, features))
        return matches

    def _follow(
        self, before: PreparedPair, features: _Features, pair: PreparedPair
    ) -> tuple[StereoMatches, Array]:
        """Matches with the next pair, and the slopes (N, 2) of their surfaces."""
        without = self.config.without
        predicts = "prediction" not in without
        last = self._motion
        motion = last
        result = NO_MATCHES
        agree = 0
        if last is not None and predicts:
            X_p = self.camera.triangulate(features.left, features.right)
            guess = self.camera.project(transform(last, X_p))
            result = self._close_loop(before, pair, features, guess, self.config.levels, motion)
            motion, agree = next_motion(self.camera, result[0], last)
        failed = len(result[0]) < MIN_MATCHED_SHARE * len(features)
        failed |= agree < MIN_AGREEING_SHARE * len(result[0])
        if failed and ("second-search" not in without or last is None or not predicts):
            # Without a motion, or after an abrupt change of motion or exposure, many matches may be wrong:
            # search again, starting at the previous positions.
            lit = before
            if "equal-exposure" not in without:
                left = lit_like(before.images[0], pair.images[0])
                right = lit_like(before.images[1], pair.images[1])
                lit = replace(before, images=(left, right))
            start = (features.left, features.right)
            second = self._close_loop(lit, pair, features, start, self.config.search_levels, motion)
            second_motion, second_agree = next_motion(self.camera, second[0], None)
            if (second_agree, len(second[0])) > (agree, len(result[0])):
                result = second
                motion = second_motion
        self._motion = motion
        return result

    def _close_loop(
        self,
        before: PreparedPair,
        pair: PreparedPair,
        features: _Features,
        guess: tuple[Array, Array],
        levels: int,
        motion: Array | None,
    ) -> tuple[StereoMatches, Array]:
        """Matches that pass all checks, and the slopes (N, 2) of their surfaces.

        guess : (N, 2) start positions in the current left and right image; motion : predicted T_cp.

        Lucas-Kanade (left image) and block matching (right image) give coarse positions, which are refined.
        """
        left, right = pair.images
        start = np.flatnonzero(_inside(guess[0], left) & _inside(guess[1], right))
        # A coarse tolerance is sufficient, since the refinement below provides the accuracy.
        cur_left, ok, difference = track(
            before.images[0],
            left,
            features.left[start],
            guess[0][start],
            self.config.window,
            np.inf,
            levels,
            criteria=COARSE_ENDS,
        )
        ok &= (difference <= self.config.max_difference) & _inside(cur_left, left)
        over_time, has_depth = _in_right_image(pair.disparity, cur_left)
        ok &= has_depth & is_stereo(cur_left, over_time, self.config)
        tracks = features[start[ok]]
        cur_left, over_time, ok = refine_over_time(
            self.camera,
            before.images,
            pair.images,
            (tracks.left, tracks.right),
            tracks.slope,
            (cur_left[ok], over_time[ok]),
            np.eye(4) if motion is None else motion,
            self.config,
        )
        tracks = tracks[ok]
        cur_left = cur_left[ok]
        over_time = over_time[ok]
        cur_right, slope, ok = refine_stereo(pair.images, pair.disparity, cur_left, over_time, self.config)
        ok &= _inside(cur_left, left) & _inside(cur_right, right)
        ok &= np.linalg.norm(cur_right - over_time, axis=1) <= self.config.loop_tolerance
        tracks = tracks[ok]
        matches = StereoMatches(
            tracks.left,
            tracks.right,
            cur_left[ok],
            cur_right[ok],
            tracks.age,
            tracks.strength,
            tracks.id,
        )
        return matches, slope[ok]

    def _add_corners(self, pair: PreparedPair, features: _Features) -> _Features:
        free = in_empty_cells(pair.corners, features.left, self.features.cell)
        guess, ok = _in_right_image(pair.disparity, pair.corners[free])
        uv = pair.corners[free][ok]
        strength = pair.strength[free][ok]
        right, slope, ok = refine_stereo(pair.images, pair.disparity, uv, guess[ok], self.config)
        ok &= _inside(right, pair.images[1])
        number = int(np.count_nonzero(ok))
        ids = np.arange(self._next_id, self._next_id + number)
        self._next_id += number
        new = _Features(uv[ok], right[ok], slope[ok], np.ones(number, np.int64), strength[ok], ids)
        return joined([features, new])


def _inside(uv: Array, image: Image) -> BoolArray:
    """Mask of the pixels (N, 2) inside an image; NaN, for a point behind the camera, is outside."""
    return np.asarray(((uv >= 0) & (uv <= (image.shape[1] - 1, image.shape[0] - 1))).all(axis=1))


def _in_right_image(coarse: CoarseDisparity, uv: Array) -> tuple[Array, BoolArray]:
    """Coarse positions (N, 2) in the right image for left pixels (N, 2), and a mask (N,) of validity."""
    column, row = np.clip(np.rint(uv / 2).astype(int), 0, np.array(coarse.shape[::-1]) - 1).T
    disparity = coarse[row, column].astype(np.float64)
    right = uv - np.stack([disparity, np.zeros_like(disparity)], axis=1)
    return right, disparity > 0


def lit_like(image: Image, target: Image) -> Image:
    """The image; if the contrast changed much, a copy with the mean and standard deviation of `target`."""
    mean, spread = cv2.meanStdDev(image)
    target_mean, target_spread = cv2.meanStdDev(target)
    gain = float(target_spread[0, 0] / max(spread[0, 0], 1.0))
    if 1.0 / MAX_CONTRAST_RATIO < gain < MAX_CONTRAST_RATIO:
        return image
    tone = np.clip(np.rint(gain * (np.arange(256) - mean[0, 0]) + target_mean[0, 0]), 0, 255)
    return np.asarray(cv2.LUT(image, tone.astype(np.uint8)), np.uint8)


def next_motion(camera: StereoCamera, matches: StereoMatches, last: Array | None) -> tuple[Array | None, int]:
    """The motion T_cp (4, 4) for the prediction of the next positions, and the number of inliers.

    With too few matches, the motion is None. The fit starts from the previous motion `last`.
    """
    if len(matches) < MIN_MOTION_MATCHES:
        return None, 0
    start = np.eye(4) if last is None else last
    T_cp, residual = fit_motion(camera, matches, start, tolerance=CONVERGED_TRIAL_STEP)
    return T_cp, int(np.count_nonzero(residual < MAX_AGREEMENT_RESIDUAL_PX))
