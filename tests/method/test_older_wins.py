"""In a bucket the older feature stays, whatever its strength; among equally old ones the stronger."""

from __future__ import annotations

from itertools import permutations

import numpy as np
import pytest

from vo_lib.config import BucketConfig
from vo_lib.method.buckets import select_by_bucket

# Age and strength, best first: a feature seen for long is kept though it is the weakest of all.
RANKING = [(9, 1.0), (4, 8.0), (4, 2.0), (1, 50.0), (1, 30.0)]


@pytest.mark.parametrize("most", [1, 2, 3, 4])
def test_older_and_weaker_goes_before_younger_and_stronger(most: int) -> None:
    for order in permutations(range(5)):
        age, strength = (np.array(column) for column in zip(*(RANKING[i] for i in order), strict=True))
        uv = np.linspace([20.0, 20.0], [24.0, 24.0], 5)
        kept = select_by_bucket(uv, age, strength, BucketConfig(size=50, features=most))
        assert {order[i] for i in kept.tolist()} == set(range(most))


def test_buckets_are_squares_that_do_not_compete() -> None:
    # At 49 and 50 pixels two features are neighbours in different buckets, along each axis.
    uv = np.array([[49.0, 49.0], [50.0, 49.0], [49.0, 50.0], [50.0, 50.0], [0.0, 0.0]])
    age, strength = np.array([1, 1, 1, 1, 2]), np.ones(5)
    kept = select_by_bucket(uv, age, strength, BucketConfig(size=50, features=1))
    assert kept.tolist() == [1, 2, 3, 4]
