"""Bucketing: selection of features by bucket, age and strength (chapter 1)."""

from __future__ import annotations

import numpy as np

from ..geometry.types import Array, Index, IntArray
from .settings import BucketConfig


def square_numbers(uv: Array, side: int) -> IntArray:
    """Numbers (N,) of the squares, `side` pixels wide, that contain the pixels (N, 2).

    The numbers go row by row; a row has as many squares as the rightmost pixel needs.
    """
    column, row = (uv // side).astype(np.int64).T
    columns = column.max(initial=0) + 1
    return np.asarray(row * columns + column)


def ranks_in_groups(groups: IntArray | Index) -> Index:
    """The rank 0, 1, … (N,) of each item within its group, for items (N,) sorted by their group's number."""
    start_of_group = np.searchsorted(groups, groups)  # the first place at which an item's group appears
    return np.arange(len(groups)) - start_of_group


def select_by_bucket(uv: Array, age: IntArray, strength: Array, config: BucketConfig) -> Index:
    """The oldest features of each bucket; among features of equal age, the strongest (section 1).

    A bucket is a square of `config.size` × `config.size` pixels.

    Parameters
    ----------
    uv : (N, 2) pixels; age : (N,) frames; strength : (N,) responses of the detector.

    Returns
    -------
    Sorted indices of the selected features, at most `config.features` of each bucket.
    """
    bucket = square_numbers(uv, config.size)
    # The last key is the first to decide: by bucket, in a bucket by age, at equal age by strength.
    order = np.lexsort((-strength, -age, bucket))
    rank = ranks_in_groups(bucket[order])
    return np.sort(order[rank < config.features])
