"""The five-point problem: every essential matrix that fits five matches, for many sets at once.

Nistér, "An efficient solution to the five-point relative pose problem", PAMI 2004; the constraints as
ten cubics follow Stewénius, Engels and Nistér, "Recent developments on direct relative orientation", 2006.

Each step is one function, to be called one by one. Sets lie along the **last** axis of every array in
between: numpy then runs each operation of the algebra over all sets in one sweep of memory.

    epipolar_rows (5, 9, S) -> null_space (4, 3, 3, S) -> cubic_constraints (10, 20, S) -> eliminate (6, 16, S)
    -> determinant (11, S) -> real_roots -> back_substitute (4, M) -> polish -> E = x E0 + y E1 + z E2 + w E3

Two things differ from the paper. Nistér sets w = 1; here (z, w) is a point of the projective line, so that
no solution lies at infinity. And he divides by the pivots of ten monomials, which may be small; here four
are eliminated by reflections and the other six stay in the determinant: the same polynomial, with
hundreds of times less noise where it matters, in forward motion and planar scenes.
"""

from __future__ import annotations

from math import comb
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .geometry import Array

Index = NDArray[np.intp]
Mask = NDArray[np.bool_]
QUIET = np.errstate(divide="ignore", invalid="ignore", over="ignore")  # degenerate sets drop out later

# Exponents of x, y, z, w in the 20 monomials of degree 3: first x³, y³, x²y, xy², which are eliminated;
# then x², y², xy, each times (z, w); x and y times (z², zw, w²); and z³, z²w, zw², w³.
_MONOMIALS = "3000 0300 2100 1200 2010 2001 0210 0201 1110 1101 1020 1011 1002 0120 0111 0102 0030 0021 0012 0003"
EXPONENTS = np.array([[int(d) for d in word] for word in _MONOMIALS.split()])
# A cubic is known from its values at 20 points. The exponents themselves, as points, form a lattice
# for which this is well conditioned (20).
POINTS = EXPONENTS / np.linalg.norm(EXPONENTS, axis=1, keepdims=True)
CUBIC_FROM_VALUES = np.linalg.inv(np.prod(POINTS[:, None, :] ** EXPONENTS, axis=2))

# The polynomial of degree 10 is known from its values in eleven directions (z, w).
DEGREE = 10
_ANGLES = np.pi * np.arange(DEGREE + 1) / (DEGREE + 1)
NODES = np.array([np.cos(_ANGLES), np.sin(_ANGLES)])
POLYNOMIAL_FROM_VALUES = np.linalg.inv(
    NODES[0, :, None] ** np.arange(DEGREE, -1, -1) * NODES[1, :, None] ** np.arange(DEGREE + 1)
)

PIECES = 17  # first cut of [-1, 1]; odd, so that the special root 0 is not at a cut
SPLIT = 8  # an interval that may hold more than one root is cut into this many
SPLITS = 16
NOISE = 2e-11, 1e-19  # rounding error of the polynomial: relative to its largest coefficient, absolute
VANISHING = 1e-25  # a polynomial no larger has no isolated roots
ROOT_STEPS, ROOT_DONE = 20, 1e-7
POLISH_STEPS, POLISH_DONE = 8, 1e-8
FAR = 1e-2  # a candidate that polishing moves farther may have left another solution unfound
SAME = 1e-7  # candidates of one set nearer than this are one solution found twice


class Candidates(NamedTuple):
    """All real solutions of S five-point sets, sorted by set.

    Attributes
    ----------
    E : (M, 3, 3) essential matrices of Frobenius norm 1; the sign is arbitrary.
    set_index : (M,) the set, 0 … S-1, that each one solves.
    """

    E: Array
    set_index: Index


def five_point(x_p: Array, x_c: Array) -> Candidates:
    """All real essential matrices through five matches, for S sets at once. Nothing is chosen here.

    Parameters
    ----------
    x_p, x_c : (S, 5, 2) normalised image points in the previous and current camera; x_cᵀ E x_p = 0.

    Returns
    -------
    Candidates, at most ten a set. A set has none when its matches are dependent (a point twice) or when a
    whole family of E fits them (no parallax at all).
    """
    basis, independent = null_space(epipolar_rows(x_p, x_c))
    v, index, doubtful = _solve(basis)
    again = np.flatnonzero(doubtful & independent)
    if again.size:
        # Solutions that share z/w are hard to tell apart; seen along other axes they are far from each other.
        v_again, index_again, _ = _solve(np.roll(basis.take(again, axis=-1), 1, axis=0))
        v = np.concatenate([v, np.roll(v_again, -1, axis=0)], axis=1)
        index = np.concatenate([index, again[index_again]])
    # Within a set, sorted by |x|: a solution found twice then sits beside itself.
    order = np.argsort(index + 0.99 * np.abs(v[0]))
    order = order[independent[index[order]]]
    v, index = v.take(order, axis=1), index[order]
    cosine = np.abs(np.einsum("am,am->m", v[:, 1:], v[:, :-1]))
    twice = (index[1:] == index[:-1]) & (1.0 - cosine < 0.5 * SAME**2)
    keep = np.flatnonzero(np.concatenate([[True], ~twice])[: len(index)])
    v, index = v.take(keep, axis=1), index[keep]
    return Candidates(np.einsum("am,aijm->mij", v, basis.take(index, axis=-1)), index)


