"""KITTI-layout folders: what is read, what is refused, and with which words."""

from __future__ import annotations

import shutil
import struct
import zlib
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from conftest import BASELINE, FOCAL, HEIGHT, WIDTH

from vo_lib import DataError, available, open_sequence
from vo_lib.data.kitti import read_image
from vo_lib.data.sequence import stereo_ahead

SIDES = ("image_0", "image_1")


def test_a_folder_is_read_with_camera_times_and_truth(bands: Path) -> None:
    sequence = open_sequence(bands)
    assert len(sequence) == 6
    assert sequence.frames[0] == "000000"
    camera = sequence.camera
    assert (camera.f, camera.cx, camera.cy) == (FOCAL, WIDTH / 2, HEIGHT / 2)
    assert (camera.baseline, camera.width, camera.height) == (BASELINE, WIDTH, HEIGHT)
    assert sequence.truth is not None
    assert sequence.truth[5, 0, 3] == 5 * BASELINE
    np.testing.assert_allclose(sequence.times[5], 0.5)


def test_the_baseline_is_the_distance_between_both_cameras(bands: Path) -> None:
    """KITTI's colour cameras stand beside the origin: P2 has a last column of its own."""
    words = (bands / "calib.txt").read_text(encoding="utf-8").split()
    words[4] = str(float(words[4]) + 30.0)  # P0[0,3]
    words[17] = str(float(words[17]) + 30.0)  # P1[0,3]
    (bands / "calib.txt").write_text(f"{' '.join(words[:13])}\n{' '.join(words[13:])}\n", encoding="utf-8")
    assert open_sequence(bands).camera.baseline == pytest.approx(BASELINE)


def test_a_label_folder_asked_for_has_labels(bands: Path) -> None:
    (bands / "labels").mkdir()
    assert len(open_sequence(bands).boxes(1)) == 0
    for folder, words in (("labels", "no label file is named after a frame"), ("none", "folder is missing")):
        with pytest.raises(DataError, match=words):
            open_sequence(bands, labels=bands / folder)


def test_images_decoded_ahead_come_in_order(bands: Path) -> None:
    sequence = open_sequence(bands)
    for ahead in (1, 4, 20):
        pairs = list(stereo_ahead(sequence, lambda pair: pair, ahead))
        assert len(pairs) == len(sequence)
        for index, pair in enumerate(pairs):
            np.testing.assert_array_equal(pair, sequence.stereo(index))


def test_a_part_keeps_images_times_and_truth_together(bands: Path) -> None:
    part = open_sequence(bands).part(2, 5)
    assert part.frames == ("000002", "000003", "000004")
    assert part.truth is not None
    assert part.truth[0, 0, 3] == 2 * BASELINE
    np.testing.assert_allclose(part.times[0], 0.2)


@pytest.mark.parametrize(("start", "stop"), [(0, 7), (-1, 3), (3, 3), (4, 5), (5, 2)])
def test_a_part_outside_or_too_short_is_refused(bands: Path, start: int, stop: int) -> None:
    with pytest.raises(DataError, match="0:6"):
        open_sequence(bands).part(start, stop)


def test_truth_beside_the_sequences_is_found_and_longer_files_are_read_by_number(bands: Path) -> None:
    root = bands.parent / "root"
    shutil.copytree(bands, root / "sequences" / "05")
    folder = root / "sequences" / "05"
    (root / "poses").mkdir()
    (folder / "poses.txt").rename(root / "poses" / "05.txt")
    remove_pairs(0)(folder)
    sequence = open_sequence(folder)
    assert sequence.truth is not None
    assert sequence.truth[:, 0, 3].tolist() == [BASELINE * i for i in range(1, 6)]
    assert sequence.times[0] == 0.1


