"""Pitch and yaw between the camera's axes and the truth's: found where they are known."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from conftest import winding_road

from vo_lib.commands.cli import main
from vo_lib.core.geometry import rotation_from_vector
from vo_lib.core.poses import write_kitti_poses
from vo_lib.core.types import Array
from vo_lib.evaluation.axes import LARGEST, axes_rotation, fit_axes, turn_axes
from vo_lib.evaluation.kitti import kitti_errors

LENGTHS = (20.0, 50.0)
TRUTH = winding_road(150, 0.04, 1.07)


def drifting(truth: Array) -> Array:
    """The truth's path with noise in every step."""
    rng = np.random.default_rng(5)
    motions = np.linalg.inv(truth[:-1]) @ truth[1:]
    motions[:, :3, :3] @= rotation_from_vector(rng.normal(0.0, 1e-3, (len(motions), 3)))
    motions[:, :3, 3] += rng.normal(0.0, 0.01, (len(motions), 3))
    poses = [truth[0]]
    for motion in motions:
        poses.append(poses[-1] @ motion)
    return np.array(poses)


@pytest.mark.parametrize(("pitch", "yaw"), [(0.5, -0.9), (-0.123, 0.0), (1.0, 1.0), (0.0, 0.3)])
def test_a_camera_turned_by_a_known_pitch_and_yaw_gets_them_back_and_no_error(
    pitch: float, yaw: float
) -> None:
    seen = turn_axes(TRUTH, axes_rotation((pitch, yaw)).T)
    measured = kitti_errors(TRUTH, seen, LENGTHS, 1).te
    assert measured is not None
    assert measured > 0.1
    found = fit_axes(TRUTH, seen, LENGTHS, 1)
    assert (found.pitch, found.yaw) == pytest.approx((pitch, yaw), abs=1e-6)
    assert found.kitti.te == pytest.approx(0.0, abs=1e-4)


def test_a_perfect_estimate_needs_no_turn() -> None:
    found = fit_axes(TRUTH, TRUTH, LENGTHS, 1)
    assert (found.pitch, found.yaw) == (0.0, 0.0)
    assert found.kitti.te == pytest.approx(0.0, abs=1e-12)


def test_with_positive_pitch_and_yaw_the_camera_looks_up_and_right() -> None:
    x, y, _ = axes_rotation((0.5, 0.9)) @ np.array([0.0, 0.0, 1.0])
    assert x > 0 > y


def test_no_other_angles_give_a_smaller_te() -> None:
    estimate = turn_axes(drifting(TRUTH), axes_rotation((0.2, -0.4)))
    found = fit_axes(TRUTH, estimate, LENGTHS, 1)
    assert found.kitti.te is not None
    for pitch, yaw in ((0.01, 0.0), (-0.01, 0.0), (0.0, 0.01), (0.0, -0.01)):
        other = turn_axes(estimate, axes_rotation((found.pitch + pitch, found.yaw + yaw)))
        te = kitti_errors(TRUTH, other, LENGTHS, 1).te
        assert te is not None
        assert te > found.kitti.te


def test_angles_stay_within_their_limit_and_are_zero_without_sub_sequences() -> None:
    found = fit_axes(TRUTH, turn_axes(TRUTH, axes_rotation((-3.0, 0.0))), LENGTHS, 1)
    assert (found.pitch, found.yaw) == pytest.approx((LARGEST, 0.0), abs=1e-2)
    assert fit_axes(TRUTH[:5], TRUTH[:5]).to_dict() == {
        "pitch_deg": 0.0,
        "yaw_deg": 0.0,
        "subsequences": 0,
        "te_percent": None,
        "re_deg_per_100m": None,
    }


def test_the_command_prints_the_angles_beside_errors_as_measured(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_kitti_poses(tmp_path / "truth.txt", TRUTH)
    write_kitti_poses(tmp_path / "seen.txt", turn_axes(TRUTH, axes_rotation((0.25, -0.5)).T))
    words = ["evaluate", "--truth", str(tmp_path / "truth.txt"), "--estimate", str(tmp_path / "seen.txt")]
    words += ["--lengths", "20,50", "--step", "1"]
    assert main([*words, "--axes"]) == 0
    assert "+0.25" in (text := capsys.readouterr().out)
    assert "-0.50" in text
    assert main([*words, "--axes", "--json"]) == 0
    with_axes = json.loads(capsys.readouterr().out)
    assert main([*words, "--json"]) == 0
    plain = json.loads(capsys.readouterr().out)
    assert with_axes["sequences"][0].pop("axes")["te_percent"] < 0.01
    assert with_axes == plain
