"""The right answers to the exercises of chapter 2, for one set of matches, one matrix or one motion.

They are functions of `vo_lib` in the form of the exercises, and, written here, what `vo_lib` does not have in that
form.
"""

from __future__ import annotations

import numpy as np

from vo_lib.geometry.motion import decompose_essential
from vo_lib.geometry.types import Array
from vo_lib.paper.five_point import epipolar_rows, five_point, hidden_variable_matrix


def homogeneous(x: Array) -> Array:
    """Normalised points (N, 2) with a third coordinate 1, (N, 3)."""
    return np.column_stack([x, np.ones(len(x))])


def distances(E: Array, x_p: Array, x_c: Array) -> Array:
    """Distances (N,) of current points x_c (N, 2) from the epipolar lines E x_p, normalised units."""
    lines = homogeneous(x_p) @ E.T
    products = np.sum(lines * homogeneous(x_c), axis=1)
    return np.asarray(np.abs(products) / np.hypot(lines[:, 0], lines[:, 1]))


def four_motions(E: Array) -> Array:
    """The four motions [R | t] of E (3, 3), (4, 3, 4), with |t| = 1."""
    rotations, t = decompose_essential(E)
    return all_motions(list(rotations), t)


def all_motions(rotations: list[Array], t: Array) -> Array:
    """The motions [R | t] (2 K, 3, 4) of K rotations (3, 3), each with t (3,) and with -t."""
    motions = []
    for R in rotations:
        motions.append(np.column_stack([R, t]))
        motions.append(np.column_stack([R, -t]))
    return np.array(motions)


def sorted_motions(motions: Array) -> Array:
    """Motions (M, 3, 4) in an order of their own, for comparison."""
    flat = motions.reshape(len(motions), -1)
    return np.asarray(motions[np.lexsort(np.round(flat, 4).T)])


def two_depths(motion: Array, x_p: Array, x_c: Array) -> tuple[Array, Array]:
    """Depths (N,) of matches (N, 2) in the previous and in the current camera, for a motion [R | t] (3, 4).

    d_c x_c = d_p R x_p + t, solved by least squares: a cross product with one ray leaves the depth along the
    other ray. Depths of parallel rays are infinite or NaN.
    """
    t = motion[:, 3]
    q = homogeneous(x_p) @ motion[:, :3].T  # rays of the previous camera, R x_p
    c = homogeneous(x_c)  # rays of the current camera
    normal = np.cross(c, q)
    with np.errstate(divide="ignore", invalid="ignore"):
        squared = np.sum(normal**2, axis=1)
        d_p = -np.sum(normal * np.cross(c, t), axis=1) / squared
        d_c = -np.sum(normal * np.cross(q, t), axis=1) / squared
    return np.asarray(d_p), np.asarray(d_c)


def count_in_front(motion: Array, x_p: Array, x_c: Array) -> int:
    """How many points are in front of both cameras."""
    d_p, d_c = two_depths(motion, x_p, x_c)
    return int(np.count_nonzero((d_p > 0) & (d_c > 0)))


def choose_motion(motions: Array, x_p: Array, x_c: Array) -> Array:
    """The motion (3, 4) with the most points in front of both cameras, of several motions (M, 3, 4)."""
    counts = [count_in_front(motion, x_p, x_c) for motion in motions]
    return np.asarray(motions[int(np.argmax(counts))])


def rows(x_p: Array, x_c: Array) -> Array:
    """The five rows (5, 9) of the epipolar constraint of five matches (5, 2)."""
    of_sets = epipolar_rows(x_p[None], x_c[None])  # of S sets, the last axis is S
    return np.asarray(of_sets[:, :, 0])


def null_space(A: Array) -> Array:
    """An orthonormal basis (4, 9) of the null space of A (5, 9)."""
    _, _, Vt = np.linalg.svd(A)
    return np.asarray(Vt[5:])


def constraints(E: Array) -> Array:
    """The ten constraints (10,) of a matrix (3, 3): nine of E Eᵀ E - ½ trace(E Eᵀ) E, and det E."""
    M = E @ E.T @ E - 0.5 * np.trace(E @ E.T) * E
    return np.append(M.ravel(), np.linalg.det(E))


def hidden_matrix(six: Array, z: float) -> Array:
    """C(z) (6, 6) of the six rows (6, 16), with w = 1; columns x², y², xy, x, y, 1."""
    one = np.ones(1)
    return np.asarray(hidden_variable_matrix(six[:, :, None], z * one, one)[..., 0])


def solve_five(x_p: Array, x_c: Array) -> Array:
    """All essential matrices (M, 3, 3) that fit five matches (5, 2)."""
    return five_point(x_p[None], x_c[None]).E