def _solve(basis: Array) -> tuple[Array, Index, Mask]:
    """Solutions v = (x, y, z, w) of norm 1, (4, M), their sets (M,), and which sets are doubtful (S,)."""
    rows = eliminate(cubic_constraints(basis))
    z, w, index, doubtful = real_roots(determinant(rows))
    start = back_substitute(rows, z, w, index)
    v, found = polish(basis, start, index)
    near = found & (np.abs(np.einsum("am,am->m", start, v)) > 1.0 - 0.5 * FAR**2)
    doubtful[index[~near]] = True
    return v[:, found], index[found], doubtful


def epipolar_rows(x_p: Array, x_c: Array) -> Array:
    """Rows a with a · vec(E) = x_cᵀ E x_p, vec(E) row by row. (S, 5, 2) twice -> (5, 9, S)."""
    h_p, h_c = (np.ones((5, 3, len(x))) for x in (x_p, x_c))
    h_p[:, :2] = np.transpose(x_p, (1, 2, 0))
    h_c[:, :2] = np.transpose(x_c, (1, 2, 0))
    return np.asarray((h_c[:, :, None] * h_p[:, None]).reshape(5, 9, -1))


def triangulate(A: Array, columns: int) -> Array:
    """Zero the first `columns` columns of A (m, n, S) below the diagonal by Householder reflections.

    Reflections need no pivoting to be stable, so every set takes the same path.
    """
    A = A.copy()
    buffer = np.empty_like(A)
    for k in range(columns):
        v, rest = A[k:, k].copy(), A[k:, k + 1 :]
        pivot = -np.copysign(np.sqrt(np.einsum("is,is->s", v, v)), v[0])
        v[0] -= pivot
        w = np.einsum("is,ijs->js", v, rest)
        w /= np.maximum(-pivot * v[0], 1e-300)
        rest -= np.multiply(v[:, None], w, out=buffer[k:, k + 1 :])
        A[k:, k] = 0.0
        A[k, k] = pivot
    return A


def null_space(rows: Array) -> tuple[Array, Mask]:
    """Four orthonormal matrices (4, 3, 3, S) that span all E with rows · vec(E) = 0.

    Reflections Q that make Q rowsᵀ triangular turn [rowsᵀ | I] into [R | Q]; the last four rows of Q
    are orthogonal to all five rows. Also returned: (S,) whether the five rows are independent.

    The order matters. Row i of Q is near the unit vector i, so that z and w are close to entries E20 and
    E12, two components of the translation, in which solutions differ; E22 is small for all of them.
    """
    sets = rows.shape[-1]
    identity = np.broadcast_to(np.eye(9)[..., None], (9, 9, sets))
    RQ = triangulate(np.concatenate([rows.transpose(1, 0, 2), identity], axis=1), 5)
    diagonal = np.abs(RQ[range(5), range(5)])
    basis = np.ascontiguousarray(RQ[:4:-1, 5:]).reshape(4, 3, 3, sets)
    return basis, diagonal.min(axis=0) > 1e-12 * diagonal.max(axis=0)


def cubic_constraints(basis: Array) -> Array:
    """The ten cubics in (x, y, z, w), as coefficients (10, 20, S) of the monomials EXPONENTS.

    E Eᵀ E - trace(E Eᵀ) E / 2 = 0 (nine) and det E = 0, for E = x E0 + y E1 + z E2 + w E3.
    """
    sets = basis.shape[-1]
    E = (POINTS @ basis.reshape(4, -1)).reshape(20, 3, 3, sets)
    M = np.einsum("niks,njks->nijs", E, E)
    M[:, range(3), range(3)] -= 0.5 * np.einsum("niis->ns", M)[:, None]
    values = np.empty((20, 10, sets))
    np.einsum("niks,nkjs->nijs", M, E, out=values[:, :9].reshape(20, 3, 3, sets))
    values[:, 9] = _det_3x3(E.transpose(1, 2, 0, 3))
    return np.asarray((CUBIC_FROM_VALUES @ values.reshape(20, -1)).reshape(20, 10, sets).swapaxes(0, 1))


