"""The detector: letterbox, both layouts of the output, suppression, errors, recall and precision."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from real_images import SHARED, labelled_drive_0005
from tiny_onnx import write_answering

from vo_lib.data.sequence import Sequence
from vo_lib.detection.label_folders import chosen_mask, with_label_numbers
from vo_lib.detection.models import MODELS
from vo_lib.detection.network_image import fit_letterbox, yolox_cells
from vo_lib.detection.suppression import best_boxes
from vo_lib.detection.yolo import YoloDetector
from vo_lib.errors import DataError
from vo_lib.geometry.boxes import Boxes, overlap

VEHICLES = (2, 5, 7)
CELLS = yolox_cells(64, 64)  # 84 rows for a network's image of 64×64 px

sides = st.integers(16, 2000)


@given(sides, sides, st.integers(1, 30), st.integers(1, 30), st.booleans())
def test_boxes_survive_the_way_to_the_network_and_back(
    width: int, height: int, columns: int, rows: int, centred: bool
) -> None:
    letterbox = fit_letterbox(width, height, 32 * columns, 32 * rows, centred)
    box = np.array([[0.2 * width, 0.1 * height, 0.9 * width, 0.7 * height]])
    inside = box * letterbox.scale + [letterbox.left, letterbox.top, letterbox.left, letterbox.top]
    assert letterbox.to_image(inside, width, height) == pytest.approx(box - 0.5, abs=1e-6)
    # The scaled image is inside the network's image, up to rounding.
    assert letterbox.left + letterbox.scale * width <= letterbox.width + 1
    assert letterbox.top + letterbox.scale * height <= letterbox.height + 1


def yolov8_answer(classes: int = 2) -> np.ndarray:
    """Output with one box of class 1: centre (32, 24), 20 × 10 px, score 0.75, in an input of 64 × 64 px."""
    answer = np.zeros((1, 4 + classes, CELLS), np.float32)
    answer[0, :4, 7] = 32, 24, 20, 10
    answer[0, 5, 7] = 0.75
    return answer


def yolox_answer() -> np.ndarray:
    """The same box as raw output of the cell in column 1 and row 1 of the grid with stride 16."""
    answer = np.zeros((1, CELLS, 5 + 2), np.float32)
    row = 8 * 8 + 1 * 4 + 1
    answer[0, row, :4] = 32 / 16 - 1, 24 / 16 - 1, np.log(20 / 16), np.log(10 / 16)
    answer[0, row, 4:] = 0.8, 0.1, 0.75 / 0.8
    return answer


LAYOUTS = {"yolov8": yolov8_answer(), "yolox": yolox_answer()}


@pytest.fixture(params=LAYOUTS)
def either(request: pytest.FixtureRequest, tmp_path: Path) -> YoloDetector:
    """A network of each layout that detects the same box of a car in every image."""
    path = write_answering(tmp_path / "m.onnx", LAYOUTS[request.param], names="{0: 'cat', 1: 'Car'}")
    detector = YoloDetector(path)
    assert detector.layout_name == request.param
    return detector


def test_both_layouts_give_the_box(either: YoloDetector) -> None:
    # The image fills the network's image from edge to edge at half the scale.
    result = either.detect(np.zeros((128, 128), np.uint8))
    assert result.xyxy == pytest.approx(np.array([[43.5, 37.5, 83.5, 57.5]]), abs=1e-3)
    assert result.class_id.tolist() == [1]  # the model's number
    assert with_label_numbers(either, result).class_id.tolist() == [2]  # COCO's, as in label files
    assert result.score == pytest.approx([0.75], abs=1e-6)


def test_300_selected_boxes_of_a_network_of_every_size_are_no_grid(tmp_path: Path) -> None:
    """300 is also the number of cells of a small image, and a black image may give any values."""
    answer = np.random.default_rng(1).random((1, 300, 84), np.float32)
    path = write_answering(tmp_path / "m.onnx", answer, input_shape=(1, 3, "height", "width"))
    assert YoloDetector(path).layout_name == "rtdetr"


def test_layouts_place_wide_images_differently(either: YoloDetector) -> None:
    result = either.detect(np.zeros((32, 64), np.uint8))
    top = 2.5 if either.layout_name == "yolov8" else 18.5
    assert result.xyxy[0] == pytest.approx([21.5, top, 41.5, top + 10], abs=1e-3)


def test_suppression_keeps_the_better_box() -> None:
    corners = np.array([[0, 0, 10, 10], [1, 0, 11, 10], [5, 0, 15, 10], [30, 30, 40, 40.0]])
    scores = np.array([[0.6, 0], [0.9, 0], [0, 0.5], [0.2, 0.0]])
    result = best_boxes(corners, scores, 0.25, 0.5)
    assert result.score.tolist() == [0.9, 0.5]
    assert result.class_id.tolist() == [0, 1]  # overlapping, but of another class
    corners = np.array([[0, 0, 100, 100], [1, 0, 101, 100.0]])
    assert best_boxes(corners, np.array([[0.6, 0], [0, 0.7]]), 0.25, 0.5).class_id.tolist() == [1]


def test_unusable_models_are_refused(tmp_path: Path) -> None:
    path, box = tmp_path / "model.onnx", yolov8_answer()

    def message() -> str:
        with pytest.raises(DataError) as caught:
            YoloDetector(path)
        text = str(caught.value)
        assert text.startswith(str(path))
        assert "\n" not in text
        return text

    path.write_bytes(b"not a model")
    assert "not a model that ONNX Runtime can load" in message()
    write_answering(path, box, input_shape=(1, 3, 64))
    assert "expected one input [1, 3, height, width], found [1, 3, 64]" in message()
    write_answering(path, box, names="{0: 'cat', 1: 'dog'}")
    with pytest.raises(DataError, match="none of the classes is a vehicle by its name, only cat, dog"):
        chosen_mask(YoloDetector(path), ("vehicles",))


@pytest.mark.parametrize("classes", [(), ("vehicles",), ("0", "car"), ("2",)])
def test_a_model_without_names_has_its_classes_chosen_by_number(
    tmp_path: Path, classes: tuple[str, ...]
) -> None:
    path = tmp_path / "model.onnx"
    write_answering(path, yolov8_answer())
    detector = YoloDetector(path)
    assert detector.names is None
    assert chosen_mask(detector, ("1",)).tolist() == [False, True]
    with pytest.raises(DataError, match="so its classes are chosen by number from 0 to 1"):
        chosen_mask(detector, classes)


def test_classes_beyond_those_of_any_model_are_refused_without_a_class_count(
    tmp_path: Path,
) -> None:
    answer = np.array([[[10.0, 10.0, 30.0, 20.0, 0.9, 2.0]]], np.float32)  # corners, score, class
    detector = YoloDetector(write_answering(tmp_path / "model.onnx", answer))
    assert detector.class_count is None
    assert chosen_mask(detector, ("2",)).tolist() == [False, False, True]
    with pytest.raises(DataError, match="so its classes are chosen by number"):
        chosen_mask(detector, ("20261127000000",))


def recall_precision(
    images: Iterable[tuple[Boxes, Boxes]], min_height: float, min_iou: float = 0.5
) -> tuple[float, float, int]:
    """Recall, precision and number of true boxes, from the detections and true boxes of each image.

    A detection is correct if it overlaps a true box that has no detection with a higher score. Boxes with a
    height under `min_height` pixels are ignored.
    """
    correct = counted = true_boxes = 0
    for detections, truth in images:
        boxes = detections.xyxy[np.argsort(-detections.score, kind="stable")]
        tall = truth.xyxy[:, 3] - truth.xyxy[:, 1] >= min_height
        iou, free = overlap(boxes, truth.xyxy), np.ones(len(truth), np.bool_)
        for box, row in zip(boxes, iou, strict=True):
            # True boxes that count go first; among these, the larger overlap.
            score = np.where(free & (row >= min_iou), row + tall, 0.0)
            if score.any():
                best = int(score.argmax())
                free[best] = False
                correct, counted = correct + int(tall[best]), counted + int(tall[best])
            else:
                counted += int(box[3] - box[1] >= min_height)
        true_boxes += int(tall.sum())
    return correct / max(true_boxes, 1), correct / max(counted, 1), true_boxes


def test_street_model_detects_vehicles_of_a_new_street(street: Sequence) -> None:
    detector, frames = YoloDetector("street"), range(5, 75, 10)
    images = [(detector.detect(street.stereo(frame)[0]), street.boxes(frame)) for frame in frames]
    numbered = [with_label_numbers(detector, detections) for detections, _ in images]
    assert all(set(detections.class_id.tolist()) <= set(VEHICLES) for detections in numbered)
    recall, precision, vehicles = recall_precision(images, 32.0)
    assert vehicles >= 30
    assert recall >= 0.75
    assert precision >= 0.75
    assert MODELS["street"].stat().st_size <= 3_000_000


# Measured bounds of plain decoders: vehicles at least 25 px high, IoU 0.5, score 0.25, NMS 0.5.
@pytest.mark.parametrize(
    ("model", "recall", "precision"), [("yolov8n_int8", 0.79, 0.61), ("yolox_nano", 0.74, 0.63)]
)
def test_detectors_find_the_labelled_vehicles_of_drive_0005(
    model: str, recall: float, precision: float
) -> None:
    path = SHARED / "models" / f"{model}.onnx"
    if not path.exists():
        pytest.skip("the detectors are not beside this checkout (shared/data/models)")
    detector, drive = YoloDetector(path), labelled_drive_0005()
    frames = range(len(drive))
    vehicles = [drive.boxes(frame) for frame in frames]
    mask = chosen_mask(detector, ("car", "bus", "truck"))
    detections = [detector.detect(drive.stereo(frame)[0], mask) for frame in frames]
    result = recall_precision(zip(detections, vehicles, strict=True), 25.0)
    assert result[2] == 340
    assert result[0] >= recall - 0.03
    assert result[1] >= precision - 0.03
