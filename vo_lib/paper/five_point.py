"""Five-point solver: all essential matrices that fit five matches, for many sets at once.

Source: Nistér, "An efficient solution to the five-point relative pose problem", PAMI 2004. The constraints
are from Stewénius, Engels and Nistér, "Recent developments on direct relative orientation", 2006.

Each step is a function. The last axis of the intermediate arrays is the axis of the sets, so that NumPy does
each operation for all sets in one pass over memory. S is the number of sets, M that of solutions:

    epipolar_rows (5, 9, S)           one linear equation in E for each match
    null_space (4, 3, 3, S)           so E = x E0 + y E1 + z E2 + w E3
    cubic_constraints (10, 20, S)     of an essential matrix, in x, y, z, w
    eliminate (6, 16, S)              without x³, y³, x²y, xy²: linear in x², y², xy, x, y, 1
    determinant (11, S)               of these six equations: a polynomial in (z, w) alone
    real_roots                        its roots (z, w)
    back_substitute (4, M)            x and y of each root
    polish                            Newton steps on the constraints

Two steps differ from Nistér's paper. Nistér sets w = 1; here (z, w) is a point of the projective line, so no
solution is at infinity. Nistér eliminates ten monomials and divides by their pivots, which may be small; here
reflections eliminate only four of them. The other six give three of the six columns, x², y² and xy, of the
matrix whose determinant is taken. In the worst 5 % of the sets, the polynomial then has a hundred to a
thousand times less rounding error than his.
"""

from __future__ import annotations

from itertools import permutations
from typing import NamedTuple

import numpy as np

from ..geometry.types import Array, BoolArray, Index
from .real_roots import DEGREE, real_roots

# Degenerate sets cause these floating-point errors; their candidates are removed at the end.
ignore_degenerate_sets = np.errstate(divide="ignore", invalid="ignore", over="ignore")

# The 20 monomials of degree 3, by their power of x and y. The four without z and w are eliminated.
WITHOUT_Z_AND_W = ["xxx", "yyy", "xxy", "xyy"]
QUADRATIC = ["xxz", "xxw", "yyz", "yyw", "xyz", "xyw"]
LINEAR = ["xzz", "xzw", "xww", "yzz", "yzw", "yww"]
CONSTANT = ["zzz", "zzw", "zww", "www"]
MONOMIALS = [*WITHOUT_Z_AND_W, *QUADRATIC, *LINEAR, *CONSTANT]
EXPONENTS = np.array([[monomial.count(variable) for variable in "xyzw"] for monomial in MONOMIALS])
# The 20 coefficients of a cubic are computed from its values at 20 points (x, y, z, w): `VALUES_OF_MONOMIALS`
# has a row for each point, so its inverse turns values into coefficients. With the exponents as points,
# errors are not amplified.
POINTS = EXPONENTS / np.linalg.norm(EXPONENTS, axis=1, keepdims=True)
VALUES_OF_MONOMIALS = np.prod(POINTS[:, None, :] ** EXPONENTS, axis=2)
CUBIC_FROM_VALUES = np.linalg.inv(VALUES_OF_MONOMIALS)

# In the same way, the polynomial of degree 10 is computed from its values in eleven directions (z, w).
_ANGLES = np.pi * np.arange(DEGREE + 1) / (DEGREE + 1)
Z_NODES = np.cos(_ANGLES)
W_NODES = np.sin(_ANGLES)
_POWERS = np.arange(DEGREE + 1)
POLYNOMIAL_FROM_VALUES = np.linalg.inv(Z_NODES[:, None] ** _POWERS[::-1] * W_NODES[:, None] ** _POWERS)

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
    v, index = _solve_in_turns(basis, np.flatnonzero(independent))
    v, index = _distinct_solutions(v, index)
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


def _solve_in_turns(basis: Array, sets: Index) -> tuple[Array, Index]:
    """Solutions v = (x, y, z, w) of norm 1, (4, M), of some of the sets, and the set (M,) of each.

    Solutions with nearly equal z/w are hard to separate. So a set with doubtful solutions has another turn,
    with other matrices of the basis in the places of E2 and E3, where the ratios differ. In the second turn,
    E0 is in the place of E3. For most sets that is worse (`null_space`), but not for all of the few that are
    left.
    """
    solutions = [np.empty((4, 0))]
    indices = [np.empty(0, dtype=np.intp)]
    todo = sets
    for turn in range(SOLVING_TURNS):
        axes = (np.arange(4) + turn) % 4
        v, index, doubtful = _solve(basis[axes].take(todo, axis=-1))
        solutions.append(v[np.argsort(axes)])  # back in the order of the basis
        indices.append(todo[index])
        todo = todo[doubtful]
        if not todo.size:
            break
    return np.concatenate(solutions, axis=1), np.concatenate(indices)


