"""What single panels add to the common pattern: fates of features, own pose files, running a method."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from course.ch01.figures import four_images, walk
from course.ch01.panel import MatchingView, with_view
from course.ch01.trace import KEPT, REASONS, trace
from course.ch04.panel import covariance
from course.ch04.weightings import alone
from course.ch05.figures import cells_picture
from course.ch05.panel import as_yolox
from course.ch06.panel import EvaluationPanel, read_own
from course.drawing import GOOD, WIDTH, bgr
from vo_lib import open_sequence
from vo_lib.config import Config, FeatureConfig, MatchingConfig, TranslationConfig
from vo_lib.core.errors import DataError
from vo_lib.core.geometry import rotation_from_vector
from vo_lib.core.poses import write_kitti_poses, write_tum
from vo_lib.detection.yolo import Candidates
from vo_lib.detection.yolo_layout import letterbox, read_yolox, yolox_cells
from vo_lib.method.translation import feature_rows

LONG = 300.0  # seconds; a safeguard
FEATURES = FeatureConfig(cell=10)


@pytest.mark.parametrize("variant", ["kit", "published"])
def test_every_feature_has_one_fate(bands: Path, variant: str) -> None:
    settings = with_view(Config(), MatchingView(variant=variant, spacing=10, threshold=0.5))
    traced = trace(open_sequence(bands), 3, *settings)
    assert len(traced.left) == len(traced.id) == len(traced.reason)
    np.testing.assert_array_equal(traced.id[traced.index], traced.found.id)
    assert (traced.reason[traced.index] > 0).all()
    np.testing.assert_array_equal(np.sort(traced.kept.id), np.sort(traced.id[traced.reason == KEPT]))
    assert len(traced.kept) > 20


def test_a_strict_check_is_blamed_for_what_it_drops(bands: Path) -> None:
    sequence = open_sequence(bands)
    usual = trace(sequence, 3, FEATURES, MatchingConfig())
    strict = trace(sequence, 3, FEATURES, replace(MatchingConfig(), max_difference=1.0))
    first = REASONS.index("looks different")
    assert np.count_nonzero(strict.reason == first) > np.count_nonzero(usual.reason == first)
    assert len(strict.kept) < len(usual.kept)


def test_a_walk_round_the_loop_of_an_exact_scene_comes_back(bands: Path) -> None:
    uv = np.array([[200.0, 20.0], [200.0, 60.0], [260.0, 100.0]])
    matches, back, found = walk(four_images(open_sequence(bands), 2), uv)
    assert found.all()
    np.testing.assert_allclose(back, uv, atol=0.2)
    np.testing.assert_allclose((matches.prev_left - matches.prev_right)[:, 0], (4, 6, 9), atol=0.2)


def test_the_scatter_of_exact_matches_is_small(bands: Path) -> None:
    sequence = open_sequence(bands)
    kept = trace(sequence, 3, FEATURES, MatchingConfig()).kept
    each = alone(*feature_rows(sequence.camera, kept, np.eye(3)))
    np.testing.assert_allclose(np.median(each, axis=0), (-0.5, 0.0, 0.0), atol=0.02)
    C = covariance(sequence.camera, kept, np.eye(3), TranslationConfig())
    assert (np.linalg.eigvalsh(C) >= 0).all()
    turned = covariance(
        sequence.camera, kept, rotation_from_vector(np.array([0.0, 0.05, 0.0])), TranslationConfig()
    )
    assert np.trace(turned) > np.trace(C)


def test_own_poses_are_read_in_both_formats(bands: Path, tmp_path: Path) -> None:
    truth = open_sequence(bands).truth
    assert truth is not None
    write_kitti_poses(tmp_path / "kitti.txt", truth)
    write_tum(tmp_path / "tum.txt", np.linspace(0.0, 0.5, len(truth)), truth)
    for name in ("kitti.txt", "tum.txt"):
        np.testing.assert_allclose(read_own(str(tmp_path / name), truth), truth, atol=1e-8)
    write_kitti_poses(tmp_path / "short.txt", truth[:-1])
    with pytest.raises(DataError, match="6 poses and the estimate 5"):
        read_own(str(tmp_path / "short.txt"), truth)


def test_typing_a_file_judges_it(bands: Path) -> None:
    panel = EvaluationPanel(str(bands), frame=1, view__lengths="1,2")
    panel.wait(LONG)
    assert panel.error == ""
    assert panel.facts["TE"] > 0.5
    file = panel.knobs["view.file"].widget
    file.value = str(bands / "poses.txt")
    assert panel.error == ""
    assert panel.facts["TE"] == pytest.approx(0.0, abs=1e-6)
    file.value = str(bands / "nothing.txt")
    assert "nothing.txt" in panel.error


def test_a_method_is_run_and_judged(bands: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    panel = EvaluationPanel(str(bands), frame=1, view__lengths="1,2")
    panel.wait(LONG)
    panel.run()
    panel.wait(LONG)
    assert "choose one of the methods" in panel.error
    panel.set(view__estimate="mesvo_f")
    assert "press Run" in panel._text.value
    panel.run()
    panel.wait(LONG)
    assert panel.error == ""
    assert 0 < panel.facts["TE"] < 20


def made_up_candidates() -> Candidates:
    """Boxes all over an image of 96×64 px, two classes; the first cell is the surest of stride 8."""
    rng, number = np.random.default_rng(0), yolox_cells(96, 64)
    first = rng.uniform(0, 50, (number, 2))
    scores = rng.uniform(0, 0.5, (number, 2))
    scores[0], scores[1] = (0.9, 0.1), 0.0
    corners = np.hstack([first, first + rng.uniform(4, 40, (number, 2))])
    return Candidates(letterbox(96, 64, 96, 64), corners, scores, 96, 64)


def test_candidates_in_the_layout_of_yolox_are_read_back() -> None:
    found = made_up_candidates()
    corners, scores = read_yolox(as_yolox(found), 96, 64)
    np.testing.assert_allclose(corners, found.corners, atol=1e-4)
    np.testing.assert_allclose(scores, found.scores, atol=1e-6)


def test_the_surest_cell_is_filled() -> None:
    found = made_up_candidates()
    found.corners[0] = 40, 30, 80, 60
    picture = cells_picture(np.zeros((64, 96), np.uint8), found.plan, found.corners, found.scores)
    cell = 8 * WIDTH // 96
    # Below the words and beside the line to the centre.
    np.testing.assert_array_equal(picture[cell - 3, 3], bgr(GOOD))
    assert (picture[round(45 * WIDTH / 96), round(60 * WIDTH / 96)] == 255).all()
