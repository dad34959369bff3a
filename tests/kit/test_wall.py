"""Motions along a wall: two motions fit the images of a plane, and the stereo depths tell them apart."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from vo_lib.config import preset
from vo_lib.geometry.boxes import no_boxes
from vo_lib.geometry.camera import StereoCamera
from vo_lib.geometry.matches import StereoMatches
from vo_lib.geometry.motion import essential_from_motion
from vo_lib.geometry.result import Flag, FrameResult
from vo_lib.geometry.types import Array
from vo_lib.paper.odometry import Odometry, Rotation, contradiction_limit
from vo_lib.runs.drive import make_odometry

CAMERA = StereoCamera(f=400.0, cx=319.5, cy=119.5, baseline=0.5, width=640, height=240)
SIDEWAYS = np.array([-0.5, 0.0, 0.0])  # metres a frame
UPWARDS = np.array([0.0, 0.3, 0.0])
NOISE = 0.01  # pixels, as in drawn images of a wall


def wall_matches(distance: float, t_cp: Array, seed: int, count: int = 200) -> StereoMatches:
    """Matches of a wall that faces the camera, metres away, for a translation t_cp without rotation."""
    rng = np.random.default_rng(seed)
    margin = 60.0  # pixels, for what moves out of the image
    uv = rng.uniform(margin, (CAMERA.width - margin, CAMERA.height - margin), (count, 2))
    X_p = np.column_stack([CAMERA.normalise(uv) * distance, np.full(count, distance)])
    views = np.array([*CAMERA.project(X_p), *CAMERA.project(X_p + t_cp)])
    views += rng.normal(0.0, NOISE, views.shape)
    index = np.arange(count)
    return StereoMatches(*views, np.ones(count, np.int64), np.ones(count), index)  # type: ignore[call-arg]


def drive_along(variant: str, seed: int, distance: float, t_cp: Array) -> list[FrameResult]:
    """Motions of eight frames along a wall."""
    odometry = make_odometry(CAMERA, preset("solution_selection", variant=variant, seed=seed))
    odometry.start(no_boxes())
    frames = [wall_matches(distance, t_cp, 100 * seed + number) for number in range(8)]
    return [odometry.step(matches, no_boxes()).motion for matches in frames]


@pytest.mark.parametrize(("distance", "t_cp"), [(12.0, SIDEWAYS), (20.0, SIDEWAYS), (25.0, UPWARDS)])
@pytest.mark.parametrize("seed", range(5))
def test_kit_takes_the_motion_that_stereo_supports(seed: int, distance: float, t_cp: Array) -> None:
    motions = drive_along("kit", seed, distance, t_cp)
    total = sum(motion.T_cp[:3, 3] for motion in motions)
    assert np.linalg.norm(total - 8 * t_cp) < 0.05 * np.linalg.norm(8 * t_cp)


@pytest.mark.parametrize(("distance", "t_cp"), [(12.0, SIDEWAYS), (20.0, SIDEWAYS), (25.0, UPWARDS)])
def test_published_flags_the_wrong_motions_and_no_right_one(distance: float, t_cp: Array) -> None:
    flagged = []
    wrong = []
    for seed in range(5):
        for motion in drive_along("published", seed, distance, t_cp):
            if motion.measured:
                error = np.linalg.norm(motion.T_cp[:3, 3] - t_cp)
                flagged.append(Flag.CONTRADICTS_STEREO in motion.flags)
                wrong.append(bool(error > 0.2 * np.linalg.norm(t_cp)))
    assert flagged == wrong
    assert any(wrong)


def test_a_flag_does_not_change_the_path(monkeypatch: pytest.MonkeyPatch) -> None:
    with_flags = drive_along("published", 0, 12.0, SIDEWAYS)
    assert any(Flag.CONTRADICTS_STEREO in motion.flags for motion in with_flags)
    monkeypatch.setattr(Odometry, "contradicts_stereo", lambda *_: False)
    without = drive_along("published", 0, 12.0, SIDEWAYS)
    for one, other in zip(with_flags, without, strict=True):
        np.testing.assert_array_equal(one.T_cp, other.T_cp)


def test_a_motion_is_judged_by_its_inliers() -> None:
    matches = wall_matches(12.0, SIDEWAYS, seed=0)
    # Most features are on a lorry that drives beside the camera, at the same distance.
    lorry = replace(matches, cur_left=matches.prev_left, cur_right=matches.prev_right)
    half = np.arange(200) < 80
    mixed = replace(
        matches,
        cur_left=np.where(half[:, None], matches.cur_left, lorry.cur_left),
        cur_right=np.where(half[:, None], matches.cur_right, lorry.cur_right),
    )
    odometry = make_odometry(CAMERA, preset("solution_selection"))
    right = Rotation(np.eye(3), essential_from_motion(np.eye(3), SIDEWAYS), half)
    assert not odometry.contradicts_stereo(mixed, right, SIDEWAYS)
    assert odometry.contradicts_stereo(mixed, right, 0.5 * SIDEWAYS)


def test_limit_follows_the_noise_within_bounds() -> None:
    limits = [contradiction_limit(noise, 1.5) for noise in (0.0, 0.05, 0.1, 0.4, 1.0)]
    assert limits == pytest.approx([0.3, 0.75, 1.5, 1.5, 3.0])
