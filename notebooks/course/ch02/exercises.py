"""Exercises of chapter 2: epipolar lines, R and t from E, rows, null space, ten constraints, the solver, noise."""

from __future__ import annotations

import functools
from collections.abc import Callable
from functools import partial

import numpy as np

from vo_lib.geometry.motion import skew
from vo_lib.geometry.types import Array, BoolArray, Index
from vo_lib.paper.five_point import cubic_constraints, eliminate, five_point, hidden_variable_matrix
from vo_lib.paper.sampson import sampson_distance
from vo_lib.paper.selection import truncated_errors

from ..candidates import first_of_each_set
from ..checker import Case, Condition, Exercise
from ..rotation_errors import rotation_errors
from ..simulation.problems import FOCAL, random_problems
from . import library
from .library import homogeneous, null_space, rows

FIRST = "rotation error of solution 1"  # a fact of the panel
SCENE_POINTS = 65  # matches of a scene, of which the first five are the set
FAR_BEHIND = 5000.0  # depth of a distant point whose rays meet on the wrong side, in the unit of t
GOOD_PX = 1.0  # image errors are truncated at this distance


def matches() -> list[Case]:
    """Six cases, each with an E and three noisy matches."""
    given = random_problems(np.random.default_rng(7), 6, 3, noise_px=2.0)
    return list(zip(given.E, given.x_p, given.x_c, strict=True))


def from_lines(value: Callable[[Array, Array], Array]) -> Callable[..., Array]:
    """Answer built from a function `value` of the numbers x_cᵀ E x_p (N,) and of the lines E x_p (N, 3)."""

    def measured(E: Array, x_p: Array, x_c: Array) -> Array:
        lines = homogeneous(x_p) @ E.T
        return value(np.sum(lines * homogeneous(x_c), axis=1), lines)

    return measured


def length_of_normal(lines: Array) -> Array:
    """Lengths (N,) of the normals (a, b) of lines (N, 3)."""
    return np.asarray(np.hypot(lines[:, 0], lines[:, 1]))


def random_matches(seed: int, points: int, noise_px: float = 0.0) -> tuple[Array, Array, Array]:
    """E (3, 3), x_p and x_c (N, 2) of a random problem."""
    given = random_problems(np.random.default_rng(seed), 1, points, noise_px=noise_px)
    return given.E[0], given.x_p[0], given.x_c[0]


def decomposed() -> list[Case]:
    """The E of the chapter's example by hand, and eight random ones of either sign and any scale."""
    given = random_problems(np.random.default_rng(3), 8, 1)
    scales = np.array([1.0, -1.0, 2.0, -0.5, 1.0, -3.0, 0.7, -1.0])
    by_hand = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    scaled = scales[:, None, None] * given.E
    return [(E,) for E in [by_hand, *scaled]]


def in_any_order(motions: Array) -> Array:
    """Motions (M, 3, 4) in an order of their own; other arrays do not change."""
    return library.sorted_motions(motions) if motions.ndim == 3 else motions


def motions_by(
    make: Callable[[Array, Array, Array], tuple[list[Array], Array]], all_signs: bool = False
) -> Callable[[Array], Array]:
    """Answer built from a function of U, W, Vᵀ that returns rotations and t.

    U and Vᵀ have the determinant 1: where it was -1, the sign of u₃ or v₃ is changed, or with `all_signs` the
    sign of the whole matrix.
    """

    def motions(E: Array) -> Array:
        U, _, Vt = np.linalg.svd(E)
        changed = slice(None) if all_signs else 2
        U[:, changed] *= np.linalg.det(U)
        Vt[changed] *= np.linalg.det(Vt)
        W = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
        rotations, t = make(U, W, Vt)
        return library.all_motions(rotations, t)

    return motions


def with_v(U: Array, W: Array, Vt: Array) -> tuple[list[Array], Array]:
    """Rotations with V in place of Vᵀ, and the right t."""
    return [U @ W @ Vt.T, U @ W.T @ Vt.T], U[:, 2]


