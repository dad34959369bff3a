"""Check of a KITTI folder: missing and wrong files are listed."""

from __future__ import annotations

import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
from conftest import write_bands
from real_images import SHARED

from fetch.kitti_check import SequenceReport, check_tree, parse_numbers
from vo_lib.data.kitti import EXPECTED_FRAMES, count_pairs
from vo_lib.errors import DataError

FRAMES = 6


@pytest.fixture
def tree(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A root with a complete sequence 04 of six frames."""
    monkeypatch.setitem(EXPECTED_FRAMES, "04", FRAMES)
    folder = write_bands(tmp_path / "root" / "sequences" / "04", FRAMES)
    (tmp_path / "root" / "poses").mkdir()
    (folder / "poses.txt").rename(tmp_path / "root" / "poses" / "04.txt")
    return tmp_path / "root"


def only(tree: Path, deep: bool = False) -> SequenceReport:
    (report,) = check_tree(tree, deep=deep)
    return report


def test_expected_frames_agree_with_kitti() -> None:
    assert sum(EXPECTED_FRAMES.values()) == 43552
    poses = SHARED / "kitti_poses"
    if not poses.is_dir():
        pytest.skip("the pose files of 00-10 are not beside this checkout (shared/data/kitti_poses)")
    for path in sorted(poses.glob("*.txt")):
        assert EXPECTED_FRAMES[path.stem] == len(path.read_text(encoding="utf-8").splitlines())


def test_missing_and_wrong_files_are_listed(tree: Path) -> None:
    folder = tree / "sequences" / "04"
    (folder / "image_1" / "000002.png").unlink()
    shutil.copy(folder / "image_0" / "000000.png", folder / "image_0" / "000009.png")
    (folder / "times.txt").write_text("0\n0.1\n", encoding="utf-8")
    (folder / "calib.txt").unlink()
    (tree / "poses" / "04.txt").unlink()
    report = only(tree)
    assert report.pairs == count_pairs(folder) == FRAMES - 1
    assert set(report.problems) == {
        "image_1: 1 images missing, the first is 000002",
        "image_0: 1 images have wrong numbers, such as 000009",
        "times.txt: 2 rows for 6 frames",
        "calib.txt: the file is missing",
        "poses/04.txt: the file is missing",
    }


def test_damaged_images_are_listed(tree: Path) -> None:
    folder = tree / "sequences" / "04"
    cut, other = folder / "image_0" / "000005.png", folder / "image_1" / "000001.png"
    cut.write_bytes(cut.read_bytes()[:-40])
    cv2.imwrite(str(other), np.zeros((240, 100), np.uint8))
    assert only(tree).problems == ()  # only the deep check decodes images
    first, second = only(tree, deep=True).problems
    assert first.startswith("image_0/000005.png: the image is truncated")
    assert second == "image_1/000001.png: 100×240, the others are 480×240"


@pytest.mark.parametrize("first", [1403636579763555584, 20260101120000, 1700000000])
def test_names_that_are_times_are_listed_in_one_line(tmp_path: Path, first: int) -> None:
    folder = write_bands(tmp_path / "root" / "sequences" / "mine", FRAMES)
    for number in range(FRAMES):
        for side in ("image_0", "image_1"):
            old, new = f"{number:06d}.png", f"{first + number * 50_000_000}.png"
            (folder / side / old).rename(folder / side / new)
    (folder / "image_1" / f"{first}.png").unlink()
    assert set(only(tmp_path / "root").problems) == {
        "the names of the images are times, not numbers: convert with from_folder",
        f"image_1: 1 images missing, the first is {first}",
    }


def test_gap_in_a_users_clip_is_listed(tmp_path: Path) -> None:
    folder = write_bands(tmp_path / "root" / "sequences" / "mine", FRAMES)
    for side in ("image_0", "image_1"):
        (folder / side / "000005.png").rename(folder / side / "000300.png")
    problem = "images missing, the first is 000005"
    problems = {f"{side}: 295 {problem}" for side in ("image_0", "image_1")}
    problems |= {f"{name}: 6 rows for 301 frames" for name in ("times.txt", "poses.txt")}
    assert set(only(tmp_path / "root").problems) == problems


def test_sequence_numbers_and_ranges_are_parsed() -> None:
    assert parse_numbers("07,04,07") == ["07", "04"]
    assert parse_numbers("09-11") == ["09", "10", "11"]
    for text in ("22", "synthetic/jam", "05-03"):
        with pytest.raises(DataError, match=r"sequences .*expected"):
            parse_numbers(text)
