"""The calibration against a camera with known faults, written here from the pinhole equations alone.

Nothing of the library makes these matches: a point (X, Y, Z) is seen at u = f X / Z + cx, v = f Y / Z + cy,
its disparity is f b / Z, and the faults are added to that.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
import pytest

from vo_lib.beyond.calibration import StereoCalibration, estimate_disparity_error
from vo_lib.beyond.principal_point import PrincipalPoint
from vo_lib.beyond.refinement import refine
from vo_lib.beyond.row_calibration import RowError
from vo_lib.config import CalibrationConfig
from vo_lib.core.camera import StereoCamera
from vo_lib.core.matches import StereoMatches
from vo_lib.core.sampson import match_terms
from vo_lib.core.types import Array

F, CX, CY, B = 700.0, 600.0, 180.0, 0.5
CAMERA = StereoCamera(f=F, cx=CX, cy=CY, baseline=B, width=1200, height=360)


@dataclass(frozen=True)
class Faults:
    """What is wrong: disparities too large by `offset` + `quadratic` x², rows of the left image too large by
    `rows` (x, y), pixels, and an image that is shifted by (`right`, `down`) against the nominal centre."""

    offset: float = 0.0
    quadratic: float = 0.0
    rows: Callable[[Array, Array], Array] | None = None
    right: float = 0.0
    down: float = 0.0


def yaw_matrix(angle: float) -> Array:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])


def pair(X: Array, faults: Faults, noise: float, rng: np.random.Generator) -> tuple[Array, Array]:
    """Left and right pixels (N, 2) of points (N, 3)."""
    x, y = X[:, 0] / X[:, 2], X[:, 1] / X[:, 2]
    u, v = F * x + CX + faults.right, F * y + CY + faults.down
    disparity = F * B / X[:, 2] + faults.offset + faults.quadratic * x * x
    right_v = v if faults.rows is None else v - faults.rows(x, y)
    left, right = np.stack([u, v], axis=1), np.stack([u - disparity, right_v], axis=1)
    return left + rng.normal(0, noise, left.shape), right + rng.normal(0, noise, right.shape)


def drive(
    frames: int,
    faults: Faults,
    noise: float = 0.2,
    points: int = 300,
    yaw: Callable[[int], float] = lambda i: 0.01 * np.sin(i / 5),
    step: float = 1.0,
) -> Iterator[tuple[StereoMatches, Array, Array]]:
    """Matches, R_cp and t_cp of a camera that goes `step` metres ahead a frame and turns by `yaw` radians."""
    rng = np.random.default_rng(11)
    for i in range(frames):
        R_cp, t_cp = yaw_matrix(yaw(i)), np.array([0.0, 0.0, -step])
        z = rng.uniform(5.0, 45.0, points)
        x, y = rng.uniform(-0.8, 0.8, points), rng.uniform(-0.25, 0.25, points)
        X_p = np.stack([x * z, y * z, z], axis=1)
        before, now = (pair(X, faults, noise, rng) for X in (X_p, X_p @ R_cp.T + t_cp))
        whole = np.arange(points)
        yield StereoMatches(*before, *now, whole * 0 + 1, np.ones(points), whole), R_cp, t_cp


@pytest.mark.parametrize(("offset", "quadratic"), [(0.0, 0.0), (-1.1, 0.0), (0.6, -0.9), (0.0, 1.0)])
def test_the_disparity_field_is_found_within_its_own_deviation(offset: float, quadratic: float) -> None:
    true = np.array([offset, quadratic])
    calibration = StereoCalibration(CAMERA, CalibrationConfig(noise_inflation=1.0, drift=0.001))
    for matches, R_cp, t_cp in drive(40, Faults(offset, quadratic)):
        calibration.update(calibration.correct(matches), R_cp, t_cp)
    deviation = np.sqrt(np.diag(calibration.covariance))
    assert np.all(deviation < [0.05, 0.15])
    assert np.all(np.abs(calibration.disparity - true) < 3.0 * deviation)


def test_corrected_disparities_are_those_of_the_points() -> None:
    calibration = StereoCalibration(CAMERA, CalibrationConfig())
    faults = Faults(0.8, -0.7, lambda x, y: 0.3 + 0.4 * x - 0.5 * x * y)
    for matches, R_cp, t_cp in drive(40, faults):
        calibration.learn_rows(matches)
        calibration.update(calibration.correct(matches), R_cp, t_cp)
    exact, _, _ = next(drive(1, Faults(), noise=0.0))
    faulty, _, _ = next(drive(1, faults, noise=0.0))
    mended = calibration.correct(faulty)
    np.testing.assert_allclose(mended.prev_right, exact.prev_right, atol=0.1)
    np.testing.assert_allclose(mended.cur_right, exact.cur_right, atol=0.1)
    np.testing.assert_array_equal(mended.prev_left, faulty.prev_left)


def test_every_frame_that_moves_shrinks_the_covariance_of_the_disparities() -> None:
    calibration = StereoCalibration(CAMERA, CalibrationConfig(drift=0.0))
    for matches, R_cp, t_cp in drive(25, Faults(-0.5, 0.3)):
        before = calibration.covariance
        calibration.update(calibration.correct(matches), R_cp, t_cp)
        # In every direction, not only in the sum.
        assert np.linalg.eigvalsh(before - calibration.covariance)[0] > 0
        assert np.linalg.eigvalsh(calibration.covariance)[0] > 0


def test_what_one_frame_knows_of_the_disparities_grows_with_its_matches() -> None:
    spread = {}
    for points in (200, 800):
        found = [
            estimate_disparity_error(CAMERA, matches, R_cp, t_cp, 0.5)
            for matches, R_cp, t_cp in drive(10, Faults(-0.5, 0.3), points=points)
        ]
        spread[points] = np.mean([np.diag(each[1]) for each in found if each is not None], axis=0)
    np.testing.assert_allclose(spread[200] / spread[800], 4.0, rtol=0.25)


def test_one_frame_scatters_as_much_as_it_says() -> None:
    found = [
        estimate_disparity_error(CAMERA, matches, R_cp, t_cp, 0.5)
        for matches, R_cp, t_cp in drive(100, Faults(-0.5, 0.3), points=200)
    ]
    errors = [each[0] for each in found if each is not None]
    told = [np.sqrt(np.diag(each[1])) for each in found if each is not None]
    np.testing.assert_allclose(np.std(errors, axis=0), np.mean(told, axis=0), rtol=0.25)


def test_a_slow_frame_knows_less_of_the_disparities() -> None:
    """Without parallax nothing betrays them: at a tenth of the speed a frame knows a hundredth."""
    spread = {}
    for step in (0.1, 1.0):
        found = [
            estimate_disparity_error(CAMERA, matches, R_cp, t_cp, 0.5)
            for matches, R_cp, t_cp in drive(10, Faults(), step=step, yaw=lambda i: 0.0)
        ]
        spread[step] = np.mean([np.diag(each[1]) for each in found if each is not None], axis=0)
    assert np.all(spread[0.1] > 30.0 * spread[1.0])


ROWS: dict[str, Callable[[Array, Array], Array]] = {
    "a pixel higher": lambda x, y: np.full_like(x, -0.9),
    "rolled": lambda x, y: 0.6 * x,
    "stretched": lambda x, y: -1.2 * y,
    "bent": lambda x, y: 0.4 * x * x - 2.0 * x * y + 1.5 * y * y,
}


@pytest.mark.parametrize("fault", ROWS)
def test_the_difference_of_rows_is_found_all_over_the_image(fault: str) -> None:
    rows, found = ROWS[fault], RowError(CalibrationConfig())
    for matches, _, _ in drive(20, Faults(rows=rows)):
        found.update(CAMERA, matches.cur_left, matches.cur_right)
    x, y = (grid.ravel() for grid in np.meshgrid(np.linspace(-0.7, 0.7, 9), np.linspace(-0.2, 0.2, 5)))
    np.testing.assert_allclose(found.at(x, y), rows(x, y), atol=0.06)


def test_every_frame_shrinks_the_covariance_of_the_rows() -> None:
    found = RowError(CalibrationConfig(row_memory=1e6))
    for matches, _, _ in drive(15, Faults(rows=ROWS["bent"])):
        before = np.linalg.inv(found.information)
        found.update(CAMERA, matches.cur_left, matches.cur_right)
        assert np.linalg.eigvalsh(before - np.linalg.inv(found.information))[0] > 0


def learnt(
    faults: Faults, frames: int = 120, watch: Callable[[Array, Array], None] | None = None
) -> PrincipalPoint:
    """What a winding drive teaches of the principal point, the motion refined frame by frame."""
    config = CalibrationConfig(centre_noise_inflation=1.0, centre_floor=0.0, centre_deviation=10.0)
    centre = PrincipalPoint(CAMERA, config)
    for matches, R_cp, t_cp in drive(frames, faults, 0.1, yaw=lambda i: 0.05 * np.sin(i / 9)):
        x_p, x_c = (centre.camera.normalise(uv) for uv in (matches.prev_left, matches.cur_left))
        R, direction = refine(R_cp, t_cp / np.linalg.norm(t_cp), match_terms(x_p, x_c), 0.5 / F)
        before = centre.information
        centre.update(x_p, x_c, R, direction)
        if watch is not None:
            watch(before, centre.information)
    return centre


@pytest.mark.parametrize(("right", "down"), [(7.0, -4.0), (-5.0, 6.0)])
def test_a_shifted_image_shifts_the_principal_point(right: float, down: float) -> None:
    centre = learnt(Faults(right=right, down=down))
    np.testing.assert_allclose(centre.pixels, (right, down), atol=1.0)
    assert centre.camera.cx == pytest.approx(CX + right, abs=1.0)
    assert centre.camera.cy == pytest.approx(CY + down, abs=1.0)
    deviation = F * np.sqrt(np.diag(np.linalg.inv(centre.information)))[:2]
    assert np.all(deviation < 1.0)


def test_every_turn_shrinks_the_covariance_of_the_principal_point() -> None:
    def shrinks(before: Array, after: Array) -> None:
        lost = np.linalg.inv(before) - np.linalg.inv(after)
        assert np.linalg.eigvalsh(lost)[0] > -1e-9 * np.trace(lost)
        assert np.all(np.diag(lost) > 0)

    learnt(Faults(right=4.0), 40, shrinks)
