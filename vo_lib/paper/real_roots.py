"""All real roots of many polynomials of degree 10 at once, for the five-point solver.

The polynomials are homogeneous in (z, w). Each polynomial is solved for z/w and for w/z in [-1, 1], so no
root is at infinity. [-1, 1] is cut into pieces, and these again, until each has no root or one root, as the
sign changes of the polynomial's Bernstein coefficients there tell (Descartes' rule); then Newton's method
gives the root. If a piece is mapped to [0, 1], the polynomial is a sum of Bernstein polynomials, and its
Bernstein coefficients are their factors (`_bernstein`). The last axis of the arrays is the axis of the
polynomials or of their intervals.
"""

from __future__ import annotations

from math import comb
from typing import NamedTuple

import numpy as np

from ..geometry.types import Array, BoolArray, Index

DEGREE = 10
_POWERS = np.arange(DEGREE + 1)
# Number of pieces of [-1, 1]. It is odd, so that 0 is no border between pieces: a double root on a border can
# be missed, and the sets of a camera that moves exactly to the side, without a rotation, have roots at 0.
PIECES = 17
PARTS = 8  # number of parts of a piece, or of a part, that is cut again
CUTS = 16  # largest number of cuts, including the one into pieces
SAMPLES = 6  # number of starting points for polishing in an interval whose roots cannot be separated
RELATIVE_ERROR = 5e-13  # rounding error of a polynomial, relative to its largest coefficient
ABSOLUTE_ERROR = 1e-19  # smallest rounding error
ZERO_POLYNOMIAL = 1e-25  # largest coefficient of a zero polynomial, whose set has a family of solutions
ROOT_STEPS = 20  # largest number of Newton steps
ROOT_DONE = 1e-7  # length of a step that ends them


def _bernstein(u: Array) -> Array:
    """Values (M, 11) at places u (M,) of the Bernstein polynomials C(10, i) uⁱ (1 - u)¹⁰⁻ⁱ of [0, 1]."""
    choose = np.array([comb(DEGREE, i) for i in _POWERS], dtype=np.float64)
    return np.asarray(choose * u[:, None] ** _POWERS * (1.0 - u[:, None]) ** _POWERS[::-1])


def _bernstein_matrices() -> tuple[Array, Array]:
    """Matrices from coefficients to Bernstein coefficients, built with values at eleven places.

    Returns
    -------
    (11 · PIECES, 11): from the coefficients of t¹⁰ … 1, the Bernstein coefficients on all pieces of [-1, 1].
    (11 · PARTS, 11): from the Bernstein coefficients on an interval, those on all of its parts.
    The rows have the first coefficient of each piece or part, then the second one of each, and so on.
    """
    u = 0.5 - 0.5 * np.cos(np.pi * (_POWERS + 0.5) / (DEGREE + 1))  # Chebyshev's nodes, in [0, 1]
    from_values = np.linalg.inv(_bernstein(u))
    pieces = [from_values @ np.vander(2.0 * (k + u) / PIECES - 1.0, DEGREE + 1) for k in range(PIECES)]
    parts = [from_values @ _bernstein((k + u) / PARTS) for k in range(PARTS)]
    to_pieces = np.stack(pieces, axis=1).reshape(-1, DEGREE + 1)
    to_parts = np.stack(parts, axis=1).reshape(-1, DEGREE + 1)
    return to_pieces, to_parts


TO_PIECES, TO_PARTS = _bernstein_matrices()


class Intervals(NamedTuple):
    """K intervals of polynomials.

    Attributes
    ----------
    low, width : (K,) each interval is low … low + width.
    p : (K,) index of the interval's polynomial.
    b : (11, K) Bernstein coefficients of the polynomial on the interval.
    """

    low: Array
    width: Array
    p: Index
    b: Array


def isolate_roots(polynomials: Array) -> tuple[Intervals, Intervals]:
    """The intervals in [-1, 1] with one real root each, and those with an unclear number of roots.

    The number of roots in an interval is at most the number of sign changes among the Bernstein coefficients
    there (Descartes): no change means no root, one change means one root. Other intervals are cut into parts.

    The number stays unclear where rounding decides: if the signs change several times though all coefficients
    are below the rounding noise, or if they never change though the smallest coefficient is below it. It also
    stays unclear where the signs still change several times after the last cut.

    polynomials : (11, P) coefficients of t¹⁰ … 1.
    """
    size = np.max(np.abs(polynomials), axis=0)
    noise = np.maximum(RELATIVE_ERROR * size, ABSOLUTE_ERROR)
    p = np.flatnonzero(size > ZERO_POLYNOMIAL)
    b = (TO_PIECES @ polynomials.take(p, axis=1)).reshape(DEGREE + 1, -1)
    width = 2.0 / PIECES
    low = np.repeat(-1.0 + width * np.arange(PIECES), p.size)
    p = np.tile(p, PIECES)
    single_groups: list[Intervals] = []
    unclear_groups: list[Intervals] = []
    for cut in range(CUTS):
        positive = b >= 0.0
        changes = np.sum((positive[1:] != positive[:-1]).view(np.int8), axis=0, dtype=np.int8)
        single = changes == 1
        several = changes > 1
        unclear = np.zeros_like(single)
        if cut > 0:  # not for whole pieces: inside them, even a double root shows clearly by two changes
            magnitude = np.abs(b)
            faint = np.where(several, magnitude.max(axis=0), magnitude.min(axis=0)) < noise[p]
            unclear = faint & ~single
        if cut + 1 == CUTS:
            unclear |= several
        single_groups.append(_selected(single, low, width, p, b))
        unclear_groups.append(_selected(unclear, low, width, p, b))
        to_cut = np.flatnonzero(several & ~unclear)
        if not to_cut.size:
            break
        width /= PARTS
        low = (low[to_cut] + width * np.arange(PARTS)[:, None]).ravel()
        p = np.tile(p[to_cut], PARTS)
        b = (TO_PARTS @ b.take(to_cut, axis=1)).reshape(DEGREE + 1, -1)
    return _joined(single_groups), _joined(unclear_groups)


