"""Selection and joining of rows of an object with several arrays."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from vo_lib.geometry.rows import Rows, joined
from vo_lib.geometry.types import Array, IntArray


@dataclass(frozen=True, eq=False)
class Points(Rows):
    """Example of `Rows` with pixels (N, 2) and numbers (N,)."""

    uv: Array
    number: IntArray


POINTS = Points(np.arange(8.0).reshape(4, 2), np.arange(4))


@pytest.mark.parametrize("index", [np.array([3, 1]), np.array([False, True, False, True]), np.zeros(0, int)])
def test_index_selects_the_same_rows_of_every_array(index: IntArray) -> None:
    some = POINTS[index]
    np.testing.assert_array_equal(some.uv, POINTS.uv[index])
    np.testing.assert_array_equal(some.number, POINTS.number[index])
    assert len(some) == len(POINTS.number[index])


def test_parts_are_joined_in_their_order() -> None:
    parts = [POINTS[np.array([2])], POINTS[np.zeros(0, int)], POINTS[np.array([0, 1])]]
    assert joined(parts).number.tolist() == [2, 0, 1]
    assert joined(iter(parts)).uv.tolist() == [[4, 5], [0, 1], [2, 3]]
