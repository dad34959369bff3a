"""Which way vehicles drive: in the traffic that is drawn, and in what the truth says of their points."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from street.drive import make_drive, make_route
from street.shapes import SHAPES
from street.traffic import Traffic, Vehicle
from street.truth_files import encode_depth, write_objects
from street.vehicles import Model
from street.world import World
from vo_lib.core.geometry import inverse, rigid
from vo_lib.core.types import Array
from vo_lib.data.scenes import SceneConfig, scene_config
from vo_lib.data.truth import Truth

NOTHING: Any = None  # what a picture needs and a motion does not
SCENE = scene_config("jam", length=60.0, parked=0.5, bends=0.0)  # a straight street: lanes are plain to see


def traffic(kind: str, config: SceneConfig = SCENE) -> tuple[World, list[Vehicle]]:
    """A world without pictures, with one kind of vehicle."""
    route = make_route(config)
    drive = make_drive(config, route)
    models = [Model(name, shape, NOTHING, NOTHING) for name, shape in SHAPES.items()]
    made = Traffic(config, route, drive, models)
    getattr(made, kind)()
    assert len(made.vehicles) >= 2
    return World(config, route, drive, NOTHING, 0, NOTHING, made.vehicles, NOTHING), made.vehicles


def steps(poses: Array) -> Array:
    """Way (N - 1, 3) of bodies from frame to frame."""
    return np.asarray(np.diff(poses[:, :3, 3], axis=0))


@pytest.mark.parametrize("kind", ["ahead", "overtaking", "oncoming"])
def test_every_vehicle_drives_the_way_it_looks(kind: str) -> None:
    for vehicle in traffic(kind)[1]:
        ways, right, ahead = steps(vehicle.poses), vehicle.poses[:-1, :3, 0], vehicle.poses[:-1, :3, 2]
        along, aside = np.einsum("ni,ni->n", ways, ahead), np.einsum("ni,ni->n", ways, right)
        assert (along >= 0).all()
        assert along.max() > 0.1
        assert np.abs(aside).max() < 0.1 * along.max()
        assert not vehicle.parked


def in_camera(world: World, vehicle: Vehicle) -> tuple[Array, Array, Array]:
    """How far to the right (N,) and ahead (N,) of the camera of each frame a vehicle is, and how far ahead
    (N - 1,) of the frames from the second on the place is where it was in the frame before."""
    eye = inverse(world.drive.poses)
    here, before = eye @ vehicle.poses, eye[1:] @ vehicle.poses[:-1]
    return here[:, 0, 3], here[:, 2, 3], before[:, 2, 3]


def test_oncoming_vehicles_face_the_camera_and_come_nearer_faster_than_what_stands() -> None:
    world, vehicles = traffic("oncoming")
    for vehicle in vehicles:
        ahead = np.einsum("ni,ni->n", vehicle.poses[:, :3, 2], world.drive.poses[:, :3, 2])
        x, z, stood = in_camera(world, vehicle)
        assert (ahead < -0.8).all()
        assert (z[1:] < stood - 0.2).all()
        assert (x < -2.0).all()


def test_overtaking_vehicles_pass_on_the_left_and_go_away() -> None:
    world, vehicles = traffic("overtaking")
    for vehicle in vehicles:
        x, z, stood = in_camera(world, vehicle)
        assert (x < -2.0).all()
        assert (z[1:] > stood).all()
        assert z[-1] > z[0]


def test_vehicles_ahead_stay_ahead_in_the_camera_s_lane() -> None:
    world, vehicles = traffic("ahead")
    for vehicle in vehicles:
        x, z, _ = in_camera(world, vehicle)
        assert (z > 5.0).all()
        assert np.abs(x).max() < 1.65 + 0.02 * z.max()  # half a lane, and the camera looks aside a little


def test_parked_cars_never_move_and_stand_at_both_kerbs() -> None:
    _, vehicles = traffic("parked")
    assert all(vehicle.parked for vehicle in vehicles)
    assert {np.sign(vehicle.poses[0, 0, 3]) for vehicle in vehicles} == {1.0, -1.0}


def test_the_truth_is_told_in_the_first_camera_s_axes(tmp_path: Path) -> None:
    world, (one, *vehicles) = traffic("oncoming")
    place = np.tile(np.eye(4), (len(world.drive.times), 1, 1))
    place[3:, 2, 3] += 0.5  # one step, from frame 2 to frame 3
    place[6:, 2, 3] += 0.009  # and one that is too small to count
    world.vehicles[0] = Vehicle(one.model, place, 1.0)
    write_objects(world, tmp_path / "objects.npz")
    with np.load(tmp_path / "objects.npz") as told:
        poses, speed, moving = told["poses"], told["speed"], told["moving"]
    assert poses.shape[:2] == (len(world.drive.times), len(vehicles) + 1)
    assert np.flatnonzero(moving[:, 0]).tolist() == [2, 3]
    assert moving[:, 1:].all()
    for k, vehicle in enumerate(vehicles, start=1):
        x, z, _ = in_camera(world, vehicle)
        np.testing.assert_allclose(poses[0, k, [0, 2], 3], [x[0], z[0]], atol=1e-9)
        length = np.linalg.norm(steps(vehicle.poses), axis=1) * SCENE.rate
        np.testing.assert_allclose(speed[:-1, k], length, rtol=0.05)
    # The camera looks along z: what comes towards it has ever smaller z in the world.
    assert (np.diff(poses[:, 1:, 2, 3], axis=0) < 0).all()


# A truth of two frames made by hand: 10 px columns of the picture show one thing each, straight on.
CONFIG = SceneConfig(width=64, height=48, focal=50.0, baseline=0.5)
CAMERA = CONFIG.camera
AHEAD = 0.8  # metres that the camera goes
DEPTH = 12.0
# Step of each vehicle in the world, metres: it comes, it goes faster than the camera, it stands, it crosses.
STEPS = {"oncoming": (0, 0, -1.5), "overtaking": (0, 0, 2.0), "parked": (0, 0, 0), "crossing": (0.6, 0, 0)}
NAMES = ("street", *STEPS)


@pytest.fixture
def truth(tmp_path: Path) -> Truth:
    for name in ("depth", "instance"):
        (tmp_path / "truth" / name).mkdir(parents=True)
    ids = np.zeros((48, 64), np.uint8)
    for k in range(1, 5):
        ids[:, 10 * k : 10 * k + 10] = k
        ids[40:, 10 * k : 10 * k + 10] = 4 + k  # the shadow under it
    ids[:, 50:] = 0
    count = 3
    for frame in range(count):
        depth = encode_depth(np.full((48, 64), 1 / DEPTH, np.float32))
        cv2.imwrite(str(tmp_path / "truth" / "depth" / f"{frame:06d}.png"), depth)
        cv2.imwrite(str(tmp_path / "truth" / "instance" / f"{frame:06d}.png"), ids)
    poses = np.stack([rigid(np.eye(3), np.array([0, 0, AHEAD * i])) for i in range(count)])
    objects = np.tile(np.eye(4), (count, 4, 1, 1))
    for k, step in enumerate(STEPS.values()):
        # From frame 0 to frame 1; then everything stands.
        objects[:, k, :3, 3] = np.array([0.0, 1.0, DEPTH]) + np.outer([0, 1, 1], step)
    return Truth(tmp_path, CONFIG, poses, np.arange(1, 5), np.full(4, 2), objects)


def pixel(name: str, row: float = 20.0) -> Array:
    return np.array([[10.0 * NAMES.index(name) + 4.0, row]])


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("row", [20.0, 43.0])
def test_points_move_as_their_vehicle_does_against_the_camera(truth: Truth, name: str, row: float) -> None:
    step = np.array(STEPS.get(name, (0, 0, 0)), float)
    uv = pixel(name, row)
    # Its place before; then it moves, and the camera goes ahead.
    X = np.array([*CAMERA.normalise(uv)[0], 1.0]) * DEPTH + step - (0, 0, AHEAD)
    expected = CAMERA.f * X[:2] / X[2] + (CAMERA.cx, CAMERA.cy)
    left, right, _ = truth.predict(0, 1, uv)
    np.testing.assert_allclose(left[0], expected, atol=0.01)
    assert (left - right)[0, 0] == pytest.approx(CAMERA.f * CAMERA.baseline / X[2], abs=1e-3)


def test_vehicles_and_their_shadows_move_between_two_frames(truth: Truth) -> None:
    for row in (20.0, 43.0):  # the vehicle and its shadow
        uv = np.concatenate([pixel(name, row) for name in NAMES])
        # From the first frame to the second they go; from the second to the third all stand.
        for one, other in ((0, 1), (1, 0), (0, 2), (1, 2), (2, 1)):
            moving = {
                name for name, moves in zip(NAMES, truth.is_moving(one, uv, other), strict=True) if moves
            }
            assert moving == ({"oncoming", "overtaking", "crossing"} if 0 in (one, other) else set())
