"""Selection of an essential matrix from many candidates, and its rotation (chapter 3; paper, section 2.2).

Of each five-point set, only the k candidates nearest to the previous frame's essential vector are kept. That
vector is called the prior. The paper speaks of "vectors from the two previous frames"; we read this as one
vector, which belongs to the motion between these two frames. Of the paper's letters, n and N are the number
of sets, and m is the number of a set's solutions, which the first paragraph of section 2.2 calls N as well.

Among the kept candidates of all sets, the one with the smallest error wins; it is the paper's basis vector.
The paper first takes the best of each set and then one of these. By the same error, that is the same winner.
Which error is meant, the paper does not say. We take the mean of the squared Sampson distances, each
truncated at a threshold, over the used matches of the frame, which are left after steps 1 and 2 of
`odometry`.

Without the prior, and with the number of inliers in place of the error, the same steps are RANSAC, which is
how we read MESVO_F.
"""

from __future__ import annotations

import numpy as np

from ..geometry.motion import decompose_essential, essential_angle, essential_vector
from ..geometry.types import Array, BoolArray, Index
from .buckets import ranks_in_groups
from .sampson import Floats, candidate_terms, match_terms, sampson_distance, squared_distances
from .settings import SelectionConfig


def draw_sets(rng: np.random.Generator, number: int, sets: int) -> Index:
    """Random sets (sets, 5) of five different indices below `number`; all sets are equally likely."""
    # Draw `number` random numbers for each set: the places of the five smallest ones are the set.
    return np.argpartition(rng.random((sets, number)), 4, axis=1)[:, :5]


def truncated_errors(E: Array, x_p: Array, x_c: Array, threshold: float) -> Array:
    """For each candidate, the mean over the matches of the truncated squared Sampson distance, (M,).

    Parameters
    ----------
    E : (M, 3, 3) candidates; x_p, x_c : (N, 2) normalised points.
    threshold : distance, in the unit of the points, at which the error of a match is truncated.

    Returns
    -------
    mean(min(d² / threshold², 1)), in [0, 1]: an outlier costs 1, however far off it is.
    """
    # Single precision is enough for a ranking, and twice as fast.
    d2 = squared_distances(candidate_terms(E, np.float32), match_terms(x_p, x_c, np.float32))
    return truncated_mean(d2, threshold)


def truncated_mean(squared: Floats, threshold: float) -> Array:
    """mean(min(d² / threshold², 1)) over the last axis of squared distances d² (…, N).

    To save memory, `squared` itself is truncated.
    """
    np.minimum(squared, squared.dtype.type(threshold**2), out=squared)
    return np.asarray(squared.mean(axis=-1, dtype=np.float64) / threshold**2)


def outlier_shares(E: Array, x_p: Array, x_c: Array, threshold: float) -> Array:
    """For each candidate, the share (M,) of outliers; parameters as in `truncated_errors`.

    The candidate with the smallest share has the most inliers; RANSAC selects this candidate.
    """
    d2 = squared_distances(candidate_terms(E, np.float32), match_terms(x_p, x_c, np.float32))
    return np.asarray((d2 >= d2.dtype.type(threshold**2)).mean(axis=1))


# The function that the winner minimises, for each value of `selection.winner`.
WINNER_CRITERIA = {"error": truncated_errors, "inliers": outlier_shares}


def sampson_inliers(E: Array, x_p: Array, x_c: Array, threshold: float) -> BoolArray:
    """Mask (N,) of the matches (x_p, x_c), normalised points (N, 2), whose distance to E (3, 3) is small.

    threshold : Sampson distance, in the unit of the points, that an inlier stays below.
    """
    return np.asarray(np.abs(sampson_distance(E, x_p, x_c)) < threshold)


