"""The route of the street, and the drive of the camera along the route.

Street frame: x right, y down, z forward at the start of the street, origin on the road's centre line;
the road is the plane y = 0. Arc length s and lateral offset (positive to the right) are street coordinates.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vo_lib.data.scenes import SceneConfig
from vo_lib.geometry.motion import rotation_from_vector
from vo_lib.geometry.types import Array

LANE_WIDTH = 3.3
STEP = 0.25  # metres between samples of the centre line
BEHIND = 60.0  # metres of street before the start of the drive
BEYOND = 320.0  # metres of street after the end of the drive
# A block: one round of the street, the starts of the corners of its first half, and their length, metres.
LAP = 324.0
CORNERS = (63.0, 129.0)
CORNER = 30.0


@dataclass(frozen=True, eq=False)
class Route:
    """The street's centre line, sampled every `STEP` metres.

    Attributes
    ----------
    s : (M,) arc length, metres; 0 at the start of the drive.
    x, z : (M,) position in the street frame, metres.
    heading : (M,) angle from the z axis towards x, radians.
    curvature : (M,) change of heading, radians per metre.
    lap : length of a closed street, metres; None for a street with two ends.
    """

    s: Array
    x: Array
    z: Array
    heading: Array
    curvature: Array
    lap: float | None = None

    def point(self, s: Array | float, offset: Array | float = 0.0, up: Array | float = 0.0) -> Array:
        """Points (..., 3) at arc length s, `offset` metres to the right and `up` metres above the road."""
        s, offset, up = np.broadcast_arrays(np.asarray(s, float), offset, up)
        psi = np.interp(s, self.s, self.heading)
        # Before its start and after its end, the street is straight.
        beyond = s - np.clip(s, self.s[0], self.s[-1])
        x = np.interp(s, self.s, self.x) + offset * np.cos(psi) + beyond * np.sin(psi)
        z = np.interp(s, self.s, self.z) - offset * np.sin(psi) + beyond * np.cos(psi)
        return np.stack([x, -up, z], axis=-1)

    def angle(self, s: Array | float) -> Array:
        """Heading at arc length s, radians."""
        return np.asarray(np.interp(s, self.s, self.heading))

    def pose(self, s: Array | float, offset: Array | float = 0.0, turn: float = 0.0) -> Array:
        """Poses (..., 4, 4), street frame, of vehicles that point `turn` rad to the right of the road."""
        position = self.point(s, offset)
        T = np.zeros((*position.shape[:-1], 4, 4))
        T[..., :3, :3] = yaw_rotation(self.angle(s) + turn)
        T[..., :3, 3] = position
        T[..., 3, 3] = 1.0
        return T

    def distance(self, points: Array) -> Array:
        """Horizontal distance (N,) of points (N, 3) from the centre line, metres."""
        line = np.stack([self.x, self.z], axis=1)[::4]
        return np.asarray(np.min(np.linalg.norm(points[:, None, [0, 2]] - line, axis=2), axis=1))


def yaw_rotation(psi: Array | float) -> Array:
    """Rotations (..., 3, 3) from the vehicle frame to the street frame, for headings psi (...), radians."""
    psi = np.asarray(psi, float)
    return rotation_from_vector(np.stack([0 * psi, psi, 0 * psi], axis=-1))


def make_route(config: SceneConfig) -> Route:
    """A street with gentle bends and a straight start; `sharp_turn` adds a right-angled turn half-way.

    The street round a block turns right four times and is closed.
    """
    if config.layout == "block":
        # Oncoming vehicles drive round the other way: they need two rounds behind the start.
        s = np.arange(-BEHIND - 2 * LAP, config.length + BEYOND, STEP)
        curvature = sum(bump(np.mod(s, LAP / 2), start, CORNER, np.pi / 2) for start in CORNERS)
        return _integrated(s, np.asarray(curvature), LAP)
    rng = np.random.default_rng([config.seed, 1])
    s = np.arange(-BEHIND, config.length + BEYOND, STEP)
    curvature = np.zeros_like(s)
    corner = 0.5 * config.length if config.sharp_turn else np.inf
    start = 15.0
    stretch = 1.0
    if config.layout == "highway":
        start = 40.0
        stretch = 3.0
    heading = 0.0
    while start < s[-1]:
        size = rng.uniform(40.0, 80.0) * stretch
        turn = np.radians(rng.uniform(0.3, 1.0) * config.bends) * rng.choice([-1.0, 1.0])
        if abs(heading + turn) > np.radians(config.bends):
            turn = -turn
        is_clear_of_corner = start + size < corner - 25.0 or start > corner + 25.0
        if is_clear_of_corner:
            curvature += bump(s, start, size, turn)
            heading += turn
        start += size + rng.uniform(5.0, 30.0)
    if config.sharp_turn:
        curvature += bump(s, corner - 15.0, 30.0, np.pi / 2)
    return _integrated(s, curvature)


def _integrated(s: Array, curvature: Array, lap: float | None = None) -> Route:
    """The route with `curvature` (M,) at s (M,); the route starts at the origin along the z axis."""
    psi = np.concatenate([[0.0], np.cumsum(0.5 * (curvature[1:] + curvature[:-1]) * STEP)])
    psi -= np.interp(0.0, s, psi)
    x = np.concatenate([[0.0], np.cumsum(np.sin(0.5 * (psi[1:] + psi[:-1])) * STEP)])
    z = np.concatenate([[0.0], np.cumsum(np.cos(0.5 * (psi[1:] + psi[:-1])) * STEP)])
    return Route(s, x - np.interp(0.0, s, x), z - np.interp(0.0, s, z), psi, curvature, lap)


def bump(s: Array, start: float, size: float, turn: float) -> Array:
    """Curvature (N,), 1/metre, of a bend: a raised cosine along s. The whole bend turns by `turn` radians."""
    phase = np.clip((s - start) / size, 0.0, 1.0)
    return np.asarray(turn / size * (1.0 - np.cos(2.0 * np.pi * phase)))


@dataclass(frozen=True, eq=False)
class Drive:
    """The camera's drive along the street.

    Attributes
    ----------
    times : (N,) seconds.
    s, speed : (N,) arc length, metres, and speed along the street, m/s.
    poses : (N, 4, 4) pose of the left camera in the street frame, T_s_c.
    clock, way : (M,) samples of time, s, and arc length, m, also before and after the drive.
    """

    times: Array
    s: Array
    speed: Array
    poses: Array
    clock: Array
    way: Array


def lane_offset(config: SceneConfig) -> float:
    """Lateral offset of the rightmost lane, in which the camera drives, metres."""
    return (config.lanes - 0.5) * LANE_WIDTH + (1.0 if config.layout == "highway" else 0.0)


def frame_count(config: SceneConfig) -> int:
    """Number of frames of a scene's drive."""
    return len(make_drive(config, make_route(config)).times)


