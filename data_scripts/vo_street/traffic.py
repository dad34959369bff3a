"""Vehicles on the street (parked, ahead, oncoming, overtaking) and their exact motion."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np

from vo_lib.data.scenes import SceneConfig
from vo_lib.geometry.types import Array

from .route import LANE_WIDTH, Drive, Route, lane_offset
from .shapes import CAR, TRUCK
from .site import PARKING, Profile
from .vehicles import Model


@dataclass(frozen=True, eq=False)
class Vehicle:
    """A vehicle and its poses during the whole drive.

    Attributes
    ----------
    model : shape and paint of the vehicle.
    poses : (N, 4, 4) pose in the street frame, T_s_o.
    gain : brightness.
    """

    model: Model
    poses: Array
    gain: float

    @functools.cached_property
    def parked(self) -> bool:
        """Whether the vehicle never moves."""
        return bool(np.ptp(self.poses[:, :3, 3], axis=0).max() < 1e-9)

    @functools.cached_property
    def light(self) -> tuple[Array, Array]:
        """Brightness of the faces of the vehicle, and of its shadow's.

        The light is computed for the middle of the drive, so that the brightness of a vehicle is constant.
        """
        middle = self.poses[len(self.poses) // 2]
        faces = self.model.faces.moved(middle).lit().gain * self.gain
        shadow = self.model.shadow.moved(middle).lit().gain * self.gain
        return faces, shadow


class Traffic:
    """The builder of traffic; `vehicles` has all vehicles, moving vehicles first."""

    def __init__(self, config: SceneConfig, route: Route, drive: Drive, models: list[Model]):
        self.config = config
        self.route = route
        self.drive = drive
        self.rng = np.random.default_rng([config.seed, 5])
        self.cars = [model for model in models if model.shape.kind == CAR]
        self.large = [model for model in models if model.shape.kind != CAR]
        self.vehicles: list[Vehicle] = []

    def pick(self, large: float = 0.0) -> Model:
        """A random model; a truck or a bus with probability `large`."""
        pool = self.large if self.rng.random() < large else self.cars
        return pool[int(self.rng.integers(len(pool)))]

    def add(self, model: Model, s: Array, offset: float, turn: float = 0.0) -> None:
        """Add a vehicle at arc lengths s (N,) and lateral `offset`, metres, turned by `turn` radians."""
        poses = self.route.pose(s, offset, turn)
        self.vehicles.append(Vehicle(model, poses, float(self.rng.uniform(0.9, 1.1))))

    def ahead(self) -> None:
        """Vehicles that drive in front of the camera, with short headways."""
        config = self.config
        rng = self.rng
        times = self.drive.times
        trucks = [model for model in self.large if model.shape.kind == TRUCK]
        clear = 0.0  # distance from the camera that is taken, metres
        for k in range(config.ahead):
            is_first = k == 0
            if is_first and config.truck_ahead:
                model = trucks[int(rng.integers(len(trucks)))]
            else:
                model = self.pick(0.15)
            gap = config.gap if is_first else 0.6 * config.gap + 3.0
            clear += gap + model.shape.length / 2
            swing = 1.5 * np.sin(2 * np.pi * times / rng.uniform(9, 15) + rng.uniform(0, 6))
            s = np.interp(times + 0.6 * (k + 1), self.drive.clock, self.drive.way) + clear
            s = s + swing * min(config.gap / 20.0, 1.0)
            self.add(model, np.maximum.accumulate(s), lane_offset(config) + float(rng.uniform(-0.15, 0.15)))
            clear += model.shape.length / 2

    def overtaking(self) -> None:
        """Vehicles in the next lane to the left, faster than the camera."""
        config = self.config
        rng = self.rng
        times = self.drive.times
        if config.lanes < 2 or not config.overtaking:
            return
        faster = max(0.25 * config.speed, 2.0)
        spacing = max(60.0 / config.overtaking, 11.0 / faster)
        at = float(rng.uniform(0.5, 2.0))
        while at < times[-1] + 40.0 / faster:
            model = self.pick(0.12)
            offset = lane_offset(config) - LANE_WIDTH + float(rng.uniform(-0.15, 0.25))
            self.add(model, np.maximum.accumulate(self.drive.s + faster * (times - at)), offset)
            at += spacing * float(rng.uniform(1.0, 1.6)) + model.shape.length / faster

    def oncoming(self) -> None:
        """Vehicles in the lanes of the other direction, all at the same constant speed."""
        config = self.config
        rng = self.rng
        times = self.drive.times
        if not config.oncoming:
            return
        speed = 0.9 * config.speed
        median = 1.0 if config.layout == "highway" else 0.0
        for lane in range(config.lanes):
            s0 = self.drive.s[0] + float(rng.uniform(15.0, 35.0))
            last = self.drive.s[-1] + speed * times[-1] + 120.0
            if self.route.lap is not None:  # the last vehicle drives ahead of the first
                last = s0 + self.route.lap - 25.0
            while s0 < last:
                model = self.pick(0.2)
                offset = -(lane + 0.5) * LANE_WIDTH - median + float(rng.uniform(-0.2, 0.2))
                self.add(model, s0 - speed * times, offset, np.pi)
                clear = float(rng.exponential(max(100.0 / config.oncoming - 11.0, 0.5)))
                s0 += model.shape.length + 5.0 + clear

    def parked(self) -> None:
        """Cars at both kerbs; a few face the wrong way."""
        config = self.config
        rng = self.rng
        if not config.parked or config.layout == "highway":
            return
        first = -25.0
        last = self.drive.s[-1] + 110.0
        if self.route.lap is not None:
            first = 0.0
            last = self.route.lap - 6.0
        middle = Profile.of(config).lanes + PARKING / 2
        for side in (-1.0, 1.0):
            s = first
            while s < last:
                model = self.pick()
                s += model.shape.length / 2 + float(rng.uniform(0.5, 1.4))
                offset = side * (middle + float(rng.uniform(-0.1, 0.15)))
                turn = float(rng.normal(0, 0.02))
                faces_back = side < 0 or rng.random() < 0.1
                if faces_back:
                    turn += np.pi
                curvature = abs(float(np.interp(s, self.route.s, self.route.curvature)))
                if rng.random() < config.parked and curvature < 0.04:
                    self.add(model, np.full(len(self.drive.times), s), offset, turn)
                s += model.shape.length / 2


def make_traffic(config: SceneConfig, route: Route, drive: Drive, models: list[Model]) -> list[Vehicle]:
    """All vehicles of a scene, moving vehicles first."""
    traffic = Traffic(config, route, drive, models)
    traffic.ahead()
    traffic.overtaking()
    traffic.oncoming()
    traffic.parked()
    return traffic.vehicles