def without_signs(E: Array) -> Array:
    """Wrong answer: the four motions with the signs that the singular value decomposition happens to give."""
    U, _, Vt = np.linalg.svd(E)
    W = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    return library.all_motions([U @ W @ Vt, U @ W.T @ Vt], U[:, 2])


def is_reflection(motions: Array, E: Array) -> bool:
    """Whether all R of motions (M, 3, 4) are orthogonal, but some have a determinant of -1."""
    R = motions[:, :, :3]
    orthogonal = np.allclose(R @ np.swapaxes(R, 1, 2), np.eye(3), atol=1e-9)
    return bool(orthogonal and np.linalg.det(R).min() < 0.0)


def gives_other_matrix(motions: Array, E: Array) -> bool:
    """Whether [t]× R of some motion (M, 3, 4) is no multiple of E."""
    products = (skew(motions[:, :, 3]) @ motions[:, :, :3]).reshape(-1, 9)
    size = np.linalg.norm(products, axis=1) * np.linalg.norm(E)
    return bool((np.abs(products @ E.ravel()) < (1 - 1e-6) * size).any())


def motions_and_matches(points: int) -> list[Case]:
    """The four motions of one E with exact matches, one motion in each case.

    Without noise the rays meet, and every way to the depths gives the same numbers.
    """
    E, x_p, x_c = random_matches(4, points)
    return [(motion, x_p, x_c) for motion in library.four_motions(E)]


def backward_motion(motion: Array) -> Array:
    """The motion with -t in place of t."""
    return np.column_stack([motion[:, :3], -motion[:, 3]])


def inverted_motion(motion: Array) -> Array:
    """The motion with Rᵀ in place of R."""
    return np.column_stack([motion[:, :3].T, motion[:, 3]])


def along_the_rays(motion: Array, x_p: Array, x_c: Array) -> tuple[Array, Array]:
    """Wrong answer: distances of the points from both cameras, with the signs of the depths."""
    d_p, d_c = library.two_depths(motion, x_p, x_c)
    length_p = np.linalg.norm(homogeneous(x_p), axis=1)
    length_c = np.linalg.norm(homogeneous(x_c), axis=1)
    return d_p * length_p, d_c * length_c


def by_length_of_normal(motion: Array, x_p: Array, x_c: Array) -> tuple[Array, Array]:
    """Wrong answer: depths times the length of n = x_c × R x_p."""
    d_p, d_c = library.two_depths(motion, x_p, x_c)
    normals = np.cross(homogeneous(x_c), homogeneous(x_p) @ motion[:, :3].T)
    length = np.linalg.norm(normals, axis=1)
    return d_p * length, d_c * length


def twisted_first(motions: Array, x_p: Array, x_c: Array) -> Array:
    """The motions (4, 3, 4), first the one that deceives the wrong test d_p + d_c > 0 most.

    Deceiving are the points in front of one camera and behind the other whose d_p + d_c is positive.
    """
    counts = []
    for motion in motions:
        d_p, d_c = library.two_depths(motion, x_p, x_c)
        counts.append(np.sum((d_p + d_c > 0.0) & (d_p * d_c < 0.0)))
    return np.asarray(motions[np.argsort(counts)[::-1]])


def choices() -> list[Case]:
    """The motions of six E in different orders, each with twenty noisy matches, two of them wrong.

    The last two cars drive forward, where the depths of a twisted motion have positive sums; and one of their
    matches has rays that meet far behind, as those of distant points do.
    """
    cases: list[Case] = []
    for seed in range(4):
        E, x_p, x_c = random_matches(seed, 20, noise_px=0.5)
        x_c[[0, 1]] = x_c[[1, 0]]
        motions = np.roll(library.four_motions(E), seed, axis=0)
        cases.append((motions, x_p, x_c))
    for seed in (4, 5):
        given = random_problems(np.random.default_rng(seed), 1, 20, motion="forward", noise_px=0.5)
        x_p = given.x_p[0]
        x_c = given.x_c[0]
        behind = -FAR_BEHIND * homogeneous(x_p[:1]) @ given.R_cp[0].T + given.t_cp[0]
        x_c[:1] = behind[:, :2] / behind[:, 2:]
        motions = twisted_first(library.four_motions(given.E[0]), x_p, x_c)
        cases.append((motions, x_p, x_c))
    return cases


