"""Sequences out of zip archives, over ranges and from disk: whole files, checksums, second calls."""

from __future__ import annotations

import errno
import io
import struct
import zipfile
from pathlib import Path

import numpy as np
import pytest
from file_server import FileServer

from fetch import kitti_archive
from fetch.kitti_archive import CALIB, GRAY, POSES, absent, fetch, link_tree, plan
from fetch.zip_archives import Archives, Member
from vo_lib.core.errors import DataError


def content(name: str) -> bytes:
    """Bytes of a member, different for every name, that do not compress."""
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
    """The three archives of the benchmark, small."""
    server.files[GRAY] = zipped([*GRAY_NAMES, "dataset/sequences/07/calib.txt", "dataset/readme.txt"])
    texts = [f"dataset/sequences/{s}/{name}" for s in ("04", "07") for name in ("calib.txt", "times.txt")]
    server.files[CALIB] = zipped(texts, zipfile.ZIP_DEFLATED)
    server.files[POSES] = zipped(["dataset/poses/04.txt", "dataset/poses/07.txt"], zipfile.ZIP_DEFLATED)
    return server


def take(server: FileServer, root: Path, jobs: int = 4) -> list[Member]:
    """What a call of the script does for sequence 07; returns what was fetched."""
    return unpack([server.url + kind for kind in (GRAY, CALIB, POSES)], root, jobs)


def unpack(places: list[str], root: Path, jobs: int = 4) -> list[Member]:
    with Archives() as archives:
        todo = absent(plan(archives, places, ["07"]), root)
        fetch(archives, todo, root, jobs)
    return todo


def files_below(root: Path) -> list[str]:
    return sorted(path.relative_to(root).as_posix() for path in root.rglob("*") if path.is_file())


def assert_whole(root: Path) -> None:
    assert files_below(root) == EXPECTED
    for name in EXPECTED:
        assert (root / name).read_bytes() == content(f"dataset/{name}"), name


def whole_part(root: Path) -> list[str]:
    """The files that are there: some of those expected, each whole."""
    there = files_below(root)
    assert 0 < len(there) < len(EXPECTED)
    assert all((root / name).read_bytes() == content(f"dataset/{name}") for name in there)
    return there


def test_only_the_sequences_wanted_come_and_only_their_bytes(kitti: FileServer, tmp_path: Path) -> None:
    take(kitti, tmp_path / "kitti")
    assert_whole(tmp_path / "kitti")
    # Half of the images and, for each thread, the archive's directory.
    assert kitti.sent[GRAY] < 0.9 * len(kitti.files[GRAY]) + 5 * 70_000
    assert take(kitti, tmp_path / "kitti") == []


def test_a_file_that_is_damaged_or_cut_on_disk_is_fetched_again(kitti: FileServer, tmp_path: Path) -> None:
    take(kitti, tmp_path)
    cut, changed = (tmp_path / name for name in EXPECTED[3:5])
    cut.write_bytes(cut.read_bytes()[:100])
    changed.write_bytes(b"x" + changed.read_bytes()[1:])
    assert [str(member.target) for member in take(kitti, tmp_path)] == EXPECTED[3:5]
    assert_whole(tmp_path)


def test_lost_connections_are_taken_up_again(kitti: FileServer, tmp_path: Path) -> None:
    # With several threads it would be chance which requests fail.
    kitti.drop_every = 4
    take(kitti, tmp_path, jobs=1)
    assert_whole(tmp_path)


def test_a_server_that_goes_away_leaves_whole_files_and_a_second_call_goes_on(
    kitti: FileServer, tmp_path: Path
) -> None:
    kitti.after = (16, lambda: setattr(kitti, "drop_every", 1))
    with pytest.raises(DataError, match="connection was lost"):
        take(kitti, tmp_path)
    there = whole_part(tmp_path)
    kitti.drop_every = 0
    assert len(take(kitti, tmp_path)) == len(EXPECTED) - len(there)
    assert_whole(tmp_path)


