"""The data scripts as commands: output, files and exit code."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
from conftest import write_bands
from data_command import load
from file_server import FileServer
from test_kitti_archive import content, kitti, zipped  # noqa: F401  (one is a fixture)

from fetch.kitti_archive import COLOR
from vo_lib.data.kitti import EXPECTED_FRAMES


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
    for unit, name in ((1e3, "milliseconds"), (1e9, "nanoseconds")):
        moments = unit * 0.1 * np.arange(6)
        (tmp_path / "times.txt").write_text("".join(f"{t:.0f}\n" for t in moments), encoding="utf-8")
        words = [*swapped, *camera, "0.5", "--times", str(tmp_path / "times.txt")]
        assert main([*words, "--out", str(tmp_path / "other")]) == 2
        error = capsys.readouterr().err
        assert (
            f"times.txt: the median interval of the times is {0.1 * unit:g} s, expected 0.001 to 10" in error
        )
        assert f"they are probably {name}: divide them by" in error
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