def most_in_front_of(cameras: Callable[[Array, Array], BoolArray]) -> Callable[..., Array]:
    """Answer that counts the points whose depths `cameras` accepts."""

    def chosen(motions: Array, x_p: Array, x_c: Array) -> Array:
        counts = [np.sum(cameras(*library.two_depths(motion, x_p, x_c))) for motion in motions]
        return np.asarray(motions[int(np.argmax(counts))])

    return chosen


def largest_sum_of_depths(motions: Array, x_p: Array, x_c: Array) -> Array:
    """Wrong answer: the motion with the largest sum of all depths."""
    sums = [np.sum(library.two_depths(motion, x_p, x_c)) for motion in motions]
    return np.asarray(motions[int(np.argmax(sums))])


def index_of_choice(motions: Array, x_p: Array, x_c: Array) -> int:
    """Wrong answer: the index of the right motion."""
    counts = [library.count_in_front(motion, x_p, x_c) for motion in motions]
    return int(np.argmax(counts))


def as_equations(A: Array) -> Array:
    """Rows (5, 9) in one order, scale and sign, so that rows of the same equations are equal; other arrays as given."""
    if A.ndim != 2:
        return A
    with np.errstate(divide="ignore", invalid="ignore"):
        unit = A / np.linalg.norm(A, axis=1, keepdims=True) * np.where(A[:, -1:] < 0.0, -1.0, 1.0)
    return np.asarray(unit[np.lexsort(np.round(unit, 6).T)])


def five_matches(seed: int) -> tuple[Array, Array]:
    """x_p and x_c (5, 2) of a random problem without noise."""
    _, x_p, x_c = random_matches(seed, 5)
    return x_p, x_c


def projector(basis: Array) -> Array:
    """Projector (9, 9) on the space of vectors in rows (4, 9), or in columns (9, 4)."""
    return basis.T @ basis if len(basis) == 4 else basis @ basis.T


def essentials() -> list[Case]:
    """Five essential matrices and two other matrices: one of rank 2, one random."""
    rng = np.random.default_rng(10)
    E = random_problems(rng, 5).E
    rank_2 = np.diag([1.0, 0.5, 1.0]) @ E[0]
    return [(each,) for each in [*E, rank_2, rng.normal(size=(3, 3))]]


def ten_constraints(E: Array, half: float = 0.5) -> Array:
    """The ten constraints (10,) of a matrix (3, 3); wrong with another number `half` in place of ½."""
    M = E @ E.T @ E - half * np.trace(E @ E.T) * E
    return np.append(M.ravel(), np.linalg.det(E))


def up_to_scale(values: Array) -> Array:
    """Ones if the values are a case's ten constraints in any order and scale; else the values."""
    determinant_last = (values[:9], values[9])
    determinant_first = (values[1:], values[0])
    for (E,) in essentials()[5:]:  # for the others, all constraints are 0
        constraints = ten_constraints(E)
        for nine, determinant in (determinant_last, determinant_first):
            given = np.sort(np.abs(nine))
            right = np.sort(np.abs(constraints[:9]))
            scale = given[-1] / right[-1]
            has_nine = scale > 1e-9 and np.allclose(given, scale * right)
            # The determinant may have the scale of the nine or one of its own.
            factors = np.array([0.5, 1.0, 2.0, scale])
            has_determinant = np.isclose(abs(determinant), abs(constraints[9]) * factors).any()
            has_signs = values.min() < 0.0  # absolute values are no constraints
            if has_nine and has_determinant and has_signs:
                return np.ones(10)
    return np.asarray(values)


def six_rows(seed: int) -> Array:
    """The six rows (6, 16) after the elimination, for the five matches of a random problem."""
    basis = null_space(rows(*five_matches(seed))).reshape(4, 3, 3)
    return np.asarray(eliminate(cubic_constraints(basis[..., None]))[..., 0])


def at_z() -> list[Case]:
    """Six rows, each with a value of z; the values 0 and 1 come last, since they hide mistakes."""
    values = (-2.0, 0.5, 3.0, 1.0, 0.0)
    return [(six_rows(seed), z) for seed, z in enumerate(values)]


