"""Simulated drives: matches along a path, without images, and the paths of drawn scenes."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import accumulate
from typing import NamedTuple

import numpy as np

from vo_lib.data.scenes import scene_config
from vo_lib.geometry.camera import StereoCamera
from vo_lib.geometry.motion import rigid, rotation_from_vector
from vo_lib.geometry.types import Array
from vo_street.route import make_drive, make_route

from .problems import random_problems
from .tracks import SimulatedFrame, TrackConfig, simulate_tracks

CAMERA = StereoCamera(f=718.856, cx=607.19, cy=185.22, baseline=0.537, width=1241, height=376)


class SimulatedPoints(NamedTuple):
    """Matches of a simulated frame: x_p, x_c (N, 2) normalised, X_p (N, 3) metres; and R_cp (3, 3), which is true."""

    x_p: Array
    x_c: Array
    X_p: Array
    R_cp: Array


@dataclass(frozen=True)
class Scene:
    """Settings of simulated matches along `drive`.

    If `plane`, every frame is instead a problem of its own: one metre ahead with a random rotation, and all points
    are on a plane that fills the view (a wall, the rear of a lorry), so that two essential matrices fit all
    matches. Of `tracks`, only `points` and `noise` count then.
    """

    tracks: TrackConfig
    plane: bool = False


def drive(frames: int) -> Array:
    """Poses (frames + 1, 4, 4): as many steps of one metre as `frames` says, on gentle bends."""
    turns = np.zeros((frames, 3))  # rotation vectors of the steps
    turns[:, 1] = np.radians(0.4 * np.sin(np.arange(frames) / 5.0))
    steps = np.tile(rigid(np.eye(3), np.array([0.0, 0.0, 1.0])), (frames, 1, 1))
    steps[:, :3, :3] = rotation_from_vector(turns)
    return np.array([*accumulate(steps, np.matmul, initial=np.eye(4))])


def path_of(scene: str) -> Array:
    """The true poses (N, 4, 4) of a drawn scene by name ("hard"); no image is drawn."""
    config = scene_config(scene)
    return make_drive(config, make_route(config)).poses


def points_by_frame(scene: Scene, frames: int, seed: int) -> Iterator[SimulatedPoints]:
    """The matches of a scene, frame by frame."""
    if scene.plane:
        rng = np.random.default_rng(seed)
        count = scene.tracks.points
        noise = scene.tracks.noise
        problems = random_problems(rng, frames, count, "planar_forward", noise_px=noise)
        yield from map(SimulatedPoints, problems.x_p, problems.x_c, problems.X_p, problems.R_cp)
        return
    yield from map(points_of, simulate_tracks(drive(frames), CAMERA, scene.tracks, seed))


def points_of(frame: SimulatedFrame) -> SimulatedPoints:
    """The matches of a simulated frame that have a depth."""
    X_p = CAMERA.triangulate(frame.matches.prev_left, frame.matches.prev_right)
    has_depth = np.isfinite(X_p[:, 2])
    matches = frame.matches[has_depth]
    x_p = CAMERA.normalise(matches.prev_left)
    x_c = CAMERA.normalise(matches.cur_left)
    return SimulatedPoints(x_p, x_c, X_p[has_depth], frame.T_cp[:3, :3])
