"""The second visit of chapter 9: two pieces of a sequence, which one command fetches."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from course.ch09 import second_visit
from vo_lib.data.kitti import PART
from vo_lib.data.poses import write_kitti_poses
from vo_lib.data.sequence import Sequence


def as_two_pieces(sequence: Sequence, first: range, second: range, folder: Path) -> None:
    """Write frames of a sequence as the frames FIRST and SECOND of a benchmark sequence."""
    numbers = [*second_visit.FIRST, *second_visit.SECOND]
    poses = np.tile(np.eye(4), (1101, 1, 1))
    for number, index in zip(numbers, [*first, *second], strict=True):
        for side in sequence.sides:
            (folder / side).mkdir(parents=True, exist_ok=True)
            source = sequence.folder / side / f"{sequence.frames[index]}.png"
            shutil.copy(source, folder / side / f"{number:06d}.png")
        poses[number] = sequence.true_poses[index]
    shutil.copy(sequence.folder / "calib.txt", folder)
    (folder / "times.txt").write_text("".join(f"{0.1 * k:.1f}\n" for k in range(1101)), encoding="utf-8")
    (folder / PART).write_text("--sequences 06 --frames 122:139,953:968\n", encoding="utf-8")
    poses_file = folder.parents[1] / "poses" / "06.txt"
    poses_file.parent.mkdir()
    write_kitti_poses(poses_file, poses)


def test_the_command_fetches_the_frames_that_the_chapter_opens() -> None:
    words = second_visit.COMMAND.split()
    frames = f"{second_visit.FIRST.start}:{second_visit.FIRST.stop}"
    frames += f",{second_visit.SECOND.start}:{second_visit.SECOND.stop}"
    assert words == ["vo", "data", "get_kitti", "--sequences", second_visit.NAME[-2:], "--frames", frames]


def test_the_two_pieces_are_found_with_their_truth(
    street: Sequence, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("KITTI_ROOT", str(tmp_path))
    first, second = range(17), range(len(street) - 31, len(street) - 16)
    as_two_pieces(street, first, second, tmp_path / "sequences" / "06")
    visit = second_visit.real_visit()
    assert visit is not None
    assert visit.pieces == [range(17), range(17, 32)]
    np.testing.assert_allclose(visit.true_poses, street.true_poses[[*first, *second]], atol=1e-6)
    assert np.array_equal(visit.left(20), street.left(second[3]))
    for side in visit.sides:
        (tmp_path / "sequences" / "06" / side / "000967.png").unlink()
    (tmp_path / "sequences" / "06" / PART).write_text(
        "--sequences 06 --frames 122:139,953:967\n", encoding="utf-8"
    )
    assert second_visit.real_visit() is None


def test_the_whole_sequence_has_the_two_pieces_too(street: Sequence) -> None:
    visit = second_visit.two_pieces(street, range(3, 6), range(50, 52))
    assert visit is not None
    assert [int(frame) for frame in visit.frames] == [3, 4, 5, 50, 51]
    np.testing.assert_array_equal(visit.times, street.times[[3, 4, 5, 50, 51]])
    assert second_visit.two_pieces(street, range(3, 6), range(len(street) - 1, len(street) + 1)) is None
