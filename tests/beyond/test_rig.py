"""The errors of a rig are found where there are some, and none are invented elsewhere."""

from __future__ import annotations

import dataclasses
import shutil
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from faulty_camera import CAMERA, KITTI, F, Faults, drive

from vo_lib import open_sequence, preset, run
from vo_lib.beyond.parallax import parallax_information
from vo_lib.beyond.refinement import refine
from vo_lib.beyond.rig import (
    BACK,
    BY_PARALLAX,
    COLUMNS,
    DOWN,
    FIELD,
    K1,
    LENS,
    NAMES,
    PAIR,
    ROWS,
    SIZE,
    N,
    Rig,
    effects,
    field_at,
    lens_shapes,
    powers,
    prior_covariance,
)
from vo_lib.beyond.translation import solve_translation
from vo_lib.config import CalibrationConfig, TranslationConfig
from vo_lib.core import settings
from vo_lib.core.boxes import Boxes, no_boxes
from vo_lib.core.geometry import rotation_angle
from vo_lib.core.matches import StereoMatches
from vo_lib.core.sampson import match_terms
from vo_lib.core.types import Array
from vo_lib.data.sequence import Sequence
from vo_lib.evaluation.axes import fit_axes
from vo_lib.evaluation.kitti import kitti_errors
from vo_lib.runs.runner import FoundMatches, make_odometry

GRID = np.stack(np.meshgrid(np.linspace(60, 1140, 9), np.linspace(20, 340, 5)), axis=-1).reshape(-1, 2)
# Noise is all there is in these drives: nothing is to be inflated.
TRUSTING = CalibrationConfig(noise_inflation=1.0, drift=0.0)


@pytest.fixture
def no_floors(monkeypatch: pytest.MonkeyPatch) -> None:
    """No lens has more errors than the model here, so every number of frames mends what is learnt of one."""
    monkeypatch.setattr("vo_lib.beyond.rig.LENS", {name: (prior, 0.0) for name, (prior, _) in LENS.items()})


def of_stereo(x: Array, disparity: Array) -> Array:
    return effects(CAMERA, x, disparity)[BY_PARALLAX, :3]


def learnt(
    faults: Faults,
    config: CalibrationConfig | None = None,
    frames: int = 60,
    noise: float = 0.2,
    step: float = 1.0,
    yaw: Callable[[int], float] = lambda i: 0.01 * np.sin(i / 5),
) -> Rig:
    """What is known after a drive whose motion is known."""
    rig = Rig(CAMERA, config or CalibrationConfig())
    for matches, R_cp, t_cp in drive(frames, faults, noise, step=step, yaw=yaw):
        rig.learn_rows(matches)
        rig.update(rig.correct(matches), R_cp, t_cp)
    return rig


def true_field(faults: Faults) -> Array:
    """Errors (2, N) of disparity and row at `GRID`."""
    x, y = CAMERA.normalise(GRID).T
    return np.stack([faults.disparities(x, y), faults.rows(x, y)])


def by_name(**terms: float) -> Array:
    """Coefficients (21,); d_ for disparities, r_ for rows."""
    names = {f"d_{term}": f"disparity {term}" for term in COLUMNS}
    names |= {f"r_{term}": f"row {term}" for term in ROWS}
    return np.array([{names.get(k, k): v for k, v in terms.items()}.get(name, 0.0) for name in NAMES])


def test_one_frame_without_noise_tells_the_coefficients_exactly() -> None:
    true = by_name(
        d_1=-0.2, d_x=-0.1, d_y=0.2, k1=2.0, **{"d_x²": 0.4, "d_y²": 1.5, "d_xy": 0.3, "d_x⁴": -0.6}
    )
    faults = Faults(
        lambda x, y: -0.2 + 0.4 * x * x + 1.5 * y * y + 0.3 * x * y - 0.1 * x + 0.2 * y - 0.6 * x**4, k1=2.0
    )
    matches, R_cp, t_cp = next(drive(1, faults, noise=0.0, points=2000))
    found = parallax_information(CAMERA, matches, R_cp, t_cp, of_stereo, 5.0)
    assert found is not None
    np.testing.assert_allclose(np.linalg.solve(*found), true[BY_PARALLAX], atol=0.08)


