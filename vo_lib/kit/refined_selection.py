"""Selection with a prior that may be dropped, and a refined winner (chapters 2 and 3, not in the paper).

In a frame whose best candidate near the prior is clearly worse than the best of all, the prior is dropped.
The winner is then refined on its inliers.
"""

from __future__ import annotations

import math

import numpy as np

from ..geometry.motion import DEVIATION_OVER_MEDIAN, essential_from_motion
from ..geometry.types import Array, BoolArray, Index
from ..paper.sampson import MatchTerms, candidate_terms, match_terms, squared_distances
from ..paper.selection import WINNER_CRITERIA, candidates_near_prior, resolve_by_depth
from .refinement import refine
from .settings import KitSelectionConfig

COARSE_ITERATIONS = 3  # iterations of the first, coarse refinement
MIN_DEVIATION = 1e-3  # lower bound of the estimated noise, as a multiple of the threshold


def sample_sets(rng: np.random.Generator, number: int, sets: int) -> Index:
    """Indices (sets, 5): for each set, five different indices below `number`, which is 5 or more.

    The sets are consecutive parts of random permutations, so that all features are used about equally often.
    """
    sets_per_permutation = number // 5
    permutations = math.ceil(sets / sets_per_permutation)
    order = rng.permuted(np.tile(np.arange(number), (permutations, 1)), axis=1)
    return order[:, : 5 * sets_per_permutation].reshape(-1, 5)[:sets]


def choose_candidate(
    E: Array,
    set_index: Index,
    x_p: Array,
    x_c: Array,
    e_prev: Array | None,
    config: KitSelectionConfig,
    focal: float,
) -> tuple[int, bool]:
    """The best candidate near the prior; the best of all if there is no prior, or if the prior is dropped.

    The steps are those of section 2.2 of the paper; the paper never drops the prior.

    Parameters
    ----------
    E, set_index : all candidates of a frame (M, 3, 3) and their sets (M,), from `five_point`.
    x_p, x_c : (N, 2) normalised points.
    e_prev : (9,) previous essential vector, the prior; None if there is none.
    focal : focal length, pixels.

    Returns
    -------
    The winner's index, and whether the prior was dropped.
    """
    errors = WINNER_CRITERIA[config.winner](E, x_p, x_c, config.threshold / focal)
    near_prior = candidates_near_prior(E, set_index, e_prev, config)
    return choose_unless_prior_bad(errors, near_prior, config.prior_rejection_ratio)


def choose_unless_prior_bad(errors: Array, near_prior: BoolArray, ratio: float) -> tuple[int, bool]:
    """Index of the winner, and whether the prior is dropped.

    The best candidate near the prior wins, unless its error exceeds `ratio` times the smallest error of all,
    as in a sharp turn: then the prior is dropped, and the best of all wins.

    errors : (M,) of the candidates; near_prior : (M,) mask of those near the prior.
    """
    best = int(np.argmin(errors))
    best_near_prior = int(np.argmin(np.where(near_prior, errors, np.inf)))
    if errors[best_near_prior] > ratio * errors[best]:
        return best, True
    return best_near_prior, False


def motion_of_candidate(
    E: Array, x_p: Array, x_c: Array, X_p: Array, config: KitSelectionConfig, focal: float
) -> tuple[Array, Array, Array, BoolArray]:
    """Rotation (3, 3), unit translation (3,), essential matrix (3, 3), inliers (N,) of a candidate.

    Mode `literal` keeps E unchanged; mode `refined` refines E on its inliers.

    Parameters
    ----------
    E : (3, 3) the candidate; x_p, x_c : (N, 2) normalised points; X_p : (N, 3) points, metres, of the
        previous left frame. focal : focal length, pixels.
    """
    threshold = config.threshold / focal
    matches = match_terms(x_p, x_c)
    inliers = _squared_distances_to(E, matches) < threshold**2
    trusted = np.flatnonzero(inliers)
    if len(trusted) < 5:
        trusted = np.arange(len(inliers))
    R, t = resolve_by_depth(E, x_c[trusted], X_p[trusted])
    if config.mode == "refined":
        # A coarse refinement, then one with a scale from the noise: features on a slow car may be inliers of
        # the threshold, and only a scale near the noise gives them a low weight.
        trusted_matches = matches.take(trusted)
        R, t = refine(R, t, trusted_matches, threshold / 2, COARSE_ITERATIONS)
        squared = _squared_distances_to(essential_from_motion(R, t), trusted_matches)
        deviation = DEVIATION_OVER_MEDIAN * float(np.sqrt(np.median(squared)))
        scale = min(config.refine_scale * max(deviation, MIN_DEVIATION * threshold), threshold / 2)
        R, t = refine(R, t, trusted_matches, scale)
        E = essential_from_motion(R, t)
        inliers = _squared_distances_to(E, matches) < threshold**2
    return R, t, E, inliers


def _squared_distances_to(E: Array, matches: MatchTerms) -> Array:
    """Squared Sampson distances (N,) to one E (3, 3)."""
    return np.asarray(squared_distances(candidate_terms(E[None]), matches)[0], np.float64)
