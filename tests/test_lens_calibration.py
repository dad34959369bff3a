"""What the undistortion left of a lens shows in the epipolar geometry; none is invented."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest
from conftest import winding_road

from vo_lib import preset, settings
from vo_lib.camera import StereoCamera
from vo_lib.config import CalibrationConfig
from vo_lib.detection import no_boxes
from vo_lib.geometry import Array, inverse, rotation_angle
from vo_lib.lens_calibration import LensError, decentering, measured_distances
from vo_lib.odometry import Odometry
from vo_lib.refinement import refine
from vo_lib.runner import FoundMatches
from vo_lib.sampson import match_terms
from vo_lib.sequence import Sequence
from vo_lib.synthetic.tracks import TrackConfig, simulate_tracks

CAMERA = StereoCamera(f=718.856, cx=607.2, cy=185.2, baseline=0.537, width=1241, height=376)


def drive(
    number: int, lens: tuple[float, float], wrong: float = 0.0, on: bool = True
) -> tuple[LensError, Array]:
    """The lens learnt along a winding road, and the errors of the rotations on the way, degrees."""
    poses = winding_road(number, 0.02, 0.8)
    error = LensError(CAMERA.f, CalibrationConfig(lens_caution=1.0, lens_deviation=5.0))
    bent = LensError(CAMERA.f, CalibrationConfig())
    bent.coefficients = -np.array(lens) / CAMERA.f
    angles = []
    for frame in simulate_tracks(poses, CAMERA, TrackConfig(points=350, noise=0.1, wrong=wrong), seed=5):
        x_p, x_c = (
            bent.correct(CAMERA.normalise(uv)) for uv in (frame.matches.prev_left, frame.matches.cur_left)
        )
        R, direction = frame.T_cp[:3, :3], frame.T_cp[:3, 3] / np.linalg.norm(frame.T_cp[:3, 3])
        corrected = match_terms(error.correct(x_p), error.correct(x_c))
        R, direction = refine(R, direction, corrected, 0.5 / CAMERA.f)
        angles.append(np.degrees(rotation_angle(R @ inverse(frame.T_cp)[:3, :3])))
        if on:
            error.update(x_p, x_c, R, direction)
    return error, np.array(angles)


# The correction undoes what bent the points; p1 and p2 of KITTI's size.
@pytest.mark.parametrize("lens", [(0.0, 0.0), (1.3, -1.5), (-0.6, -0.8)])
@pytest.mark.parametrize("wrong", [0.0, 0.05])
def test_the_lens_is_learnt_on_the_way(lens: tuple[float, float], wrong: float) -> None:
    error, _ = drive(150, lens, wrong)
    np.testing.assert_allclose(error.coefficients * CAMERA.f, lens, atol=0.3)


def test_the_rotations_get_better_with_it() -> None:
    _, with_it = drive(80, (2.6, -3.0))
    _, without = drive(80, (2.6, -3.0), on=False)
    assert np.median(with_it[30:]) < 0.6 * np.median(without[30:])


def test_a_frame_learnt_twice_as_carefully_counts_a_quarter() -> None:
    information = []
    for caution in (2.0, 4.0):
        again = LensError(CAMERA.f, CalibrationConfig(lens_caution=caution, lens_deviation=100.0))
        rng = np.random.default_rng(0)
        x = rng.uniform([-0.8, -0.2], [0.8, 0.2], (50, 2))
        again.update(x, 1.05 * x + rng.normal(0, 1e-4, x.shape), np.eye(3), np.array([0.0, 0.0, 1.0]))
        information.append(again.information - np.eye(2) * (CAMERA.f / 100.0) ** 2)
    np.testing.assert_allclose(information[0], 4.0 * information[1], rtol=1e-6)


def test_the_terms_are_browns() -> None:
    x, y = 0.6, -0.2
    p1, p2 = decentering(np.array([[x], [y]]), np.eye(2))
    r2 = x * x + y * y
    np.testing.assert_allclose(p1[:, 0], [2 * x * y, r2 + 2 * y * y])
    np.testing.assert_allclose(p2[:, 0], [r2 + 2 * x * x, 2 * x * y])


def test_points_without_any_error_teach_nothing_and_do_no_harm() -> None:
    error = LensError(CAMERA.f, CalibrationConfig())
    x = np.zeros((20, 2))
    error.update(x, x, np.eye(3), np.array([0.0, 0.0, 1.0]))
    np.testing.assert_array_equal(error.coefficients, np.zeros(2))


def test_distances_are_divided_by_the_gradient_of_the_points_as_measured() -> None:
    rng = np.random.default_rng(1)
    E, coefficients = rng.normal(size=(3, 3)), np.array([[0.03, -0.05], [0.0, 0.0]])
    x_p, x_c = rng.uniform(-0.6, 0.6, (2, 7, 2))

    def residual(lens: Array, p: Array, c: Array) -> Array:
        error = LensError(CAMERA.f, CalibrationConfig())
        error.coefficients = lens
        p, c = (np.column_stack([error.correct(x), np.ones(len(x))]) for x in (p, c))
        return np.asarray(np.sum(c * (p @ E.T), axis=1))

    for lens, found in zip(coefficients, measured_distances(E, x_p, x_c, coefficients), strict=True):
        h = 1e-6 * np.eye(2)
        gradient = [residual(lens, x_p + d, x_c) - residual(lens, x_p - d, x_c) for d in h]
        gradient += [residual(lens, x_p, x_c + d) - residual(lens, x_p, x_c - d) for d in h]
        expected = residual(lens, x_p, x_c) / np.linalg.norm(np.array(gradient) / 2e-6, axis=0)
        np.testing.assert_allclose(found, expected, rtol=1e-6)


def test_the_odometry_learns_all_of_a_lens(street: Sequence) -> None:
    """Features of a drawn street, bent as by a lens, go through the whole method."""
    lens = np.array([1.5, -2.0])
    config = settings.replace(preset("solution_selection"), "calibration.lens_caution", 1.0)
    config = settings.replace(config, "calibration.lens_deviation", 10.0)
    street, camera, centre = street.part(0, 120), street.camera, (street.camera.cx, street.camera.cy)
    bend, odometry = LensError(camera.f, config.calibration), Odometry(camera, config)
    bend.coefficients = -lens / camera.f
    odometry.start(no_boxes())
    for i, (matches, _) in enumerate(FoundMatches(street, config.features, config.matching)):
        if i:
            moved: dict[str, Any] = {
                name: camera.f * bend.correct(camera.normalise(getattr(matches, name))) + centre
                for name in ("prev_left", "prev_right", "cur_left", "cur_right")
            }
            odometry.step(dataclasses.replace(matches, **moved), no_boxes())
    np.testing.assert_allclose(odometry.state()["lens"] * camera.f, lens, atol=0.6)
