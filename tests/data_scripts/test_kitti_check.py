"""A KITTI tree, complete or not: what is missing is named."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from conftest import write_bands

from fetch.kitti_check import SequenceReport, check_tree, in_ranges, parse_numbers
from vo_lib.core.errors import DataError
from vo_lib.data.kitti import EXPECTED_FRAMES, count_pairs

FRAMES = 6


@pytest.fixture
def tree(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A root with a complete sequence 04, which has six frames here."""
    monkeypatch.setitem(EXPECTED_FRAMES, "04", FRAMES)
    folder = write_bands(tmp_path / "root" / "sequences" / "04", FRAMES)
    (tmp_path / "root" / "poses").mkdir()
    (folder / "poses.txt").rename(tmp_path / "root" / "poses" / "04.txt")
    return tmp_path / "root"


def only(tree: Path, deep: bool = False) -> SequenceReport:
    (report,) = check_tree(tree, deep=deep)
    return report


def test_the_benchmark_has_43552_pairs_and_its_poses_a_row_for_each(clips: Path) -> None:
    assert sum(EXPECTED_FRAMES.values()) == 43552
    poses = clips.parent / "kitti_poses"
    if not poses.is_dir():
        pytest.skip("the pose files of 00-10 are not beside the clips")
    for path in sorted(poses.glob("*.txt")):
        assert EXPECTED_FRAMES[path.stem] == len(path.read_text(encoding="utf-8").splitlines())


@pytest.mark.parametrize("deep", [False, True])
def test_a_complete_sequence_has_no_problems(tree: Path, deep: bool) -> None:
    report = only(tree, deep)
    assert report.problems == ()
    assert (report.pairs, report.expected) == (FRAMES, FRAMES)
    parts = dict(report.parts)
    assert list(parts) == ["image_0", "image_1", "calib.txt", "times.txt", "poses/04.txt"]
    assert "480×240" in parts["image_0"]


def test_what_is_missing_or_wrong_is_named(tree: Path) -> None:
    folder = tree / "sequences" / "04"
    (folder / "image_1" / "000002.png").unlink()
    (folder / "image_0" / "000003.png").write_bytes(b"")
    shutil.copy(folder / "image_0" / "000000.png", folder / "image_0" / "000009.png")
    (folder / "times.txt").write_text("0\n0.1\n", encoding="utf-8")
    (folder / "calib.txt").unlink()
    (tree / "poses" / "04.txt").unlink()
    report = only(tree)
    assert report.pairs == FRAMES - 1
    assert set(report.problems) == {
        "image_1: missing 2",
        "image_0/000003.png: is empty or no PNG file",
        "image_0: not of this sequence: 9",
        "times.txt: 2 rows for 6 frames",
        "calib.txt: the file is missing",
        "poses/04.txt: the file is missing",
    }


def test_only_a_deep_look_finds_an_image_that_ends_early(tree: Path) -> None:
    path = tree / "sequences" / "04" / "image_0" / "000005.png"
    path.write_bytes(path.read_bytes()[:-40])
    assert only(tree).problems == ()
    (problem,) = only(tree, deep=True).problems
    assert problem.startswith("image_0/000005.png: the image is truncated")


def test_an_image_of_another_size_is_found(tree: Path) -> None:
    other = write_bands(tree.parent / "small", 2) / "image_0" / "000000.png"
    data = bytearray(other.read_bytes())
    data[16:20] = (100).to_bytes(4, "big")
    (tree / "sequences" / "04" / "image_1" / "000001.png").write_bytes(data)
    assert only(tree).problems == ("image_1/000001.png: 100×240, the others are 480×240",)


def test_a_sequence_of_ones_own_need_not_start_at_zero_but_have_no_gap(tree: Path) -> None:
    mine = write_bands(tree / "sequences" / "mine")
    for frame, problems in ((0, ()), (3, ("image_0: missing 3", "image_1: missing 3"))):
        for side in ("image_0", "image_1"):
            (mine / side / f"{frame:06d}.png").unlink()
        (report,) = check_tree(tree, ["mine"])
        assert report.problems == problems
        assert report.expected is None


def test_colour_images_are_checked_where_there_are_some(tree: Path) -> None:
    folder = tree / "sequences" / "04"
    shutil.copytree(folder / "image_0", folder / "image_2")
    assert only(tree).problems == ("image_3: no images",)


def test_what_is_asked_for_and_not_there_is_missing_as_a_whole(tree: Path, tmp_path: Path) -> None:
    (report,) = check_tree(tree, ["07"])
    assert report.pairs == 0
    assert {"image_0: no images", "poses/07.txt: the file is missing"} <= set(report.problems)
    with pytest.raises(DataError, match="no KITTI tree"):
        check_tree(tree / "poses")


def test_the_tree_as_the_archives_unpack_it_is_found(tree: Path, tmp_path: Path) -> None:
    tree.rename(tmp_path / "dataset")
    assert only(tmp_path).problems == ()
    assert count_pairs(tmp_path / "dataset" / "sequences" / "04") == FRAMES


def test_sequences_are_named_by_numbers_and_ranges() -> None:
    assert parse_numbers("07,04,07") == ["07", "04"]
    assert parse_numbers("09-11") == ["09", "10", "11"]
    for text in ("22", "7", "synthetic/jam", "", "05-03"):
        with pytest.raises(DataError, match="--sequences"):
            parse_numbers(text)


def test_numbers_far_apart_are_not_counted_through(tmp_path: Path) -> None:
    for side in ("image_0", "image_1"):
        (tmp_path / "sequences" / "mine" / side).mkdir(parents=True)
        for name in ("0", "9999999999", "9" * 200):
            (tmp_path / "sequences" / "mine" / side / f"{name}.png").write_bytes(b"")
    (report,) = check_tree(tmp_path)
    assert f"image_0: missing 1-9999999998, 10000000000-{'9' * 199}8" in report.problems


def test_frame_numbers_are_put_in_ranges() -> None:
    assert in_ranges([(5, 5)]) == "5"
    assert in_ranges([(3, 3), (1, 2), (7, 7), (9, 9)]) == "1-3, 7, 9"
    assert in_ranges((n, n) for n in range(0, 20, 2)) == "0, 2, 4, 6 and 6 more"


def test_real_clips_are_said_to_be_parts(clips: Path) -> None:
    reports = {report.name: report for report in check_tree(clips)}
    assert reports["00"].pairs == 201
    assert "image_0: missing 201-4540" in reports["00"].problems
    assert reports["drive_0005"].problems == ()
