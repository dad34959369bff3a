"""Five-point solver: all essential matrices that fit five matches, for many sets at once.

Source: Nistér, "An efficient solution to the five-point relative pose problem", PAMI 2004. The constraints
are from Stewénius, Engels and Nistér, "Recent developments on direct relative orientation", 2006.

Each step is a function. The last axis of the intermediate arrays is the axis of the sets, so that NumPy does
each operation for all sets in one pass over memory.

    epipolar_rows (5, 9, S) -> null_space (4, 3, 3, S) -> cubic_constraints (10, 20, S)
    -> eliminate (6, 16, S) -> determinant (11, S) -> real_roots -> back_substitute (4, M) -> polish
    -> E = x E0 + y E1 + z E2 + w E3

Two steps differ from Nistér's paper. Nistér sets w = 1; here (z, w) is a point of the projective line, so no
solution is at infinity. Nistér eliminates ten monomials and divides by their pivots, which may be small; here
reflections eliminate four monomials, and the determinant contains the other six. In the worst 5 % of the
sets, the polynomial then has a hundred to a thousand times less rounding error than his.
"""

from __future__ import annotations

from itertools import permutations
from typing import NamedTuple

import numpy as np

from ..geometry.types import Array, BoolArray, Index
from .real_roots import DEGREE, real_roots

# Degenerate sets cause these floating-point errors; their candidates are removed at the end.
DEGENERATE_SETS = np.errstate(divide="ignore", invalid="ignore", over="ignore")

# Exponents of x, y, z, w in the 20 monomials of degree 3: first x³, y³, x²y, xy², which are eliminated;
# then x², y², xy, each times (z, w); x and y, each times (z², zw, w²); and z³, z²w, zw², w³.
_WORDS = "3000 0300 2100 1200 2010 2001 0210 0201 1110 1101 1020 1011 1002 0120 0111 0102 0030 0021 0012 0003"
EXPONENTS = np.array([[int(digit) for digit in word] for word in _WORDS.split()])
# A cubic is computed from its values at 20 points; with the exponents as points, errors are not amplified.
POINTS = EXPONENTS / np.linalg.norm(EXPONENTS, axis=1, keepdims=True)
CUBIC_FROM_VALUES = np.linalg.inv(np.prod(POINTS[:, None, :] ** EXPONENTS, axis=2))

# The polynomial of degree 10 is computed from its values in eleven directions (z, w).
_ANGLES = np.pi * np.arange(DEGREE + 1) / (DEGREE + 1)
NODES = np.array([np.cos(_ANGLES), np.sin(_ANGLES)])
_ORDER = np.arange(DEGREE + 1)
POLYNOMIAL_FROM_VALUES = np.linalg.inv(NODES[0][:, None] ** _ORDER[::-1] * NODES[1][:, None] ** _ORDER)

SOLVING_TURNS = 2  # largest number of attempts to solve a set, each with a different order of the axes
POLISH_STEPS = 8  # largest number of steps of the polishing
POLISH_DONE = 1e-8  # length of a step that ends the polishing
CONVERGED = 1e-6  # largest last step of a solution that is kept
MAX_POLISH_MOVE = 1e-3  # if a candidate moves farther, its set is doubtful: a solution may be missing
SAME_CANDIDATE_DISTANCE = 1e-7  # nearer candidates of a set are duplicates of one solution


class Candidates(NamedTuple):
    """All real solutions of S five-point sets, sorted by set.

    Attributes
    ----------
    E : (M, 3, 3) essential matrices of Frobenius norm 1; the sign is arbitrary.
    set_index : (M,) index, 0 … S-1, of the set that each matrix fits.
    """

    E: Array
    set_index: Index


