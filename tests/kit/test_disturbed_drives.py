"""Drives with a faulty camera: every run finishes, and its path is finite and near the true path."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
import pytest
from faulty_camera import CAMERA, Faults
from faulty_camera import drive as drive_of
from numpy.typing import NDArray

from vo_lib import Sequence, preset, run
from vo_lib.geometry.boxes import no_boxes
from vo_lib.geometry.camera import StereoCamera
from vo_lib.geometry.matches import empty_matches
from vo_lib.geometry.motion import inverse
from vo_lib.geometry.result import Flag
from vo_lib.geometry.types import Image
from vo_lib.kit.kit_odometry import SelfCalibratingOdometry
from vo_lib.runs.drive import MethodRun, frames, make_odometry

FIRST, FRAMES, AT = 100, 14, 6  # first frame in the street, number of frames, first frame with the fault
OMITTED = 5  # frames
FRAME_S = 0.1  # seconds between frames
USUALLY_OFF_M = 0.2  # largest error of the last position; some faults leave no way to a better one
OFF_M = {"left camera frozen for one frame": 1.2, "back and forth": 1.2, "roll of 3° in one frame": 6.0}
COLUMNS, ROWS = slice(360, 880), slice(100, 300)  # a part of the images is enough
Pair = tuple[Image, Image]


@dataclass(frozen=True)
class Fault:
    """A fault of the stereo camera.

    images : function from the undisturbed drive and a frame number to the pair of the faulty camera.
    shown : function from a frame number to the number of the frame whose left image is used.
    """

    images: Callable[[list[Pair], int], Pair]
    shown: Callable[[int], int] = lambda i: i


def both(change: Callable[[Image], NDArray[Any]], number: int = FRAMES) -> Fault:
    """A fault that changes both images of `number` frames."""

    def images(drive: list[Pair], i: int) -> Pair:
        left, right = (np.asarray(np.clip(change(image), 0, 255), np.uint8) for image in drive[i])
        return (left, right) if AT <= i < AT + number else drive[i]

    return Fault(images)


def taken_from(left: Callable[[int], int], right: Callable[[int], int] | None = None) -> Fault:
    """A fault that shows images of other frames, whose numbers are left(i) and right(i) in frame i."""
    of_right = right or left
    return Fault(lambda drive, i: (drive[left(i)][0], drive[of_right(i)][1]), left)


def same(i: int) -> int:
    return i


def frozen(number: int) -> Callable[[int], int]:
    return lambda i: AT - 1 if AT <= i < AT + number else i


def rolled(image: Image) -> NDArray[Any]:
    """The image rotated by 3° about its centre."""
    height, width = image.shape
    A = cv2.getRotationMatrix2D((width / 2, height / 2), 3.0, 1.0)
    return cv2.warpAffine(image, A, (width, height), borderMode=cv2.BORDER_REFLECT)


def noisy(image: Image) -> NDArray[Any]:
    """The image with noise that differs between images and is the same in each run."""
    return image + np.random.default_rng(int(image.sum())).normal(0, 60.0, image.shape)


DRIVES: dict[str, Fault] = {
    "both cameras frozen for one frame": taken_from(frozen(1)),
    "both cameras frozen for good": taken_from(frozen(FRAMES)),
    "right camera frozen for five frames": taken_from(same, frozen(5)),
    "left camera frozen for one frame": taken_from(frozen(1), same),
    "right camera a frame late at once": taken_from(same, lambda i: i - (i >= AT)),
    "five frames omitted": taken_from(lambda i: i + OMITTED * (i >= AT)),
    "back and forth": taken_from(lambda i: max(i - 3 * (i % 2), 0)),
    "roll of 3° in one frame": both(rolled, number=1),
    "60 rows down in one frame": both(lambda image: np.roll(image, 60, axis=0), number=1),
    "three times as bright in one frame": both(lambda image: 3.0 * image, number=1),
    "one black frame": both(lambda image: 0 * image, number=1),
    "left half covered": both(lambda image: image * (np.arange(image.shape[1]) >= image.shape[1] // 2)),
    "noise of 60 grey levels in five frames": both(noisy, number=5),
    "left and right swapped for good": Fault(lambda drive, i: drive[i][::-1] if i >= AT else drive[i]),
}


@pytest.fixture(scope="module")
def drive(street: Sequence) -> tuple[list[Pair], Sequence]:
    """Cropped images of a part of the street, and the part as a sequence."""
    part = street.part(FIRST, FIRST + FRAMES + OMITTED)
    pairs = [part.stereo(i) for i in range(len(part))]
    return [(left[ROWS, COLUMNS], right[ROWS, COLUMNS]) for left, right in pairs], part


@dataclass(frozen=True)
class Shown(Sequence):
    """A sequence with images in memory."""

    pairs: tuple[Pair, ...] = ()

    def stereo(self, index: int) -> Pair:
        """The images of a frame."""
        return self.pairs[index]


def shown(like: Sequence, pairs: list[Pair], camera: StereoCamera | None = None) -> Shown:
    """A sequence of given images at intervals of 0.1 s, with the camera of another sequence."""
    frames = tuple(f"{i:06d}" for i in range(len(pairs)))
    times = np.asarray(FRAME_S * np.arange(len(pairs)), np.float64)
    return Shown("shown", like.folder, frames, camera or like.camera, times, None, None, tuple(pairs))


@pytest.mark.parametrize("name", DRIVES)
def test_disturbed_drives_have_a_finite_path(drive: tuple[list[Pair], Sequence], name: str) -> None:
    pairs, street = drive
    whole, truth = street.camera, street.truth
    height, width = pairs[0][0].shape
    camera = StereoCamera(
        whole.f, whole.cx - COLUMNS.start, whole.cy - ROWS.start, whole.baseline, width, height
    )
    sequence = shown(street, [DRIVES[name].images(pairs, i) for i in range(FRAMES)], camera)
    assert truth is not None
    path = inverse(truth[0]) @ truth[[DRIVES[name].shown(i) for i in range(FRAMES)]]
    if name.startswith("left"):  # only the camera stops, not the vehicle
        path = inverse(truth[0]) @ truth[:FRAMES]
    assert np.isfinite(run(sequence, preset("solution_selection")).poses).all()
    result = run(sequence, preset("solution_selection", variant="kit"))
    off = float(np.linalg.norm((result.poses - path)[-1, :3, 3]))
    assert off <= OFF_M.get(name, USUALLY_OFF_M)


def test_repeated_pair_changes_no_state(street: Sequence) -> None:
    config = preset("feature_selection", variant="kit")
    index = [0, 1, 2, 3, 3, 4]
    method = MethodRun(street, config)
    assert isinstance(method.odometry, SelfCalibratingOdometry)
    sequence = shown(street, [street.stereo(i) for i in index])
    for frame in frames(sequence, config):
        rig = method.odometry.rig
        before = method.odometry.e_prev, rig.estimate, rig.covariance
        if frame.index == 0:
            method.start(frame)
        else:
            method.step(frame)
        after = method.odometry.e_prev, rig.estimate, rig.covariance
        equal = [a is b or np.array_equal(a, b) for a, b in zip(before, after, strict=True)]  # type: ignore[arg-type]
        assert all(equal) == (frame.index in (0, 4))
    step = method.motions[3]
    assert step.flags == (Flag.STANDSTILL,)
    assert np.linalg.norm(step.T_cp[:3, 3]) < 0.01  # metres


def test_a_missing_motion_is_the_last_one_of_a_moving_camera() -> None:
    """A repeated image looks like a standstill; the camera of a vehicle goes on all the same."""
    odometry = make_odometry(CAMERA, preset("solution_selection", variant="kit"))
    odometry.start(no_boxes())
    missing = odometry.step(empty_matches(), no_boxes()).motion
    assert missing.flags == (Flag.FEW_MATCHES,)
    np.testing.assert_array_equal(missing.T_cp, np.eye(4))
    matches, _, t_cp = next(iter(drive_of(1, Faults(), noise=0.0)))
    moving = odometry.step(matches, no_boxes()).motion
    np.testing.assert_allclose(moving.T_cp[:3, 3], t_cp, atol=1e-3)
    still = replace(matches, cur_left=matches.prev_left, cur_right=matches.prev_right)
    assert odometry.step(still, no_boxes()).motion.flags == (Flag.STANDSTILL,)
    for _ in range(2):
        repeated = odometry.step(empty_matches(), no_boxes()).motion
        assert repeated.flags == (Flag.FEW_MATCHES,)
        np.testing.assert_array_equal(repeated.T_cp, moving.T_cp)
