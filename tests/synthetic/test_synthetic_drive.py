"""The route of the street, the drive of the camera, and the traffic."""

from __future__ import annotations

from collections import defaultdict
from typing import Any

import numpy as np
import pytest

from vo_lib.data.scenes import SCENES, SceneConfig
from vo_lib.geometry.motion import inverse, rotation_angle, transform
from vo_lib.geometry.types import Array
from vo_street.city import FRONTS, build_city
from vo_street.route import Drive, Route, make_drive, make_route
from vo_street.shapes import SHAPES
from vo_street.site import Site
from vo_street.traffic import Vehicle, make_traffic
from vo_street.vehicles import Model

NOTHING: Any = None  # in place of faces, which motions do not need
# Sum over all poses with fixed weights: the measured results depend on these scenes.
DRIVES = {
    "empty": -434.007837,
    "parked": -348.505225,
    "traffic": -459.407512,
    "jam": -101.319658,
    "highway": 789.204498,
    "hard": 316.692195,
    "block": -45.708762,
}


def course(name: str) -> tuple[SceneConfig, Route, Drive]:
    config = SCENES[name]
    route = make_route(config)
    return config, route, make_drive(config, route)


def traffic(name: str) -> tuple[Drive, list[Vehicle]]:
    """Drive and vehicles of a scene, without the faces."""
    config, route, drive = course(name)
    models = [Model(key, shape, NOTHING, NOTHING) for key, shape in SHAPES.items()]
    return drive, make_traffic(config, route, drive, models)


@pytest.mark.parametrize(("name", "expected"), DRIVES.items())
def test_drives_are_smooth_and_unchanged(name: str, expected: float) -> None:
    config, _, drive = course(name)
    assert drive.s[-1] == pytest.approx(config.length, abs=1.2 * config.speed / config.rate)
    steps = inverse(drive.poses[:-1]) @ drive.poses[1:]
    # Neighbouring steps differ little: no jump in speed or in turn rate.
    assert np.abs(np.diff(steps[:, :3, 3], axis=0)).max() < 0.08
    turns = steps[:, :3, :3]
    assert np.degrees(rotation_angle(np.swapaxes(turns[:-1], 1, 2) @ turns[1:])).max() < 0.8
    assert np.abs(-drive.poses[:, 1, 3] - config.camera_height).max() < 0.05
    poses = drive.poses[:, :3]
    weights = np.cos(np.arange(poses.size)).reshape(poses.shape)
    assert float(np.sum(poses * weights)) == pytest.approx(expected)


def test_block_route_returns_to_its_first_street() -> None:
    _, route, drive = course("block")
    assert route.lap is not None
    assert route.pose(route.lap + 30.0) == pytest.approx(route.pose(30.0), abs=1e-9)
    assert route.pose(route.lap / 2)[:3, :3] == pytest.approx(np.diag([-1.0, 1.0, -1.0]))
    assert drive.s[-1] == pytest.approx(route.lap + 30.0, abs=1.0)
    again = drive.s > route.lap + 1.0
    first = drive.poses[~again & (drive.s < 40.0), :3, 3]
    nearest = np.linalg.norm(drive.poses[again, None, :3, 3] - first, axis=2).min(axis=1)
    assert nearest.max() < 1.0


def test_block_repeats_its_outer_houses() -> None:
    config, route, _ = course("block")
    mesh: Any = Fronts()
    names = defaultdict(int, {f"house {k}": k + 1 for k in range(FRONTS)})
    build_city(Site(mesh, names, route, config))
    assert route.lap is not None
    opposite = route.pose(route.lap / 2)
    twins = [
        number == other and np.allclose(transform(opposite, place), again, atol=1e-6)
        for number, place in mesh.fronts
        for other, again in mesh.fronts
    ]
    assert sum(twins) >= 20


class Fronts:
    """Replacement for a mesh, which collects texture numbers and corners of house fronts."""

    def __init__(self) -> None:
        self.fronts: list[tuple[int, Array]] = []

    def add(self, corners: Array, texture: int, uv: Array | None, gain: float | Array) -> None:
        if texture:
            self.fronts.append((texture, corners))


@pytest.mark.parametrize("name", list(SCENES))
def test_vehicles_never_collide(name: str) -> None:
    drive, vehicles = traffic(name)
    if not vehicles:
        assert name == "empty"
        return
    half = np.array([(v.model.shape.width / 2, v.model.shape.length / 2) for v in vehicles])
    for frame in range(0, len(drive.times), 7):
        poses = np.stack([v.poses[frame] for v in vehicles])
        between = inverse(poses)[:, None] @ poses[None]
        apart = np.abs(between[..., [0, 2], 3]) > half[:, None] + half[None] - 0.1
        beside = np.abs(between[..., 0, 2]) < 0.2  # the same or the opposite heading
        near = beside & ~apart.any(axis=-1) & ~np.eye(len(vehicles), dtype=bool)
        clash = near & near.T  # boxes overlap only if they overlap along the axes of both
        assert not clash.any(), np.argwhere(clash)
        eye = inverse(poses) @ drive.poses[frame][:, 3]
        assert np.any(np.abs(eye[:, [0, 2]]) > half + np.array([0.7, 1.0]), axis=1).all()
