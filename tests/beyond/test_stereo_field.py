"""The field of disparity and row errors is found where there is one, and none is invented elsewhere."""

from __future__ import annotations

import dataclasses
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
from faulty_camera import CAMERA, KITTI, Faults, drive

from vo_lib import open_sequence, preset, run
from vo_lib.beyond.stereo_field import (
    COLUMNS,
    ROWS,
    StereoField,
    field_at,
    parallax_information,
    powers,
    prior_covariance,
)
from vo_lib.beyond.translation import solve_translation
from vo_lib.config import CalibrationConfig, TranslationConfig
from vo_lib.core import settings
from vo_lib.core.boxes import Boxes, no_boxes
from vo_lib.core.matches import StereoMatches
from vo_lib.core.types import Array
from vo_lib.data.sequence import Sequence
from vo_lib.evaluation.axes import fit_axes
from vo_lib.evaluation.kitti import kitti_errors
from vo_lib.runs.runner import FoundMatches, make_odometry

N = len(COLUMNS)
GRID = np.stack(np.meshgrid(np.linspace(60, 1140, 9), np.linspace(20, 340, 5)), axis=-1).reshape(-1, 2)


def learnt(faults: Faults, frames: int = 60, config: CalibrationConfig | None = None) -> StereoField:
    """The field after a drive whose motion is known."""
    field = StereoField(CAMERA, config or CalibrationConfig())
    for matches, R_cp, t_cp in drive(frames, faults):
        field.learn_rows(matches)
        field.update(field.correct(matches), R_cp, t_cp)
    return field


def true_field(faults: Faults) -> Array:
    """Errors (2, N) of disparity and row at `GRID`."""
    x, y = CAMERA.normalise(GRID).T
    return np.stack([faults.disparities(x, y), faults.rows(x, y)])


def test_one_frame_without_noise_tells_the_disparities_coefficients_exactly() -> None:
    true = {"1": -0.2, "x²": 0.4, "y²": 1.5, "xy": 0.3, "x": -0.1, "y": 0.2, "x⁴": -0.6}
    faults = Faults(
        lambda x, y: -0.2 + 0.4 * x * x + 1.5 * y * y + 0.3 * x * y - 0.1 * x + 0.2 * y - 0.6 * x**4
    )
    matches, R_cp, t_cp = next(drive(1, faults, noise=0.0, points=2000))
    found = parallax_information(CAMERA, matches, R_cp, t_cp, 5.0)
    assert found is not None
    expected = [true.get(term, 0.0) for term in COLUMNS]
    np.testing.assert_allclose(np.linalg.solve(*found), expected, atol=0.06)


def test_a_step_that_is_wrong_at_first_is_mended_before_the_field_is_asked() -> None:
    faults = Faults(lambda x, y: -0.2 + 0.4 * x * x + 1.5 * y * y)
    matches, R_cp, t_cp = next(drive(1, faults, noise=0.0, points=2000))
    found = [
        parallax_information(CAMERA, matches, R_cp, share * t_cp + (aside, 0.0, 0.0), 5.0)
        for share, aside in ((1.0, 0.0), (1.05, 0.0), (0.97, 0.03))
    ]
    right, *others = (np.linalg.solve(*each) for each in found if each is not None)
    assert len(others) == 2
    for other in others:
        np.testing.assert_allclose(other, right, atol=0.01)


@pytest.mark.parametrize("faults", [Faults(), KITTI], ids=["perfect", "as on KITTI"])
def test_the_field_is_found_all_over_the_image(faults: Faults) -> None:
    field = learnt(faults)
    found = field_at(field.coefficients, *CAMERA.normalise(GRID).T)
    np.testing.assert_allclose(found[1], true_field(faults)[1], atol=0.06)
    np.testing.assert_allclose(found[0], true_field(faults)[0], atol=0.15)
    assert np.abs(found[0] - true_field(faults)[0]).mean() < 0.06


