"""Loops of a sequence: similar places and the motion between their stereo pairs."""

from __future__ import annotations

import functools
from collections.abc import Hashable, Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..data.sequence import Sequence
from ..geometry.camera import StereoCamera
from ..geometry.matches import StereoMatches
from ..geometry.motion import inverse, rigid
from ..geometry.reprojection import linearise, measured_pixels
from ..geometry.rows import Rows
from ..geometry.types import Array, BoolArray, IntArray, Progress
from ..paper.buckets import select_by_bucket
from ..paper.matching import DescribedPair, LoopMatcher, describe_pair
from ..paper.settings import FeatureConfig, MatchingConfig, MethodConfig
from ..paper.viso2 import ransac_motion
from .places import candidate_pairs, outside_masks_and_boxes, place_frames, similarities
from .settings import LoopConfig

PAIRS_KEPT = 32  # number of described stereo pairs in memory; neighbouring places share many candidates


@dataclass(frozen=True, eq=False)
class PlacePairs(Rows):
    """N pairs of places that were compared; the accepted ones are loops.

    Attributes
    ----------
    first_frame, second_frame : (N,) frames of the two places, from 0.
    similarity : (N,) similarity of their left images.
    matches : (N,) number of matches between the stereo pairs, outside masks and boxes, after the buckets.
    inliers : (N,) number of these matches that are inliers of the motion.
    residual : (N,) root mean square of the inliers' reprojection errors, pixels; NaN without a motion.
    motion : (N, 4, 4) pose of the second left camera relative to the first; the identity without a motion.
    """

    first_frame: IntArray
    second_frame: IntArray
    similarity: Array
    matches: IntArray
    inliers: IntArray
    residual: Array
    motion: Array

    def accepted(self, config: LoopConfig) -> BoolArray:
        """Mask (N,) of the pairs with enough inliers for a loop."""
        return np.asarray((self.inliers >= config.inliers) & (self.inliers >= config.share * self.matches))


def find_loops(
    sequence: Sequence, method: MethodConfig, config: LoopConfig, progress: Progress
) -> PlacePairs:
    """Pairs of similar places, accepted or not, with the motion between them.

    method : only the seed and the settings of box rule, buckets and reprojection are used, not the features.
    progress : called with (steps done, total steps); places are the first half, pairs the second half.

    Raises `DataError` for an unusable image, label or mask of the sequence.
    """
    frames = place_frames(len(sequence), config)
    steps = 2 * len(frames)
    similarity = similarities(sequence, method, config, lambda done, _: progress(done, steps))
    place_pairs = candidate_pairs(similarity, frames, config)
    count = len(place_pairs)
    match_counts = np.zeros(count, np.int64)
    inlier_counts = np.zeros(count, np.int64)
    residual = np.zeros(count)
    motion = np.zeros((count, 4, 4))
    for row, compared in enumerate(compare_places(sequence, method, config, frames[place_pairs])):
        inliers = compared.matches[compared.is_inlier]
        match_counts[row] = len(compared.matches)
        inlier_counts[row] = len(inliers)
        residual[row] = reprojection_error(sequence.camera, inliers, compared.T_cp)
        motion[row] = inverse(compared.T_cp)
        progress(len(frames) + len(frames) * (row + 1) // count, steps)
    first_place, second_place = place_pairs.T
    return PlacePairs(
        first_frame=frames[first_place],
        second_frame=frames[second_place],
        similarity=similarity[first_place, second_place],
        matches=match_counts,
        inliers=inlier_counts,
        residual=residual,
        motion=motion,
    )


def comparison_key(method: MethodConfig) -> Hashable:
    """The settings of a method that `find_loops` uses: runs over one sequence with equal ones share loops."""
    return (method.seed, method.filter, method.buckets, method.reprojection)


def reprojection_error(camera: StereoCamera, matches: StereoMatches, T_cp: Array) -> float:
    """Root mean square over matches of the reprojection residual's norm, pixels; NaN without matches.

    T_cp : (4, 4) motion from the previous camera to the current one, metres.
    """
    if len(matches) == 0:
        return np.nan
    X_p = camera.triangulate(matches.prev_left, matches.prev_right)
    measured = measured_pixels(camera, matches.cur_left, matches.cur_right)
    residuals, _, _ = linearise(camera, X_p @ T_cp[:3, :3].T, T_cp[:3, 3], measured)
    return float(np.sqrt(np.sum(residuals**2) / len(matches)))


class ComparedPlaces(NamedTuple):
    """Two places: N matches, their motion T_cp (4, 4), metres, and the mask (N,) of its inliers.

    The first place is the previous camera p, the second the current camera c. Without a motion, T_cp is the
    identity and no match is an inlier.
    """

    matches: StereoMatches
    T_cp: Array
    is_inlier: BoolArray


def compare_places(
    sequence: Sequence, method: MethodConfig, config: LoopConfig, frame_pairs: IntArray
) -> Iterator[ComparedPlaces]:
    """Matches and motion for each of the `frame_pairs` (N, 2), numbers of frames.

    The settings are those of `find_loops`.
    """
    features = FeatureConfig()
    matching = MatchingConfig(search_radius=config.radius)

    @functools.lru_cache(PAIRS_KEPT)
    def described(frame: int) -> DescribedPair:
        """The features of a frame's stereo pair."""
        return describe_pair(sequence.stereo(frame), features, matching)

    for first_frame, second_frame in frame_pairs.tolist():
        # The loop of `LoopMatcher` is not one of the path, but the way through the four images of two stereo
        # pairs (paper, section 2), here of two places. Each pair of places has its own matcher, since a
        # matcher remembers the stereo pair before.
        matcher = LoopMatcher(features, matching)
        matcher.step(described(first_frame))
        matches = matcher.step(described(second_frame))
        is_outside = outside_masks_and_boxes(sequence, first_frame, matches.prev_left, method)
        is_outside &= outside_masks_and_boxes(sequence, second_frame, matches.cur_left, method)
        matches = matches[is_outside]
        # A repeated hedge has many matches in a small part of the image; buckets limit their number.
        selected = select_by_bucket(matches.prev_left, matches.age, matches.strength, method.buckets)
        matches = matches[selected]
        rng = np.random.default_rng([method.seed, first_frame, second_frame])
        solution = ransac_motion(sequence.camera, matches, rng, method.reprojection)
        if solution is None:
            yield ComparedPlaces(matches, np.eye(4), np.zeros(len(matches), np.bool_))
        else:
            R_cp, t_cp, is_inlier = solution
            yield ComparedPlaces(matches, rigid(R_cp, t_cp), is_inlier)
