"""Drives with a disturbed camera, made from a clean drive: exposure, blur, noise, gaps, few frames, reversed.

A disturbance of the light changes the images of every frame; the changed images are written into a folder. A
disturbance of the order only takes other frames of the same folder. Both are deterministic. Truth and times
are those of the frames that remain, and the vehicle boxes are those of the clean images.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import os
import shutil
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from vo_lib.data.sequence import Sequence
from vo_lib.errors import DataError
from vo_lib.geometry.types import Array, Image
from vo_lib.runs.identity import images_digest, library_versions

DISTURBED_FRAMES = 100  # number of frames from the start of a drive
SEED = 0
SWING_FRAMES = 20  # period of the swinging brightness
BLUR_FRAMES = 7  # one blurred frame in so many
NOISE_LEVELS = 12.0
GAP_START = 50  # first omitted frame
VERSION = 1  # of the images; increase with every change of the functions that make them

# Function of an image (H, W), its frame's number and its side (0 left, 1 right); returns grey levels (H, W).
LightChange = Callable[[Image, int, int], Array]


@dataclass(frozen=True)
class Disturbance:
    """A disturbance of a drive: of the light in its images, or of the choice and order of its frames.

    Attributes
    ----------
    name : name in the tables; text : description in a sentence.
    light : change of an image, or None.
    order : numbers of the frames that remain of a drive of N frames, in the new order, or None for all.
    """

    name: str
    text: str
    light: LightChange | None = None
    order: Callable[[int], list[int]] | None = None

    @property
    def keeps_frames(self) -> bool:
        """Whether every frame of the drive remains."""
        return self.order is None or len(self.order(DISTURBED_FRAMES)) == DISTURBED_FRAMES


def _alternating(image: Image, frame: int, side: int) -> Array:
    """An image with 1.35 times its brightness in odd frames, and 0.65 times in even ones."""
    return np.asarray(image * (1.35 if frame % 2 else 0.65))


def _swinging(image: Image, frame: int, side: int) -> Array:
    """An image whose brightness swings from frame to frame."""
    return np.asarray(image * (1.0 + 0.5 * np.sin(2.0 * np.pi * frame / SWING_FRAMES)))


def _unequal(image: Image, frame: int, side: int) -> Array:
    """An image of a pair whose cameras have unequal exposure."""
    return np.asarray(image * (1.3 if side else 0.8))


def _blurred(image: Image, frame: int, side: int) -> Array:
    """An image that is blurred in one of `BLUR_FRAMES` frames."""
    if frame % BLUR_FRAMES != BLUR_FRAMES - 1:
        return np.asarray(image, np.float64)
    return np.asarray(cv2.GaussianBlur(image, (0, 0), 2.0), np.float64)


def _noisy(image: Image, frame: int, side: int) -> Array:
    """An image with noise."""
    noise = np.random.default_rng([SEED, frame, side])
    return np.asarray(image + noise.normal(0.0, NOISE_LEVELS, image.shape))


def _dark(image: Image, frame: int, side: int) -> Array:
    """An image at dusk."""
    return np.asarray(image * 0.15)


def _gap(frames: int) -> Callable[[int], list[int]]:
    """An order without so many frames, from `GAP_START` on."""
    return lambda number: [i for i in range(number) if not GAP_START <= i < GAP_START + frames]


def _every(step: int) -> Callable[[int], list[int]]:
    """An order with one of `step` frames."""
    return lambda number: list(range(0, number, step))


DISTURBANCES = (
    Disturbance("alternating", "the brightness alternates by ±35 % from frame to frame", _alternating),
    Disturbance("swinging", f"the brightness swings by ±50 % in {SWING_FRAMES} frames", _swinging),
    Disturbance("unequal", "left images have 0.8 times, right images 1.3 times the brightness", _unequal),
    Disturbance("blurred", "every seventh frame is blurred (Gaussian, σ 2 px)", _blurred),
    Disturbance("noisy", f"every pixel has noise of {NOISE_LEVELS:g} grey levels", _noisy),
    Disturbance("dark", "the images have 15 % of their brightness", _dark),
    Disturbance("gap of 5", "five frames are missing in the middle", order=_gap(5)),
    Disturbance("gap of 10", "ten frames are missing in the middle", order=_gap(10)),
    Disturbance("every 2nd", "only every second frame remains", order=_every(2)),
    Disturbance("every 3rd", "only every third frame remains", order=_every(3)),
    Disturbance("reversed", "the drive is played back", order=lambda number: list(range(number))[::-1]),
)


def disturbed_drives(sequence: Sequence, folder: Path) -> list[Sequence]:
    """Disturbed drives from the first `DISTURBED_FRAMES` frames of a sequence.

    A shorter sequence has only the disturbances that keep every frame. Changed images are written to `folder`
    unless they are there. The name of a drive is the sequence's name and the disturbance's.
    """
    number = min(len(sequence), DISTURBED_FRAMES)
    part = sequence.part(0, number)
    kinds = [kind for kind in DISTURBANCES if kind.keeps_frames or number == DISTURBED_FRAMES]
    return [disturb(part, kind, folder) for kind in kinds]


def disturb(sequence: Sequence, kind: Disturbance, folder: Path) -> Sequence:
    """The disturbed drive; changed images are written to a folder in `folder` unless they are there."""
    order = range(len(sequence)) if kind.order is None else kind.order(len(sequence))
    rows = np.array(order)
    times = sequence.times[rows]
    if times[-1] < times[0]:  # in a drive that is played back, the clock runs forward, too
        times = times[0] - times
    images = sequence.folder
    if kind.light is not None:
        images = _changed_images(sequence, kind.name, kind.light, folder)
    return dataclasses.replace(
        sequence,
        name=f"{sequence.name}: {kind.name}",
        folder=images,
        frames=tuple(sequence.frames[row] for row in rows),
        times=times,
        truth=None if sequence.truth is None else sequence.truth[rows],
        skips_frames=kind.order is not None,
    )


def _changed_images(sequence: Sequence, name: str, light: LightChange, folder: Path) -> Path:
    """The folder of a sequence's images after a change of the light; it appears when all are written."""
    inputs = [VERSION, name, images_digest(sequence), library_versions()]
    digest = hashlib.sha256(json.dumps(inputs, sort_keys=True).encode()).hexdigest()[:12]
    target = folder / f"{name}-{digest}"
    if target.is_dir():
        return target
    folder.mkdir(parents=True, exist_ok=True)
    draft = Path(tempfile.mkdtemp(prefix=".", dir=folder))
    try:
        for side in (0, 1):
            (draft / f"image_{side}").mkdir()
        for index, frame in enumerate(sequence.frames):
            for side, image in enumerate(sequence.stereo(index)):
                changed = np.clip(np.rint(light(image, index, side)), 0, 255).astype(np.uint8)
                path = draft / f"image_{side}" / f"{frame}.png"
                if not cv2.imwrite(str(path), changed, [cv2.IMWRITE_PNG_COMPRESSION, 1]):
                    raise DataError("the image cannot be written", path)
        os.replace(draft, target)
    finally:
        shutil.rmtree(draft, ignore_errors=True)
    return target
