"""Arrays of symmetric 3×3 matrices, stored as six rows: xx, yy, zz, xy, xz, yz."""

from __future__ import annotations

import numpy as np

from .types import Array

ROW, COLUMN = np.array([0, 1, 2, 0, 0, 1]), np.array([0, 1, 2, 1, 2, 2])
FULL = np.array([[0, 3, 4], [3, 1, 5], [4, 5, 2]])  # row of each entry of a matrix


def outer(v: Array) -> Array:
    """Products v vᵀ (6, …) of vectors (3, …)."""
    return np.asarray(v[ROW] * v[COLUMN])


def invert(C: Array) -> Array:
    """Inverses (6, N) of symmetric 3×3 matrices (6, N), by cofactors."""
    xx, yy, zz, xy, xz, yz = C
    diagonal = yy * zz - yz * yz, xx * zz - xz * xz, xx * yy - xy * xy
    cofactors = np.stack([*diagonal, xz * yz - xy * zz, xy * yz - xz * yy, xy * xz - xx * yz])
    return np.asarray(cofactors / (xx * cofactors[0] + xy * cofactors[3] + xz * cofactors[4]))


def times(S: Array, v: Array) -> Array:
    """Products (3, N) of symmetric 3×3 matrices (6, N) with vectors (3, N)."""
    return np.asarray(np.einsum("ijn,jn->in", S[FULL], v))
