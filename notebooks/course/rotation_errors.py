"""Errors of estimated rotations, and the rotation with which they are compared."""

from __future__ import annotations

import numpy as np

from vo_lib.data.sequence import Sequence
from vo_lib.geometry.motion import decompose_essential, rotation_angle
from vo_lib.geometry.types import Array, Index
from vo_lib.paper.five_point import five_point
from vo_lib.paper.selection import truncated_errors

from .candidates import consensus_rotation, first_of_each_set
from .frames import Points, key_of
from .memory import Memory

_rotations: Memory[Array] = Memory(16)


def reference_rotation(sequence: Sequence, frame: int, points: Points) -> Array:
    """The true rotation or, without truth, the best rotation from all matches."""
    if points.T_cp is not None:
        return np.asarray(points.T_cp[:3, :3])

    def estimate() -> Array:
        return consensus_rotation(points, np.random.default_rng(0), sequence.camera.f)

    return _rotations.get((*key_of(sequence, frame), *points.key), estimate)


def angle_between(R: Array, R_other: Array | None) -> float:
    """Angle between two rotations (3, 3), degrees; NaN if the second rotation is None."""
    return np.nan if R_other is None else float(np.degrees(rotation_angle(R.T @ R_other)))


def rotation_errors(E: Array, R_true: Array) -> Array:
    """Angle between the rotation of each E (M, 3, 3) and the true rotation, (M,) degrees.

    E has two rotations; the result is the error of the nearer rotation. The other rotation differs by 180°
    about t, and the depths of the points exclude this rotation.

    R_true : (3, 3), or (M, 1, 3, 3) with one for each E.
    """
    R, _ = decompose_essential(E)
    angles = rotation_angle(np.swapaxes(R, -1, -2) @ R_true)
    return np.asarray(np.degrees(angles.min(axis=-1)))


def set_errors(points: Points, R_true: Array, chosen: Index, threshold: float) -> tuple[Array, float]:
    """Rotation errors, degrees: of the best candidate of each set, and of the winner of all sets.

    The best candidate has the smallest image error over all matches. Returns (K,) for the K sets that have a
    solution, and a float.

    R_true : (3, 3), the rotation of comparison, which may be that of `reference_rotation`.
    chosen : (S, 5) matches of each set. threshold : at which image errors are truncated, normalised units.
    """
    solutions = five_point(points.x_p[chosen], points.x_c[chosen])
    image_errors = truncated_errors(solutions.E, points.x_p, points.x_c, threshold)
    best = np.flatnonzero(first_of_each_set(image_errors, solutions.set_index))
    errors = rotation_errors(solutions.E[best], R_true)
    return errors, float(errors[np.argmin(image_errors[best])])
