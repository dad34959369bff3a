"""The detector: fitting images in, both layouts, suppression, clear errors, quality on real images."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest
from detections import recall_precision
from hypothesis import given
from hypothesis import strategies as st
from tiny_onnx import write_answering

from vo_lib.data.catalogue import open_sequence
from vo_lib.data.sequence import Sequence
from vo_lib.detection.class_names import choose_classes, class_numbers
from vo_lib.detection.layout import best_boxes, fit_letterbox, yolox_cells
from vo_lib.detection.models import MODELS
from vo_lib.detection.yolo import YoloDetector
from vo_lib.errors import DataError
from vo_lib.geometry.boxes import Boxes
from vo_lib.geometry.types import Array, Image

DATA = Path(__file__).resolve().parents[3] / "shared" / "data"
VEHICLES = (2, 5, 7)
CELLS = yolox_cells(64, 64)  # 84 rows for a network's image of 64×64 px

sides = st.integers(16, 2000)


@given(sides, sides, st.integers(1, 30), st.integers(1, 30), st.booleans())
def test_letterbox_round_trip(width: int, height: int, columns: int, rows: int, centred: bool) -> None:
    letterbox = fit_letterbox(width, height, 32 * columns, 32 * rows, centred)
    box = np.array([[0.2 * width, 0.1 * height, 0.9 * width, 0.7 * height]])
    inside = box * letterbox.scale + [letterbox.left, letterbox.top, letterbox.left, letterbox.top]
    assert letterbox.to_image(inside, width, height) == pytest.approx(box - 0.5, abs=1e-6)
    # The scaled image lies inside of the network's, to rounding.
    assert letterbox.left + letterbox.scale * width <= letterbox.width + 1
    assert letterbox.top + letterbox.scale * height <= letterbox.height + 1


def yolov8_answer(classes: int = 2) -> np.ndarray:
    """One box of class 1, centre (32, 24), 20 × 10 px, score 0.75, in a network's image of 64 × 64."""
    answer = np.zeros((1, 4 + classes, CELLS), np.float32)
    answer[0, :4, 7] = 32, 24, 20, 10
    answer[0, 5, 7] = 0.75
    return answer


def yolox_answer() -> np.ndarray:
    """The same box, as raw numbers of a cell of stride 16: column 1, row 1."""
    answer = np.zeros((1, CELLS, 5 + 2), np.float32)
    row = 8 * 8 + 1 * 4 + 1
    answer[0, row, :4] = 32 / 16 - 1, 24 / 16 - 1, np.log(20 / 16), np.log(10 / 16)
    answer[0, row, 4:] = 0.8, 0.1, 0.75 / 0.8
    return answer


LAYOUTS = {"yolov8": yolov8_answer(), "yolox": yolox_answer()}


@pytest.fixture(params=LAYOUTS)
def either(request: pytest.FixtureRequest, tmp_path: Path) -> YoloDetector:
    """A network of each layout that finds this box, a car, in every image."""
    path = write_answering(tmp_path / "m.onnx", LAYOUTS[request.param], names="{0: 'cat', 1: 'Car'}")
    detector = YoloDetector(path)
    assert detector.layout == request.param
    return detector


def test_both_layouts_give_the_box(either: YoloDetector) -> None:
    # The image fills the network's image from edge to edge at half the scale.
    result = either.detect(np.zeros((128, 128), np.uint8))
    assert result.xyxy == pytest.approx(np.array([[43.5, 37.5, 83.5, 57.5]]), abs=1e-3)
    assert result.class_id.tolist() == [2]  # COCO's number, whatever the model counts
    assert result.score == pytest.approx([0.75], abs=1e-6)


def test_layouts_place_wide_images_differently(either: YoloDetector) -> None:
    result = either.detect(np.zeros((32, 64), np.uint8))
    top = 2.5 if either.layout == "yolov8" else 18.5
    assert result.xyxy[0] == pytest.approx([21.5, top, 41.5, top + 10], abs=1e-3)