def _solve(basis: Array) -> tuple[Array, Index, BoolArray]:
    """Solutions v = (x, y, z, w) of norm 1, (4, M), their sets (M,), and a mask (S,) of doubtful sets."""
    rows = eliminate(cubic_constraints(basis))
    z, w, index, doubtful = real_roots(determinant(rows))
    start = back_substitute(rows, z, w, index)
    v, converged = polish(basis, start, index)
    # The cosine of a small angle a is 1 - a² / 2.
    near = np.abs(np.einsum("am,am->m", start, v)) > 1.0 - 0.5 * MAX_POLISH_MOVE**2
    doubtful[index[~(converged & near)]] = True
    return v[:, converged], index[converged], doubtful


def _distinct_solutions(v: Array, index: Index) -> tuple[Array, Index]:
    """The solutions v (4, M) and their sets (M,), sorted by set, without duplicates and samples of families.

    Five matches have at most ten essential matrices, or a whole family of them. So the solutions of a set
    that has more than ten are samples of a family, and all of them are left out.
    """
    # By set, in a set by |x|, so that duplicates of a solution are neighbours. Since |x| is at most 1,
    # 0.99 |x| does not reach the next set.
    order = np.argsort(index + 0.99 * np.abs(v[0]))
    v = v.take(order, axis=1)
    index = index[order]
    cosine = np.abs(np.einsum("am,am->m", v[:, 1:], v[:, :-1]))
    differs = 1.0 - cosine > 0.5 * SAME_CANDIDATE_DISTANCE**2
    distinct = np.ones(index.size, dtype=bool)
    distinct[1:] = (index[1:] != index[:-1]) | differs
    count_in_set = np.bincount(index[distinct])
    kept = distinct & (count_in_set <= DEGREE)[index]
    return v[:, kept], index[kept]


def epipolar_rows(x_p: Array, x_c: Array) -> Array:
    """The rows a (5, 9, S) of matches (S, 5, 2): a · vec(E) = x_cᵀ E x_p, where vec(E) is E row by row."""
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
        # The reflection X -> X - 2 v (vᵀ X) / (vᵀ v) with v = a ± ‖a‖ e1 takes the column a to ∓ ‖a‖ e1. The
        # names `v` and `rest` are views, so A itself changes; vᵀ v / 2 is `norm` times the first entry of v.
        v = A[k:, k]
        rest = A[k:, k + 1 :]
        norm = np.copysign(np.sqrt(np.einsum("is,is->s", v, v)), v[0])
        v[0] += norm
        factor = np.einsum("is,ijs->js", v, rest)
        factor /= np.maximum(norm * v[0], 1e-300)
        rest -= np.multiply(v[:, None], factor, out=buffer[k:, k + 1 :])
        v[0] = -norm
    return A


def null_space(rows: Array) -> tuple[Array, BoolArray]:
    """Four orthonormal matrices (4, 3, 3, S) that span all E with rows · vec(E) = 0.

    The second result is a mask (S,) of the sets with independent rows.

    The reflections Q make Q rowsᵀ triangular and so change [rowsᵀ | I] to [U | Q]. Below the triangle, U is
    zero, so the last four rows of Q are orthogonal to all five `rows`. From the last one upwards, they are
    E0, E1, E2 and E3.

    This order matters. The roots are those of a polynomial in z and w, the factors of E2 and E3. If E0 were
    in the place of one of the two, several times as many sets would have roots that are too near each other
    to be counted.
    """
    sets = rows.shape[-1]
    identity = np.broadcast_to(np.eye(9)[..., None], (9, 9, sets))
    U_and_Q = householder(np.concatenate([rows.swapaxes(0, 1), identity], axis=1), 5)
    diagonal = np.abs(U_and_Q[range(5), range(5)])
    independent = diagonal.min(axis=0) > 1e-12 * diagonal.max(axis=0)
    last_rows = U_and_Q[5:, 5:]
    return np.ascontiguousarray(last_rows[::-1]).reshape(4, 3, 3, sets), independent