def test_coefficients_are_found_within_their_own_deviations() -> None:
    # Noise is all there is: nothing is to be inflated.
    field = learnt(KITTI, config=CalibrationConfig(noise_inflation=1.0, drift=0.0))
    true = {"1": -0.6, "x": -0.4, "y": -0.3, "x²": 0.5, "xy": 0.3, "y²": 6.3, "x⁴": -3.5}
    rows = {"1": 0.1, "x": 0.3, "y": -0.4, "x²": 0.2, "xy": -5.8, "y²": 0.5}
    expected = [true.get(term, 0.0) for term in COLUMNS] + [rows.get(term, 0.0) for term in ROWS]
    away = (field.coefficients - expected) / np.sqrt(np.diag(field.covariance))
    assert np.abs(away).max() < 3.5
    assert 0.4 < np.sqrt(np.mean(away**2)) < 1.6


def test_rows_betray_what_a_roll_does_to_the_disparities() -> None:
    roll = Faults(lambda x, y: 0.8 * y, lambda x, y: -0.8 * x)
    field = StereoField(CAMERA, CalibrationConfig())
    for matches, _, _ in drive(20, roll):
        field.learn_rows(matches)
    assert field.coefficients[COLUMNS.index("y")] == pytest.approx(0.8, abs=0.1)
    assert abs(field.coefficients[COLUMNS.index("1")]) < 0.1


def test_each_fault_of_a_rig_moves_columns_and_rows_as_the_pinhole_equations_say() -> None:
    """A right camera turned a little: its image by the rotation, against the shapes that are added up."""
    covariance = prior_covariance()
    x, y = np.random.default_rng(0).uniform([-0.5, -0.2], [0.5, 0.2], (40, 2)).T
    points = np.stack([x, y, np.ones_like(x)])
    for axis in np.eye(3):
        angle = 1e-4
        cross = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
        turned = points - angle * cross @ points
        moved = (points[:2] - turned[:2] / turned[2]) / angle
        A = np.zeros((2, len(x), N + len(ROWS)))
        A[0, :, :N], A[1, :, N:] = powers(x, y).T, powers(x, y)[: len(ROWS)].T
        coefficients = np.linalg.lstsq(A.reshape(-1, N + len(ROWS)), moved.ravel(), rcond=None)[0]
        # What the prior takes for possible costs little, anything else much.
        assert coefficients @ np.linalg.solve(covariance, coefficients) < 20.0


def test_steps_have_their_length_after_some_frames() -> None:
    lengths: dict[str, list[float]] = {"perfect": [], "faulty": []}
    for name, faults in (("perfect", Faults()), ("faulty", KITTI)):
        field = StereoField(CAMERA, CalibrationConfig())
        for matches, R_cp, _ in drive(90, faults):
            field.learn_rows(matches)
            corrected = field.correct(matches)
            solved = solve_translation(CAMERA, corrected, R_cp, TranslationConfig())
            assert solved is not None
            lengths[name].append(float(np.linalg.norm(solved[0])))
            field.update(corrected, R_cp, solved[0])
    for found in lengths.values():
        assert np.mean(found[50:]) == pytest.approx(1.0, abs=0.001)


def test_corrected_positions_are_those_of_the_points() -> None:
    field = learnt(KITTI)
    exact, _, _ = next(drive(1, Faults(), noise=0.0))
    faulty, _, _ = next(drive(1, KITTI, noise=0.0))
    mended = field.correct(faulty)
    np.testing.assert_allclose(mended.prev_right, exact.prev_right, atol=0.2)
    np.testing.assert_allclose(mended.cur_right, exact.cur_right, atol=0.2)
    np.testing.assert_array_equal(mended.prev_left, faulty.prev_left)


def test_every_frame_shrinks_the_covariance() -> None:
    field = StereoField(CAMERA, CalibrationConfig(drift=0.0))
    for matches, R_cp, t_cp in drive(15, KITTI):
        for learn in (
            lambda m: field.learn_rows(m),
            lambda m, R=R_cp, t=t_cp: field.update(field.correct(m), R, t),
        ):
            before = field.covariance
            learn(matches)
            lost = before - field.covariance
            assert np.linalg.eigvalsh(lost)[0] > -1e-9 * np.trace(before)
            assert np.trace(lost) > 0


