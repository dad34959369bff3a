"""Digests change with every input of a result, and with no other file."""

from __future__ import annotations

import dataclasses
import os
import shutil
import time
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest

import vo_lib.data.image_hashes as image_hashes
import vo_lib.runs.identity as identity
from vo_lib import DataError, open_sequence, preset
from vo_lib.config import change
from vo_lib.files import file_sha256


@pytest.fixture
def memory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty folder for stored hashes."""
    monkeypatch.setattr(image_hashes, "cache_folder", lambda: tmp_path / "user")
    return tmp_path / "user" / "hashes"


def hashed(monkeypatch: pytest.MonkeyPatch, folder: Path) -> tuple[str, list[str]]:
    """The digest of a sequence's images, and the names of the images that are read for the digest."""
    read: list[str] = []

    def watched(path: Path) -> str:
        read.append(f"{path.parent.name}/{path.name}")
        return file_sha256(path)

    with monkeypatch.context() as patch:
        patch.setattr(image_hashes, "file_sha256", watched)
        return identity.images_digest(open_sequence(folder)), sorted(read)


def test_digest_of_images_ignores_the_folder(bands: Path, tmp_path: Path) -> None:
    shutil.copytree(bands, tmp_path / "copy")
    one, other = open_sequence(bands), open_sequence(tmp_path / "copy")
    assert identity.images_digest(one) == identity.images_digest(other)
    assert identity.images_digest(one) != identity.images_digest(one.part(0, 5))
    assert identity.images_digest(one.part(0, 5)) != identity.images_digest(one.part(1, 6))


def test_image_is_hashed_again_after_a_change(
    bands: Path, memory: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first, read = hashed(monkeypatch, bands)
    assert len(read) == 12
    assert hashed(monkeypatch, bands) == (first, [])
    os.utime(bands / "image_1" / "000003.png", (time.time() - 1800,) * 2)
    assert hashed(monkeypatch, bands) == (first, ["image_1/000003.png"])
    (file,) = memory.iterdir()
    file.write_text("[1]", encoding="utf-8")
    assert hashed(monkeypatch, bands) == (first, read)


def test_digest_changes_with_one_pixel(bands: Path) -> None:
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


def test_identity_has_times_camera_and_used_labels(bands: Path) -> None:
    (bands / "labels").mkdir()
    (bands / "labels" / "000001.txt").touch()
    sequence, kept, removed = open_sequence(bands), preset("solution_selection"), preset("feature_selection")
    before = [identity.run_identity(sequence, config, "m") for config in (kept, removed)]
    (bands / "labels" / "000002.txt").write_text("2 0.5 0.5 0.1 0.1\n", encoding="utf-8")
    after = [identity.run_identity(sequence, config, "m") for config in (kept, removed)]
    assert [a == b for a, b in zip(before, after, strict=True)] == [True, False]
    # The same numbers have another meaning with names.
    (bands / "labels" / "classes.txt").write_text("person\nbus\ncar\n", encoding="utf-8")
    named = [identity.run_identity(sequence, config, "m") for config in (kept, removed)]
    assert [a == b for a, b in zip(named, after, strict=True)] == [True, False]
    assert identity.matches_identity(sequence, removed)["images"] == before[1]["images"]
    for other_part in (
        {"times": sequence.times * 2},
        {"camera": dataclasses.replace(sequence.camera, baseline=0.6)},
    ):
        other = dataclasses.replace(sequence, **other_part)
        assert identity.run_identity(other, kept, "m") != after[0]


def test_masks_are_in_the_identity_of_runs_only(bands: Path) -> None:
    sequence, config = open_sequence(bands), preset("feature_selection")
    matches, runs = [], []
    for value in (None, 0, 255):
        if value is not None:
            cv2.imwrite(str(bands / "mask.png"), np.full((240, 480), value, np.uint8))
            sequence = dataclasses.replace(sequence, masks=bands / "mask.png")
        matches.append(identity.matches_identity(sequence, config))
        runs.append(identity.run_identity(sequence, config, "m"))
    assert matches[0] == matches[1] == matches[2]
    assert len({run["masks"] for run in runs}) == 3


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A copy of vo_lib whose files a test can change."""
    shutil.copytree(identity.PACKAGE, tmp_path / "vo_lib", ignore=shutil.ignore_patterns("__pycache__"))
    monkeypatch.setattr(identity, "PACKAGE", tmp_path / "vo_lib")
    yield tmp_path / "vo_lib"
    identity.code_digest.cache_clear()


def code_digests() -> dict[str, str]:
    """The digests of the code of matches and of poses, by kind and variant."""
    identity.code_digest.cache_clear()
    return {
        f"{name} {variant}": identity.code_digest(modules)
        for name, code in (("matches", identity.FRONT_END_CODE), ("poses", identity.POSE_CODE))
        for variant, modules in code.items()
    }


EVERYTHING = {"matches published", "matches kit", "poses published", "poses kit"}
POSES = {"poses published", "poses kit"}


# Which digests change if one byte of a file changes.
CHANGED_BY = {
    "data/kitti.py": EVERYTHING,
    "paper/matching.py": EVERYTHING,
    "runs/drive.py": POSES,
    "paper/selection.py": POSES,
    "kit/rig.py": {"poses kit"},
    "kit/surface.py": {"matches kit", "poses kit"},
    "report/plots.py": set(),
    "runs/jobs.py": set(),
    "config.py": set(),
}


def test_code_digests_cover_the_code_used(package: Path) -> None:
    before = code_digests()
    for file, expected in CHANGED_BY.items():
        path = package / file
        content = path.read_bytes()
        path.write_bytes(content + b"\n")
        after = code_digests()
        path.write_bytes(content)
        assert {name for name in before if before[name] != after[name]} == expected, file
    assert code_digests() == before


def test_identity_has_the_truth_of_rule_truth(bands: Path) -> None:
    (bands / "truth").mkdir()
    sequence, kit = open_sequence(bands), preset("feature_selection", variant="kit")
    configs = [kit, change(kit, "filter.rule", "truth")]
    before = [identity.run_identity(sequence, config, "m") for config in configs]
    (bands / "truth" / "objects.npz").write_bytes(b"other steps")
    after = [identity.run_identity(sequence, config, "m") for config in configs]
    assert [a == b for a, b in zip(before, after, strict=True)] == [True, False]