def cubic_constraints(basis: Array) -> Array:
    """Coefficients (10, 20, S) of the ten cubics in (x, y, z, w), in the order of `MONOMIALS`.

    E Eᵀ E - trace(E Eᵀ) E / 2 = 0 (nine cubics) and det E = 0 (one), for E = x E0 + y E1 + z E2 + w E3.
    """
    sets = basis.shape[-1]
    # E at each of the 20 points, and the values of the ten cubics there.
    E = (POINTS @ basis.reshape(4, -1)).reshape(20, 3, 3, sets)
    M = np.einsum("niks,njks->nijs", E, E)  # E Eᵀ
    M[:, range(3), range(3)] -= 0.5 * np.einsum("niis->ns", M)[:, None]  # E Eᵀ - trace(E Eᵀ) I / 2
    values = np.empty((20, 10, sets))
    np.einsum("niks,nkjs->nijs", M, E, out=values[:, :9].reshape(20, 3, 3, sets))
    values[:, 9] = _det_3x3(E.transpose(1, 2, 0, 3))
    return np.asarray((CUBIC_FROM_VALUES @ values.reshape(20, -1)).reshape(20, 10, sets).swapaxes(0, 1))


def eliminate(cubics: Array) -> Array:
    """Eliminate x³, y³, x²y and xy² from the ten cubics and return the remaining six rows (6, 16, S)."""
    return householder(cubics.copy(), 4)[4:, 4:]


def hidden_variable_matrix(rows: Array, z: Array, w: Array) -> Array:
    """Matrices C (6, 6, …) of the six rows (6, 16, …) at given (z, w): C (x², y², xy, x, y, 1)ᵀ = 0.

    The variables z and w are hidden in the coefficients, as in the technique of this name for resultants.
    The 16 coefficients of a row are those of `MONOMIALS` without the first four, and C sums up those that
    belong to the same power of x and y.
    """
    zz = z * z
    zw = z * w
    ww = w * w
    C = np.empty((6, 6, *np.broadcast_shapes(rows.shape[2:], z.shape)))
    C[:, :3] = rows[:, 0:6:2] * z + rows[:, 1:6:2] * w
    C[:, 3:5] = rows[:, 6:12:3] * zz + rows[:, 7:12:3] * zw + rows[:, 8:12:3] * ww
    C[:, 5] = (rows[:, 12] * z + rows[:, 13] * w) * zz + (rows[:, 14] * z + rows[:, 15] * w) * ww
    return C


def determinant(rows: Array) -> Array:
    """Coefficients (11, S) of z¹⁰, z⁹w, …, w¹⁰ in det C(z, w), from its values in eleven directions.

    A solution has C (x², y², xy, x, y, 1)ᵀ = 0 with a vector that is not zero, so det C(z, w) = 0.
    """
    C = hidden_variable_matrix(rows[:, :, None], Z_NODES[:, None], W_NODES[:, None])
    # After three reflections the determinant is a product. They change its sign in all sets alike, which does
    # not matter for the roots.
    R = householder(C.reshape(6, 6, -1), 3)
    values = R[0, 0] * R[1, 1] * R[2, 2] * _det_3x3(R[3:, 3:])
    return np.asarray(POLYNOMIAL_FROM_VALUES @ values.reshape(DEGREE + 1, -1))


@ignore_degenerate_sets
def back_substitute(rows: Array, z: Array, w: Array, index: Index) -> Array:
    """Solutions (4, M) of norm 1 from roots z, w (M,), and the set (M,) of each.

    (x², y², xy, x, y, 1) spans the null space of C(z, w). Three reflections leave three equations for
    (x, y, 1) alone, whose solution is any column of the cofactors of the transposed matrix that is not zero.
    """
    R = householder(hidden_variable_matrix(rows.take(index, axis=-1), z, w), 3)
    # (x, y, 1) times an unknown factor, which is `one`.
    x, y, one = _longest_column(_cofactors(R[3:, 3:].swapaxes(0, 1)))
    return _unit(np.stack([x, y, z * one, w * one]))


@ignore_degenerate_sets
def polish(basis: Array, v: Array, index: Index) -> tuple[Array, BoolArray]:
    """Solutions v (4, M) refined by Newton steps, and a mask (M,) of the converged solutions.

    The steps use the constraints, which are more precise than the polynomial. Most candidates need one step.

    Parameters
    ----------
    basis : (4, 3, 3, S) null spaces of all sets; index : (M,) the set of each solution.
    """
    v = v.copy()
    converged = np.zeros(v.shape[1], dtype=bool)
    # Of the candidates that still move: their numbers, null spaces and solutions.
    todo = np.arange(v.shape[1])
    N = basis.take(index, axis=-1)
    old = v.copy()
    for _ in range(POLISH_STEPS):
        new = newton_step(N, old)
        # The part of `new` across `old`: the sine of the angle between them, whatever their signs are.
        move = np.linalg.norm(new - np.einsum("am,am->m", new, old) * old, axis=0)
        v[:, todo] = new
        converged[todo] = move < CONVERGED
        remaining = np.flatnonzero(~(move < POLISH_DONE))  # with those whose step is NaN
        if not remaining.size:
            break
        todo = todo[remaining]
        N = N.take(remaining, axis=-1)
        old = new.take(remaining, axis=-1)
    return v, converged