def five_point(x_p: Array, x_c: Array) -> Candidates:
    """All real essential matrices that fit five matches, for S sets at once, without a selection.

    Parameters
    ----------
    x_p, x_c : (S, 5, 2) normalised image points in the previous and current camera; x_cᵀ E x_p = 0.

    Returns
    -------
    Candidates, at most ten per set. A set has no candidates if its matches are dependent (a repeated match)
    or if a whole family of E fits the matches (no parallax and no noise). The memory use is about 10 kB per
    set.

    Raises
    ------
    ValueError : the arrays have other shapes or no real numbers, or a coordinate is not finite.
    """
    x_p, x_c = _checked_points(x_p, x_c)
    basis, independent = null_space(epipolar_rows(x_p, x_c))
    solutions = [np.empty((4, 0))]
    indices = [np.empty(0, dtype=np.intp)]
    todo = np.flatnonzero(independent)
    for turn in range(SOLVING_TURNS):
        # Solutions with nearly equal z/w are hard to separate; with other axes as z and w, the ratios differ.
        axes = (np.arange(4) + turn) % 4
        v, index, doubtful = _solve(basis[axes].take(todo, axis=-1))
        solutions.append(v[np.argsort(axes)])
        indices.append(todo[index])
        todo = todo[doubtful]
        if not todo.size:
            break
    v = np.concatenate(solutions, axis=1)
    index = np.concatenate(indices)
    # Sorted by |x| within each set, so that duplicates of a solution are neighbours.
    order = np.argsort(index + 0.99 * np.abs(v[0]))
    v = v.take(order, axis=1)
    index = index[order]
    distinct = np.ones(index.size, dtype=bool)
    cosine = np.abs(np.einsum("am,am->m", v[:, 1:], v[:, :-1]))
    distinct[1:] = (index[1:] != index[:-1]) | (1.0 - cosine > 0.5 * SAME_CANDIDATE_DISTANCE**2)
    # Ten polynomials of degree three have at most ten common roots, or a whole family of them. So a set with
    # more than ten solutions has samples of a family.
    count = np.bincount(index[distinct], minlength=len(x_p))
    kept = distinct & (count <= DEGREE)[index]
    v = v[:, kept]
    index = index[kept]
    E = np.einsum("am,aijm->mij", v, basis.take(index, axis=-1))
    return Candidates(E, index)


def _checked_points(x_p: Array, x_c: Array) -> tuple[Array, Array]:
    """The points as arrays of double precision; `ValueError` unless there are finite sets of five matches."""
    checked = []
    for name, points in (("x_p", x_p), ("x_c", x_c)):
        given = np.asarray(points)
        if given.dtype.kind not in "fiu":  # NumPy would read words as numbers, and drop imaginary parts
            raise ValueError(
                f"{name} of shape {given.shape} has the type {given.dtype}, expected real numbers"
            )
        array = given.astype(np.float64)
        if array.ndim != 3 or array.shape[1:] != (5, 2):
            raise ValueError(f"{name} has the shape {array.shape}, expected (S, 5, 2): S sets of five points")
        finite = np.isfinite(array).all(axis=(1, 2))
        if not finite.all():
            bad = int(np.argmin(finite))
            raise ValueError(f"{name} of shape {array.shape} has a number in set {bad} that is not finite")
        checked.append(array)
    if len(checked[0]) != len(checked[1]):
        shapes = " and ".join(str(array.shape) for array in checked)
        raise ValueError(f"x_p and x_c have the shapes {shapes}, expected equal shapes (S, 5, 2)")
    return checked[0], checked[1]


def _solve(basis: Array) -> tuple[Array, Index, BoolArray]:
    """Solutions v = (x, y, z, w) of norm 1, (4, M), their sets (M,), and a mask (S,) of doubtful sets."""
    rows = eliminate(cubic_constraints(basis))
    z, w, index, doubtful = real_roots(determinant(rows))
    start = back_substitute(rows, z, w, index)
    v, converged = polish(basis, start, index)
    near = np.abs(np.einsum("am,am->m", start, v)) > 1.0 - 0.5 * MAX_POLISH_MOVE**2
    doubtful[index[~(converged & near)]] = True
    return v[:, converged], index[converged], doubtful


def epipolar_rows(x_p: Array, x_c: Array) -> Array:
    """Rows a (5, 9, S) of points (S, 5, 2), with a · vec(E) = x_cᵀ E x_p; vec(E) has E row by row."""
    h_p = np.ones((5, 3, len(x_p)))
    h_c = np.ones((5, 3, len(x_c)))
    h_p[:, :2] = np.transpose(x_p, (1, 2, 0))
    h_c[:, :2] = np.transpose(x_c, (1, 2, 0))
    products = h_c[:, :, None] * h_p[:, None]
    return np.asarray(products.reshape(5, 9, -1))


def householder(A: Array, columns: int) -> Array:
    """Make the first `columns` columns of A (m, n, S) upper triangular by Householder reflections, in place.

    Reflections are stable without pivoting, so all sets have the same operations. The entries below the
    diagonal are undefined afterwards. Returns A.
    """
    buffer = np.empty_like(A)
    for k in range(columns):
        v = A[k:, k]
        rest = A[k:, k + 1 :]
        norm = np.copysign(np.sqrt(np.einsum("is,is->s", v, v)), v[0])
        v[0] += norm
        step = np.einsum("is,ijs->js", v, rest)
        step /= np.maximum(norm * v[0], 1e-300)
        rest -= np.multiply(v[:, None], step, out=buffer[k:, k + 1 :])
        v[0] = -norm
    return A


