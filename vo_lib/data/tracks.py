"""Matches without pictures: points of a random street, seen along any trajectory, with chosen errors.

Fast enough to try a method over thousands of frames in seconds:

    for frame in simulate_tracks(poses, camera, TrackConfig(noise=0.3, wrong=0.1), seed=1):
        frame.matches, frame.wrong, frame.moving
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from ..core.camera import StereoCamera
from ..core.errors import DataError
from ..core.geometry import inverse, rigid, rotation_from_vector, transform
from ..core.matches import StereoMatches
from ..core.rows import Rows, joined
from ..core.settings import Checked, setting
from ..core.types import Array, Mask, Whole

Rng = np.random.Generator

ROUNDS = 8  # attempts to fill a frame with points before it is left with fewer


@dataclass(frozen=True)
class TrackConfig(Checked):
    """What the simulated front end finds."""

    points: int = setting(400, "Matches in each frame.", low=1, high=20000)
    noise: float = setting(0.2, "Standard deviation of each coordinate measured.", unit="px", low=0, high=10)
    wrong: float = setting(0.0, "Share of matches whose current pair shows another point.", low=0, high=1)
    moving: float = setting(0.0, "Share of matches on moving objects.", low=0, high=1)
    objects: int = setting(2, "Moving objects in view.", low=1, high=20)
    object_speed: float = setting(0.8, "Way of an object from frame to frame.", unit="m", low=-5, high=5)
    object_heading: float = setting(
        0.0,
        "Heading of the objects to the right of the camera's; 90: they cross.",
        unit="deg",
        low=-180,
        high=180,
    )
    survival: float = setting(0.8, "Share of features found again in the next frame.", low=0, high=1)
    camera_height: float = setting(1.65, "Height of the cameras above the road.", unit="m", low=0.1, high=10)
    nearest: float = setting(4.0, "Depth of the nearest points.", unit="m", low=0.5, high=50)
    farthest: float = setting(70.0, "Depth of the farthest points.", unit="m", low=2, high=1000)


@dataclass(frozen=True)
class SimulatedFrame:
    """Matches between two stereo pairs, and what is true of them.

    Attributes
    ----------
    frame : number of the current pair, 1 to N - 1.
    matches : (M,) matches between the pairs frame - 1 and frame.
    wrong : (M,) the current pair shows another point; never set together with `moving`.
    moving : (M,) the point lies on an object that moves.
    T_cp : (4, 4) the camera's true motion, X_c = T_cp X_p.
    """

    frame: int
    matches: StereoMatches
    wrong: Mask
    moving: Mask
    T_cp: Array


@dataclass(frozen=True)
class _Features(Rows):
    """Features alive: points (n, 3) in their body's frame, body -1 is the street, else an object."""

    point: Array
    body: Whole
    left: Array
    right: Array
    age: Whole
    strength: Array
    id: Whole


def _no_features() -> _Features:
    uv, whole = np.zeros((0, 2)), np.zeros(0, np.int64)
    return _Features(np.zeros((0, 3)), whole, uv, uv, whole, np.zeros(0), whole)


def simulate_tracks(
    poses: Array, camera: StereoCamera, config: TrackConfig | None = None, seed: int | Rng = 0
) -> Iterator[SimulatedFrame]:
    """Matches along a trajectory, frame by frame.

    Parameters
    ----------
    poses : (N, 4, 4) T_w_c of the left camera, for example KITTI's ground truth.
    camera : the stereo camera, with its image size.
    config : how many points, how good and how many of them lie.
    seed : number or generator from which all chance follows.

    Yields
    ------
    SimulatedFrame for the pairs 1 to N - 1. What is measured in the current pair is the previous pair of the
    next frame, as with a real tracker. With zero noise the right matches satisfy the geometry exactly.
    """
    if camera.width <= 0 or camera.height <= 0:
        raise DataError("simulated matches need the size of the image in the camera")
    config = TrackConfig() if config is None else config
    return _Street(np.asarray(poses, np.float64), camera, config, np.random.default_rng(seed)).frames()