def make_drive(config: SceneConfig, route: Route) -> Drive:
    """A drive along the route, slow in bends, with varying speed, suspension and optional standstill."""
    rng = np.random.default_rng([config.seed, 2])
    clock, way = _time_law(config, route, rng)
    count = max(2, int(np.floor(np.interp(config.length, way, clock) * config.rate)) + 1)
    times = np.arange(count) / config.rate
    s = np.interp(times, clock, way)
    wander_all = 0.12 * smooth_wave(route.s, rng, 35.0, 90.0)
    wander = np.interp(s, route.s, wander_all)
    psi = route.angle(s) + np.interp(s, route.s, np.gradient(wander_all, STEP))
    moving = np.minimum(np.gradient(s, times) / config.speed, 1.2)  # a camera at rest does not shake
    up = config.camera_height + 0.008 * config.shake * moving * smooth_wave(times, rng, 0.6, 1.5)
    pitch = np.radians(0.15) * config.shake * moving * smooth_wave(times, rng, 0.7, 2.0)
    roll = np.radians(0.12) * config.shake * moving * smooth_wave(times, rng, 0.9, 2.5)
    nod = rotation_from_vector(np.stack([pitch, 0 * pitch, 0 * pitch], axis=1))
    lean = rotation_from_vector(np.stack([0 * roll, 0 * roll, roll], axis=1))
    poses = np.tile(np.eye(4), (count, 1, 1))
    poses[:, :3, :3] = yaw_rotation(psi) @ nod @ lean
    poses[:, :3, 3] = route.point(s, lane_offset(config) + wander, up)
    return Drive(times, s, np.gradient(s, times), poses, clock, way)


def _time_law(config: SceneConfig, route: Route, rng: np.random.Generator) -> tuple[Array, Array]:
    """Times (M,) and arc lengths (M,) of a drive with a lateral acceleration of at most 2.5 m/s² in bends."""
    wave = smooth_wave(route.s, rng, 6.0 * config.speed, 12.0 * config.speed)
    desired = config.speed * (1.0 + config.speed_change * wave)
    in_bends = np.sqrt(2.5 / np.maximum(np.abs(route.curvature), 1e-6))
    allowed = np.minimum(desired, in_bends)
    stop = int(np.argmin(np.abs(route.s - config.length / 3.0)))
    if config.standstill:
        allowed[stop] = 0.0
    # Over a distance x, an acceleration a changes the squared speed by 2 a x.
    speed2 = np.minimum(allowed, 60.0) ** 2
    for i in range(1, len(speed2)):  # speeding up by at most 1.8 m/s²
        speed2[i] = min(speed2[i], speed2[i - 1] + 2 * 1.8 * STEP)
    for i in range(len(speed2) - 2, -1, -1):  # braking by at most 2.5 m/s²
        speed2[i] = min(speed2[i], speed2[i + 1] + 2 * 2.5 * STEP)
    speed = np.sqrt(speed2)
    clock = np.concatenate([[0.0], np.cumsum(2 * STEP / np.maximum(speed[1:] + speed[:-1], 0.05))])
    way = route.s.copy()
    if config.standstill:
        clock = np.concatenate([clock[: stop + 1], clock[stop:] + config.standstill])
        way = np.concatenate([way[: stop + 1], way[stop:]])
    return clock - np.interp(0.0, way, clock), way


def smooth_wave(t: Array, rng: np.random.Generator, short: float, long: float) -> Array:
    """A smooth random wave within [-1, 1] with periods from `short` to `long`."""
    periods = np.geomspace(short, long, 4)
    phases = rng.uniform(0, 2 * np.pi, 4)
    weights = rng.uniform(0.5, 1.0, 4)
    waves = np.sin(2 * np.pi * t[:, None] / periods + phases)
    return np.asarray(waves @ (weights / weights.sum()))
