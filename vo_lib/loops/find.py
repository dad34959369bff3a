"""Loops of a sequence: places that look alike, and the motion between their stereo pairs."""

from __future__ import annotations

import functools
from dataclasses import dataclass, replace

import numpy as np

from ..data.kitti import read_image
from ..data.sequence import Sequence, at_pixels
from ..geometry.motion import inverse, rigid
from ..geometry.reprojection import fit_motion
from ..geometry.rows import Rows
from ..geometry.types import Array, BoolArray, IntArray, Progress
from ..paper.boxes import in_boxes
from ..paper.buckets import select_by_bucket
from ..paper.features import describe
from ..paper.matching import DescribedPair, LoopMatcher
from ..paper.settings import FeatureConfig, MatchingConfig, MethodConfig
from ..paper.viso2 import ransac_motion
from .places import candidates, place_frames, similarities
from .settings import LoopConfig

PAIRS_KEPT = 32  # described stereo pairs: neighbouring places have the same candidates


@dataclass(frozen=True, eq=False)
class Loops(Rows):
    """N pairs of places that were compared.

    first, second : (N,) their frames, counted from 0; similarity : (N,) of the two images.
    matches, inliers : (N,) matches of the two stereo pairs, and those that agree with one motion.
    residual : (N,) root mean square of the inliers' reprojection errors, pixels; NaN without a motion.
    motion : (N, 4, 4) pose of the second left camera in the first; the identity without a motion.
    """

    first: IntArray
    second: IntArray
    similarity: Array
    matches: IntArray
    inliers: IntArray
    residual: Array
    motion: Array

    def accepted(self, config: LoopConfig) -> BoolArray:
        """Which pairs (N,) have inliers enough for a loop."""
        return np.asarray((self.inliers >= config.inliers) & (self.inliers >= config.share * self.matches))


def find_loops(
    sequence: Sequence, method: MethodConfig, config: LoopConfig, progress: Progress | None = None
) -> Loops:
    """Pairs of similar places with the motion between them, accepted or not.

    method : its seed, box rule, buckets and reprojection settings are used; the features are the published.
    progress : called with (steps done, steps in all), a half each for the places and for the pairs.
    """
    frames, report = place_frames(len(sequence), config), progress or (lambda done, of: None)
    similarity = place_similarities(sequence, method, config, lambda done, of: report(done, 2 * of))
    matcher = LoopMatcher(FeatureConfig(), MatchingConfig(search_radius=config.radius))

    @functools.lru_cache(PAIRS_KEPT)
    def described(frame: int) -> DescribedPair:
        pair = matcher.prepare(sequence.stereo(frame))
        keep = uncovered(sequence, frame, pair.in_left.uv, method)
        to_left = np.where(keep[pair.to_left], pair.to_left, -1)  # -1 stays -1 whatever the last feature is
        return replace(pair, to_right=np.where(keep, pair.to_right, -1), to_left=to_left)

    pairs = candidates(similarity, frames, config)
    first, second = frames[pairs].T
    counts, residuals, motions = np.zeros((2, len(pairs)), np.int64), np.zeros(len(pairs)), []
    for row, (a, b) in enumerate(zip(first.tolist(), second.tolist(), strict=True)):
        matcher.step(described(a))
        matches = matcher.step(described(b))
        # A repeated hedge has many matches in a small part of the image; buckets let it count little.
        matches = matches[select_by_bucket(matches.prev_left, matches.age, matches.strength, method.buckets)]
        rng = np.random.default_rng([method.seed, a, b])
        solution = ransac_motion(sequence.camera, matches, rng, method.reprojection)
        R_cp, t_cp, agrees = solution or (np.eye(3), np.zeros(3), np.zeros(len(matches), np.bool_))
        agreed = matches[agrees]
        X_p = sequence.camera.triangulate(agreed.prev_left, agreed.prev_right)
        fit = sequence.camera, X_p, agreed.cur_left, agreed.cur_right, R_cp, t_cp
        counts[:, row] = len(matches), len(agreed)
        residuals[row] = np.sqrt(np.mean(fit_motion(*fit, iterations=0)[2] ** 2)) if len(agreed) else np.nan
        motions.append(inverse(rigid(R_cp, t_cp)))
        report(len(frames) + len(frames) * (row + 1) // len(pairs), 2 * len(frames))
    stacked = np.reshape(motions, (-1, 4, 4))
    alike, (matched, agreeing) = similarity[tuple(pairs.T)], counts
    return Loops(first, second, alike, matched, agreeing, residuals, stacked)


def place_similarities(
    sequence: Sequence, method: MethodConfig, config: LoopConfig, progress: Progress | None = None
) -> Array:
    """Similarity (N, N) in [-1, 1] of the left images of the N places of a sequence."""
    frames, images = place_frames(len(sequence), config), []
    for frame in frames.tolist():
        image = describe(sequence.stereo(frame)[0], FeatureConfig())
        image = image[uncovered(sequence, frame, image.uv, method)]
        # With descriptors of length 1 a change of exposure changes nothing.
        length = np.maximum(np.linalg.norm(image.descriptor, axis=1, keepdims=True), 1.0)
        images.append(replace(image, descriptor=image.descriptor / length))
        if progress is not None:
            progress(len(images), len(frames))
    return similarities(images, sequence.camera.width, config, method.seed)


def uncovered(sequence: Sequence, frame: int, uv: Array, method: MethodConfig) -> BoolArray:
    """Mask of the pixels (N, 2) of a left image outside all masks and, by the method's rule, outside vehicle
    boxes."""
    keep = np.ones(len(uv), np.bool_)
    if files := sequence.mask_files():
        keep &= at_pixels(read_image(files[frame if len(files) > 1 else 0]), uv) == 0
    if method.filter.rule != "none":
        keep &= ~in_boxes(uv, sequence.boxes(frame), method.filter)
    return keep
