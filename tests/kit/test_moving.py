"""Motion of the vehicle in a box: steps of the features in space, and steps of the box."""

from __future__ import annotations

import numpy as np
import pytest
from box_scenes import CAMERA, STEP, match_points, street_points
from numpy.typing import NDArray

from vo_lib.geometry.boxes import Boxes
from vo_lib.geometry.motion import rigid, rotation_from_vector, transform
from vo_lib.geometry.types import Array
from vo_lib.kit.moving import PointSteps, box_steps, owner_of, point_steps

CAR = np.array([-0.7, 0.3, 0.2])  # step of a car relative to the street, current camera's axes


def step_of(yaw: float, roll: float = 0.0) -> Array:
    """Motion T_cp of a camera that moves 0.8 m forward and rotates by `yaw` and `roll` degrees."""
    return rigid(rotation_from_vector(np.radians([0.0, yaw, roll])), np.array([0.05, 0.0, -0.8]))


@pytest.mark.parametrize("T_cp", [STEP, step_of(8.0, 5.0), step_of(-8.0, 5.0), step_of(40.0, 5.0)])
@pytest.mark.parametrize("step", [np.zeros(3), CAR])
def test_point_steps_equal_the_true_steps(T_cp: Array, step: Array) -> None:
    X = street_points(np.random.default_rng(1), 50)
    X = X[transform(T_cp, X)[:, 2] > 1.0]
    assert len(X) > 10
    result = point_steps(CAMERA, match_points(X, transform(T_cp, X) + step), T_cp)
    np.testing.assert_allclose(result.step, np.tile(step, (len(X), 1)), atol=1e-9)
    np.testing.assert_allclose(result.depth, transform(T_cp, X)[:, 2])


def boxes(*xyxy: tuple[float, ...], kind: int = 2) -> Boxes:
    return Boxes(np.array(xyxy, float), np.full(len(xyxy), kind), np.ones(len(xyxy)))


def test_feature_in_two_boxes_belongs_to_the_nearer() -> None:
    both = boxes((100, 100, 200, 180), (150, 100, 300, 220))
    left = np.array([[120.0, 150.0], [180.0, 150.0], [280.0, 150.0], [400.0, 150.0]])
    assert owner_of(CAMERA, left, left - (40.0, 0.0), both).tolist() == [0, 1, 1, -1]


def steps_of(step: Array, background: int) -> tuple[PointSteps, NDArray[np.int64]]:
    """Steps and owners of features: 20 on a vehicle 15 m ahead, `background` behind it, 100 on the street."""
    rng = np.random.default_rng(4)
    car = np.array([0.5, 0.8, 15.0]) + rng.uniform(-0.8, 0.8, (20, 3))
    behind = np.array([1.0, 0.0, 25.0]) + rng.uniform(-2, 2, (background, 3))
    X = np.concatenate([car, behind, street_points(rng, 100)])
    moved = transform(STEP, X)
    moved[:20] += step
    owner = np.repeat(np.array([0, -1]), [20 + background, 100])
    return point_steps(CAMERA, match_points(X, moved, 0.15, rng), STEP), owner


@pytest.mark.parametrize("background", [0, 10, 20])
@pytest.mark.parametrize("step", [CAR, -0.3 * CAR, np.zeros(3)])
def test_box_step_tolerates_background_features(background: int, step: Array) -> None:
    points, owner = steps_of(step, background)
    result = box_steps(points, owner, 1, 0.15**2)
    assert result.matches.tolist() == [20 + background]
    deviation = np.sqrt(result.step[0] @ result.information[0] @ result.step[0])
    if step.any():
        assert np.linalg.norm(result.step[0] - step) < 0.05
        assert deviation > 8.0
    else:
        assert deviation < 3.0
