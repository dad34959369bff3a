"""The data scripts as a person calls them: what is printed, what is written, and the exit code."""

from __future__ import annotations

import io
import sys
from dataclasses import replace
from pathlib import Path

import pytest
from conftest import write_bands
from data_command import load
from file_server import FileServer
from test_kitti_archive import content, kitti, zipped  # noqa: F401  (one is a fixture)

from fetch.detectors import FETCHABLE, YOLOV8
from fetch.download import confirm, in_words
from fetch.kitti_archive import COLOR
from vo_lib.data.kitti import EXPECTED_FRAMES


def test_get_kitti_asks_fetches_and_goes_on(
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
    assert not root.exists()
    monkeypatch.setattr(sys.stdin, "isatty", lambda: True)
    monkeypatch.setattr("builtins.input", lambda question: "n")
    assert main(words) == 1
    assert not root.exists()
    monkeypatch.setattr("builtins.input", lambda question: "y")
    assert main(words) == 0
    printed = capsys.readouterr().out
    assert "CC BY-NC-SA 3.0" in printed
    assert "cvlibs.net" in printed
    assert "27 files" in printed
    assert len([p for p in root.rglob("*") if p.is_file()]) == 27
    colour = ["dataset/sequences/07/image_2/000000.png", "dataset/sequences/07/image_3/000000.png"]
    kitti.files[COLOR] = zipped(colour)
    assert main([*words, "--yes", "--color"]) == 0
    assert "27 of 29 files" in capsys.readouterr().out
    assert (root / "sequences" / "07" / "image_3" / "000000.png").read_bytes() == content(colour[1])
    assert main([*words, "--yes"]) == 0
    assert "27 of 27 files" in capsys.readouterr().out


def test_get_kitti_from_zip_and_by_link(
    kitti: FileServer,  # noqa: F811
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    main = load("get_kitti")
    zips = []
    for name, data in kitti.files.items():
        (tmp_path / name).write_bytes(data)
        zips.append(str(tmp_path / name))
    assert main(["--from-zip", *zips, "--root", str(tmp_path / "a"), "--yes"]) == 0
    assert (tmp_path / "a" / "sequences" / "04" / "image_1" / "000011.png").is_file()
    assert sum(kitti.gets.values()) == 0
    assert main(["--sequences", "04,07", "--link", str(tmp_path / "a"), "--root", str(tmp_path / "b")]) == 0
    assert (tmp_path / "b" / "sequences" / "04").is_symlink()
    assert "04, 07" in capsys.readouterr().out
    assert main(["--sequences", "04", "--root", str(tmp_path / "b"), "--host", kitti.url, "--yes"]) == 2
    assert "is a link into another tree" in capsys.readouterr().err
    words = ["--sequences", "15", "--host", kitti.url, "--yes", "--root", str(tmp_path / "c")]
    assert main(words) == 2
    assert "nothing of the sequences 15" in capsys.readouterr().err
    assert not (tmp_path / "c").exists()


def test_check_kitti_draws_a_tree_and_names_the_command(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    main = load("check_kitti")
    monkeypatch.setitem(EXPECTED_FRAMES, "04", 6)
    folder = write_bands(tmp_path / "sequences" / "04")
    assert main(["--root", str(tmp_path), "--deep"]) == 0
    printed = capsys.readouterr().out
    assert "04: 6 of 6 pairs, complete" in printed
    assert "get_kitti" not in printed
    (folder / "image_1" / "000003.png").unlink()
    assert main(["--root", str(tmp_path)]) == 1
    printed = capsys.readouterr().out
    assert "image_1: missing 3" in printed
    assert f"vo data get_kitti --root {tmp_path} --sequences 04" in printed


def test_from_folder_checks_the_pair_and_writes_a_sequence(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    main, out = load("from_folder"), tmp_path / "mine"
    bands = write_bands(tmp_path / "bands", 2)
    left, right = str(bands / "image_0"), str(bands / "image_1")
    camera = ["--focal", "300", "--centre", "240,120", "--baseline"]
    assert main(["--left", right, "--right", left, *camera, "0.5", "--out", str(out)]) == 2
    assert "left and right are swapped" in capsys.readouterr().err
    assert not out.exists()
    near = ["--left", left, "--right", right, *camera, "0.005", "--out", str(tmp_path / "new" / "near")]
    assert main(near) == 2
    assert "the median depth would be 0.13 m with a baseline of 0.005 m" in capsys.readouterr().err
    assert not (tmp_path / "new").exists()
    assert main([*near, "--anyway"]) == 0
    assert "warning: the median depth" in capsys.readouterr().out
    swapped = ["--left", right, "--right", left, "--swap"]
    poses = ["--unit", "mm", "--poses", str(bands / "poses.txt")]
    assert main([*swapped, *camera, "500", *poses, "--out", str(out)]) == 0
    printed = capsys.readouterr().out
    assert "baseline 0.500 m, with true poses" in printed
    assert f"vo run {out}" in printed
    assert main([*swapped, *camera, "0.5", "--out", str(out)]) == 2
    assert "not empty" in capsys.readouterr().err


def test_get_detector_lists_explains_and_refuses(
    server: FileServer, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    main, folder = load("get_detector"), ["--folder", str(tmp_path / "models")]
    assert main(folder) == 0
    assert "yolox-tiny" in capsys.readouterr().out
    assert main(["yolov8n", *folder]) == 0
    assert "\n".join(YOLOV8) in capsys.readouterr().out
    server.files["yolox_nano.onnx"] = bytes(3_659_407)
    nano = replace(FETCHABLE["yolox-nano"], url=server.url + "yolox_nano.onnx")
    monkeypatch.setitem(FETCHABLE, "yolox-nano", nano)
    assert main(["yolox-nano", "--yes", *folder]) == 2
    captured = capsys.readouterr()
    assert "Apache-2.0" in captured.out
    assert "c789161ed43c8269" in captured.out
    assert "not the file expected" in captured.err
    assert list((tmp_path / "models").iterdir()) == []
    assert main(["yolo", *folder]) == 2
    assert "expected one of" in capsys.readouterr().err


def test_no_answer_means_no(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stdin", io.StringIO())
    monkeypatch.setattr(sys.stdin, "isatty", lambda: True)
    assert not confirm("Go on?", yes=False)


def test_bytes_are_written_as_people_read_them() -> None:
    sizes = [in_words(n) for n in (5, 1500, 20_219_662, 22_000_000_000)]
    assert sizes == ["5 bytes", "1.5 kB", "20.2 MB", "22.0 GB"]
