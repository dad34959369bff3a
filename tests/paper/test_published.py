"""Variant `published`: selection, standstill, translation, and errors on real images."""

from __future__ import annotations

import dataclasses
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from box_scenes import CAMERA, match_points
from real_images import DRIVE_0013, RealImages

from measure.axes import fit_axes
from vo_lib.config import PUBLISHED, change, preset
from vo_lib.data.catalogue import open_sequence
from vo_lib.data.sequence import Sequence
from vo_lib.evaluation.kitti_errors import kitti_errors
from vo_lib.geometry.boxes import Boxes, no_boxes
from vo_lib.geometry.matches import StereoMatches, empty_matches
from vo_lib.geometry.motion import (
    essential_angle,
    essential_from_motion,
    essential_vector,
    inverse,
    rigid,
    rotation_angle,
    rotation_from_vector,
    transform,
)
from vo_lib.geometry.types import Array, BoolArray
from vo_lib.paper.odometry import Odometry
from vo_lib.paper.translation import (
    PairBefore,
    earlier_rows,
    eliminate_points,
    feature_rows,
    solve_translation,
)
from vo_lib.runs.drive import make_odometry, run, run_methods
from vo_lib.runs.match_cache import CachedMatches

R_CP = rotation_from_vector(np.array([0.004, 0.03, -0.002]))
T_CP = rigid(R_CP, np.array([0.05, -0.02, -1.1]))
CONFIG = PUBLISHED["solution_selection"].translation


def scene(
    number: int = 300, seed: int = 0, T_cp: Array = T_CP, noise: float = 0.0, farthest: float = 50.0
) -> StereoMatches:
    """Matches of points in the whole image, at depths from 6 to `farthest` metres, for a motion T_cp."""
    rng = np.random.default_rng(seed)
    disparity = CAMERA.f * CAMERA.baseline / rng.uniform(6.0, farthest, number)
    X = CAMERA.back_project(rng.uniform((60, 20), (1180, 356), (number, 2)), disparity)
    matches = match_points(X, transform(T_cp, X), noise, rng)
    return dataclasses.replace(matches, id=1000 * seed + matches.id)


def translation(
    matches: StereoMatches, R_cp: Array = R_CP, before: PairBefore | None = None, agreement: float = 1.0
) -> tuple[Array, BoolArray]:
    config = dataclasses.replace(CONFIG, agreement=agreement)
    solved = solve_translation(CAMERA, matches, R_cp, config, before)
    assert solved is not None
    return solved


def pair_before(matches: StereoMatches, T_cp: Array) -> PairBefore:
    """A previous pair with the same motion and with all matches except the last, in a different order."""
    X_p = CAMERA.triangulate(matches.prev_left, matches.prev_right)
    earlier = match_points(transform(inverse(T_cp), X_p), X_p)
    return PairBefore(earlier[np.arange(len(matches) - 2, -1, -1)], T_cp)


def odometry(method: str = "solution_selection") -> Odometry:
    made = make_odometry(CAMERA, preset(method, variant="published"))
    made.start(no_boxes())
    return made


@pytest.mark.parametrize("method", PUBLISHED)
def test_exact_matches_give_the_exact_motion(method: str) -> None:
    motion = odometry(method).step(scene(), no_boxes()).motion
    np.testing.assert_allclose(motion.T_cp, T_CP, atol=1e-6)
    assert float(rotation_angle(motion.T_cp[:3, :3] @ R_CP.T)) < 1e-7
    assert motion.flags == ()


def test_winner_becomes_e_prev() -> None:
    system = odometry()
    first = system.step(scene(noise=0.3), no_boxes()).motion
    assert np.isnan(first.prior_angle)
    assert system.e_prev is not None
    before = system.e_prev
    # The winner fits five noisy matches, so it is near the truth.
    truth = essential_vector(essential_from_motion(R_CP, T_CP[:3, 3]))
    assert 1e-6 < float(essential_angle(before, truth)) < 0.05
    second = system.step(scene(seed=1, noise=0.3), no_boxes()).motion
    assert second.prior_angle == pytest.approx(
        float(np.degrees(essential_angle(system.e_prev, before))), abs=1e-9
    )


def test_prior_selects_before_the_error() -> None:
    """One set has the truth and a solution near E_prev, the other set has a solution between these two."""
    matches = scene()
    x_p, x_c = CAMERA.normalise(matches.prev_left), CAMERA.normalise(matches.cur_left)
    before, between = (turned_by(angle) for angle in (0.10, 0.05))
    E = np.array([turned_by(0.0), before, between])
    chosen = {}
    for method in ("mesvo_f", "solution_selection"):
        system = make_odometry(CAMERA, change(preset(method, variant="published"), "selection.top_k", 1))
        system.e_prev = essential_vector(before)
        chosen[method] = system.select(E, np.array([0, 0, 1]), x_p, x_c).candidate
    # Consensus selects the truth. The prior keeps one solution per set, and the better kept solution wins.
    assert chosen == {"mesvo_f": 0, "solution_selection": 2}


