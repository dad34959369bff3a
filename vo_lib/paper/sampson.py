"""The Sampson distance of many matches to many essential matrices, as two matrix products.

With homogeneous points p and c, cᵀ E p is linear in the nine products c_i p_j, and |(E p)₁,₂|² + |(Eᵀ c)₁,₂|²
is linear in monomials of degree 2 or less. The monomials of the matches are computed once per frame.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import DTypeLike, NDArray

from ..geometry.types import Array, Index

Floats = NDArray[np.floating]

MIN_DIVISOR = 1e-20  # lower bound of the divisor


class MatchTerms(NamedTuple):
    """Monomials of N matches, or the coefficients of these monomials for N essential matrices.

    Attributes
    ----------
    outer : (9, N) c_i p_j; vec(E) · outer = cᵀ E p.
    squares : (11, N) x², y², xy, x, y of p, then of c, then 1; see `denominator_forms`.
    """

    outer: Floats
    squares: Floats

    @property
    def points(self) -> tuple[Array, Array]:
        """The homogeneous points p and c, (3, N) each."""
        return np.asarray(self.outer[6:9]), np.asarray(self.outer[[2, 5, 8]])

    def take(self, index: Index) -> MatchTerms:
        """The monomials of selected matches."""
        return MatchTerms(self.outer.take(index, axis=1), self.squares.take(index, axis=1))


def match_terms(x_p: Array, x_c: Array, dtype: DTypeLike = np.float64) -> MatchTerms:
    """Monomials of matches, given as normalised points x_p and x_c (N, 2)."""
    one = np.ones(len(x_p))
    px, py = x_p.T
    cx, cy = x_c.T
    outer = [cx * px, cx * py, cx, cy * px, cy * py, cy, px, py, one]
    squares = [px * px, py * py, px * py, px, py, cx * cx, cy * cy, cx * cy, cx, cy, one]
    return MatchTerms(np.array(outer, dtype), np.array(squares, dtype))


# Entries (i, j) of a symmetric 3×3 matrix in the order of `MatchTerms.squares`, and their multiplicities.
_I = np.array([0, 1, 0, 0, 1, 2])
_J = np.array([0, 1, 1, 2, 2, 2])
_TIMES = np.array([1.0, 1.0, 2.0, 2.0, 2.0, 1.0])


def denominator_forms(E: Array) -> Array:
    """Coefficients (M, 11) of |(E p)₁,₂|² + |(Eᵀ c)₁,₂|² in `MatchTerms.squares`, for E (M, 3, 3).

    |(E p)₁,₂|² = pᵀ A p with A_ij = E_1i E_1j + E_2i E_2j, and likewise for Eᵀ c.
    """
    e = E.reshape(-1, 9)
    of_p = _TIMES * (e[:, _I] * e[:, _J] + e[:, 3 + _I] * e[:, 3 + _J])
    of_c = _TIMES * (e[:, 3 * _I] * e[:, 3 * _J] + e[:, 3 * _I + 1] * e[:, 3 * _J + 1])
    return np.concatenate([of_p[:, :5], of_c[:, :5], of_p[:, 5:] + of_c[:, 5:]], axis=1)


def candidate_terms(E: Array, dtype: DTypeLike = np.float64) -> MatchTerms:
    """Coefficients of the monomials in `match_terms`: vec(E) (9, M) and `denominator_forms` (11, M)."""
    outer = np.ascontiguousarray(E.reshape(-1, 9).T, dtype)
    squares = np.ascontiguousarray(denominator_forms(E).T, dtype)
    return MatchTerms(outer, squares)


def sampson_distance(E: Array, x_p: Array, x_c: Array) -> Array:
    """Signed Sampson distance of matches to E: first-order distance to the epipolar constraint.

    Parameters
    ----------
    E : (..., 3, 3) essential matrices.
    x_p, x_c : (N, 2) normalised points in the previous and current left image.

    Returns
    -------
    (..., N) distances in units of the points (multiply by f for pixels):
    x_cᵀ E x_p / sqrt((E x_p)₁² + (E x_p)₂² + (Eᵀ x_c)₁² + (Eᵀ x_c)₂²).
    """
    candidates = candidate_terms(E)
    matches = match_terms(x_p, x_c)
    d = candidates.outer.T @ matches.outer
    d /= np.sqrt(np.maximum(candidates.squares.T @ matches.squares, MIN_DIVISOR))
    return np.asarray(d.reshape(*E.shape[:-2], len(x_p)))


def squared_distances(candidates: MatchTerms, matches: MatchTerms) -> Floats:
    """Squared Sampson distances (M, N) of N matches to M candidates, in the precision of the terms."""
    d2 = candidates.outer.T @ matches.outer
    denominator = candidates.squares.T @ matches.squares
    np.multiply(d2, d2, out=d2)
    np.maximum(denominator, denominator.dtype.type(MIN_DIVISOR), out=denominator)
    np.divide(d2, denominator, out=d2)
    return d2
