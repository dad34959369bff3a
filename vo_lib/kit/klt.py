"""Loop matching through two stereo pairs by Lucas-Kanade (chapter 1)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

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

MAX_CONTRAST_RATIO = 1.25  # a larger change of contrast makes Lucas-Kanade fail
# The search from predicted positions has failed if it matches too few of the features, or if too few of the
# matches agree with one motion.
MIN_MATCHED_SHARE = 0.3
MIN_AGREEING_SHARE = 0.5
COARSE_CRITERIA = (10, 0.03)  # iterations, and step in pixels, at which the coarse search ends
MIN_MOTION_MATCHES = 10  # smallest number of matches for a motion


@dataclass(frozen=True, eq=False)
class _Features(Rows):
    """N features of a stereo pair, for the matching with the next pair.

    Attributes
    ----------
    left, right : (N, 2) pixels; slope : (N, 2) of their surfaces, see `Surface`.
    age, strength, id : (N,) as in `StereoMatches`.
    """

    left: Array
    right: Array
    slope: Array
    age: IntArray
    strength: Array
    id: IntArray


class _SlopedMatches(NamedTuple):
    """Matches, and the slopes (N, 2) of their surfaces in the current pair."""

    matches: StereoMatches
    slope: Array


NO_MATCHES = _SlopedMatches(empty_matches(), np.zeros((0, 2)))


class _Search(NamedTuple):
    """The result of a search: matches, the motion T_cp (4, 4) fitted to them, and how many agree with it."""

    found: _SlopedMatches
    motion: Array | None
    agreeing: int


@dataclass(frozen=True, eq=False)
class PreparedPair:
    """A stereo pair with the results that do not depend on the motion, computed ahead in other threads.

    Attributes
    ----------
    images : left and right, (H, W) uint8.
    corners : (N, 2) corners of the left image, pixels; strength : (N,) their strengths.
    disparity : (H / 2, W / 2) coarse disparity, pixels of the full image; not positive where unknown.
    """

    images: Pair
    corners: Array
    strength: Array
    disparity: CoarseDisparity


class KltMatcher:
    """Corners tracked by Lucas-Kanade from the previous pair to both current images.

    The loop is closed if two ways to the current right image end at the same pixel: one from the previous
    right image, one from the current left image.

    In the left image the search starts at the position predicted from the previous motion and the stereo
    depth (constant velocity). The right image is not searched from a prediction: block matching gives the
    position there, and the predicted one must only be inside the image. The matcher estimates the motion
    itself, so the matches depend only on the images and the matching settings, not on method or seed.
    """

    def __init__(self, camera: StereoCamera, features: KitFeatureConfig, matching: KitMatchingConfig):
        self.camera = camera
        self.feature_config = features
        self.config = matching
        self._previous: tuple[PreparedPair, _Features] | None = None  # the last pair, and its features
        self._motion: Array | None = None  # T_cp (4, 4) of the last pair
        self._next_id = 0

    def prepare(self, pair: Pair) -> PreparedPair:
        """Corners and coarse disparity of a stereo pair."""
        left, right = pair
        corners, strength = detect_corners(corner_strength(left), self.feature_config)
        disparity = coarse_disparity(left, right, self.config.max_disparity)
        return PreparedPair(pair, corners, strength, disparity)

    def step(self, pair: PreparedPair) -> StereoMatches:
        """Matches between the previous pair and `pair`; empty for the first pair."""
        found = NO_MATCHES
        if self._previous is not None:
            before, features = self._previous
            search = self._best_search(before, pair, features, self._motion)
            found = search.found
            self._motion = search.motion
        matches = found.matches
        one_per_cell = BucketConfig(size=self.feature_config.cell, features=1)
        rows = select_by_bucket(matches.cur_left, matches.age, matches.strength, one_per_cell)
        best = matches[rows]
        kept = _Features(
            best.cur_left, best.cur_right, found.slope[rows], best.age + 1, best.strength, best.id
        )
        self._previous = (pair, self._add_corners(pair, kept))
        return matches

    def _best_search(
        self, before: PreparedPair, pair: PreparedPair, features: _Features, last: Array | None
    ) -> _Search:
        """The matches of the previous pair's features in the next pair, and the motion between the pairs.

        The search begins at positions predicted with the `last` motion T_cp (4, 4). If it fails, a second
        search begins at the previous positions. Of the two, the search with more matches that agree on one
        motion is taken.
        """
        without = self.config.without
        # Without a motion to predict with, this search without matches stays, and counts as failed.
        search = _Search(NO_MATCHES, last, 0)
        searches_again = True
        if last is not None and "prediction" not in without:
            search = self._predicted_search(before, pair, features, last)
            searches_again = "second-search" not in without
        number = len(search.found.matches)
        too_few_found = number < MIN_MATCHED_SHARE * len(features)
        too_few_agree = search.agreeing < MIN_AGREEING_SHARE * number
        failed = too_few_found or too_few_agree
        if not failed or not searches_again:
            return search
        wide = self._wide_search(before, pair, features, search.motion)
        is_better = (wide.agreeing, len(wide.found.matches)) > (search.agreeing, number)
        return wide if is_better else search

    def _predicted_search(
        self, before: PreparedPair, pair: PreparedPair, features: _Features, last: Array
    ) -> _Search:
        """A search that begins at positions predicted with the last motion T_cp (4, 4)."""
        X_p = self.camera.triangulate(features.left, features.right)
        start = self.camera.project(transform(last, X_p))
        found = self._close_loop(before, pair, features, start, self.config.levels, last)
        motion, agreeing = next_motion(self.camera, found.matches, last)
        return _Search(found, motion, agreeing)

    def _wide_search(
        self, before: PreparedPair, pair: PreparedPair, features: _Features, motion: Array | None
    ) -> _Search:
        """A wide search that begins at the previous positions, in images of equal exposure.

        It is for a start without a motion, and for an abrupt change of motion or exposure, after which many
        of the predicted matches may be wrong.

        motion : T_cp (4, 4) by which windows are warped, from the failed search or the last pair; or None.
        """
        if "equal-exposure" not in self.config.without:
            left = lit_like(before.images[0], pair.images[0])
            right = lit_like(before.images[1], pair.images[1])
            before = replace(before, images=(left, right))
        start = (features.left, features.right)
        found = self._close_loop(before, pair, features, start, self.config.search_levels, motion)
        own_motion, agreeing = next_motion(self.camera, found.matches, None)
        return _Search(found, own_motion, agreeing)

    def _close_loop(
        self,
        before: PreparedPair,
        pair: PreparedPair,
        features: _Features,
        start: tuple[Array, Array],
        levels: int,
        motion: Array | None,
    ) -> _SlopedMatches:
        """The features that pass all checks in the next pair.

        The coarse positions are refined: in both images by comparison with the previous pair, and again in
        the right image by comparison with the left. The loop is closed if the two positions in the right
        image agree.

        start : (N, 2) expected positions in the current left image, where the search starts, and in the
            right image, which must only be inside it (block matching finds the position there).
        levels : pyramid levels. motion : predicted T_cp (4, 4).
        """
        left, right = pair.images
        tracks, coarse_left, coarse_right = self._coarse_tracks(before, pair, features, start, levels)
        # From the previous pair to both current images.
        cur_left, over_time, ok = refine_over_time(
            self.camera,
            before.images,
            pair.images,
            (tracks.left, tracks.right),
            tracks.slope,
            (coarse_left, coarse_right),
            np.eye(4) if motion is None else motion,
            self.config,
        )
        tracks = tracks[ok]
        cur_left = cur_left[ok]
        over_time = over_time[ok]
        # From the current left to the current right image, which must reach the pixel `over_time`.
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
        return _SlopedMatches(matches, slope[ok])

    def _coarse_tracks(
        self,
        before: PreparedPair,
        pair: PreparedPair,
        features: _Features,
        start: tuple[Array, Array],
        levels: int,
    ) -> tuple[_Features, Array, Array]:
        """The M features with a coarse position in the current pair, and their left and right pixels (M, 2).

        Lucas-Kanade gives the position in the left image, and block matching the disparity there. `start` and
        `levels` as in `_close_loop`.
        """
        left, right = pair.images
        searched = np.flatnonzero(_inside(start[0], left) & _inside(start[1], right))
        # A coarse tolerance is sufficient, since the refinement provides the accuracy.
        cur_left, ok, difference = track(
            before.images[0],
            left,
            features.left[searched],
            start[0][searched],
            self.config.window,
            np.inf,
            levels,
            criteria=COARSE_CRITERIA,
        )
        ok &= (difference <= self.config.max_difference) & _inside(cur_left, left)
        cur_right, has_depth = _in_right_image(pair.disparity, cur_left)
        ok &= has_depth & is_stereo(cur_left, cur_right, self.config)
        return features[searched[ok]], cur_left[ok], cur_right[ok]

    def _add_corners(self, pair: PreparedPair, features: _Features) -> _Features:
        """The features, and new ones from the corners in cells without a feature."""
        free = in_empty_cells(pair.corners, features.left, self.feature_config.cell)
        coarse_right, has_depth = _in_right_image(pair.disparity, pair.corners[free])
        left = pair.corners[free][has_depth]
        strength = pair.strength[free][has_depth]
        right, slope, ok = refine_stereo(
            pair.images, pair.disparity, left, coarse_right[has_depth], self.config
        )
        ok &= _inside(right, pair.images[1])
        number = int(np.count_nonzero(ok))
        ids = np.arange(self._next_id, self._next_id + number)
        self._next_id += number
        ages = np.ones(number, np.int64)
        new = _Features(left[ok], right[ok], slope[ok], ages, strength[ok], ids)
        return joined([features, new])


def _inside(uv: Array, image: Image) -> BoolArray:
    """Mask of the pixels (N, 2) inside an image; NaN, for a point behind the camera, is outside."""
    return np.asarray(((uv >= 0) & (uv <= (image.shape[1] - 1, image.shape[0] - 1))).all(axis=1))


def _in_right_image(coarse: CoarseDisparity, uv: Array) -> tuple[Array, BoolArray]:
    """Coarse positions (N, 2) in the right image for left pixels (N, 2), and a mask (N,): disparity known."""
    height, width = coarse.shape
    # The disparities are at half size.
    column, row = np.clip(np.rint(uv / 2).astype(int), 0, (width - 1, height - 1)).T
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
    """The motion T_cp (4, 4) for the prediction of the next positions, and how many matches agree with it.

    With too few matches, the motion is None. The fit starts from the previous motion `last` (4, 4), if any.
    """
    if len(matches) < MIN_MOTION_MATCHES:
        return None, 0
    start = np.eye(4) if last is None else last
    T_cp, residual = fit_motion(camera, matches, start, tolerance=CONVERGED_TRIAL_STEP)
    return T_cp, int(np.count_nonzero(residual < MAX_AGREEMENT_RESIDUAL_PX))