def null_space(rows: Array) -> tuple[Array, BoolArray]:
    """Four orthonormal matrices (4, 3, 3, S) that span all E with rows · vec(E) = 0.

    The reflections Q make Q rowsᵀ triangular and so change [rowsᵀ | I] to [R | Q]. The last four rows of Q
    are orthogonal to all five `rows`. The second result is a mask (S,) of the sets with independent rows.

    The order of the matrices matters. Row i of Q is near the unit vector i, so the largest entries of the
    four matrices are E22, E21, E20 and E12. The last two, with the factors z and w, are components of the
    translation, which differs between solutions; E22 is small in all solutions.
    """
    sets = rows.shape[-1]
    identity = np.broadcast_to(np.eye(9)[..., None], (9, 9, sets))
    RQ = householder(np.concatenate([rows.swapaxes(0, 1), identity], axis=1), 5)
    diagonal = np.abs(RQ[range(5), range(5)])
    independent = diagonal.min(axis=0) > 1e-12 * diagonal.max(axis=0)
    return np.ascontiguousarray(RQ[:4:-1, 5:]).reshape(4, 3, 3, sets), independent


def cubic_constraints(basis: Array) -> Array:
    """Coefficients (10, 20, S) of the ten cubics in (x, y, z, w); `EXPONENTS` lists their monomials.

    E Eᵀ E - trace(E Eᵀ) E / 2 = 0 (nine cubics) and det E = 0 (one), for E = x E0 + y E1 + z E2 + w E3.
    """
    sets = basis.shape[-1]
    E = (POINTS @ basis.reshape(4, -1)).reshape(20, 3, 3, sets)
    M = np.einsum("niks,njks->nijs", E, E)
    M[:, range(3), range(3)] -= 0.5 * np.einsum("niis->ns", M)[:, None]
    values = np.empty((20, 10, sets))
    np.einsum("niks,nkjs->nijs", M, E, out=values[:, :9].reshape(20, 3, 3, sets))
    values[:, 9] = _det_3x3(E.transpose(1, 2, 0, 3))
    return np.asarray((CUBIC_FROM_VALUES @ values.reshape(20, -1)).reshape(20, 10, sets).swapaxes(0, 1))


def eliminate(cubics: Array) -> Array:
    """Eliminate x³, y³, x²y and xy² from the ten cubics and return the remaining six rows (6, 16, S)."""
    return householder(cubics.copy(), 4)[4:, 4:]


def hidden_variable_matrix(rows: Array, z: Array, w: Array) -> Array:
    """Matrices C (6, 6, …) of the six rows (6, 16, …) at given (z, w): C (x², y², xy, x, y, 1)ᵀ = 0."""
    zz = z * z
    zw = z * w
    ww = w * w
    C = np.empty((6, 6, *np.broadcast_shapes(rows.shape[2:], z.shape)))
    C[:, :3] = rows[:, 0:6:2] * z + rows[:, 1:6:2] * w
    C[:, 3:5] = rows[:, 6:12:3] * zz + rows[:, 7:12:3] * zw + rows[:, 8:12:3] * ww
    C[:, 5] = (rows[:, 12] * z + rows[:, 13] * w) * zz + (rows[:, 14] * z + rows[:, 15] * w) * ww
    return C


def determinant(rows: Array) -> Array:
    """Coefficients (11, S) of z¹⁰, z⁹w, …, w¹⁰ in det C(z), from the values of det C(z) at the `NODES`."""
    C = hidden_variable_matrix(rows[:, :, None], *NODES[..., None])
    R = householder(C.reshape(6, 6, -1), 3)
    values = R[0, 0] * R[1, 1] * R[2, 2] * _det_3x3(R[3:, 3:])
    return np.asarray(POLYNOMIAL_FROM_VALUES @ values.reshape(DEGREE + 1, -1))


@DEGENERATE_SETS
def back_substitute(rows: Array, z: Array, w: Array, index: Index) -> Array:
    """Solutions (4, M) of norm 1 from roots (z, w): (x², y², xy, x, y, 1) spans the null space of C(z)."""
    R = householder(hidden_variable_matrix(rows.take(index, axis=-1), z, w), 3)
    x, y, one = _longest_column(_cofactors(R[3:, 3:].swapaxes(0, 1)))
    return _unit(np.stack([x, y, z * one, w * one]))


