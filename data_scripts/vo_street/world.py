"""A complete scene from its settings: route, drive, street, vehicles and textures."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np

from vo_lib.data.scenes import SceneConfig
from vo_lib.geometry.motion import inverse
from vo_lib.geometry.rows import joined
from vo_lib.geometry.types import Array

from .atlas import Atlas, TextureSet
from .mesh import Faces, MeshBuilder
from .route import Drive, Route, make_drive, make_route
from .shapes import CAR, SHAPES
from .site import Site
from .street import build_street, paint_street
from .traffic import Vehicle, make_traffic
from .vehicles import make_models


def make_shade(config: SceneConfig, route: Route) -> Array:
    """Light (M,) along the route: 1 in general, less in dark stretches of 10 to 40 m with soft ends."""
    rng = np.random.default_rng([config.seed, 9])
    light = np.ones_like(route.s)
    at = 10.0
    while config.dark_stretches and at < route.s[-1]:
        dark = float(rng.uniform(10.0, 40.0))
        depth = float(rng.uniform(0.55, 0.8))
        inside = np.clip(np.minimum(route.s - at, at + dark - route.s) / 3.0, 0.0, 1.0)
        light -= depth * inside
        at += dark + dark * (1.0 / config.dark_stretches - 1.0) * float(rng.uniform(0.7, 1.3))
    return light


def light_at(light: Array, route: Route, points: Array) -> Array:
    """Light (N,) at points (N, 3) in the street frame: the light at the nearest sample of the route."""
    if light.min() == 1.0:
        return np.ones(len(points))
    line = np.stack([route.x, route.z], axis=1)[::8]
    nearest = np.argmin(np.linalg.norm(points[:, None, [0, 2]] - line, axis=2), axis=1)
    return np.asarray(light[::8][nearest])


@dataclass(frozen=True, eq=False)
class World:
    """The data for the renderer and the truth.

    Attributes
    ----------
    config : the scene's settings.
    route, drive : the street's centre line and the camera's path.
    atlas : all textures. sky : index of the cloud texture.
    still : faces without motion (street and parked vehicles), street frame.
    vehicles : all K vehicles. Vehicle k has instance number k + 1, and its shadow has K + k + 1.
    shade : (M,) light at the samples of the route; 1 outside dark stretches.
    """

    config: SceneConfig
    route: Route
    drive: Drive
    atlas: Atlas
    sky: int
    still: Faces
    vehicles: list[Vehicle]
    shade: Array

    @property
    def poses(self) -> Array:
        """(N, 4, 4) camera poses T_w_c; the world frame is the frame of the first left camera."""
        return np.asarray(inverse(self.drive.poses[0]) @ self.drive.poses)

    def vehicles_near(self, frame: int, reach: float = 200.0) -> list[int]:
        """Numbers of the vehicles near the camera that are not part of `still`."""
        eye = self.drive.poses[frame][:3, 3]
        return [
            k
            for k, vehicle in enumerate(self.vehicles)
            if not vehicle.parked and np.linalg.norm(vehicle.poses[frame][:3, 3] - eye) < reach
        ]

    def placed(self, k: int, frame: int) -> Faces:
        """Faces of vehicle k and of its shadow at their positions in a frame."""
        faces = place_vehicle(self.vehicles[k], k + 1, len(self.vehicles) + k + 1, frame)
        shade = light_at(self.shade, self.route, self.vehicles[k].poses[frame, :3, 3][None])
        return dataclasses.replace(faces, gain=faces.gain * shade)


def place_vehicle(vehicle: Vehicle, instance: int, shadow: int, frame: int) -> Faces:
    """Faces of a vehicle and of its shadow in the street frame."""
    parts = []
    both = (vehicle.model.faces, instance), (vehicle.model.shadow, shadow)
    for (faces, number), light in zip(both, vehicle.light, strict=True):
        numbers = np.full(len(faces), number, np.int32)
        moved = faces.moved(vehicle.poses[frame])
        parts.append(dataclasses.replace(moved, instance=numbers, gain=light))
    return joined(parts)


def make_world(config: SceneConfig) -> World:
    """Build a scene."""
    route = make_route(config)
    drive = make_drive(config, route)
    textures = TextureSet()
    paint_street(textures, config, np.random.default_rng([config.seed, 3]))
    names = _vehicles_needed(config)
    models = make_models(textures, np.random.default_rng([config.seed, 6]), names) if names else []
    vehicles = make_traffic(config, route, drive, models) if names else []
    mesh = MeshBuilder([textures.size(k) for k in range(len(textures.images))])
    build_street(Site(mesh, textures.names, route, config))
    parts = [mesh.build().lit()]
    for k, vehicle in enumerate(vehicles):
        if vehicle.parked:
            parts.append(place_vehicle(vehicle, k + 1, len(vehicles) + k + 1, 0))
    still = joined(parts)
    shade = make_shade(config, route)
    light = light_at(shade, route, still.corners.mean(axis=1))
    still = dataclasses.replace(still, gain=still.gain * light)
    return World(config, route, drive, textures.build(), textures.names["clouds"], still, vehicles, shade)


def _vehicles_needed(config: SceneConfig) -> tuple[str, ...]:
    """Names of the vehicle shapes of a scene; only these shapes are painted."""
    if config.ahead or config.oncoming or config.overtaking:
        return tuple(SHAPES)
    if config.parked:
        return tuple(name for name, shape in SHAPES.items() if shape.kind == CAR)
    return ()
