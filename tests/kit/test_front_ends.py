"""The front ends of both variants through one interface."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from box_scenes import CAMERA, match_points
from conftest import BANDS, HEIGHT, small

from vo_lib import open_sequence, preset
from vo_lib.data.sequence import Sequence
from vo_lib.geometry.matches import StereoMatches
from vo_lib.geometry.motion import rotation_from_vector
from vo_lib.kit.klt import next_motion
from vo_lib.paper.settings import FeatureConfig
from vo_lib.runs.front_end import FrontEnd, make_front_end

FEATURES = FeatureConfig(blob_cell=9, blob_quality=30)
# Lower limit of the number of matches; upper limits of the errors' median and 90 or 95 % quantile, pixels.
FRONT_ENDS = {"kit": (60, 0.02, 0.1), "published": (30, 0.03, 0.2)}


def opened(sequence: Sequence, kind: str) -> FrontEnd:
    if kind == "kit":
        return make_front_end(sequence.camera, small())
    return make_front_end(sequence.camera, replace(preset("mesvo_f"), features=FEATURES))


def follow(folder: Path, kind: str) -> list[StereoMatches]:
    sequence = open_sequence(folder)
    front_end = opened(sequence, kind)
    return [front_end.step(front_end.prepare(sequence.stereo(i))) for i in range(len(sequence))]


@pytest.mark.parametrize("kind", FRONT_ENDS)
def test_matches_have_the_true_disparity(bands: Path, kind: str) -> None:
    least, middle, most = FRONT_ENDS[kind]
    for matches in follow(bands, kind)[1:]:
        assert len(matches) > least
        row = matches.prev_left[:, 1]
        disparity = np.array(BANDS)[(row // (HEIGHT / len(BANDS))).astype(int)]
        clear = np.abs((row % (HEIGHT / len(BANDS))) - HEIGHT / len(BANDS) / 2) < 12
        for left, right in (
            (matches.prev_left, matches.prev_right),
            (matches.cur_left, matches.cur_right),
            (matches.prev_left, matches.cur_left),
        ):
            error = np.abs(left - right - np.stack([disparity, 0 * disparity], axis=1))[clear]
            assert np.median(error) < middle
            assert np.percentile(error, 95 if kind == "kit" else 90) < most


@pytest.mark.parametrize("kind", FRONT_ENDS)
def test_age_and_id_continue_over_frames(bands: Path, kind: str) -> None:
    first, before, after = follow(bands, kind)[2:5]
    _, i, j = np.intersect1d(before.id, after.id, return_indices=True)
    assert len(i) > 15
    np.testing.assert_array_equal(after.age[j], before.age[i] + 1)
    # In variant `published`, each pair starts from whole pixels, up to 2 px from the refined position.
    apart = 0.0 if kind == "kit" else 2.0
    np.testing.assert_allclose(after.prev_left[j], before.cur_left[i], rtol=0, atol=apart)
    np.testing.assert_allclose(after.prev_right[j], before.cur_right[i], rtol=0, atol=apart)
    assert len(np.unique(after.id)) == len(after)
    assert after.id[after.age == 1].min() > first.id.max()


@pytest.mark.parametrize("kind", FRONT_ENDS)
def test_black_images_give_no_matches(bands: Path, kind: str) -> None:
    sequence = open_sequence(bands)
    front_end = opened(sequence, kind)
    black = np.zeros_like(sequence.stereo(0)[0])
    front_end.step(front_end.prepare(sequence.stereo(0)))
    assert len(front_end.step(front_end.prepare((black, black)))) == 0
    assert len(front_end.step(front_end.prepare(sequence.stereo(2)))) == 0
    assert len(front_end.step(front_end.prepare(sequence.stereo(3)))) > FRONT_ENDS[kind][0]


def test_next_search_starts_from_the_last_motion() -> None:
    X_p = np.random.default_rng(4).uniform((-4.0, -2.0, 5.0), (4.0, 2.0, 20.0), (60, 3))
    R, t = rotation_from_vector(np.array([0.01, 0.03, 0.0])), np.array([0.1, 0.0, -0.8])
    result, agree = next_motion(CAMERA, match_points(X_p, X_p @ R.T + t), None)
    assert result is not None
    assert agree == 60
    np.testing.assert_allclose(result[:3, :3], R, atol=1e-3)
    np.testing.assert_allclose(result[:3, 3], t, atol=1e-2)


@pytest.mark.parametrize("window", [5, 27, 41])
def test_every_refinement_window_gives_matches(bands: Path, window: int) -> None:
    sequence = open_sequence(bands).part(0, 2)
    front_end = make_front_end(sequence.camera, small(matching__subpixel_window=window))
    assert len([front_end.step(front_end.prepare(sequence.stereo(i))) for i in range(2)][-1]) > 10