def _cofactors(A: Array) -> Array:
    """Cofactors of A (3, 3, …): A[i+1, j+1] A[i+2, j+2] - A[i+1, j+2] A[i+2, j+1], indices modulo 3."""
    A = A[[[0], [1], [2], [0], [1]], [0, 1, 2, 0, 1]]
    return np.asarray(A[1:4, 1:4] * A[2:, 2:] - A[1:4, 2:] * A[2:, 1:4])


def _det_3x3(A: Array) -> Array:
    (a, b, c), (d, e, f), (g, h, i) = A
    return np.asarray(a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g))


def _longest_column(A: Array) -> Array:
    """The longest column of A (3, 3, M), as a unit vector (3, M)."""
    norm2 = np.einsum("ijm,ijm->jm", A, A)
    second = norm2[1] > norm2[0]
    third = norm2[2] > np.maximum(norm2[0], norm2[1])
    column = np.where(third, A[:, 2], np.where(second, A[:, 1], A[:, 0]))
    return _unit(column)


def _unit(v: Array) -> Array:
    return np.asarray(v / np.sqrt(np.einsum("im,im->m", v, v)))


def eliminate(cubics: Array) -> Array:
    """Take x³, y³, x²y, xy² out of the ten cubics: six rows remain, (6, 16, S)."""
    return triangulate(cubics, 4)[4:, 4:]


def hidden_variable_matrix(rows: Array, z: Array, w: Array) -> Array:
    """C(z) with C(z) (x², y², xy, x, y, 1)ᵀ = 0: the six rows (6, 16, …) at given (z, w), (6, 6, …)."""
    zz, zw, ww = z * z, z * w, w * w
    C = np.empty((6, 6, *np.broadcast_shapes(rows.shape[2:], z.shape)))
    C[:, :3] = rows[:, 0:6:2] * z + rows[:, 1:6:2] * w
    C[:, 3:5] = rows[:, 6:12:3] * zz + rows[:, 7:12:3] * zw + rows[:, 8:12:3] * ww
    C[:, 5] = (rows[:, 12] * z + rows[:, 13] * w) * zz + (rows[:, 14] * z + rows[:, 15] * w) * ww
    return C


def determinant(rows: Array) -> Array:
    """det C(z), coefficients (11, S) of z¹⁰, z⁹w, …, w¹⁰; from its values at the NODES."""
    z, w = NODES[..., None]
    C = hidden_variable_matrix(rows[:, :, None], z, w)
    R = triangulate(C.reshape(6, 6, -1), 3)
    values = R[0, 0] * R[1, 1] * R[2, 2] * _det_3x3(R[3:, 3:])
    return np.asarray(POLYNOMIAL_FROM_VALUES @ values.reshape(DEGREE + 1, -1))


def _bernstein_matrices() -> tuple[Array, Array]:
    """Power coefficients -> Bernstein coefficients on the PIECES of [-1, 1]; those -> on SPLIT parts."""
    n = DEGREE
    u = 0.5 - 0.5 * np.cos(np.pi * (np.arange(n + 1) + 0.5) / (n + 1))

    def bernstein(u: Array) -> Array:
        binomial = np.array([comb(n, i) for i in range(n + 1)])
        return np.asarray(binomial * u[:, None] ** np.arange(n + 1) * (1 - u[:, None]) ** np.arange(n, -1, -1))

    from_values = np.linalg.inv(bernstein(u))
    pieces = [from_values @ np.vander(2 * (k + u) / PIECES - 1, n + 1) for k in range(PIECES)]
    parts = [from_values @ bernstein((k + u) / SPLIT) for k in range(SPLIT)]
    return np.concatenate(np.stack(pieces, axis=1)), np.concatenate(np.stack(parts, axis=1))


TO_PIECES, TO_PARTS = _bernstein_matrices()  # (11 · PIECES, 11), (11 · SPLIT, 11), coefficient by coefficient


class Intervals(NamedTuple):
    """K intervals in [-1, 1], `low` … `low + width`, of the polynomials `p`; all (K,)."""

    low: Array
    width: Array
    p: Index


