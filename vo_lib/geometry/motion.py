"""Rigid motions, rotations and the essential matrix.

Conventions of the kit: `X_c = R_cp X_p + t_cp` transforms a point from the previous left camera p to the
current left camera c; `T_cp` is the 4×4 matrix of the same motion; `T_w_c` is the pose of camera c in the
world. Metres and radians.
"""

from __future__ import annotations

import numpy as np

from .types import Array

DEVIATION_OVER_MEDIAN = 1.4826  # standard deviation over median absolute deviation of normal noise
# Below this angle, series replace quotients that are nearly 0 / 0 (`rotation_from_vector` has its own limit).
SMALL_ANGLE_RAD = 1e-4


def skew(v: Array) -> Array:
    """Cross-product matrices (..., 3, 3) of vectors v (..., 3): skew(v) @ w = v × w."""
    v = np.asarray(v, dtype=np.float64)
    S = np.zeros((*v.shape, 3))
    S[..., 2, 1] = v[..., 0]
    S[..., 0, 2] = v[..., 1]
    S[..., 1, 0] = v[..., 2]
    return S - np.swapaxes(S, -1, -2)


def rotation_from_vector(w: Array) -> Array:
    """Rotation matrices (..., 3, 3) of rotation vectors w (..., 3) in radians, by Rodrigues' formula.

    R = I + (sin θ / θ) W + ((1 - cos θ) / θ²) W² with W = [w]× and θ = ‖w‖.
    """
    w = np.asarray(w, dtype=np.float64)
    theta2 = np.sum(w * w, axis=-1)[..., None, None]
    theta = np.sqrt(theta2)
    # Here the series are needed only where the quotients are 0 / 0. At slightly larger angles, 1 - cos θ has
    # a large relative error. But its absolute error is that of rounding, and its factor W² / θ² has entries
    # of at most 1, so R is as precise as at any other angle.
    small = theta2 < 1e-12
    safe = np.where(small, 1.0, theta)
    a = np.where(small, 1.0 - theta2 / 6.0, np.sin(safe) / safe)
    b = np.where(small, 0.5 - theta2 / 24.0, (1.0 - np.cos(safe)) / (safe * safe))
    W = skew(w)
    return np.asarray(np.eye(3) + a * W + b * (W @ W))


def rotation_angle(R: Array) -> Array:
    """Angle of rotation matrices (..., 3, 3), radians, in [0, π].

    The antisymmetric part of R has 2 sin θ times the axis, and its trace is 1 + 2 cos θ. Both together are
    precise even at small angles, where the cosine alone is not.
    """
    R = np.asarray(R, dtype=np.float64)
    axis = np.stack(
        [R[..., 2, 1] - R[..., 1, 2], R[..., 0, 2] - R[..., 2, 0], R[..., 1, 0] - R[..., 0, 1]], axis=-1
    )
    twice_sine = np.linalg.norm(axis, axis=-1)
    twice_cosine = np.trace(R, axis1=-2, axis2=-1) - 1.0
    return np.asarray(np.arctan2(twice_sine, twice_cosine))


def vector_from_rotation(R: Array) -> Array:
    """Rotation vectors (..., 3), radians, of rotation matrices (..., 3, 3) with angles of less than π.

    The inverse of `rotation_from_vector`: R - Rᵀ has 2 sin θ times the axis.
    """
    angle = rotation_angle(R)[..., None]
    difference = R - np.swapaxes(R, -1, -2)
    axis = np.stack([difference[..., 2, 1], difference[..., 0, 2], difference[..., 1, 0]], axis=-1)
    small = angle < SMALL_ANGLE_RAD
    safe = np.where(small, 1.0, angle)
    return np.asarray(axis * np.where(small, 0.5 + angle**2 / 12.0, safe / (2.0 * np.sin(safe))))


def nearest_rotation(M: Array) -> Array:
    """The rotation nearest to M (3, 3) in Frobenius norm; removes the rounding errors of long products."""
    U, _, Vt = np.linalg.svd(M)
    U[:, -1] *= np.linalg.det(U) * np.linalg.det(Vt)  # so that the product is no reflection
    return np.asarray(U @ Vt)