def all_linear_in_z(six: Array, z: float) -> Array:
    """Wrong answer: C(z) with z in place of every power of z."""
    at_one = library.hidden_matrix(six, 1.0)
    constant = library.hidden_matrix(six, 0.0)
    return constant + z * (at_one - constant)


def columns_from_the_start(six: Array, z: float) -> Array:
    """Wrong answer: C(z) if the columns of `six` are taken for the first sixteen monomials of the twenty."""
    shifted = np.zeros_like(six)
    shifted[:, :12] = six[:, 4:]
    return library.hidden_matrix(shifted, z)


def powers_of_w(six: Array, z: float) -> Array:
    """Wrong answer: the powers of z and w exchanged, which is C at z = 1 and w = `z`."""
    one = np.ones(1)
    return np.asarray(hidden_variable_matrix(six[:, :, None], one, z * one)[..., 0])


def in_basis(E: Array, x_p: Array, x_c: Array) -> Array:
    """x, y, z (3, M) of matrices E (M, 3, 3) in the basis of `null_space`, with w = 1."""
    xyzw = np.reshape(E, (-1, 9)) @ null_space(rows(x_p, x_c)).T
    return np.asarray((xyzw[:, :3] / xyzw[:, 3:]).T)


def only_z_is_right(E: Array, x_p: Array, x_c: Array) -> bool:
    """Whether the matrices have the same z as the solutions."""
    got = np.sort(in_basis(E, x_p, x_c)[2])
    right = np.sort(in_basis(library.solve_five(x_p, x_c), x_p, x_c)[2])
    return np.allclose(got, right, rtol=1e-3)


def as_unit_vectors(E: Array) -> Array:
    """Matrices as unit vectors (M, 9) with a fixed order and fixed signs, for comparison."""
    e = np.asarray(E, np.float64).reshape(-1, 9)
    e = e / np.linalg.norm(e, axis=1, keepdims=True)
    largest = e[np.arange(len(e)), np.abs(e).argmax(axis=1)]
    e = e * np.sign(largest)[:, None]
    return np.asarray(e[np.lexsort(np.round(e, 3).T)])


@functools.cache
def counts() -> Index:
    """The number of real solutions of each of 2000 sets."""
    given = random_problems(np.random.default_rng(0), 2000)
    return np.bincount(five_point(given.x_p, given.x_c).set_index, minlength=2000)


@functools.cache
def median_error(noise_px: float) -> float:
    """Median rotation error of sets of five with a noise of `noise_px` pixels, degrees.

    500 scenes of a car that drives forward, one set in each; of its solutions, the one with the smallest image
    error over `SCENE_POINTS` matches of the scene.
    """
    given = random_problems(np.random.default_rng(0), 500, SCENE_POINTS, motion="forward", noise_px=noise_px)
    candidates = five_point(given.x_p[:, :5], given.x_c[:, :5])
    image_errors = np.empty(len(candidates.E))
    for scene in range(len(given.E)):
        of_set = candidates.set_index == scene
        E = candidates.E[of_set]
        image_errors[of_set] = truncated_errors(E, given.x_p[scene], given.x_c[scene], GOOD_PX / FOCAL)
    best = np.flatnonzero(first_of_each_set(image_errors, candidates.set_index))
    R_cp = given.R_cp[candidates.set_index[best]]
    return float(np.median(rotation_errors(candidates.E[best], R_cp[:, None])))


