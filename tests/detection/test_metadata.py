"""Class names and other entries of a model's metadata."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tiny_onnx import write_answering

from vo_lib.data.class_names import COCO
from vo_lib.detection.metadata import MAX_CLASSES, read_metadata, read_names, read_size
from vo_lib.detection.yolo import YoloDetector
from vo_lib.errors import DataError

NAMES = ("car", "driver's cab", 'the "big" truck', "truck-l-", "Straße, nass", "naïve\tname")
WRITTEN = tuple(" ".join(name.split()) for name in NAMES)


@pytest.mark.parametrize(
    "text",
    [
        str(dict(enumerate(NAMES))),
        str(dict(reversed(list(enumerate(NAMES))))),
        str({str(k): name for k, name in enumerate(NAMES)}),
        str(list(NAMES)),
        str(NAMES),
        json.dumps(NAMES),
        json.dumps(dict(enumerate(NAMES))),
        json.dumps(dict(enumerate(NAMES)), ensure_ascii=False, indent=2),
    ],
)
def test_names_are_read_from_every_notation(text: str) -> None:
    assert read_names(text) == WRITTEN


@given(st.lists(st.text(st.characters(codec="utf-8"), max_size=20), min_size=1, max_size=30), st.booleans())
def test_names_of_any_letters_are_read_as_they_were_written(names: list[str], as_json: bool) -> None:
    numbered = dict(enumerate(names))
    text = json.dumps(numbered) if as_json else str(numbered)
    assert read_names(text) == tuple(" ".join(name.split()) for name in names)


@pytest.mark.parametrize("text", ["", "  ", "{}", "[]", "None", "null"])
def test_a_text_without_names_means_that_the_model_has_none(text: str) -> None:
    assert read_names(text) is None


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("car, truck", "cannot be read"),
        ("{0: 'car', 1: 'truck'", "cannot be read"),
        ("{0: 'car', 1: truck}", "cannot be read"),
        ("'car'", "cannot be read"),
        ("7", "cannot be read"),
        ("[" * 5000, "cannot be read"),
        (str(["x"] * (MAX_CLASSES + 1)), "cannot be read"),
        ("{1: 'car', 2: 'truck'}", "have the numbers 1, 2"),
        ("{0: 'car', 2: 'truck'}", "have the numbers 0, 2"),
        ("{0: 'car', '0': 'truck'}", "have the numbers 0"),
        ("{'car': 0, 'truck': 1}", "have no numbers"),
        ("{0: None}", "are not all text"),
        ("[['car'], ['truck']]", "are not all text"),
    ],
)
def test_unreadable_or_badly_numbered_names_are_refused(text: str, words: str, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=words):
        read_names(text)
    path = write_answering(tmp_path / "m.onnx", np.zeros((1, 6, 84)), names=text)
    with pytest.raises(DataError, match=r"m\.onnx: its class names .*expected names such as {0: 'car'"):
        YoloDetector(path)


def test_cocos_names_are_only_taken_where_a_model_has_none(tmp_path: Path) -> None:
    path = tmp_path / "m.onnx"
    for rows, names, expected, named in (
        (84, None, COCO, False),
        (7, None, None, False),
        (84, str(list(reversed(COCO))), tuple(reversed(COCO)), True),
    ):
        detector = YoloDetector(write_answering(path, np.zeros((1, rows, 84)), names=names))
        assert detector.names == expected
        assert detector.named == named
        assert detector.class_count == rows - 4
    write_answering(path, np.zeros((1, 84, 84)), names="{0: 'car', 1: 'truck'}")
    with pytest.raises(DataError, match="the metadata names 2 classes"):
        YoloDetector(path)


def test_image_size_task_and_suppression_are_read_from_the_metadata() -> None:
    assert [
        read_size(text) for text in ("[640, 640]", "(384, 672)", "800", "", "big", "[8, 8]", "99999")
    ] == [
        640,
        672,
        800,
        None,
        None,
        None,
        None,
    ]
    found = read_metadata({"task": "Segment", "end2end": "True", "imgsz": "[320, 320]", "names": "['car']"})
    assert (found.task, found.one_to_one, found.transformer, found.size) == ("segment", True, False, 320)
    assert found.names == ("car",)
    assert not read_metadata({"end2end": "False", "args": "{'nms': False}"}).one_to_one
    assert read_metadata({"args": "{'nms': True, 'data': None}"}).one_to_one
    assert not read_metadata({"args": "{'nms': True"}).one_to_one
    assert read_metadata({"head": "RTDETRDecoder"}).transformer
    assert read_metadata({"description": "Ultralytics rtdetr-l model trained on coco.yaml"}).transformer
