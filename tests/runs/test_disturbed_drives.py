"""Drives through a faulty camera: no step that no vehicle makes goes unflagged, nothing stops the run."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from street.folder import calibration_text
from vo_lib import Sequence, open_sequence, preset, run
from vo_lib.core.frame import REPEATED, TIME_JUMP
from vo_lib.core.geometry import inverse, rotation_angle
from vo_lib.core.types import Array, Image
from vo_lib.core.vehicle import VehicleConfig
from vo_lib.runs.runner import Run, run_methods

FIRST, FRAMES, AT = 100, 14, 6  # of the street; the fault begins at the sixth of fourteen frames
LEFT_OUT = 5  # frames at most
TENTH = 0.1  # seconds between frames
FARTHEST_OFF = 0.5  # metres of a step; the vehicle makes about 1; of a jump beyond 5 m a tenth
COLUMNS, ROWS = slice(360, 880), slice(100, 300)  # a part of the images is enough, and quick
ANY_ORDER = np.random.default_rng(5).permutation(FRAMES).tolist()
Pair = tuple[Image, Image]


@dataclass(frozen=True)
class Fault:
    """A camera's fault.

    images : from the undisturbed drive and the number of a frame to the pair that the camera gives.
    shown : from that number to the frame whose left image that is.
    """

    images: Callable[[list[Pair], int], Pair]
    shown: Callable[[int], int] = lambda i: i


def grey(image: NDArray[Any]) -> Image:
    return np.asarray(np.clip(image, 0, 255), np.uint8)


def turned(image: Image, degrees: float = 0.0, zoom: float = 1.0) -> Image:
    height, width = image.shape
    A = cv2.getRotationMatrix2D((width / 2, height / 2), degrees, zoom)
    return np.asarray(cv2.warpAffine(image, A, (width, height), borderMode=cv2.BORDER_REFLECT), np.uint8)


def both(change: Callable[[Image], NDArray[Any]], first: int = AT, number: int = FRAMES) -> Fault:
    """A change of both images of `number` frames."""

    def seen(drive: list[Pair], i: int) -> Pair:
        left, right = drive[i]
        changed = first <= i < first + number
        return (grey(change(left)), grey(change(right))) if changed else (left, right)

    return Fault(seen)


def taken_from(left: Callable[[int], int], right: Callable[[int], int] | None = None) -> Fault:
    """Each frame shows images of other frames; `right` where the right camera has its own."""
    of_right = right or left
    return Fault(lambda drive, i: (drive[left(i)][0], drive[of_right(i)][1]), left)


def same(i: int) -> int:
    return i


def frozen(number: int) -> Callable[[int], int]:
    return lambda i: AT - 1 if AT <= i < AT + number else i


def noisy(deviation: float) -> Callable[[Image], NDArray[Any]]:
    """Other noise in each image, the same in each run."""
    return lambda image: image + np.random.default_rng(int(image.sum())).normal(0, deviation, image.shape)


def flicker(*gains: float) -> Fault:
    return Fault(lambda drive, i: (grey(drive[i][0] * gains[i % 2]), grey(drive[i][1] * gains[i % 2])))


def swapped(number: int) -> Fault:
    return Fault(lambda drive, i: drive[i][::-1] if AT <= i < AT + number else drive[i])


DRIVES: dict[str, Fault] = {
    "both cameras frozen for one frame": taken_from(frozen(1)),
    "both cameras frozen for three frames": taken_from(frozen(3)),
    "both cameras frozen for six frames": taken_from(frozen(6)),
    "both cameras frozen for good": taken_from(frozen(FRAMES)),
    "right camera frozen for one frame": taken_from(same, frozen(1)),
    "right camera frozen for five frames": taken_from(same, frozen(5)),
    "right camera frozen for good": taken_from(same, frozen(FRAMES)),
    "left camera frozen for one frame": taken_from(frozen(1), same),
    "left camera frozen for good": taken_from(frozen(FRAMES), same),
    "right camera a frame late at once": taken_from(same, lambda i: i - (i >= AT)),
    "left camera two frames late at once": taken_from(lambda i: i - 2 * (i >= AT), same),
    "a frame left out": taken_from(lambda i: i + (i >= AT)),
    "five frames left out": taken_from(lambda i: i + LEFT_OUT * (i >= AT)),
    "every second frame twice": taken_from(lambda i: i - i % 2),
    "back and forth": taken_from(lambda i: max(i - 3 * (i % 2), 0)),
    "backwards from the middle": taken_from(lambda i: i if i < AT else max(2 * AT - i, 0)),
    "frames in any order": taken_from(ANY_ORDER.__getitem__),
    "roll of 3° in one frame": both(lambda image: turned(image, 3), number=1),
    "roll of 7° in one frame": both(lambda image: turned(image, 7), number=1),
    "roll of -15° that stays": both(lambda image: turned(image, -15)),
    "upside down in one frame": both(lambda image: image[::-1, ::-1], number=1),
    "upside down from the middle": both(lambda image: image[::-1, ::-1]),
    "mirrored from the middle": both(lambda image: image[:, ::-1]),
    "zoom of 1.2 in one frame": both(lambda image: turned(image, zoom=1.2), number=1),
    "zoom of 0.8 in one frame": both(lambda image: turned(image, zoom=0.8), number=1),
    "zoom of 1.5 that stays": both(lambda image: turned(image, zoom=1.5)),
    "60 rows down in one frame": both(lambda image: np.roll(image, 60, axis=0), number=1),
    "150 columns aside in one frame": both(lambda image: np.roll(image, 150, axis=1), number=1),
    "150 columns aside for good": both(lambda image: np.roll(image, -150, axis=1)),
    "flicker of 0.4 and 1.6": flicker(1.6, 0.4),
    "flicker of 0.7 and 1.3": flicker(1.3, 0.7),
    "three times as bright in one frame": both(lambda image: 3.0 * image, number=1),
    "one black frame": both(lambda image: 0 * image, number=1),
    "black from the middle": both(lambda image: 0 * image),
    "black from the start": both(lambda image: 0 * image, first=0),
    "five white frames": both(lambda image: 0 * image + 255, number=5),
    "the left half covered": both(lambda image: image * (np.arange(image.shape[1]) >= image.shape[1] // 2)),
    "noise of 60 grey levels in five frames": both(noisy(60.0), number=5),
    "nothing but noise in one frame": both(lambda image: 128 + noisy(80.0)(image) - image, number=1),
    "a blur of 5 pixels in five frames": both(lambda image: cv2.GaussianBlur(image, (0, 0), 5), number=5),
    "left and right swapped in one frame": swapped(1),
    "left and right swapped for good": swapped(FRAMES),
}
# Wrong steps that a vehicle could have made: no limit tells them from true ones.
NOT_TOLD = {
    ("zoom of 1.5 that stays", "published"),
    ("frames in any order", "published"),
}
# What the check is for: the path stays within 0.06 m of the truth with it, and not without.
CAUGHT = {
    "roll of 3° in one frame",
    "roll of 7° in one frame",
    "zoom of 1.2 in one frame",
    "zoom of 0.8 in one frame",
    "60 rows down in one frame",
}


@pytest.fixture(scope="module")
def drive(street: Sequence) -> tuple[list[Pair], Sequence]:
    """Images of a piece of the street, a window of each, and the street."""
    part = street.part(FIRST, FIRST + FRAMES + LEFT_OUT)
    pairs = [part.stereo(i) for i in range(len(part))]
    return [(left[ROWS, COLUMNS], right[ROWS, COLUMNS]) for left, right in pairs], part


def written(folder: Path, drive: tuple[list[Pair], Sequence], fault: Fault) -> Sequence:
    """A KITTI-layout folder with the images that the faulty camera gives."""
    for side in range(2):
        (folder / f"image_{side}").mkdir()
        for i in range(FRAMES):
            image = fault.images(drive[0], i)[side]
            cv2.imwrite(str(folder / f"image_{side}/{i:06d}.png"), image, [cv2.IMWRITE_PNG_COMPRESSION, 1])
    whole = drive[1].camera
    camera = replace(whole, cx=whole.cx - COLUMNS.start, cy=whole.cy - ROWS.start)
    (folder / "calib.txt").write_text(calibration_text(camera), encoding="utf-8")
    (folder / "times.txt").write_text("".join(f"{TENTH * i:.6f}\n" for i in range(FRAMES)), encoding="utf-8")
    return open_sequence(folder)


@pytest.mark.parametrize("name", DRIVES)
def test_no_step_that_no_vehicle_makes_goes_unflagged_and_the_check_makes_no_path_worse(
    drive: tuple[list[Pair], Sequence], tmp_path: Path, name: str
) -> None:
    fault, kit = DRIVES[name], preset("solution_selection")
    sequence, unchecked = written(tmp_path, drive, fault), replace(kit, vehicle=VehicleConfig(check=False))
    runs = run_methods(sequence, {"kit": kit, "unchecked": unchecked})
    runs["published"] = run(sequence, preset("solution_selection", variant="published"))
    truth = drive[1].truth
    assert truth is not None
    path = inverse(truth[0]) @ truth[[fault.shown(i) for i in range(FRAMES)]]  # of what the left camera shows
    true = inverse(path[1:]) @ path[:-1]
    for variant in ("kit", "published"):
        require_flagged(runs[variant], true, told=(name, variant) not in NOT_TOLD)
    if name.startswith("flicker"):
        steps = np.stack([motion.T_cp for motion in runs["kit"].motions])
        assert np.linalg.norm((steps - true)[:, :3, 3], axis=1).max() < 0.05  # metres, of steps of one
        assert sum(motion.in_doubt for motion in runs["kit"].motions) <= 1
    if name.startswith("left"):  # it alone stops or is late, the vehicle does not
        path = inverse(truth[0]) @ truth[:FRAMES]
    off = {k: np.linalg.norm((run.poses - path)[:, :3, 3], axis=1) for k, run in runs.items()}
    assert np.sqrt(np.mean(off["kit"] ** 2)) <= np.sqrt(np.mean(off["unchecked"] ** 2)) + 0.01
    assert off["kit"][-1] <= off["unchecked"][-1] + 0.01
    if name in CAUGHT:
        assert off["kit"].max() < 0.06 < off["unchecked"].max()


def require_flagged(result: Run, true: Array, told: bool) -> None:
    """No step beyond the limits is without a flag nor, where it can be `told`, one far from the true one."""
    T_cp = np.stack([motion.T_cp for motion in result.motions])
    flagged = np.array([motion.in_doubt for motion in result.motions])
    repeated = np.array([REPEATED in motion.flags for motion in result.motions])
    seen = flagged | repeated | [TIME_JUMP in motion.flags for motion in result.motions]
    seen[1:] |= repeated[:-1]  # that step is of more than a tenth of a second
    assert np.isfinite(result.poses).all()
    # The limits, from the steps alone: of one that is not flagged, and of two that are not.
    limits = VehicleConfig()
    turn = np.degrees(rotation_angle(T_cp[:, :3, :3])) / TENTH
    most = np.hypot(limits.turn_rate, np.hypot(limits.tilt_rate, limits.tilt_rate))
    assert (seen | (turn <= most)).all()
    change = np.linalg.norm(np.diff(T_cp[:, :3, 3], axis=0), axis=1) / TENTH
    assert (seen[1:] | seen[:-1] | (change <= TENTH * limits.speed_change)).all()
    # And the truth: a step that is off by what no vehicle changes is flagged.
    off = np.linalg.norm((T_cp - true)[:, :3, 3], axis=1)
    far = np.maximum(FARTHEST_OFF, 0.1 * np.linalg.norm(true[:, :3, 3], axis=1))
    assert not (told and ((off > far) & ~flagged).any())
