"""Parts of variant `kit` that the settings `without` turn off, for comparisons."""

from __future__ import annotations

import dataclasses
from functools import reduce
from pathlib import Path

import numpy as np
import pytest
from conftest import small
from faulty_camera import CAMERA, KITTI, Faults, drive

from vo_lib import open_sequence, preset, run
from vo_lib.config import change
from vo_lib.data.sequence import Sequence
from vo_lib.errors import DataError
from vo_lib.geometry.camera import StereoCamera
from vo_lib.geometry.matches import StereoMatches
from vo_lib.geometry.types import Array, Image
from vo_lib.kit.klt import KltMatcher
from vo_lib.kit.rig import ERROR_NAMES, FIELD_COUNT, Rig, field_at, prior_covariance
from vo_lib.kit.settings import CalibrationConfig, KitConfig, KitTranslationConfig
from vo_lib.kit.weighted_translation import papers_translation, robust_translation
from vo_lib.paper.matching import LoopMatcher
from vo_lib.paper.translation import solve_translation
from vo_lib.runs.front_end import make_front_end
from vo_lib.settings import declared

COLUMNS, ROWS = slice(360, 880), slice(100, 300)  # a part of the images is enough
FIRST = 100
FRONT_END_PARTS = next(each.choices for each in declared(KitConfig) if each.name == "matching.without")
CALIBRATION_PARTS = next(each.choices for each in declared(KitConfig) if each.name == "calibration.without")


def dimmed(image: Image, factor: float) -> Image:
    return np.asarray(np.clip(np.rint(factor * image), 0, 255), np.uint8)


@pytest.fixture(scope="module")
def disturbed(street: Sequence) -> tuple[StereoCamera, list[tuple[Image, Image]]]:
    """Images with unequal cameras, then flicker and a leap: every part of the front end has work."""
    whole = street.camera
    pairs = []
    for i, index in enumerate((0, 1, 2, 3, 9, 10, 11)):
        factor = (1.0, 1.0, 1.0, 0.65, 1.35, 0.65, 1.35)[i]
        left, right = (image[ROWS, COLUMNS] for image in street.stereo(FIRST + index))
        pairs.append((dimmed(left, factor), dimmed(right, 0.8 * factor)))
    height, width = pairs[0][0].shape
    camera = StereoCamera(
        whole.f, whole.cx - COLUMNS.start, whole.cy - ROWS.start, whole.baseline, width, height
    )
    return camera, pairs


def matches_of(camera: StereoCamera, pairs: list[tuple[Image, Image]], *without: str) -> list[StereoMatches]:
    config = change(preset("solution_selection", variant="kit"), "matching.without", without)
    front_end = make_front_end(camera, config)
    return [front_end.step(front_end.prepare(pair)) for pair in pairs]


@pytest.fixture(scope="module")
def complete(disturbed: tuple[StereoCamera, list[tuple[Image, Image]]]) -> list[StereoMatches]:
    return matches_of(*disturbed)


@pytest.mark.parametrize("part", FRONT_END_PARTS)
def test_each_part_of_the_front_end_changes_the_matches(
    disturbed: tuple[StereoCamera, list[tuple[Image, Image]]], complete: list[StereoMatches], part: str
) -> None:
    changed = matches_of(*disturbed, part)
    same = [
        len(one) == len(other) and np.array_equal(one.cur_left, other.cur_left)
        for one, other in zip(complete, changed, strict=True)
    ]
    assert not all(same)


def test_matching_goes_on_without_prediction_and_second_search(
    disturbed: tuple[StereoCamera, list[tuple[Image, Image]]],
) -> None:
    # Without a prediction there is only one search; it is not a second one.
    alone = matches_of(*disturbed, "prediction")
    both = matches_of(*disturbed, "prediction", "second-search")
    assert [len(matches) for matches in both] == [len(matches) for matches in alone]
    assert min(len(matches) for matches in alone[1:4]) > 50


def test_without_tracking_the_papers_matcher_has_the_kits_limits() -> None:
    config = small(matching__without=("tracking",), matching__max_disparity=48, features__border=20)
    matcher = make_front_end(CAMERA, config)
    assert isinstance(matcher, LoopMatcher)
    assert matcher.config.max_disparity == 48
    assert matcher.feature_config.border == 20
    assert isinstance(make_front_end(CAMERA, small(matching__without=("prediction",))), KltMatcher)


def rig_after_drive(faults: Faults, *without: str) -> Rig:
    rig = Rig(CAMERA, CalibrationConfig(without=without))
    for matches, R_cp, t_cp in drive(40, faults):
        rig.update_from_rows(matches)
        rig.update(rig.correct(matches), R_cp, t_cp)
    return rig


FAULTS = dataclasses.replace(KITTI, p1=2.0, k1=12.0)


@pytest.fixture(scope="module")
def whole_rig() -> Rig:
    return rig_after_drive(FAULTS)


