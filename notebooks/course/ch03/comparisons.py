"""Chapter 3: errors of several selections on simulated drives, and where adaptive stopping ends."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from vo_lib.geometry.types import Array, Progress
from vo_lib.paper.five_point import Candidates
from vo_lib.paper.selection import outlier_shares, truncated_errors
from vo_lib.paper.settings import SelectionConfig

from ..candidates import candidates_of, motion_of, winner_of
from ..frames import Points
from ..rotation_errors import angle_between
from ..simulation.drives import CAMERA, Scene, SimulatedPoints, points_by_frame

SETS = 200  # of five matches for each simulated frame

# Compared selections of a winner: among all candidates, or among the k nearest of each set.
SELECTIONS = {
    "consensus": SelectionConfig(prior=False),
    "k = 1": SelectionConfig(top_k=1),
    "k = 2": SelectionConfig(top_k=2),
}


def selection_errors(
    scene: Scene, selections: Mapping[str, SelectionConfig], frames: int, seed: int
) -> dict[str, Array]:
    """Rotation error of each frame (frames,), degrees, by selection; all selections have the same candidates."""
    e_prev: dict[str, Array | None] = dict.fromkeys(selections)
    errors: dict[str, list[float]] = {name: [] for name in selections}
    thresholds = {config.threshold for config in selections.values()}
    for number, points in enumerate(points_by_frame(scene, frames, seed)):
        candidates = candidates_of(points, SETS, 1000 * seed + number)
        truncated = {}
        for threshold in thresholds:
            limit = threshold / CAMERA.f
            truncated[threshold] = truncated_errors(candidates.E, points.x_p, points.x_c, limit)
        for name, config in selections.items():
            winner, _ = winner_of(candidates, truncated[config.threshold], e_prev[name], config)
            R_cp, e_prev[name], _ = motion_of(candidates.E[winner], points, config, CAMERA.f)
            errors[name].append(angle_between(R_cp, points.R_cp))
    return {name: np.array(values) for name, values in errors.items()}


def median_errors_by_seed(
    scenes: list[Scene], frames: int, seeds: int, progress: Progress
) -> dict[str, Array]:
    """Median rotation error over the frames, degrees: an array (seeds, scenes) for each of `SELECTIONS`."""
    medians = {name: np.zeros((seeds, len(scenes))) for name in SELECTIONS}
    for seed in range(seeds):
        for number, scene in enumerate(scenes):
            progress(seed * len(scenes) + number, seeds * len(scenes))
            for name, errors in selection_errors(scene, SELECTIONS, frames, seed).items():
                medians[name][seed, number] = np.median(errors)
    return medians


def adaptive_stopping(
    candidates: Candidates, points: Points | SimulatedPoints, limit: float, orders: int
) -> tuple[Array, Array, Array]:
    """Number of sets that adaptive stopping draws, for several orders of the same sets.

    Parameters
    ----------
    limit : largest Sampson distance of an inlier, normalised units.
    orders : number of random orders.

    Returns
    -------
    needed : (orders, sets) sets required for one right set with 99 % probability, after each drawn set.
    best : (orders, sets) smallest image error so far.
    stop : (orders,) number of sets drawn when no more are required; all sets if that is never so.
    """
    sets, first = np.unique(candidates.set_index, return_index=True)
    order = np.array([np.random.default_rng(seed).permutation(len(sets)) for seed in range(orders)])

    def smallest_so_far(of_candidates: Array) -> Array:
        of_sets = np.minimum.reduceat(of_candidates, first)
        return np.minimum.accumulate(of_sets[order], axis=1)

    outlier_share = smallest_so_far(outlier_shares(candidates.E, points.x_p, points.x_c, limit))
    best = smallest_so_far(truncated_errors(candidates.E, points.x_p, points.x_c, limit))
    right_sets = np.clip(1.0 - outlier_share, 1e-3, 1.0 - 1e-9) ** 5
    needed = np.log(0.01) / np.log1p(-right_sets)
    is_enough = needed <= np.arange(1, len(sets) + 1)
    stop = np.where(is_enough.any(axis=1), 1 + is_enough.argmax(axis=1), len(sets))
    return needed, best, stop
