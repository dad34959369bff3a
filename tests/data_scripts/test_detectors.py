"""Detectors by name: download, verification, registration, and errors."""

from __future__ import annotations

import hashlib
import shutil
from pathlib import Path

import numpy as np
import pytest
from data_command import load
from file_server import FileServer
from tiny_onnx import FLOAT, write_answering, write_network

from fetch.detectors import FETCHABLE, Detector, fetch_detector, register_detector
from fetch.download import format_bytes
from vo_lib.detection.models import find_model, list_detectors
from vo_lib.detection.yolo import YoloDetector
from vo_lib.errors import DataError

DATA = np.random.default_rng(1).bytes(200_000)


@pytest.fixture
def small(server: FileServer) -> Detector:
    """A detector file on the test server."""
    server.files["small.onnx"] = DATA
    sha256 = hashlib.sha256(DATA).hexdigest()
    return Detector("small", server.url + "small.onnx", len(DATA), sha256, "for tests")


@pytest.fixture
def onnx(tmp_path: Path) -> Path:
    """A valid model."""
    return write_answering(tmp_path / "own.onnx", np.zeros((1, 5, 84), np.float32), names="['car']")


def test_detector_is_downloaded_once_unless_damaged(
    small: Detector, server: FileServer, tmp_path: Path
) -> None:
    path = fetch_detector(small, tmp_path)
    assert path.read_bytes() == DATA
    requests = server.gets["small.onnx"]
    assert fetch_detector(small, tmp_path) == find_model("small", tmp_path) == path
    assert server.gets["small.onnx"] == requests
    path.write_bytes(b"x" * len(DATA))
    assert fetch_detector(small, tmp_path).read_bytes() == DATA


def test_own_model_is_registered(onnx: Path, tmp_path: Path) -> None:
    path = register_detector("mine", onnx, tmp_path / "new")
    assert path.read_bytes() == onnx.read_bytes()
    assert register_detector("mine", path, tmp_path / "new") == path
    assert list_detectors(tmp_path / "new") == {"mine": path}
    assert find_model("mine", tmp_path / "new") == path
    other = write_answering(tmp_path / "other.onnx", np.zeros((1, 5, 84), np.float32), names="['truck']")
    with pytest.raises(DataError, match=r"mine\.onnx: is another detector: choose another name"):
        register_detector("mine", other, tmp_path / "new")
    assert path.read_bytes() == onnx.read_bytes()


def test_bad_names_and_files_of_models_are_refused(onnx: Path, tmp_path: Path) -> None:
    (tmp_path / "page.onnx").write_text("<html>", encoding="utf-8")
    for name, path, words in (
        ("../up", onnx, "is not a valid name"),
        ("yolox-tiny", onnx, "is not the official yolox-tiny"),
        ("mine", tmp_path / "page.onnx", "not a model that ONNX Runtime can load"),
    ):
        with pytest.raises(DataError, match=words):
            register_detector(name, path, tmp_path / "new")
    assert not (tmp_path / "new").exists()
    with pytest.raises(DataError, match=r"'mine': .* one of street; `vo data get_detector` lists more"):
        find_model("mine", tmp_path / "new")
    for name in (*FETCHABLE, "yolov8n", "yolo26n", "yolo11s", "rtdetr-l"):
        with pytest.raises(DataError, match=rf"not on this machine; use: vo data get_detector {name}$"):
            find_model(name, tmp_path / "new")
    with pytest.raises(DataError, match="street is the kit's own detector"):
        register_detector("street", onnx, tmp_path / "new")


def test_a_missing_file_is_called_missing(tmp_path: Path) -> None:
    for name, words in (
        ("yolov8n.onnx", "; `vo data get_detector yolov8n` says how to get this model"),
        ("street.onnx", "; the detector of this name is given as street"),
        ("best.onnx", ""),
        ("runs/best.pt", ""),
        ("runs/street", "; the detector of this name is given as street"),
    ):
        with pytest.raises(DataError) as caught:
            find_model(name, tmp_path)
        assert str(caught.value) == f"{name}: no such file{words}"
    (tmp_path / "best.pt").write_bytes(b"PK")
    with pytest.raises(DataError, match=r"is a file of PyTorch, .* yolo export model=best.pt format=onnx$"):
        find_model(tmp_path / "best.pt", tmp_path)