def test_what_a_frame_knows_grows_with_its_matches_and_its_speed() -> None:
    def known(points: int, step: float) -> float:
        found = []
        for matches, R_cp, t_cp in drive(10, Faults(), points=points, step=step, yaw=lambda i: 0.0):
            information = parallax_information(CAMERA, matches, R_cp, t_cp, 0.5)
            assert information is not None
            found.append(np.linalg.inv(information[0])[0, 0])
        return float(np.median(found))

    assert known(200, 1.0) / known(800, 1.0) == pytest.approx(4.0, rel=0.3)
    # Without parallax nothing betrays a disparity: at a tenth of the speed a frame knows a hundredth.
    assert known(300, 0.1) > 30.0 * known(300, 1.0)


def test_a_camera_at_rest_teaches_nothing() -> None:
    matches, _, _ = next(drive(1, Faults(lambda x, y: -1.0 + 0 * x), noise=0.0))
    still = dataclasses.replace(matches, cur_left=matches.prev_left, cur_right=matches.prev_right)
    field = StereoField(CAMERA, CalibrationConfig())
    field.update(still, np.eye(3), np.zeros(3))
    assert np.abs(field.coefficients).max() < 0.2


def test_no_frame_moves_the_field_by_more_than_three_deviations() -> None:
    field = StereoField(CAMERA, CalibrationConfig(noise_inflation=1.0))
    matches, R_cp, t_cp = next(drive(1, Faults(lambda x, y: 12.0 + 0 * x)))
    known = np.linalg.inv(field.covariance)
    field.update(matches, R_cp, t_cp)
    assert field.coefficients @ known @ field.coefficients <= 9.0 + 1e-6


@pytest.mark.parametrize("seed", [897, 2880])
def test_few_or_wild_matches_do_no_harm(seed: int) -> None:
    rng = np.random.default_rng(seed)
    left, disparity, flat = rng.uniform([0, 0], [1200, 360], (12, 2)), rng.uniform(1, 60, 12), np.zeros(12)
    now = left + rng.normal(0, 3, (12, 2))
    right = left - np.stack([disparity, flat], axis=1)
    now_right = now - np.stack([disparity * rng.uniform(0.5, 1.5, 12), flat], axis=1)
    wild = StereoMatches(left, right, now, now_right, np.ones(12, int), np.ones(12), np.arange(12))
    t_cp = np.array([0.0, 0.0, -rng.uniform(0, 2)])
    field = StereoField(CAMERA, CalibrationConfig())
    field.update(wild, np.eye(3), t_cp)
    assert np.isfinite(field.coefficients).all()
    assert np.linalg.eigvalsh(field.covariance)[0] > 0
    few = wild[np.arange(5)]
    assert parallax_information(CAMERA, few, np.eye(3), t_cp, 0.5) is None
    assert field.update(few, np.eye(3), t_cp) is None
    field.learn_rows(wild[np.arange(0)])
    assert np.isfinite(field.coefficients).all()


def test_boxes_keep_nothing_from_the_field_but_what_moves_in_them_does_not_teach() -> None:
    """A box over the left third of the image; parked cars in it, or cars that cross."""
    over = Boxes(np.array([[0.0, 0.0, 400.0, 360.0]]), np.array([2]), np.ones(1))
    deviation, error = [], []
    for boxes, crossing in ((no_boxes(), 0.0), (over, 0.0), (over, 6.0)):
        odometry = make_odometry(CAMERA, preset("feature_selection"))
        odometry.start(boxes)
        for matches, _, _ in drive(40, KITTI):
            aside = np.where(matches.prev_left[:, :1] < 300.0, (crossing, 0.0), 0.0)
            crossed = dataclasses.replace(
                matches, cur_left=matches.cur_left + aside, cur_right=matches.cur_right + aside
            )
            odometry.step(crossed, boxes)
        field = odometry.field
        deviation.append(float(np.sqrt(field.covariance[0, 0])))
        found = field_at(field.coefficients, *CAMERA.normalise(GRID).T)
        error.append(float(np.abs(found[0] - true_field(KITTI)[0])[GRID[:, 0] > 300].mean()))
    assert deviation[1] < 1.02 * deviation[0]
    assert error[2] < 0.1


