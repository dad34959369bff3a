"""Symmetric 3×3 matrices that are stored as six numbers."""

from __future__ import annotations

import numpy as np

from vo_lib.geometry.symmetric import FULL, invert, times


def test_inverse_and_product_of_symmetric_matrices() -> None:
    A = np.random.default_rng(0).normal(size=(7, 3, 3))
    S = A @ np.swapaxes(A, 1, 2) + 0.1 * np.eye(3)
    six = np.stack([S[:, 0, 0], S[:, 1, 1], S[:, 2, 2], S[:, 0, 1], S[:, 0, 2], S[:, 1, 2]])
    np.testing.assert_allclose(np.moveaxis(invert(six)[FULL], 2, 0), np.linalg.inv(S), rtol=1e-9)
    v = np.random.default_rng(1).normal(size=(3, 7))
    np.testing.assert_allclose(times(six, v), np.einsum("nij,jn->in", S, v), rtol=1e-12)
