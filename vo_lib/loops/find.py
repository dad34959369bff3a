"""Loops of a sequence: similar places and the motion between their stereo pairs."""

from __future__ import annotations

import functools
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ..data.sequence import Sequence
from ..geometry.matches import StereoMatches
from ..geometry.motion import inverse, rigid
from ..geometry.reprojection import linearise, measured_pixels
from ..geometry.rows import Rows
from ..geometry.types import Array, BoolArray, IntArray, Progress
from ..paper.buckets import select_by_bucket
from ..paper.matching import LoopMatcher, describe_pair
from ..paper.settings import FeatureConfig, MatchingConfig, MethodConfig
from ..paper.viso2 import ransac_motion
from .places import candidates, place_frames, similarities, uncovered
from .settings import LoopConfig

PAIRS_KEPT = 32  # number of described stereo pairs in memory; neighbouring places share many candidates


@dataclass(frozen=True, eq=False)
class Loops(Rows):
    """N pairs of places that were compared.

    first, second : (N,) frames of the two places, from 0; similarity : (N,) similarity of their left images.
    matches, inliers : (N,) number of matches between the stereo pairs, and number of inliers of their motion.
    residual : (N,) root mean square of the inliers' reprojection errors, pixels; NaN without a motion.
    motion : (N, 4, 4) pose of the second left camera relative to the first; the identity without a motion.
    """

    first: IntArray
    second: IntArray
    similarity: Array
    matches: IntArray
    inliers: IntArray
    residual: Array
    motion: Array

    def accepted(self, config: LoopConfig) -> BoolArray:
        """Mask (N,) of the pairs with enough inliers for a loop."""
        return np.asarray((self.inliers >= config.inliers) & (self.inliers >= config.share * self.matches))


def find_loops(sequence: Sequence, method: MethodConfig, config: LoopConfig, progress: Progress) -> Loops:
    """Pairs of similar places, accepted or not, with the motion between them.

    method : only the seed and the settings of box rule, buckets and reprojection are used, not the features.
    progress : called with (steps done, total steps); places are the first half, pairs the second half.
    """
    frames = place_frames(len(sequence), config)
    similarity = similarities(sequence, method, config, lambda done, of: progress(done, 2 * of))
    pairs = candidates(similarity, frames, config)
    (first, second), (matched, agreeing) = frames[pairs].T, np.zeros((2, len(pairs)), np.int64)
    residual, motion = np.zeros(len(pairs)), np.zeros((len(pairs), 4, 4))
    for row, (matches, T_cp, agrees) in enumerate(compare_places(sequence, method, config, frames[pairs])):
        inliers = matches[agrees]
        matched[row], agreeing[row], motion[row] = len(matches), len(inliers), inverse(T_cp)
        X_p = sequence.camera.triangulate(inliers.prev_left, inliers.prev_right)
        measured = measured_pixels(sequence.camera, inliers.cur_left, inliers.cur_right)
        r, *_ = linearise(sequence.camera, X_p @ T_cp[:3, :3].T, T_cp[:3, 3], measured)
        residual[row] = np.sqrt(np.sum(r**2) / (len(inliers) or np.nan))
        progress(len(frames) + len(frames) * (row + 1) // len(pairs), 2 * len(frames))
    return Loops(first, second, similarity[tuple(pairs.T)], matched, agreeing, residual, motion)


def compare_places(
    sequence: Sequence, method: MethodConfig, config: LoopConfig, pairs: IntArray
) -> Iterator[tuple[StereoMatches, Array, BoolArray]]:
    """For each pair of frames in `pairs` (N, 2): matches, their motion T_cp (4, 4), and a mask of inliers.

    Without a motion, T_cp is the identity and no match is an inlier.
    """
    settings = FeatureConfig(), MatchingConfig(search_radius=config.radius)
    described = functools.lru_cache(PAIRS_KEPT)(lambda k: describe_pair(sequence.stereo(k), *settings))
    for first, second in pairs.tolist():
        matcher = LoopMatcher(*settings)
        matcher.step(described(first))
        m = matcher.step(described(second))
        keep = uncovered(sequence, first, m.prev_left, method)
        m = m[keep & uncovered(sequence, second, m.cur_left, method)]
        # A repeated hedge has many matches in a small part of the image; buckets limit their number.
        m = m[select_by_bucket(m.prev_left, m.age, m.strength, method.buckets)]
        rng = np.random.default_rng([method.seed, first, second])
        solution = ransac_motion(sequence.camera, m, rng, method.reprojection)
        R_cp, t_cp, inliers = solution or (np.eye(3), np.zeros(3), np.zeros(len(m), np.bool_))
        yield m, rigid(R_cp, t_cp), inliers