def test_a_motion_that_is_wrong_at_first_is_mended_before_the_errors_are_asked() -> None:
    faults = Faults(lambda x, y: -0.2 + 0.4 * x * x + 1.5 * y * y)
    matches, R_cp, t_cp = next(drive(1, faults, noise=0.0, points=2000))
    turned = R_cp @ cv2.Rodrigues(np.array([0.0, 0.002, 0.001]))[0]
    found = [
        parallax_information(CAMERA, matches, R, share * t_cp + (aside, 0.0, 0.0), of_stereo, 5.0)
        for R, share, aside in ((R_cp, 1.0, 0.0), (R_cp, 1.05, 0.0), (R_cp, 0.97, 0.03), (turned, 1.0, 0.0))
    ]
    right, *others = (np.linalg.solve(*each) for each in found if each is not None)
    assert len(others) == 3
    for other in others:
        np.testing.assert_allclose(other, right, atol=0.01)


@pytest.mark.parametrize("faults", [Faults(), KITTI], ids=["perfect", "as on KITTI"])
@pytest.mark.parametrize("k1", [0.0, 10.0])
def test_the_field_is_found_all_over_the_image(faults: Faults, k1: float) -> None:
    rig = learnt(dataclasses.replace(faults, k1=k1), noise=0.1)
    found = field_at(rig.errors, *CAMERA.normalise(GRID).T)
    np.testing.assert_allclose(found[1], true_field(faults)[1], atol=0.06 if k1 == 0 else 0.07)
    np.testing.assert_allclose(found[0], true_field(faults)[0], atol=0.15)
    assert np.abs(found[0] - true_field(faults)[0]).mean() < 0.06
    assert rig.errors[K1] == pytest.approx(k1, abs=1.5)


def test_coefficients_are_found_within_their_own_deviations() -> None:
    # Noise is all there is: nothing is to be inflated.
    rig = learnt(KITTI, CalibrationConfig(noise_inflation=1.0, drift=0.0))
    columns = {"d_1": -0.6, "d_x": -0.4, "d_y": -0.3, "d_x²": 0.5, "d_xy": 0.3, "d_y²": 6.3, "d_x⁴": -3.5}
    rows = {"r_1": 0.1, "r_x": 0.3, "r_y": -0.4, "r_x²": 0.2, "r_xy": -5.8, "r_y²": 0.5}
    away = (rig.errors - by_name(**columns, **rows)) / np.sqrt(np.diag(rig.covariance))
    assert np.abs(away).max() < 3.5
    assert 0.4 < np.sqrt(np.mean(away**2)) < 1.6


def test_rows_betray_what_a_roll_does_to_the_disparities() -> None:
    roll = Faults(lambda x, y: 0.8 * y, lambda x, y: -0.8 * x)
    rig = Rig(CAMERA, CalibrationConfig())
    for matches, _, _ in drive(20, roll):
        rig.learn_rows(matches)
    assert rig.errors[COLUMNS.index("y")] == pytest.approx(0.8, abs=0.1)
    assert abs(rig.errors[COLUMNS.index("1")]) < 0.1


@pytest.mark.parametrize("faults", [Faults(), KITTI], ids=["perfect", "as on KITTI"])
def test_the_place_of_the_right_camera_and_a_pincushion_are_known_soon(faults: Faults) -> None:
    """Straight ahead at full speed, where the motion tells least; near and far points on one row do."""
    faults = dataclasses.replace(faults, down=-0.5, back=1.5, k1=10.0)
    rig = learnt(faults, frames=20, noise=0.1, yaw=lambda i: 0.0)
    found = rig.errors - by_name(**{"right camera down": -0.5, "right camera back": 1.5}, k1=10.0)
    np.testing.assert_array_less(np.abs(found[[DOWN, BACK, K1]]), (0.1, 0.3, 1.5))


