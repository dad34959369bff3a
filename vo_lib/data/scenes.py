"""The named scenes, and the settings of a drawn street."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any

from ..errors import DataError, did_you_mean
from ..geometry.camera import StereoCamera
from ..settings import Checked, setting

# Intrinsics of KITTI odometry sequence 00, for an image of 1241×376 pixels.
KITTI_WIDTH = 1241
KITTI_HEIGHT = 376
KITTI_F = 718.856
KITTI_CX = 607.1928
KITTI_CY = 185.2157


@dataclass(frozen=True)
class SceneConfig(Checked):
    """Settings of a drawn street; equal settings give equal bytes."""

    seed: int = setting(1, "Seed of the scene's random numbers.", low=0)
    layout: str = setting("city", "Kind of street.", choices=("city", "highway", "block"))
    length: float = setting(260.0, "Length of the camera's path.", unit="m", low=2, high=20000)
    speed: float = setting(10.0, "Mean speed of the camera.", unit="m/s", low=0.5, high=40)
    speed_change: float = setting(0.15, "Amplitude of speed changes, share of the mean.", low=0, high=0.95)
    rate: float = setting(10.0, "Frame rate of the stereo pairs.", unit="Hz", low=1, high=100)
    bends: float = setting(35.0, "Largest change of heading in one bend.", unit="deg", low=0, high=60)
    sharp_turn: bool = setting(False, "A right-angled turn half-way.")
    standstill: float = setting(0.0, "Duration of a stop at one third of the way.", unit="s", low=0, high=60)
    shake: float = setting(1.0, "Suspension: 1 gives up to 1 cm of bounce and 0.2° of pitch.", low=0, high=10)

    lanes: int = setting(1, "Lanes in each direction.", low=1, high=3)
    parked: float = setting(0.0, "Share of the kerbside places with a parked car.", low=0, high=1)
    ahead: int = setting(0, "Vehicles ahead in the same lane.", low=0, high=20)
    truck_ahead: bool = setting(False, "The nearest vehicle ahead is a truck.")
    gap: float = setting(14.0, "Distance to the vehicle ahead at standstill.", unit="m", low=7, high=100)
    oncoming: float = setting(0.0, "Oncoming vehicles per lane.", unit="per 100 m", low=0, high=7)
    overtaking: float = setting(0.0, "Vehicles that overtake.", unit="per minute", low=0, high=30)

    noise: float = setting(1.6, "Standard deviation of the sensor noise.", unit="grey levels", low=0, high=30)
    optics: float = setting(0.45, "Standard deviation of the lens blur.", unit="px", low=0, high=5)
    exposure_change: float = setting(0.06, "Relative variation of the exposure.", low=0, high=0.9)
    gain_difference: float = setting(0.03, "Relative gain of the right image.", low=-0.5, high=0.5)
    dark_stretches: float = setting(0.0, "Share of the street in deep shade.", low=0, high=0.9)
    shutter: float = setting(0.0, "Exposure time, the cause of motion blur.", unit="ms", low=0, high=50)

    width: int = setting(KITTI_WIDTH, "Image width.", unit="px", low=64, high=4096)
    height: int = setting(KITTI_HEIGHT, "Image height.", unit="px", low=48, high=3072)
    focal: float | None = setting(None, "Focal length; none: KITTI's.", unit="px", low=20, high=8000)
    baseline: float = setting(0.5372, "Distance between the two cameras.", unit="m", low=0.01, high=5)
    camera_height: float = setting(1.65, "Height of the cameras above the road.", unit="m", low=0.5, high=5)

    @property
    def camera(self) -> StereoCamera:
        """The stereo camera; the principal point has KITTI's position relative to the image size."""
        return StereoCamera(
            f=KITTI_F * self.width / KITTI_WIDTH if self.focal is None else self.focal,
            cx=KITTI_CX / (KITTI_WIDTH - 1) * (self.width - 1),
            cy=KITTI_CY / (KITTI_HEIGHT - 1) * (self.height - 1),
            baseline=self.baseline,
            width=self.width,
            height=self.height,
        )


SCENES: dict[str, SceneConfig] = {
    "empty": SceneConfig(seed=11),
    "parked": SceneConfig(seed=12, parked=0.85),
    "traffic": SceneConfig(seed=13, parked=0.4, ahead=2, oncoming=2.5),
    "jam": SceneConfig(
        seed=14,
        length=100.0,
        speed=3.5,
        speed_change=0.6,
        bends=15.0,
        lanes=2,
        parked=0.5,
        ahead=3,
        truck_ahead=True,
        gap=10.0,
        oncoming=5.0,
        overtaking=14.0,
    ),
    "highway": SceneConfig(
        seed=15,
        layout="highway",
        length=500.0,
        speed=25.0,
        speed_change=0.05,
        bends=12.0,
        lanes=2,
        ahead=1,
        gap=25.0,
        oncoming=0.8,
        overtaking=6.0,
    ),
    "hard": SceneConfig(
        seed=16,
        sharp_turn=True,
        standstill=2.5,
        parked=0.4,
        ahead=1,
        oncoming=1.0,
        exposure_change=0.8,
        dark_stretches=0.3,
        shutter=12.0,
        noise=2.5,
        shake=2.0,
    ),
    "block": SceneConfig(seed=17, layout="block", length=354.0, parked=0.5, ahead=1, oncoming=1.5),
}
# The scenes of tables and of training: streets with two ends, so not the drive around a block.
TABLE_SCENES = tuple(name for name, scene in SCENES.items() if scene.layout != "block")


def scene_config(name: str, **changes: Any) -> SceneConfig:
    """The settings of a named scene, with changes; `DataError` for an unknown name."""
    if name not in SCENES:
        near = did_you_mean(name, SCENES)
        raise DataError(f"unknown synthetic scene {name!r}; {near}the scenes are {', '.join(SCENES)}")
    return dataclasses.replace(SCENES[name], **changes)
