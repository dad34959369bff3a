"""Chapter 1: the choice of features by bucket, age and strength."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..core.types import Array
from .config import BucketConfig


def square_numbers(uv: Array, side: int) -> NDArray[np.int64]:
    """A number (N,) for each pixel (N, 2), the same for those in one square of the image, `side` wide."""
    column, row = (uv // side).astype(np.int64).T
    return np.asarray(row * (column.max(initial=0) + 1) + column)


def select_by_bucket(
    uv: Array, age: NDArray[np.int64], strength: Array, config: BucketConfig
) -> NDArray[np.intp]:
    """Of each bucket the oldest features, then the strongest: earlier work, reported in section 1.

    Parameters
    ----------
    uv : (N, 2) pixels; age : (N,) frames; strength : (N,).

    Returns
    -------
    Indices of the features kept, at most `config.features` for each square of `config.size` pixels, sorted.
    """
    bucket = square_numbers(uv, config.size)
    order = np.lexsort((-strength, -age, bucket))
    sorted_bucket = bucket[order]
    first = np.searchsorted(sorted_bucket, sorted_bucket)
    rank = np.arange(len(order)) - first
    return np.sort(order[rank < config.features])
