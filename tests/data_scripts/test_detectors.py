"""Detectors by name: fetched and verified, registered from disk, or explained."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np
import pytest
from file_server import FileServer
from tiny_onnx import write_answering

from fetch.detectors import FETCHABLE, fetch_detector, register_detector
from vo_lib.core.errors import DataError
from vo_lib.detection.detectors import Detector, find_model, known

DATA = np.random.default_rng(1).bytes(200_000)


@pytest.fixture
def small(server: FileServer) -> Detector:
    """A fetchable detector on the test's server."""
    server.files["small.onnx"] = DATA
    sha256 = hashlib.sha256(DATA).hexdigest()
    return Detector("small", "small.onnx", server.url + "small.onnx", len(DATA), sha256, "MIT", "for tests")


@pytest.fixture
def onnx(tmp_path: Path) -> Path:
    """A model that the kit can run."""
    return write_answering(tmp_path / "own.onnx", np.zeros((1, 5, 84), np.float32), names="['car']")


def test_the_registry_is_what_the_readme_of_the_scripts_says() -> None:
    text = (Path(__file__).parents[2] / "data_scripts" / "README.md").read_text(encoding="utf-8")
    for name, detector in FETCHABLE.items():
        size = f"{detector.size:,}".replace(",", " ")
        assert f"| `{name}` | {size} bytes | {detector.licence} | `{detector.sha256}` |" in text
        assert name == detector.name
        assert detector.url.endswith("/" + detector.file)


def test_a_detector_is_fetched_once_and_again_where_it_is_damaged(
    small: Detector, server: FileServer, tmp_path: Path
) -> None:
    server.drop_every = 2
    path = fetch_detector(small, tmp_path)
    assert path.read_bytes() == DATA
    asked = server.gets["small.onnx"]
    assert fetch_detector(small, tmp_path) == find_model("small", tmp_path) == path
    assert server.gets["small.onnx"] == asked
    path.write_bytes(b"x" * len(DATA))
    assert fetch_detector(small, tmp_path).read_bytes() == DATA


def test_names_that_are_not_known_or_not_there_are_said(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"'yolox-s': .* one of street; vo data get_detector lists more"):
        find_model("yolox-s", tmp_path)
    with pytest.raises(DataError, match=r"my\.onnx: the model is missing: .* street"):
        find_model("my.onnx", tmp_path)


def test_a_model_of_ones_own_is_registered(onnx: Path, tmp_path: Path) -> None:
    made = register_detector("mine", onnx, tmp_path / "new", "own work")
    assert made.sha256 == hashlib.sha256(onnx.read_bytes()).hexdigest()
    detector, path = known(tmp_path / "new")["mine"]
    assert detector == made
    assert path is not None
    assert path.read_bytes() == onnx.read_bytes()
    again = register_detector("mine", path, tmp_path / "new")
    assert again.licence == "not stated"
    assert find_model("mine", tmp_path / "new") == path


@pytest.mark.parametrize("name", ["../up", "a/b", "", ".hidden"])
def test_a_name_is_no_path(name: str, onnx: Path, tmp_path: Path) -> None:
    with pytest.raises(DataError, match="is no name"):
        register_detector(name, onnx, tmp_path / "new")


def test_what_is_no_model_or_another_than_its_name_says_is_refused(onnx: Path, tmp_path: Path) -> None:
    (tmp_path / "page.onnx").write_text("<html>", encoding="utf-8")
    for name, path, words in (
        ("yolox-tiny", onnx, "is not the official yolox-tiny"),
        ("mine", tmp_path / "page.onnx", "no model that ONNX Runtime can load"),
        ("mine", tmp_path / "nowhere.onnx", "the file is missing"),
    ):
        with pytest.raises(DataError, match=words):
            register_detector(name, path, tmp_path / "new")
    assert not (tmp_path / "new").exists()
