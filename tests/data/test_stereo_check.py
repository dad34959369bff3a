"""Swapped images, wrong baselines and rows that do not match, on drawn and on real pairs."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from vo_lib.core.errors import DataError
from vo_lib.core.types import Image
from vo_lib.data.sequence import Sequence, open_sequence
from vo_lib.data.stereo_check import PairStatistics, complaints, measure_pairs

Pair = tuple[Image, Image]


@pytest.fixture(scope="module")
def drawn(street: Sequence) -> list[Pair]:
    """A pair of a drawn street."""
    return [street.stereo(0)]


@pytest.fixture(scope="module", params=["drawn", "00", "01", "drive_0005"])
def pairs(request: pytest.FixtureRequest) -> list[Pair]:
    """Drawn and real pairs."""
    if request.param == "drawn":
        found: list[Pair] = request.getfixturevalue("drawn")
        return found
    clips: Path = request.getfixturevalue("clips")
    sequence = open_sequence(clips / "sequences" / request.param)
    return [sequence.stereo(40)]


def changed(pairs: list[Pair], change: Callable[[Image], Image]) -> PairStatistics:
    """Statistics with the right images changed."""
    return measure_pairs((left, change(right)) for left, right in pairs)


def test_a_rectified_pair_is_in_order(pairs: list[Pair]) -> None:
    found = measure_pairs(pairs)
    assert complaints(found, 0.54) == []
    assert found.disparity > 3
    assert found.negative < 0.05
    assert abs(found.row) < 0.5


def test_swapped_images_are_told_from_a_wrong_baseline(pairs: list[Pair]) -> None:
    swapped = measure_pairs((right, left) for left, right in pairs)
    (words,) = complaints(swapped, 0.54)
    assert words.startswith("left and right are swapped")
    (words,) = complaints(swapped, -0.54)
    assert "the baseline is negative too" in words
    (words,) = complaints(measure_pairs(pairs), -0.54)
    assert words.startswith("the baseline has the wrong sign (-0.54 m)")


@pytest.mark.parametrize(("rows", "word"), [(4, "lower"), (-3, "higher")])
def test_shifted_rows_are_measured_and_named(pairs: list[Pair], rows: int, word: str) -> None:
    found = changed(pairs, lambda image: np.roll(image, rows, axis=0))
    assert found.row == pytest.approx(rows, abs=0.5)
    (words,) = complaints(found, 0.54)
    assert f"px {word} than the left one" in words


def test_a_turned_camera_is_told_from_a_shift(pairs: list[Pair]) -> None:
    def turn(image: Image) -> Image:
        height, width = image.shape
        matrix = cv2.getRotationMatrix2D((width / 2, height / 2), 1.0, 1.0)
        return np.asarray(cv2.warpAffine(image, matrix, (width, height)), np.uint8)

    words = complaints(changed(pairs, turn), 0.54)
    assert any("one camera is turned" in sentence for sentence in words)


def test_principal_points_that_differ_show_in_the_disparities(drawn: list[Pair]) -> None:
    shift = int(measure_pairs(drawn).disparity)
    words = complaints(changed(drawn, lambda image: np.roll(image, shift, axis=1)), 0.54)
    assert any("principal points differ" in sentence for sentence in words)


def test_images_of_different_scenes_are_said(drawn: list[Pair], clips: Path) -> None:
    real = open_sequence(clips / "sequences" / "00").stereo(0)[1]
    left = cv2.resize(drawn[0][0], (real.shape[1], real.shape[0]))
    (words,) = complaints(measure_pairs([(np.asarray(left, np.uint8), real)]), 0.54)
    assert "same scene" in words


def test_one_image_given_for_both_is_said(drawn: list[Pair]) -> None:
    (words,) = complaints(measure_pairs((left, left) for left, _ in drawn), 0.54)
    assert words == "left and right are the same images: there is no depth in them"


def test_images_without_anything_in_them_have_no_matches() -> None:
    empty = np.zeros((100, 200), np.uint8)
    assert "only 0 matches" in complaints(measure_pairs([(empty, empty)]), 0.5)[0]


def test_images_of_different_sizes_are_refused() -> None:
    with pytest.raises(DataError, match="200×100 and 200×99"):
        measure_pairs([(np.zeros((100, 200), np.uint8), np.zeros((99, 200), np.uint8))])
