"""Places: the similarity of images, and the earlier images that are most similar to an image.

A histogram of visual words describes an image: the nearest word of a vocabulary replaces each descriptor. The
vocabulary is learnt from the same sequence (Sivic and Zisserman, "Video Google", ICCV 2003). Features in
vehicle boxes are not counted: parked cars drive away, and the car ahead is in every image.
"""

from __future__ import annotations

import numpy as np

from ..geometry.types import Array, IntArray
from ..paper.features import Described
from .settings import LoopConfig

KINDS = 4  # kinds of features: blobs and corners, bright and dark; words are of one kind
SAMPLE_FEATURES = 8000  # number of features of each kind in the sample
LEARNING_ROUNDS = 5


def place_frames(count: int, config: LoopConfig) -> IntArray:
    """The frames that are places: every n-th of `count`, with n large enough for at most `config.places`."""
    return np.arange(0, count, max(config.every, -(-count // config.places)), dtype=np.int64)


def learn_words(images: list[Described], config: LoopConfig, seed: int) -> list[Array]:
    """The vocabulary of images, for each kind of features (words, 32): k-means of a sample."""
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
    """Number of features (columns * words,) of each word in each column of an image, `width` pixels wide."""
    number = np.zeros(len(image), np.int64)
    for kind, centres in enumerate(words):
        of_kind = image.kind == kind
        number[of_kind] = kind * len(centres) + (image.descriptor[of_kind] @ centres.T).argmax(axis=1)
    column, size = (image.uv[:, 0] * columns // width).astype(np.int64), sum(map(len, words))
    return np.bincount(number + size * column, minlength=size * columns).astype(np.float64)


def similarities(images: list[Described], width: int, config: LoopConfig, seed: int) -> Array:
    """Similarity (N, N) in [-1, 1] of N images, `width` pixels wide, with descriptors of length 1."""
    words = learn_words(images, config, seed)
    # The root reduces the weight of repetitions; a word that is as frequent in all images has no weight.
    flat = np.sqrt([histogram(image, words, width, config.columns) for image in images])
    flat -= flat.mean(axis=0)
    flat /= np.maximum(np.linalg.norm(flat, axis=1, keepdims=True), 1e-9)
    return np.asarray(flat @ flat.T)


def candidates(similarity: Array, frames: IntArray, config: LoopConfig) -> IntArray:
    """Pairs (M, 2) of places, the earlier first: each place with its most similar places, a gap earlier."""
    pairs = []
    for later in range(len(frames)):
        earlier = np.flatnonzero(frames <= frames[later] - config.gap)
        best = earlier[np.argsort(-similarity[later, earlier], kind="stable")[: config.candidates]]
        pairs += [(each, later) for each in best if similarity[later, each] >= config.similarity]
    return np.array(pairs, np.int64).reshape(-1, 2)
