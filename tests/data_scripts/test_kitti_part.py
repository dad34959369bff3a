"""Parts of sequences and raw drives, fetched from a server."""

from __future__ import annotations

import io
import re
import zipfile
from pathlib import Path

import cv2
import numpy as np
import pytest
from data_command import load
from file_server import FileServer
from test_kitti_archive import content, files_below, kitti  # noqa: F401  (one is a fixture)
from test_kitti_raw import P0, drive, path_of_the_camera  # noqa: F401  (one is a fixture)

from fetch.kitti_archive import CALIB, GRAY, POSES
from vo_lib import preset
from vo_lib.commands.cli import main
from vo_lib.data.kitti import GREY, PART, calibration_text, read_part
from vo_lib.data.poses import from_first, write_kitti_poses
from vo_lib.data.sequence import open_folder
from vo_lib.errors import DataError
from vo_lib.geometry.camera import StereoCamera
from vo_lib.geometry.types import Array
from vo_lib.runs.drive import run_methods

NAME = "2011_09_26_drive_0005"
SYNC, CALIBRATION = f"{NAME}_sync.zip", "2011_09_26_calib.zip"


@pytest.fixture
def raw(server: FileServer, drive: Path) -> FileServer:  # noqa: F811
    """Archives of a synthetic drive (eight pairs and laser points) and of its calibration."""
    points = drive / "velodyne_points" / "data" / "0000000003.bin"
    points.parent.mkdir(parents=True)
    points.write_bytes(np.random.default_rng(0).bytes(1_000_000))
    day = drive.parent
    pack(server, SYNC, day.parent, [path for path in drive.rglob("*") if path.is_file()])
    pack(server, CALIBRATION, day.parent, list(day.glob("*.txt")))
    return server


def pack(server: FileServer, name: str, base: Path, paths: list[Path]) -> None:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        for path in sorted(paths):
            archive.write(path, path.relative_to(base).as_posix())
    server.files[name] = buffer.getvalue()


def get(server: FileServer, root: Path, *words: str) -> int:
    return load("get_kitti")([*words, "--root", str(root), "--host", server.url, "--yes"])


def images(folder: Path) -> list[list[int]]:
    return [sorted(int(path.stem) for path in (folder / f"image_{side}").iterdir()) for side in (0, 1)]


def assert_drive(folder: Path, start: int, stop: int) -> None:
    """Require the given frames of the synthetic drive, with calibration, times and poses."""
    sequence = open_folder(folder, "")
    assert [int(frame) for frame in sequence.frames] == list(range(start, stop))
    assert sequence.camera.f == P0[0, 0]
    assert sequence.camera.baseline == pytest.approx(387 / 720)
    seconds = np.array([0, 0.1, 0.2, 0.3, 0.4, 0.5, 1.0, 1.1])[start:stop]
    np.testing.assert_allclose(sequence.times, seconds - seconds[0], atol=1e-6)
    assert sequence.truth is not None
    np.testing.assert_allclose(sequence.truth, from_first(path_of_the_camera()[start:stop]), atol=1e-4)
    for index, frame in enumerate(range(start, stop)):
        assert [int(image[0, 0]) for image in sequence.stereo(index)] == [10 * frame, 10 * frame + 1]


