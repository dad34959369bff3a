"""Directions and lanes of the vehicles in drawn traffic."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from vo_lib.data.scenes import SceneConfig, scene_config
from vo_lib.geometry.motion import inverse
from vo_lib.geometry.types import Array
from vo_street.route import make_drive, make_route
from vo_street.shapes import SHAPES
from vo_street.traffic import Traffic, Vehicle
from vo_street.vehicles import Model
from vo_street.world import World

NOTHING: Any = None  # in place of images, which motions do not need
SCENE = scene_config("jam", length=60.0, parked=0.5, bends=0.0)  # a straight street


def traffic(kind: str, config: SceneConfig = SCENE) -> tuple[World, list[Vehicle]]:
    """A drawn world with one kind of vehicle; no images are rendered."""
    route = make_route(config)
    drive = make_drive(config, route)
    models = [Model(name, shape, NOTHING, NOTHING) for name, shape in SHAPES.items()]
    made = Traffic(config, route, drive, models)
    getattr(made, kind)()
    assert len(made.vehicles) >= 2
    return World(config, route, drive, NOTHING, 0, NOTHING, made.vehicles, NOTHING), made.vehicles


def steps(poses: Array) -> Array:
    """Displacements (N - 1, 3) of vehicles from frame to frame."""
    return np.asarray(np.diff(poses[:, :3, 3], axis=0))


def in_camera(world: World, vehicle: Vehicle) -> tuple[Array, Array, Array]:
    """Distances of a vehicle to the right (N,) and ahead (N,) of the camera of each frame, metres.

    Third result (N - 1,), metres: forward distance from the current camera to the previous position.
    """
    eye = inverse(world.drive.poses)
    here, before = eye @ vehicle.poses, eye[1:] @ vehicle.poses[:-1]
    return here[:, 0, 3], here[:, 2, 3], before[:, 2, 3]


@pytest.mark.parametrize("kind", ["ahead", "overtaking", "oncoming"])
def test_vehicles_drive_forward_in_their_lane(kind: str) -> None:
    world, vehicles = traffic(kind)
    for vehicle in vehicles:
        ways, right, ahead = steps(vehicle.poses), vehicle.poses[:-1, :3, 0], vehicle.poses[:-1, :3, 2]
        along, aside = np.einsum("ni,ni->n", ways, ahead), np.einsum("ni,ni->n", ways, right)
        assert (along >= 0).all()
        assert along.max() > 0.1
        assert np.abs(aside).max() < 0.1 * along.max()
        x, z, stood = in_camera(world, vehicle)
        if kind == "oncoming":
            assert (np.einsum("ni,ni->n", ahead, world.drive.poses[:-1, :3, 2]) < -0.8).all()
            assert (z[1:] < stood - 0.2).all()
        elif kind == "overtaking":
            assert (z[1:] > stood).all()
            assert z[-1] > z[0]
        else:
            assert (z > 5.0).all()
        # Within half a lane, with a tolerance for the camera's yaw; other vehicles are further to the left.
        assert (np.abs(x).max() < 1.65 + 0.02 * z.max()) if kind == "ahead" else (x < -2.0).all()
