"""Folders and videos become sequences in KITTI's layout, with linked, copied or rectified images."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from fetch.stereo_calibration import RectifiedRig, rig_from_matrices
from fetch.stereo_import import write_sequence
from fetch.stereo_sources import FolderSource, VideoSource, pair_images
from vo_lib.data.catalogue import open_sequence
from vo_lib.errors import DataError
from vo_lib.geometry.motion import rotation_from_vector

RIG = RectifiedRig(300.0, 240.0, 120.0, 0.5)
K = np.array([[300.0, 0, 240], [0, 300, 120], [0, 0, 1]])


@pytest.fixture
def source(bands: Path) -> FolderSource:
    """The band images under other names, as in a user's folder."""
    for side in ("image_0", "image_1"):
        for path in sorted((bands / side).iterdir()):
            path.rename(path.with_name(f"img_{int(path.stem) + 7}.png"))
    return pair_images(bands / "image_0", bands / "image_1")


def test_png_images_are_linked_in_order(source: FolderSource, tmp_path: Path) -> None:
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


def renamed(bands: Path, name: Callable[[int, int], str]) -> Path:
    """All band images in one folder, named by camera and frame."""
    for side in range(2):
        for path in sorted((bands / f"image_{side}").iterdir()):
            path.rename(bands / name(side, int(path.stem)))
    return bands


def numbers(source: FolderSource, bands: Path) -> list[str]:
    """Names of the pairs of a source."""
    return [" ".join(str(path.relative_to(bands)) for path in pair) for pair in source.paths]


def test_patterns_pair_images_of_one_folder(bands: Path) -> None:
    renamed(bands, lambda side, frame: f"I{side + 1}_{frame}.png")
    (bands / "I2_3.png").unlink()
    patterns = bands / "I1_*.png", bands / "I2_*.png"
    with pytest.raises(DataError, match=r"I1_3\.png: the image has no partner; --skip-unpaired"):
        pair_images(*patterns)
    result = pair_images(*patterns, skip_unpaired=True)
    assert numbers(result, bands) == [f"I1_{n}.png I2_{n}.png" for n in (0, 1, 2, 4, 5)]
    gap = "the numbers have a gap of 1 frame after I1_2.png; the times have the same"
    assert result.note == f"images without a partner, skipped: 1; {gap}"
    assert result.frames is not None
    assert result.frames.tolist() == [0, 1, 2, 4, 5]
    assert result.of_pairs(np.arange(6.0)).tolist() == [0, 1, 2, 4, 5]  # rows of all left images
    assert result.of_pairs(np.arange(5.0)).tolist() == [0, 1, 2, 3, 4]  # rows of the pairs
    with pytest.raises(DataError, match="expected two or more images, found 0"):
        pair_images(bands / "I1_*.png", bands / "I3_*.png")


@pytest.mark.parametrize(
    ("left", "right"),
    [
        ("frame{:04d}", "img_{:06d}_R"),
        ("{}", "{:02d}"),
        ("z{}", "{}a"),
        ("1_{}", "2_{:03d}_0"),
        ("{0}_{0}.5", "{0}_{0}.5"),  # two groups of digits: equal names
    ],
)
def test_names_that_are_not_times_are_paired_by_number(bands: Path, left: str, right: str) -> None:
    names = [[form.format(n) for n in range(7, 13)] for form in (f"L{left}", right)]
    renamed(bands, lambda side, frame: f"image_{side}/{names[side][frame]}.png")
    sides = bands / "image_0" / "L*", bands / "image_1"
    every = [f"image_0/{a}.png image_1/{b}.png" for a, b in zip(*names, strict=True)]
    assert numbers(pair_images(*sides), bands) == every
    # Without these images, the counts are equal and every third pair is complete.
    (bands / "image_0" / f"{names[0][1]}.png").unlink()
    (bands / "image_1" / f"{names[1][4]}.png").unlink()
    with pytest.raises(DataError, match=f"{names[0][4]}.png: the image has no partner; --skip-unpaired"):
        pair_images(*sides)
    result = pair_images(*sides, skip_unpaired=True)
    assert numbers(result, bands) == [every[n] for n in (0, 2, 3, 5)]
    assert result.left == (0, 1, 2, 4)


@pytest.mark.parametrize(
    ("left", "right"),
    [("abcdef", "ghijkl"), ("0a 0b 1a 1b 2a 2b", "0c 0d 1c 1d 2c 2d"), ("0 1 2 3 4 5", "5 6 7 8 9 10")],
)
def test_names_without_equal_numbers_are_refused(bands: Path, left: str, right: str) -> None:
    names = [words.split() if " " in words else [*words] for words in (left, right)]
    renamed(bands, lambda side, frame: f"image_{side}/{names[side][frame]}.png")
    with pytest.raises(DataError, match=r"image_1: fewer than two .*: expected equal names, equal numbers"):
        pair_images(bands / "image_0", bands / "image_1", skip_unpaired=True)


