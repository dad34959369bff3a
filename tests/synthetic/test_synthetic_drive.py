"""The street's course, the way the car drives it, and the traffic around it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from street.drive import Drive, Route, make_drive, make_route
from street.shapes import SHAPES
from street.traffic import Vehicle, make_traffic
from street.vehicles import Model
from vo_lib.core.geometry import inverse, rotation_angle
from vo_lib.data.scenes import SCENES, SceneConfig

NOTHING: Any = None  # faces, which a motion does not need
# A sum over all poses with fixed weights: the scenes that results were measured on.
DRIVES = {
    "empty": -434.007837,
    "parked": -348.505225,
    "traffic": -459.407512,
    "jam": -101.319658,
    "highway": 789.204498,
    "hard": 316.692195,
}


def course(name: str) -> tuple[SceneConfig, Route, Drive]:
    config = SCENES[name]
    route = make_route(config)
    return config, route, make_drive(config, route)


def traffic(name: str) -> tuple[Drive, list[Vehicle]]:
    """Vehicles of a scene, without their faces."""
    config, route, drive = course(name)
    models = [Model(key, shape, NOTHING, NOTHING) for key, shape in SHAPES.items()]
    return drive, make_traffic(config, route, drive, models)


@pytest.mark.parametrize("name", list(SCENES))
def test_the_drive_is_as_long_as_asked_and_smooth(name: str) -> None:
    config, _, drive = course(name)
    assert drive.s[-1] == pytest.approx(config.length, abs=1.2 * config.speed / config.rate)
    np.testing.assert_allclose(np.diff(drive.times), 1.0 / config.rate)
    steps = inverse(drive.poses[:-1]) @ drive.poses[1:]
    # Neighbouring steps differ little: no jump in speed or in turn rate.
    assert np.abs(np.diff(steps[:, :3, 3], axis=0)).max() < 0.08
    turns = steps[:, :3, :3]
    assert np.degrees(rotation_angle(np.swapaxes(turns[:-1], 1, 2) @ turns[1:])).max() < 0.8
    np.testing.assert_allclose(np.linalg.det(drive.poses[:, :3, :3]), 1.0)
    height = -drive.poses[:, 1, 3]
    assert np.abs(height - config.camera_height).max() < 0.05


@pytest.mark.parametrize(("name", "expected"), DRIVES.items())
def test_the_drive_of_a_scene_stays_as_it_was_measured(name: str, expected: float) -> None:
    poses = course(name)[2].poses[:, :3]
    assert float(np.sum(poses * np.cos(np.arange(poses.size)).reshape(poses.shape))) == pytest.approx(
        expected
    )


def test_the_hard_scene_stands_still_and_turns_sharply() -> None:
    config, route, drive = course("hard")
    assert (drive.speed < 0.01).sum() >= int(config.standstill * config.rate) - 2
    half = np.abs(route.s - config.length / 2) < 20
    assert np.degrees(np.ptp(route.heading[half])) == pytest.approx(90.0, abs=5.0)
    assert np.degrees(np.abs(np.diff(route.angle(drive.s)))).max() > 2.0


@pytest.mark.parametrize("name", list(SCENES))
def test_vehicles_never_drive_through_each_other_or_the_camera(name: str) -> None:
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
        clash = near & near.T  # boxes overlap only if they do so along the axes of both
        assert not clash.any(), np.argwhere(clash)
        eye = inverse(poses) @ drive.poses[frame][:, 3]
        assert np.any(np.abs(eye[:, [0, 2]]) > half + np.array([0.7, 1.0]), axis=1).all()


def test_scenes_hold_what_their_names_promise() -> None:
    moving = {name: [v for v in traffic(name)[1] if not v.parked] for name in SCENES}
    parked = {name: [v for v in traffic(name)[1] if v.parked] for name in SCENES}
    assert not moving["empty"]
    assert not parked["empty"]
    assert not moving["parked"]
    assert len(parked["parked"]) > 50
    assert len(moving["traffic"]) > 6
    assert moving["jam"][0].model.name == "truck"
    assert not parked["highway"]
    assert moving["highway"]