def newton_step(N: Array, v: Array) -> Array:
    """Solutions (4, M) of norm 1 after one Newton step from v (4, M), for the null spaces N (4, 3, 3, M).

    At an essential matrix only three of the ten constraints are independent: the third singular value is
    zero (one equation), and the other two are equal (two equations). Let t be the left null vector of E,
    (a, b, t) orthonormal, p = Eᵀa and q = Eᵀb. Then

        r0 = (p·p - q·q) / 2 = 0,   r1 = p·q = 0,   r2 = (Eᵀt)·(p×q) = ± det E = 0.

    The vectors a, b, t and the product p×q count as constant in the step.
    """
    E = np.einsum("am,aijm->ijm", v, N)
    t = _longest_column(_cofactors(E))
    # The reflection that takes t to the third axis has the rows a, b, ±t.
    h = t.copy()
    h[2] += np.copysign(1.0, t[2])
    frame = np.eye(3)[..., None] - h[:, None] * (h / (1.0 + np.abs(t[2])))
    # P has Eᵀa, Eᵀb and Eᵀt of each matrix of the null space: they are the derivatives of p, q and Eᵀt.
    P = np.einsum("kim,aijm->kajm", frame, N)
    pq = np.einsum("am,kajm->kjm", v, P[:2])
    G = np.einsum("kjm,lajm->klam", pq, P[:2])  # p or q times the derivative of p or q
    p, q = pq[:, [0, 1, 2, 0, 1]]  # the first two entries again, so that slices give the cross product
    cross = p[1:4] * q[2:] - p[2:] * q[1:4]
    J = np.stack([G[0, 0] - G[1, 1], G[0, 1] + G[1, 0]])
    J_det = np.einsum("jm,ajm->am", cross, P[2])
    # The constraints are homogeneous: J v = (2 r0, 2 r1, r2). So the step r + J (v' - v) = 0 with v·v' = 1
    # becomes (J - (r0, r1, 0) vᵀ) v' = 0: v' is orthogonal to three rows, so it is their cross product.
    J -= 0.5 * np.einsum("kam,am->km", J, v)[:, None] * v
    return _unit(_cross_product(J[0], J[1], J_det))


# Entry i of the cross product of three vectors a, b, c is a sum of products ± c_l a_j b_k. The sign is that
# of the permutation (i, l, j, k), and 0 if an index occurs twice.
_SIGNS = np.zeros((4, 4, 4, 4))
for _permutation in permutations(range(4)):
    _SIGNS[_permutation] = np.linalg.det(np.eye(4)[list(_permutation)])


def _cross_product(a: Array, b: Array, c: Array) -> Array:
    """The vectors (4, M) that are orthogonal to a, b and c, each (4, M)."""
    minors = _SIGNS.reshape(16, 16) @ (a[:, None] * b).reshape(16, -1)
    return np.asarray(np.einsum("ilm,lm->im", minors.reshape(4, 4, -1), c))


def _cofactors(A: Array) -> Array:
    """Cofactors of A (3, 3, …): A[i+1, j+1] A[i+2, j+2] - A[i+1, j+2] A[i+2, j+1], indices modulo 3."""
    # The first two rows and columns again behind the last ones, so that slices can be taken modulo 3.
    A = A[[[0], [1], [2], [0], [1]], [0, 1, 2, 0, 1]]
    return np.asarray(A[1:4, 1:4] * A[2:, 2:] - A[1:4, 2:] * A[2:, 1:4])


def _det_3x3(A: Array) -> Array:
    """Determinants (…) of matrices (3, 3, …)."""
    (a, b, c), (d, e, f), (g, h, i) = A
    return np.asarray(a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g))


def _longest_column(A: Array) -> Array:
    """The longest column of each matrix in A (3, 3, M), as unit vectors (3, M)."""
    n0, n1, n2 = np.einsum("ijm,ijm->jm", A, A)
    longer_of_two = np.where(n1 > n0, A[:, 1], A[:, 0])
    return _unit(np.where(n2 > np.maximum(n0, n1), A[:, 2], longer_of_two))


def _unit(v: Array) -> Array:
    """Vectors v (K, M) divided by their norms."""
    return np.asarray(v / np.sqrt(np.einsum("im,im->m", v, v)))