def test_each_fault_of_a_rig_moves_columns_and_rows_as_the_pinhole_equations_say() -> None:
    """A right camera turned a little: its image by the rotation, against the shapes that are added up."""
    covariance = prior_covariance()[:FIELD, :FIELD]
    x, y = np.random.default_rng(0).uniform([-0.5, -0.2], [0.5, 0.2], (40, 2)).T
    points = np.stack([x, y, np.ones_like(x)])
    for axis in np.eye(3):
        angle = 1e-4
        turned = points - angle * np.cross(axis, points, axisb=0).T
        moved = (points[:2] - turned[:2] / turned[2]) / angle
        A = np.zeros((2, len(x), FIELD))
        A[0, :, :N], A[1, :, N:] = powers(x, y).T, powers(x, y)[: len(ROWS)].T
        coefficients = np.linalg.lstsq(A.reshape(-1, FIELD), moved.ravel(), rcond=None)[0]
        # What the prior takes for possible costs little, anything else much.
        assert coefficients @ np.linalg.solve(covariance, coefficients) < 20.0


@pytest.mark.parametrize("faults", [Faults(), KITTI, dataclasses.replace(KITTI, k1=10.0)])
def test_steps_have_their_length_after_some_frames(faults: Faults) -> None:
    lengths, rig = [], Rig(CAMERA, CalibrationConfig())
    for matches, R_cp, _ in drive(90, faults):
        rig.learn_rows(matches)
        corrected = rig.correct(matches)
        solved = solve_translation(CAMERA, corrected, R_cp, TranslationConfig())
        assert solved is not None
        lengths.append(float(np.linalg.norm(solved[0])))
        rig.update(corrected, R_cp, solved[0])
    assert np.mean(lengths[50:]) == pytest.approx(1.0, abs=0.001)


@pytest.mark.parametrize(
    ("faults", "errors", "atol"),
    [
        (Faults(p1=1.2, p2=-1.4, k1=-3.0), by_name(p1=1.2, p2=-1.4, k1=-3.0), 0.05),
        (KITTI, None, 0.2),  # as learnt
    ],
)
def test_corrected_positions_are_those_of_the_points(
    faults: Faults, errors: Array | None, atol: float
) -> None:
    rig = learnt(faults) if errors is None else Rig(CAMERA, CalibrationConfig())
    (exact, _, _), (faulty, _, _) = (next(drive(1, each, noise=0.0)) for each in (Faults(), faults))
    mended = rig.correct(faulty, errors)
    for view in ("prev_left", "prev_right", "cur_left", "cur_right"):
        np.testing.assert_allclose(getattr(mended, view), getattr(exact, view), atol=atol)


def test_every_frame_shrinks_the_covariance() -> None:
    rig = Rig(CAMERA, CalibrationConfig(drift=0.0))
    for matches, R_cp, t_cp in drive(15, KITTI):
        for learn in (
            lambda m: rig.learn_rows(m),
            lambda m, R=R_cp, t=t_cp: rig.update(rig.correct(m), R, t),
        ):
            before = rig.covariance
            learn(matches)
            lost = before - rig.covariance
            assert np.linalg.eigvalsh(lost)[0] > -1e-9 * np.trace(before)
            assert np.trace(lost) > 0


def test_what_a_frame_knows_grows_with_its_matches_and_its_speed() -> None:
    def known(points: int, step: float) -> float:
        found = []
        for matches, R_cp, t_cp in drive(10, Faults(), points=points, step=step, yaw=lambda i: 0.0):
            information = parallax_information(CAMERA, matches, R_cp, t_cp, of_stereo, 0.5)
            assert information is not None
            found.append(np.linalg.inv(information[0])[0, 0])
        return float(np.median(found))

    assert known(200, 1.0) / known(800, 1.0) == pytest.approx(4.0, rel=0.3)
    # Without parallax nothing betrays a disparity: at a tenth of the speed a frame knows a hundredth.
    assert known(300, 0.1) > 30.0 * known(300, 1.0)


