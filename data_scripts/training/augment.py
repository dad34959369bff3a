"""Changed copies of training images: scale, place, mirror, mosaic, brightness, blur, noise.

Every change is drawn from the generator given, so that the same seed makes the same pictures.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np

from training.config import TrainingConfig
from training.dataset import Example
from vo_lib.core.boxes import Boxes
from vo_lib.core.types import Array, Image, Whole
from vo_lib.detection.yolo_layout import PAD, fit_size, letterbox, place

Rng = np.random.Generator

LEAST_SEEN = 0.3  # share of a box that must stay in the picture
LEAST_HEIGHT = 4.0  # px; lower boxes are ignored, neither vehicle nor background


@dataclass(frozen=True)
class Target:
    """A picture as the network gets it, with outer-edge boxes in its pixels.

    Attributes
    ----------
    image : (H, W) uint8.
    corners : (K, 4) x0, y0, x1, y1. class_id : (K,). ignored : (M, 4).
    """

    image: Image
    corners: Array
    class_id: Whole
    ignored: Array


def fitted(example: Example, size: int) -> Target:
    """The whole image, its longer side `size` pixels, unchanged otherwise: for evaluation."""
    rows, columns = example.image.shape
    width, height = fit_size(columns, rows, size)
    plan = letterbox(columns, rows, width, height)
    shift = np.array([plan.left, plan.top] * 2)
    return Target(
        place(example.image, plan),
        (example.boxes.xyxy + 0.5) * plan.scale + shift,
        example.boxes.class_id,
        (example.ignored.xyxy + 0.5) * plan.scale + shift,
    )


def training_picture(
    draw: Callable[[], Example], config: TrainingConfig, rng: Rng, mosaic: bool = True
) -> Target:
    """One picture to train on, of the configured size; `draw` gives the next example.

    With the configured chance it is a mosaic: four pieces of four images around a common corner.
    """
    width, height = config.width, config.height
    if mosaic and rng.random() < config.mosaic:
        x, y = (int(side * rng.uniform(0.3, 0.7)) for side in (width, height))
        windows = [(0, 0, x, y), (x, 0, width, y), (0, y, x, height), (x, y, width, height)]
    else:
        windows = [(0, 0, width, height)]
    canvas = np.full((height, width), PAD, np.uint8)
    pieces = []
    for x0, y0, x1, y1 in windows:
        piece = _cut(draw(), x1 - x0, y1 - y0, config, rng)
        canvas[y0:y1, x0:x1] = piece.image
        shift = (x0, y0, x0, y0)
        pieces.append((piece.corners + shift, piece.class_id, piece.ignored + shift))
    corners, class_id, ignored = (np.concatenate(part) for part in zip(*pieces, strict=True))
    return Target(_tones(canvas, config, rng), corners, class_id, ignored)


def _cut(example: Example, width: int, height: int, config: TrainingConfig, rng: Rng) -> Target:
    """A window of the image, scaled by chance, perhaps mirrored."""
    rows, columns = example.image.shape
    scale = (
        config.size
        / max(columns, rows)
        * float(np.exp(rng.uniform(np.log(config.smallest), np.log(config.largest))))
    )
    size = max(1, round(columns * scale)), max(1, round(rows * scale))
    image = cv2.resize(example.image, size, interpolation=cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR)
    left, top = _corner(example.boxes, scale, size, (width, height), config.aim, rng)
    window = np.full((height, width), PAD, np.uint8)
    x0, y0 = max(0, -left), max(0, -top)
    seen = image[max(0, top) : top + height, max(0, left) : left + width]
    window[y0 : y0 + seen.shape[0], x0 : x0 + seen.shape[1]] = seen
    shift = np.array([left, top, left, top])
    corners, ignored = ((boxes.xyxy + 0.5) * scale - shift for boxes in (example.boxes, example.ignored))
    if rng.random() < config.mirror:
        window = np.ascontiguousarray(window[:, ::-1])
        corners, ignored = (
            part[:, [2, 1, 0, 3]] * (-1, 1, -1, 1) + (width, 0, width, 0) for part in (corners, ignored)
        )
    return _visible(window, corners, example.boxes, ignored)


def _corner(
    boxes: Boxes, scale: float, size: tuple[int, int], window: tuple[int, int], aim: float, rng: Rng
) -> tuple[int, int]:
    """Left upper corner of the window in the scaled image: anywhere, or so that it covers a box's middle.

    Where the scaled image is smaller than the window it lies anywhere inside.
    """
    aimed = len(boxes) > 0 and rng.random() < aim
    box = boxes.xyxy[int(rng.integers(len(boxes)))] * scale if aimed else np.zeros(4)
    corner = []
    for axis, (have, want) in enumerate(zip(size, window, strict=True)):
        low, high = min(0, have - want), max(0, have - want)
        if aimed and have > want:
            middle = 0.5 * (box[axis] + box[axis + 2])
            corner.append(int(np.clip(middle - want * rng.uniform(0.15, 0.85), low, high)))
        else:
            corner.append(int(rng.integers(low, high + 1)))
    return corner[0], corner[1]


def _visible(window: Image, corners: Array, boxes: Boxes, ignored: Array) -> Target:
    """Boxes cut at the window's border; those mostly outside or too low are ignored."""
    height, width = window.shape
    border = (width, height, width, height)
    cut = np.clip(corners, 0.0, border)
    share = _area(cut) / np.maximum(_area(corners), 1e-9)
    good = (share >= LEAST_SEEN) & (cut[:, 3] - cut[:, 1] >= LEAST_HEIGHT)
    rest = np.concatenate([cut[~good], np.clip(ignored, 0.0, border)])
    return Target(window, cut[good], boxes.class_id[good], rest[_area(rest) > 0])


def _area(corners: Array) -> Array:
    return np.asarray((corners[:, 2] - corners[:, 0]) * (corners[:, 3] - corners[:, 1]))


def _tones(image: Image, config: TrainingConfig, rng: Rng) -> Image:
    """Brightness, contrast and gamma by chance; sometimes blur, sometimes noise."""
    strength = config.tones
    gain, gamma = (float(np.exp(rng.uniform(-strength, strength))) for _ in range(2))
    table = 255.0 * (np.arange(256) / 255.0) ** gamma * gain + 60.0 * strength * rng.uniform(-1, 1)
    out = table.astype(np.float32)[image]
    if rng.random() < config.blur:
        out = np.asarray(cv2.GaussianBlur(out, (0, 0), float(rng.uniform(0.3, 1.2))), np.float32)
    if rng.random() < config.noise:
        out += rng.standard_normal(out.shape, np.float32) * np.float32(rng.uniform(1.0, 8.0))
    return np.asarray(np.clip(np.rint(out), 0, 255), np.uint8)
