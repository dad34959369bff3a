"""A simulated street of points and vehicles for tests of the box rules, with or without noise."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from vo_lib.geometry.boxes import Boxes
from vo_lib.geometry.camera import StereoCamera
from vo_lib.geometry.matches import StereoMatches
from vo_lib.geometry.motion import rigid, rotation_from_vector, transform
from vo_lib.geometry.types import Array

CAMERA = StereoCamera(f=718.856, cx=607.2, cy=185.2, baseline=0.537, width=1241, height=376)
# The camera moves 1 m forward per frame and turns by 0.5°.
STEP = rigid(rotation_from_vector(np.array([0.001, 0.009, -0.001])), np.array([0.02, -0.01, -1.0]))


def street_points(rng: np.random.Generator, number: int) -> Array:
    """Points (N, 3) on both sides of a street, 6 to 40 m ahead, metres in the left camera's axes."""
    side = np.where(rng.random(number) < 0.5, -1.0, 1.0)
    z = rng.uniform(6.0, 40.0, number)
    return np.stack([side * rng.uniform(2.5, 5.0, number), rng.uniform(-2.0, 1.6, number), z], axis=1)


def match_points(
    X_p: Array, X_c: Array, noise: float = 0.0, rng: np.random.Generator | None = None
) -> StereoMatches:
    """Matches of points (N, 3) in the frames of the previous and of the current left camera."""
    n = len(X_p)
    views = (*CAMERA.project(X_p), *CAMERA.project(X_c))
    if rng is not None:
        a, b, c, d = (uv + rng.normal(0.0, noise, uv.shape) for uv in views)
        views = a, b, c, d
    return StereoMatches(*views, np.ones(n, np.int64), np.ones(n), np.arange(n))


@dataclass
class Vehicle:
    """A vehicle of 20 points: its position relative to the camera, and its step per frame, metres."""

    place: tuple[float, float, float]
    step: tuple[float, float, float] = (0.0, 0.0, 0.0)
    X: Array = field(init=False)

    def __post_init__(self) -> None:
        rng = np.random.default_rng(int(100 * abs(self.place[0])) + int(self.place[2]))
        self.X = np.array(self.place) + rng.uniform(-1, 1, (20, 3)) * (0.9, 0.75, 0.5)

    def box(self) -> Array:
        """The box of the vehicle in the left image, (4,)."""
        corners = np.array(self.place) + np.array(
            [[x, y, z] for x in (-0.9, 0.9) for y in (-0.75, 0.75) for z in (-0.5, 0.5)]
        )
        uv = CAMERA.project(corners)[0]
        return np.concatenate([uv.min(axis=0), uv.max(axis=0)])

    def drive(self) -> None:
        """Move the vehicle to its position in the next frame, in the axes of the next camera."""
        turned = transform(STEP, self.X) - transform(STEP, np.array([self.place]))
        self.place = tuple((transform(STEP, np.array([self.place]))[0] + self.step).tolist())
        self.X = np.array(self.place) + turned


def drive(
    vehicles: list[Vehicle], frames: int, noise: float = 0.15
) -> tuple[Boxes, list[tuple[StereoMatches, Boxes]]]:
    """Boxes of the first frame; then matches and boxes of each following frame, without occlusion."""
    rng = np.random.default_rng(6)
    first, result = _boxes(vehicles), []
    for _ in range(frames):
        fixed = street_points(rng, 200)
        before = np.concatenate([fixed, *(vehicle.X for vehicle in vehicles)])
        for vehicle in vehicles:
            vehicle.drive()
        after = np.concatenate([transform(STEP, fixed), *(vehicle.X for vehicle in vehicles)])
        result.append((match_points(before, after, noise, rng), _boxes(vehicles)))
    return first, result


def _boxes(vehicles: list[Vehicle]) -> Boxes:
    k = len(vehicles)
    return Boxes(np.stack([vehicle.box() for vehicle in vehicles]), np.full(k, 2), np.ones(k))
