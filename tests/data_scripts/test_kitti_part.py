"""Parts of sequences and raw drives, fetched from a server."""

from __future__ import annotations

import io
import zipfile
from pathlib import Path

import numpy as np
import pytest
from data_command import load
from file_server import FileServer
from test_kitti_archive import content, files_below, kitti  # noqa: F401  (one is a fixture)
from test_kitti_raw import P0, drive, path_of_the_camera  # noqa: F401  (one is a fixture)

from vo_lib.data.kitti import PART
from vo_lib.data.poses import from_first
from vo_lib.data.sequence import open_folder

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
    assert "drive_0005: has the frames 0:3; --frames 0:7 leaves no gap" in capsys.readouterr().err
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
