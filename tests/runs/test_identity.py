"""Digests change with what decides a result, and with nothing else."""

from __future__ import annotations

import json
import os
import shutil
import time
from pathlib import Path

import cv2
import numpy as np
import pytest

import vo_lib.runs.identity as identity
from vo_lib import DataError, open_sequence, preset
from vo_lib.core.files import file_sha256


@pytest.fixture
def memory(bands: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A user's cache folder with nothing in it, for hashes of images that count as old at once."""
    monkeypatch.setattr(identity, "cache_folder", lambda: tmp_path / "user" / "synthetic")
    monkeypatch.setattr(identity, "UNSETTLED", -(10**12))
    return tmp_path / "user" / "hashes"


def set_age(path: Path, seconds: float) -> None:
    os.utime(path, (time.time() - seconds,) * 2)


def hashed(monkeypatch: pytest.MonkeyPatch, folder: Path) -> tuple[str, list[str]]:
    """The digest of a sequence's images, and the names of those that were read for it."""
    read: list[str] = []

    def watched(path: Path) -> str:
        read.append(f"{path.parent.name}/{path.name}")
        return file_sha256(path)

    with monkeypatch.context() as patch:
        patch.setattr(identity, "file_sha256", watched)
        return identity.images_digest(open_sequence(folder)), sorted(read)


def test_copies_of_the_images_are_the_same_images_and_names_count(bands: Path, tmp_path: Path) -> None:
    shutil.copytree(bands, tmp_path / "copy")
    one, other = open_sequence(bands), open_sequence(tmp_path / "copy")
    assert identity.images_digest(one) == identity.images_digest(other)
    assert identity.images_digest(one) != identity.images_digest(one.part(0, 5))
    assert identity.images_digest(one.part(0, 5)) != identity.images_digest(one.part(1, 6))
    for side in ("image_0", "image_1"):
        for number in reversed(range(6)):
            (bands / side / f"{number:06d}.png").rename(bands / side / f"{number + 1:06d}.png")
    assert identity.images_digest(open_sequence(bands)) != identity.images_digest(other)


def test_an_image_is_read_once_and_again_when_it_has_changed(
    bands: Path, memory: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first, read = hashed(monkeypatch, bands)
    assert len(read) == 12
    assert hashed(monkeypatch, bands) == (first, [])
    path = bands / "image_1" / "000003.png"
    set_age(path, 1800)
    assert hashed(monkeypatch, bands) == (first, ["image_1/000003.png"])
    # Other content of equal size and time.
    data, stat = bytearray(path.read_bytes()), path.stat()
    data[len(data) // 2] ^= 1
    path.write_bytes(bytes(data))
    os.utime(path, ns=(stat.st_atime_ns, stat.st_mtime_ns))
    monkeypatch.setattr(identity, "UNSETTLED", 10**12)
    changed, read = hashed(monkeypatch, bands)
    assert changed != first
    # So young a file may change again within the grain of its time.
    assert read == ["image_1/000003.png"]
    assert hashed(monkeypatch, bands) == (changed, ["image_1/000003.png"])
    assert len(list(memory.iterdir())) == 1


@pytest.mark.parametrize(
    "damage", ["", "{", "[1]", "null", '{"image_0/000000.png": 5}', '{"image_0/000000.png": [1, 2, "x"]}']
)
def test_damaged_memory_means_to_hash_again(
    bands: Path, memory: Path, monkeypatch: pytest.MonkeyPatch, damage: str
) -> None:
    first, _ = hashed(monkeypatch, bands)
    (file,) = memory.iterdir()
    whole = json.loads(file.read_text(encoding="utf-8"))
    file.write_text(damage, encoding="utf-8")
    assert hashed(monkeypatch, bands) == (first, sorted(whole))
    assert json.loads(file.read_text(encoding="utf-8")) == whole


def test_processes_that_hash_at_once_lose_nothing_but_time(
    bands: Path, memory: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    early, late = open_sequence(bands).part(0, 3), open_sequence(bands).part(3, 6)
    others: list[str] = []

    def meanwhile(path: Path) -> str:
        if path == bands / "image_0" / "000002.png":
            others.append(identity.images_digest(late))
        return file_sha256(path)

    with monkeypatch.context() as patch:
        patch.setattr(identity, "file_sha256", meanwhile)
        first = identity.images_digest(early)
    (file,) = memory.iterdir()
    assert len(json.loads(file.read_text(encoding="utf-8"))) == 12
    assert hashed(monkeypatch, bands)[1] == []
    assert [identity.images_digest(early), identity.images_digest(late)] == [first, *others]


def test_a_cache_folder_that_cannot_be_written_is_no_error(bands: Path, memory: Path) -> None:
    memory.parent.write_text("a file", encoding="utf-8")
    assert identity.images_digest(open_sequence(bands)) == identity.images_digest(open_sequence(bands))


@pytest.mark.parametrize("place", [(0, 0), (120, 240), (239, 479)])
def test_one_grey_level_of_one_pixel_makes_another_image(bands: Path, place: tuple[int, int]) -> None:
    before = identity.images_digest(open_sequence(bands))
    path = bands / "image_1" / "000003.png"
    image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    assert image is not None
    image[place] ^= np.uint8(1)
    cv2.imwrite(str(path), image)
    assert identity.images_digest(open_sequence(bands)) != before
    sequence = open_sequence(bands)
    path.unlink()
    with pytest.raises(DataError, match=r"000003\.png: the "):
        identity.images_digest(sequence)


def test_labels_count_only_where_they_are_used(bands: Path) -> None:
    (bands / "labels").mkdir()
    names = ("solution_selection", "feature_selection")
    before = [identity.run_identity(open_sequence(bands), preset(name), "m")["labels"] for name in names]
    (bands / "labels" / "000002.txt").write_text("2 0.5 0.5 0.1 0.1\n", encoding="utf-8")
    after = [identity.run_identity(open_sequence(bands), preset(name), "m")["labels"] for name in names]
    assert before[0] == after[0] == identity.NOT_USED
    assert before[1] != after[1]


def test_all_maths_counts_as_the_code_of_a_run_and_no_plot(monkeypatch: pytest.MonkeyPatch) -> None:
    read: list[str] = []
    read_bytes = Path.read_bytes

    def watched(path: Path) -> bytes:
        read.append(path.stem)
        return read_bytes(path)

    monkeypatch.setattr(Path, "read_bytes", watched)
    identity.code_digest.__wrapped__()
    wanted = {"config", "klt", "corners", "five_point", "selection", "translation", "viso2", "geometry"}
    assert wanted <= set(read)
    assert not {"plots", "console", "cli", "report"} & set(read)


def test_any_change_of_the_maths_is_another_code(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "method").mkdir()
    (tmp_path / "config.py").write_text("", encoding="utf-8")
    (tmp_path / "other.py").write_text("", encoding="utf-8")
    (tmp_path / "method" / "odometry.py").write_text("", encoding="utf-8")
    monkeypatch.setattr(identity, "PACKAGE", tmp_path)
    digest = identity.code_digest.__wrapped__
    before = digest()
    (tmp_path / "other.py").write_text("x = 1\n", encoding="utf-8")
    assert digest() == before
    for name in ("config.py", "method/odometry.py", "method/new.py"):
        (tmp_path / name).write_text("x = 2\n", encoding="utf-8")
        after = digest()
        assert after != before, name
        before = after


def test_the_commit_is_that_of_the_kit_or_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    found = identity.git_commit()
    assert found is None or len(found.removesuffix("-dirty")) == 40
    monkeypatch.setattr(identity, "PACKAGE", tmp_path / "vo_lib")
    assert identity.git_commit() is None
