"""Self-calibration: true errors are estimated, and a perfect rig is not corrected."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from faulty_camera import CAMERA, KITTI, Faults, drive
from real_images import RealImages

from measure.axes import fit_axes
from vo_lib import preset, run, settings
from vo_lib.evaluation.kitti_errors import kitti_errors
from vo_lib.geometry.boxes import Boxes
from vo_lib.geometry.matches import StereoMatches
from vo_lib.geometry.types import Array
from vo_lib.kit.kit_odometry import make_kit_odometry
from vo_lib.kit.parallax import parallax_information
from vo_lib.kit.rig import (
    BY_PARALLAX,
    DISPARITY_TERMS,
    ERROR_NAMES,
    FIELD_COUNT,
    K1,
    ROW_TERMS,
    Rig,
    effects,
    field_at,
)
from vo_lib.kit.settings import CalibrationConfig
from vo_lib.runs.front_end import find_matches

GRID = np.stack(np.meshgrid(np.linspace(60, 1140, 9), np.linspace(20, 340, 5)), axis=-1).reshape(-1, 2)


def of_stereo(x: Array, disparity: Array) -> Array:
    return effects(CAMERA, x, disparity)[BY_PARALLAX, :3]


def learnt(
    faults: Faults,
    config: CalibrationConfig | None = None,
    frames: int = 60,
    noise: float = 0.2,
    step: float = 1.0,
) -> Rig:
    """The rig after a drive whose motion is given."""
    rig = Rig(CAMERA, config or CalibrationConfig())
    for matches, R_cp, t_cp in drive(frames, faults, noise, step=step):
        rig.update_from_rows(matches)
        rig.update(rig.correct(matches), R_cp, t_cp)
    return rig


def true_field(faults: Faults) -> Array:
    """Errors (2, N) of disparity and row difference at the points of `GRID`, pixels."""
    x, y = CAMERA.normalise(GRID).T
    return np.stack([faults.disparities(x, y), faults.rows(x, y)])


def by_name(**terms: float) -> Array:
    """The errors (19,) with the given terms; a name has the prefix d_ (disparities) or r_ (rows)."""
    names = {f"d_{term}": f"disparity {term}" for term in DISPARITY_TERMS}
    names |= {f"r_{term}": f"row {term}" for term in ROW_TERMS}
    return np.array([{names.get(k, k): v for k, v in terms.items()}.get(name, 0.0) for name in ERROR_NAMES])


def test_noise_free_frame_gives_the_coefficients() -> None:
    true = by_name(
        d_1=-0.2, d_x=-0.1, d_y=0.2, k1=2.0, **{"d_x²": 0.4, "d_y²": 1.5, "d_xy": 0.3, "d_x⁴": -0.6}
    )
    faults = Faults(
        lambda x, y: -0.2 + 0.4 * x * x + 1.5 * y * y + 0.3 * x * y - 0.1 * x + 0.2 * y - 0.6 * x**4, k1=2.0
    )
    matches, R_cp, t_cp = next(drive(1, faults, noise=0.0, points=2000))
    result = parallax_information(CAMERA, matches, R_cp, t_cp, of_stereo, 5.0)
    assert result is not None
    np.testing.assert_allclose(np.linalg.solve(*result), true[BY_PARALLAX], atol=0.08)


@pytest.mark.parametrize("faults", [Faults(), KITTI], ids=["perfect", "as on KITTI"])
@pytest.mark.parametrize("k1", [0.0, 10.0])
def test_error_field_is_estimated_over_the_image(faults: Faults, k1: float) -> None:
    rig = learnt(dataclasses.replace(faults, k1=k1), noise=0.1)
    result = field_at(rig.errors, *CAMERA.normalise(GRID).T)
    np.testing.assert_allclose(result[1], true_field(faults)[1], atol=0.06 if k1 == 0 else 0.07)
    np.testing.assert_allclose(result[0], true_field(faults)[0], atol=0.15)
    assert np.abs(result[0] - true_field(faults)[0]).mean() < 0.06
    assert rig.errors[K1] == pytest.approx(k1, abs=1.5)


@pytest.mark.parametrize(
    ("faults", "errors", "atol"),
    [
        (Faults(p1=1.2, p2=-1.4, k1=-3.0), by_name(p1=1.2, p2=-1.4, k1=-3.0), 0.05),
        (KITTI, None, 0.2),  # with the estimated errors
    ],
)
def test_corrected_positions_equal_the_exact_ones(faults: Faults, errors: Array | None, atol: float) -> None:
    rig = learnt(faults) if errors is None else Rig(CAMERA, CalibrationConfig())
    (exact, _, _), (faulty, _, _) = (next(drive(1, each, noise=0.0)) for each in (Faults(), faults))
    mended = rig.correct(faulty, errors)
    for view in ("prev_left", "prev_right", "cur_left", "cur_right"):
        np.testing.assert_allclose(getattr(mended, view), getattr(exact, view), atol=atol)


@pytest.mark.parametrize(("noise", "step"), [(0.1, 1.0), (0.3, 1.0), (0.3, 0.15)])
def test_perfect_lenses_stay_uncorrected(noise: float, step: float) -> None:
    """The estimate of the lens errors remains near zero for any noise of the matches."""
    rig = learnt(Faults(), CalibrationConfig(), 100, noise, step)
    np.testing.assert_array_equal(rig.errors[FIELD_COUNT:], np.zeros(4))
    assert (np.abs(rig.estimate[FIELD_COUNT:]) < 2.0 * np.sqrt(np.diag(rig.covariance)[FIELD_COUNT:])).all()


def test_calibration_ignores_features_in_boxes() -> None:
    """A box covers the crossing cars in the left third of the image."""
    over = Boxes(np.array([[0.0, 0.0, 400.0, 360.0]]), np.array([2]), np.ones(1))
    odometry = make_kit_odometry(CAMERA, preset("feature_selection", variant="kit"))
    odometry.start(over)
    for matches, _, _ in drive(40, KITTI):
        aside = np.where(matches.prev_left[:, :1] < 300.0, (6.0, 0.0), 0.0)
        crossed = dataclasses.replace(
            matches, cur_left=matches.cur_left + aside, cur_right=matches.cur_right + aside
        )
        odometry.step(crossed, over)
    result = field_at(odometry.rig.errors, *CAMERA.normalise(GRID).T)
    assert np.abs(result[0] - true_field(KITTI)[0])[GRID[:, 0] > 300].mean() < 0.1


@pytest.mark.parametrize("method", ["feature_selection", "viso2"])
def test_camera_at_rest_in_cross_traffic_learns_nothing(method: str) -> None:
    """Two thirds of the matches are on crossing cars, all in the box: the other features are at rest."""
    over = Boxes(np.array([[0.0, 0.0, 800.0, 360.0]]), np.array([2]), np.ones(1))
    config = settings.replace(preset(method, variant="kit"), "filter.rule", "all")
    odometry = make_kit_odometry(CAMERA, config)
    odometry.start(over)
    moving = drive(6, KITTI)
    for matches, _, _ in moving:
        odometry.step(matches, over)
    before = odometry.calibration
    assert before.estimate.any()
    for matches, _, _ in drive(6, KITTI, noise=0.1, step=0.0):
        aside = np.where(matches.prev_left[:, :1] < 780.0, (6.0, 0.0), 0.0)
        crossed = dataclasses.replace(
            matches,
            cur_left=matches.prev_left + aside,
            cur_right=matches.prev_right + aside,
        )
        assert odometry.step(crossed, over).motion.still
    np.testing.assert_array_equal(odometry.calibration.estimate, before.estimate)
    np.testing.assert_array_equal(odometry.calibration.covariance, before.covariance)


# libviso2 has 7.84 % / 2.70 and ORB-SLAM2's published trajectory 5.47 % / 2.54 on the same frames.
def test_calibration_lowers_the_error_of_01(real: RealImages) -> None:
    sequence = real.sequence("01", 0, 51)
    assert sequence.truth is not None
    te, turned, length = {}, {}, {}
    true = np.linalg.norm(np.diff(sequence.truth[:, :3, 3], axis=0), axis=1).sum()
    for estimate in (True, False):
        config = settings.replace(
            preset("solution_selection", variant="kit"), "calibration.estimate", estimate
        )
        poses = run(sequence, config).poses
        errors = kitti_errors(sequence.truth, poses, [20.0], 1)
        assert errors.te is not None
        assert errors.re is not None
        assert errors.re < 2.5
        te[estimate] = errors.te
        turned[estimate] = fit_axes(sequence.truth, poses, [20.0], 1).kitti.te or np.inf
        length[estimate] = np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1).sum() / true
    assert te[True] < 1.0 < 2.0 < te[False]
    # The field must be estimated within the first frames: otherwise the error is 0.3 %.
    assert turned[True] < 0.2
    assert length[True] == pytest.approx(1.0, abs=0.003)


@pytest.mark.parametrize("name", ["00", "01", "drive_0005", "drive_0013"])
def test_rows_of_real_pairs_agree_after_correction(real: RealImages, name: str) -> None:
    sequence = real.sequence(name, 0, 12)
    config = preset("viso2", variant="kit")
    rig = Rig(sequence.camera, config.calibration)
    for matches, _ in find_matches(sequence, config):
        if len(matches):
            corrected = rig.correct(matches)  # with the estimate from the frames before
            rig.update_from_rows(matches)
    before, after = (
        float(np.median(np.abs(m.cur_left[:, 1] - m.cur_right[:, 1]))) for m in (matches, corrected)
    )
    assert after < 0.15 < 0.2 < before


@pytest.mark.parametrize("seed", [897, 2880])
def test_few_or_random_matches_keep_the_estimate_valid(seed: int) -> None:
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
    before = rig.estimate
    rig.update(few, np.eye(3), t_cp)
    assert rig.estimate is before
    rig.update_from_rows(wild[np.arange(0)])
    assert np.isfinite(rig.errors).all()
