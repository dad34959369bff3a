"""Folders in KITTI's layout: their content, and the errors for invalid folders."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from conftest import BASELINE, FOCAL, HEIGHT, WIDTH

from vo_lib import DataError, open_sequence
from vo_lib.data.kitti import read_image
from vo_lib.runs.front_end import stereo_ahead

SIDES = ("image_0", "image_1")


def test_folder_has_camera_times_and_truth(bands: Path) -> None:
    sequence = open_sequence(bands)
    assert len(sequence) == 6
    assert sequence.frames[0] == "000000"
    camera = sequence.camera
    assert (camera.f, camera.cx, camera.cy) == (FOCAL, WIDTH / 2, HEIGHT / 2)
    assert (camera.baseline, camera.width, camera.height) == (BASELINE, WIDTH, HEIGHT)
    assert sequence.truth is not None
    assert sequence.truth[5, 0, 3] == 5 * BASELINE
    np.testing.assert_allclose(sequence.times[5], 0.5)


def test_baseline_is_the_distance_between_the_cameras(bands: Path) -> None:
    """KITTI's colour cameras are not at the origin, so the last column of P2 is not zero."""
    words = (bands / "calib.txt").read_text(encoding="utf-8").split()
    words[4] = str(float(words[4]) + 30.0)  # P0[0,3]
    words[17] = str(float(words[17]) + 30.0)  # P1[0,3]
    (bands / "calib.txt").write_text(f"{' '.join(words[:13])}\n{' '.join(words[13:])}\n", encoding="utf-8")
    assert open_sequence(bands).camera.baseline == pytest.approx(BASELINE)


def test_part_has_its_images_times_and_truth(bands: Path) -> None:
    part = open_sequence(bands).part(2, 5)
    assert part.frames == ("000002", "000003", "000004")
    assert part.truth is not None
    assert part.truth[0, 0, 3] == 2 * BASELINE
    np.testing.assert_allclose(part.times[0], 0.2)
    for start, stop in ((0, 7), (-1, 3), (3, 3), (4, 5), (5, 2)):
        with pytest.raises(DataError, match="0:6"):
            open_sequence(bands).part(start, stop)


def test_number_of_a_kitti_sequence_gets_a_command_or_a_name(
    bands: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shutil.copytree(bands, tmp_path / "kitti" / "sequences" / "01")
    monkeypatch.setenv("KITTI_ROOT", str(tmp_path / "kitti"))
    for name, words in (
        ("kitti/1", "did you mean kitti/01?"),
        ("kitti/07", f"not found in {tmp_path / 'kitti'}; .*: vo data get_kitti --sequences 07"),
        ("kitti/22", "KITTI has the sequences 00 to 21"),
    ):
        with pytest.raises(DataError, match=words):
            open_sequence(name)


def test_truth_in_the_poses_folder_is_read_by_frame_number(bands: Path) -> None:
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


def edit(name: str, change: Callable[[str], str]) -> Callable[[Path], object]:
    def apply(folder: Path) -> object:
        path = folder / name
        return path.write_text(change(path.read_text(encoding="utf-8")), encoding="utf-8")

    return apply


def cut(name: str, rows: int) -> Callable[[Path], object]:
    """A function that keeps only the first rows of an image."""
    return lambda folder: cv2.imwrite(str(folder / name), cv2.imread(str(folder / name), 0)[:rows])  # type: ignore[index]


def remove_pairs(*frames: int) -> Callable[[Path], object]:
    def apply(folder: Path) -> None:
        for side in SIDES:
            for frame in frames:
                (folder / side / f"{frame:06d}.png").unlink()

    return apply


# Faults of a single file are in tests/bad_files.json; these faults concern several files.
FAULTS: dict[str, tuple[Callable[[Path], object], str]] = {
    "no calib.txt": (lambda f: (f / "calib.txt").unlink(), r"calib\.txt: .*missing"),
    "skew": (edit("calib.txt", lambda t: t.replace("0 240", "55 240")), r"line 1: P0: expected f 0 cx"),
    "baseline in mm": (
        edit("calib.txt", lambda t: t.replace("-150", "-161100")),
        r"calib\.txt, line 2: P1: the baseline .* is 537 m, expected more than 0 and at most 10 m",
    ),
    "centre outside": (
        edit("calib.txt", lambda t: t.replace("240.0", "90000")),
        r"calib\.txt, line 1: P0: principal point 90000,120: .*inside the images of 480×240 px",
    ),
    "pair missing": (remove_pairs(2), r"000002\.png: .*missing between 000001\.png and 000003\.png"),
    "size": (cut("image_1/000002.png", 230), r"image_1/000002\.png: .* 480×230, expected 480×240"),
    "one frame": (remove_pairs(1, 2, 3, 4, 5), "two or more stereo pairs"),
    "times short": (edit("times.txt", lambda t: "\n".join(t.split("\n")[:3])), r"times\.txt: 3 rows for 6"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_faults_of_a_sequence_are_one_line(bands: Path, fault: str) -> None:
    spoil, words = FAULTS[fault]
    spoil(bands)
    with pytest.raises(DataError, match=words) as caught:
        list(stereo_ahead(open_sequence(bands), lambda pair: pair))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("keep", [0, 7, 60, 0.5, 0.999, None])
def test_damaged_images_are_refused(
    bands: Path, keep: float | None, capfd: pytest.CaptureFixture[str]
) -> None:
    path = bands / "image_0" / "000000.png"
    data = bytearray(path.read_bytes())
    if keep is None:
        data[len(data) // 2] ^= 0x10
    else:
        del data[keep if isinstance(keep, int) else int(keep * len(data)) :]
    path.write_bytes(data)
    with pytest.raises(DataError, match="truncated or damaged"):
        read_image(path)
    assert capfd.readouterr() == ("", "")  # no output of libpng and OpenCV
