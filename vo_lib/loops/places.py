"""Places: which earlier images look like this one?

An image is a histogram of visual words: each descriptor of a feature is replaced by the nearest of a small
vocabulary, which is learnt from the same sequence (Sivic and Zisserman, "Video Google", ICCV 2003). Features
in vehicle boxes are left out: a parked car drives away, and the car ahead is in every image.
"""

from __future__ import annotations

import numpy as np

from ..geometry.types import Array, IntArray
from ..paper.features import Described
from .settings import LoopConfig

KINDS = 4  # of features, which are compared only within their kind
SAMPLE_FEATURES = 8000  # of each kind, from which the vocabulary is learnt
LEARNING_ROUNDS = 5


def place_frames(count: int, config: LoopConfig) -> IntArray:
    """The frames of `count` that are places."""
    return np.arange(0, count, max(config.every, -(-count // config.places)), dtype=np.int64)


def learn_words(images: list[Described], config: LoopConfig, seed: int) -> list[Array]:
    """The vocabulary of images, of each kind of features (words, 32): k-means on a sample."""
    rng, words = np.random.default_rng(seed), []
    for kind in range(KINDS):
        descriptors = np.concatenate([image.descriptor[image.kind == kind] for image in images])
        sample = descriptors[rng.permutation(len(descriptors))[:SAMPLE_FEATURES]]
        centres = np.resize(sample, (config.words, descriptors.shape[1]))
        for _ in range(LEARNING_ROUNDS):
            sums = np.zeros_like(centres)
            np.add.at(sums, (sample @ centres.T).argmax(axis=1), sample)
            length = np.linalg.norm(sums, axis=1, keepdims=True)
            centres = np.where(length > 0, sums / np.maximum(length, 1e-9), centres)
        words.append(centres)
    return words


def histogram(image: Described, words: list[Array], width: int, columns: int) -> Array:
    """How often an image, `width` pixels wide, has each word in each of its columns: one row of numbers."""
    number = np.zeros(len(image), np.int64)
    for kind, centres in enumerate(words):
        of_kind = image.kind == kind
        number[of_kind] = kind * len(centres) + (image.descriptor[of_kind] @ centres.T).argmax(axis=1)
    column, size = (image.uv[:, 0] * columns // width).astype(np.int64), sum(map(len, words))
    return np.bincount(number + size * column, minlength=size * columns).astype(np.float64)


def similarities(images: list[Described], width: int, config: LoopConfig, seed: int) -> Array:
    """Similarity (N, N) in [-1, 1] of N images, `width` pixels wide, with descriptors of length 1."""
    words = learn_words(images, config, seed)
    # Repetitions of a word count less and less; a word that every image has as often says nothing.
    flat = np.sqrt([histogram(image, words, width, config.columns) for image in images])
    flat -= flat.mean(axis=0)
    flat /= np.maximum(np.linalg.norm(flat, axis=1, keepdims=True), 1e-9)
    return np.asarray(flat @ flat.T)


def candidates(similarity: Array, frames: IntArray, config: LoopConfig) -> IntArray:
    """Pairs (M, 2) of places, the earlier one first: those most similar to each place, the gap apart."""
    pairs = []
    for later in range(len(frames)):
        earlier = np.flatnonzero(frames <= frames[later] - config.gap)
        best = earlier[np.argsort(-similarity[later, earlier], kind="stable")[: config.candidates]]
        pairs += [(each, later) for each in best if similarity[later, each] >= config.similarity]
    return np.array(pairs, np.int64).reshape(-1, 2)
