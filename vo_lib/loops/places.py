"""Places: the similarity of images, and the earlier images that are most similar to an image.

A histogram of visual words describes an image: the nearest word of a vocabulary replaces each descriptor. The
vocabulary is learnt from the same sequence (Sivic and Zisserman, "Video Google", ICCV 2003). With a rule that
uses boxes, features in vehicle boxes are not counted: parked cars drive away, and the car ahead is in every
image.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from ..data.sequence import Sequence, at_pixels
from ..geometry.types import Array, BoolArray, IntArray, Progress
from ..paper.box_removal import in_boxes
from ..paper.features import DescribedFeatures, describe
from ..paper.settings import FeatureConfig, MethodConfig
from .settings import LoopConfig

KINDS = 4  # number of kinds of features: blobs and corners, maxima and minima; each word has one kind
SAMPLE_FEATURES = 8000  # number of features of each kind in the sample
LEARNING_ROUNDS = 5


def place_frames(count: int, config: LoopConfig) -> IntArray:
    """The frames (N,) that are places: every n-th of `count` frames; n is increased to limit their number."""
    smallest_step = math.ceil(count / config.places)
    step = max(config.every, smallest_step)
    return np.arange(0, count, step, dtype=np.int64)


def learn_words(images: list[DescribedFeatures], config: LoopConfig, seed: int) -> Array:
    """The vocabulary (kinds, words, 32) of images, by k-means on a sample of the features of each kind.

    The centres of the clusters are the words.

    images : features with descriptors of length 1, so that the nearest centre is that with the largest scalar
        product.
    """
    rng = np.random.default_rng(seed)
    words = []
    for kind in range(KINDS):
        of_kind = np.concatenate([image.descriptor[image.kind == kind] for image in images])
        sample = rng.permutation(of_kind)[:SAMPLE_FEATURES]
        # The first features of the sample, repeated if there are fewer of them than words.
        centres = np.resize(sample, (config.words, sample.shape[1]))
        for _ in range(LEARNING_ROUNDS):
            nearest = (sample @ centres.T).argmax(axis=1)
            sums = np.zeros_like(centres)
            np.add.at(sums, nearest, sample)
            length = np.linalg.norm(sums, axis=1, keepdims=True)
            # A centre has length 1; one without features stays where it is.
            centres = np.where(length > 0, sums / np.maximum(length, 1e-9), centres)
        words.append(centres)
    return np.array(words)


def histogram(image: DescribedFeatures, words: Array, width: int, columns: int) -> Array:
    """Number of features for each column, kind and word (columns, kinds, words).

    image : features with descriptors of length 1.
    words : (kinds, words, 32) from `learn_words`. width : of the image, pixels.
    """
    products = (words[image.kind] @ image.descriptor[:, :, None])[..., 0]
    nearest = products.argmax(axis=1)
    column = (image.uv[:, 0] * columns // width).astype(np.int64)
    counts = np.zeros((columns, *words.shape[:2]))
    np.add.at(counts, (column, image.kind, nearest), 1.0)
    return counts


def similarities(sequence: Sequence, method: MethodConfig, config: LoopConfig, progress: Progress) -> Array:
    """Similarity (N, N) in [-1, 1] of the left images of the N places of a sequence.

    progress : called with the numbers of described places and of all places.
    """
    frames = place_frames(len(sequence), config)
    images: list[DescribedFeatures] = []
    for frame in frames.tolist():
        # The paper's features with their defaults, also for the kit, whose own features have no descriptors.
        image = describe(sequence.left(frame), FeatureConfig())
        image = image[outside_masks_and_boxes(sequence, frame, image.uv, method)]
        # With descriptors of length 1, the histogram does not depend on the exposure.
        length = np.maximum(np.linalg.norm(image.descriptor, axis=1, keepdims=True), 1.0)
        images.append(replace(image, descriptor=image.descriptor / length))
        progress(len(images), len(frames))
    words = learn_words(images, config, method.seed)
    width = sequence.camera.width
    histograms = [histogram(image, words, width, config.columns).ravel() for image in images]
    # The root reduces the weight of repetitions; a word with equal frequency in all images has no weight.
    flat = np.sqrt(histograms)
    flat -= flat.mean(axis=0)
    flat /= np.maximum(np.linalg.norm(flat, axis=1, keepdims=True), 1e-9)
    return np.asarray(flat @ flat.T)


def outside_masks_and_boxes(sequence: Sequence, frame: int, uv: Array, method: MethodConfig) -> BoolArray:
    """Mask (N,) of the pixels (N, 2) of a left image outside masks and, with a rule that uses them, boxes.

    The rule `truth` of variant `kit` uses none: it knows what moves from one frame to the next, which says
    nothing about two visits of a place.
    """
    keep = np.ones(len(uv), np.bool_)
    mask = sequence.mask(frame)
    if mask is not None:
        keep &= at_pixels(mask, uv) == 0
    if method.filter.uses_boxes:
        keep &= ~in_boxes(uv, sequence.boxes(frame, method.filter.classes), method.filter)
    return keep


def candidate_pairs(similarity: Array, frames: IntArray, config: LoopConfig) -> IntArray:
    """Pairs (M, 2) of similar places, the earlier place first, at least `config.gap` frames apart.

    similarity : (N, N) of all places. frames : (N,) their frames. A pair has the indices of two places.
    """
    is_earlier = frames[:, None] - frames >= config.gap  # a row for each later place
    allowed = np.where(is_earlier, similarity, -np.inf)
    best = np.argsort(-allowed, axis=1, kind="stable")[:, : config.candidates]
    is_similar = np.take_along_axis(allowed, best, axis=1) >= config.similarity
    later, rank = np.nonzero(is_similar)
    return np.stack([best[later, rank], later], axis=1)
