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
    os.utime(path, (time.time() - 1800,) * 2)
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


@pytest.mark.parametrize("damage", ["", "[1]", '{"image_0/000000.png": [1, 2, "x"]}'])
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

    def meanwhile(path: Path) -> str:
        if path == bands / "image_0" / "000002.png":
            identity.images_digest(late)
        return file_sha256(path)

    with monkeypatch.context() as patch:
        patch.setattr(identity, "file_sha256", meanwhile)
        identity.images_digest(early)
    assert hashed(monkeypatch, bands)[1] == []


def test_a_cache_folder_that_cannot_be_written_is_no_error(bands: Path, memory: Path) -> None:
    memory.parent.write_text("a file", encoding="utf-8")
    assert identity.images_digest(open_sequence(bands)) == identity.images_digest(open_sequence(bands))


def test_one_grey_level_of_one_pixel_makes_another_image_and_a_missing_one_is_named(bands: Path) -> None:
    sequence = open_sequence(bands)
    before = identity.images_digest(sequence)
    path = bands / "image_1" / "000003.png"
    image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    assert image is not None
    image[239, 479] ^= np.uint8(1)
    cv2.imwrite(str(path), image)
    assert identity.images_digest(sequence) != before
    path.unlink()
    with pytest.raises(DataError, match=r"000003\.png: the "):
        identity.images_digest(sequence)


def test_labels_count_only_where_they_are_used(bands: Path) -> None:
    (bands / "labels").mkdir()
    sequence = open_sequence(bands)

    def labels(method: str) -> object:
        return identity.run_identity(sequence, preset(method), "m")["labels"]

    before = labels("feature_selection")
    (bands / "labels" / "000002.txt").write_text("2 0.5 0.5 0.1 0.1\n", encoding="utf-8")
    assert labels("solution_selection") == identity.NOT_USED
    assert labels("feature_selection") != before


def test_any_change_of_the_maths_is_another_code_and_one_of_a_plot_is_not(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shutil.copytree(identity.PACKAGE, tmp_path / "vo_lib")
    monkeypatch.setattr(identity, "PACKAGE", tmp_path / "vo_lib")
    digest = identity.code_digest.__wrapped__
    found = {digest()}
    for name in ("tables/plots.py", "commands/console.py", "data/kitti.py"):
        (tmp_path / "vo_lib" / name).write_text("x = 1\n", encoding="utf-8")
        assert digest() in found
    maths = ("config", "front_end/klt", "method/selection", "baseline/viso2", "beyond/rig", "core/new")
    for name in maths:
        (tmp_path / "vo_lib" / f"{name}.py").write_text("x = 2\n", encoding="utf-8")
        found.add(digest())
    assert len(found) == 1 + len(maths)


def test_the_commit_is_that_of_the_kit_or_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    found = identity.git_commit()
    assert found is None or len(found.removesuffix("-dirty")) == 40
    monkeypatch.setattr(identity, "PACKAGE", tmp_path / "vo_lib")
    assert identity.git_commit() is None
