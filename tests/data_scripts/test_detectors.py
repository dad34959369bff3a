"""Detectors by name: download, verification, registration, and errors."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np
import pytest
from file_server import FileServer
from tiny_onnx import write_answering

from fetch.detectors import FETCHABLE, Detector, fetch_detector, register_detector
from vo_lib.detection.models import find_model, list_detectors
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
    for name in (*FETCHABLE, "yolov8n"):
        with pytest.raises(DataError, match=rf"not on this machine; use: vo data get_detector {name}$"):
            find_model(name, tmp_path / "new")
