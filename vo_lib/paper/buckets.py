"""Bucketing: selection of features by bucket, age and strength (chapter 1)."""

from __future__ import annotations

import numpy as np

from ..geometry.types import Array, Index, IntArray
from .settings import BucketConfig


def square_numbers(uv: Array, side: int) -> IntArray:
    """Indices (N,) of the image squares, `side` pixels wide, that contain the pixels (N, 2)."""
    column, row = (uv // side).astype(np.int64).T
    return np.asarray(row * (column.max(initial=0) + 1) + column)


def select_by_bucket(uv: Array, age: IntArray, strength: Array, config: BucketConfig) -> Index:
    """The oldest features of each bucket; among features of equal age, the strongest (section 1).

    Parameters
    ----------
    uv : (N, 2) pixels; age : (N,) frames; strength : (N,).

    Returns
    -------
    Sorted indices of the selected features: at most `config.features` per square of `config.size` pixels.
    """
    bucket = square_numbers(uv, config.size)
    order = np.lexsort((-strength, -age, bucket))  # by bucket, in a bucket by age, at equal age by strength
    sorted_bucket = bucket[order]
    first_of_bucket = np.searchsorted(sorted_bucket, sorted_bucket)
    rank = np.arange(len(order)) - first_of_bucket
    return np.sort(order[rank < config.features])
