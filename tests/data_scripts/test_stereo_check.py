"""Checks for swapped images, wrong baselines and shifted rows, on a drawn pair and a real pair."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
import pytest
from real_images import RealImages

from fetch.stereo_check import PairStatistics, complaints, measure_pairs
from vo_lib.data.sequence import Sequence
from vo_lib.geometry.types import Image

Pair = tuple[Image, Image]


@pytest.fixture(scope="module")
def drawn(street: Sequence) -> list[Pair]:
    """A pair of a drawn street."""
    return [street.stereo(0)]


@pytest.fixture(scope="module", params=["drawn", "00", "drive_0013"])
def pairs(request: pytest.FixtureRequest) -> list[Pair]:
    """A drawn pair and a real pair."""
    if request.param == "drawn":
        result: list[Pair] = request.getfixturevalue("drawn")
        return result
    real: RealImages = request.getfixturevalue("real")
    return [real.sequence(request.param, 40, 42).stereo(0)]


def changed(pairs: list[Pair], change: Callable[[Image], Image]) -> PairStatistics:
    """Statistics of pairs after a change of the right images."""
    return measure_pairs((left, change(right)) for left, right in pairs)


def test_rectified_pair_has_no_complaints(pairs: list[Pair]) -> None:
    result = measure_pairs(pairs)
    assert complaints(result, 0.54) == []
    assert result.disparity > 3
    assert result.negative < 0.05
    assert abs(result.row) < 0.5


def test_swapped_images_and_wrong_baselines_are_reported(pairs: list[Pair]) -> None:
    swapped = measure_pairs((right, left) for left, right in pairs)
    (words,) = complaints(swapped, 0.54)
    assert words.startswith("left and right are swapped")
    (words,) = complaints(swapped, -0.54)
    assert "the baseline is negative too" in words
    (words,) = complaints(measure_pairs(pairs), -0.54)
    assert words.startswith("the baseline has the wrong sign (-0.54 m)")


@pytest.mark.parametrize("rows", [4, -3])
def test_shifted_rows_are_reported(pairs: list[Pair], rows: int) -> None:
    result = changed(pairs, partial(np.roll, shift=rows, axis=0))
    assert result.row == pytest.approx(rows, abs=0.5)
    (words,) = complaints(result, 0.54)
    assert "rows do not match" in words
