"""Chapters 3, 4 and 7: simulated drives, what solution selection is worth on them, and estimated rotations."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from course.simulation.problems import random_problems
from course.simulation.tracks import SimulatedFrame, TrackConfig, simulate_tracks
from vo_lib.geometry.camera import StereoCamera
from vo_lib.geometry.matches import StereoMatches
from vo_lib.geometry.motion import essential_vector, rigid, rotation_angle, rotation_from_vector
from vo_lib.geometry.types import Array
from vo_lib.kit.selection import choose, motion_of_winner, sample_sets
from vo_lib.kit.settings import KitSelectionConfig
from vo_lib.paper.five_point import five_point

from .frames import consensus_rotation

CAMERA = StereoCamera(f=718.856, cx=607.19, cy=185.22, baseline=0.537, width=1241, height=376)


class Pair(NamedTuple):
    """Matches of one frame with its known rotation: x_p, x_c (N, 2) normalised, X_p (N, 3) metres, R_cp."""

    x_p: Array
    x_c: Array
    X_p: Array
    R_cp: Array


@dataclass(frozen=True)
class Scene:
    """Simulated matches along `drive`, with sharp turns or not; or, `plane`, of a plane that fills the view.

    A wall, or the rear of a lorry: two essential matrices then fit all matches.
    """

    tracks: TrackConfig
    sharp: bool = False
    plane: bool = False


def selections(mode: str = "literal") -> dict[str, KitSelectionConfig]:
    """The ways to choose a winner that are compared: all candidates, or the k nearest of each set."""
    nearest = {f"k = {keep}": KitSelectionConfig(mode=mode, keep=keep) for keep in (1, 2)}
    return {"consensus": KitSelectionConfig(mode=mode, prior=False), **nearest}


def drive(frames: int, sharp: bool = False) -> Array:
    """Poses (N, 4, 4) of steps of one metre on gentle bends or, `sharp`, with turns of 4° a frame."""
    number = np.arange(frames)
    yaw = np.where(number % 20 >= 10, 4.0, 0.0) if sharp else 0.4 * np.sin(number / 5.0)
    poses = np.tile(np.eye(4), (frames + 1, 1, 1))
    for i, angle in enumerate(np.radians(yaw)):
        step = rigid(rotation_from_vector(np.array([0.0, angle, 0.0])), np.array([0.0, 0.0, 1.0]))
        poses[i + 1] = poses[i] @ step
    return poses


def frames_of(scene: Scene, frames: int, seed: int) -> Iterator[Pair]:
    """Matches of a scene, frame by frame."""
    if scene.plane:
        count = scene.tracks.points
        given = random_problems(
            np.random.default_rng(seed), frames, count, "planar_forward", noise_px=scene.tracks.noise
        )
        yield from map(Pair, given.x_p, given.x_c, given.X_p, given.R_cp)
        return
    for frame in simulate_tracks(drive(frames, scene.sharp), CAMERA, scene.tracks, seed):
        yield _pair(frame.matches, frame.T_cp[:3, :3])


def _pair(matches: StereoMatches, R_cp: Array) -> Pair:
    X_p = CAMERA.triangulate(matches.prev_left, matches.prev_right)
    near = np.isfinite(X_p[:, 2])
    x_p, x_c = CAMERA.normalise(matches.prev_left[near]), CAMERA.normalise(matches.cur_left[near])
    return Pair(x_p, x_c, X_p[near], R_cp)


def selection_errors(
    scene: Scene, configs: dict[str, KitSelectionConfig], frames: int, seed: int
) -> dict[str, Array]:
    """Rotation error of each frame, (frames,) degrees, by selection; all choose from the same candidates."""
    e_prev: dict[str, Array | None] = dict.fromkeys(configs)
    errors: dict[str, list[float]] = {name: [] for name in configs}
    for number, pair in enumerate(frames_of(scene, frames, seed)):
        sets = sample_sets(np.random.default_rng([seed, number]), len(pair.x_p), 200)
        E, set_index = five_point(pair.x_p[sets], pair.x_c[sets])
        known: dict[tuple[int, str], tuple[float, Array]] = {}
        for name, config in configs.items():
            winner, _ = choose(E, set_index, pair.x_p, pair.x_c, e_prev[name], config, CAMERA.f)
            if (winner, config.mode) not in known:
                R, _, best, _ = motion_of_winner(E[winner], pair.x_p, pair.x_c, pair.X_p, config, CAMERA.f)
                error = float(np.degrees(rotation_angle(R.T @ pair.R_cp)))
                known[winner, config.mode] = error, essential_vector(best)
            error, e_prev[name] = known[winner, config.mode]
            errors[name].append(error)
    return {name: np.array(values) for name, values in errors.items()}


def estimated_rotations(
    poses: Array, tracks: TrackConfig, seed: int
) -> Iterator[tuple[SimulatedFrame, Array]]:
    """Simulated frames along a path, each with the rotation (3, 3) of the candidate that fits its matches best."""
    for frame in simulate_tracks(poses, CAMERA, tracks, seed):
        x_p, x_c, X_p, _ = _pair(frame.matches, frame.T_cp[:3, :3])
        yield frame, consensus_rotation(x_p, x_c, X_p, np.random.default_rng([seed, frame.frame]), CAMERA.f)