@pytest.mark.parametrize("method", ["solution_selection", "viso2"])
def test_switched_off_nothing_is_learnt(method: str) -> None:
    odometry = make_odometry(CAMERA, settings.replace(preset(method), "calibration.estimate", False))
    odometry.start(no_boxes())
    for matches, _, _ in drive(3, KITTI):
        odometry.step(matches, no_boxes())
    np.testing.assert_array_equal(odometry.field.coefficients, np.zeros(N + len(ROWS)))
    np.testing.assert_array_equal(odometry.lens.decentering, np.zeros(2))


def test_a_street_seen_by_a_rig_like_kittis_has_its_length_from_frame_50_on(
    street: Sequence, tmp_path: Path
) -> None:
    """The right images drawn anew as such a camera shows them."""
    part = street.part(0, 112)
    camera = part.camera
    v, u = np.mgrid[: camera.height, : camera.width].astype(np.float64)
    x, y = (u - camera.cx) / camera.f, (v - camera.cy) / camera.f
    places = (u + KITTI.disparities(x, y)).astype(np.float32), (v + KITTI.rows(x, y)).astype(np.float32)
    shutil.copytree(part.folder / "image_0", tmp_path / "image_0")
    (tmp_path / "image_1").mkdir()
    for frame in part.frames:
        image = cv2.imread(str(part.folder / "image_1" / f"{frame}.png"), cv2.IMREAD_GRAYSCALE)
        assert image is not None
        image = cv2.remap(image, *places, cv2.INTER_LANCZOS4, borderMode=cv2.BORDER_REFLECT)
        cv2.imwrite(str(tmp_path / "image_1" / f"{frame}.png"), image)
    for left in (tmp_path / "image_0").glob("*.png"):
        if left.stem not in part.frames:
            left.unlink()
    shutil.copy(part.folder / "calib.txt", tmp_path)
    np.savetxt(tmp_path / "times.txt", part.times)
    assert part.truth is not None
    te = []
    for sequence in (part, open_sequence(tmp_path)):
        errors = kitti_errors(
            part.truth[50:], run(sequence, preset("solution_selection")).poses[50:], [50.0], 1
        )
        assert errors.te is not None
        te.append(errors.te)
    assert te[1] < te[0] + 0.05  # without learning 1.0


# libviso2 has 7.84 % / 2.70 and ORB-SLAM2's published trajectory 5.47 % / 2.54 on the same frames.
def test_the_real_highway_needs_the_field(clips: Path) -> None:
    sequence = open_sequence(clips / "sequences" / "01")
    assert sequence.truth is not None
    te, turned, length = {}, {}, {}
    true = np.linalg.norm(np.diff(sequence.truth[:, :3, 3], axis=0), axis=1).sum()
    for estimate in (True, False):
        config = settings.replace(preset("solution_selection"), "calibration.estimate", estimate)
        poses = run(sequence, config).poses
        errors = kitti_errors(sequence.truth, poses, [20.0], 1)
        assert errors.te is not None
        assert errors.re is not None
        assert errors.re < 2.5
        te[estimate] = errors.te
        turned[estimate] = fit_axes(sequence.truth, poses, [20.0], 1).kitti.te or np.inf
        length[estimate] = np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1).sum() / true
    assert te[True] < 1.0 < 2.0 < te[False]
    # The field is found within the first frames: else this is 0.3 %.
    assert turned[True] < 0.2
    assert length[True] == pytest.approx(1.0, abs=0.003)


@pytest.mark.parametrize("name", ["00", "01", "drive_0005"])
def test_rows_of_a_real_pair_agree_after_some_frames(clips: Path, name: str) -> None:
    sequence = open_sequence(clips / "sequences" / name).part(0, 12)
    config = preset("viso2")
    field = StereoField(sequence.camera, config.calibration)
    for matches, _ in FoundMatches(sequence, config.features, config.matching):
        if len(matches):
            corrected = field.correct(matches)  # with what was learnt before this frame
            field.learn_rows(matches)
    before, after = (
        float(np.median(np.abs(m.cur_left[:, 1] - m.cur_right[:, 1]))) for m in (matches, corrected)
    )
    assert after < 0.15 < 0.2 < before