def test_a_server_without_ranges_is_said_with_the_way_out(kitti: FileServer, tmp_path: Path) -> None:
    kitti.ranges = False
    with pytest.raises(DataError, match="--from-zip"):
        take(kitti, tmp_path)
    assert files_below(tmp_path) == []


def test_a_wrong_checksum_writes_nothing_of_the_member(kitti: FileServer, tmp_path: Path) -> None:
    bad = GRAY_NAMES[-1]
    kitti.files[GRAY] = kitti.files[GRAY].replace(content(bad), b"\0" * len(content(bad)))
    with pytest.raises(DataError, match=r"image_1/000011\.png is damaged.*CRC"):
        take(kitti, tmp_path)
    assert bad.removeprefix("dataset/") not in files_below(tmp_path)
    assert not list(tmp_path.rglob("*.tmp"))


def test_an_archive_that_changes_meanwhile_gives_no_mixture(kitti: FileServer, tmp_path: Path) -> None:
    # The same files at other places are found there; files that are others end the call.
    moved, others = GRAY_NAMES[::-1], [name.replace("sequences/0", "sequences/1") for name in GRAY_NAMES]
    kitti.after = (12, lambda: kitti.files.update({GRAY: zipped(moved)}))
    take(kitti, tmp_path / "moved")
    assert_whole(tmp_path / "moved")
    kitti.after = (sum(kitti.gets.values()) + 12, lambda: kitti.files.update({GRAY: zipped(others)}))
    with pytest.raises(DataError, match="changed meanwhile"):
        take(kitti, tmp_path / "replaced")
    whole_part(tmp_path / "replaced")


@pytest.mark.parametrize(
    "name",
    ["../07.txt", "dataset/../../sequences/07/calib.txt", "/etc/x", "C:/x", "a\\..\\..\\x", "//host/x/y"],
)
def test_a_member_that_would_leave_the_root_is_refused(name: str, tmp_path: Path) -> None:
    (tmp_path / "bad.zip").write_bytes(zipped(["dataset/poses/07.txt", name]))
    with pytest.raises(DataError, match="leave the folder"):
        unpack([str(tmp_path / "bad.zip")], tmp_path / "root")


def test_archives_on_disk_are_unpacked_and_the_calibration_archive_wins(
    kitti: FileServer, tmp_path: Path
) -> None:
    for kind in (GRAY, CALIB, POSES):
        (tmp_path / kind).write_bytes(kitti.files[kind])
    members = unpack([str(tmp_path / kind) for kind in (GRAY, CALIB, POSES)], tmp_path / "root")
    assert_whole(tmp_path / "root")
    (calibration,) = [member for member in members if member.target.name == "calib.txt"]
    assert calibration.archive == str(tmp_path / CALIB)


def packed(how: int, **changes: int) -> bytes:
    """An archive of one calib.txt, with fields of its two headers changed: `flag_bits`, `method`, `size`."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", how) as archive:
        archive.writestr("sequences/07/calib.txt", b"P0: 1 2 3\n" * 40)
    data = bytearray(buffer.getvalue())
    central = data.index(b"PK\x01\x02")
    for start, shift in ((0, 0), (central, 2)):
        for field, place, kind in (("flag_bits", 6, "<H"), ("method", 8, "<H"), ("size", 22, "<I")):
            if field in changes:
                struct.pack_into(kind, data, start + place + shift, changes[field])
    return bytes(data)


def garbled(method: int) -> bytes:
    """An archive whose member's packed bytes are changed behind their start."""
    data = bytearray(packed(method))
    start = 30 + len("sequences/07/calib.txt")
    for place in range(start + 14, data.index(b"PK\x01\x02") - 2):
        data[place] ^= 0x5A
    return bytes(data)


