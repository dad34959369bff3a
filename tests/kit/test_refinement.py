"""The refinement converges from a distant start and for large rotations."""

from __future__ import annotations

import numpy as np
import pytest

from vo_lib.geometry.motion import essential_from_motion, rotation_angle, rotation_from_vector
from vo_lib.geometry.types import Array
from vo_lib.kit.refined_selection import motion_of_candidate
from vo_lib.kit.refinement import distances_and_derivatives, refine
from vo_lib.kit.settings import KitSelectionConfig
from vo_lib.paper.sampson import match_terms, sampson_distance

FOCAL = 700.0
DIRECTION = np.array([0.1, -0.05, -1.0]) / np.linalg.norm([0.1, -0.05, -1.0])
# Rotations about each axis and about a mixed one, larger than a car's rotations.
AXES = {"pitch": (1, 0, 0), "yaw": (0, 1, 0), "roll": (0, 0, 1), "mixed": (0.6, -0.7, 0.4)}


def turn(axis: str, degrees: float) -> Array:
    about = np.array(AXES[axis], float)
    return rotation_from_vector(np.radians(degrees) * about / np.linalg.norm(about))


def visible_points(R_cp: Array, number: int = 200, seed: int = 0) -> tuple[Array, Array, Array]:
    """Normalised points x_p and x_c (N, 2), and the points X_p (N, 3), in front of both cameras."""
    X_c = np.random.default_rng(seed).uniform([-6, -3, 6], [6, 3, 30], (60 * number, 3))
    X_p = (X_c - 1.2 * DIRECTION) @ R_cp
    ahead = np.flatnonzero(X_p[:, 2] > 1.0)[:number]
    assert len(ahead) == number
    X_p, X_c = X_p[ahead], X_c[ahead]
    return X_p[:, :2] / X_p[:, 2:], X_c[:, :2] / X_c[:, 2:], X_p


@pytest.mark.parametrize("axis", AXES)
@pytest.mark.parametrize("degrees", [5.0, -10.0])
@pytest.mark.parametrize("turned", [2.0, 25.0])
def test_refinement_converges_to_the_true_motion(axis: str, degrees: float, turned: float) -> None:
    R = turn("mixed", turned)
    start, astray = turn(axis, degrees) @ R, np.array([0.1, 0.1, 0.0]) + DIRECTION
    result, direction = refine(start, astray, match_terms(*visible_points(R)[:2]), 100.0 / FOCAL, 30)
    assert rotation_angle(result.T @ R) < 1e-6
    np.testing.assert_allclose(direction, DIRECTION, atol=1e-5)


@pytest.mark.parametrize("axis", AXES)
@pytest.mark.parametrize("turned", [2.0, 30.0, 50.0])
def test_refinement_derivative_equals_finite_differences(axis: str, turned: float) -> None:
    R, h = turn(axis, turned), 1e-6
    x_p, x_c, _ = visible_points(R)
    aside = turn("mixed", 1.0) @ R

    def distance(by: Array) -> Array:
        return sampson_distance(essential_from_motion(rotation_from_vector(by) @ aside, DIRECTION), x_p, x_c)

    r, jac = distances_and_derivatives(aside, DIRECTION, match_terms(x_p, x_c))
    np.testing.assert_allclose(r, distance(np.zeros(3)), atol=1e-12)
    for k, step in enumerate(h * np.eye(3)):
        np.testing.assert_allclose(jac[k], (distance(step) - distance(-step)) / (2 * h), atol=1e-7)


@pytest.mark.parametrize("mode", ["literal", "refined"])
@pytest.mark.parametrize("axis", AXES)
@pytest.mark.parametrize("turned", [2.0, 30.0, 50.0])
def test_the_motion_of_a_winner_is_exact_for_large_rotations(mode: str, axis: str, turned: float) -> None:
    R = turn(axis, turned)
    x_p, x_c, X_p = visible_points(R)
    # The winner is near the truth; the refined winner is the truth.
    E = essential_from_motion(turn("mixed", 0.0 if mode == "literal" else 0.05) @ R, DIRECTION)
    result, direction, best, inliers = motion_of_candidate(
        E, x_p, x_c, X_p, KitSelectionConfig(mode=mode), FOCAL
    )
    assert rotation_angle(result.T @ R) < 1e-5
    np.testing.assert_allclose(direction, DIRECTION, atol=1e-4)
    assert inliers.all()
    assert np.abs(sampson_distance(best, x_p, x_c)).max() < 1e-5