def isolate_roots(polynomials: Array) -> tuple[Intervals, Array, Intervals]:
    """Intervals that each hold one real root in [-1, 1] of polynomials (11, P), coefficients of t¹⁰ … 1.

    The number of roots in an interval is at most the number of sign changes among the Bernstein
    coefficients there (Descartes): none means no root, one means one. Others are cut into parts. When the
    coefficients are no larger than rounding noise, cutting tells no more.

    Returns
    -------
    Intervals of one root; (11, K) their Bernstein coefficients; intervals lost in noise.
    """
    size = np.max(np.abs(polynomials), axis=0)
    noise = np.maximum(NOISE[0] * size, NOISE[1])
    p = np.flatnonzero(size > VANISHING)
    b = (TO_PIECES @ polynomials.take(p, axis=1)).reshape(DEGREE + 1, -1)
    width = 2.0 / PIECES
    low = np.repeat(-1.0 + width * np.arange(PIECES), p.size)
    p = np.tile(p, PIECES)
    single, unclear, coefficients = [], [], []
    for _ in range(SPLITS):
        changes = _sign_changes(b)
        one, many = np.flatnonzero(changes == 1), np.flatnonzero(changes > 1)
        single.append((low[one], np.full(one.size, width), p[one]))
        coefficients.append(b.take(one, axis=1))
        b, low, p = b.take(many, axis=1), low[many], p[many]
        clear = np.max(np.abs(b), axis=0) > noise[p]
        if not clear.all():
            unclear.append((low[~clear], np.full(np.count_nonzero(~clear), width), p[~clear]))
            b, low, p = b[:, clear], low[clear], p[clear]
        if not p.size:
            break
        width /= SPLIT
        b = (TO_PARTS @ b).reshape(DEGREE + 1, -1)
        low = (low + width * np.arange(SPLIT)[:, None]).ravel()
        p = np.tile(p, SPLIT)
    unclear.append((low, np.full(low.size, width), p))
    return _join(single), np.concatenate(coefficients, axis=1), _join(unclear)


def _sign_changes(b: Array) -> NDArray[np.int8]:
    positive = b >= 0.0
    return np.asarray(np.sum((positive[1:] != positive[:-1]).view(np.int8), axis=0, dtype=np.int8))


def _join(parts: list[tuple[Array, Array, Index]]) -> Intervals:
    low, width, p = zip(*parts, strict=True)
    return Intervals(np.concatenate(low), np.concatenate(width), np.concatenate(p))


def _crossing(b: Array) -> Array:
    """Where in [0, 1] the polygon of Bernstein coefficients b (11, K), with one sign change, crosses zero."""
    positive = b >= 0.0
    k = np.sum((positive == positive[0]).view(np.int8), axis=0, dtype=np.int8) - 1
    column = np.arange(b.shape[1])
    before, after = b[k, column], b[k + 1, column]
    return np.asarray((k + before / (before - after)) / DEGREE)


@QUIET
def real_roots(polynomials: Array) -> tuple[Array, Array, Index, Mask]:
    """All real roots (z, w), max(|z|, |w|) = 1, of polynomials (11, S).

    Returns
    -------
    z, w : (M,) roots; index : (M,) the polynomial of each; doubtful : (S,) polynomials with roots so near
    each other that their number is uncertain. Both ends of such an interval are returned as roots.
    """
    sets = polynomials.shape[1]
    both = np.concatenate([polynomials, polynomials[::-1]], axis=1)  # in z/w, and in w/z
    single, b, unclear = isolate_roots(both)
    root = _newton(both.take(single.p, axis=1), single, _crossing(b), b[-1] >= 0.0)
    t = np.concatenate([root, unclear.low, unclear.low + unclear.width])
    p = np.concatenate([single.p, unclear.p, unclear.p])
    index, in_z = p % sets, p < sets
    doubtful = np.zeros(sets, dtype=bool)
    doubtful[unclear.p % sets] = True
    return np.where(in_z, t, 1.0), np.where(in_z, 1.0, t), index, doubtful


