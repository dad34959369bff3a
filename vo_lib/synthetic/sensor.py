"""From brightness to the grey levels a camera writes: blur, exposure, noise."""

from __future__ import annotations

import functools

import cv2
import numpy as np
from numpy.typing import NDArray

from .blur import smear
from .drive import smooth_wave
from .render import Float32, Renderer, View
from .scenes import SceneConfig

SHIFTS = 256  # places along each side where a picture's noise may begin


def exposures(config: SceneConfig, times: NDArray[np.float64]) -> NDArray[np.float64]:
    """Exposure (N,) of each frame: it wanders by the share the settings give."""
    rng = np.random.default_rng([config.seed, 7])
    wave = smooth_wave(times, rng, 4.0, 15.0)
    return np.asarray(np.exp(np.log1p(config.exposure_change) * wave))


def photograph(renderer: Renderer, frame: int, right: bool = False) -> tuple[View, NDArray[np.uint8]]:
    """What a camera sees in a frame, and the picture (H, W) that it takes of it."""
    world, view = renderer.world, renderer.view(frame, right)
    exposure = float(exposures(world.config, world.drive.times)[frame])
    return view, expose(smear(world, frame, view, right), world.config, exposure, frame, right)


def expose(
    light: Float32, config: SceneConfig, exposure: float, frame: int, right: bool
) -> NDArray[np.uint8]:
    """The picture (H, W), 8 bits, of one camera.

    Noise depends on seed, frame and camera alone, so that frames can be drawn in any order.
    """
    gain = exposure * (1.0 + config.gain_difference * right)
    if config.optics > 0:
        soft = cv2.GaussianBlur(light, (0, 0), config.optics, borderType=cv2.BORDER_REFLECT_101)
        light = np.asarray(soft, np.float32)
    height, width = light.shape
    row, column = np.random.default_rng([config.seed, 8, frame, int(right)]).integers(SHIFTS, size=2).tolist()
    field = noise_field(config.seed, height, width)[row : row + height, column : column + width]
    grey = field * np.float32(config.noise) + light * np.float32(gain)
    return np.asarray(np.clip(np.rint(grey), 0, 255), np.uint8)


@functools.lru_cache(maxsize=2)
def noise_field(seed: int, height: int, width: int) -> Float32:
    """White noise of deviation 1, larger than a picture, which takes a piece of its own: this saves time."""
    rng = np.random.default_rng([seed, 10])
    return rng.standard_normal((height + SHIFTS, width + SHIFTS), dtype=np.float32)
