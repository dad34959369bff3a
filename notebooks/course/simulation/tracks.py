"""Matches without images: points of a random street along any trajectory, with given errors.

The simulation of thousands of frames takes seconds:

    for frame in simulate_tracks(poses, camera, TrackConfig(noise=0.3, wrong=0.1), seed=1):
        frame.matches, frame.wrong, frame.moving
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from vo_lib.geometry.camera import StereoCamera
from vo_lib.geometry.matches import StereoMatches
from vo_lib.geometry.motion import inverse, rigid, rotation_from_vector, transform
from vo_lib.geometry.rows import Rows, joined
from vo_lib.geometry.types import Array, BoolArray, IntArray

ROUNDS = 8  # attempts to fill a frame with points; afterwards, the frame has fewer points
# Depth of the points, metres.
NEAREST = 4.0
FARTHEST = 70.0
CAMERA_HEIGHT = 1.65  # metres above the road
AHEAD = rigid(np.eye(3), np.array([0.0, 0.0, 0.8]))  # motion of an object from frame to frame, metres


@dataclass(frozen=True)
class TrackConfig:
    """Settings of the simulated front end."""

    points: int = 400  # matches in each frame
    noise: float = 0.2  # standard deviation of each measured coordinate, pixels
    wrong: float = 0.0  # share of matches whose current pair shows another point
    moving: float = 0.0  # share of matches on moving objects
    objects: int = 2  # moving objects in view
    object_heading: float = 0.0  # of the objects, degrees to the right of the camera's
    survival: float = 0.8  # share of features that are matched again in the next frame


@dataclass(frozen=True, eq=False)
class SimulatedFrame:
    """Matches between two stereo pairs, and their truth.

    Attributes
    ----------
    frame : number of the current pair, 1 to N - 1.
    matches : (M,) matches between the pairs frame - 1 and frame.
    wrong : (M,) mask of matches whose current pair shows another point; never on moving objects.
    moving : (M,) mask of points on moving objects.
    T_cp : (4, 4) the camera's true motion, X_c = T_cp X_p.
    """

    frame: int
    matches: StereoMatches
    wrong: BoolArray
    moving: BoolArray
    T_cp: Array


@dataclass(frozen=True, eq=False)
class _Features(Rows):
    """Tracked features: points (n, 3) in the axes of their `body`, the number of an object or -1 (street)."""

    point: Array
    body: IntArray
    left: Array
    right: Array
    age: IntArray
    strength: Array
    id: IntArray


def simulate_tracks(
    poses: Array, camera: StereoCamera, config: TrackConfig | None = None, seed: int = 0
) -> Iterator[SimulatedFrame]:
    """Matches along a trajectory, frame by frame.

    Parameters
    ----------
    poses : (N, 4, 4) T_w_c of the left camera, for example KITTI's ground truth.
    camera : the stereo camera, with its image size.
    config : number of points, noise, and share of wrong matches.
    seed : seed of all random numbers.

    Yields
    ------
    A SimulatedFrame for each of the pairs 1 to N - 1. The current positions of a feature are its previous
    positions in the next frame. Without noise, the correct matches satisfy the geometry exactly.
    """
    street = _Street(np.asarray(poses, float), camera, config or TrackConfig(), np.random.default_rng(seed))
    return map(street.step, range(1, len(poses)))


class _Street:
    """State of the simulation between the frames: tracked features, and poses of the objects."""

    def __init__(self, poses: Array, camera: StereoCamera, config: TrackConfig, rng: np.random.Generator):
        self.poses = poses
        self.camera = camera
        self.config = config
        self.rng = rng
        self.from_world = inverse(poses)
        # Poses T_w_o of the objects in the current pair; far away until they are placed.
        self.objects = np.tile(rigid(np.eye(3), np.array([0.0, 0.0, -1e6])), (config.objects, 1, 1))
        # Into the camera of the previous and of the current pair: from each object, then from the world. The world is
        # last, so that the body -1 picks it.
        nowhere = np.tile(np.eye(4), (config.objects + 1, 1, 1))
        self.to_camera = [nowhere, nowhere]
        self.next_id = 0
        self.tracked = self._new(0, 0, False)  # features that may be matched again in the next frame

    def step(self, frame: int) -> SimulatedFrame:
        """Remaining and new features, measured in the current pair."""
        config = self.config
        self._move_objects(frame)
        survivors = self.tracked[self.rng.random(len(self.tracked)) < config.survival]
        kept = survivors[self._visible(survivors.point, survivors.body)]
        on_objects = round(config.moving * config.points)
        parts = []
        for moving, wanted in ((False, config.points - on_objects), (True, on_objects)):
            is_kind = (kept.body >= 0) == moving
            old = kept[np.flatnonzero(is_kind)[:wanted]]
            parts.append(old)
            parts.append(self._new(frame, wanted - len(old), moving))
        return self._measure(frame, joined(parts))

    def _measure(self, frame: int, features: _Features) -> SimulatedFrame:
        """Measure the features in the current pair, some of them at wrong positions; track the right ones on."""
        rng = self.rng
        count = len(features)
        left, right = self._project(1, features.point, features.body)
        left = left + self._noise(count)
        right = right + self._noise(count)
        moving = features.body >= 0
        wrong = np.zeros(count, bool)
        wrong[rng.permutation(np.flatnonzero(~moving))[: round(self.config.wrong * count)]] = True
        # As if another feature nearby had been matched: 4 to 40 px away, at another disparity.
        mismatches = np.flatnonzero(wrong)
        distance = rng.uniform(4.0, 40.0, len(mismatches))
        angle = rng.uniform(0, 2 * np.pi, len(mismatches))
        disparity = (left - right)[mismatches, 0] * rng.uniform(0.6, 1.6, len(mismatches))
        left[mismatches] += distance[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        right[mismatches, 0] = left[mismatches, 0] - disparity
        right[mismatches, 1] = left[mismatches, 1] + self._noise(len(mismatches))[:, 1]
        matches = StereoMatches(
            features.left, features.right, left, right, features.age, features.strength, features.id
        )
        self.tracked = replace(features, left=left, right=right, age=features.age + 1)[~wrong]
        return SimulatedFrame(frame, matches, wrong, moving, self.from_world[frame] @ self.poses[frame - 1])

    def _new(self, frame: int, wanted: int, moving: bool) -> _Features:
        """New features that are visible in the previous and in the current pair."""
        point = np.zeros((0, 3))
        body = np.zeros(0, np.int64)
        for _ in range(ROUNDS):
            lacking = wanted - len(body)
            if lacking <= 0:
                break
            more, bodies = self._sample(frame, 2 * lacking + 20, moving)
            good = np.flatnonzero(self._visible(more, bodies))[:lacking]
            point = np.concatenate([point, more[good]])
            body = np.concatenate([body, bodies[good]])
        count = len(body)
        left, right = self._project(0, point, body)
        left = left + self._noise(count)
        right = right + self._noise(count)
        age = np.ones(count, np.int64)
        strength = self.rng.gamma(2.0, 20.0, count)
        ids = np.arange(self.next_id, self.next_id + count)
        self.next_id += count
        return _Features(point, body, left, right, age, strength, ids)

    def _sample(self, frame: int, count: int, moving: bool) -> tuple[Array, IntArray]:
        """Random points in the axes of their body: on road or house fronts near the camera, or on objects."""
        rng = self.rng
        if moving:
            body = rng.integers(self.config.objects, size=count)
            point = rng.uniform((-0.9, -1.4, -2.1), (0.9, 0.0, 2.1), (count, 3))
            point[:, 2] = np.where(rng.random(count) < 0.6, -2.1, point[:, 2])  # mostly the visible rear
            return point, body
        z = NEAREST * (FARTHEST / NEAREST) ** rng.random(count)
        ground = rng.random(count) < 0.4
        x_of_front = rng.uniform(5.0, 14.0, count) * rng.choice([-1.0, 1.0], count)
        y_of_front = CAMERA_HEIGHT - rng.uniform(0.0, 8.0, count)
        x = np.where(ground, rng.uniform(-7.0, 7.0, count), x_of_front)
        y = np.where(ground, CAMERA_HEIGHT, y_of_front)
        point = transform(self.poses[frame - 1], np.stack([x, y, z], axis=1))
        return point, np.full(count, -1)

    def _project(self, pair: int, point: Array, body: IntArray) -> tuple[Array, Array]:
        """Left and right pixels of points in the previous pair (`pair` 0) or in the current pair (1)."""
        T = self.to_camera[pair][body]
        return self.camera.project(np.einsum("nij,nj->ni", T[:, :3, :3], point) + T[:, :3, 3])

    def _visible(self, point: Array, body: IntArray) -> BoolArray:
        """Mask of the points inside all four images, with a margin for noise."""
        uv = np.stack([self._project(pair, point, body) for pair in (0, 1)])
        far_corner = (self.camera.width - 3.0, self.camera.height - 3.0)
        return np.asarray(((uv > 2.0) & (uv < far_corner)).all(axis=(0, 1, 3)))

    def _move_objects(self, frame: int) -> None:
        """Objects drive along their heading; an object that leaves the view reappears elsewhere."""
        before = self.objects
        in_previous = self.from_world[frame - 1] @ before
        in_current = self.from_world[frame] @ (before @ AHEAD)
        visible = _in_view(in_previous) & _in_view(in_current)
        for k in np.flatnonzero(~visible):
            side = float(self.rng.choice([-3.3, 0.0, 3.3]))
            place = np.array([side, CAMERA_HEIGHT, self.rng.uniform(11.0, 25.0)])
            turn = rotation_from_vector(np.array([0.0, np.radians(self.config.object_heading), 0.0]))
            before[k] = self.poses[frame - 1] @ rigid(turn, place)
            self.tracked = self.tracked[self.tracked.body != k]
        self.objects = before @ AHEAD
        for pair, bodies in enumerate((before, self.objects)):
            T = self.from_world[frame - 1 + pair]
            self.to_camera[pair] = np.concatenate([T @ bodies, T[None]])

    def _noise(self, count: int) -> Array:
        """Errors (count, 2) of measured positions, pixels."""
        return self.config.noise * self.rng.standard_normal((count, 2))


def _in_view(poses: Array) -> BoolArray:
    """Mask (K,) of the objects with poses (K, 4, 4) in the camera that are 7 to 45 m ahead and not too far beside."""
    x = poses[:, 0, 3]
    z = poses[:, 2, 3]
    return np.asarray((z > 7.0) & (z < 45.0) & (np.abs(x) < 0.6 * z))