def test_a_camera_at_rest_teaches_nothing() -> None:
    matches, _, _ = next(drive(1, Faults(lambda x, y: -1.0 + 0 * x, k1=5.0), noise=0.0))
    still = dataclasses.replace(matches, cur_left=matches.prev_left, cur_right=matches.prev_right)
    rig = Rig(CAMERA, CalibrationConfig())
    rig.update(still, np.eye(3), np.zeros(3))
    assert np.abs(rig.errors).max() < 0.2


def test_no_frame_changes_anything_by_more_than_three_deviations() -> None:
    rig = Rig(CAMERA, TRUSTING)
    matches, R_cp, t_cp = next(drive(1, Faults(lambda x, y: 6.0 + 0 * x), points=2000))
    known = np.linalg.inv(rig.covariance)
    rig.update(matches, R_cp, t_cp)
    assert rig.estimate @ known @ rig.estimate == pytest.approx(9.0)


def test_a_frame_learnt_twice_as_carefully_counts_a_quarter() -> None:
    information = []
    matches, R_cp, t_cp = next(drive(1, Faults()))
    for inflation in (2.0, 4.0):
        rig = Rig(CAMERA, CalibrationConfig(noise_inflation=inflation))
        before = np.linalg.inv(rig.covariance)
        rig.update(matches, R_cp, t_cp)
        information.append(np.linalg.inv(rig.covariance) - before)
    np.testing.assert_allclose(information[0], 4.0 * information[1], atol=1e-6 * np.abs(information[0]).max())


@pytest.mark.parametrize("seed", [897, 2880])
def test_few_or_wild_matches_do_no_harm(seed: int) -> None:
    rng = np.random.default_rng(seed)
    left, disparity, flat = rng.uniform([0, 0], [1200, 360], (12, 2)), rng.uniform(1, 60, 12), np.zeros(12)
    now = left + rng.normal(0, 3, (12, 2))
    right = left - np.stack([disparity, flat], axis=1)
    now_right = now - np.stack([disparity * rng.uniform(0.5, 1.5, 12), flat], axis=1)
    wild = StereoMatches(left, right, now, now_right, np.ones(12, int), np.ones(12), np.arange(12))
    t_cp = np.array([0.0, 0.0, -rng.uniform(0, 2)])
    rig = Rig(CAMERA, CalibrationConfig())
    rig.update(wild, np.eye(3), t_cp)
    assert np.isfinite(rig.errors).all()
    assert np.linalg.eigvalsh(rig.covariance)[0] > 0
    few = wild[np.arange(5)]
    assert parallax_information(CAMERA, few, np.eye(3), t_cp, of_stereo, 0.5) is None
    assert rig.update(few, np.eye(3), t_cp) is None
    rig.learn_rows(wild[np.arange(0)])
    assert np.isfinite(rig.errors).all()


@pytest.mark.parametrize(("p1", "p2", "k1"), [(1.2, -1.4, 0.0), (-0.8, 1.0, 10.0), (0.0, 0.0, -12.0)])
@pytest.mark.parametrize("turn", [0.0, 0.03])
def test_lenses_are_known_in_turns_and_on_straight_roads(
    p1: float, p2: float, k1: float, turn: float, no_floors: None
) -> None:
    rig = learnt(Faults(p1=p1, p2=p2, k1=k1), TRUSTING, 100, 0.1, yaw=lambda i: turn * np.sin(i / 9))
    np.testing.assert_array_less(np.abs(rig.errors[PAIR:] - (p1, p2, k1, 0.0)), (0.2, 0.2, 1.1, 1.1))