def test_part_of_a_raw_drive_can_be_extended(
    raw: FileServer, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    root, folder = tmp_path / "root", tmp_path / "root" / "sequences" / "drive_0005"
    assert get(raw, root, "--raw", NAME, "--frames", "2:5") == 0
    assert_drive(folder, 2, 5)
    assert sum(raw.sent.values()) < 150_000  # the laser points are not fetched
    assert load("check_kitti")(["--root", str(root), "--deep"]) == 0
    mark, printed = f"--raw {NAME} --frames 2:5", capsys.readouterr().out
    assert "drive_0005: 3 of 3 pairs, complete" in printed
    assert f"a part: {mark}\n" in printed
    assert get(raw, root, *mark.split()) == 0
    assert "13 of 13 files are already complete" in capsys.readouterr().out
    (folder / "labels").mkdir()
    assert get(raw, root, "--raw", NAME, "--frames", "4:8") == 0
    assert "to download: 9 files" in capsys.readouterr().out
    assert_drive(folder, 2, 8)
    assert get(raw, root, "--raw", NAME) == 0
    assert_drive(folder, 0, 8)
    assert (folder / PART).read_text(encoding="utf-8") == f"--raw {NAME} --frames 0:8\n"
    assert (folder / "labels").is_dir()


def test_wrong_frames_and_other_folders_are_refused(
    raw: FileServer, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "sequences" / "drive_0005"
    for frames in ("2:9", "8:12", "-2:3", "3:4"):
        assert get(raw, tmp_path, "--raw", NAME, f"--frames={frames}") == 2
        expected = f"frames {frames}: expected two or more frames of {NAME}, which has 0:8\n"
        assert capsys.readouterr().err.endswith(expected)
    assert not folder.exists()
    assert get(raw, tmp_path, "--raw", NAME, "--frames", "0:3") == 0
    assert get(raw, tmp_path, "--raw", NAME, "--frames", "5:7") == 2
    expected = "drive_0005: has the frames 0:3; --frames 0:7 leaves no gap, --frames 0:3,5:7 keeps one"
    assert expected in capsys.readouterr().err
    (folder / PART).write_text("--raw 2011_10_03_drive_0005 --frames 0:3\n", encoding="utf-8")
    assert get(raw, tmp_path, "--raw", NAME, "--frames", "0:4") == 2
    assert f"drive_0005: contains images of a source other than {NAME}" in capsys.readouterr().err
    (folder / PART).unlink()
    assert get(raw, tmp_path, "--raw", NAME, "--frames", "0:4") == 2
    assert images(folder) == [[0, 1, 2], [0, 1, 2]]


def test_part_of_a_sequence_can_be_completed(kitti: FileServer, tmp_path: Path) -> None:  # noqa: F811
    folder = tmp_path / "sequences" / "07"
    words = ["--sequences", "07", "--frames"]
    assert get(kitti, tmp_path, *words, "2:5") == 0
    assert images(folder) == [[2, 3, 4], [2, 3, 4]]
    assert {"poses/07.txt", "sequences/07/calib.txt", "sequences/07/times.txt"} < set(files_below(tmp_path))
    assert get(kitti, tmp_path, *words, "5:9") == 0
    assert images(folder) == [[*range(2, 9)], [*range(2, 9)]]
    assert (folder / PART).read_text(encoding="utf-8") == "--sequences 07 --frames 2:9\n"
    assert get(kitti, tmp_path, "--sequences", "07") == 0
    assert images(folder) == [[*range(12)], [*range(12)]]
    assert not (folder / PART).exists()
    # A range of a whole sequence only fetches missing files: the sequence does not become a part.
    (folder / "image_0" / "000003.png").unlink()
    assert get(kitti, tmp_path, *words, "2:5") == 0
    assert images(folder) == [[*range(12)], [*range(12)]]
    assert not (folder / PART).exists()


FRAMES = 12


@pytest.fixture
def benchmark(server: FileServer, tmp_path: Path) -> FileServer:
    """The archives of the benchmark with a sequence 06 that opens: twelve frames, two metres apart."""
    base = tmp_path / "archives"
    folder = base / "dataset" / "sequences" / "06"
    for number in range(FRAMES):
        for side, name in enumerate(GREY):
            (folder / name).mkdir(parents=True, exist_ok=True)
            image = np.full((40, 60), 10 * number + side, np.uint8)
            assert cv2.imwrite(str(folder / name / f"{number:06d}.png"), image)
    write_band_tables(folder)
    poses = base / "dataset" / "poses" / "06.txt"
    poses.parent.mkdir()
    write_kitti_poses(poses, true_poses_of_all())
    pack(server, GRAY, base, list(folder.glob("image_?/*.png")))
    pack(server, CALIB, base, list(folder.glob("*.txt")))
    pack(server, POSES, base, [poses])
    return server


def write_band_tables(folder: Path) -> None:
    camera = StereoCamera(50.0, 30.0, 20.0, 0.5, 60, 40)
    (folder / "calib.txt").write_text(calibration_text(camera), encoding="utf-8")
    times = "".join(f"{0.1 * number:.6e}\n" for number in range(FRAMES))
    (folder / "times.txt").write_text(times, encoding="utf-8")


def true_poses_of_all() -> Array:
    poses = np.tile(np.eye(4), (FRAMES, 1, 1))
    poses[:, 2, 3] = 2.0 * np.arange(FRAMES)
    return poses


def test_several_pieces_keep_their_frames_times_and_truth(
    benchmark: FileServer, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    root = tmp_path / "root"
    folder = root / "sequences" / "06"
    assert get(benchmark, root, "--sequences", "06", "--frames", "1:4,8:10") == 0
    numbers = [1, 2, 3, 8, 9]
    assert images(folder) == [numbers, numbers]
    assert (folder / PART).read_text(encoding="utf-8") == "--sequences 06 --frames 1:4,8:10\n"
    sequence = open_folder(folder, "kitti/06")
    assert [int(frame) for frame in sequence.frames] == numbers
    assert sequence.pieces == [range(3), range(3, 5)]
    assert sequence.is_part
    np.testing.assert_allclose(sequence.times, 0.1 * np.array(numbers))
    np.testing.assert_allclose(sequence.true_poses[:, 2, 3], 2.0 * np.array(numbers))
    assert [int(sequence.left(index)[0, 0]) for index in range(5)] == [10 * number for number in numbers]
    assert load("check_kitti")(["--root", str(root), "--deep"]) == 0
    assert "06: 5 of 5 pairs, complete" in capsys.readouterr().out


def test_no_motion_leads_across_a_gap(
    benchmark: FileServer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    root = tmp_path / "root"
    assert get(benchmark, root, "--sequences", "06", "--frames", "1:4,8:10") == 0
    monkeypatch.setenv("KITTI_ROOT", str(root))
    sequence = open_folder(root / "sequences" / "06", "kitti/06")
    words = "kitti/06 has the frames 1:4, 8:10 with a gap between, and no motion leads across a gap: "
    words += "choose --frames 0:3 or 3:5, counted from 0"
    with pytest.raises(DataError, match=f"{words}$"):
        run_methods(sequence, {"": preset("feature_selection")})
    capsys.readouterr()
    sweep = ["sweep", "--sequence", "kitti/06", "--set", "selection.sets=5,6"]
    for command in (["run", "kitti/06"], sweep, ["reproduce", "--sequences", "06"]):
        assert main([*command, "--out", str(tmp_path / "out")]) == 2
        assert words in " ".join(capsys.readouterr().err.split())
        # What to type counts in the whole sequence, also if the command has a part already.
        assert main([*command, "--frames", "1:5", "--out", str(tmp_path / "out")]) == 2
        assert "choose --frames 1:3 or 3:5, counted" in " ".join(capsys.readouterr().err.split())
    assert main(["list"]) == 0
    length = 2 * 2 + 2  # metres, without the step across the gap
    assert re.search(rf"kitti/06 +│ +5 +│ +{length} ", capsys.readouterr().out)
    for piece in sequence.pieces:
        sequence.part(piece.start, piece.stop).require_unbroken()
    with pytest.raises(DataError, match="choose --frames 0:2 or 2:4"):
        sequence.part(1, 5).require_unbroken()


def test_pieces_grow_join_and_become_the_whole(benchmark: FileServer, tmp_path: Path) -> None:
    folder = tmp_path / "sequences" / "06"
    words = ["--sequences", "06", "--frames"]
    for frames, mark in (
        ("8:10,1:3", "1:3,8:10"),
        ("3:5", "1:5,8:10"),
        ("10:12", "1:5,8:12"),
        ("2:4,6:8", "1:5,6:12"),
    ):
        assert get(benchmark, tmp_path, *words, frames) == 0
        assert (folder / PART).read_text(encoding="utf-8") == f"--sequences 06 --frames {mark}\n"
        assert len(open_folder(folder, "").pieces) == 2
    assert get(benchmark, tmp_path, *words, "0:6") == 0
    assert not (folder / PART).exists()
    assert open_folder(folder, "").pieces == [range(FRAMES)]


def test_pieces_beside_the_start_of_a_sequence_without_a_mark(benchmark: FileServer, tmp_path: Path) -> None:
    folder = tmp_path / "sequences" / "06"
    assert get(benchmark, tmp_path, "--sequences", "06", "--frames", "0:3") == 0
    (folder / PART).unlink()  # as in a folder that was copied by hand
    assert get(benchmark, tmp_path, "--sequences", "06", "--frames", "6:8") == 2
    assert get(benchmark, tmp_path, "--sequences", "06", "--frames", "1:3,6:8") == 0
    assert (folder / PART).read_text(encoding="utf-8") == "--sequences 06 --frames 0:3,6:8\n"
    assert [int(frame) for frame in open_folder(folder, "").frames] == [0, 1, 2, 6, 7]


def test_pieces_of_a_raw_drive_keep_the_times_between_them(raw: FileServer, tmp_path: Path) -> None:
    folder = tmp_path / "sequences" / "drive_0005"
    assert get(raw, tmp_path, "--raw", NAME, "--frames", "1:3,5:8") == 0
    numbers = [1, 2, 5, 6, 7]
    sequence = open_folder(folder, "")
    assert [int(frame) for frame in sequence.frames] == numbers
    seconds = np.array([0, 0.1, 0.2, 0.3, 0.4, 0.5, 1.0, 1.1])[numbers]
    np.testing.assert_allclose(sequence.times, seconds - seconds[0], atol=1e-6)
    np.testing.assert_allclose(sequence.true_poses, from_first(path_of_the_camera()[numbers]), atol=1e-4)


@pytest.mark.parametrize(
    "mark", ["5:5", "1:4,2:6", "8:10,1:4", "1:4,4:6", "1:4,", "1:4;6:8", "1:4, 6:8", "4:1,6:8"]
)
def test_a_wrong_list_of_pieces_in_part_txt_is_refused(tmp_path: Path, mark: str) -> None:
    (tmp_path / PART).write_text(f"--sequences 06 --frames {mark}\n", encoding="utf-8")
    with pytest.raises(DataError, match=r"part\.txt, line 1: (expected|the piece|no frame is missing)"):
        read_part(tmp_path)


@pytest.mark.parametrize("frames", ["0:3,", "0:3;5:8", "a:b,3:5", "0:3,5", "0:2,5:99", "5:5,1:3"])
def test_a_wrong_list_of_frames_writes_nothing(benchmark: FileServer, tmp_path: Path, frames: str) -> None:
    root = tmp_path / "root"
    assert get(benchmark, root, "--sequences", "06", "--frames", frames) == 2
    assert not (root / "sequences").exists()


def test_a_gap_that_part_txt_does_not_name_is_a_missing_image(benchmark: FileServer, tmp_path: Path) -> None:
    folder = tmp_path / "sequences" / "06"
    assert get(benchmark, tmp_path, "--sequences", "06", "--frames", "1:4,8:12") == 0
    for side in GREY:
        (folder / side / "000010.png").unlink()
    with pytest.raises(DataError, match=r"000010\.png: the image is missing between"):
        open_folder(folder, "")
