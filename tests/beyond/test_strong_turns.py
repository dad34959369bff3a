"""A camera that turns strongly past parked cars: they stand, for the street turns with them."""

from __future__ import annotations

import numpy as np
import pytest
from box_scenes import CAMERA, match_points, street_points

from vo_lib.beyond.box_tracks import MOVING, PARKED, BoxMotionClassifier, new_tracks, with_evidence
from vo_lib.beyond.moving import BoxSteps, no_steps, point_steps
from vo_lib.config import FilterConfig, MovingConfig
from vo_lib.core.boxes import Boxes
from vo_lib.core.geometry import rigid, rotation_from_vector, transform
from vo_lib.core.matches import StereoMatches
from vo_lib.core.types import Array

PLACES = {"left": (-4.0, 0.6, 14.0), "right": (5.0, 0.6, 18.0), "far": (-6.0, 0.6, 26.0)}


def step_of(yaw: float, roll: float = 0.0) -> Array:
    """Motion T_cp of a camera that goes 0.8 m ahead and turns, degrees."""
    return rigid(rotation_from_vector(np.radians([0.0, yaw, roll])), np.array([0.05, 0.0, -0.8]))


@pytest.mark.parametrize("yaw", [8.0, -8.0, 40.0])
def test_a_standing_point_has_no_step_however_the_camera_turns(yaw: float) -> None:
    T_cp = step_of(yaw, 5.0)
    X = street_points(np.random.default_rng(1), 50)
    ahead = transform(T_cp, X)[:, 2] > 1.0
    found = point_steps(CAMERA, match_points(X[ahead], transform(T_cp, X[ahead])), T_cp)
    assert np.count_nonzero(ahead) > 10
    np.testing.assert_allclose(found.step, 0.0, atol=1e-9)


@pytest.mark.parametrize("yaw", [35.0, -35.0])
def test_the_uncertainty_of_the_point_before_turns_with_the_camera(yaw: float) -> None:
    """Whitened by its own information, the scatter of a step is the same in all directions."""
    T_cp, n, noise = step_of(yaw), 20000, 0.05
    # Before the turn the point is far and to one side, after it ahead.
    X_c = np.tile([0.3, -0.2, 25.0], (n, 1))
    X_p = (X_c - T_cp[:3, 3]) @ T_cp[:3, :3]
    found = point_steps(CAMERA, match_points(X_p, X_c, noise, np.random.default_rng(2)), T_cp)
    scatter = np.cov(found.step.T) / noise**2
    root = np.linalg.cholesky(np.linalg.inv(np.linalg.inv(found.information).mean(axis=0)))
    np.testing.assert_allclose(root.T @ scatter @ root, np.eye(3), atol=0.1)


def test_what_was_learnt_of_a_vehicle_turns_into_the_axes_of_the_next_camera() -> None:
    config = MovingConfig(memory=0.7)
    R_cp = rotation_from_vector(np.radians([10.0, 60.0, -20.0]))
    step, information = np.array([0.2, 0.0, 1.0]), np.diag([4e4, 9e4, 1e4])
    tracks = new_tracks(np.array([[0.0, 0.0, 10.0, 10.0]]))
    fresh = BoxSteps(step[None], information[None], np.array([20]))
    known = with_evidence(tracks, fresh, np.eye(3), config)
    later = with_evidence(known, no_steps(1), R_cp, config)
    np.testing.assert_allclose(np.linalg.solve(later.information[0], later.vector[0]), R_cp @ step, atol=1e-9)
    np.testing.assert_allclose(later.information[0], R_cp @ information @ R_cp.T, atol=1e-6)
    assert known.state.tolist() == later.state.tolist() == [MOVING]


def parked_car(place: tuple[float, float, float]) -> tuple[Array, Array]:
    """Forty points of a standing car and the corners of its outline, (N, 3) and (8, 3)."""
    half = np.array([0.9, 0.7, 1.5])
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * half
    points = np.random.default_rng(5).uniform(-1, 1, (40, 3)) * half
    return points + place, corners + place


def box_round(corners: Array) -> Boxes:
    uv = CAMERA.project(corners)[0]
    return Boxes(np.concatenate([uv.min(axis=0), uv.max(axis=0)])[None], np.array([2]), np.ones(1))


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("yaw", [3.0, -3.0])
def test_a_parked_car_stays_parked_while_the_camera_turns(place: str, yaw: float) -> None:
    T_cp, rng = step_of(yaw, yaw / 2), np.random.default_rng(6)
    points, corners = parked_car(PLACES[place])
    classifier = BoxMotionClassifier(CAMERA, FilterConfig())
    classifier.start(box_round(corners))
    states = []
    for _ in range(5):
        street = street_points(rng, 200)
        before = np.concatenate([street, points])
        after = transform(T_cp, before)
        points, corners = after[200:], transform(T_cp, corners)
        matches: StereoMatches = match_points(before, after, 0.15, rng)
        judgement = classifier.step(matches, box_round(corners))
        assert not judgement.few_background
        states += judgement.state.tolist()
    assert MOVING not in states
    assert states[-1] == PARKED


@pytest.mark.parametrize("yaw", [25.0, -25.0])
def test_two_steps_of_a_vehicle_add_up_while_the_camera_turns(yaw: float) -> None:
    """Straight on in the world, the steps seen from two cameras stand at an angle.

    Put together in one camera's axes they are a metre long; without the turn between, or with the opposite
    one, their mean is shorter: 0.98 m and 0.91 m.
    """
    T_cp, rng, length = step_of(yaw), np.random.default_rng(7), 1.0
    points, corners = parked_car((0.0, 0.6, 11.0))
    # Of the first camera: so that the vehicle is before the second one, too.
    turned = rotation_from_vector(np.radians([0.0, -yaw / 2, 0.0]))
    points, corners, step = points @ turned.T, corners @ turned.T, np.array([0.0, 0.0, length])
    classifier = BoxMotionClassifier(CAMERA, FilterConfig(moving=MovingConfig(min_step=0.985 * length)))
    classifier.start(box_round(corners))
    for _ in range(2):
        street = street_points(rng, 300)
        street = street[transform(T_cp, street)[:, 2] > 2.0]
        step = T_cp[:3, :3] @ step
        before = np.concatenate([street, points])
        points, corners = transform(T_cp, points) + step, transform(T_cp, corners) + step
        after = np.concatenate([transform(T_cp, street), points])
        judgement = classifier.step(match_points(before, after, 0.01, rng), box_round(corners))
        np.testing.assert_allclose(judgement.step[0], step, atol=0.01)
    assert judgement.state.tolist() == [MOVING]
