"""Digests change with what decides a result, and with nothing else."""

from __future__ import annotations

import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest

import vo_lib.runs.identity as identity
from vo_lib import DataError, open_sequence, preset


def test_copies_of_the_images_are_the_same_images(bands: Path, tmp_path: Path) -> None:
    shutil.copytree(bands, tmp_path / "copy")
    one, other = open_sequence(bands), open_sequence(tmp_path / "copy")
    assert identity.images_digest(one) == identity.images_digest(other)
    assert identity.images_digest(one) != identity.images_digest(one.part(0, 5))
    assert identity.images_digest(one.part(0, 5)) != identity.images_digest(one.part(1, 6))


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
    with pytest.raises(DataError, match=r"000003\.png: the image cannot be read"):
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