@pytest.mark.parametrize("part", CALIBRATION_PARTS)
def test_each_part_of_the_calibration_changes_the_correction(whole_rig: Rig, part: str) -> None:
    assert np.abs(rig_after_drive(FAULTS, part).errors - whole_rig.errors).max() > 0.01


@pytest.mark.parametrize(
    ("part", "held"),
    [
        ("field", ("disparity", "row")),
        ("field-shape", ("disparity x", "disparity y", "row x", "row y")),
        ("lens", ("p1", "p2", "k1", "k2")),
    ],
)
def test_held_errors_stay_at_zero(whole_rig: Rig, part: str, held: tuple[str, ...]) -> None:
    chosen = np.array([name.startswith(held) for name in ERROR_NAMES])
    assert np.abs(whole_rig.estimate[chosen]).max() > 0.5
    rig = rig_after_drive(FAULTS, part)
    assert np.abs(rig.estimate[chosen]).max() < 1e-3
    assert np.abs(rig.estimate[~chosen]).max() > 0.05


def test_left_out_faults_have_no_variance() -> None:
    """A relative focal length changes disparities by x and rows by y: one fault, seen at the image's edge."""
    x, y = np.array([0.8]), np.array([0.0])

    def variance(*without: str) -> float:
        covariance = prior_covariance(without)[:FIELD_COUNT, :FIELD_COUNT]
        effect = np.stack([field_at(row, x, y)[0] for row in np.eye(len(ERROR_NAMES))])[:FIELD_COUNT, 0]
        return float(effect @ covariance @ effect)

    assert variance("focal-length") == pytest.approx(variance() - 0.8**2, rel=1e-6)
    assert variance("undistortion") < variance() - 1.0
    assert variance("rows", "shrinking") == variance()
    # A group that is named twice is the same group.
    np.testing.assert_array_equal(
        prior_covariance(("lens", "undistortion", "lens")), prior_covariance(("undistortion", "lens"))
    )


def test_rows_and_shrinking_can_be_left_out_of_the_calibration() -> None:
    rig = Rig(CAMERA, CalibrationConfig(without=("rows",)))
    for matches, _, _ in drive(3, FAULTS):
        rig.update_from_rows(matches)
    assert not rig.estimate.any()
    unshrunk = rig_after_drive(FAULTS, "shrinking")
    np.testing.assert_array_equal(unshrunk.errors, unshrunk.estimate)


def with_car(outliers: int) -> tuple[StereoMatches, Array, Array]:
    """Matches with noise, the first of which are on a car, and the camera's rotation and translation."""
    matches, R_cp, t_cp = next(iter(drive(1, Faults(), noise=0.2)))
    moved = matches.cur_left.copy()
    moved[:outliers] += (6.0, 0.0)
    return dataclasses.replace(matches, cur_left=moved), R_cp, t_cp


def test_without_robust_start_a_car_pulls_the_translation() -> None:
    matches, R_cp, t_cp = with_car(120)
    off = {}
    for without in ((), ("robust-start",)):
        solution = robust_translation(
            CAMERA, matches, R_cp, KitTranslationConfig(without=without, iterations=1)
        )
        assert solution is not None
        off[without] = float(np.linalg.norm(solution[0] - t_cp))
    assert off[()] < 0.5 * off["robust-start",]


def test_without_robust_solution_the_paper_solves() -> None:
    matches, R_cp, _ = with_car(20)
    config = KitTranslationConfig(agreement=1.0)
    solved = papers_translation(CAMERA, matches, R_cp, config)
    expected = solve_translation(CAMERA, matches, R_cp, preset("solution_selection").translation)
    assert solved is not None
    assert expected is not None
    np.testing.assert_array_equal(solved[0], expected[0])
    np.testing.assert_array_equal(solved[1] == 0.0, expected[1])


def test_translation_of_a_run_is_the_papers_without_the_robust_solution(bands: Path) -> None:
    sequence = open_sequence(bands)
    paths = {
        without: run(sequence, small(translation__without=without)).poses
        for without in ((), ("robust-solution",), ("robust-start",))
    }
    assert not np.array_equal(paths[()], paths["robust-solution",])
    for poses in paths.values():
        np.testing.assert_allclose(poses[-1, :3, 3], (2.5, 0.0, 0.0), atol=0.02)


def test_unknown_parts_are_refused() -> None:
    (item,) = [each for each in declared(KitConfig) if each.name == "calibration.without"]
    assert item.parse("lens,rows") == ("lens", "rows")
    assert item.parse("") == ()
    for text in ("lenses", "lens,field_shape", "LENS"):
        with pytest.raises(DataError, match="is not one of field, field-shape, "):
            item.parse(text)
    with pytest.raises(DataError):
        item.check("lens")


def test_nothing_is_left_out_by_default() -> None:
    for item in declared(KitConfig):
        if item.name.endswith(".without"):
            assert not reduce(getattr, item.name.split("."), KitConfig())
