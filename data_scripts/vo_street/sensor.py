"""Grey levels of a camera from brightness: blur, exposure, noise."""

from __future__ import annotations

import functools

import cv2
import numpy as np
from numpy.typing import NDArray

from vo_lib.data.scenes import SceneConfig
from vo_lib.geometry.motion import rotation_angle
from vo_lib.geometry.types import Array

from .render import Float32, Renderer, View
from .route import smooth_wave
from .world import World

MAX_BLUR_PX = 24.0  # longer lines of motion blur are cut
SHIFTS = 256  # places along each side where a picture's noise may begin


def exposures(config: SceneConfig, times: Array) -> Array:
    """Exposure (N,) of each frame, which varies around 1 by up to `config.exposure_change`."""
    rng = np.random.default_rng([config.seed, 7])
    wave = smooth_wave(times, rng, 4.0, 15.0)
    return np.asarray(np.exp(np.log1p(config.exposure_change) * wave))


def photograph(renderer: Renderer, frame: int, right: bool = False) -> tuple[View, NDArray[np.uint8]]:
    """The view of a camera in a frame, and the 8-bit image (H, W)."""
    world = renderer.world
    view = renderer.view(frame, right)
    exposure = float(exposures(world.config, world.drive.times)[frame])
    return view, expose(smear(world, frame, view, right), world.config, exposure, frame, right)


def expose(
    light: Float32, config: SceneConfig, exposure: float, frame: int, right: bool
) -> NDArray[np.uint8]:
    """The 8-bit image (H, W) of one camera.

    The noise depends only on seed, frame and camera, so frames can be drawn in any order.
    """
    gain = exposure * (1.0 + config.gain_difference * right)
    if config.optics > 0:
        soft = cv2.GaussianBlur(light, (0, 0), config.optics, borderType=cv2.BORDER_REFLECT_101)
        light = np.asarray(soft, np.float32)
    height, width = light.shape
    rng = np.random.default_rng([config.seed, 8, frame, int(right)])
    row, column = rng.integers(SHIFTS, size=2).tolist()
    noise = noise_field(config.seed, height, width)[row : row + height, column : column + width]
    grey = noise * np.float32(config.noise) + light * np.float32(gain)
    return np.asarray(np.clip(np.rint(grey), 0, 255), np.uint8)


@functools.lru_cache(maxsize=2)
def noise_field(seed: int, height: int, width: int) -> Float32:
    """White noise of standard deviation 1, larger than an image, so that each image uses a different part."""
    rng = np.random.default_rng([seed, 10])
    return rng.standard_normal((height + SHIFTS, width + SHIFTS), dtype=np.float32)


def smear(world: World, frame: int, view: View, right: bool) -> Float32:
    """Brightness (H, W) averaged along the motion of each pixel during the exposure."""
    shutter = world.config.shutter * 1e-3
    if shutter <= 0:
        return view.light
    flow = image_velocity(world, frame, view, right) * np.float32(shutter)
    length = np.hypot(flow[0], flow[1])
    flow *= np.minimum(1.0, MAX_BLUR_PX / np.maximum(length, 1e-6))
    # An odd number of samples, about one a pixel, so that one is in the middle.
    count = int(np.clip(np.ceil(np.percentile(length, 95)), 1, MAX_BLUR_PX)) | 1
    if count == 1:
        return view.light
    height, width = view.light.shape
    u, v = np.meshgrid(np.arange(width, dtype=np.float32), np.arange(height, dtype=np.float32))
    total = np.zeros_like(view.light)
    for share in np.linspace(-0.5, 0.5, count).astype(np.float32):
        map_u = u + share * flow[0]
        map_v = v + share * flow[1]
        total += cv2.remap(view.light, map_u, map_v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(total / np.float32(count), np.float32)


def image_velocity(world: World, frame: int, view: View, right: bool) -> Float32:
    """Image velocity (2, H, W) of each pixel, pixels per second.

    A point X in the camera frame has the velocity X' = -v - w × X + o: v and w are velocity and angular
    velocity of the camera, o is the velocity of the point's object.
    """
    camera = world.config.camera
    poses = world.drive.poses
    first = max(frame - 1, 0)
    last = min(frame + 1, len(poses) - 1)
    elapsed = world.drive.times[last] - world.drive.times[first]
    R_c_s = poses[frame, :3, :3].T
    turn = rotation_vector(R_c_s @ poses[last, :3, :3] @ poses[first, :3, :3].T @ R_c_s.T) / elapsed
    velocity_c = R_c_s @ (poses[last, :3, 3] - poses[first, :3, 3]) / elapsed
    if right:
        velocity_c = velocity_c + np.cross(turn, (camera.baseline, 0.0, 0.0))
    # Velocity of each instance relative to the camera: the street, then the vehicles, then their shadows.
    count = len(world.vehicles)
    relative = np.zeros((2 * count + 1, 3))
    for k, vehicle in enumerate(world.vehicles):
        step = vehicle.poses[last, :3, 3] - vehicle.poses[first, :3, 3]
        relative[[k + 1, count + k + 1]] = R_c_s @ step / elapsed
    relative -= velocity_c
    x = ((np.arange(camera.width) - camera.cx) / camera.f).astype(np.float32)[None]
    y = ((np.arange(camera.height) - camera.cy) / camera.f).astype(np.float32)[:, None]
    inverse_depth = view.inverse_depth
    velocity = relative.astype(np.float32)[view.instance]
    wx, wy, wz = turn.astype(np.float32)
    turning_u = x * y * wx - (1 + x * x) * wy + y * wz
    turning_v = (1 + y * y) * wx - x * y * wy - x * wz
    along_u = (velocity[..., 0] - x * velocity[..., 2]) * inverse_depth + turning_u
    along_v = (velocity[..., 1] - y * velocity[..., 2]) * inverse_depth + turning_v
    return np.asarray(np.stack([along_u, along_v]) * np.float32(camera.f), np.float32)


def rotation_vector(R: Array) -> Array:
    """Rotation vector (3,), radians, of a rotation (3, 3) by less than 180°."""
    axis = 0.5 * np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
    sine = float(np.linalg.norm(axis))
    return axis if sine < 1e-9 else axis / sine * float(rotation_angle(R))
