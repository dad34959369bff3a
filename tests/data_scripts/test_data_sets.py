"""data.yaml: the layouts that Ultralytics reads, and the paths that have two meanings."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml

from train_detector import _describe
from training.dataset import DetectionSet, label_of, open_set
from vo_lib.errors import DataError


def images(folder: Path, *names: str) -> None:
    """Images in folder/images and their labels in folder/labels."""
    for name in names or ("0.jpg", "1.PNG"):
        for kind, data in (
            ("images", cv2.imencode(".png", np.zeros((8, 8), np.uint8))[1].tobytes()),
            ("labels", b"0 0.5 0.5 0.1 0.1\n"),
        ):
            path = folder / kind / name
            path.parent.mkdir(parents=True, exist_ok=True)
            (path if kind == "images" else path.with_suffix(".txt")).write_bytes(data)


def described(folder: Path, text: str) -> DetectionSet:
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "data.yaml").write_text(text, encoding="utf-8")
    return open_set(folder)


@pytest.fixture
def top(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with a data set `set`; the working folder is another one, and Ultralytics is unknown."""
    for split in ("train", "valid"):
        images(tmp_path / "set" / split)
    (tmp_path / "work").mkdir()
    monkeypatch.chdir(tmp_path / "work")
    monkeypatch.setenv("YOLO_CONFIG_DIR", str(tmp_path / "config"))
    return tmp_path


SPLITS = "train: train/images\nval: valid/images\nnames: [car]\n"


@pytest.mark.parametrize(
    "text",
    [
        SPLITS,
        SPLITS.replace("val:", "validation:"),
        "train: ../train/images\nval: ../valid/images\ntest: ../test/images\nnc: 1\nnames: ['car']\n",
        "train: [train/images]\nval:\n- valid/images\nnames: {0: car}\n",
        "path: {top}/set\n" + SPLITS,
        "path: .\n" + SPLITS,
        "path: ''\n" + SPLITS,
        "train: {top}/set/train\nval: {top}/set/valid\nnames: {{'0': car}}\n",
    ],
)
def test_usual_descriptions_are_read(top: Path, text: str) -> None:
    data = described(top / "set", text.format(top=top) if "{top}" in text else text)
    assert data.names == ("car",)
    assert data.images["train"] == tuple(top / "set/train/images" / name for name in ("0.jpg", "1.PNG"))
    assert len(data.images["valid"]) == 2
    assert data.outside() == []


def test_a_path_to_another_folder_is_followed_and_reported(top: Path) -> None:
    for split in ("train", "valid"):  # the folder of data.yaml has images too
        images(top / "other" / split, "wrong.png")
    data = described(top / "other", f"path: {top}/set\n" + SPLITS)
    assert [image.name for image in data.images["train"]] == ["0.jpg", "1.PNG"]
    assert data.outside() == [top / "set/train/images", top / "set/valid/images"]


def test_relative_path_is_in_the_working_folder_or_with_ultralytics(top: Path) -> None:
    text = "path: set\n" + SPLITS
    (top / "config").mkdir()
    (top / "config/settings.json").write_text(json.dumps({"datasets_dir": str(top)}), encoding="utf-8")
    assert described(top / "other", text).images["train"][0] == top / "set/train/images/0.jpg"
    for split in ("train", "valid"):
        images(top / "work" / "set" / split)
    with pytest.raises(DataError, match=r"path: set may be .*/work/set or .*/set: write the full path"):
        described(top / "other", text)
    (top / "config/settings.json").unlink()
    assert described(top / "other", text).images["train"][0] == top / "work/set/train/images/0.jpg"


def test_sub_folders_links_and_lists_are_read(top: Path) -> None:
    images(top / "set" / "deep", "city/a.jpg", "city/.hidden.jpg", "city/b/c.png")
    (top / "set/deep/images/city/b/back").symlink_to(top / "set/deep/images")  # leads back
    (top / "home").mkdir()
    (top / "home/x.png").write_bytes((top / "set/train/images/0.jpg").read_bytes())
    images(top / "set" / "linked", "x.png")
    (top / "set/linked/images/x.png").unlink()
    (top / "set/linked/images").rmdir()
    (top / "set/linked/images").symlink_to(top / "home")  # the labels are beside the link
    (top / "set/behind").mkdir()
    (top / "set/behind/images").symlink_to(top / "set/train/images")  # the labels are behind the link
    lines = ["./train/images/0.jpg", "", str(top / "set/train/images/1.PNG"), "valid/images/0.jpg"]
    (top / "set/list.txt").write_text("\n".join(lines), encoding="utf-8")
    text = "train: [deep/images, linked/images, behind/images]\nval: list.txt\nnc: 2\n"
    data = described(top / "set", text)
    assert data.names == ("class_0", "class_1")
    relative = [image.relative_to(top / "set").as_posix() for image in data.images["train"]]
    assert relative == [
        "deep/images/city/a.jpg",
        "deep/images/city/b/c.png",
        "linked/images/x.png",
        "train/images/0.jpg",
        "train/images/1.PNG",
    ]
    assert all(label_of(image).is_file() for image in data.images["train"])
    assert [image.name for image in data.images["valid"]] == ["0.jpg", "1.PNG", "0.jpg"]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (SPLITS + "nc: 2\n", "nc: 2, but there are 1 names"),
        (SPLITS.replace("[car]", "{1: car}"), "expected `names:`"),
        (SPLITS.replace("train/images", "[train/images, nowhere]"), "found 'nowhere'"),
        (
            SPLITS.replace("train/images", "{a: 1}"),
            "expected `train:` with a folder of images; found {'a': 1}",
        ),
        ("path: nowhere\n" + SPLITS, "path: none of the images is in .*/work/nowhere, .*/set/nowhere"),
        ("path: 5\n" + SPLITS, "path: expected a folder, found 5"),
        (
            "train: more\nval: more\nnames: [car]\ndownload: rm -r /\n",
            "does not run what is under `download:`",
        ),
        ("train: list.txt\nval: valid/images\nnames: [car]\n", r"list\.txt, line 1: the image is missing: x"),
    ],
)
def test_wrong_descriptions_are_one_line(top: Path, text: str, words: str) -> None:
    (top / "set/more").mkdir()
    (top / "set/list.txt").write_text("x/y.png\n", encoding="utf-8")
    with pytest.raises(DataError, match=words) as caught:
        described(top / "set", text)
    assert len(str(caught.value).splitlines()) == 1


def test_folder_above_with_the_same_images_is_never_read_silently(top: Path) -> None:
    for split in ("train", "valid"):
        images(top / split)
    with pytest.raises(DataError, match=r"\.\./train/images may be .* or .*: write the full path"):
        described(top / "set", SPLITS.replace("train: ", "train: ../").replace("val: ", "val: ../"))


def test_training_gets_lists_of_all_images(top: Path) -> None:
    images(top / "set" / "train", "city/ü.png")
    data = described(top / "set", SPLITS)
    _describe(data, None, top / "work/data.yaml")
    about = yaml.safe_load((top / "work/data.yaml").read_text(encoding="utf-8"))
    assert about == {"train": f"{top}/work/train.txt", "val": f"{top}/work/valid.txt", "names": {0: "car"}}
    listed = (top / "work/train.txt").read_text(encoding="utf-8").splitlines()
    assert listed == [str(image) for image in data.images["train"]]
    assert listed[-1].endswith("city/ü.png")
