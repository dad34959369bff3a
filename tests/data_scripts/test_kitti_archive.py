"""Sequences from zip archives, by HTTP ranges or from disk: complete files, checksums, repeated calls."""

from __future__ import annotations

import io
import zipfile
from pathlib import Path

import numpy as np
import pytest
from file_server import FileServer

from fetch.kitti_archive import CALIB, GRAY, POSES, absent, fetch, plan, sequence_archives
from fetch.zip_archives import Archives, Member
from vo_lib.errors import DataError


def content(name: str) -> bytes:
    """Incompressible content of a member, different for every name."""
    return np.random.default_rng(list(name.encode())).bytes(3000 + len(name))


def zipped(names: list[str], method: int = zipfile.ZIP_STORED) -> bytes:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", method) as archive:
        for name in names:
            archive.writestr(name, content(name))
    return buffer.getvalue()


IMAGES = [f"image_{side}/{frame:06d}.png" for side in (0, 1) for frame in range(12)]
GRAY_NAMES = [f"dataset/sequences/{sequence}/{image}" for sequence in ("04", "07") for image in IMAGES]
EXPECTED = sorted(["poses/07.txt", *(f"sequences/07/{name}" for name in (*IMAGES, "calib.txt", "times.txt"))])


@pytest.fixture
def kitti(server: FileServer) -> FileServer:
    """Small versions of the three archives of the benchmark."""
    server.files[GRAY] = zipped([*GRAY_NAMES, "dataset/sequences/07/calib.txt", "dataset/readme.txt"])
    texts = [f"dataset/sequences/{s}/{name}" for s in ("04", "07") for name in ("calib.txt", "times.txt")]
    server.files[CALIB] = zipped(texts, zipfile.ZIP_DEFLATED)
    server.files[POSES] = zipped(["dataset/poses/04.txt", "dataset/poses/07.txt"], zipfile.ZIP_DEFLATED)
    return server


def take(server: FileServer, root: Path, jobs: int = 4) -> list[Member]:
    """Fetch sequence 07, and return the fetched members."""
    return unpack([server.url + kind for kind in (GRAY, CALIB, POSES)], root, jobs)


def unpack(places: list[str], root: Path, jobs: int = 4) -> list[Member]:
    with Archives() as archives:
        todo = absent(plan(archives, places, sequence_archives("", ["07"])[1]), root)
        fetch(archives, todo, root, jobs)
    return todo


def files_below(root: Path) -> list[str]:
    return sorted(path.relative_to(root).as_posix() for path in root.rglob("*") if path.is_file())


def assert_whole(root: Path) -> None:
    assert files_below(root) == EXPECTED
    for name in EXPECTED:
        assert (root / name).read_bytes() == content(f"dataset/{name}"), name


def test_only_missing_and_damaged_files_are_fetched(kitti: FileServer, tmp_path: Path) -> None:
    take(kitti, tmp_path)
    assert_whole(tmp_path)
    # Half of the images, and the directory at the end of the archive.
    assert kitti.sent[GRAY] < 0.6 * len(kitti.files[GRAY]) + 70_000
    assert take(kitti, tmp_path) == []
    cut, changed = (tmp_path / name for name in EXPECTED[3:5])
    cut.write_bytes(cut.read_bytes()[:100])
    changed.write_bytes(b"x" + changed.read_bytes()[1:])
    assert [str(member.target) for member in take(kitti, tmp_path)] == EXPECTED[3:5]
    assert_whole(tmp_path)


def test_lost_connections_are_resumed(kitti: FileServer, tmp_path: Path) -> None:
    kitti.drop_every = 4
    take(kitti, tmp_path, jobs=1)  # with several threads, the failing requests would be random
    assert_whole(tmp_path)


def test_wrong_checksum_or_server_without_ranges_is_one_line(kitti: FileServer, tmp_path: Path) -> None:
    bad = GRAY_NAMES[-1]
    kitti.files[GRAY] = kitti.files[GRAY].replace(content(bad), b"\0" * len(content(bad)))
    with pytest.raises(DataError, match=r"image_1/000011\.png is damaged.*CRC"):
        take(kitti, tmp_path)
    assert bad.removeprefix("dataset/") not in files_below(tmp_path)
    kitti.ranges = False
    with pytest.raises(DataError, match="--from-zip"):
        take(kitti, tmp_path)
    assert not list(tmp_path.rglob("*.tmp"))


def test_no_file_is_written_outside_the_root(tmp_path: Path) -> None:
    names = ["../poses/07.txt", "dataset/../../sequences/07/calib.txt", "/etc/x", "C:/x", "a\\..\\..\\x"]
    (tmp_path / "odd.zip").write_bytes(zipped(names))
    unpack([str(tmp_path / "odd.zip")], tmp_path / "root")
    assert files_below(tmp_path) == ["odd.zip", "root/poses/07.txt", "root/sequences/07/calib.txt"]