def quaternion_from_rotation(R: Array) -> Array:
    """Unit quaternion (qx, qy, qz, qw) of a rotation matrix (3, 3), in TUM's order and with qw >= 0."""
    R = np.asarray(R, dtype=np.float64)
    # Bar-Itzhack 2000: the quaternion is the eigenvector of this symmetric matrix for its largest eigenvalue.
    K = np.empty((4, 4))
    K[:3, :3] = R + R.T - np.trace(R) * np.eye(3)
    K[3, :3] = [R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]]
    K[:3, 3] = K[3, :3]
    K[3, 3] = np.trace(R)
    _, eigenvectors = np.linalg.eigh(K)  # by ascending eigenvalue
    q = eigenvectors[:, -1]
    return np.asarray(-q if q[3] < 0 else q)


def rotation_from_quaternion(q: Array) -> Array:
    """Rotation matrix (3, 3) of a quaternion (qx, qy, qz, qw) of any non-zero norm."""
    x, y, z, w = np.asarray(q, dtype=np.float64) / np.linalg.norm(q)
    S = skew(np.array([x, y, z]))
    return np.asarray(np.eye(3) + 2.0 * w * S + 2.0 * (S @ S))


def rigid(R: Array, t: Array) -> Array:
    """4×4 matrix of the motion X -> R X + t, from R (3, 3) and t (3,)."""
    T = np.eye(4)
    T[:3, :3] = R
    T[:3, 3] = t
    return T


def inverse(T: Array) -> Array:
    """Inverses X -> Rᵀ (X - t) of rigid motions (..., 4, 4)."""
    R_inverse = np.swapaxes(T[..., :3, :3], -1, -2)
    result = np.zeros_like(T)
    result[..., :3, :3] = R_inverse
    result[..., :3, 3] = -(R_inverse @ T[..., :3, 3, None])[..., 0]
    result[..., 3, 3] = 1.0
    return result


def transform(T: Array, X: Array) -> Array:
    """Apply a motion T (4, 4) to points X (N, 3)."""
    return np.asarray(X @ T[:3, :3].T + T[:3, 3])


def essential_from_motion(R_cp: Array, t_cp: Array) -> Array:
    """Essential matrices E = [t_cp]× R_cp (..., 3, 3) of motions; all static points have x_cᵀ E x_p = 0."""
    return np.asarray(skew(t_cp) @ R_cp)


def essential_vector(E: Array) -> Array:
    """Essential vectors e = vec(E) / ‖E‖, (..., 9); sign and scale of E are free."""
    e = np.reshape(E, (*np.shape(E)[:-2], 9))
    return np.asarray(e / np.linalg.norm(e, axis=-1, keepdims=True))


def essential_angle(e1: Array, e2: Array) -> Array:
    """Angle acos|e1ᵀ e2| between essential vectors, radians, in [0, π/2] (paper, section 2.2)."""
    return np.asarray(np.arccos(np.minimum(np.abs(np.sum(e1 * e2, axis=-1)), 1.0)))


def decompose_essential(E: Array) -> tuple[Array, Array]:
    """The two rotations (..., 2, 3, 3) and the unit translation (..., 3) of E; t may have either sign.

    E = U diag(1, 1, 0) Vᵀ gives R = U W Vᵀ or U Wᵀ Vᵀ and t = ± the last column of U
    (Hartley and Zisserman, result 9.19). Known depths select one of the four pairs (R, ±t).
    """
    U, _, Vt = np.linalg.svd(E)
    # The sign of E is free, so U and V may be made rotations, with determinant 1.
    U = U * np.linalg.det(U)[..., None, None]
    Vt = Vt * np.linalg.det(Vt)[..., None, None]
    W = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    rotations = np.stack([U @ W @ Vt, U @ W.T @ Vt], axis=-3)
    return rotations, np.asarray(U[..., :, 2])
