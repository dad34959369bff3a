"""The loop of four images on a sequence that is exact in whole pixels."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from conftest import BANDS, HEIGHT

from vo_lib import Sequence, open_sequence
from vo_lib.config import FeatureConfig, MatchingConfig
from vo_lib.core.matches import StereoMatches
from vo_lib.front_end.klt import LoopMatcher, PreparedPair, prepare_pair
from vo_lib.front_end.surface import coarse_disparity


def prepared(sequence: Sequence, index: int) -> PreparedPair:
    return prepare_pair(sequence.stereo(index), FeatureConfig(), MatchingConfig())


def follow(folder: Path) -> list[StereoMatches]:
    sequence = open_sequence(folder)
    matcher = LoopMatcher(sequence.camera, FeatureConfig(cell=10), MatchingConfig())
    return [matcher.step(prepared(sequence, i)) for i in range(len(sequence))]


def test_matches_are_right_to_a_tenth_of_a_pixel(bands: Path) -> None:
    all_matches = follow(bands)
    assert len(all_matches[0]) == 0
    for matches in all_matches[1:]:
        assert len(matches) > 60
        row = matches.prev_left[:, 1]
        # Away from the seams between bands, where a window sees two depths.
        clear = np.abs((row % (HEIGHT / len(BANDS))) - HEIGHT / len(BANDS) / 2) < 12
        disparity = np.array(BANDS)[(row // (HEIGHT / len(BANDS))).astype(int)]
        for left, right in (
            (matches.prev_left, matches.prev_right),
            (matches.cur_left, matches.cur_right),
            (matches.prev_left, matches.cur_left),
        ):
            error = np.abs(left - right - np.stack([disparity, 0 * disparity], axis=1))[clear]
            assert np.median(error) < 0.02
            assert np.percentile(error, 95) < 0.1


def test_a_feature_keeps_its_number_and_grows_older(bands: Path) -> None:
    before, after = follow(bands)[2:4]
    both, i, j = np.intersect1d(before.id, after.id, return_indices=True)
    assert len(both) > 40
    np.testing.assert_array_equal(after.age[j], before.age[i] + 1)
    np.testing.assert_array_equal(after.prev_left[j], before.cur_left[i])
    assert len(np.unique(after.id)) == len(after)


def test_coarse_disparity_is_near_on_every_band(bands: Path) -> None:
    left, right = open_sequence(bands).stereo(0)
    rows = (np.arange(len(BANDS)) + 0.5) * HEIGHT / len(BANDS)
    found = coarse_disparity(left, right, 64)[(rows / 2).astype(int), 30:220]
    assert found.shape == (len(BANDS), 190)
    near = np.abs(found - np.array(BANDS)[:, None]) < 2
    assert near[found > 0].mean() > 0.8
    assert (found > 0).mean() > 0.7


def test_black_images_give_no_matches_and_no_error(bands: Path) -> None:
    sequence = open_sequence(bands)
    matcher = LoopMatcher(sequence.camera, FeatureConfig(cell=10), MatchingConfig())
    black = np.zeros_like(sequence.stereo(0)[0])
    matcher.step(prepared(sequence, 0))
    assert len(matcher.step(prepare_pair((black, black), FeatureConfig(), MatchingConfig()))) == 0
    assert len(matcher.step(prepared(sequence, 2))) == 0
    assert len(matcher.step(prepared(sequence, 3))) > 60


@pytest.mark.parametrize("frames", [3])
def test_matches_are_chosen_by_mask_and_by_index(bands: Path, frames: int) -> None:
    matches = follow(bands)[frames]
    some = matches[np.array([4, 2])]
    assert len(some) == 2
    np.testing.assert_array_equal(some.cur_right, matches.cur_right[[4, 2]])
    assert len(matches[matches.age > 1]) == np.count_nonzero(matches.age > 1)
