"""Group laws of motions, and properties of the essential matrix."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from vo_lib.geometry.motion import (
    decompose_essential,
    essential_angle,
    essential_from_motion,
    essential_vector,
    inverse,
    nearest_rotation,
    quaternion_from_rotation,
    rigid,
    rotation_angle,
    rotation_from_quaternion,
    rotation_from_vector,
    skew,
    transform,
    vector_from_rotation,
)
from vo_lib.geometry.types import Array

vectors = arrays(np.float64, 3, elements=st.floats(-3.0, 3.0, allow_subnormal=False))


@given(vectors, vectors)
def test_skew_is_the_cross_product(v: Array, w: Array) -> None:
    np.testing.assert_allclose(skew(v) @ w, np.cross(v, w), atol=1e-12)


@given(vectors)
def test_rodrigues_agrees_with_opencv(w: Array) -> None:
    np.testing.assert_allclose(rotation_from_vector(w), cv2.Rodrigues(w)[0], atol=1e-9)


@given(st.floats(1e-12, np.pi), vectors)
def test_rotation_angle_is_the_length_of_the_vector(angle: float, axis: Array) -> None:
    norm = np.linalg.norm(axis)
    if norm > 1e-3:
        R = rotation_from_vector(axis / norm * angle)
        np.testing.assert_allclose(rotation_angle(R), angle, rtol=1e-6, atol=1e-14)


@given(vectors, vectors)
def test_motion_times_inverse_is_identity(w: Array, t: Array) -> None:
    T = rigid(rotation_from_vector(w), t)
    np.testing.assert_allclose(T @ inverse(T), np.eye(4), atol=1e-12)
    X = np.array([[1.0, 2.0, 3.0], [-4.0, 0.5, 9.0]])
    np.testing.assert_allclose(transform(inverse(T), transform(T, X)), X, atol=1e-11)


@given(vectors)
def test_rotations_survive_a_round_trip_through_quaternions(w: Array) -> None:
    R = rotation_from_vector(w)
    q = quaternion_from_rotation(R)
    assert q[3] >= 0
    np.testing.assert_allclose(rotation_from_quaternion(q), R, atol=1e-9)


@given(vectors, arrays(np.float64, (3, 3), elements=st.floats(-1e-3, 1e-3)))
def test_nearest_rotation_of_a_disturbed_one(w: Array, noise: Array) -> None:
    R = rotation_from_vector(w)
    near = nearest_rotation(R + noise)
    np.testing.assert_allclose(near @ near.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(near) > 0
    assert rotation_angle(near.T @ R) < 1e-2


@given(vectors, vectors)
def test_decomposition_contains_the_motion(w: Array, t: Array) -> None:
    length = np.linalg.norm(t)
    if length < 1e-2:
        return
    R = rotation_from_vector(w)
    rotations, direction = decompose_essential(essential_from_motion(R, t))
    assert min(float(rotation_angle(R.T @ Ri)) for Ri in rotations) < 1e-7
    np.testing.assert_allclose(np.abs(direction @ t) / length, 1.0, atol=1e-9)


@pytest.mark.parametrize("angle", [0.0, 1e-9, 5e-5, 2e-4, 0.3, 3.1])
def test_a_rotation_has_the_vector_from_which_it_was_made(angle: float) -> None:
    w = angle * np.array([[0.6, -0.48, 0.64], [0.0, 0.0, -1.0]])
    np.testing.assert_allclose(vector_from_rotation(rotation_from_vector(w)), w, rtol=1e-9, atol=1e-15)


def test_essential_angle_ignores_sign_and_scale() -> None:
    E = essential_from_motion(np.eye(3), np.array([0.0, 0.1, 1.0]))
    assert essential_angle(essential_vector(E), essential_vector(-7.0 * E)) < 1e-7
    other = essential_from_motion(np.eye(3), np.array([1.0, 0.0, 0.0]))
    np.testing.assert_allclose(essential_angle(essential_vector(E), essential_vector(other)), np.pi / 2)