def test_suppression_keeps_the_better_box() -> None:
    corners = np.array([[0, 0, 10, 10], [1, 0, 11, 10], [5, 0, 15, 10], [30, 30, 40, 40.0]])
    scores = np.array([[0.6, 0], [0.9, 0], [0, 0.5], [0.2, 0.0]])
    result = best_boxes(corners, scores, 0.25, 0.5)
    assert result.score.tolist() == [0.9, 0.5]
    assert result.class_id.tolist() == [0, 1]  # overlapping, but of another class
    corners = np.array([[0, 0, 100, 100], [1, 0, 101, 100.0]])
    assert best_boxes(corners, np.array([[0.6, 0], [0, 0.7]]), 0.25, 0.5).class_id.tolist() == [1]


def test_classes_are_chosen_by_name_or_number() -> None:
    names = ("Pedestrian", "Van", "Truck", "sign")
    assert class_numbers(names).tolist() == [0, 2, 7, 83]
    assert choose_classes(("car", "7"), names).tolist() == [False, True, True, False]
    assert choose_classes(("sign",), names).tolist() == [False, False, False, True]
    assert choose_classes((), names).all()
    with pytest.raises(DataError, match=r"class 'cra': expected .* Pedestrian, Van"):
        choose_classes(("cra",), names)


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
    assert "has none of the classes car, bus, truck, only cat, dog" in message()


def test_street_model_detects_vehicles_of_a_new_street(street: Sequence) -> None:
    detector, none = YoloDetector("street"), np.zeros((0, 4))
    frames = range(5, 75, 10)
    images = [(detector.detect(street.stereo(frame)[0]), street.boxes(frame), none) for frame in frames]
    assert all(set(result.class_id.tolist()) <= set(VEHICLES) for result, _, _ in images)
    recall, precision, wanted = recall_precision(images, 32.0)
    assert wanted >= 30
    assert recall >= 0.75
    assert precision >= 0.75
    assert MODELS["street"].stat().st_size <= 3_000_000


def kitti_object_images() -> Iterator[tuple[Image, Boxes, Array]]:
    """KITTI's object images with vehicles and DontCare regions."""
    for path in sorted((DATA / "kitti_object" / "image_2").glob("*.png")):
        labels = DATA / "kitti_object" / "label_2" / f"{path.stem}.txt"
        rows = [line.split() for line in labels.read_text().splitlines()]
        vehicles, regions = (
            np.array([row[4:8] for row in rows if row[0] in kinds], float).reshape(-1, 4)
            for kinds in (("Car", "Van", "Truck"), ("DontCare",))
        )
        truth = Boxes(vehicles, np.zeros(len(vehicles), np.int64), np.ones(len(vehicles)))
        yield np.asarray(cv2.imread(str(path)), np.uint8), truth, regions


def drive_0005_images() -> Iterator[tuple[Image, Boxes, Array]]:
    """KITTI's drive 0005 with the vehicles of its labels, which are without scores."""
    drive = open_sequence(DATA / "kitti_clips" / "sequences" / "drive_0005")
    for frame in range(len(drive)):
        labels = drive.boxes(frame)
        vehicles = labels[np.isin(labels.class_id, VEHICLES)]
        yield drive.stereo(frame)[0], vehicles, np.zeros((0, 4))


# Recall and precision of a plain decoder: vehicles at least 25 px high, IoU 0.5, score 0.25, NMS 0.5.
# Measured here: 0.84 / 0.94 and 0.74 / 0.70 on the object images; 0.79 / 0.61 on the drive.
@pytest.mark.parametrize(
    ("model", "images", "vehicles", "recall", "precision"),
    [
        ("yolov8n_int8", kitti_object_images, 19, 0.84, 0.94),
        ("yolox_nano", kitti_object_images, 19, 0.74, 0.67),
        ("yolov8n_int8", drive_0005_images, 340, 0.79, 0.61),
    ],
)
def test_recall_and_precision_on_real_images(
    model: str,
    images: Callable[[], Iterator[tuple[Image, Boxes, Array]]],
    vehicles: int,
    recall: float,
    precision: float,
) -> None:
    path = DATA / "models" / f"{model}.onnx"
    if not path.exists():
        pytest.skip("the detectors are not beside this checkout (shared/data/models)")
    detector = YoloDetector(path)
    judged = [(detector.detect(image), truth, regions) for image, truth, regions in images()]
    result = recall_precision(judged, 25.0)
    assert result[2] == vehicles
    assert result[0] >= recall - 0.03
    assert result[1] >= precision - 0.03
