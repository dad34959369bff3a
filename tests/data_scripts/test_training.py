"""Detection data sets, and a short training with Ultralytics."""

from __future__ import annotations

import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
from data_command import load
from tiny_onnx import write_answering

from train_detector import register
from training.dataset import open_set
from training.evaluated import ODOMETRY_DRIVES, evaluated_sequence
from training.street_set import DetectionSetConfig, streets
from vo_lib.data.label_files import write_labels
from vo_lib.detection.yolo import YoloDetector
from vo_lib.errors import DataError
from vo_lib.geometry.boxes import Boxes

train_detector = load("train_detector")


def test_splits_share_no_street() -> None:
    config = DetectionSetConfig(train=480, valid=48, frames=24)
    every = streets(config)
    seeds = {split: {s.scene.seed for s in every if s.split == split} for split in ("train", "valid", "test")}
    assert [len(seeds[split]) for split in ("train", "valid", "test")] == [20, 2, 12]
    assert not seeds["train"] & seeds["valid"]
    assert not (seeds["train"] | seeds["valid"]) & seeds["test"]
    assert sum(s.frames for s in every if s.split == "train") == 480
    assert streets(config) == every


def test_paths_identify_evaluated_drives() -> None:
    for drive, sequence in ODOMETRY_DRIVES.items():
        for path in (
            f"/data/raw/{drive}_sync/image_00/data/0.png",
            f"kitti/sequences/{sequence}/image_0/0.png",
        ):
            assert evaluated_sequence(path) == sequence
    for path in ("2011_09_26_drive_0005_000001.png", "sequences/11/000000.png"):
        assert evaluated_sequence(path) is None


def write_set(folder: Path, count: int = 12, roboflow: bool = False, prefix: str = "") -> Path:
    """A data set of bright rectangles on dark images, in the kit's layout or in the layout of Roboflow."""
    rng = np.random.default_rng(3)
    for split in ("train", "valid"):
        for kind in ("images", "labels"):
            (folder / split / kind).mkdir(parents=True)
        for k in range(count):
            image = np.full((120, 400), 40, np.uint8)
            w, h = rng.integers((30, 24), (90, 60)).tolist()
            x, y = rng.integers((400 - w, 120 - h)).tolist()
            image[y : y + h, x : x + w] = 220
            cv2.imwrite(str(folder / split / "images" / f"{prefix}{k:03d}.png"), image)
            box = Boxes(np.array([[x, y, x + w, y + h]]) - 0.5, np.zeros(1, np.int64), np.ones(1))
            write_labels(folder / split / "labels" / f"{prefix}{k:03d}.txt", box, 400, 120, scores=False)
    text = "train: train/images\nval: valid/images\nnames:\n  0: car\n"
    if roboflow:
        text = "train: ../train/images\nval: ../valid/images\ntest: ../test/images\n\nnc: 1\nnames: ['car']\n"
    (folder / "data.yaml").write_text(text)
    return folder


@pytest.mark.parametrize("roboflow", [False, True])
def test_data_sets_of_both_layouts_are_read(tmp_path: Path, roboflow: bool) -> None:
    data = open_set(write_set(tmp_path / "set", 3, roboflow))
    assert data.names == ("car",)
    assert [len(data.images[split]) for split in ("train", "valid", "test")] == [3, 3, 0]


def test_train_detector_refuses_evaluated_images(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    write_set(tmp_path / "set", 2, prefix="2011_09_30_drive_0027_")
    words = [str(tmp_path / "set"), "--out", str(tmp_path / "run")]
    assert train_detector(words) == 2
    text = capsys.readouterr().err
    assert "KITTI odometry sequence 07, which is evaluated" in text
    assert "--allow-evaluated" in text
    monkeypatch.setitem(sys.modules, "onnx", None)
    assert train_detector([*words, "--allow-evaluated"]) == 2
    assert 'onnx is missing: pip install -e ".[train]"' in capsys.readouterr().err
    monkeypatch.setattr("train_detector.list_detectors", lambda: {"mine": tmp_path})
    assert train_detector([*words, "--allow-evaluated", "--register", "mine"]) == 2
    assert "--register mine: a detector has this name" in capsys.readouterr().err
    assert not (tmp_path / "run").exists()


@pytest.mark.filterwarnings("default")  # warnings of Ultralytics
def test_trained_model_runs_in_the_kit(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("ultralytics", reason="Ultralytics belongs to the extra [train]")
    pytest.importorskip("onnx", reason="onnx belongs to the extra [train]")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setenv("YOLO_CONFIG_DIR", str(tmp_path))
    monkeypatch.chdir(tmp_path)
    options = "--out run --epochs 2 --size 96 --batch 4"
    words = [str(write_set(tmp_path / "set")), *options.split()]
    assert train_detector([*words, "--one-class", "vehicle"]) == 0
    assert "mAP50" in capfd.readouterr().out
    detector = YoloDetector(tmp_path / "run" / "detector.onnx")
    assert detector.layout_name == "yolov8"
    assert detector.names == ("vehicle",)
    detector.detect(np.full((120, 400), 40, np.uint8))


def test_useless_model_is_not_registered(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("train_detector.detector_folder", lambda: tmp_path / "kept")
    model = write_answering(tmp_path / "own.onnx", np.zeros((1, 5, 84), np.float32), names="['car']")
    with pytest.raises(
        DataError, match=r"detects nothing on the test images; add it with: vo data get_detector"
    ):
        register("mine", model, 0.0)
    assert not (tmp_path / "kept").exists()
    register("mine", model, 0.001)
    assert "--detector mine" in capsys.readouterr().out
    assert (tmp_path / "kept" / "mine.onnx").read_bytes() == model.read_bytes()