@pytest.mark.parametrize("method", ["solution_selection", "viso2"])
def test_both_estimators_find_them_beside_an_error_of_the_disparities(method: str, no_floors: None) -> None:
    odometry = make_odometry(CAMERA, dataclasses.replace(preset(method), calibration=TRUSTING))
    odometry.start(no_boxes())
    off, faults = [], Faults(lambda x, y: 0 * x + 0.8, p1=1.5, p2=-1.5, k1=8.0)
    for matches, _, t_cp in drive(60, faults, 0.1, yaw=lambda i: 0.05 * np.sin(i / 4)):
        T_cp = odometry.step(matches, no_boxes(), seconds=0.1).T_cp
        off.append(np.linalg.norm(T_cp[:3, 3] - t_cp))
    away = np.abs(odometry.rig.errors[PAIR:] - (1.5, -1.5, 8.0, 0.0))
    np.testing.assert_array_less(away, (0.3, 0.3, 0.5, 0.5))
    assert np.median(off[20:]) < 0.02  # metres, of steps of one
    assert max(off) < 0.3


@pytest.mark.parametrize(("noise", "step"), [(0.1, 1.0), (0.3, 1.0), (0.3, 0.15)])
def test_good_lenses_are_left_alone(noise: float, step: float) -> None:
    """However the matches scatter: noise of a place does not look like a pincushion."""
    rig = learnt(Faults(), CalibrationConfig(), 100, noise, step)
    np.testing.assert_array_equal(rig.errors[PAIR:], np.zeros(4))
    assert (np.abs(rig.estimate[FIELD:]) < 2.0 * np.sqrt(np.diag(rig.covariance)[FIELD:])).all()


def test_rotations_get_better_with_it(no_floors: None) -> None:
    faults, angles = Faults(p1=2.0, p2=-2.0), np.zeros((2, 100))
    rigs = Rig(CAMERA, TRUSTING), Rig(CAMERA, TRUSTING)
    for i, (matches, R_cp, t_cp) in enumerate(drive(100, faults, 0.1, yaw=lambda i: 0.03 * np.sin(i / 9))):
        for rig, angle in zip(rigs, angles, strict=True):
            corrected = rig.correct(matches)
            x_p, x_c = (CAMERA.normalise(uv) for uv in (corrected.prev_left, corrected.cur_left))
            R, _ = refine(R_cp, t_cp / np.linalg.norm(t_cp), match_terms(x_p, x_c), 0.5 / F)
            angle[i] = rotation_angle(R @ R_cp.T)
        rigs[0].update(rigs[0].correct(matches), R_cp, t_cp)
    assert np.median(angles[0, 50:]) < 0.4 * np.median(angles[1, 50:])


def test_shapes_are_browns() -> None:
    p1, p2, k1, k2 = lens_shapes(np.array([[0.5], [-0.2]]))[:, :, 0]
    np.testing.assert_allclose(p1, [2 * 0.5 * -0.2, 0.29 + 2 * 0.04])
    np.testing.assert_allclose(p2, [0.29 + 2 * 0.25, 2 * 0.5 * -0.2])
    np.testing.assert_allclose(k1, [0.29 * 0.5, 0.29 * -0.2])
    np.testing.assert_allclose(k2, [0.29**2 * 0.5, 0.29**2 * -0.2])


@pytest.mark.parametrize(
    ("mean", "variance", "expected"),
    [
        ((0.9, -0.4, 1.0, 1.0), (1.0, 0.25, 4.0, 4.0), (0.0, 0.0, 0.0, 0.0)),
        # Variances and floors, 0.51 + 0.7² = 1, 0.56 + 1.2² = 2, 5 + 2² = 9, 9 + 4² = 25.
        ((2.0, -4.0, 6.0, 10.0), (0.51, 0.56, 5.0, 9.0), (1.5, -3.5, 4.5, 7.5)),
        # Of p1 and k1 the frames know less than half of what was known before them, 1.5² and 15².
        ((4.0, 4.0, 90.0, 90.0), (1.13, 1.12, 113.0, 49.0), (0.0, 3.36, 0.0, 89.27778)),
    ],
)
def test_what_noise_explains_of_a_lens_is_taken_for_noise(
    mean: tuple[float, ...], variance: tuple[float, ...], expected: tuple[float, ...]
) -> None:
    rig = Rig(CAMERA, CalibrationConfig())
    covariance = prior_covariance()
    covariance[PAIR:, PAIR:] = np.diag(variance)
    rig.know(np.append(np.zeros(PAIR), mean), covariance)
    np.testing.assert_allclose(rig.errors[PAIR:], expected, rtol=1e-6)


