"""What a network is given: YOLOv8 red, green, blue from 0 to 1; YOLOX blue, green, red from 0 to 255.

The networks here answer with one box, whose score is the brightest value that they see in one channel.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from tiny_onnx import FLOAT, _value_info, field

from vo_lib.config import DetectorConfig
from vo_lib.detection.yolo import YoloDetector
from vo_lib.detection.yolo_layout import yolox_cells

SIDE = 64  # of the network's image; an image of this size is given to it as it is
CELLS = yolox_cells(SIDE, SIDE)
ATTRIBUTE_INT = 2
DETECTOR = DetectorConfig(score=0.001, classes=("car",))


def tensor(name: str, values: NDArray[np.float32]) -> bytes:
    dims = b"".join(field(1, side) for side in values.shape)
    return dims + field(2, FLOAT) + field(8, name) + field(9, values.astype(np.float32).tobytes())


def node(kind: str, inputs: list[str], output: str, attribute: bytes = b"") -> bytes:
    named = b"".join(field(1, name) for name in inputs)
    return named + field(2, output) + field(4, kind) + (field(5, attribute) if attribute else b"")


def write_looking(path: Path, base: NDArray[np.float32], by: NDArray[np.float32], channel: int) -> Path:
    """A network that answers base + by · (the largest value in one channel of the image)."""
    one = np.zeros((1, 3, 1, 1), np.float32)
    one[0, channel] = 1.0
    scalar = field(1, "keepdims") + field(3, 0) + field(20, ATTRIBUTE_INT)
    nodes = [
        node("Mul", ["images", "one"], "of_channel"),
        node("ReduceMax", ["of_channel"], "brightest", scalar),
        node("Mul", ["by", "brightest"], "seen"),
        node("Add", ["base", "seen"], "output0"),
    ]
    graph = b"".join(field(1, each) for each in nodes) + field(2, "looking")
    for name, values in (("one", one), ("by", by), ("base", base)):
        graph += field(5, tensor(name, values))
    graph += field(11, _value_info("images", (1, 3, SIDE, SIDE))) + field(
        12, _value_info("output0", ["a"] * 3)
    )
    model = field(1, 8) + field(7, graph) + field(8, field(1, "") + field(2, 17))
    path.write_bytes(model + field(14, field(1, "names") + field(2, "{0: 'car'}")))
    return path


def yolov8(path: Path, channel: int) -> YoloDetector:
    """One box in the middle; its score is the value seen."""
    base, by = np.zeros((2, 1, 5, CELLS), np.float32)
    base[0, :4, 7] = 32, 32, 20, 10
    by[0, 4, 7] = 1.0
    return YoloDetector(write_looking(path, base, by, channel), DETECTOR)


def yolox(path: Path, channel: int) -> YoloDetector:
    """One box of the first cell, 8 px; its score is the value seen divided by 255."""
    base, by = np.zeros((2, 1, CELLS, 6), np.float32)
    base[0, 0, 5] = 1.0
    by[0, 0, 4] = 1.0 / 255.0
    return YoloDetector(write_looking(path, base, by, channel), DETECTOR)


KINDS = {"yolov8": yolov8, "yolox": yolox}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("grey", [51, 153, 255])
def test_each_family_is_given_the_scale_it_was_trained_with(tmp_path: Path, kind: str, grey: int) -> None:
    detector = KINDS[kind](tmp_path / "looking.onnx", 0)
    assert detector.layout == kind
    found = detector.detect(np.full((SIDE, SIDE), grey, np.uint8))
    assert found.score == pytest.approx([grey / 255], abs=1e-6)


def test_black_is_nothing_for_both(tmp_path: Path) -> None:
    for kind, make in KINDS.items():
        assert len(make(tmp_path / f"{kind}.onnx", 0).detect(np.zeros((SIDE, SIDE), np.uint8))) == 0


@pytest.mark.parametrize(("kind", "order"), [("yolov8", "RGB"), ("yolox", "BGR")])
def test_each_family_is_given_its_own_order_of_colours(tmp_path: Path, kind: str, order: str) -> None:
    values = {"R": 204, "G": 102, "B": 51}
    image = np.full((SIDE, SIDE, 3), [values[c] for c in "BGR"], np.uint8)
    for channel, colour in enumerate(order):
        found = KINDS[kind](tmp_path / f"{colour}.onnx", channel).detect(image)
        assert found.score == pytest.approx([values[colour] / 255], abs=1e-6)