def turned_by(angle: float) -> Array:
    """The essential matrix of the true motion with an additional rotation, radians."""
    off = rotation_from_vector(np.array([0.0, angle, 0.0]))
    return essential_from_motion(off @ R_CP, T_CP[:3, 3])


def test_standstill_is_the_identity_and_keeps_e_prev() -> None:
    system = odometry()
    system.step(scene(), no_boxes())
    before = system.e_prev
    hardly = scene(seed=4, T_cp=rigid(np.eye(3), np.array([0.0, 0.0, -0.005])))
    motion = system.step(hardly, no_boxes()).motion
    np.testing.assert_array_equal(motion.T_cp, np.eye(4))
    assert motion.flags == ("standstill",)
    assert system.e_prev is before


def test_few_matches_repeat_the_last_motion() -> None:
    system = odometry()
    first = system.step(scene(), no_boxes()).motion
    again = system.step(empty_matches(), no_boxes()).motion
    np.testing.assert_array_equal(again.T_cp, first.T_cp)
    assert again.flags == ("few_matches",)


def test_features_in_boxes_are_removed_before_buckets() -> None:
    system = odometry("feature_selection")
    left = Boxes(np.array([[-1e4, -1e3, 400.0, 1e3]]), np.array([2]), np.ones(1))
    right = Boxes(np.array([[800.0, -1e3, 1e4, 1e3]]), np.array([2]), np.ones(1))
    matches = scene(2000)
    system.start(left)
    motion = system.step(matches, right).motion
    missing_part = (matches.prev_left[:, 0] <= 400) | (matches.cur_left[:, 0] >= 800)
    assert motion.removed == np.count_nonzero(missing_part)
    assert motion.used > 100


def test_one_feature_gives_a_translation() -> None:
    """Equation (3) has eight rows and six unknowns (section 2.1)."""
    M, d = eliminate_points(*feature_rows(CAMERA, scene(5), R_CP))
    for rows, values in zip(M, d, strict=True):
        np.testing.assert_allclose(np.linalg.pinv(rows) @ values, T_CP[:3, 3], atol=1e-9)


def test_previous_pair_adds_four_rows() -> None:
    matches = scene(40)
    A, c = earlier_rows(CAMERA, matches, pair_before(matches, T_CP))
    Q = CAMERA.triangulate(matches.prev_left, matches.prev_right)
    np.testing.assert_allclose((A @ Q[:, :, None])[..., 0], c, atol=1e-9)
    assert np.linalg.matrix_rank(A).tolist() == 39 * [3] + [0]  # no earlier match of the last feature


def off_by_rectification(matches: StereoMatches) -> StereoMatches:
    """The matches after the addition of a smooth disparity error, similar to KITTI's rectification error."""
    for right in (matches.prev_right, matches.cur_right):
        x, y = CAMERA.normalise(right).T
        right[:, 0] += 0.2 - 0.8 * x**2 - 6.3 * y**2 - 0.8 * x * y + 4 * x**4 - 1.5 * x**2 * y
    return matches


def test_third_frame_lowers_the_rectification_error() -> None:
    """The error makes steps of 1 m too long; the rows of the previous pair reduce the excess length."""
    forward = rigid(np.eye(3), np.array([0.0, 0.0, -1.0]))
    errors = []
    for seed in range(20):
        X = CAMERA.triangulate(*(getattr(scene(400, seed), view) for view in ("prev_left", "prev_right")))
        rng, views = np.random.default_rng(seed), (transform(inverse(forward), X), X, transform(forward, X))
        pairs = pairwise(views)
        first, second = (off_by_rectification(match_points(*pair, 0.2, rng)) for pair in pairs)
        t_first, _ = translation(first, np.eye(3))
        before = PairBefore(first, rigid(np.eye(3), t_first))
        errors.append([-1.0 - translation(second, np.eye(3), expected)[0][2] for expected in (None, before)])
    two, three = np.mean(errors, axis=0)
    assert 0.0 < three < 0.9 * two


def test_frames_without_motion_are_no_previous_pair() -> None:
    """The previous pair is not used after a standstill or a frame with few matches."""
    moving, still = scene(noise=0.1), scene(seed=1, T_cp=np.eye(4))
    two = change(preset("solution_selection"), "translation.pairs", 2)
    for matches in (still, empty_matches()):
        frames = moving, moving, matches, moving
        systems = odometry(), make_odometry(CAMERA, two)
        three_pairs, two_pairs = (
            [system.step(each, no_boxes()).motion.T_cp.tobytes() for each in frames] for system in systems
        )
        assert three_pairs[1] != two_pairs[1]
        assert three_pairs[3] == two_pairs[3]


