"""Label folders of a detector: continuation, protection of other labels, and the cache."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from data_command import load
from tiny_onnx import write_answering

from vo_lib.data.catalogue import open_sequence
from vo_lib.detection.label_folders import RECORD, labelled_sequence, write_label_folder
from vo_lib.detection.layout import yolox_cells
from vo_lib.detection.settings import DetectorConfig
from vo_lib.files import only_process

Write = Callable[..., int]


@pytest.fixture
def model(tmp_path: Path) -> Path:
    """A network that detects one car in the middle of every image."""
    answer = np.zeros((1, 5, yolox_cells(64, 64)), np.float32)
    answer[0, :, 0] = 32, 32, 20, 10, 0.9
    return write_answering(tmp_path / "model.onnx", answer, names="['car']")


@pytest.fixture
def write(bands: Path, model: Path) -> Write:
    """A function that calls the script on the band sequence with the network and further options."""
    return lambda *words: load("write_labels")([str(bands), "--model", str(model), *words])


def texts(folder: Path) -> dict[str, str]:
    return {path.name: path.read_text() for path in sorted(folder.glob("*.txt"))}


def test_labels_are_written_with_the_hash_of_the_model(bands: Path, model: Path, write: Write) -> None:
    assert write() == 0
    assert len(texts(bands / "labels")) == 6
    record = json.loads((bands / "labels" / RECORD).read_text())
    assert record["sha256"] == hashlib.sha256(model.read_bytes()).hexdigest()
    boxes = open_sequence(bands).boxes(3)
    assert boxes.class_id.tolist() == [2]
    assert boxes.score == pytest.approx([0.9], abs=1e-6)
    # 480 × 240 into 64 × 64: a scale of 7.5, 16 rows of border above and below.
    assert boxes.xyxy == pytest.approx(np.array([[164.5, 82.0, 314.5, 157.0]]), abs=0.6)


def test_labels_without_boxes_cause_a_warning(write: Write, capsys: pytest.CaptureFixture[str]) -> None:
    for score, count in (("0.95", 1), ("0.5", 0)):
        assert write("--score", score, "--replace") == 0
        assert (
            " ".join(capsys.readouterr().out.split()).count(
                "the detector found no vehicle in the 6 images of"
            )
            == count
        )


def test_only_missing_or_outdated_labels_are_detected(bands: Path, model: Path) -> None:
    sequence, labels, reports = open_sequence(bands), bands / "labels", list[tuple[int, int]]()
    assert write_label_folder(sequence, model, DetectorConfig(), labels) == 6
    whole = texts(labels)
    (labels / "000001.txt").unlink()
    later = (labels / "000003.txt").stat().st_mtime_ns + 10**9
    os.utime(bands / "image_0" / "000003.png", ns=(later, later))

    def progress(done: int, total: int) -> None:
        reports.append((done, total))

    assert write_label_folder(sequence, model, DetectorConfig(), labels, progress=progress) == 2
    assert reports == [(5, 6), (6, 6)]
    assert texts(labels) == whole


def test_other_labels_are_not_overwritten(
    bands: Path, write: Write, capsys: pytest.CaptureFixture[str]
) -> None:
    (bands / "labels").mkdir()
    (bands / "labels" / "000003.txt").write_text("")
    with only_process(bands / "labels"):
        assert write("--replace") == 2
        assert "labels: another process is working in this folder" in capsys.readouterr().err
    assert write() == 2
    assert "labels that this detector did not write" in capsys.readouterr().err
    assert texts(bands / "labels") == {"000003.txt": ""}
    assert write("--replace") == 0
    assert len(texts(bands / "labels")) == 6
    assert write("--score", "0.95") == 2
    assert "labels that this detector did not write" in capsys.readouterr().err


def test_cached_labels_belong_to_one_detector(bands: Path, model: Path, tmp_path: Path) -> None:
    configs = (DetectorConfig(), DetectorConfig(score=0.5), DetectorConfig(threads=2))
    sequences = [labelled_sequence(open_sequence(bands), model, config, cache=tmp_path) for config in configs]
    folders = [sequence.labels for sequence in sequences]
    assert len(set(folders)) == 2  # the number of threads does not change the boxes
    assert folders[0] is not None
    whole = texts(folders[0])
    (folders[0] / "000002.txt").write_text("2 0.5 0.")
    (folders[0] / RECORD).write_text("[1, 2")
    assert labelled_sequence(open_sequence(bands), model, cache=tmp_path).labels == folders[0]
    assert texts(folders[0]) == whole