epipolar_distance = Exercise(
    library.distances,
    matches,
    atol=1e-12,
    praise="multiplied by f, these are the distances in pixels that the panel shows.",
    hint="a, b and c are the three entries of E x_p, with x_p as (x, y, 1).",
    line="lines = np.column_stack([x_p, np.ones(len(x_p))]) @ E.T; a, b, c = lines.T; "
    "abs(a * x_c[:, 0] + b * x_c[:, 1] + c) / np.hypot(a, b)",
    library=("sampson_distance", "epipolar_line"),
    mistakes={
        "a distance is not negative.": from_lines(lambda value, lines: value / length_of_normal(lines)),
        "this is x_cᵀ E x_p, not yet a distance: divide it by the length of (a, b).": (
            from_lines(lambda value, lines: abs(value)),
            from_lines(lambda value, lines: value),
        ),
        "the points are exchanged: x_p gives the line.": lambda E, x_p, x_c: library.distances(E, x_c, x_p),
        "these are the lines of the transposed E.": lambda E, x_p, x_c: library.distances(E.T, x_p, x_c),
        "c is left out.": from_lines(lambda value, lines: abs(value - lines[:, 2]) / length_of_normal(lines)),
        "this is divided by the length of (a, b, c); the normal of the line is (a, b) alone.": from_lines(
            lambda value, lines: abs(value) / np.linalg.norm(lines, axis=1)
        ),
        "this is the Sampson distance, which counts the line in the previous image, too; the task is the distance in "
        "the current image.": lambda E, x_p, x_c: np.abs(sampson_distance(E, x_p, x_c)),
        "every match has a line of its own, with a length of (a, b) of its own.": from_lines(
            lambda value, lines: abs(value) / np.linalg.norm(lines[:, :2])
        ),
    },
)

four_motions = Exercise(
    library.four_motions,
    decomposed,
    form=in_any_order,
    praise="each of the four is a rotation and a direction, and [t]× R is E or -E, up to scale.",
    hint="U, S, Vt = np.linalg.svd(E); R = U W Vᵀ and U Wᵀ Vᵀ, each with t = u₃ and with -u₃.",
    line="U[:, 2] *= np.linalg.det(U); Vt[2] *= np.linalg.det(Vt); t = U[:, 2]; "
    "[np.column_stack([R, way]) for R in (U @ W @ Vt, U @ W.T @ Vt) for way in (t, -t)]",
    library=("decompose_essential", "decomposeEssentialMat", "recoverPose"),
    mistakes={
        "these rotations go from the current camera to the previous one: they are transposed.": motions_by(
            lambda U, W, Vt: ([(U @ W @ Vt).T, (U @ W.T @ Vt).T], U[:, 2])
        ),
        "this t has E t = 0: it is from V, or it is the camera's place -Rᵀt. Both are seen from the previous camera; "
        "take the last column of U.": (motions_by(lambda U, W, Vt: ([U @ W @ Vt, U @ W.T @ Vt], Vt[2]))),
        "this t is the last row of U; the vectors of U are its columns.": motions_by(
            lambda U, W, Vt: ([U @ W @ Vt, U @ W.T @ Vt], U[2])
        ),
        "`np.linalg.svd` returns Vᵀ, not V: do not transpose it again.": (
            motions_by(with_v),
            motions_by(with_v, all_signs=True),
        ),
        "both rotations are the same; the second has the transposed W.": motions_by(
            lambda U, W, Vt: ([U @ W @ Vt, U @ W @ Vt], U[:, 2])
        ),
        "t is a fourth row here; [R | t] has it as the fourth column: `np.column_stack([R, t])`.": (
            lambda E: np.array([np.vstack([each[:, :3], each[:, 3]]) for each in library.four_motions(E)])
        ),
        "some of these R are reflections, with a determinant of -1: first change the signs of u₃ and v₃ so that "
        "det U = det V = 1.": (without_signs, Condition(is_reflection)),
        "some of the four are the same: each of the two R comes with t and with -t.": Condition(
            lambda motions, E: len(np.unique(np.round(motions, 6).reshape(4, -1), axis=0)) < 4
        ),
        "some of these t have not the length 1.": Condition(
            lambda motions, E: not np.allclose(np.linalg.norm(motions[:, :, 3], axis=1), 1.0)
        ),
        "[t]× R is not a multiple of E for all of these motions.": Condition(gives_other_matrix),
    },
)