STORED, DEFLATED = zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED
ODD_ARCHIVES = {
    "encrypted": packed(STORED, flag_bits=1),
    "unknown compression": packed(STORED, method=77),
    "compression of 1990": packed(STORED, method=6),
    "shorter than declared": packed(DEFLATED, size=4000),
    "longer than declared": packed(DEFLATED, size=10),
    "garbled": garbled(DEFLATED),
    "garbled bz2": garbled(zipfile.ZIP_BZIP2),
    "garbled lzma": garbled(zipfile.ZIP_LZMA),
    "lzma that is none": packed(STORED, method=zipfile.ZIP_LZMA),
    "bz2 that is none": packed(STORED, method=zipfile.ZIP_BZIP2),
    "cut": packed(DEFLATED)[:60],
    "its directory alone": packed(DEFLATED)[packed(DEFLATED).index(b"PK\x01\x02") :],
}


@pytest.mark.parametrize("kind", ODD_ARCHIVES)
def test_an_archive_that_cannot_be_unpacked_is_one_line_and_leaves_no_file(tmp_path: Path, kind: str) -> None:
    (tmp_path / "odd.zip").write_bytes(ODD_ARCHIVES[kind])
    with pytest.raises(DataError, match=r"odd\.zip: .*(damaged|no.* zip file)") as caught:
        unpack([str(tmp_path / "odd.zip")], tmp_path / "root")
    assert "None" not in str(caught.value)
    assert len(str(caught.value).splitlines()) == 1
    assert files_below(tmp_path / "root") == []


@pytest.mark.parametrize("link", ["sequences", "sequences/07"])
def test_a_link_below_the_root_that_leads_outside_is_not_written_through(tmp_path: Path, link: str) -> None:
    (tmp_path / "odd.zip").write_bytes(packed(DEFLATED))
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "root" / link).parent.mkdir(parents=True)
    (tmp_path / "root" / link).symlink_to(tmp_path / "elsewhere")
    with pytest.raises(DataError, match="07: leads outside of the tree"):
        unpack([str(tmp_path / "odd.zip")], tmp_path / "root")
    assert list((tmp_path / "elsewhere").iterdir()) == []


def test_a_member_larger_than_any_image_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kitti_archive, "LARGEST_MEMBER", 1000)
    (tmp_path / "big.zip").write_bytes(zipped(["poses/07.txt"]))
    with pytest.raises(DataError, match="no KITTI file"):
        unpack([str(tmp_path / "big.zip")], tmp_path / "root")


def test_a_disk_that_fills_up_leaves_no_half_file(
    kitti: FileServer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    writes = iter(range(1, 1000))

    def full(file: int) -> None:
        if next(writes) > 5:
            raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("vo_lib.core.files.os.fsync", full)
    with pytest.raises(DataError, match="No space left"):
        take(kitti, tmp_path)
    assert len(whole_part(tmp_path)) == 5


def test_a_folder_that_cannot_be_written_leaves_nothing(kitti: FileServer, tmp_path: Path) -> None:
    (tmp_path / "sequences").write_text("a file", encoding="utf-8")
    with pytest.raises(DataError, match="the folder cannot be made"):
        take(kitti, tmp_path)
    assert files_below(tmp_path) == ["sequences"]


def test_a_tree_elsewhere_is_linked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    tree, root = tmp_path / "tree", tmp_path / "root"
    (tree / "dataset" / "sequences" / "07").mkdir(parents=True)
    (tree / "dataset" / "poses").mkdir()
    (tree / "dataset" / "poses" / "07.txt").write_text("poses", encoding="utf-8")
    assert link_tree(tree, root, ["04", "07"]) == ["07"]
    link = root / "sequences" / "07"
    assert link.resolve() == tree / "dataset" / "sequences" / "07"
    assert (root / "poses" / "07.txt").read_text(encoding="utf-8") == "poses"
    assert link_tree(tree, root, ["07"]) == ["07"]
    with pytest.raises(DataError, match="none of these sequences"):
        link_tree(tree, root, ["04"])
    link.unlink()
    link.mkdir()
    with pytest.raises(DataError, match="is there already"):
        link_tree(tree, root, ["07"])

    def refuse(*arguments: object, **options: object) -> None:
        raise OSError(1, "a required privilege is not held")

    link.rmdir()
    monkeypatch.setattr(Path, "symlink_to", refuse)
    with pytest.raises(DataError, match="KITTI_ROOT"):  # a system without links
        link_tree(tree, root, ["07"])