def nearest_to_prior(E: Array, set_index: Index, e_prev: Array, top_k: int) -> BoolArray:
    """Solution selection: the `top_k` candidates of each set nearest to the previous essential vector.

    The nearest are those with the smallest angle acos|eᵀ e_prev| between the two vectors.

    Parameters
    ----------
    E : (M, 3, 3) candidates; set_index : (M,) the set of each candidate.
    e_prev : (9,) essential vector of the previous frame (the paper's E_prev).

    Returns
    -------
    Mask (M,) of the nearest candidates.
    """
    angle = essential_angle(essential_vector(E), e_prev)
    order = np.lexsort((angle, set_index))  # by set, in a set by angle
    rank = ranks_in_groups(set_index[order])
    kept = np.zeros(len(order), np.bool_)
    kept[order[rank < top_k]] = True
    return kept


def candidates_near_prior(
    E: Array, set_index: Index, e_prev: Array | None, config: SelectionConfig
) -> BoolArray:
    """Mask (M,) of the candidates that may win: those near the prior `e_prev` (9,).

    Before the first winner there is no `e_prev`, and `config.prior` may be off: then all candidates may win.
    """
    if not config.prior or e_prev is None:
        return np.ones(len(E), np.bool_)
    return nearest_to_prior(E, set_index, e_prev, config.top_k)


def resolve_by_depth(E: Array, x_c: Array, X_p: Array) -> tuple[Array, Array]:
    """The motion, among the four (R, ±t) of E, that agrees with the stereo depth of the matches.

    Parameters
    ----------
    E : (3, 3) essential matrix.
    x_c : (N, 2) normalised points of the current left image.
    X_p : (N, 3) their points in the axes of the previous left camera, from stereo, metres.

    Returns
    -------
    R_cp (3, 3) and the unit direction of t_cp (3,).

    Notes
    -----
    Let `ray` be the unit vector along (x_c, 1). For each of the two rotations R, the length s of the
    translation is the weighted least-squares solution of ray × (R X_p + s t) = 0 over all matches, with the
    weights 1 / ‖X_p‖², since nearer points determine the length better. A negative s means that -t is right.
    The right rotation is the one with the smallest median angle between `ray` and the moved point
    R X_p + s t.

    Points without a depth, whose X_p is NaN, say nothing on this and are left out. If no point has a depth,
    the choice stays open, and the first rotation and t are returned: such points do not give a translation
    either.
    """
    rotations, t = decompose_essential(E)
    has_depth = np.isfinite(X_p).all(axis=1)  # a single NaN would make every sum NaN
    if not has_depth.any():
        return rotations[0], t
    x_c = x_c[has_depth]
    X_p = X_p[has_depth]
    ray = np.concatenate([x_c, np.ones((len(x_c), 1))], axis=1)
    ray /= np.linalg.norm(ray, axis=1, keepdims=True)
    ray_t = ray @ t  # dot products (N,) are named after both vectors; X in these names is R X
    squared_length = np.maximum(np.sum(X_p**2, axis=1), 1e-12)
    best_cosine = -np.inf  # of the median angle
    best_R = rotations[0]
    best_t = t
    for R in rotations:
        rotated = X_p @ R.T
        ray_X = np.sum(ray * rotated, axis=1)
        t_X = rotated @ t
        # s = -Σ (ray × t)·(ray × R X) / ‖X‖² divided by Σ ‖ray × t‖² / ‖X‖². For the unit vector `ray`,
        # (ray × a)·(ray × b) = a·b - (ray·a)(ray·b).
        numerator = np.sum((t_X - ray_t * ray_X) / squared_length)
        denominator = max(np.sum((1.0 - ray_t**2) / squared_length), 1e-12)
        s = -numerator / denominator
        moved_length = np.sqrt(np.maximum(squared_length + 2.0 * s * t_X + s * s, 1e-12))
        cosine = float(np.median((ray_X + s * ray_t) / moved_length))
        if cosine > best_cosine:
            best_cosine = cosine
            best_R = R
            best_t = t if s >= 0 else -t
    return best_R, best_t