two_depths = Exercise(
    library.two_depths,
    lambda: motions_and_matches(6),
    parts=("d_p", "d_c"),
    atol=1e-7,
    rtol=1e-6,
    praise="negative depths are behind a camera.",
    hint="with q = R x_p and n = x_c × q: d_p = -n·(x_c × t) / n·n and d_c = -n·(q × t) / n·n, row by row.",
    line="n = np.cross(c, q); d_p = -np.sum(n * np.cross(c, t), axis=1) / np.sum(n**2, axis=1)",
    library=("triangulatePoints",),
    mistakes={
        "the depths have the wrong sign: x_c × t is -d_p (x_c × R x_p), with a minus; or is -t used in place of t?": lambda motion, *x: (
            library.two_depths(backward_motion(motion), *x)
        ),
        "these are distances from the cameras; a depth is Z, and the ray is (x, y, 1), of any length.": along_the_rays,
        "this is computed with Rᵀ: R takes the ray of the previous camera to the current one.": (
            lambda motion, *x: library.two_depths(inverted_motion(motion), *x)
        ),
        "this is divided by the length of n; n·n is the square of the length.": by_length_of_normal,
        "these depths have lost their signs: a negative depth, behind a camera, is what tells the motions apart.": (
            lambda motion, *x: tuple(np.abs(depths) for depths in library.two_depths(motion, *x))
        ),
        "these depths are signs only.": lambda motion, *x: np.sign(library.two_depths(motion, *x)),
    },
)

choose_motion = Exercise(
    library.choose_motion,
    choices,
    praise="most points are in front of both cameras, in one motion only.",
    hint="a point counts if both depths are positive; return the motion with the largest count.",
    line="counts = [np.sum((d_p > 0) & (d_c > 0)) …]; motions[np.argmax(counts)]",
    library=("recoverPose", "resolve_by_depth"),
    mistakes={
        "this is the number of a motion; return the motion itself, (3, 4).": index_of_choice,
        "these points are in front of the previous camera only: both depths must be positive.": most_in_front_of(
            lambda d_p, d_c: d_p > 0
        ),
        "these points are in front of the current camera only: both depths must be positive.": most_in_front_of(
            lambda d_p, d_c: d_c > 0
        ),
        "this motion has the points in front of one camera and behind the other.": most_in_front_of(
            lambda d_p, d_c: (d_p > 0) != (d_c > 0)
        ),
        "this motion has the points behind both cameras: two negative depths have a positive product.": (
            most_in_front_of(lambda d_p, d_c: (d_p < 0) & (d_c < 0))
        ),
        "d_p + d_c is also positive where a point is in front of one camera and behind the other: each of the two "
        "depths must be positive.": most_in_front_of(lambda d_p, d_c: d_p + d_c > 0),
        "this is the motion with the largest sum of depths: a single distant point decides it. Count the points.": (
            largest_sum_of_depths
        ),
        "this is the choice of a single match, which may be a wrong one: let all matches vote.": (
            lambda motions, x_p, x_c: library.choose_motion(motions, x_p[:1], x_c[:1])
        ),
        "this is the first motion, whatever the matches are.": lambda motions, *x: motions[0],
    },
)

epipolar_rows = Exercise(
    rows,
    lambda: [five_matches(8)],
    form=as_equations,
    atol=1e-9,
    praise="these are the library's equations; with the true E, A vec(E) is 0.",
    hint="x_cᵀ E x_p = Σ c_i E_ij p_j with c = (x_c, 1) and p = (x_p, 1): the factor of E_ij is c_i p_j.",
    line="np.outer(np.append(x_c[k], 1), np.append(x_p[k], 1)).ravel()",
    library=("epipolar_rows",),
    mistakes={
        "either previous and current points have changed places, or E's entries are taken column by column: vec(E) "
        "has E row by row, and x_c stands left of E.": lambda x_p, x_c: rows(x_c, x_p),
        "x and y are exchanged in both images.": lambda x_p, x_c: rows(x_p[:, ::-1], x_c[:, ::-1]),
        "`ravel` makes a row of nine numbers of each 3×3 matrix.": lambda *x: rows(*x).reshape(5, 3, 3),
        "the last column is right, others are not: look at the order of E's nine entries.": Condition(
            lambda A, *case: np.allclose(A[:, 8], 1.0, atol=1e-12)
        ),
    },
)

