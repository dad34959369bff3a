"""What single panels add to the common pattern: fates of features, own pose files, running a method."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from course.ch01.figures import four_images, walk
from course.ch01.panel import MatchingPanel, MatchingView, with_view
from course.ch01.trace import KEPT, REASONS, trace
from course.ch02.figures import epipolar_line, pixels
from course.ch02.panel import FivePointPanel, rotation_errors
from course.ch04.panel import covariance
from course.ch04.weightings import alone
from course.ch05.figures import cells_picture
from course.ch05.panel import as_yolox
from course.ch06.panel import EvaluationPanel, read_own
from course.colours import GOOD, bgr
from course.drawing import WIDTH
from course.frames import frame_points
from vo_lib import open_sequence
from vo_lib.config import Config, FeatureConfig, MatchingConfig, TranslationConfig, preset
from vo_lib.core.errors import DataError
from vo_lib.core.geometry import rotation_from_vector
from vo_lib.core.poses import write_kitti_poses, write_tum
from vo_lib.data.sequence import Sequence
from vo_lib.detection.yolo import Candidates
from vo_lib.detection.yolo_layout import letterbox, read_yolox, yolox_cells
from vo_lib.method.five_point import five_point
from vo_lib.method.translation import feature_rows

NOTEBOOKS = Path(__file__).parents[2] / "notebooks"
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


def test_only_the_good_one_of_chapter_2s_candidates_has_its_line_through_the_sixth_match(
    street: Sequence,
) -> None:
    cells = (NOTEBOOKS / "02_five_point.ipynb").read_text(encoding="utf-8")
    numbers = [
        re.search(pattern, cells) for pattern in (r"five = np.array\(\[([\d, ]+)\]", r"sixth = \[(\d+)\]")
    ]
    five, (sixth,) = ([int(word) for word in found[1].split(",")] for found in numbers if found)
    points, camera = frame_points(street, 60, preset("solution_selection")), street.camera
    assert points.T_cp is not None
    E = five_point(points.x_p[five][None], points.x_c[five][None]).E
    errors = rotation_errors(E, points.T_cp[:3, :3])
    place = np.append(pixels(points.x_c[sixth], camera), 1.0)
    off = np.array([abs(epipolar_line(each, points.x_p[sixth], camera) @ place) for each in E])
    best = int(np.argmin(errors))
    assert len(E) == 6
    assert errors[best] < 0.1
    assert off[best] < 1.0 < 10.0 < np.delete(off, best).min()


def test_chapter_1_says_what_its_panel_shows(street: Sequence) -> None:
    def facts(**values: Any) -> dict[str, float]:
        panel.set(**{**usual, **values})
        return panel.facts

    panel = MatchingPanel(street, 60)
    tolerances = ("max_difference", "row_tolerance", "surface_tolerance", "loop_tolerance")
    usual = {f"matching__{name}": panel.knobs[f"matching.{name}"].value for name in tolerances}
    first = facts()
    strict, loose = facts(matching__loop_tolerance=0.1), facts(matching__loop_tolerance=5.0)
    everything = facts(**{name: panel.knobs[name.replace("__", ".")].widget.max for name in usual})
    published = facts(view__variant="published")
    assert strict["kept"] < 0.8 * first["kept"] < loose["kept"] < 1.1 * first["kept"]
    assert everything["kept"] > first["kept"]
    assert everything["wrong among the kept"] > first["wrong among the kept"]
    assert published["features"] > 3 * first["features"]
    assert published["found again"] < 0.3 * published["features"]
    assert published["wrong among the kept"] > 2 * first["wrong among the kept"]
    assert facts(view__variant="published", matching__max_difference=5.0) == published


def test_chapter_2_says_what_its_panel_shows(street: Sequence) -> None:
    panel = FivePointPanel(street, 60)
    cases = {"few": (10, 0.0), "many": (1000, 0.0), "noisy": (1000, 0.5)}
    names = ("median error of a set", "error of the consensus winner")
    mean = {}
    for case, (sets, noise) in cases.items():
        found = []
        for frame in (20, 60, 100):
            panel.set(frame=frame, view__sets=sets, view__noise=noise)
            found.append([panel.facts[each] for each in names])
        mean[case] = np.mean(found, axis=0)
    assert mean["many"][0] == pytest.approx(mean["few"][0], rel=0.5)
    assert mean["many"][1] < 0.5 * mean["few"][1]
    assert mean["noisy"][0] > 3 * mean["many"][0]


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
