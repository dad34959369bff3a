"""Label folders of a detector: resumable, guarded, equal from the cache, ahead of the odometry."""

from __future__ import annotations

import hashlib
import json
import os
import threading
import time
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from data_command import load
from tiny_onnx import write_answering

from vo_lib.config import DetectorConfig, preset
from vo_lib.core.boxes import Boxes
from vo_lib.core.errors import DataError
from vo_lib.core.files import only_process
from vo_lib.core.types import Image
from vo_lib.data.labels import written_labels
from vo_lib.data.sequence import open_sequence
from vo_lib.detection.label_cache import RECORD, detected_sequence, labelled_sequence, write_label_folder
from vo_lib.detection.yolo import YoloDetector
from vo_lib.detection.yolo_layout import yolox_cells
from vo_lib.runs.runner import run

Write = Callable[..., int]


@pytest.fixture
def model(tmp_path: Path) -> Path:
    """A network that sees one car in the middle of every image."""
    answer = np.zeros((1, 5, yolox_cells(64, 64)), np.float32)
    answer[0, :, 0] = 32, 32, 20, 10, 0.9
    return write_answering(tmp_path / "model.onnx", answer, names="['car']")


@pytest.fixture
def write(bands: Path, model: Path) -> Write:
    """The script on the bands with this network, and more words."""
    return lambda *words: load("write_labels")([str(bands), "--model", str(model), *words])


def texts(folder: Path) -> dict[str, str]:
    return {path.name: path.read_text() for path in sorted(folder.glob("*.txt"))}


def test_labels_stand_beside_the_images_with_the_models_hash(bands: Path, model: Path, write: Write) -> None:
    assert write() == 0
    assert len(texts(bands / "labels")) == 6
    record = json.loads((bands / "labels" / RECORD).read_text())
    assert record["sha256"] == hashlib.sha256(model.read_bytes()).hexdigest()
    boxes = open_sequence(bands).boxes(3)
    assert boxes.class_id.tolist() == [2]
    assert boxes.score == pytest.approx([0.9], abs=1e-6)
    # 480 × 240 into 64 × 64: a scale of 7.5, 16 rows of border above and below.
    assert boxes.xyxy == pytest.approx(np.array([[164.5, 82.0, 314.5, 157.0]]), abs=0.6)


def test_the_list_of_written_files_is_the_same_whichever_thread_is_first(
    bands: Path, write: Write, monkeypatch: pytest.MonkeyPatch
) -> None:
    detect, pauses = YoloDetector.detect, iter([0.1, 0.0] * 3)

    def slow_at_first(self: YoloDetector, image: Image) -> Boxes:
        time.sleep(next(pauses))
        return detect(self, image)

    monkeypatch.setattr(YoloDetector, "detect", slow_at_first)
    assert write() == 0
    assert list(written_labels(bands / "labels")) == sorted(texts(bands / "labels"))


def test_a_changed_image_is_detected_again(bands: Path, model: Path) -> None:
    sequence = open_sequence(bands)
    assert write_label_folder(sequence, model, DetectorConfig(), bands / "labels") == 6
    later = (bands / "labels" / "000003.txt").stat().st_mtime_ns + 10**9
    os.utime(bands / "image_0" / "000003.png", ns=(later, later))
    assert write_label_folder(sequence, model, DetectorConfig(), bands / "labels") == 1


def test_labels_made_otherwise_are_not_overwritten(
    bands: Path, write: Write, capsys: pytest.CaptureFixture[str]
) -> None:
    (bands / "labels").mkdir()
    (bands / "labels" / "000003.txt").write_text("")
    assert len(open_sequence(bands).boxes(3)) == 0  # labels of others are taken as they are
    assert write() == 2
    assert "labels that no detector of the kit wrote" in capsys.readouterr().err
    assert texts(bands / "labels") == {"000003.txt": ""}
    assert write("--replace") == 0
    assert write("--score", "0.95") == 2
    assert "another detector's labels" in capsys.readouterr().err


@pytest.mark.parametrize("keep", [None, 0, 5, -1])
def test_a_label_that_was_cut_or_lost_since_is_noticed_and_detected_again(
    bands: Path, write: Write, capsys: pytest.CaptureFixture[str], keep: int | None
) -> None:
    assert write() == 0
    whole = texts(bands / "labels")
    label = bands / "labels" / "000003.txt"
    if keep is None:
        label.unlink()
    else:
        label.write_bytes(label.read_bytes()[:keep])
    with pytest.raises(DataError, match=r"000003\.txt: was emptied, cut or changed since the detector"):
        open_sequence(bands).boxes(3)
    assert len(open_sequence(bands).boxes(2)) == 1
    capsys.readouterr()
    assert write() == 0
    assert "1 of them detected now" in capsys.readouterr().out
    assert texts(bands / "labels") == whole