null_basis = Exercise(
    null_space,
    lambda: [(rows(*five_matches(9)),)],
    form=projector,
    praise="the true E is a combination of the four.",
    hint="A = U S Vᵀ has nine rows in Vᵀ but only five singular values; A maps the other four rows to 0.",
    line="np.linalg.svd(A)[2][5:]",
    library=("null_space",),
    slips={
        "transposed": "these are the right vectors, but as columns: return them as the four rows of a (4, 9) array."
    },
    mistakes={
        "these are columns of Vᵀ; its rows are the vectors.": lambda A: np.linalg.svd(A)[2][:, 5:],
        "these are the first four rows of Vᵀ, not the last four.": lambda A: np.linalg.svd(A)[2][:4],
        "A times the basis is not 0.": Condition(lambda basis, A: np.abs(A @ basis.T).max() > 1e-9),
        "the four vectors are not orthonormal.": Condition(lambda V, A: not np.allclose(V @ V.T, np.eye(4))),
    },
)

essential_constraints = Exercise(
    ten_constraints,
    essentials,
    form=up_to_scale,
    praise="ten cubics in the entries of E; `cubic_constraints` writes them in x, y, z, w.",
    hint="the matrix equation gives nine numbers, one for each entry; the determinant is the tenth.",
    line="np.append((E @ E.T @ E - 0.5 * np.trace(E @ E.T) * E).ravel(), np.linalg.det(E))",
    mistakes={
        "the factor of the trace is not ½: the singular values (1, 1, 0) should give 0.": (
            partial(ten_constraints, half=0.25),
            partial(ten_constraints, half=1.0),
            partial(ten_constraints, half=2.0),
            partial(ten_constraints, half=-0.5),
        ),
        "return the values of the equations themselves, with their signs.": lambda E: np.abs(
            ten_constraints(E)
        ),
        "for an essential matrix the first nine numbers are not all 0: check the transposes and the trace.": Condition(
            lambda got, E: np.abs(ten_constraints(E)).max() < 1e-9 < np.abs(got[:9]).max()
        ),
        "for an essential matrix the tenth number is {got[9]:.3g}, not 0: the determinant of a matrix of rank 2 "
        "is 0.": Condition(lambda got, E: np.abs(ten_constraints(E)).max() < 1e-9 < abs(got[9])),
        "these ten numbers are 0 for every essential matrix, but for other matrices of rank 2, too.": Condition(
            lambda got, E: np.abs(got).max() < 1e-9 < np.abs(ten_constraints(E)).max()
        ),
    },
)

hidden_matrix = Exercise(
    library.hidden_matrix,
    at_z,
    rtol=1e-9,
    praise="the determinant of this matrix is the polynomial of degree ten.",
    hint="the monomial xxz belongs to the column of x², with one factor z; zzw belongs to the column of 1, with z².",
    line='C[:, UNKNOWNS.index(name.replace("z", "").replace("w", ""))] += six[:, column] * z ** name.count("z")',
    library=("hidden_variable_matrix",),
    mistakes={
        "the powers of z are missing: xzz has the factor z², and zzz has z³.": all_linear_in_z,
        "z and w are exchanged: w is 1, so xxw has no factor, and xxz has the factor z.": powers_of_w,
        "the columns of `six` are MONOMIALS[4:]: the first four monomials are eliminated.": columns_from_the_start,
        "the columns are in another order: x², y², xy, x, y, 1.": (
            lambda six, z: library.hidden_matrix(six, z)[:, [0, 2, 1, 3, 4, 5]],
            lambda six, z: library.hidden_matrix(six, z)[:, ::-1],
            lambda six, z: library.hidden_matrix(six, z)[:, [0, 1, 2, 4, 3, 5]],
        ),
        "this is only the part without z: several monomials belong to one column; add their coefficients, `+=` "
        "instead of `=`.": lambda six, z: library.hidden_matrix(six, 0.0),
    },
)

