"""The paper's loop matching: best match, closed loops, sub-pixel refinement, range of disparities."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from conftest import texture

from vo_lib.geometry.types import BoolArray, Image, Index
from vo_lib.paper.features import DescribedFeatures, best_matches, describe, stereo_matches
from vo_lib.paper.matching import close_loop, describe_pair, track
from vo_lib.paper.settings import FeatureConfig, MatchingConfig

FEATURES = FeatureConfig(blob_cell=9, blob_quality=30)
MARGIN = 100
WALL = texture(np.random.default_rng(1), 160, 320 + 2 * MARGIN, 2.0)


def view(left_edge: int) -> Image:
    """The part of the wall to the right of `left_edge`."""
    return np.ascontiguousarray(WALL[:, left_edge : left_edge + 320])


def two_images() -> tuple[Image, Image]:
    """Blurred noise, repeated side by side and mirrored, so that some descriptors occur twice."""
    image = np.random.default_rng(1).integers(0, 255, (80, 120), np.uint8)
    image = np.tile(np.asarray(cv2.GaussianBlur(image, (5, 5), 1), np.uint8), (1, 2))
    return image, image[:, ::-1].copy()


def most_alike(a: DescribedFeatures, b: DescribedFeatures, near: BoolArray) -> Index:
    """Index (N,) of the most similar feature of the same kind; the mask near (N, M) limits the choice."""
    near = near & (a.kind[:, None] == b.kind)
    difference = np.abs(a.descriptor[:, None] - b.descriptor).sum(axis=2)
    match = np.where(near.any(axis=1), np.argmin(np.where(near, difference, np.inf), axis=1), -1)
    assert np.count_nonzero(match >= 0) > 20
    return match


@pytest.mark.parametrize("radius", [8, 30, 200])
def test_best_match_has_the_smallest_difference(radius: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("vo_lib.paper.features.BATCH_FEATURES", 4)
    a, b = (describe(image, FEATURES) for image in two_images())
    near = np.all(np.abs(a.uv[:, None] - b.uv) <= radius, axis=2)
    np.testing.assert_array_equal(best_matches(a, b, radius), most_alike(a, b, near))


@pytest.mark.parametrize("largest", [16, 37, 240])
def test_stereo_match_has_the_smallest_difference(largest: int) -> None:
    a, b = (describe(image, FEATURES) for image in two_images())
    disparity, row = np.moveaxis(a.uv[:, None] - b.uv, 2, 0)
    near = (disparity >= 0) & (disparity <= largest) & (np.abs(row) <= 2)
    to_right, to_left = stereo_matches(a, b, largest)
    np.testing.assert_array_equal(to_right, most_alike(a, b, near))
    np.testing.assert_array_equal(to_left, most_alike(b, a, near.T))


def test_loop_closes_where_four_best_matches_return() -> None:
    settings = MatchingConfig(max_disparity=32)
    images = [(view(u), view(u + 10)) for u in (MARGIN, MARGIN + 7)]
    for _, right in images:  # a step of one row: left and right features have different orders
        right[:, :160] = np.roll(right[:, :160], 1, axis=0)
    before, pair = (describe_pair(each, FEATURES, settings) for each in images)
    place = np.arange(len(before.to_right))
    ways = (
        before.to_right,
        best_matches(before.in_right, pair.in_right, 20),
        pair.to_left,
        best_matches(pair.in_left, before.in_left, 20),
    )
    steps = [place]
    for way in ways:
        steps.append(np.where(steps[-1] >= 0, way[steps[-1]], -1))
    closed = steps[-1] == place
    assert 20 < np.count_nonzero(closed) < np.count_nonzero(steps[-1] >= 0)
    prev_left, prev_right, cur_right, cur_left, _ = (step[closed] for step in steps)
    loop = close_loop(before, pair, 20)
    np.testing.assert_array_equal(loop, [prev_left, prev_right, cur_left, cur_right])


@pytest.mark.parametrize(("apart", "within"), [(1.5, True), (3.0, False)])
def test_refinement_moves_at_most_two_pixels(apart: float, within: bool) -> None:
    image = view(0)
    u, v = np.meshgrid(np.arange(40.0, 280, 30), np.arange(30.0, 130, 25))
    uv = np.stack([u.ravel(), v.ravel()], axis=1)
    result, ok, _ = track(image, image, uv, uv + np.array([apart, 0.0]), 21)
    arrived = np.linalg.norm(result - uv, axis=1) < 0.1
    assert np.count_nonzero(arrived) > 20
    assert (ok[arrived] == within).all()


@pytest.mark.parametrize(("disparity", "largest", "seen_in_both"), [(30, 32, True), (30, 24, False)])
def test_matches_respect_the_disparity_range(disparity: int, largest: int, seen_in_both: bool) -> None:
    settings = MatchingConfig(max_disparity=largest)
    for shift, there in ((disparity, seen_in_both), (-disparity, False)):
        pair = describe_pair((view(MARGIN), view(MARGIN + shift)), FEATURES, settings)
        for index, query, train, sign in (
            (pair.to_right, pair.in_left, pair.in_right, 1),
            (pair.to_left, pair.in_right, pair.in_left, -1),
        ):
            ok = index >= 0
            moved = sign * (query.uv[ok] - train.uv[index[ok]])[:, 0]
            assert ((moved >= 0) & (moved <= largest)).all()
            assert (np.mean(moved == shift) > 0.8) == there
