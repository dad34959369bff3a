"""Detectors by name: fetched and verified, registered from disk, or explained."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np
import pytest
from file_server import FileServer

from fetch.detectors import fetch_detector, register_detector
from vo_lib.core.errors import DataError
from vo_lib.detection.detectors import FETCHABLE, Detector, find_detector, known

DATA = np.random.default_rng(1).bytes(200_000)


@pytest.fixture
def small(server: FileServer, monkeypatch: pytest.MonkeyPatch) -> Detector:
    """A fetchable detector on the test's server."""
    server.files["small.onnx"] = DATA
    sha256 = hashlib.sha256(DATA).hexdigest()
    made = Detector("small", "small.onnx", server.url + "small.onnx", len(DATA), sha256, "MIT", "for tests")
    monkeypatch.setitem(FETCHABLE, "small", made)
    return made


@pytest.fixture(scope="session")
def onnx(clips: Path) -> Path:
    """A real ONNX model; skipped where there is none."""
    path = clips.parent / "models" / "yolox_nano.onnx"
    if not path.exists():
        pytest.skip("the real models are not beside this checkout (shared/data/models)")
    return path


def test_the_registry_is_what_the_readme_of_the_scripts_says() -> None:
    text = (Path(__file__).parents[2] / "data_scripts" / "README.md").read_text(encoding="utf-8")
    for name, detector in FETCHABLE.items():
        size = f"{detector.size:,}".replace(",", " ")
        assert f"| `{name}` | {size} bytes | {detector.licence} | `{detector.sha256}` |" in text
        assert name == detector.name
        assert detector.url.endswith("/" + detector.file)


def test_a_detector_is_fetched_once(small: Detector, server: FileServer, tmp_path: Path) -> None:
    server.drop_every = 2
    path = fetch_detector("small", tmp_path)
    assert path.read_bytes() == DATA
    asked = server.gets["small.onnx"]
    assert fetch_detector("small", tmp_path) == find_detector("small", tmp_path) == path
    assert server.gets["small.onnx"] == asked


def test_a_damaged_file_is_fetched_again(small: Detector, tmp_path: Path) -> None:
    (tmp_path / small.file).write_bytes(b"x" * len(DATA))
    assert fetch_detector("small", tmp_path).read_bytes() == DATA


def test_a_mirror_must_have_the_same_file(small: Detector, server: FileServer, tmp_path: Path) -> None:
    server.files["mirror.onnx"] = DATA
    assert fetch_detector("small", tmp_path, url=server.url + "mirror.onnx").read_bytes() == DATA
    assert server.gets["small.onnx"] == 0


def test_names_that_are_not_known_or_not_there_are_said(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="there are yolox-nano, yolox-tiny, yolox-s"):
        find_detector("yolo", tmp_path)
    with pytest.raises(DataError, match="expected one of yolox-nano"):
        fetch_detector("yolo", tmp_path)
    with pytest.raises(DataError, match="yolox-s fetches it"):
        find_detector("yolox-s", tmp_path)


def test_a_model_of_ones_own_is_registered(onnx: Path, tmp_path: Path) -> None:
    made = register_detector("mine", onnx, tmp_path / "new", "own work")
    assert made.sha256 == hashlib.sha256(onnx.read_bytes()).hexdigest()
    detector, path = known(tmp_path / "new")["mine"]
    assert detector == made
    assert path is not None
    assert path.read_bytes() == onnx.read_bytes()
    again = register_detector("mine", path, tmp_path / "new")
    assert again.licence == "not stated"
    assert find_detector("mine", tmp_path / "new") == path


def test_a_file_that_is_not_the_official_one_does_not_get_its_name(onnx: Path, tmp_path: Path) -> None:
    with pytest.raises(DataError, match="is not the official yolox-tiny"):
        register_detector("yolox-tiny", onnx, tmp_path)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["../up", "a/b", "", ".hidden"])
def test_a_name_is_no_path(name: str, tmp_path: Path) -> None:
    with pytest.raises(DataError, match="is no name"):
        register_detector(name, tmp_path / "x.onnx", tmp_path)


def test_what_is_no_model_is_refused(tmp_path: Path) -> None:
    (tmp_path / "page.onnx").write_text("<html>", encoding="utf-8")
    with pytest.raises(DataError, match="no model that ONNX Runtime can load"):
        register_detector("mine", tmp_path / "page.onnx", tmp_path / "new")
    with pytest.raises(DataError, match="the file is missing"):
        register_detector("mine", tmp_path / "nowhere.onnx", tmp_path / "new")
    assert not (tmp_path / "new").exists()
