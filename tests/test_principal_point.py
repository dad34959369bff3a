"""A principal point that is off shows in turns; where the calibration is good, none is invented."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from conftest import winding_road

from vo_lib import preset
from vo_lib.beyond.principal_point import PrincipalPoint, by_points, shrunk
from vo_lib.beyond.refinement import refine
from vo_lib.config import CalibrationConfig
from vo_lib.core import settings
from vo_lib.core.boxes import no_boxes
from vo_lib.core.camera import StereoCamera
from vo_lib.core.geometry import essential_from_motion, inverse, rotation_angle
from vo_lib.core.sampson import match_terms, sampson_distance
from vo_lib.core.types import Array
from vo_lib.data.sequence import Sequence
from vo_lib.evaluation.kitti import kitti_errors
from vo_lib.runs.runner import FoundMatches, make_odometry, run
from vo_lib.synthetic.tracks import TrackConfig, simulate_tracks

CAMERA = StereoCamera(f=718.856, cx=607.2, cy=185.2, baseline=0.537, width=1241, height=376)


def off_by(du: float, dv: float) -> StereoCamera:
    """The camera with a principal point that is off."""
    return dataclasses.replace(CAMERA, cx=CAMERA.cx + du, cy=CAMERA.cy + dv)


def drive(
    off: tuple[float, float],
    wrong: float = 0.0,
    on: bool = True,
    config: CalibrationConfig | None = None,
    turn: float = 0.05,
    stretch: float = 0.0,
) -> tuple[PrincipalPoint, Array]:
    """What is learnt along a winding road, and the errors of the rotations on the way, degrees.

    turn : largest of a frame, radians; gentle turns all go to the right.
    stretch : pixels by which flow is too long along u and too short along v.
    """
    centre, angles = PrincipalPoint(off_by(*off), config or CalibrationConfig()), []
    tracks = simulate_tracks(
        winding_road(150, turn, 0.8, one_way=turn < 0.01),
        CAMERA,
        TrackConfig(points=350, noise=0.1, wrong=wrong),
        seed=5,
    )
    for frame in tracks:
        x_p, x_c = (centre.camera.normalise(uv) for uv in (frame.matches.prev_left, frame.matches.cur_left))
        x_c = x_c + stretch / CAMERA.f * x_c * [2.0, 1.0]
        R, direction = frame.T_cp[:3, :3], frame.T_cp[:3, 3] / np.linalg.norm(frame.T_cp[:3, 3])
        R, direction = refine(R, direction, match_terms(x_p, x_c), 0.5 / CAMERA.f)
        angles.append(np.degrees(rotation_angle(R @ inverse(frame.T_cp)[:3, :3])))
        if on:
            centre.update(x_p, x_c, R, direction)
    return centre, np.array(angles)


@pytest.mark.parametrize("off", [(8.0, -5.0), (-4.0, 6.0)])
@pytest.mark.parametrize("wrong", [0.0, 0.05])
def test_a_principal_point_that_is_off_is_found(off: tuple[float, float], wrong: float) -> None:
    # The tracks have nothing but noise: nothing is to be inflated.
    config = CalibrationConfig(centre_noise_inflation=1.0, centre_floor=0.0, centre_deviation=10.0)
    centre, _ = drive(off, wrong, config=config)
    np.testing.assert_allclose(centre.shift * CAMERA.f, off, atol=1.0)
    assert centre.camera.cx == pytest.approx(CAMERA.cx, abs=1.0)
    assert centre.camera.cy == pytest.approx(CAMERA.cy, abs=1.0)


@pytest.mark.parametrize("wrong", [0.0, 0.05])
def test_a_good_one_is_left_where_it_is(wrong: float) -> None:
    centre, _ = drive((0.0, 0.0), wrong)
    np.testing.assert_allclose(centre.shift * CAMERA.f, 0.0, atol=0.1)


@pytest.mark.parametrize("stretch", [0.05, -0.05])
def test_a_common_stretch_of_the_flow_is_no_shift(stretch: float) -> None:
    centre, _ = drive((0.0, 0.0), turn=0.005, stretch=stretch)
    np.testing.assert_allclose(centre.shift * CAMERA.f, 0.0, atol=0.5)
    # Without the unknown that takes it, it passes for one.
    alone = CalibrationConfig(flow_stretch=0.0001)
    fooled, _ = drive((0.0, 0.0), config=alone, turn=0.005, stretch=stretch)
    assert abs(fooled.shift[0] * CAMERA.f) > 3.0
    off, _ = drive((8.0, -5.0), stretch=stretch)
    np.testing.assert_allclose(off.shift * CAMERA.f, [8.0, -5.0], atol=2.5)


def test_the_rotations_get_better_with_it() -> None:
    _, with_it = drive((12.0, 8.0))
    _, without = drive((12.0, 8.0), on=False)
    assert np.median(with_it[80:]) < 0.3 * np.median(without[80:])


def test_the_derivative_is_that_of_the_distance() -> None:
    rng = np.random.default_rng(1)
    E = essential_from_motion(np.eye(3) + rng.normal(0, 0.01, (3, 3)), rng.normal(size=3))
    x_p, x_c = rng.uniform(-0.6, 0.6, (2, 7, 2))
    by_p, by_c = by_points(E, x_p, x_c, sampson_distance(E, x_p, x_c))
    for axis, h in enumerate(1e-6 * np.eye(2)):
        previous = sampson_distance(E, x_p + h, x_c) - sampson_distance(E, x_p - h, x_c)
        current = sampson_distance(E, x_p, x_c + h) - sampson_distance(E, x_p, x_c - h)
        np.testing.assert_allclose(by_p[axis], previous / 2e-6, rtol=1e-6, atol=1e-8)
        np.testing.assert_allclose(by_c[axis], current / 2e-6, rtol=1e-6, atol=1e-8)


def test_what_noise_explains_is_taken_for_noise() -> None:
    information = np.diag([1.0, 4.0, 1.0])  # standard deviations 1 and 0.5
    for mean, floor, expected in (
        ([0.9, -0.4], 0.0, [0.0, 0.0]),
        ([2.0, -1.0], 0.0, [1.5, -0.75]),
        ([0.0, 0.0], 0.0, [0.0, 0.0]),
        ([4.0, -1.0], 3.0**0.5, [3.0, 0.0]),  # variances 1 + 3 and 0.25 + 3
    ):
        found = shrunk(information, information @ [*mean, 0.3], floor, prior=10.0)
        np.testing.assert_allclose(found, expected, atol=1e-12)


def test_what_the_frames_know_less_of_than_the_calibration_did_is_left_alone() -> None:
    information = np.diag([1.0, 4.0, 1.0])  # variances 1 and 0.25
    vector = information @ [4.0, 4.0, 0.0]
    np.testing.assert_array_equal(shrunk(information, vector, 0.0, prior=1.4) > 0, [False, True])
    np.testing.assert_array_equal(shrunk(information, vector, 0.0, prior=1.5) > 0, [True, True])


def test_what_is_farther_off_than_any_calibration_is_not_believed() -> None:
    information = np.diag([1.0, 1.0, 1.0])
    np.testing.assert_array_equal(shrunk(information, information @ [5.0, 31.0, 0.0], 0.0, 10.0), [0.0, 0.0])
    assert np.all(shrunk(information, information @ [5.0, 29.0, 0.0], 0.0, 10.0) > 4.0)


def test_a_frame_learnt_twice_as_carefully_counts_a_quarter() -> None:
    information = []
    for inflation in (2.0, 4.0):
        again = PrincipalPoint(
            CAMERA, CalibrationConfig(centre_noise_inflation=inflation, centre_deviation=100.0)
        )
        before = again.information
        rng = np.random.default_rng(0)
        x = rng.uniform([-0.8, -0.2], [0.8, 0.2], (50, 2))
        again.update(x, 1.05 * x + rng.normal(0, 1e-4, x.shape), np.eye(3), np.array([0.0, 0.0, 1.0]))
        information.append((again.information - before)[:2, :2])
    np.testing.assert_allclose(information[0], 4.0 * information[1], rtol=1e-6)


def test_points_without_any_error_teach_nothing_and_do_no_harm() -> None:
    centre, x = PrincipalPoint(CAMERA, CalibrationConfig()), np.zeros((20, 2))
    centre.update(x, x, np.eye(3), np.array([0.0, 0.0, 1.0]))
    np.testing.assert_array_equal(centre.shift, np.zeros(2))


@pytest.mark.parametrize("method", ["solution_selection", "viso2"])
def test_the_odometry_finds_it_and_its_camera_says_so(street: Sequence, method: str) -> None:
    config, camera = preset(method), street.camera
    wrong = dataclasses.replace(camera, cx=camera.cx + 15.0, cy=camera.cy - 10.0)
    odometry = make_odometry(wrong, config)
    odometry.start(no_boxes())
    for i, (matches, _) in enumerate(FoundMatches(street, config.features, config.matching)):
        if i:
            odometry.step(matches, no_boxes())
    assert np.hypot(odometry.camera.cx - camera.cx, odometry.camera.cy - camera.cy) < 0.5 * np.hypot(15, 10)


def test_boxes_are_judged_with_the_camera_as_known(street: Sequence) -> None:
    config, camera = preset("moving_selection"), street.camera
    wrong = dataclasses.replace(camera, cx=camera.cx + 15.0, cy=camera.cy - 10.0)
    learning = make_odometry(wrong, config)
    told = settings.replace(config, "calibration.estimate", False)
    known, nominal = make_odometry(camera, told), make_odometry(wrong, told)
    steps: dict[str, list[Array]] = {"learning": [], "known": [], "nominal": []}
    for name, odometry in (("learning", learning), ("known", known), ("nominal", nominal)):
        odometry.start(street.boxes(0))
        for i, (matches, _) in enumerate(FoundMatches(street, config.features, config.matching)):
            if i:
                odometry.step(matches, street.boxes(i))
                assert odometry.filtered is not None
                assert odometry.filtered.judgement is not None
                steps[name].append(odometry.filtered.judgement.step)
    apart = {
        name: np.nanmedian(np.linalg.norm(np.concatenate(found) - np.concatenate(steps["known"]), axis=1))
        for name, found in steps.items()
    }
    assert apart["learning"] < 0.7 * apart["nominal"]


def test_a_run_with_a_wrong_principal_point_is_better_with_it(street: Sequence) -> None:
    camera = street.camera
    wrong = dataclasses.replace(
        street, camera=dataclasses.replace(camera, cx=camera.cx + 15.0, cy=camera.cy - 10.0)
    )
    assert street.truth is not None
    found = []
    for on in (True, False):
        config = settings.replace(preset("solution_selection"), "calibration.estimate", on)
        errors = kitti_errors(street.truth, run(wrong, config).poses, [20.0], 1)
        assert errors.te is not None
        found.append(errors.te)
    assert found[0] < 0.7 * found[1]