class _Street:
    """The state that runs along: features alive, and where the objects are."""

    def __init__(self, poses: Array, camera: StereoCamera, config: TrackConfig, rng: Rng):
        self.poses, self.camera, self.config, self.rng = poses, camera, config, rng
        self.from_world = inverse(poses)
        self.alive = _no_features()
        self.next_id = 0
        # Poses T_w_o of the objects in the previous and the current frame; far away until they are placed.
        self.objects = np.tile(rigid(np.eye(3), np.array([0.0, 0.0, -1e6])), (config.objects, 1, 1))
        self.objects_now = self.objects

    def frames(self) -> Iterator[SimulatedFrame]:
        config, rng = self.config, self.rng
        for frame in range(1, len(self.poses)):
            self._move_objects(frame)
            on_objects = round(config.moving * config.points)
            quota = {False: config.points - on_objects, True: on_objects}
            kept = self.alive[rng.random(len(self.alive)) < config.survival]
            kept = kept[self._visible(frame, kept.point, kept.body)]
            parts = []
            for moving, wanted in quota.items():
                old = kept[np.flatnonzero((kept.body >= 0) == moving)[:wanted]]
                parts += [old, self._new(frame, wanted - len(old), moving)]
            yield self._measure(frame, joined(parts))

    def _measure(self, frame: int, features: _Features) -> SimulatedFrame:
        """Measure the features in the current pair; some of them wrongly."""
        config, rng, count = self.config, self.rng, len(features)
        left, right = self._project(frame, features.point, features.body, now=True)
        left, right = left + self._noise(count), right + self._noise(count)
        street = np.flatnonzero(features.body < 0)
        wrong = np.zeros(count, bool)
        wrong[rng.permutation(street)[: round(config.wrong * count)]] = True
        # A mismatch looks like a match: the place of another feature, somewhere near in the picture.
        lying = np.flatnonzero(wrong)
        shift = rng.uniform(4.0, 40.0, (len(lying), 1)) * _directions(rng, len(lying))
        disparity = (left - right)[lying, 0] * rng.uniform(0.6, 1.6, len(lying))
        left[lying] += shift
        right[lying, 0], right[lying, 1] = (
            left[lying, 0] - disparity,
            left[lying, 1] + self._noise(len(lying))[:, 1],
        )
        matches = StereoMatches(
            features.left, features.right, left, right, features.age, features.strength, features.id
        )
        moving = features.body >= 0
        T_cp = self.from_world[frame] @ self.poses[frame - 1]
        self.alive = replace(features, left=left, right=right, age=features.age + 1)[~wrong]
        return SimulatedFrame(frame, matches, wrong, moving, T_cp)

    def _new(self, frame: int, wanted: int, moving: bool) -> _Features:
        """Features first seen in the previous pair, visible in the current one as well."""
        found, count = [], 0
        for _ in range(ROUNDS):
            if count >= wanted:
                break
            point, body = self._sample(frame, 2 * (wanted - count) + 20, moving)
            good = np.flatnonzero(self._visible(frame, point, body))[: wanted - count]
            found.append((point[good], body[good]))
            count += len(good)
        if not found:
            return _no_features()
        point, body = (np.concatenate(part) for part in zip(*found, strict=True))
        left, right = self._project(frame - 1, point, body, now=False)
        self.next_id += count
        return _Features(
            point,
            body,
            left + self._noise(count),
            right + self._noise(count),
            np.ones(count, np.int64),
            self.rng.gamma(2.0, 20.0, count),
            np.arange(self.next_id - count, self.next_id),
        )

    def _sample(self, frame: int, count: int, moving: bool) -> tuple[Array, Whole]:
        """Random points in their body's frame: on road and fronts near the previous camera, or on objects."""
        rng, config = self.rng, self.config
        if moving:
            body = rng.integers(config.objects, size=count)
            point = rng.uniform((-0.9, -1.4, -2.1), (0.9, 0.0, 2.1), (count, 3))
            point[:, 2] = np.where(rng.random(count) < 0.6, -2.1, point[:, 2])  # the rear is what one sees
            return point, body
        z = config.nearest * (config.farthest / config.nearest) ** rng.random(count)
        ground = rng.random(count) < 0.4
        x = rng.uniform(5.0, 14.0, count) * rng.choice([-1.0, 1.0], count)
        y = config.camera_height - rng.uniform(0.0, 8.0, count)
        x, y = np.where(ground, rng.uniform(-7.0, 7.0, count), x), np.where(ground, config.camera_height, y)
        return transform(self.poses[frame - 1], np.stack([x, y, z], axis=1)), np.full(count, -1)

    def _project(self, frame: int, point: Array, body: Whole, now: bool) -> tuple[Array, Array]:
        """Left and right pixels in a frame; `now` says which of the two known poses of the objects holds."""
        objects = self.objects_now if now else self.objects
        T = np.concatenate([self.from_world[frame] @ objects, self.from_world[frame][None]])[body]
        return self.camera.project(np.einsum("nij,nj->ni", T[:, :3, :3], point) + T[:, :3, 3])

    def _visible(self, frame: int, point: Array, body: Whole) -> Mask:
        """Inside both pictures of both pairs, with a little room for noise."""
        inside = np.ones(len(body), bool)
        far_corner = (self.camera.width - 3.0, self.camera.height - 3.0)
        for number, now in ((frame - 1, False), (frame, True)):
            for uv in self._project(number, point, body, now):
                with np.errstate(invalid="ignore"):
                    inside &= np.all((uv > 2.0) & (uv < far_corner), axis=1)
        return inside

    def _move_objects(self, frame: int) -> None:
        """Objects drive on along their own heading; one that leaves the view comes back elsewhere."""
        ahead = rigid(np.eye(3), np.array([0.0, 0.0, self.config.object_speed]))
        self.objects, lost = self.objects_now.copy(), []
        for k in range(len(self.objects)):
            for number in (frame - 1, frame):
                T_w_o = self.objects[k] @ (ahead if number == frame else np.eye(4))
                seen = self.from_world[number] @ T_w_o[:, 3]
                if not (7.0 < seen[2] < 45.0 and abs(seen[0]) < 0.6 * seen[2]):
                    lost.append(k)
        for k in dict.fromkeys(lost):
            side = float(self.rng.choice([-3.3, 0.0, 3.3]))
            place = np.array([side, self.config.camera_height, self.rng.uniform(11.0, 25.0)])
            turn = rotation_from_vector(np.array([0.0, np.radians(self.config.object_heading), 0.0]))
            self.objects[k] = self.poses[frame - 1] @ rigid(turn, place)
            self.alive = self.alive[self.alive.body != k]
        self.objects_now = self.objects @ ahead

    def _noise(self, count: int) -> Array:
        return self.config.noise * self.rng.standard_normal((count, 2))


def _directions(rng: Rng, count: int) -> Array:
    """Random unit vectors (count, 2)."""
    angle = rng.uniform(0, 2 * np.pi, count)
    return np.stack([np.cos(angle), np.sin(angle)], axis=1)