def test_stacked_rows_equal_the_pseudo_inverse() -> None:
    matches = scene(40, noise=0.2)
    t, agrees = translation(matches, agreement=50.0)
    assert agrees.all()
    A, B, c = feature_rows(CAMERA, matches, R_CP)
    whole = np.zeros((40, 8, 3 * 40 + 3))
    for i in range(40):
        whole[i, :, 3 * i : 3 * i + 3], whole[i, :, -3:] = A[i], B[i]
    # In pixels, as in equation (2): the rows of a feature are divided by the feature's depth.
    depth = CAMERA.triangulate(matches.prev_left, matches.prev_right)[:, 2:]
    pixels = np.linalg.pinv((whole / depth[:, None]).reshape(320, -1)) @ (c / depth).ravel()
    np.testing.assert_allclose(t, pixels[-3:], atol=1e-9)


def test_pixel_noise_does_not_shorten_steps() -> None:
    """Least squares with noisy coefficients has a bias: with rows in metres, steps are 0.7 % too short."""
    forward = rigid(np.eye(3), np.array([0.0, 0.0, -1.0]))
    far = (scene(400, seed, forward, noise=0.2, farthest=100.0) for seed in range(40))
    steps = [translation(matches, np.eye(3))[0] for matches in far]
    assert abs(np.mean(steps, axis=0)[2] + 1.0) < 0.003


def test_inlier_limit_of_a_feature_counts_its_own_rows() -> None:
    """Features with eight and with twelve rows are removed as if each kind were alone."""
    forward = rigid(np.eye(3), np.array([0.0, 0.0, -1.0]))
    X = CAMERA.triangulate(*(getattr(scene(3000), view) for view in ("prev_left", "prev_right")))
    rng = np.random.default_rng(2)
    earlier = match_points(transform(inverse(forward), X), X, 0.4, rng)
    now = match_points(X, transform(forward, X), 0.4, rng)
    now = dataclasses.replace(now, prev_left=earlier.cur_left, prev_right=earlier.cur_right)
    with_twelve = np.arange(len(now)) % 4 == 0
    quarter = PairBefore(earlier[np.flatnonzero(with_twelve)], forward)
    _, of_two = translation(now, np.eye(3))
    _, of_three = translation(now, np.eye(3), PairBefore(earlier, forward))
    _, mixed = translation(now, np.eye(3), quarter)
    # Only the translation, which differs by millimetres, moves a few features across the limit.
    assert 0.5 < np.mean(of_two) < 0.9
    assert np.mean(mixed[~with_twelve] != of_two[~with_twelve]) < 0.01
    assert np.mean(mixed[with_twelve] != of_three[with_twelve]) < 0.01


def test_wrong_depths_do_not_change_the_translation() -> None:
    matches = scene(300, noise=0.1)
    wrong = np.arange(300) % 3 == 0
    matches.cur_right[wrong, 0] -= 9.0  # a repeated texture: a disparity error of 9 px
    t, agrees = translation(matches)
    assert not agrees[wrong].any()
    assert np.linalg.norm(t - T_CP[:3, 3]) < 0.02


def test_seed_determines_the_bytes(bands: Path) -> None:
    sequence = open_sequence(bands)
    configs = [preset("solution_selection", variant="published", seed=seed) for seed in (1, 1, 2)]
    poses = [run(sequence, config).poses for config in configs]
    assert poses[0].tobytes() == poses[1].tobytes() != poses[2].tobytes()
    assert np.abs(poses[0][:, 0, 3] - 0.5 * np.arange(6)).max() < 0.03


def test_published_errors_on_00(drive_00: Sequence) -> None:
    """Sub-sequences of 100 m from every frame."""
    config = preset("solution_selection", variant="published")
    result = run_methods(drive_00, {"": config}, matches=CachedMatches(drive_00, config))[""]
    assert drive_00.truth is not None
    errors = kitti_errors(drive_00.truth, result.poses, (100.0,), 1)
    assert errors.te is not None
    assert errors.re is not None
    assert 0.85 < errors.te < 1.15
    assert 1.3 < errors.re < 1.8


def test_published_errors_on_drive_0013(real: RealImages) -> None:
    """Sub-sequences of 50 m; the axes of this truth are turned against the camera, by about a degree."""
    drive = real.sequence(*DRIVE_0013)
    config = preset("solution_selection", variant="published")
    poses = run_methods(drive, {"": config}, matches=CachedMatches(drive, config))[""].poses
    assert drive.truth is not None
    errors = fit_axes(drive.truth, poses, [50.0], 1).kitti
    assert errors.te is not None
    assert errors.re is not None
    assert 1.3 < errors.te < 1.7
    assert 0.25 < errors.re < 0.55
