"""Label folders of a detector: continuation, protection of other labels, and the cache."""

from __future__ import annotations

import hashlib
import json
import os
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from data_command import load
from tiny_onnx import write_answering

from vo_lib.commands.cli import main
from vo_lib.data.catalogue import open_sequence
from vo_lib.data.label_names import DETECTOR_RECORD
from vo_lib.detection.label_folders import (
    detection_record,
    label_folder,
    labelled_sequence,
    with_all_labels,
    write_label_folder,
)
from vo_lib.detection.network_image import yolox_cells
from vo_lib.detection.settings import DetectorConfig
from vo_lib.detection.yolo import YoloDetector
from vo_lib.files import only_process
from vo_lib.geometry.boxes import Boxes

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
    record = json.loads((bands / "labels" / DETECTOR_RECORD).read_text())
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


FULL_DISK = """
import resource, sys
from pathlib import Path
from vo_lib.data.catalogue import open_sequence
from vo_lib.detection.label_folders import write_label_folder
from vo_lib.detection.settings import DetectorConfig

def fill_disk(done, total):
    resource.setrlimit(resource.RLIMIT_FSIZE, (100, 100))  # the list of images needs 77 bytes for each

folder = Path(sys.argv[3])
write_label_folder(open_sequence(sys.argv[1]), sys.argv[2], DetectorConfig(), folder, progress=fill_disk)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no limit for the size of files")
def test_a_full_disk_is_told_with_the_file_and_the_labels_are_continued(bands: Path, model: Path) -> None:
    labels = bands / "labels"
    words = [sys.executable, "-c", FULL_DISK, str(bands), str(model), str(labels)]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert done.stderr.endswith("images.sha256: cannot be written: File too large\n")
    # The line that the full disk has cut off spoils the next one, so that image is listed once more.
    numbers = [write_label_folder(open_sequence(bands), model, DetectorConfig(), labels) for _ in range(3)]
    assert numbers == [5, 1, 0]
    assert len(texts(labels)) == 6


def replace_image(path: Path) -> None:
    """Change a pixel of an image, and make the file older than every label."""
    image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    assert image is not None
    image[0, 0] ^= np.uint8(1)
    cv2.imwrite(str(path), image)
    os.utime(path, (10**9, 10**9))


def test_only_missing_or_outdated_labels_are_detected(bands: Path, model: Path) -> None:
    sequence, labels, reports = open_sequence(bands), bands / "labels", list[tuple[int, int]]()
    assert write_label_folder(sequence, model, DetectorConfig(), labels) == 6
    whole = texts(labels)
    (labels / "000001.txt").unlink()
    replace_image(bands / "image_0" / "000003.png")
    os.utime(bands / "image_0" / "000004.png")  # newer than its label, but the same image

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


OF_SEQUENCES = ("calib.txt", "times.txt", "poses.txt")


@pytest.mark.parametrize("words", [[], ["--replace"]])
def test_folder_of_a_sequence_is_never_a_label_folder(
    bands: Path, write: Write, capsys: pytest.CaptureFixture[str], words: list[str]
) -> None:
    before = {name: (bands / name).read_bytes() for name in OF_SEQUENCES}
    assert write("--out", str(bands), *words) == 2
    assert "bands: contains image_0, so it is the folder of a sequence or a run" in capsys.readouterr().err
    assert {name: (bands / name).read_bytes() for name in OF_SEQUENCES} == before
    assert not list(bands.glob("0*.txt"))


def test_folder_of_a_run_is_never_a_label_folder(
    bands: Path, write: Write, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "run"
    assert main(["run", str(bands), "--out", str(out), "--features.blob_cell", "9"]) == 0
    before = {path.name: path.read_bytes() for path in out.iterdir()}
    assert write("--out", str(out), "--replace") == 2
    assert "run: contains poses.txt" in capsys.readouterr().err
    assert {path.name: path.read_bytes() for path in out.iterdir()} == before


def test_replacement_deletes_only_labels_of_frames(
    bands: Path, write: Write, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "mine"
    out.mkdir()
    others = {"classes.txt": "car\n", "notes.txt": "x", "1a.txt": "y", ".a.b.c.tmp": "z", "000001.png": "p"}
    for name, text in (others | {"000002.txt": "0 0.5 0.5 0.1 0.1\n"}).items():
        (out / name).write_text(text, encoding="utf-8")
    assert write("--out", str(out), "--replace") == 0
    assert {name: (out / name).read_text(encoding="utf-8") for name in others} == others
    assert (out / "000002.txt").read_text(encoding="utf-8").startswith("2 ")
    (out / "000077.txt").write_text(
        "0 0.5 0.5 0.1 0.1\n", encoding="utf-8"
    )  # would seem to be this detector's
    assert write("--out", str(out), "--replace", "--score", "0.3") == 2
    assert "000077.txt: is another detector's label, and bands has no such frame" in capsys.readouterr().err
    assert len(list(out.glob("0*.txt"))) == 7


GPS_ROW = " ".join(["49.015", "8.434", "116.43", *["0.01"] * 27]) + "\n"
KITTI_ROW = "Car 0.00 0 1.85 387.63 181.54 423.81 203.12 1.67 1.87 3.69 -16.53 2.39 58.49 1.57\n"


@pytest.mark.parametrize(
    "text", [GPS_ROW, KITTI_ROW, "seen from the left\n", "3\n", "2 100 50 20 10\n", "\0\xff"]
)
@pytest.mark.parametrize("own_record", [False, True])
def test_files_that_are_no_labels_are_never_replaced(
    bands: Path, write: Write, capsys: pytest.CaptureFixture[str], text: str, own_record: bool
) -> None:
    out = bands / "oxts"
    out.mkdir()
    if own_record:
        assert write("--out", str(out)) == 0
        for file in out.glob("*.txt"):
            file.unlink()
        (out / "images.sha256").unlink()
    (out / "000001.txt").write_text("2 0.5 0.5 0.1 0.1\n", encoding="utf-8")
    (out / "000003.txt").write_text(text, encoding="latin-1")
    before = {path.name: path.read_bytes() for path in out.iterdir()}
    for words in ([], ["--replace"]):
        assert write("--out", str(out), *words) == 2
        told = capsys.readouterr().err
        assert "000003.txt: is named as a frame and is no YOLO label" in told
        assert "--replace" not in told
        assert {path.name: path.read_bytes() for path in out.iterdir()} == before


@pytest.mark.parametrize("name", ["image_0", "image_1", "masks", "image_02/data", "linked"])
def test_folder_of_images_in_a_sequence_is_never_a_label_folder(
    bands: Path, write: Write, tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str
) -> None:
    out = bands / name
    if name == "linked":
        out = tmp_path / "linked"
        out.symlink_to(bands / "image_0")
    if not out.exists():
        out.mkdir(parents=True)
        shutil.copy(bands / "image_0" / "000000.png", out / "000000.png")
    before = sorted(path.name for path in out.iterdir())
    for words in ([], ["--replace"]):
        assert write("--out", str(out), *words) == 2
        assert f"{name}: is a folder of images of a sequence: choose another" in capsys.readouterr().err
        assert sorted(path.name for path in out.iterdir()) == before


@pytest.mark.parametrize("content", ["{}", '{"model": "yolo", "lr": 0.1}', "not JSON", ""])
def test_record_of_another_program_is_kept(
    write: Write, tmp_path: Path, capsys: pytest.CaptureFixture[str], content: str
) -> None:
    out = tmp_path / "mine"
    out.mkdir()
    (out / DETECTOR_RECORD).write_text(content, encoding="utf-8")
    for words in ([], ["--replace"]):
        assert write("--out", str(out), *words) == 2
        assert "expected the record of the detector that wrote the labels" in capsys.readouterr().err
        assert [path.name for path in out.iterdir()] == [DETECTOR_RECORD]
        assert (out / DETECTOR_RECORD).read_text(encoding="utf-8") == content


@pytest.mark.usefixtures("pictures_not_drawn")
def test_second_detection_of_the_same_images_is_refused(
    bands: Path, model: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    record = detection_record(model, DetectorConfig())
    folder = label_folder(open_sequence(bands), record, tmp_path / "cache")
    folder.mkdir(parents=True)
    words = ["run", str(bands), "--out", str(tmp_path / "out"), "--detector", str(model)]
    with only_process(folder):
        assert main([*words, "--cache", str(tmp_path / "cache")]) == 2
    assert "another process is working in this folder: wait until it ends" in capsys.readouterr().err
    assert texts(folder) == {}


def test_cached_labels_belong_to_one_detector(bands: Path, model: Path, tmp_path: Path) -> None:
    configs = (DetectorConfig(), DetectorConfig(score=0.5), DetectorConfig(threads=2))
    sequences = [labelled_sequence(open_sequence(bands), model, config, cache=tmp_path) for config in configs]
    folders = [sequence.labels for sequence in sequences]
    assert len(set(folders)) == 2  # the number of threads does not change the boxes
    assert folders[0] is not None
    whole = texts(folders[0])
    (folders[0] / "000002.txt").write_text("2 0.5 0.")
    (folders[0] / DETECTOR_RECORD).write_text("[1, 2")
    assert labelled_sequence(open_sequence(bands), model, cache=tmp_path).labels == folders[0]
    assert texts(folders[0]) == whole


def counting(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """A list to which each detection in an image adds a 1."""
    calls, detect = list[int](), YoloDetector.detect

    def counted(detector: YoloDetector, *inputs: Any) -> Boxes:
        calls.append(1)
        return detect(detector, *inputs)

    monkeypatch.setattr(YoloDetector, "detect", counted)
    return calls


def test_cached_labels_belong_to_the_contents_of_images(
    bands: Path, model: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls = counting(monkeypatch)
    first = labelled_sequence(open_sequence(bands), model, cache=tmp_path).labels
    assert len(calls) == 6
    shutil.copytree(bands, tmp_path / "elsewhere")
    assert labelled_sequence(open_sequence(tmp_path / "elsewhere"), model, cache=tmp_path).labels == first
    assert len(calls) == 6
    replace_image(bands / "image_0" / "000003.png")
    second = labelled_sequence(open_sequence(bands), model, cache=tmp_path).labels
    assert second != first
    assert len(calls) == 7  # the labels of the five other images are copied
    assert first is not None
    assert second is not None
    assert texts(first) == texts(second)


def test_copied_labels_take_no_part_in_the_time_of_the_detector(
    bands: Path, model: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pause = 0.2
    detect = YoloDetector.detect

    def slow(detector: YoloDetector, *inputs: Any) -> Boxes:
        time.sleep(pause)
        return detect(detector, *inputs)

    monkeypatch.setattr(YoloDetector, "detect", slow)
    counted = list[tuple[int, float]]()

    def detected(images: int, seconds: float) -> None:
        counted.append((images, seconds))

    sequence = open_sequence(bands)
    for part in (sequence.part(0, 4), sequence, sequence, sequence.part(0, 3)):
        labelled_sequence(part, model, cache=tmp_path, detected=detected)
    assert [images for images, _ in counted] == [4, 2]  # four of the six labels are copied, then all
    assert all(seconds >= pause for _, seconds in counted)


@pytest.mark.usefixtures("pictures_not_drawn")
def test_labels_of_other_classes_are_never_taken(
    bands: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    answer = np.zeros((1, 6, yolox_cells(64, 64)), np.float32)
    answer[0, :, 0] = 32, 32, 20, 10, 0.9, 0
    answer[0, :, 1] = 12, 32, 20, 10, 0, 0.8
    path = write_answering(tmp_path / "two.onnx", answer, names="{0: 'car', 1: 'person'}")
    write = load("write_labels")
    assert write([str(bands), "--model", str(path)]) == 0
    record = json.loads((bands / "labels" / DETECTOR_RECORD).read_text())
    assert record["names"] == {"2": "car", "0": "person"}
    assert record["written"] == [2]
    words = ["run", str(bands), "--features.blob_cell", "9", "--fresh"]
    assert main([*words, "--out", str(tmp_path / "a")]) == 0
    assert "note: boxes of car; not person (as the detector names them)" in one_line(capsys)
    assert main([*words, "--out", str(tmp_path / "b"), "--filter.classes", "person"]) == 2
    assert "the detector's boxes of class person were not written, only those of car" in one_line(capsys)
    detected = ["--detector", str(path), "--cache", str(tmp_path / "cache")]
    assert main([*words, "--out", str(tmp_path / "b"), "--filter.classes", "person", *detected]) == 0
    assert "note: boxes of person; not car" in one_line(capsys)
    assert write([str(bands), "--model", str(path), "--classes", "person"]) == 2
    assert "labels that this detector did not write" in one_line(capsys)


def one_line(capsys: pytest.CaptureFixture[str]) -> str:
    captured = capsys.readouterr()
    return " ".join((captured.out + captured.err).split())


def test_model_without_names_is_chosen_by_number(
    bands: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    answer = np.zeros((1, 5, yolox_cells(64, 64)), np.float32)
    answer[0, :, 0] = 32, 32, 20, 10, 0.9
    path = write_answering(tmp_path / "one.onnx", answer)
    words = ["run", str(bands), "--detector", str(path), "--cache", str(tmp_path / "cache")]
    words += ["--features.blob_cell", "9", "--out", str(tmp_path / "out")]
    assert main(words) == 2
    assert "the model has no class names, so its classes are chosen by number: --filter.classes 0" in (
        one_line(capsys)
    )
    assert main([*words, "--filter.classes", "0"]) == 0
    removed = re.search(r"features removed in boxes │ (\S+) %", one_line(capsys))
    assert removed is not None
    assert 0 < float(removed[1]) < 100
    assert main([*words, "--filter.classes", "1", "--fresh"]) == 2
    assert "its classes are chosen by number" in one_line(capsys)


@pytest.mark.usefixtures("pictures_not_drawn")
def test_every_class_that_is_chosen_is_removed(
    bands: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    answer = np.zeros((1, 6, yolox_cells(64, 64)), np.float32)
    answer[0, :, 0] = 32, 32, 20, 10, 0.9, 0
    path = write_answering(tmp_path / "two.onnx", answer, names="{0: 'big truck', 1: 'tree'}")
    words = ["run", str(bands), "--detector", str(path), "--cache", str(tmp_path / "cache")]
    words += ["--features.blob_cell", "9", "--out", str(tmp_path / "out"), "--fresh"]
    shares = []
    for more in ([], ["--filter.classes", "big truck"], ["--filter.classes", "0"]):
        assert main([*words, *more]) == 0
        removed = re.search(r"features removed in boxes │ (\S+) %", one_line(capsys))
        assert removed is not None
        shares.append(float(removed[1]))
    assert shares[0] > 0
    assert len(set(shares)) == 1


def test_models_of_other_names_tell_how_to_choose(
    bands: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    answer = np.zeros((1, 5, yolox_cells(64, 64)), np.float32)
    path = write_answering(tmp_path / "one.onnx", answer, names="{0: 'Fahrzeug'}")
    (bands / "labels").mkdir()
    (bands / "labels" / "000001.txt").write_text("2 0.5 0.5 0.1 0.1\n")
    before = texts(bands / "labels")
    assert load("write_labels")([str(bands), "--model", str(path), "--replace"]) == 2
    assert "none of the classes is a vehicle by its name, only Fahrzeug: --classes Fahrzeug" in one_line(
        capsys
    )
    assert texts(bands / "labels") == before  # nothing is deleted before the model is known to be usable


@pytest.mark.usefixtures("pictures_not_drawn")
def test_incomplete_labels_are_completed_where_a_detector_is_asked_for(
    bands: Path, model: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (bands / "labels").mkdir()
    (bands / "labels" / "000001.txt").write_text("2 0.5 0.5 0.1 0.1\n")
    words = ["reproduce", "--sequences", str(bands), "--methods", "feature_selection", "--seeds", "1"]
    words += ["--variant", "published", "--cache", str(tmp_path / "cache"), "--lengths", "1"]
    main([*words, "--out", str(tmp_path / "a")])
    assert "note: bands: 5 of 6 images have no label file, which means no vehicle" in one_line(capsys)
    assert "5 of 6 images have no label file" in (tmp_path / "a" / "table1.md").read_text(encoding="utf-8")
    main([*words, "--out", str(tmp_path / "b"), "--detector", str(model)])
    told = one_line(capsys)
    assert "5 of 6 images have no label file, so the boxes of all images are those of --detector" in told
    assert "which means no vehicle" not in told
    assert with_all_labels(open_sequence(bands), model, cache=tmp_path).labels != bands / "labels"