@DEGENERATE_SETS
def polish(basis: Array, v: Array, index: Index) -> tuple[Array, BoolArray]:
    """Solutions v (4, M) refined by Newton steps, and a mask (M,) of the converged solutions.

    The steps use the constraints, which are more precise than the polynomial. Most candidates need one step.
    """
    v = v.copy()
    converged = np.zeros(v.shape[1], dtype=bool)
    # Of the candidates that still move: their numbers, null spaces and solutions.
    todo = np.arange(v.shape[1])
    N = basis.take(index, axis=-1)
    old = v.copy()
    for _ in range(POLISH_STEPS):
        new = newton_step(N, old)
        move = np.linalg.norm(new - np.einsum("am,am->m", new, old) * old, axis=0)  # sine of the angle
        v[:, todo] = new
        converged[todo] = move < CONVERGED
        remaining = np.flatnonzero(~(move < POLISH_DONE))
        if not remaining.size:
            break
        todo = todo[remaining]
        N = N.take(remaining, axis=-1)
        old = new.take(remaining, axis=-1)
    return v, converged


# Signs of the permutations of four indices; a contraction with three vectors is their cross product.
_SIGNS = np.zeros((4, 4, 4, 4))
for _i, _l, _j, _k in permutations(range(4)):
    _SIGNS[_i, _l, _j, _k] = np.linalg.det(np.eye(4)[[_i, _l, _j, _k]])


def newton_step(N: Array, v: Array) -> Array:
    """Solutions (4, M) of norm 1 after one Newton step from v (4, M), for the null spaces N (4, 3, 3, M).

    At an essential matrix only three of the ten constraints are independent: the third singular value is
    zero (one equation), and the other two are equal (two equations). Let t be the left null vector of E,
    (a, b, t) orthonormal, p = Eᵀa and q = Eᵀb. Then

        (p·p - q·q) / 2 = 0,   p·q = 0,   (Eᵀt)·(p×q) = det E = 0.
    """
    E = np.einsum("am,aijm->ijm", v, N)
    t = _longest_column(_cofactors(E))
    h = t.copy()  # the reflection that takes t to the third axis has rows a, b, ±t
    h[2] += np.copysign(1.0, t[2])
    frame = np.eye(3)[..., None] - h[:, None] * (h / (1.0 + np.abs(t[2])))
    P = np.einsum("kim,aijm->kajm", frame, N)
    pq = np.einsum("am,kajm->kjm", v, P[:2])
    G = np.einsum("kjm,lajm->klam", pq, P[:2])
    p, q = pq[:, [0, 1, 2, 0, 1]]
    cross = p[1:4] * q[2:] - p[2:] * q[1:4]
    J = np.stack([G[0, 0] - G[1, 1], G[0, 1] + G[1, 0]])
    J_det = np.einsum("jm,ajm->am", cross, P[2])
    # The constraints are homogeneous: J v = (2 r0, 2 r1, r2). So the step r + J (v' - v) = 0 with v·v' = 1
    # becomes (J - (r0, r1, 0) vᵀ) v' = 0, and v' is the cross product of three rows, without a division.
    J -= 0.5 * np.einsum("kam,am->km", J, v)[:, None] * v
    minors = _SIGNS.reshape(16, 16) @ (J[0][:, None] * J[1]).reshape(16, -1)
    return _unit(np.einsum("ilm,lm->im", minors.reshape(4, 4, -1), J_det))


def _cofactors(A: Array) -> Array:
    """Cofactors of A (3, 3, …): A[i+1, j+1] A[i+2, j+2] - A[i+1, j+2] A[i+2, j+1], indices modulo 3."""
    A = A[[[0], [1], [2], [0], [1]], [0, 1, 2, 0, 1]]
    return np.asarray(A[1:4, 1:4] * A[2:, 2:] - A[1:4, 2:] * A[2:, 1:4])


def _det_3x3(A: Array) -> Array:
    (a, b, c), (d, e, f), (g, h, i) = A
    return np.asarray(a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g))


def _longest_column(A: Array) -> Array:
    """The longest column of each matrix in A (3, 3, M), as unit vectors (3, M)."""
    n0, n1, n2 = np.einsum("ijm,ijm->jm", A, A)
    longer_of_two = np.where(n1 > n0, A[:, 1], A[:, 0])
    return _unit(np.where(n2 > np.maximum(n0, n1), A[:, 2], longer_of_two))


def _unit(v: Array) -> Array:
    return np.asarray(v / np.sqrt(np.einsum("im,im->m", v, v)))
