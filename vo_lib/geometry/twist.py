"""Twists (..., 6), each a rotation vector w and a translation part v: logarithm and exponential of SE(3).

A twist (w, v) belongs to the motion with the rotation R(w) and the translation V v, where

    V = I + ((1 - cos θ) / θ²) W + ((θ - sin θ) / θ³) W²,   W = [w]×,   θ = ‖w‖.
"""

from __future__ import annotations

import numpy as np

from .motion import SMALL_ANGLE_RAD, rotation_angle, rotation_from_vector, skew, vector_from_rotation
from .types import Array


def twist_from_motion(T: Array) -> Array:
    """Twists (..., 6) of motions (..., 4, 4) with rotations of less than π.

    v = V⁻¹ t with V⁻¹ = I - W / 2 + c W², and c = (1 - θ / (2 tan(θ / 2))) / θ².
    """
    R = T[..., :3, :3]
    angle = rotation_angle(R)[..., None, None]
    small = angle < SMALL_ANGLE_RAD
    safe = np.where(small, 1.0, angle)
    c = np.where(small, 1.0 / 12.0, (1.0 - safe / (2.0 * np.tan(safe / 2.0))) / safe**2)
    w = vector_from_rotation(R)
    W = skew(w)
    v = (np.eye(3) - 0.5 * W + c * (W @ W)) @ T[..., :3, 3, None]
    return np.concatenate([w, v[..., 0]], axis=-1)


def motion_from_twist(xi: Array) -> Array:
    """Motions (..., 4, 4) of twists (..., 6)."""
    w = xi[..., :3]
    angle = np.linalg.norm(w, axis=-1)[..., None, None]
    small = angle < SMALL_ANGLE_RAD
    safe = np.where(small, 1.0, angle)
    b = np.where(small, 0.5 - angle**2 / 24.0, (1.0 - np.cos(safe)) / safe**2)
    c = np.where(small, 1.0 / 6.0 - angle**2 / 120.0, (safe - np.sin(safe)) / safe**3)
    W = skew(w)
    V = np.eye(3) + b * W + c * (W @ W)
    T = np.zeros((*xi.shape[:-1], 4, 4))
    T[..., :3, :3] = rotation_from_vector(w)
    T[..., :3, 3] = (V @ xi[..., 3:, None])[..., 0]
    T[..., 3, 3] = 1.0
    return T


def adjoint(T: Array) -> Array:
    """Matrices (..., 6, 6) that transform twists from frame b to frame a, for motions T_ab (..., 4, 4)."""
    R = T[..., :3, :3]
    result = np.zeros((*T.shape[:-2], 6, 6))
    result[..., :3, :3] = R
    result[..., 3:, 3:] = R
    result[..., 3:, :3] = skew(T[..., :3, 3]) @ R
    return result


def bracket(xi: Array) -> Array:
    """Matrices (..., 6, 6) of the Lie bracket with twists (..., 6): the derivative of `adjoint`."""
    W = skew(xi[..., :3])
    result = np.zeros((*xi.shape, 6))
    result[..., :3, :3] = W
    result[..., 3:, 3:] = W
    result[..., 3:, :3] = skew(xi[..., 3:])
    return result
