"""A decentered lens is found from turns and straight roads; where the lens is good, none is invented."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from faulty_camera import CAMERA, F, Faults, drive

from vo_lib import preset
from vo_lib.beyond.lens import Lens, by_points, decentering_shapes, shrunk
from vo_lib.beyond.refinement import refine
from vo_lib.config import CalibrationConfig
from vo_lib.core import settings
from vo_lib.core.boxes import no_boxes
from vo_lib.core.geometry import essential_from_motion, rotation_angle
from vo_lib.core.sampson import match_terms, sampson_distance
from vo_lib.core.types import Array
from vo_lib.data.sequence import Sequence
from vo_lib.evaluation.kitti import kitti_errors
from vo_lib.runs.runner import FoundMatches, make_odometry, run_methods

# Noise is all there is in these drives: nothing is to be inflated.
TRUSTING = CalibrationConfig(lens_noise_inflation=1.0, lens_floor=0.0, lens_deviation=3.0)


def learnt(
    faults: Faults,
    config: CalibrationConfig = TRUSTING,
    frames: int = 100,
    turn: float = 0.03,
    stretch: float = 0.0,
    on: bool = True,
) -> tuple[Lens, Array]:
    """What a winding drive teaches of the lens, and the errors of the rotations on the way, degrees.

    turn : largest of a frame, radians. stretch : pixels by which flow is too long along u, half along v.
    """
    lens, angles = Lens(CAMERA, config), []
    for matches, R_cp, t_cp in drive(frames, faults, 0.1, yaw=lambda i: turn * np.sin(i / 9)):
        corrected = lens.correct(matches)
        x_p, x_c = (CAMERA.normalise(uv) for uv in (corrected.prev_left, corrected.cur_left))
        x_c = x_c + stretch / F * x_c * [2.0, 1.0]
        R, direction = refine(R_cp, t_cp / np.linalg.norm(t_cp), match_terms(x_p, x_c), 0.5 / F)
        angles.append(np.degrees(rotation_angle(R @ R_cp.T)))
        if on:
            lens.update(x_p, x_c, R, direction)
    return lens, np.array(angles)


@pytest.mark.parametrize(("p1", "p2"), [(1.2, -1.4), (-0.8, 1.0)])
@pytest.mark.parametrize("turn", [0.0, 0.03])
def test_a_decentered_lens_is_found_in_turns_and_on_straight_roads(p1: float, p2: float, turn: float) -> None:
    lens, _ = learnt(Faults(p1=p1, p2=p2), turn=turn)
    # What is learnt takes the error away.
    np.testing.assert_allclose(lens.pixels, (-p1, -p2), atol=0.2)


@pytest.mark.parametrize("method", ["solution_selection", "viso2"])
def test_both_estimators_find_it_beside_an_error_of_the_disparities(method: str) -> None:
    odometry = make_odometry(CAMERA, dataclasses.replace(preset(method), calibration=TRUSTING))
    odometry.start(no_boxes())
    off, faults = [], Faults(lambda x, y: 0 * x + 0.8, p1=1.5, p2=-1.5)
    for matches, _, t_cp in drive(60, faults, 0.1, yaw=lambda i: 0.05 * np.sin(i / 4)):
        T_cp = odometry.step(matches, no_boxes(), seconds=0.1).T_cp
        off.append(np.linalg.norm(T_cp[:3, 3] - t_cp))
    np.testing.assert_allclose(odometry.lens.pixels, (-1.5, 1.5), atol=0.3)
    assert np.median(off[20:]) < 0.02  # metres, of steps of one
    assert max(off) < 0.3


@pytest.mark.parametrize("stretch", [0.0, 0.05])
def test_a_good_lens_is_left_alone(stretch: float) -> None:
    lens, _ = learnt(Faults(), CalibrationConfig(), stretch=stretch)
    np.testing.assert_array_equal(lens.decentering, np.zeros(2))


def test_rotations_get_better_with_it() -> None:
    faults = Faults(p1=2.0, p2=-2.0)
    _, with_it = learnt(faults)
    _, without = learnt(faults, on=False)
    assert np.median(with_it[50:]) < 0.4 * np.median(without[50:])


def test_corrected_points_are_where_a_perfect_lens_shows_them() -> None:
    faults = Faults(p1=1.2, p2=-1.4)
    lens = Lens(CAMERA, TRUSTING)
    lens.decentering = np.array([-1.2, 1.4]) / F
    exact, _, _ = next(drive(1, Faults(), noise=0.0))
    faulty, _, _ = next(drive(1, faults, noise=0.0))
    mended = lens.correct(faulty)
    for view in ("prev_left", "prev_right", "cur_left", "cur_right"):
        before = np.abs(getattr(faulty, view) - getattr(exact, view)).max()
        after = np.abs(getattr(mended, view) - getattr(exact, view)).max()
        assert after < 0.05 < 1.0 < before


def test_the_derivative_is_that_of_the_distance() -> None:
    rng = np.random.default_rng(1)
    E = essential_from_motion(np.eye(3) + rng.normal(0, 0.01, (3, 3)), rng.normal(size=3))
    x_p, x_c = rng.uniform(-0.6, 0.6, (2, 7, 2))

    def distance(p: Array, c: Array) -> Array:
        return sampson_distance(E, p, c)

    by_p, by_c = by_points(E, x_p, x_c, distance(x_p, x_c))
    for axis, h in enumerate(1e-6 * np.eye(2)):
        previous = distance(x_p + h, x_c) - distance(x_p - h, x_c)
        current = distance(x_p, x_c + h) - distance(x_p, x_c - h)
        np.testing.assert_allclose(by_p[axis], previous / 2e-6, rtol=1e-6, atol=1e-8)
        np.testing.assert_allclose(by_c[axis], current / 2e-6, rtol=1e-6, atol=1e-8)


def test_shapes_are_browns() -> None:
    (p1, p2) = decentering_shapes(np.array([[0.5, -0.2]]))
    np.testing.assert_allclose(p1[:, 0], [2 * 0.5 * -0.2, 0.29 + 2 * 0.04])
    np.testing.assert_allclose(p2[:, 0], [0.29 + 2 * 0.25, 2 * 0.5 * -0.2])


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


def test_a_frame_learnt_twice_as_carefully_counts_a_quarter() -> None:
    information = []
    for inflation in (2.0, 4.0):
        again = Lens(CAMERA, CalibrationConfig(lens_noise_inflation=inflation, lens_deviation=100.0))
        before = again.information
        rng = np.random.default_rng(0)
        x = rng.uniform([-0.8, -0.2], [0.8, 0.2], (50, 2))
        again.update(x, 1.05 * x + rng.normal(0, 1e-4, x.shape), np.eye(3), np.array([0.0, 0.0, 1.0]))
        information.append((again.information - before)[:2, :2])
    np.testing.assert_allclose(information[0], 4.0 * information[1], rtol=1e-6)


def test_points_without_any_error_teach_nothing_and_do_no_harm() -> None:
    lens, x = Lens(CAMERA, CalibrationConfig()), np.zeros((20, 2))
    lens.update(x, x, np.eye(3), np.array([0.0, 0.0, 1.0]))
    np.testing.assert_array_equal(lens.decentering, np.zeros(2))


def test_a_run_with_a_decentered_lens_is_better_with_it(street: Sequence) -> None:
    base = preset("solution_selection")
    configs = {str(on): settings.replace(base, "calibration.estimate", on) for on in (True, False)}
    part = street.part(0, 80)
    frames = FoundMatches(part, base.features, base.matching)
    wrong = Lens(part.camera, TRUSTING)
    wrong.decentering = np.array([4.0, -4.0]) / part.camera.f
    spoiled = ((wrong.correct(matches), ms) for matches, ms in frames)
    runs = run_methods(part, configs, matches=spoiled)
    assert part.truth is not None
    te = {name: kitti_errors(part.truth, result.poses, [20.0], 1).te for name, result in runs.items()}
    assert te["True"] is not None
    assert te["False"] is not None
    assert te["True"] < 0.8 * te["False"]