def _selected(mask: BoolArray, low: Array, width: float, p: Index, b: Array) -> Intervals:
    """The intervals that a mask (K,) selects among K intervals of one width."""
    k = np.flatnonzero(mask)
    return Intervals(low[k], np.full(k.size, width), p[k], b.take(k, axis=1))


def _joined(groups: list[Intervals]) -> Intervals:
    """All intervals of several groups."""
    return Intervals(
        low=np.concatenate([group.low for group in groups]),
        width=np.concatenate([group.width for group in groups]),
        p=np.concatenate([group.p for group in groups]),
        b=np.concatenate([group.b for group in groups], axis=1),
    )


@np.errstate(divide="ignore", invalid="ignore", over="ignore")
def real_roots(polynomials: Array) -> tuple[Array, Array, Index, BoolArray]:
    """All real roots (z, w), max(|z|, |w|) = 1, of polynomials (11, S).

    Returns
    -------
    z, w : (M,) roots; index : (M,) the polynomial of each root; doubtful : (S,) mask of polynomials with
    roots too near each other to be counted; these roots are replaced by evenly spaced values of the interval.
    """
    sets = polynomials.shape[1]
    # First all polynomials in t = z/w, with w = 1, then all of them in t = w/z, with z = 1.
    both = np.concatenate([polynomials, polynomials[::-1]], axis=1)
    single, unclear = isolate_roots(both)
    root = _newton(both.take(single.p, axis=1), single)
    samples = unclear.low + unclear.width * np.linspace(0.0, 1.0, SAMPLES)[:, None]
    t = np.concatenate([root, samples.ravel()])
    p = np.concatenate([single.p, np.tile(unclear.p, SAMPLES)])
    z = np.where(p < sets, t, 1.0)
    w = np.where(p < sets, 1.0, t)
    doubtful = np.zeros(sets, dtype=bool)
    doubtful[unclear.p % sets] = True
    return z, w, p % sets, doubtful


def _newton(c: Array, interval: Intervals) -> Array:
    """The root (K,) of each polynomial c (11, K) in its interval, by Newton's method with bisection.

    A step that would leave the interval goes to its middle, and each step makes the interval smaller.
    """
    low = interval.low
    high = low + interval.width
    positive = interval.b >= 0.0
    # Start where the polygon of Bernstein coefficients crosses zero.
    last_of_first_sign = np.sum((positive == positive[0]).view(np.int8), axis=0, dtype=np.int8) - 1
    before, after = interval.b[[last_of_first_sign, last_of_first_sign + 1], np.arange(low.size)]
    t = low + interval.width * (last_of_first_sign + before / (before - after)) / DEGREE
    rising = positive[-1]
    c = c[::-1]  # from here, c[d] is the coefficient of t to the power d
    slopes = c[1:] * _POWERS[1:, None]
    powers = np.ones_like(c)
    root: Array = t.copy()
    todo = np.arange(t.size)
    for step in range(ROOT_STEPS):
        for d in range(DEGREE):
            np.multiply(powers[d], t, out=powers[d + 1])
        value = np.einsum("km,km->m", c, powers)
        above = (value >= 0.0) == rising
        high = np.where(above, t, high)
        low = np.where(above, low, t)
        new = t - value / np.einsum("km,km->m", slopes, powers[:-1])
        new = np.where((new >= low) & (new <= high), new, 0.5 * (low + high))
        move = np.abs(new - t)
        t = new
        if step >= 2:  # from here, few roots are unfinished, and only these are continued
            root[todo] = t
            remaining = np.flatnonzero(~(move < ROOT_DONE))  # with those whose step is NaN
            if not remaining.size:
                break
            todo = todo[remaining]
            low = low[remaining]
            high = high[remaining]
            t = t[remaining]
            rising = rising[remaining]
            c = c.take(remaining, axis=1)
            slopes = slopes.take(remaining, axis=1)
            powers = powers.take(remaining, axis=1)
    return root
