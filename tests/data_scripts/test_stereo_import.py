"""Folders and videos become sequences in KITTI's layout: linked, copied or rectified, whole or not at all."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from fetch.stereo_calibration import Rig, rig_from_matrices
from fetch.stereo_import import write_sequence
from fetch.stereo_sources import FolderSource, VideoSource, pair_folders
from vo_lib.core.errors import DataError
from vo_lib.core.geometry import rotation_from_vector
from vo_lib.data.sequence import open_sequence

RIG = Rig(300.0, 240.0, 120.0, 0.5)
K = np.array([[300.0, 0, 240], [0, 300, 120], [0, 0, 1]])


@pytest.fixture
def source(bands: Path) -> FolderSource:
    """The band images under names of their own, as a user would have them."""
    for side in ("image_0", "image_1"):
        for path in sorted((bands / side).iterdir()):
            path.rename(path.with_name(f"img_{int(path.stem) + 7}.png"))
    return FolderSource(pair_folders(bands / "image_0", bands / "image_1"))


def test_png_images_are_linked_in_order_and_the_sequence_opens(source: FolderSource, tmp_path: Path) -> None:
    count = write_sequence(source, RIG, tmp_path / "new" / "mine", times=5.0)
    sequence = open_sequence(tmp_path / "new" / "mine")
    assert count == len(sequence) == 6
    first = tmp_path / "new" / "mine" / "image_0" / "000000.png"
    assert first.is_symlink()
    assert first.resolve().name == "img_7.png"
    assert (tmp_path / "new" / "mine" / "image_1" / "000005.png").resolve().name == "img_12.png"
    assert (sequence.camera.f, sequence.camera.baseline) == (300.0, 0.5)
    np.testing.assert_allclose(sequence.times, np.arange(6) / 5)
    assert sequence.truth is None


@pytest.mark.parametrize("links", [True, False])
def test_where_links_are_unwanted_or_impossible_there_are_copies(
    source: FolderSource, bands: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, links: bool
) -> None:
    def refuse(*arguments: object, **options: object) -> None:
        raise OSError(1, "a required privilege is not held")

    if not links:
        monkeypatch.setattr(Path, "symlink_to", refuse)
    before = source.sample()[0][0]
    write_sequence(source, RIG, tmp_path / "mine", times=10.0, copy=links)
    shutil.rmtree(bands)
    np.testing.assert_array_equal(open_sequence(tmp_path / "mine").stereo(0)[0], before)


def test_truth_and_times_come_along(source: FolderSource, tmp_path: Path) -> None:
    poses = np.tile(np.eye(4), (6, 1, 1))
    poses[:, 0, 3] = 0.5 * np.arange(6)
    times = np.array([0.0, 0.2, 0.3, 0.5, 0.6, 0.9])
    write_sequence(source, RIG, tmp_path / "mine", times, poses)
    sequence = open_sequence(tmp_path / "mine")
    np.testing.assert_allclose(sequence.times, times)
    np.testing.assert_allclose(np.asarray(sequence.truth), poses)
    for wrong in ({"times": times[:5]}, {"times": times, "poses": poses[:4]}):
        with pytest.raises(DataError, match="expected one row a pair"):
            write_sequence(source, RIG, tmp_path / "other", **wrong)  # type: ignore[arg-type]
        assert not (tmp_path / "other").exists()


def test_other_kinds_of_images_are_written_as_png(source: FolderSource, tmp_path: Path) -> None:
    for side, index in (("l", 0), ("r", 1)):
        (tmp_path / side).mkdir()
        for number, pair in enumerate(source.paths):
            image = cv2.imread(str(pair[index]), cv2.IMREAD_COLOR)
            assert image is not None
            cv2.imwrite(str(tmp_path / side / f"{number}.bmp"), image)
    found = FolderSource(pair_folders(tmp_path / "l", tmp_path / "r"))
    assert found.files() is None
    write_sequence(found, RIG, tmp_path / "mine", times=10.0)
    np.testing.assert_array_equal(open_sequence(tmp_path / "mine").stereo(3)[1], source.sample()[3][1])


def test_a_full_calibration_rectifies_the_images(source: FolderSource, tmp_path: Path) -> None:
    turn, none = rotation_from_vector(np.array([0.0, 0.0, 0.02])), np.zeros(5)
    found = {"K1": K, "D1": none, "K2": K, "D2": none, "R": turn, "T": turn @ [-0.5, 0.0, 0.0]}
    rig = rig_from_matrices(found, (480, 240), Path("rig.yml"))
    write_sequence(source, rig, tmp_path / "mine", times=10.0)
    sequence = open_sequence(tmp_path / "mine")
    assert sequence.camera.baseline == pytest.approx(0.5)
    for mine, expected in zip(sequence.stereo(2), rig.rectify(*source.sample()[2]), strict=True):
        np.testing.assert_array_equal(mine, expected)


def test_a_video_side_by_side_is_split(source: FolderSource, tmp_path: Path) -> None:
    path = tmp_path / "both.avi"
    video = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 12.5, (960, 240))
    for left, right in source.sample():
        video.write(cv2.cvtColor(np.hstack([left, right]), cv2.COLOR_GRAY2BGR))
    video.release()
    found = VideoSource(path)
    assert found.fps() == pytest.approx(12.5)
    assert write_sequence(found, RIG, tmp_path / "mine", times=found.fps()) == 6
    left, right = open_sequence(tmp_path / "mine").stereo(1)
    for seen, drawn in ((left, source.sample()[1][0]), (right, source.sample()[1][1])):
        # JPEG changes grey levels a little.
        assert np.abs(seen.astype(int) - drawn).mean() < 6
    swapped = VideoSource(path, swap=True).sample()[0]
    np.testing.assert_array_equal(swapped[0], found.sample()[0][1])
    (tmp_path / "text.mp4").write_text("no video", encoding="utf-8")
    with pytest.raises(DataError, match="no video that OpenCV"):
        VideoSource(tmp_path / "text.mp4").sample()


def test_files_pair_by_name_else_by_number(tmp_path: Path) -> None:
    def folder(name: str, names: list[str]) -> Path:
        (tmp_path / name).mkdir()
        for stem in names:
            (tmp_path / name / f"{stem}.png").write_bytes(b"")
        return tmp_path / name

    a = folder("a", ["1", "2", "10"])
    assert [left.stem for left, _ in pair_folders(a, folder("b", ["10", "2", "1"]))] == ["1", "2", "10"]
    by_order = pair_folders(a, folder("c", ["r1", "r2", "r10"]))
    assert [(left.stem, right.stem) for left, right in by_order] == [("1", "r1"), ("2", "r2"), ("10", "r10")]
    for name, names, words in (
        ("d", ["1", "2"], "the image 10 is missing"),
        ("e", ["x1", "x2"], "has 2 images"),
        ("f", ["1"], "found 1"),
    ):
        with pytest.raises(DataError, match=words):
            pair_folders(a, folder(name, names))


def test_an_image_that_fails_in_the_middle_leaves_nothing(source: FolderSource, tmp_path: Path) -> None:
    source.paths[4][1].write_bytes(b"")
    same: Any = cv2.initUndistortRectifyMap(K, np.zeros(5), np.eye(3), K, (480, 240), cv2.CV_16SC2)
    rig = Rig(RIG.f, RIG.cx, RIG.cy, RIG.baseline, (same, same))
    with pytest.raises(DataError, match=r"img_11\.png"):
        write_sequence(source, rig, tmp_path / "mine", times=10.0)
    assert [p.name for p in tmp_path.iterdir()] == ["bands"]


def test_a_folder_with_something_in_it_is_left_alone(source: FolderSource, tmp_path: Path) -> None:
    (tmp_path / "mine").mkdir()
    write_sequence(source, RIG, tmp_path / "mine", times=10.0)
    with pytest.raises(DataError, match="not empty"):
        write_sequence(source, RIG, tmp_path / "mine", times=10.0)
