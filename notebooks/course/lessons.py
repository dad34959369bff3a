"""Drives without images: their matches frame by frame, and the steps of solution selection on them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import accumulate
from typing import NamedTuple

import numpy as np

from course.simulation.problems import random_problems
from course.simulation.tracks import SimulatedFrame, TrackConfig, simulate_tracks
from vo_lib.data.scenes import scene_config
from vo_lib.errors import DataError
from vo_lib.geometry.camera import StereoCamera
from vo_lib.geometry.motion import essential_vector, rigid, rotation_angle, rotation_from_vector
from vo_lib.geometry.types import Array, BoolArray, Progress
from vo_lib.kit.refined_selection import choose_unless_prior_bad, motion_of_candidate, sample_sets
from vo_lib.kit.settings import KitSelectionConfig
from vo_lib.paper.five_point import Candidates, five_point
from vo_lib.paper.selection import (
    candidates_near_prior,
    draw_sets,
    outlier_shares,
    resolve_by_depth,
    sampson_inliers,
    truncated_errors,
)
from vo_lib.paper.settings import SelectionConfig
from vo_street.route import make_drive, make_route

from .frames import Points

SETS = 200  # of five matches for each simulated frame
CAMERA = StereoCamera(f=718.856, cx=607.19, cy=185.22, baseline=0.537, width=1241, height=376)


class Pair(NamedTuple):
    """Matches of a frame and its true rotation: x_p, x_c (N, 2) normalised, X_p (N, 3) metres, R_cp."""

    x_p: Array
    x_c: Array
    X_p: Array
    R_cp: Array


@dataclass(frozen=True)
class Scene:
    """Settings of simulated matches along `drive`; if `plane`, all points are on a plane that fills the view.

    For a plane (a wall, the rear of a lorry), two essential matrices fit all matches.
    """

    tracks: TrackConfig
    plane: bool = False


# Compared selections of a winner: among all candidates, or among the k nearest of each set.
SELECTIONS = {
    "consensus": SelectionConfig(prior=False),
    "k = 1": SelectionConfig(top_k=1),
    "k = 2": SelectionConfig(top_k=2),
}


def candidates_of(points: Points | Pair, sets: int, draw: int) -> Candidates:
    """All solutions of random five-point sets of a frame; `DataError` if there are none."""
    chosen = draw_sets(np.random.default_rng([5, draw]), len(points.x_p), sets)
    candidates = five_point(points.x_p[chosen], points.x_c[chosen])
    if len(candidates.E) == 0:
        raise DataError(
            "no five of the matches determine an essential matrix: the camera may stand still; choose another frame"
        )
    return candidates


def winner_of(
    candidates: Candidates, errors: Array, e_prev: Array | None, config: SelectionConfig
) -> tuple[int, bool]:
    """Index of the winner among candidates with errors (M,), and whether variant `kit` dropped the prior."""
    ratio = np.inf
    if isinstance(config, KitSelectionConfig):
        ratio = config.prior_rejection_ratio
    near = candidates_near_prior(candidates.E, candidates.set_index, e_prev, config)
    return choose_unless_prior_bad(errors, near, ratio)


def motion_of(
    E: Array, points: Points | Pair, config: SelectionConfig, focal: float
) -> tuple[Array, Array, BoolArray]:
    """From a winner E (3, 3): R_cp (3, 3), the essential vector (9,) to store, and the inlier mask (N,)."""
    x_p = points.x_p
    x_c = points.x_c
    X_p = points.X_p
    if isinstance(config, KitSelectionConfig):
        R, _, E, inliers = motion_of_candidate(E, x_p, x_c, X_p, config, focal)
    else:
        inliers = sampson_inliers(E, x_p, x_c, config.threshold / focal)
        R, _ = resolve_by_depth(E, x_c[inliers], X_p[inliers])
    return R, essential_vector(E), inliers


def consensus_rotation(points: Points | Pair, rng: np.random.Generator, focal: float) -> Array:
    """Refined R_cp (3, 3) of the candidate with the smallest error over all matches of a frame."""
    config = KitSelectionConfig()
    sets = sample_sets(rng, len(points.x_p), config.sets)
    E, _ = five_point(points.x_p[sets], points.x_c[sets])
    winner = E[np.argmin(truncated_errors(E, points.x_p, points.x_c, config.threshold / focal))]
    R_cp, _, _ = motion_of(winner, points, config, focal)
    return R_cp


def drive(frames: int) -> Array:
    """Poses (frames + 1, 4, 4) with steps of one metre on gentle bends."""
    turns = np.zeros((frames, 3))  # rotation vectors of the steps
    turns[:, 1] = np.radians(0.4 * np.sin(np.arange(frames) / 5.0))
    steps = np.tile(rigid(np.eye(3), np.array([0.0, 0.0, 1.0])), (frames, 1, 1))
    steps[:, :3, :3] = rotation_from_vector(turns)
    return np.array([*accumulate(steps, np.matmul, initial=np.eye(4))])


def path_of(scene: str) -> Array:
    """The true poses (N, 4, 4) of a drawn scene by name ("hard"); no image is drawn."""
    config = scene_config(scene)
    return make_drive(config, make_route(config)).poses


def frames_of(scene: Scene, frames: int, seed: int) -> Iterator[Pair]:
    """Matches of a scene, frame by frame."""
    if scene.plane:
        rng = np.random.default_rng(seed)
        count = scene.tracks.points
        noise = scene.tracks.noise
        problems = random_problems(rng, frames, count, "planar_forward", noise_px=noise)
        yield from map(Pair, problems.x_p, problems.x_c, problems.X_p, problems.R_cp)
        return
    yield from map(pair_of, simulate_tracks(drive(frames), CAMERA, scene.tracks, seed))


def angle_between(R: Array, R_other: Array | None) -> float:
    """Angle between two rotations (3, 3), degrees; NaN if the second rotation is None."""
    return np.nan if R_other is None else float(np.degrees(rotation_angle(R.T @ R_other)))


def pair_of(frame: SimulatedFrame) -> Pair:
    """The matches of a simulated frame that have a depth."""
    X_p = CAMERA.triangulate(frame.matches.prev_left, frame.matches.prev_right)
    has_depth = np.isfinite(X_p[:, 2])
    matches = frame.matches[has_depth]
    x_p = CAMERA.normalise(matches.prev_left)
    x_c = CAMERA.normalise(matches.cur_left)
    return Pair(x_p, x_c, X_p[has_depth], frame.T_cp[:3, :3])


def selection_errors(
    scene: Scene, selections: Mapping[str, SelectionConfig], frames: int, seed: int
) -> dict[str, Array]:
    """Rotation error of each frame (frames,), degrees, by selection; all selections have the same candidates."""
    e_prev: dict[str, Array | None] = dict.fromkeys(selections)
    errors: dict[str, list[float]] = {name: [] for name in selections}
    thresholds = {config.threshold for config in selections.values()}
    for number, pair in enumerate(frames_of(scene, frames, seed)):
        candidates = candidates_of(pair, SETS, 1000 * seed + number)
        truncated = {}
        for threshold in thresholds:
            limit = threshold / CAMERA.f
            truncated[threshold] = truncated_errors(candidates.E, pair.x_p, pair.x_c, limit)
        for name, config in selections.items():
            winner, _ = winner_of(candidates, truncated[config.threshold], e_prev[name], config)
            R_cp, e_prev[name], _ = motion_of(candidates.E[winner], pair, config, CAMERA.f)
            errors[name].append(angle_between(R_cp, pair.R_cp))
    return {name: np.array(values) for name, values in errors.items()}


def errors_by_seed(scenes: list[Scene], frames: int, seeds: int, progress: Progress) -> dict[str, Array]:
    """Median rotation error over the frames, degrees: an array (seeds, scenes) for each selection."""
    medians = {name: np.zeros((seeds, len(scenes))) for name in SELECTIONS}
    for seed in range(seeds):
        for number, scene in enumerate(scenes):
            progress(seed * len(scenes) + number, seeds * len(scenes))
            for name, errors in selection_errors(scene, SELECTIONS, frames, seed).items():
                medians[name][seed, number] = np.median(errors)
    return medians


def adaptive_stopping(candidates: Candidates, points: Points, limit: float, orders: int) -> tuple[Array, ...]:
    """Number of sets that adaptive stopping draws, for several orders of the same sets.

    Parameters
    ----------
    limit : largest Sampson distance of an inlier, normalised units.
    orders : number of random orders.

    Returns
    -------
    needed : (orders, sets) sets required for one right set with 99 % probability, after each drawn set.
    best : (orders, sets) smallest image error so far.
    stop : (orders,) number of sets drawn when no more are required.
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
    stop = 1 + is_enough.argmax(axis=1)
    return needed, best, stop