def write_parts(folder: Path, weight: float = 0.0) -> Path:
    """A model with a car whose numbers are in two files beside it, one of them in a folder."""
    answer = np.zeros((1, 84, 4), np.float32)
    answer[0, 0] = 10 + weight, 10, 40, 40
    scores = np.zeros((1, 84, 2), np.float32)
    scores[0, 0] = 0, 0.9
    folder.mkdir(exist_ok=True)
    return write_network(
        folder / "best.onnx",
        {"boxes": answer, "scores": scores},
        {"images": ((1, 3, 64, 64), FLOAT)},
        {"names": "{0: 'cat', 1: 'car'}"},
        locations={"boxes": "best.onnx.data", "scores": "parts/scores.bin"},
    )


def test_all_files_of_a_model_are_registered(tmp_path: Path) -> None:
    source = write_parts(tmp_path / "export")
    expected = YoloDetector(source).detect(np.zeros((64, 64), np.uint8)).xyxy
    assert len(expected) == 1
    path = register_detector("mine", source, tmp_path / "new")
    shutil.rmtree(source.parent)
    assert list_detectors(tmp_path / "new") == {"mine": path}
    assert find_model("mine", tmp_path / "new") == path
    np.testing.assert_array_equal(YoloDetector(path).detect(np.zeros((64, 64), np.uint8)).xyxy, expected)
    # A second model with files of the same names is beside it; one under the same name is refused.
    other = write_parts(tmp_path / "again", weight=2)
    register_detector("other", other, tmp_path / "new")
    np.testing.assert_array_equal(YoloDetector(path).detect(np.zeros((64, 64), np.uint8)).xyxy, expected)
    with pytest.raises(DataError, match=r"mine\.onnx: is another detector: choose another name"):
        register_detector("mine", other, tmp_path / "new")
    assert sorted(p.name for p in (tmp_path / "new").iterdir()) == ["mine", "other"]


def test_half_of_a_model_is_not_registered(tmp_path: Path) -> None:
    source = write_parts(tmp_path / "export")
    (source.parent / "parts" / "scores.bin").unlink()
    with pytest.raises(DataError, match=r"best\.onnx: its file of weights scores\.bin is missing: copy both"):
        register_detector("mine", source, tmp_path / "new")
    # Too short a file is whole by its name; loading tells.
    source = write_parts(tmp_path / "export")
    (source.parent / "best.onnx.data").write_bytes(b"short")
    with pytest.raises(DataError, match="is not a model that ONNX Runtime can load"):
        register_detector("mine", source, tmp_path / "new")
    assert not (tmp_path / "new").exists()


def test_get_detector_lists_and_describes(
    onnx: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    get_detector = load("get_detector")

    def printed(*words: str, code: int = 0) -> str:
        assert get_detector([*words, "--folder", str(tmp_path / "new")]) == code
        return " ".join("".join(capsys.readouterr()).split())

    listed = printed()
    assert "street" in listed
    assert "yolov8n │ │ COCO, the paper's YOLOv8 │ export it, see below" in listed
    assert "model=yolo26n.pt format=onnx" in printed("yolo26n")
    assert "1 class: car" in printed("mine", "--from", str(onnx))
    whole = write_parts(tmp_path / "export")
    size = format_bytes(sum(file.stat().st_size for file in whole.parent.rglob("*.*")))
    printed("parts", "--from", str(tmp_path / "export" / "best.onnx"))
    assert f"parts │ {size} │ registered │ available" in printed()
    inputs = {"images": ((1, 3, 64, 64), FLOAT)}
    for shape, words in (
        ((1, 84, 84), "the file has no class names; 80 classes are taken as COCO's: person, bicycle, car,"),
        ((1, 7, 84), "the file has no class names: choose its classes by number, 0 to 2"),
        ((0, 7), "the file has no class names: choose its classes by number"),
    ):
        path = write_network(tmp_path / "n.onnx", {"output0": np.zeros(shape, np.float32)}, inputs)
        assert words in printed(f"n{len(shape)}{shape[1]}", "--from", str(path))