def test_names_are_found_under_the_kitti_root(bands: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    root = bands.parent / "kitti"
    shutil.copytree(bands, root / "dataset" / "sequences" / "07")
    monkeypatch.setenv("KITTI_ROOT", str(root))
    assert available()["kitti/07"] == (root / "dataset" / "sequences" / "07").resolve()
    assert open_sequence("kitti/07").name == "kitti/07"
    with pytest.raises(DataError, match="kitti/08 was not found"):
        open_sequence("kitti/08")


def edit(name: str, change: Callable[[str], str]) -> Callable[[Path], object]:
    def apply(folder: Path) -> object:
        path = folder / name
        return path.write_text(change(path.read_text(encoding="utf-8")), encoding="utf-8")

    return apply


def cut(name: str, rows: int) -> Callable[[Path], object]:
    """An image's first rows only."""
    return lambda folder: cv2.imwrite(str(folder / name), cv2.imread(str(folder / name), 0)[:rows])  # type: ignore[index]


def foreign_labels(folder: Path) -> object:
    (folder / "labels").mkdir()
    return (folder / "labels" / "frame1.txt").write_text("", encoding="utf-8")


def remove_pairs(*frames: int) -> Callable[[Path], object]:
    def apply(folder: Path) -> None:
        for side in SIDES:
            for frame in frames:
                (folder / side / f"{frame:06d}.png").unlink()

    return apply


def claim_more_pixels_than_opencv_takes(folder: Path) -> object:
    path = folder / "image_1" / "000003.png"
    data = path.read_bytes()
    header = b"IHDR" + struct.pack(">IIBBBBB", 100_000, 100_000, 8, 0, 0, 0, 0)
    return path.write_bytes(data[:12] + header + struct.pack(">I", zlib.crc32(header)) + data[33:])


def number_twice(folder: Path) -> object:
    return [shutil.copy(folder / side / "000002.png", folder / side / "2.png") for side in SIDES]


# What a single file says wrong is in tests/bad_files.json; here is what shows beside the images.
FAULTS: dict[str, tuple[Callable[[Path], object], str]] = {
    "no calib.txt": (lambda f: (f / "calib.txt").unlink(), r"calib\.txt: .*missing"),
    "P1 twice": (edit("calib.txt", lambda t: t + t.split("\n")[1]), r"calib\.txt, line 3: P1 .* twice"),
    "huge focal length": (edit("calib.txt", lambda t: t.replace("300.0", "3e300")), r"txt, line 1: P0"),
    "centre outside": (
        edit("calib.txt", lambda t: t.replace("240.0", "90000")),
        r"calib\.txt, line 1: P0: principal point 90000,120: .*inside the 480×240 px images",
    ),
    "centre above": (edit("calib.txt", lambda t: t.replace("120.0", "-1")), r"line 1: P0: principal point"),
    "too long": (edit("calib.txt", lambda t: t.replace("300.0", "30000")), r"line 1: P0: .*0\.9 degrees"),
    "too short": (edit("calib.txt", lambda t: t.replace("300.0", "30")), r"line 1: P0: focal length 30 px"),
    "far centre": (edit("calib.txt", lambda t: t.replace("240.0", "-6e9")), r"calib\.txt, line 1: P0"),
    "image missing": (lambda f: (f / "image_0" / "000002.png").unlink(), r"image_0/000002\.png: .*missing"),
    "pair missing": (remove_pairs(2), r"000002\.png: .*missing in the middle"),
    "no right folder": (lambda f: shutil.rmtree(f / "image_1"), "image_1 is missing"),
    "too small": (
        cut("image_0/000000.png", 20),
        r"image_0/000000\.png: .* 480×20, expected 32×32 px",
    ),
    "too large": (claim_more_pixels_than_opencv_takes, r"image_1/000003\.png: .*cannot be decoded"),
    "number twice": (number_twice, r"image_0/.*2\.png: the image has the number of .*2\.png"),
    "size": (cut("image_1/000002.png", 230), r"image_1/000002\.png: .* 480×230, expected 480×240"),
    "one frame": (remove_pairs(1, 2, 3, 4, 5), "two stereo pairs"),
    "no times": (lambda f: (f / "times.txt").unlink(), r"times\.txt: .*missing"),
    "times short": (edit("times.txt", lambda t: "\n".join(t.split("\n")[:3])), r"times\.txt: 3 rows for 6"),
    "truth short": (edit("poses.txt", lambda t: "\n".join(t.split("\n")[:3])), r"poses\.txt: 3 rows for 6"),
    "label names": (foreign_labels, "no label file is named after a frame"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_is_one_line_that_names_the_place(bands: Path, fault: str) -> None:
    spoil, words = FAULTS[fault]
    spoil(bands)
    with pytest.raises(DataError, match=words) as caught:
        list(stereo_ahead(open_sequence(bands), lambda pair: pair))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("keep", [0, 7, 60, 0.5, 0.9, 0.999, None])
def test_no_truncated_or_damaged_png_is_taken_for_an_image(bands: Path, keep: float | None) -> None:
    path = bands / "image_0" / "000000.png"
    data = bytearray(path.read_bytes())
    if keep is None:
        data[len(data) // 2] ^= 0x10
    else:
        del data[keep if isinstance(keep, int) else int(keep * len(data)) :]
    path.write_bytes(data)
    with pytest.raises(DataError, match="truncated or damaged"):
        read_image(path)


def test_a_missing_folder_is_named() -> None:
    with pytest.raises(DataError, match="nowhere/at/all: the folder is missing"):
        open_sequence("nowhere/at/all")
    with pytest.raises(DataError, match="kitti/99 was not found"):
        open_sequence("kitti/99")
