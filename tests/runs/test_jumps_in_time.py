"""Drives with gaps, turned back, or with frames shown twice: the check believes what the images agree on."""

from __future__ import annotations

import itertools
import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from vo_lib import Sequence, open_sequence, preset, run
from vo_lib.core.frame import DOUBTFUL, REPEATED, TIME_JUMP
from vo_lib.core.geometry import inverse
from vo_lib.core.poses import format_kitti_poses
from vo_lib.core.types import Array
from vo_lib.core.vehicle import VehicleConfig
from vo_lib.runs.runner import Run, run_methods

Pick = Callable[[int], list[int]]  # from a number of frames to those shown
WORSE = 0.01  # metres


def there_and_back(n: int) -> list[int]:
    return [*range(n), *range(n - 2, -1, -1), *range(1, n // 2)]


DRIVES: dict[str, tuple[Pick, set[str]]] = {
    "as driven": (lambda n: list(range(n)), set()),
    "there and back": (there_and_back, {TIME_JUMP}),
    "a gap": (lambda n: [i for i in range(n) if not 11 <= i < 14], {TIME_JUMP}),
    "every fifth frame": (lambda n: list(range(0, n, 5)), set()),
    "begins with a jump": (lambda n: [0, *range(5, n)], {TIME_JUMP}),
    "the first frame twice": (lambda n: [0, *range(n)], {REPEATED}),
    "every frame twice": (lambda n: [i // 2 for i in range(2 * n)], {REPEATED}),
    "frozen for three frames": (lambda n: [10 if 10 <= i <= 13 else i for i in range(n)], {REPEATED}),
}


SOURCES = {"street": (100, 130), "00": (70, 100), "01": (10, 40)}


@pytest.fixture(scope="module", params=SOURCES)
def drive(request: pytest.FixtureRequest) -> Sequence:
    """A piece of the drawn street, or of a clip."""
    if request.param == "street":
        whole: Sequence = request.getfixturevalue("street")
    else:
        whole = open_sequence(request.getfixturevalue("clips") / "sequences" / request.param)
    return whole.part(*SOURCES[request.param])


def shown(folder: Path, drive: Sequence, frames: list[int]) -> Sequence:
    """A folder with some frames of a drive, a tenth of a second apart."""
    for side in ("image_0", "image_1"):
        (folder / side).mkdir(parents=True)
        for i, frame in enumerate(frames):
            os.symlink(drive.folder / side / f"{drive.frames[frame]}.png", folder / side / f"{i:06d}.png")
    (folder / "calib.txt").write_bytes((drive.folder / "calib.txt").read_bytes())
    times = "".join(f"{0.1 * i:.1f}\n" for i in range(len(frames)))
    (folder / "times.txt").write_text(times, encoding="utf-8")
    assert drive.truth is not None
    poses = inverse(drive.truth[frames[0]]) @ drive.truth[frames]
    (folder / "poses.txt").write_text(format_kitti_poses(poses), encoding="utf-8")
    return open_sequence(folder)


def off(result: Run) -> Array:
    assert result.sequence.truth is not None
    return np.asarray(np.linalg.norm((result.poses - result.sequence.truth)[:, :3, 3], axis=1))


@pytest.mark.parametrize("name", DRIVES)
def test_the_path_is_that_without_a_check(drive: Sequence, tmp_path: Path, name: str) -> None:
    pick, expected = DRIVES[name]
    require_no_worse(shown(tmp_path, drive, pick(len(drive))), expected)


def require_no_worse(sequence: Sequence, expected: set[str]) -> None:
    """With the check the path is nowhere farther off than without it; nothing is doubtful."""
    checked = preset("solution_selection")
    unchecked = replace(checked, vehicle=VehicleConfig(check=False))
    found = run_methods(sequence, {"with": checked, "without": unchecked})
    assert (off(found["with"]) <= off(found["without"]) + WORSE).all()
    flags = {flag for motion in found["with"].motions for flag in motion.flags}
    assert expected <= flags
    assert not flags & set(DOUBTFUL)


@pytest.mark.parametrize(
    "frames",
    [[36, 37, 38, 39, 48, 49, 50], [8, 9, 15, 16, 22, 23, 24, 25], [*range(0, 51, 5)]],
    ids=["one long", "two", "all the way"],
)
def test_gaps_on_a_motorway_are_believed_though_a_third_of_few_matches_agrees(
    clips: Path, tmp_path: Path, frames: list[int]
) -> None:
    require_no_worse(shown(tmp_path, open_sequence(clips / "sequences" / "01"), frames), {TIME_JUMP})


def test_the_way_of_a_gap_does_not_go_on_in_a_pair_without_a_motion(street: Sequence, tmp_path: Path) -> None:
    sequence = shown(tmp_path, street.part(100, 114), [*range(6), *range(9, 14)])
    for black in tmp_path.glob("*/000007.png"):
        black.unlink()
        cv2.imwrite(str(black), np.zeros((street.camera.height, street.camera.width), np.uint8))
    result = run(sequence, preset("solution_selection"))
    assert [i for i, motion in enumerate(result.motions) if motion.in_doubt] == [6, 7]
    assert TIME_JUMP in result.motions[5].flags
    assert off(result).max() < 0.1


@pytest.mark.parametrize("variant", ["kit", "published"])
@pytest.mark.parametrize("name", ["the first frame twice", "every frame twice"])
def test_a_pair_that_equals_the_one_before_changes_nothing(
    street: Sequence, tmp_path: Path, name: str, variant: str
) -> None:
    piece, config = street.part(100, 112), preset("solution_selection", variant=variant)
    frames = DRIVES[name][0](len(piece))
    once = run(shown(tmp_path / "once", piece, list(range(len(piece)))), config)
    twice = run(shown(tmp_path / "twice", piece, frames), config)
    assert np.abs(twice.poses - once.poses[frames]).max() < 1e-9
    repeated = [REPEATED in motion.flags for motion in twice.motions]
    assert repeated == [a == b for a, b in itertools.pairwise(frames)]
    which = "every second pair" if name.startswith("every") else "a pair"
    assert twice.doubts[0].startswith(f"{which} equals the one before: {sum(repeated)} of {len(repeated)}")
    assert once.doubts == ()
    assert twice.matches_per_frame == once.matches_per_frame
