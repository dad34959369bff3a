"""The data scripts as commands: output, files and exit code."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest
from conftest import write_bands
from data_command import load
from file_server import FileServer
from test_kitti_archive import content, kitti, zipped  # noqa: F401  (one is a fixture)

from fetch import stereo_check
from fetch.kitti_archive import COLOR
from vo_lib.commands.cli import main
from vo_lib.data.kitti import EXPECTED_FRAMES
from vo_lib.geometry.types import Array, Image


@pytest.fixture(scope="module", autouse=True)
def _each_pair_is_measured_once() -> Iterator[None]:
    """The tests import the same few images again and again, of which SIFT takes most of the time."""
    measure = stereo_check._shifts
    known: dict[tuple[bytes, ...], Array] = {}

    def shifts(left: Image, right: Image) -> Array:
        key = (str(left.shape).encode(), left.tobytes(), right.tobytes())
        if key not in known:
            known[key] = measure(left, right)
        return known[key]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(stereo_check, "_shifts", shifts)
        yield


def test_get_kitti_asks_downloads_and_continues(
    kitti: FileServer,  # noqa: F811
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    main, root = load("get_kitti"), tmp_path / "data"
    words = ["--sequences", "07", "--root", str(root), "--host", kitti.url]
    monkeypatch.setattr(sys.stdin, "isatty", lambda: False)
    assert main(words) == 2
    assert "--yes" in capsys.readouterr().err
    monkeypatch.setattr(sys.stdin, "isatty", lambda: True)
    monkeypatch.setattr("builtins.input", lambda question: "n")
    assert main(words) == 1
    assert not root.exists()
    monkeypatch.setattr("builtins.input", lambda question: "y")
    assert main(words) == 0
    printed = capsys.readouterr().out
    assert "CC BY-NC-SA 3.0" in printed
    assert len([p for p in root.rglob("*") if p.is_file()]) == 27
    colour = [f"dataset/sequences/07/image_{side}/000000.png" for side in (2, 3)]
    kitti.files[COLOR] = zipped(colour)
    assert main([*words, "--yes", "--color"]) == 0
    assert "27 of 29 files" in capsys.readouterr().out
    assert (root / "sequences" / "07" / "image_3" / "000000.png").read_bytes() == content(colour[1])


def test_get_kitti_from_zip_and_by_link(
    kitti: FileServer,  # noqa: F811
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    main, trees = load("get_kitti"), (tmp_path / "a", tmp_path / "b")
    zips = [tmp_path / name for name in kitti.files]
    for path in zips:
        path.write_bytes(kitti.files[path.name])
    assert main(["--from-zip", *map(str, zips), "--root", str(trees[0]), "--yes"]) == 0
    assert (trees[0] / "sequences" / "04" / "image_1" / "000011.png").is_file()
    assert main(["--sequences", "04,07", "--link", str(trees[0]), "--root", str(trees[1])]) == 0
    assert "04, 07" in capsys.readouterr().out
    more = ["--root", str(trees[1]), "--host", kitti.url, "--yes"]
    assert main(["--sequences", "04", *more]) == 2
    assert "is a link to another folder" in capsys.readouterr().err


def test_check_kitti_names_the_command_to_repair(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    main = load("check_kitti")
    monkeypatch.setitem(EXPECTED_FRAMES, "04", 6)
    folder = write_bands(tmp_path / "sequences" / "04")
    assert main(["--root", str(tmp_path), "--deep"]) == 0
    assert "04: 6 of 6 pairs, complete" in capsys.readouterr().out
    (folder / "image_1" / "000003.png").unlink()
    assert main(["--root", str(tmp_path)]) == 1
    printed = capsys.readouterr().out
    assert "image_1: 1 images missing, the first is 000003" in printed
    assert f"vo data get_kitti --root {tmp_path} --sequences 04" in printed


def test_from_folder_checks_pairs_and_writes_a_sequence(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    main, out = load("from_folder"), tmp_path / "mine"
    bands = write_bands(tmp_path / "bands", 2)
    left, right = str(bands / "image_0"), str(bands / "image_1")
    camera = ["--focal", "300", "--centre", "240,120", "--baseline"]
    assert main(["--left", right, "--right", left, *camera, "0.5", "--out", str(out)]) == 2
    assert "left and right are swapped" in capsys.readouterr().err
    assert not out.exists()
    wrong = ["--left", left, "--right", right, "--out", str(tmp_path / "wrong"), *camera]
    for baseline, depth in (("0.005", 0.125), ("6", 150)):
        assert main([*wrong, baseline]) == 2
        line = f"the median depth is {depth} m with a baseline of {baseline} m and a focal length of 300 px"
        assert f"{line}, expected 5 to 100 m outdoors" in capsys.readouterr().err
    assert main([*wrong, "6", "--anyway"]) == 0
    assert "warning: the median depth" in capsys.readouterr().out
    swapped = ["--left", right, "--right", left, "--swap"]
    poses = ["--unit", "mm", "--poses", str(bands / "poses.txt")]
    assert main([*swapped, *camera, "500", *poses, "--out", str(out)]) == 0
    printed = capsys.readouterr().out
    assert "baseline 0.500 m, with truth" in printed
    assert f"vo run {out}" in printed
    assert "note: 10 pairs per second are assumed; give the times by --fps or --times" in printed
    for unit in (1e3, 1e9):
        moments = unit * 0.1 * np.arange(6)
        (tmp_path / "times.txt").write_text("".join(f"{t:.0f}\n" for t in moments), encoding="utf-8")
        words = [*swapped, *camera, "0.5", "--times", str(tmp_path / "times.txt")]
        assert main([*words, "--out", str(tmp_path / "other")]) == 2
        error = capsys.readouterr().err
        assert (
            f"times.txt: the median interval of the times is {0.1 * unit:g} s: expected 0.001 to 10" in error
        )
        assert not (tmp_path / "other").exists()
    # Names that are times replace the frame rate.
    for side in (left, right):
        for frame in range(2):
            old = Path(side, f"{frame:06d}.png")
            old.rename(old.with_stem(str(1403636579763555584 + 250_000_000 * frame)))
    assert main(["--left", left, "--right", right, *camera, "0.5", "--out", str(tmp_path / "timed")]) == 0
    assert "assumed" not in capsys.readouterr().out
    seconds = (tmp_path / "timed" / "times.txt").read_text(encoding="utf-8").split()
    assert float(seconds[1]) - float(seconds[0]) == pytest.approx(0.25, abs=1e-6)


def imported(bands: Path, out: Path, *options: str) -> int:
    """Exit code of an import of the band images."""
    places = ["--left", str(bands / "image_0"), "--right", str(bands / "image_1")]
    return load("from_folder")([*places, "--out", str(out), *options])


CAMERA = ["--focal", "300", "--centre", "240,120", "--baseline", "0.5"]


def times_in(folder: Path) -> list[float]:
    """Times of a sequence, counted from the first."""
    seconds = [float(word) for word in (folder / "times.txt").read_text(encoding="utf-8").split()]
    return [round(second - seconds[0], 6) for second in seconds]


def test_gaps_in_the_numbers_remain_in_the_times(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bands = write_bands(tmp_path / "bands")
    for side in ("image_0", "image_1"):
        for path in sorted((bands / side).iterdir(), reverse=True):
            number = int(path.stem)
            path.rename(path.with_stem(f"{number + (8 if number < 2 else 38):06d}"))
    assert imported(bands, tmp_path / "a", *CAMERA) == 0
    assert "note: the numbers have a gap of 30 frames after 000009.png; the times" in capsys.readouterr().out
    assert times_in(tmp_path / "a") == [0.0, 0.1, 3.2, 3.3, 3.4, 3.5]
    assert imported(bands, tmp_path / "b", *CAMERA, "--fps", "20") == 0
    assert times_in(tmp_path / "b") == [0.0, 0.05, 1.6, 1.65, 1.7, 1.75]
    (bands / "image_1" / "000041.png").unlink()
    (bands / "image_0" / "000008.png").unlink()
    assert imported(bands, tmp_path / "c", *CAMERA, "--skip-unpaired") == 0
    printed = capsys.readouterr().out
    assert "images without a partner, skipped: 2" in printed
    assert times_in(tmp_path / "c") == [0.0, 3.1, 3.3, 3.4]


def test_times_that_no_camera_has_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bands = write_bands(tmp_path / "bands")
    for side in ("image_0", "image_1"):
        for path in sorted((bands / side).iterdir(), reverse=True):
            # A clock of unknown unit and start: neither times since 1970 nor frame numbers.
            path.rename(path.with_stem(str(5_000_000 + 33_333 * int(path.stem) + int(path.stem) % 2)))
    assert imported(bands, tmp_path / "a", *CAMERA) == 2
    fault = "the median interval of the times is 1666.7 s: expected 0.001 to 10 s"
    assert fault in capsys.readouterr().err
    assert not (tmp_path / "a").exists()


def test_a_baseline_of_tens_of_metres_is_refused_with_its_likely_unit(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bands = write_bands(tmp_path / "bands", 2)
    for baseline, unit in (("54", "cm"), ("540", "mm")):
        assert imported(bands, tmp_path / "a", *CAMERA[:-1], baseline) == 2
        metres = float(baseline) / {"cm": 100, "mm": 1000}[unit]
        assert f"add --unit {unit} (then {metres:g} m)" in capsys.readouterr().err
        assert imported(bands, tmp_path / unit, *CAMERA[:-1], baseline, "--unit", unit) == 0


def test_a_principal_point_far_from_the_middle_is_a_warning(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bands = write_bands(tmp_path / "bands", 2)
    for number, centre in enumerate(("119,120", "240,181")):
        assert imported(bands, tmp_path / str(number), *CAMERA[:3], centre, *CAMERA[4:]) == 0
        assert (
            f"warning: the principal point {centre.replace(',', '.0,')}.0 is far" in capsys.readouterr().out
        )
    assert imported(bands, tmp_path / "near", *CAMERA[:3], "121,61", *CAMERA[4:]) == 0
    assert "warning" not in capsys.readouterr().out


def camera_infos(folder: Path, distortion: float = 0.0) -> Path:
    """left.yaml and right.yaml of ROS for the band images."""
    folder.mkdir()
    for side, tx in (("left", 0.0), ("right", -150.0)):
        text = (
            "image_width: 480\nimage_height: 240\ndistortion_model: plumb_bob\n"
            "camera_matrix: {rows: 3, cols: 3, data: [300, 0, 240, 0, 300, 120, 0, 0, 1]}\n"
            f"distortion_coefficients: {{rows: 1, cols: 5, data: [{distortion}, 0, 0, 0, 0]}}\n"
            "rectification_matrix: {rows: 3, cols: 3, data: [1, 0, 0, 0, 1, 0, 0, 0, 1]}\n"
            "projection_matrix: {rows: 3, cols: 4, "
            f"data: [300, 0, 240, {tx}, 0, 300, 120, 0, 0, 0, 1, 0]}}\n"
        )
        (folder / f"{side}.yaml").write_text(text, encoding="utf-8")
    return folder


def test_rectified_images_are_linked_and_not_rectified_twice(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bands = write_bands(tmp_path / "bands")
    none = camera_infos(tmp_path / "none")
    assert imported(bands, tmp_path / "a", "--calibration", str(none)) == 0
    assert "f 300.0 px, centre 240.0,120.0, baseline 0.500 m" in capsys.readouterr().out
    assert (tmp_path / "a" / "image_0" / "000003.png").is_symlink()
    raw = camera_infos(tmp_path / "raw", -0.4)
    assert imported(bands, tmp_path / "b", "--calibration", str(raw)) == 2
    assert "the images are rectified already: give --rectified" in capsys.readouterr().err
    assert imported(bands, tmp_path / "b", "--calibration", str(raw), "--rectified") == 0
    assert (tmp_path / "b" / "image_0" / "000003.png").is_symlink()


def test_grey_values_of_10_bits_are_written_with_8(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bands = write_bands(tmp_path / "bands")
    expected = cv2.imread(str(bands / "image_0" / "000002.png"), cv2.IMREAD_UNCHANGED)
    for side in ("image_0", "image_1"):
        for path in (bands / side).iterdir():
            image = np.asarray(cv2.imread(str(path), cv2.IMREAD_GRAYSCALE))
            cv2.imwrite(str(path), image.astype(np.uint16) * 4)
    # The brightest image has no partner, and is skipped.
    cv2.imwrite(str(bands / "image_0" / "000006.png"), np.full((240, 480), 1023, np.uint16))
    assert imported(bands, tmp_path / "a", *CAMERA, "--skip-unpaired") == 0
    assert "note: the grey values need 10 bits, so they are divided by 4" in capsys.readouterr().out
    written = tmp_path / "a" / "image_0" / "000002.png"
    assert not written.is_symlink()
    np.testing.assert_array_equal(cv2.imread(str(written), cv2.IMREAD_UNCHANGED), expected)


def test_run_on_colour_images_alone(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bands = write_bands(tmp_path / "bands")
    for grey, colour in (("image_0", "image_2"), ("image_1", "image_3")):
        (bands / grey).rename(bands / colour)
    text = (bands / "calib.txt").read_text(encoding="utf-8")
    (bands / "calib.txt").write_text(text.replace("P0", "P2").replace("P1", "P3"), encoding="utf-8")
    assert (
        main(
            [
                "run",
                str(bands),
                "--method",
                "viso2",
                "--variant",
                "kit",
                "--features.cell",
                "10",
                "--out",
                str(tmp_path / "r"),
            ]
        )
        == 0
    )
    line = "note: there are only colour images: image_2 and image_3 are read as grey"
    assert line in " ".join(capsys.readouterr().out.split())
