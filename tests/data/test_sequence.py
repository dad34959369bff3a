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
    with pytest.raises(DataError, match="no label file is named after a frame"):
        open_sequence(bands, labels=bands / "labels")


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
    for side in ("image_0", "image_1"):
        (folder / side / "000000.png").unlink()
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


def labels(text: str, name: str = "000001.txt") -> Callable[[Path], object]:
    def apply(folder: Path) -> object:
        (folder / "labels").mkdir()
        return (folder / "labels" / name).write_text(text, encoding="utf-8")

    return apply


def truncate(folder: Path) -> object:
    path = folder / "image_1" / "000003.png"
    return path.write_bytes(path.read_bytes()[:-200])


def shrink(folder: Path) -> object:
    path = str(folder / "image_1" / "000002.png")
    return cv2.imwrite(path, cv2.imread(path, 0)[:-10])  # type: ignore[index]


def remove_frames(folder: Path) -> object:
    for side in ("image_0", "image_1"):
        for path in sorted((folder / side).iterdir())[1:]:
            path.unlink()
    return edit("poses.txt", lambda text: text.split("\n")[0] + "\n")(folder)


def remove_pair(folder: Path) -> object:
    for side in ("image_0", "image_1"):
        (folder / side / "000002.png").unlink()
    return None


def cut_to_a_strip(folder: Path) -> object:
    path = str(folder / "image_0" / "000000.png")
    return cv2.imwrite(path, cv2.imread(path, 0)[:20])  # type: ignore[index]


def claim_more_pixels_than_opencv_takes(folder: Path) -> object:
    path = folder / "image_1" / "000003.png"
    data = path.read_bytes()
    header = b"IHDR" + struct.pack(">IIBBBBB", 100_000, 100_000, 8, 0, 0, 0, 0)
    return path.write_bytes(data[:12] + header + struct.pack(">I", zlib.crc32(header)) + data[33:])


def number_twice(folder: Path) -> object:
    for side in ("image_0", "image_1"):
        shutil.copy(folder / side / "000002.png", folder / side / "2.png")
    return None


FAULTS: dict[str, tuple[Callable[[Path], object], str]] = {
    "no calib.txt": (lambda f: (f / "calib.txt").unlink(), r"calib\.txt: .*missing"),
    "no P1": (edit("calib.txt", lambda t: t.split("P1")[0]), r"calib\.txt: P1 is missing"),
    "P1 twice": (
        edit("calib.txt", lambda t: t + t.split("\n")[1]),
        r"calib\.txt, line 3: P1 stands there twice",
    ),
    "P1 short": (edit("calib.txt", lambda t: t.rstrip()[:-2]), r"calib\.txt, line 2: P1: expected 12"),
    "zero baseline": (edit("calib.txt", lambda t: t.replace("-150.0", "0")), r"line 2: .*baseline"),
    "wrong sign": (edit("calib.txt", lambda t: t.replace("-150.0", "150")), r"line 2: .*baseline"),
    "not rectified": (edit("calib.txt", lambda t: t[:60] + t[60:].replace("300.0", "310")), "rectified"),
    "huge baseline": (edit("calib.txt", lambda t: t.replace("-150.0", "-1e200")), r"line 2: .*baseline"),
    "huge focal length": (
        edit("calib.txt", lambda t: t.replace("300.0", "3e300")),
        r"calib\.txt, line 1: P0",
    ),
    "centre outside": (
        edit("calib.txt", lambda t: t.replace("240.0", "90000")),
        r"calib\.txt, line 1: P0: principal point 90000,120: .*inside the 480×240 px images",
    ),
    "centre above": (edit("calib.txt", lambda t: t.replace("120.0", "-1")), r"line 1: P0: principal point"),
    "too long": (edit("calib.txt", lambda t: t.replace("300.0", "30000")), r"line 1: P0: .*0\.9 degrees"),
    "too short": (edit("calib.txt", lambda t: t.replace("300.0", "30")), r"line 1: P0: focal length 30 px"),
    "far centre": (edit("calib.txt", lambda t: t.replace("240.0", "-6e9")), r"calib\.txt, line 1: P0"),
    "image missing": (lambda f: (f / "image_0" / "000002.png").unlink(), r"image_0/000002\.png: .*missing"),
    "pair missing": (remove_pair, r"000002\.png: .*missing in the middle"),
    "no right folder": (lambda f: shutil.rmtree(f / "image_1"), "image_1 is missing"),
    "truncated": (truncate, r"image_1/000003\.png: .*truncated"),
    "too small": (cut_to_a_strip, r"image_0/000000\.png: the image is 480×20, expected 32×32 px or more"),
    "too large": (claim_more_pixels_than_opencv_takes, r"image_1/000003\.png: .*cannot be decoded"),
    "number twice": (number_twice, r"image_0/.*2\.png: the image has the number of .*2\.png"),
    "size": (shrink, r"image_1/000002\.png: the image is 480×230, expected 480×240"),
    "one frame": (remove_frames, "two stereo pairs"),
    "no times": (lambda f: (f / "times.txt").unlink(), r"times\.txt: .*missing"),
    "times short": (edit("times.txt", lambda t: "\n".join(t.split("\n")[:3])), r"times\.txt: 3 rows for 6"),
    "times text": (edit("times.txt", lambda t: t.replace("2.000000e-01", "soon")), r"times\.txt, line 3"),
    "truth short": (edit("poses.txt", lambda t: "\n".join(t.split("\n")[:3])), r"poses\.txt: 3 rows for 6"),
    "truth nan": (edit("poses.txt", lambda t: t.replace("1 0 0 0.5", "1 0 0 nan")), r"poses\.txt, line 2"),
    "label fields": (labels("2 0.5 0.5 0.1\n"), r"000001\.txt, line 1: expected class cx cy w h"),
    "label range": (labels("2 0.5 0.5 0.1 1.1\n"), r"000001\.txt, line 1: .*0\.\.1"),
    "label class": (labels(f"{10**23} 0.5 0.5 0.1 0.1\n"), r"000001\.txt, line 1: expected a class number"),
    "label names": (labels("", "frame1.txt"), "no label file is named after a frame"),
}


def read_everything(folder: Path) -> None:
    sequence = open_sequence(folder)
    for index, _ in enumerate(stereo_ahead(sequence, lambda pair: pair)):
        sequence.boxes(index)


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_is_one_line_that_names_the_place(bands: Path, fault: str) -> None:
    spoil, words = FAULTS[fault]
    spoil(bands)
    with pytest.raises(DataError, match=words) as caught:
        read_everything(bands)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("keep", [0, 7, 60, 0.5, 0.9, 0.999])
def test_no_truncated_png_is_taken_for_an_image(bands: Path, keep: float) -> None:
    path = bands / "image_0" / "000000.png"
    data = path.read_bytes()
    path.write_bytes(data[: keep if isinstance(keep, int) else int(keep * len(data))])
    with pytest.raises(DataError, match="truncated"):
        read_image(path)


def test_a_damaged_png_is_noticed(bands: Path) -> None:
    path = bands / "image_0" / "000000.png"
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 0x10
    path.write_bytes(data)
    with pytest.raises(DataError, match="damaged"):
        read_image(path)


def test_a_missing_folder_is_named() -> None:
    with pytest.raises(DataError, match="nowhere/at/all: the folder is missing"):
        open_sequence("nowhere/at/all")
    with pytest.raises(DataError, match="kitti/99 was not found"):
        open_sequence("kitti/99")
