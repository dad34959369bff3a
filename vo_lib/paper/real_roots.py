"""All real roots of many polynomials of degree 10 at once, for the five-point solver.

The polynomials are homogeneous in (z, w). Each polynomial is solved for z/w and for w/z in [-1, 1], so no
root is at infinity. The sign changes of Bernstein coefficients give intervals with one root each (Descartes'
rule), and Newton's method gives the roots. The last axis of the arrays is the axis of the polynomials.
"""

from __future__ import annotations

from math import comb
from typing import NamedTuple

import numpy as np

from ..geometry.types import Array, BoolArray, Index

DEGREE = 10
_ORDER = np.arange(DEGREE + 1)
PIECES = 17  # number of pieces of [-1, 1]; odd, so that 0 is no border
PARTS = 8  # number of parts of an interval that is cut
CUTS = 16  # largest number of cuts
SAMPLES = 6  # number of starting points for polishing in an interval whose roots cannot be separated
RELATIVE_ERROR = 5e-13  # rounding error of a polynomial, relative to its largest coefficient
ABSOLUTE_ERROR = 1e-19  # smallest rounding error
ZERO_POLYNOMIAL = 1e-25  # largest coefficient of a zero polynomial, whose set has a family of solutions
ROOT_STEPS = 20  # largest number of Newton steps
ROOT_DONE = 1e-7  # length of a step that ends them


def _bernstein_matrices() -> tuple[Array, Array]:
    """Matrices for the Bernstein coefficients of all pieces (from powers) and of all parts of an interval.

    Shapes (11 · PIECES, 11) and (11 · PARTS, 11); rows are in the order of the coefficient, then the part.
    """
    choose = np.array([comb(DEGREE, i) for i in _ORDER], dtype=np.float64)

    def bernstein(u: Array) -> Array:
        return np.asarray(choose * u[:, None] ** _ORDER * (1.0 - u[:, None]) ** _ORDER[::-1])

    u = 0.5 - 0.5 * np.cos(np.pi * (_ORDER + 0.5) / (DEGREE + 1))
    from_values = np.linalg.inv(bernstein(u))
    pieces = [from_values @ np.vander(2.0 * (k + u) / PIECES - 1.0, DEGREE + 1) for k in range(PIECES)]
    parts = [from_values @ bernstein((k + u) / PARTS) for k in range(PARTS)]
    return np.concatenate(np.stack(pieces, axis=1)), np.concatenate(np.stack(parts, axis=1))


TO_PIECES, TO_PARTS = _bernstein_matrices()


class Intervals(NamedTuple):
    """K intervals low … low + width; indices p (K,) and Bernstein coefficients b (11, K) of polynomials."""

    low: Array
    width: Array
    p: Index
    b: Array


def isolate_roots(polynomials: Array) -> tuple[Intervals, Intervals]:
    """Intervals in [-1, 1] that contain one real root each; the polynomials (11, P) have terms t¹⁰ … 1.

    The number of roots in an interval is at most the number of sign changes among the Bernstein coefficients
    there (Descartes): no change means no root, one change means one root. Other intervals are cut into parts.
    In the intervals of the second result, the number of roots is uncertain: either the signs change several
    times and all coefficients are below the rounding noise, or the signs never change and the smallest
    coefficient is below the noise.
    """
    size = np.max(np.abs(polynomials), axis=0)
    noise = np.maximum(RELATIVE_ERROR * size, ABSOLUTE_ERROR)
    p = np.flatnonzero(size > ZERO_POLYNOMIAL)
    b = (TO_PIECES @ polynomials.take(p, axis=1)).reshape(DEGREE + 1, -1)
    width = 2.0 / PIECES
    low = np.repeat(-1.0 + width * np.arange(PIECES), p.size)
    p = np.tile(p, PIECES)
    single_groups: list[Intervals] = []
    hidden_groups: list[Intervals] = []
    for cut in range(CUTS):
        positive = b >= 0.0
        changes = np.sum((positive[1:] != positive[:-1]).view(np.int8), axis=0, dtype=np.int8)
        single = changes == 1
        many = changes > 1
        hidden = np.zeros_like(single)
        if cut:
            magnitude = np.abs(b)
            faint = np.where(many, magnitude.max(axis=0), magnitude.min(axis=0)) < noise[p]
            hidden = (faint & ~single) | (many & (cut + 1 == CUTS))
        single_groups.append(_selected(single, low, width, p, b))
        hidden_groups.append(_selected(hidden, low, width, p, b))
        more = np.flatnonzero(many & ~hidden)
        if not more.size:
            break
        width /= PARTS
        low = (low[more] + width * np.arange(PARTS)[:, None]).ravel()
        p = np.tile(p[more], PARTS)
        b = (TO_PARTS @ b.take(more, axis=1)).reshape(DEGREE + 1, -1)
    return _joined(single_groups), _joined(hidden_groups)


def _selected(mask: BoolArray, low: Array, width: float, p: Index, b: Array) -> Intervals:
    """The intervals in a mask (K,)."""
    k = np.flatnonzero(mask)
    return Intervals(low[k], np.full(k.size, width), p[k], b.take(k, axis=1))


def _joined(groups: list[Intervals]) -> Intervals:
    """All intervals of several groups."""
    columns = zip(*groups, strict=True)
    return Intervals(*(np.concatenate(column, axis=-1) for column in columns))


@np.errstate(divide="ignore", invalid="ignore", over="ignore")
def real_roots(polynomials: Array) -> tuple[Array, Array, Index, BoolArray]:
    """All real roots (z, w), max(|z|, |w|) = 1, of polynomials (11, S).

    Returns
    -------
    z, w : (M,) roots; index : (M,) the polynomial of each root; doubtful : (S,) mask of polynomials with
    roots too near each other to be counted; these roots are replaced by evenly spaced values of the interval.
    """
    sets = polynomials.shape[1]
    both = np.concatenate([polynomials, polynomials[::-1]], axis=1)  # in z/w, and in w/z
    single, unclear = isolate_roots(both)
    root = _newton(both.take(single.p, axis=1), single)
    samples = unclear.low + unclear.width * np.linspace(0.0, 1.0, SAMPLES)[:, None]
    t = np.concatenate([root, samples.ravel()])
    p = np.concatenate([single.p, np.tile(unclear.p, SAMPLES)])
    doubtful = np.zeros(sets, dtype=bool)
    doubtful[unclear.p % sets] = True
    z = np.where(p < sets, t, 1.0)
    w = np.where(p < sets, 1.0, t)
    return z, w, p % sets, doubtful


def _newton(c: Array, interval: Intervals) -> Array:
    """The root (K,) of each polynomial c (11, K) in its interval, by Newton's method with bisection."""
    low = interval.low
    high = low + interval.width
    positive = interval.b >= 0.0
    # Start where the polygon of Bernstein coefficients crosses zero.
    k = np.sum((positive == positive[0]).view(np.int8), axis=0, dtype=np.int8) - 1
    before, after = interval.b[[k, k + 1], np.arange(k.size)]
    t = low + interval.width * (k + before / (before - after)) / DEGREE
    rising = positive[-1]
    c = c[::-1]  # from here, c[d] is the coefficient of t to the power d
    slopes = c[1:] * _ORDER[1:, None]
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
            remaining = np.flatnonzero(~(move < ROOT_DONE))
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
