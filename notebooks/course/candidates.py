"""Solution selection on the matches of one frame, step by step: sets of five, their solutions, winner, motion."""

from __future__ import annotations

import numpy as np

from vo_lib.errors import DataError
from vo_lib.geometry.motion import essential_vector
from vo_lib.geometry.types import Array, BoolArray, Index
from vo_lib.kit.refined_selection import choose_unless_prior_bad, motion_of_candidate, sample_sets
from vo_lib.kit.settings import KitSelectionConfig
from vo_lib.paper.five_point import Candidates, five_point
from vo_lib.paper.selection import (
    candidates_near_prior,
    draw_sets,
    resolve_by_depth,
    sampson_inliers,
    truncated_errors,
)
from vo_lib.paper.settings import SelectionConfig

from .frames import Points
from .simulation.drives import SimulatedPoints


def sets_of_five(x_c: Array, seed: int | list[int], sets: int, side_by_side: bool = False) -> Index:
    """Indices (sets, 5) of random matches with current points x_c (N, 2).

    If `side_by_side`, a set is the first of its random matches with the four that are nearest to it.
    """
    chosen = draw_sets(np.random.default_rng(seed), len(x_c), sets)
    if not side_by_side:
        return chosen
    away = np.linalg.norm(x_c[chosen[:, :1]] - x_c, axis=2)
    return np.argsort(away, axis=1)[:, :5]


def candidates_of(points: Points | SimulatedPoints, sets: int, draw: int) -> Candidates:
    """All solutions of `sets` random five-point sets of a frame, with the seed `draw`; `DataError` without any."""
    # The 5 stands for these sets: what a panel draws otherwise, such as its noise, has another number before `draw`.
    chosen = sets_of_five(points.x_c, [5, draw], sets)
    candidates = five_point(points.x_p[chosen], points.x_c[chosen])
    if len(candidates.E) == 0:
        raise DataError(
            "no five of the matches determine an essential matrix: the camera may stand still; choose another frame"
        )
    return candidates


def first_of_each_set(errors: Array, set_index: Index, count: int = 1) -> BoolArray:
    """Mask (M,) of the candidates with the `count` smallest errors in their set."""
    order = np.lexsort((errors, set_index))
    rank = np.arange(len(order)) - np.searchsorted(set_index[order], set_index[order])
    return np.isin(np.arange(len(order)), order[rank < count])


def winner_of(
    candidates: Candidates, errors: Array, e_prev: Array | None, config: SelectionConfig
) -> tuple[int, bool]:
    """Index of the winner among candidates with image errors (M,), and whether variant `kit` dropped the prior.

    e_prev : (9,) essential vector of the previous frame, the prior; None without one.
    """
    ratio = np.inf
    if isinstance(config, KitSelectionConfig):
        ratio = config.prior_rejection_ratio
    near = candidates_near_prior(candidates.E, candidates.set_index, e_prev, config)
    return choose_unless_prior_bad(errors, near, ratio)


def motion_of(
    E: Array, points: Points | SimulatedPoints, config: SelectionConfig, focal: float
) -> tuple[Array, Array, BoolArray]:
    """From a winner E (3, 3): R_cp (3, 3), the essential vector (9,) to store, and the inlier mask (N,).

    focal : focal length, pixels, with which the threshold of `config` becomes normalised units.
    """
    x_p = points.x_p
    x_c = points.x_c
    X_p = points.X_p
    if isinstance(config, KitSelectionConfig):
        R, _, E, inliers = motion_of_candidate(E, x_p, x_c, X_p, config, focal)
    else:
        inliers = sampson_inliers(E, x_p, x_c, config.threshold / focal)
        R, _ = resolve_by_depth(E, x_c[inliers], X_p[inliers])
    return R, essential_vector(E), inliers


def consensus_rotation(points: Points | SimulatedPoints, rng: np.random.Generator, focal: float) -> Array:
    """R_cp (3, 3) of the candidate with the smallest image error over all matches, refined as in variant `kit`.

    focal : focal length, pixels.
    """
    config = KitSelectionConfig()
    sets = sample_sets(rng, len(points.x_p), config.sets)
    E, _ = five_point(points.x_p[sets], points.x_c[sets])
    winner = E[np.argmin(truncated_errors(E, points.x_p, points.x_c, config.threshold / focal))]
    R_cp, _, _ = motion_of(winner, points, config, focal)
    return R_cp