def test_the_field_in_use_is_the_one_that_goes_with_the_lens_in_use() -> None:
    """Of a pincushion that is not believed the field must not keep its half."""
    rig = Rig(CAMERA, CalibrationConfig())
    covariance = 1e-4 * np.eye(SIZE)
    covariance[3, 3], covariance[K1, K1], covariance[3, K1], covariance[K1, 3] = 1.0001, 4.0, -2.0, -2.0
    rig.know(by_name(**{"d_x²": 3.0, "d_1": 1.0}, k1=2.4), covariance)
    np.testing.assert_allclose(rig.errors, by_name(**{"d_x²": 4.2, "d_1": 1.0}), atol=0.01)


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
        rig = odometry.rig
        deviation.append(float(np.sqrt(rig.covariance[0, 0])))
        found = field_at(rig.errors, *CAMERA.normalise(GRID).T)
        error.append(float(np.abs(found[0] - true_field(KITTI)[0])[GRID[:, 0] > 300].mean()))
    assert deviation[1] < 1.02 * deviation[0]
    assert error[2] < 0.1


@pytest.mark.parametrize("method", ["solution_selection", "viso2"])
def test_switched_off_nothing_is_learnt(method: str) -> None:
    odometry = make_odometry(CAMERA, settings.replace(preset(method), "calibration.estimate", False))
    odometry.start(no_boxes())
    for matches, _, _ in drive(3, KITTI):
        odometry.step(matches, no_boxes())
    np.testing.assert_array_equal(odometry.rig.errors, np.zeros(SIZE))


def test_a_street_seen_by_a_rig_like_kittis_has_its_length_from_frame_50_on(
    street: Sequence, tmp_path: Path
) -> None:
    """The images drawn anew as such cameras show them."""
    part = street.part(0, 112)
    camera = part.camera
    v, u = np.mgrid[: camera.height, : camera.width].astype(np.float64)
    x, y = (u - camera.cx) / camera.f, (v - camera.cy) / camera.f
    for side, half in (("image_0", -0.5), ("image_1", 0.5)):
        true_x, true_y = x, y
        for _ in range(3):  # the faults are those of the true place
            true_x, true_y = (
                x + half / camera.f * KITTI.disparities(true_x, true_y),
                y + half / camera.f * KITTI.rows(true_x, true_y),
            )
        places = (camera.f * true_x + camera.cx).astype("f4"), (camera.f * true_y + camera.cy).astype("f4")
        (tmp_path / side).mkdir()
        for frame in part.frames:
            image = cv2.imread(str(part.folder / side / f"{frame}.png"), cv2.IMREAD_GRAYSCALE)
            assert image is not None
            image = cv2.remap(image, *places, cv2.INTER_LANCZOS4, borderMode=cv2.BORDER_REFLECT)
            cv2.imwrite(str(tmp_path / side / f"{frame}.png"), image)
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
    rig = Rig(sequence.camera, config.calibration)
    for matches, _ in FoundMatches(sequence, config.features, config.matching):
        if len(matches):
            corrected = rig.correct(matches)  # with what was learnt before this frame
            rig.learn_rows(matches)
    before, after = (
        float(np.median(np.abs(m.cur_left[:, 1] - m.cur_right[:, 1]))) for m in (matches, corrected)
    )
    assert after < 0.15 < 0.2 < before
