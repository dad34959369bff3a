"""Models of several files: which files belong to a model, their hash, and names that lead elsewhere."""

from __future__ import annotations

import hashlib
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tiny_onnx import field, tensor, write_answering, write_network

from vo_lib.detection.label_folders import detection_record
from vo_lib.detection.model_files import copy_model, external_names, model_files, model_sha256
from vo_lib.detection.settings import DetectorConfig
from vo_lib.detection.yolo import YoloDetector
from vo_lib.errors import DataError

ANSWER = np.zeros((1, 7, 84), np.float32)


def write_parts(folder: Path, location: str = "weights.bin") -> Path:
    return write_network(folder / "m.onnx", {"output0": ANSWER}, locations={"output0": location})


def test_a_model_of_one_file_has_the_hash_of_the_file(tmp_path: Path) -> None:
    path = write_answering(tmp_path / "m.onnx", ANSWER)
    assert model_files(path) == (path,)
    assert model_sha256(path) == hashlib.sha256(path.read_bytes()).hexdigest()
    for content in (b"", b"no model", b"\xff" * 40, b"\x0a\xff\xff\xff\xff\x0f"):
        path.write_bytes(content)
        assert external_names(path) == []


def test_new_weights_in_another_file_are_another_model(tmp_path: Path) -> None:
    """A model trained again may have the same .onnx file, byte for byte."""
    path = write_parts(tmp_path, "weights/m.bin")
    part = tmp_path / "weights" / "m.bin"
    assert model_files(path) == (path, part)
    lines = "".join(
        f"{hashlib.sha256(file.read_bytes()).hexdigest()}  {name}\n"
        for file, name in ((path, "m.onnx"), (part, "weights/m.bin"))
    )
    assert model_sha256(path) == hashlib.sha256(lines.encode()).hexdigest()
    before = detection_record(path, DetectorConfig())
    part.write_bytes((ANSWER + 1).tobytes())
    assert detection_record(path, DetectorConfig())["sha256"] != before["sha256"]


def test_tensors_inside_nodes_and_graphs_count(tmp_path: Path) -> None:
    """External data of a constant in a branch of a branch, as exporters write for control flow."""
    inner = field(1, "value") + field(5, tensor("t", ANSWER, "deep.bin")) + field(20, 4)
    graph = field(1, field(1, "out") + field(4, "Constant") + field(5, inner))
    for _ in range(3):
        branch = field(1, "then_branch") + field(6, graph) + field(20, 5)
        graph = field(1, field(4, "If") + field(5, branch))
    path = tmp_path / "m.onnx"
    path.write_bytes(field(1, 8) + field(7, graph))
    assert external_names(path) == ["deep.bin"]
    path.write_bytes(field(1, 8) + field(25, field(7, field(5, inner))))
    assert external_names(path) == ["deep.bin"]


@pytest.mark.parametrize(
    "location",
    ["../weights.bin", "/etc/passwd", "a/../../b", "C:\\w.bin", "..\\w.bin", "", ".", "m.onnx", "a\0b"],
)
def test_weights_outside_the_folder_are_refused(location: str, tmp_path: Path) -> None:
    inside = tmp_path / "inside"
    inside.mkdir()
    path = inside / "m.onnx"
    constant = tensor("output0_constant", ANSWER, location)
    path.write_bytes(field(1, 8) + field(7, field(5, constant)))
    for use in (external_names, model_files, model_sha256, YoloDetector):
        with pytest.raises(
            DataError, match=r"refers to .* for its weights, which is not a file in its folder"
        ):
            use(path)
    with pytest.raises(DataError, match="refers to"):
        copy_model(path, inside / "copy.onnx")
    assert [file.name for file in tmp_path.rglob("*") if file.is_file()] == ["m.onnx"]


def test_a_copy_has_all_files_and_the_new_name(tmp_path: Path) -> None:
    path = write_parts(tmp_path)
    target = tmp_path / "new" / "detector.onnx"
    copy_model(path, target)
    assert {p.name: p.read_bytes() for p in target.parent.iterdir()} == {
        "detector.onnx": path.read_bytes(),
        "weights.bin": ANSWER.tobytes(),
    }
    with pytest.raises(DataError, match=r"m\.onnx: its weights are in a file named weights\.bin: choose"):
        copy_model(path, tmp_path / "new" / "weights.bin")
    # A model of which a part is missing leaves the old copy as it was.
    (tmp_path / "weights.bin").unlink()
    with pytest.raises(DataError, match=r"its file of weights weights\.bin is missing"):
        copy_model(path, target)
    assert len(list(target.parent.iterdir())) == 2
    assert target.read_bytes() == path.read_bytes()


@given(st.binary(max_size=300))
def test_any_bytes_are_read_without_another_error(data: bytes) -> None:
    with TemporaryDirectory() as folder:
        path = Path(folder) / "any.onnx"
        path.write_bytes(data)
        with suppress(DataError):
            external_names(path)
