"""The paper's loop matching: how far the finish may go, how near a thing may be."""

from __future__ import annotations

import numpy as np
import pytest
from conftest import texture

from vo_lib.geometry.types import Image
from vo_lib.paper.matching import describe_pair, track
from vo_lib.paper.settings import FeatureConfig, MatchingConfig

FEATURES = FeatureConfig(blob_cell=9, blob_quality=30)
MARGIN = 100
WALL = texture(np.random.default_rng(1), 160, 320 + 2 * MARGIN, 2.0)


def seen(left_edge: int) -> Image:
    """The wall from `left_edge` on."""
    return np.ascontiguousarray(WALL[:, left_edge : left_edge + 320])


@pytest.mark.parametrize(("apart", "within"), [(1.5, True), (3.0, False)])
def test_the_finish_moves_a_place_by_two_pixels_at_most(apart: float, within: bool) -> None:
    image = seen(0)
    u, v = np.meshgrid(np.arange(40.0, 280, 30), np.arange(30.0, 130, 25))
    uv = np.stack([u.ravel(), v.ravel()], axis=1)
    found, ok, _ = track(image, image, uv, uv + np.array([apart, 0.0]), 21)
    arrived = np.linalg.norm(found - uv, axis=1) < 0.1
    assert np.count_nonzero(arrived) > 20
    assert (ok[arrived] == within).all()


@pytest.mark.parametrize(("disparity", "largest", "seen_in_both"), [(30, 32, True), (30, 24, False)])
def test_nothing_is_matched_beyond_the_largest_disparity_or_to_the_wrong_side(
    disparity: int, largest: int, seen_in_both: bool
) -> None:
    settings = MatchingConfig(max_disparity=largest)
    for shift, there in ((disparity, seen_in_both), (-disparity, False)):
        pair = describe_pair((seen(MARGIN), seen(MARGIN + shift)), FEATURES, settings)
        for index, query, train, sign in (
            (pair.to_right, pair.in_left, pair.in_right, 1),
            (pair.to_left, pair.in_right, pair.in_left, -1),
        ):
            ok = index >= 0
            moved = sign * (query.uv[ok] - train.uv[index[ok]])[:, 0]
            assert ((moved >= 0) & (moved <= largest)).all()
            assert (np.mean(moved == shift) > 0.8) == there