solve_five = Exercise(
    library.solve_five,
    lambda: [five_matches(seed) for seed in range(8)],
    form=as_unit_vectors,
    atol=1e-4,
    praise="these are the library's solutions; the library solves hundreds of sets at once.",
    hint="each real root z gives one solution: compute x and y from the null vector of C(z).",
    line="v = np.linalg.svd(C(z))[2][-1]; E = np.tensordot([v[3] / v[5], v[4] / v[5], z, 1], basis, axes=1)",
    library=("five_point", "findEssentialMat", "real_roots", "eliminate", "determinant", "back_substitute"),
    slips={"transposed": "these are the transposes: vec(E) runs row by row, and a row of A has x_c first."},
    mistakes={
        "this is one of several solutions; return all real solutions: chapter 3 selects one of them.": (
            lambda *x: library.solve_five(*x)[:1],
            lambda *x: library.solve_five(*x)[-1:],
            lambda *x: library.solve_five(*x)[0],
        ),
        "every z is right, x and y are not. Either x and y are exchanged (the columns of C are those of x², y², xy, x, "
        "y, 1), or the null vector of C(z) is not divided by its last entry.": Condition(only_z_is_right),
        "these matrices do not fit the five matches: x_cᵀ E x_p is not 0. Is vec(E) read row by row, and are x_p and "
        "x_c in their places?": Condition(lambda E, *x: np.abs(rows(*x) @ as_unit_vectors(E).T).max() > 1e-4),
        "these matrices fit the five matches, but some are not essential: the ten constraints do not hold.": Condition(
            lambda E, x_p, x_c: (
                max(np.abs(ten_constraints(each.reshape(3, 3))).max() for each in as_unit_vectors(E)) > 1e-4
            )
        ),
    },
)

most_frequent_count = Exercise(
    lambda: np.argmax(np.bincount(counts())),
    praise="{right} real solutions are the most frequent number of 0, 2, 4, 6, 8 and 10.",
    hint="count the solutions of each set, then the sets with 0, 1, 2 … solutions.",
    line="np.argmax(np.bincount(np.bincount(solutions.set_index)))",
    mistakes={
        "this is the mean number; the task is the most frequent number.": lambda: counts().mean(),
        "this is the index of the set with the most solutions.": lambda: np.argmax(counts()),
        "this is a number of sets, not of solutions.": lambda: np.bincount(counts()).max(),
        "this is a share of the sets; the task is the number of solutions.": Condition(
            lambda got: 0 < got < 1
        ),
        "odd numbers hardly ever occur: complex roots come in pairs.": Condition(lambda got: got % 2 == 1),
    },
)

noise_factor = Exercise(
    lambda: median_error(0.4) / median_error(0.1),
    rtol=0.02,
    praise="{right:.2f}, for four times the noise: the rotation error grows nearly in proportion to it.",
    hint="compute the median error at both noises and divide.",
    line="ch02.median_error(0.4) / ch02.median_error(0.1)",
    mistakes={
        "a factor is the larger error divided by the smaller, not the inverse and not the difference.": (
            Condition(lambda got: 0 < got < 1),
            lambda: median_error(0.4) - median_error(0.1),
        ),
        "this is the error at one noise.": (lambda: median_error(0.4), lambda: median_error(0.1)),
        "this is no measurement: measure the factor of the error.": Condition(lambda got: got in (3, 4)),
    },
)

far_off = Exercise(
    {FIRST: 2.5, "noise added": 0.0, "outliers among the five": 0.0, "closest two of the five": 50.0},
    praise="{rotation error of solution 1:.1f}° from five correct matches: small errors of their places become large "
    "errors of the rotation. Only the other matches show that this set is bad.",
    mistakes={
        "there is no ground truth: choose another sequence.": lambda now: np.isnan(now[FIRST]),
        "{noise added:.2f} px of noise are added: set the noise to 0.": lambda now: now["noise added"] != 0,
        "solution 1 of these five matches is only {rotation error of solution 1:.2f}° wrong; the task is more than 2°. "
        "The slider `solution` does not help: choose five other matches. Which matches determine the rotation "
        "badly?": lambda now: not now[FIRST] > 2.0,
        "outliers among the five: {outliers among the five:.0f}. One outlier makes a set bad; find five correct "
        "matches with a similar error.": lambda now: now["outliers among the five"] > 0,
        "two of the five are only {closest two of the five:.1f} px apart. Neighbours give nearly the same equation; find "
        "five matches at least 40 px apart.": lambda now: now["closest two of the five"] < 40,
    },
)