def test_a_label_without_its_line_is_detected_again(bands: Path, model: Path, write: Write) -> None:
    assert write() == 0
    log = bands / "labels" / "written.csv"
    log.write_text(log.read_text()[:-90])  # killed while it wrote the last but one
    for lacking in (2, 0):
        assert write_label_folder(open_sequence(bands), model, DetectorConfig(), bands / "labels") == lacking


def test_a_second_detector_is_refused_while_the_first_one_writes(
    bands: Path, write: Write, capsys: pytest.CaptureFixture[str]
) -> None:
    (bands / "labels").mkdir()
    with only_process(bands / "labels"):
        assert write("--replace") == 2
        assert "labels: another process is working in this folder" in capsys.readouterr().err
        assert not (bands / "labels" / RECORD).exists()
    assert write("--replace") == 0
    assert len(texts(bands / "labels")) == 6


def test_pictures_show_the_boxes(bands: Path, write: Write, tmp_path: Path) -> None:
    assert write("--out", str(tmp_path / "l"), "--pictures", str(tmp_path / "p")) == 0
    picture, image = (
        cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
        for path in (tmp_path / "p" / "000001.jpg", bands / "image_0" / "000001.png")
    )
    assert picture is not None
    assert image is not None
    assert picture[90:150, 164].mean() > image[90:150, 164].mean() + 60  # the box's left side is white
    assert np.median(picture[70:80, 165:200]) < 0.6 * np.median(image[70:80, 165:200])  # dark under words
    np.testing.assert_allclose(picture[160:, 330:].astype(int), image[160:, 330:].astype(int), atol=25)


def test_a_run_on_cached_labels_equals_the_first_one(bands: Path, model: Path, tmp_path: Path) -> None:
    sequence, config = open_sequence(bands), preset("feature_selection")
    poses = []
    for _ in range(2):
        with detected_sequence(sequence, model, cache=tmp_path / "cache") as detected:
            poses.append(run(detected, config).poses)
            labels = detected.labels
    assert labels is not None
    assert len(texts(labels)) == 6
    assert np.array_equal(poses[0], poses[1])
    whole = labelled_sequence(sequence, model, cache=tmp_path / "cache")
    assert whole.labels == labels
    assert np.array_equal(run(whole, config).poses, poses[0])


@pytest.mark.parametrize("damaged", ["000002.txt", RECORD])
def test_damaged_cached_labels_are_detected_again(
    bands: Path, model: Path, tmp_path: Path, damaged: str
) -> None:
    sequence = open_sequence(bands)
    labels = labelled_sequence(sequence, model, cache=tmp_path).labels
    assert labels is not None
    whole = texts(labels)
    (labels / damaged).write_text("2 0.5 0.")
    with detected_sequence(sequence, model, cache=tmp_path) as detected:
        for frame in range(len(detected)):
            detected.boxes(frame)
    assert texts(labels) == whole


def test_another_score_has_a_folder_of_its_own(bands: Path, model: Path, tmp_path: Path) -> None:
    configs = (DetectorConfig(), DetectorConfig(score=0.5), DetectorConfig(threads=2))
    found = [labelled_sequence(open_sequence(bands), model, config, cache=tmp_path) for config in configs]
    assert len({sequence.labels for sequence in found}) == 2  # the number of threads changes no box


def test_boxes_wait_for_their_frame_while_the_detector_is_at_work(
    bands: Path, model: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    go, real = threading.Event(), YoloDetector.detect

    def held(self: YoloDetector, image: Image) -> Boxes:
        go.wait(20)
        return real(self, image)

    monkeypatch.setattr(YoloDetector, "detect", held)
    with detected_sequence(open_sequence(bands), model, cache=tmp_path / "cache") as detected:
        assert detected.labels is not None
        assert not texts(detected.labels)
        threading.Timer(0.2, go.set).start()
        # A part of the sequence keeps its frames' own labels.
        assert len(detected.part(2, 5).boxes(1)) == 1
        assert "000003.txt" in texts(detected.labels)


def test_an_error_in_the_detectors_thread_reaches_the_run(bands: Path, model: Path, tmp_path: Path) -> None:
    sequence = open_sequence(bands)
    (bands / "image_0" / "000004.png").write_bytes(b"no image")
    with detected_sequence(sequence, model, cache=tmp_path / "cache") as detected:
        assert len(detected.boxes(3)) == 1
        with pytest.raises(DataError, match=r"000004\.png"):
            detected.boxes(4)