@pytest.mark.parametrize("digits", [0, 6])
def test_names_that_are_times_are_paired_by_time(bands: Path, digits: int) -> None:
    start = 1403636579763555584

    def name(side: int, frame: int) -> str:
        # The right camera is 2 ms late, and 20 ms late from frame 4 on.
        ns = start + 100_000_000 * frame + side * (20_000_000 if frame > 3 else 2_000_000)
        stamp = f"{ns // 10**9}.{ns % 10**9:09d}"[: 11 + digits] if digits else str(ns)
        return f"{'lr'[side]}_{stamp}.png"

    renamed(bands, name)
    sides = bands / "l_*.png", bands / "r_*.png"
    with pytest.raises(DataError, match="has no partner"):
        pair_images(*sides)
    result = pair_images(*sides, skip_unpaired=True)
    assert numbers(result, bands) == [f"{name(0, frame)} {name(1, frame)}" for frame in range(4)]
    assert result.note == "left and right images are up to 2.0 ms apart; images without a partner, skipped: 4"
    assert result.times is not None
    np.testing.assert_allclose(result.times - 1e-9 * start, [0.0, 0.1, 0.2, 0.3], atol=1e-5)
    assert len(pair_images(*sides, max_delay=0.03).paths) == 6
    with pytest.raises(DataError, match=r"at most --max-delay 0.001 s apart; .* are 0.002 s apart"):
        pair_images(*sides, max_delay=0.001)


def test_truth_and_times_are_written(source: FolderSource, tmp_path: Path) -> None:
    poses = np.tile(np.eye(4), (6, 1, 1))
    poses[:, 0, 3] = 0.5 * np.arange(6)
    times = np.array([0.0, 0.2, 0.3, 0.5, 0.6, 0.9])
    write_sequence(source, RIG, tmp_path / "mine", times, poses)
    sequence = open_sequence(tmp_path / "mine")
    np.testing.assert_allclose(sequence.times, times)
    np.testing.assert_allclose(np.asarray(sequence.truth), poses)
    with pytest.raises(DataError, match="expected a row per pair or per left image"):
        write_sequence(source, RIG, tmp_path / "other", times, poses[:4])
    assert not (tmp_path / "other").exists()


def test_full_calibration_rectifies_the_images(source: FolderSource, tmp_path: Path) -> None:
    turn, none = rotation_from_vector(np.array([0.0, 0.0, 0.02])), np.zeros(5)
    result = {"K1": K, "D1": none, "K2": K, "D2": none, "R": turn, "T": turn @ [-0.5, 0.0, 0.0]}
    rig = rig_from_matrices(result, (480, 240), Path("rig.yml"))
    write_sequence(source, rig, tmp_path / "mine", times=10.0)
    sequence = open_sequence(tmp_path / "mine")
    assert sequence.camera.baseline == pytest.approx(0.5)
    for mine, expected in zip(sequence.stereo(2), rig.rectify(*source.sample()[2]), strict=True):
        np.testing.assert_array_equal(mine, expected)


def test_side_by_side_video_is_split(source: FolderSource, tmp_path: Path) -> None:
    path = tmp_path / "both.avi"
    video = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 12.5, (960, 240))
    for left, right in source.sample():
        video.write(cv2.cvtColor(np.hstack([left, right]), cv2.COLOR_GRAY2BGR))
    video.release()
    result = VideoSource(path)
    assert result.fps() == pytest.approx(12.5)
    assert write_sequence(result, RIG, tmp_path / "mine", times=result.fps()) == 6
    left, right = open_sequence(tmp_path / "mine").stereo(1)
    for visible, drawn in ((left, source.sample()[1][0]), (right, source.sample()[1][1])):
        # JPEG changes grey levels a little.
        assert np.abs(visible.astype(int) - drawn).mean() < 6
    swapped = VideoSource(path, swap=True).sample()[0]
    np.testing.assert_array_equal(swapped[0], result.sample()[0][1])


@pytest.mark.parametrize("name", ["text.txt", "image.avi", "empty.avi"])
def test_other_files_are_not_videos(bands: Path, name: str) -> None:
    (bands / "text.txt").write_text("1.0 0.5 0.25\n" * 4000, encoding="utf-8")
    (bands / "image_0" / "000000.png").rename(bands / "image.avi")
    (bands / "empty.avi").touch()
    with pytest.raises(DataError, match=rf"{name}: is not a video that OpenCV can read"):
        VideoSource(bands / name).sample()


@pytest.mark.parametrize("rectified", [False, True])
def test_failed_import_leaves_no_files(
    source: FolderSource, bands: Path, tmp_path: Path, rectified: bool
) -> None:
    path = source.paths[4][1]
    same: Any = cv2.initUndistortRectifyMap(K, np.zeros(5), np.eye(3), K, (480, 240), cv2.CV_16SC2)
    rig = RIG if rectified else replace(RIG, maps=(same, same))
    for data, words in (
        (path.read_bytes()[:-100], "the image is truncated or damaged"),
        (cv2.imencode(".png", np.zeros((200, 480), np.uint8))[1].tobytes(), "480×200, expected 480×240"),
    ):
        path.write_bytes(data)
        with pytest.raises(DataError, match=rf"img_11\.png: .*{words}"):
            write_sequence(source, rig, tmp_path / "mine", times=10.0)
    assert [p.name for p in tmp_path.iterdir()] == ["bands"]
    with pytest.raises(DataError, match="not empty"):
        write_sequence(source, RIG, bands, times=10.0)
