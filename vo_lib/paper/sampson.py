"""The Sampson distance of many matches to many essential matrices, as two matrix products.

A match has the homogeneous points p = (x_p, 1) and c = (x_c, 1), and its Sampson distance to E is

    d = cᵀ E p / √D,   D = (E p)₁² + (E p)₂² + (Eᵀ c)₁² + (Eᵀ c)₂².

The numerator is linear in the nine products c_i p_j, and D is linear in the squares and products of the
coordinates of p and of those of c. These monomials belong to the matches alone, so they are computed once per
frame, and their coefficients once per E. All distances are then two products of matrices.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import DTypeLike, NDArray

from ..geometry.types import Array, Index

Floats = NDArray[np.floating]

MIN_DENOMINATOR = 1e-20  # lower bound of D


class CandidateTerms(NamedTuple):
    """Coefficients of the monomials in `MatchTerms` for M essential matrices.

    Attributes
    ----------
    outer : (9, M) vec(E), row by row: outer · `MatchTerms.outer` = cᵀ E p.
    squares : (11, M) `denominator_forms`: squares · `MatchTerms.squares` = D.
    """

    outer: Floats
    squares: Floats


class MatchTerms(NamedTuple):
    """Monomials of N matches.

    Attributes
    ----------
    outer : (9, N) c_i p_j, with i and j in the order of vec(E).
    squares : (11, N) x², y², xy, x, y of p, then of c, then 1.
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
    xp, yp = x_p.T
    xc, yc = x_c.T
    outer = [xc * xp, xc * yp, xc, yc * xp, yc * yp, yc, xp, yp, one]
    squares = [xp * xp, yp * yp, xp * yp, xp, yp, xc * xc, yc * yc, xc * yc, xc, yc, one]
    return MatchTerms(np.array(outer, dtype), np.array(squares, dtype))


# The six different entries (i, j) of a symmetric 3×3 matrix A, in the order in which the form pᵀ A p has its
# terms x², y², xy, x, y, 1; an entry beside the diagonal counts twice.
_I = np.array([0, 1, 0, 0, 1, 2])
_J = np.array([0, 1, 1, 2, 2, 2])
_TIMES = np.array([1.0, 1.0, 2.0, 2.0, 2.0, 1.0])


def denominator_forms(E: Array) -> Array:
    """Coefficients (M, 11) of D in the monomials `MatchTerms.squares`, for E (M, 3, 3).

    (E p)₁² + (E p)₂² = pᵀ A p with A_ij = E_1i E_1j + E_2i E_2j, from the first two rows of E. Its first two
    columns give the other half in the same way, with c in place of p.
    """
    row_1 = E[..., 0, :].reshape(-1, 3)
    row_2 = E[..., 1, :].reshape(-1, 3)
    column_1 = E[..., :, 0].reshape(-1, 3)
    column_2 = E[..., :, 1].reshape(-1, 3)
    of_p = _TIMES * (row_1[:, _I] * row_1[:, _J] + row_2[:, _I] * row_2[:, _J])
    of_c = _TIMES * (column_1[:, _I] * column_1[:, _J] + column_2[:, _I] * column_2[:, _J])
    constant = of_p[:, 5:] + of_c[:, 5:]
    return np.concatenate([of_p[:, :5], of_c[:, :5], constant], axis=1)


def candidate_terms(E: Array, dtype: DTypeLike = np.float64) -> CandidateTerms:
    """Coefficients of the monomials in `match_terms`, for candidates E (M, 3, 3)."""
    outer = np.ascontiguousarray(E.reshape(-1, 9).T, dtype)
    squares = np.ascontiguousarray(denominator_forms(E).T, dtype)
    return CandidateTerms(outer, squares)


def sampson_distance(E: Array, x_p: Array, x_c: Array) -> Array:
    """Signed Sampson distance d of matches to E: to first order, how far a match must move to fit E exactly.

    Parameters
    ----------
    E : (..., 3, 3) essential matrices.
    x_p, x_c : (N, 2) normalised points in the previous and current left image.

    Returns
    -------
    (..., N) distances in the unit of the points (multiply by f for pixels).
    """
    candidates = candidate_terms(E)
    matches = match_terms(x_p, x_c)
    d = candidates.outer.T @ matches.outer
    denominator = candidates.squares.T @ matches.squares
    d /= np.sqrt(np.maximum(denominator, MIN_DENOMINATOR))
    return np.asarray(d.reshape(*E.shape[:-2], len(x_p)))


def squared_distances(candidates: CandidateTerms, matches: MatchTerms) -> Floats:
    """Squared Sampson distances (M, N) of N matches to M candidates, in the precision of the terms."""
    d2 = candidates.outer.T @ matches.outer
    denominator = candidates.squares.T @ matches.squares
    np.multiply(d2, d2, out=d2)
    np.maximum(denominator, denominator.dtype.type(MIN_DENOMINATOR), out=denominator)
    np.divide(d2, denominator, out=d2)
    return d2
