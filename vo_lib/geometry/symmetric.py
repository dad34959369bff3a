"""Arrays of symmetric 3×3 matrices, stored as six rows: xx, yy, zz, xy, xz, yz."""

from __future__ import annotations

import numpy as np

from .types import Array

# Row and column in the matrix of each of the six stored entries.
ROW = np.array([0, 1, 2, 0, 0, 1])
COLUMN = np.array([0, 1, 2, 1, 2, 2])
# The other way round: which of the six is at each place of the full matrix.
FULL = np.array([[0, 3, 4], [3, 1, 5], [4, 5, 2]])


def outer(v: Array) -> Array:
    """Products v vᵀ (6, …) of vectors (3, …)."""
    return np.asarray(v[ROW] * v[COLUMN])


def invert(C: Array) -> Array:
    """Inverses (6, N) of symmetric 3×3 matrices (6, N), by cofactors."""
    xx, yy, zz, xy, xz, yz = C
    cofactors = np.stack(
        [
            yy * zz - yz * yz,
            xx * zz - xz * xz,
            xx * yy - xy * xy,
            xz * yz - xy * zz,
            xy * yz - xz * yy,
            xy * xz - xx * yz,
        ]
    )
    determinant = xx * cofactors[0] + xy * cofactors[3] + xz * cofactors[4]
    return np.asarray(cofactors / determinant)


def times(S: Array, v: Array) -> Array:
    """Products (3, N) of symmetric 3×3 matrices (6, N) with vectors (3, N)."""
    return np.asarray(np.einsum("ijn,jn->in", S[FULL], v))