def _newton(c: Array, interval: Intervals, guess: Array, rising: Mask) -> Array:
    """The root of c (11, K) in each interval, by Newton steps that fall back on halving."""
    low, high = interval.low, interval.low + interval.width
    t = low + interval.width * guess
    c = c[::-1]  # now of 1, t, …, t¹⁰
    slopes = c[1:] * np.arange(1.0, DEGREE + 1)[:, None]
    root, todo = t.copy(), np.arange(t.size)
    powers = np.ones((DEGREE + 1, t.size))
    for step in range(ROOT_STEPS):
        np.multiply.accumulate(np.broadcast_to(t, (DEGREE, t.size)), axis=0, out=powers[1:])
        value = np.einsum("km,km->m", c, powers)
        above = (value >= 0.0) == rising
        high, low = np.where(above, t, high), np.where(above, low, t)
        new = t - value / np.einsum("km,km->m", slopes, powers[:-1])
        new = np.where((new >= low) & (new <= high), new, 0.5 * (low + high))
        move, t = np.abs(new - t), new
        if step >= 2:
            root[todo] = t
            left = np.flatnonzero(~(move < ROOT_DONE))
            if not left.size:
                break
            todo, c, slopes, powers = todo[left], c.take(left, axis=1), slopes.take(left, axis=1), powers.take(left, axis=1)
            low, high, t, rising = low[left], high[left], t[left], rising[left]
    return root


@QUIET
def back_substitute(rows: Array, z: Array, w: Array, index: Index) -> Array:
    """(x, y, z, w) of norm 1, (4, M), from the roots: (x², y², xy, x, y, 1) spans the null space of C(z)."""
    R = triangulate(hidden_variable_matrix(rows.take(index, axis=-1), z, w), 3)
    x, y, one = _longest_column(_cofactors(R[3:, 3:].swapaxes(0, 1)))
    return _unit(np.stack([x, y, z * one, w * one]))


@QUIET
def polish(basis: Array, v: Array, index: Index) -> tuple[Array, Mask]:
    """Newton steps on the constraints themselves, from v (4, M); also (M,) whether they converged.

    The polynomial has lost digits that the constraints still have. Most candidates need one step.
    """
    v = v.copy()
    found = np.zeros(v.shape[1], dtype=bool)
    todo = np.arange(v.shape[1])
    N, old = basis.take(index, axis=-1), v
    for _ in range(POLISH_STEPS):
        new = newton_step(N, old)
        # 1 - cos² of the angle moved, without cancellation
        move2 = np.sum((new - np.einsum("am,am->m", new, old) * old) ** 2, axis=0)
        v[:, todo] = new
        found[todo] = move2 < 1e-12
        left = np.flatnonzero(~(move2 < POLISH_DONE**2))
        if not left.size:
            break
        todo, N, old = todo[left], N.take(left, axis=-1), new.take(left, axis=-1)
    return v, found


_PERMUTATIONS = np.zeros((4, 4, 4, 4))
for _i in range(4):
    for _j in range(4):
        for _k in range(4):
            _l = 6 - _i - _j - _k
            if len({_i, _j, _k, _l}) == 4:
                _PERMUTATIONS[_i, _l, _j, _k] = np.linalg.det(np.eye(4)[[_i, _j, _k, _l]])


def newton_step(N: Array, v: Array) -> Array:
    """One Newton step on the essential constraints. N (4, 3, 3, M), v (4, M) -> (4, M), norm 1.

    At an essential matrix only three of the ten constraints are independent: the third singular value is
    zero, the other two are equal (two equations). With t the left null vector of E, a and b orthonormal to
    it, p = Eᵀa, q = Eᵀb:

        (p·p - q·q) / 2 = 0,   p·q = 0,   (Eᵀt)·(p×q) = det E = 0.
    """
    E = np.einsum("am,aijm->ijm", v, N)
    t = _longest_column(_cofactors(E))
    h = t.copy()  # the reflection that takes t to the third axis has rows a, b, ±t
    h[2] += np.copysign(1.0, t[2])
    frame = np.eye(3)[..., None] - h[:, None] * (h / (1.0 + np.abs(t[2])))
    P = np.einsum("kim,aijm->kajm", frame, N)
    p = np.einsum("am,kajm->kjm", v, P[:2])
    G = np.einsum("kjm,lajm->klam", p, P[:2])
    p = p[:, [0, 1, 2, 0, 1]]
    cross = p[0, 1:4] * p[1, 2:] - p[0, 2:] * p[1, 1:4]
    J = np.stack([G[0, 0] - G[1, 1], G[0, 1] + G[1, 0]])
    # The constraints are homogeneous: J v = (2 r0, 2 r1, r2). So the step r + J (v' - v) = 0 with v·v' = 1
    # reads (J - (r0, r1, 0) vᵀ) v' = 0: v' is a null vector, found without division.
    J -= 0.5 * np.einsum("kam,am->km", J, v)[:, None] * v
    last = np.einsum("jm,ajm->am", cross, P[2])
    minors = _PERMUTATIONS.reshape(16, 16) @ (J[0][:, None] * J[1]).reshape(16, -1)
    return _unit(np.einsum("ilm,lm->im", minors.reshape(4, 4, -1), last))
