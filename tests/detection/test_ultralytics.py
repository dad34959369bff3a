"""Agreement with Ultralytics: its own predictor and the kit give the same boxes for its exports.

The networks are built from Ultralytics' YAML files with random weights; their scores are shifted so that some
cells have a box. Without the extra [train] these tests are skipped.
"""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from vo_lib.detection import suppression
from vo_lib.detection.network_image import fit_letterbox, letterboxed
from vo_lib.detection.settings import DetectorConfig
from vo_lib.detection.yolo import YoloDetector
from vo_lib.errors import DataError
from vo_lib.geometry.boxes import Boxes

os.environ.setdefault("YOLO_AUTOINSTALL", "false")
pytest.importorskip("ultralytics", reason="Ultralytics belongs to the extra [train]")
pytest.importorskip("onnx", reason="onnx belongs to the extra [train]")
try:
    import torchvision
except (ImportError, RuntimeError) as error:  # of another build than PyTorch
    pytest.skip(f"Ultralytics' predictor needs torchvision: {error}", allow_module_level=True)
assert torchvision is not None
pytestmark = pytest.mark.filterwarnings("default")  # warnings of Ultralytics and PyTorch

SIZE = 320
SCORE, NMS = 0.25, 0.5
SAME_PLACE_PX, SAME_SCORE = 0.05, 1e-3
SPREAD = 1.0  # standard deviation of the logarithmic scores
CELLS_WITH_A_BOX = 0.02  # share of the scores that shall be above the threshold


@dataclass(frozen=True)
class Export:
    """A network of Ultralytics, the options of its export, and the layout that the kit shall see."""

    yaml: str
    layout: str
    options: dict[str, Any] = field(default_factory=dict)
    task: str = "detect"


EXPORTS = {
    "yolov5": Export("yolov5n", "yolov8"),
    "yolov8": Export("yolov8n", "yolov8"),
    "yolov8 dynamic": Export("yolov8n", "yolov8", {"dynamic": True}),
    "yolov8 simplified": Export("yolov8n", "yolov8", {"simplify": True}),
    "yolov8 with suppression": Export("yolov8n", "end2end", {"nms": True}),
    "yolov8 p2": Export("yolov8n-p2", "yolov8"),
    "yolov9": Export("yolov9t", "yolov8"),
    "yolo11": Export("yolo11n", "yolov8"),
    "yolo12": Export("yolo12n", "yolov8"),
    "yolov10": Export("yolov10n", "yolov8"),
    "yolov10 end to end": Export("yolov10n", "end2end", {"nms": False}),
    "yolo26": Export("yolo26n", "yolov8"),
    "yolo26 end to end": Export("yolo26n", "end2end", {"nms": False}),
    "yolo26 end to end dynamic": Export("yolo26n", "end2end", {"nms": False, "dynamic": True}),
    "rtdetr": Export("yolov8-rtdetr", "rtdetr"),
    "yolov8 segmentation": Export("yolov8n-seg", "yolov8", task="segment"),
    "yolo26 segmentation": Export("yolo26n-seg", "end2end", {"nms": False}, task="segment"),
}
REFUSED = {
    "yolov8n-pose": "is a pose model",
    "yolo26n-pose": "is a pose model",
    "yolov8n-obb": "is a model of oriented boxes",
    "yolov8n-cls": "is a classification model",
}


def images() -> list[NDArray[np.uint8]]:
    """Noise of several scales, in sizes that both programs give to the network as it is, or enlarged."""
    rng = np.random.default_rng(8)
    out = []
    for height, width in ((SIZE, SIZE), (200, SIZE), (SIZE, 200), (100, 160)):
        image = sum(
            cv2.resize(rng.normal(0, 40, (height // part, width // part, 3)), (width, height))
            for part in (4, 16, 50)
        )
        out.append(np.clip(np.asarray(image) + 110, 0, 255).astype(np.uint8))
    return out


def build(yaml: str, folder: Path) -> Any:
    """A network of Ultralytics with random weights whose scores exceed the threshold in some cells."""
    import torch
    from ultralytics import RTDETR, YOLO

    torch.manual_seed(5)
    network = (RTDETR if "rtdetr" in yaml else YOLO)(f"{yaml}.yaml")
    model = network.model
    pixels = torch.from_numpy(np.stack([square(image) for image in images()])).float() / 255
    with torch.no_grad():
        # Normalisation fits the images, as after a training; otherwise all cells would be nearly equal.
        model.eval()
        for layer in model.modules():
            if isinstance(layer, torch.nn.BatchNorm2d):
                layer.reset_running_stats()
                layer.momentum = None
                layer.train()
        model(pixels)
        model.eval()
        for last in last_layers(model.model[-1], "cv3", "dec_score_head"):
            shift(last, model, pixels, SPREAD)
            if (logits := output_of(last, model, pixels)) is not None:
                best = logits.amax(1 if logits.ndim == 4 else -1).flatten()
                last.bias += np.log(SCORE / (1 - SCORE)) - float(torch.quantile(best, 1 - CELLS_WITH_A_BOX))
        for last in last_layers(model.model[-1], "cv2"):
            shift(last, model, pixels, 0.3)
            last.bias += 2.0  # sides of boxes in cells, or their logarithmic probabilities
    file = folder / "random.pt"  # Ultralytics would download weights under a name that it knows
    network.save(file)
    return (RTDETR if "rtdetr" in yaml else YOLO)(str(file))


def square(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """The network's image (3, SIZE, SIZE) of an image."""
    height, width = image.shape[:2]
    placed = letterboxed(image, fit_letterbox(width, height, SIZE, SIZE))
    return np.asarray(placed[:, :, ::-1].transpose(2, 0, 1))


def last_layers(head: Any, *names: str) -> list[Any]:
    """The last layers of the branches of a head, those of the one-to-one head included."""
    branches = [
        branch
        for name in names
        for part in ("", "one2one_")
        for branch in getattr(head, part + name, None) or []
    ]
    return [branch[-1] if hasattr(branch, "__getitem__") else branch for branch in branches]


def shift(layer: Any, model: Any, pixels: Any, spread: float) -> None:
    """Scale a layer's output to this standard deviation; its bias becomes zero."""
    output = output_of(layer, model, pixels)
    if output is not None:
        layer.weight *= spread / float(output.std())
        layer.bias.zero_()


def output_of(layer: Any, model: Any, pixels: Any) -> Any:
    """The output of a layer for an image; None if the network does not use the layer."""
    found: list[Any] = []
    hook = layer.register_forward_hook(lambda _, __, output: found.append(output.clone()))
    model(pixels)
    hook.remove()
    return found[-1] if found else None


def exported(yaml: str, options: dict[str, Any], folder: Path) -> Path:
    options = {"imgsz": SIZE, "simplify": False, **options}
    return Path(build(yaml, folder).export(format="onnx", **options))


def their_boxes(model: Path, image: NDArray[np.uint8], task: str, rtdetr: bool) -> Boxes:
    """The boxes of Ultralytics' predictor, clipped to the image."""
    from ultralytics import RTDETR, YOLO

    network = RTDETR(str(model)) if rtdetr else YOLO(str(model), task=task)
    options = {"imgsz": SIZE, "conf": SCORE, "iou": NMS, "max_det": 1000, "device": "cpu", "verbose": False}
    found = network.predict(image, **options)[0].boxes
    height, width = image.shape[:2]
    xyxy = np.clip(found.xyxy.numpy().astype(np.float64), 0, [width, height, width, height]) - 0.5
    return Boxes(xyxy, found.cls.numpy().astype(np.int64), found.conf.numpy().astype(np.float64))


def with_area(boxes: Boxes) -> Boxes:
    """The boxes that have an area."""
    return boxes[np.asarray((boxes.xyxy[:, 2:] > boxes.xyxy[:, :2]).all(axis=1))]


def has_counterpart(boxes: Boxes, others: Boxes) -> NDArray[np.bool_]:
    """Mask of the boxes that have a box of the same class, place and score among the others."""
    near = np.abs(boxes.xyxy[:, None] - others.xyxy).max(axis=2) < SAME_PLACE_PX
    near &= boxes.class_id[:, None] == others.class_id
    near &= np.abs(boxes.score[:, None] - others.score) < SAME_SCORE
    return np.asarray(near.any(axis=1))


@pytest.fixture(autouse=True)
def own_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Ultralytics writes its settings and files here."""
    monkeypatch.setenv("YOLO_CONFIG_DIR", str(tmp_path))
    monkeypatch.chdir(tmp_path)
    # Ultralytics does not compare boxes of different classes.
    monkeypatch.setattr(suppression, "ONE_OBJECT_IOU", 1.1)


@pytest.mark.parametrize("kind", EXPORTS)
def test_boxes_are_those_of_ultralytics(kind: str, tmp_path: Path) -> None:
    export = EXPORTS[kind]
    model = exported(export.yaml, export.options, tmp_path)
    detector = YoloDetector(model, DetectorConfig(size=SIZE, score=SCORE, nms=NMS))
    assert detector.layout_name == export.layout
    assert detector.names is not None
    total = 0
    for image in images():
        # Boxes of a network without training may be in the border, or have exchanged corners.
        ours = with_area(detector.detect(image))
        theirs = with_area(their_boxes(model, image, export.task, export.layout == "rtdetr"))
        # At the threshold, the last digit of a score decides.
        clear = theirs[theirs.score > SCORE + SAME_SCORE]
        assert has_counterpart(clear, ours).all()
        if export.task == "detect":  # of a segmentation model, Ultralytics drops boxes with an empty mask
            assert has_counterpart(ours[ours.score > SCORE + SAME_SCORE], theirs).all()
        total += len(clear)
    assert total >= 8


@pytest.mark.parametrize("yaml", REFUSED)
def test_models_of_other_tasks_are_refused(yaml: str, tmp_path: Path) -> None:
    from ultralytics import YOLO

    model = YOLO(f"{yaml}.yaml").export(format="onnx", imgsz=64, simplify=False)
    with pytest.raises(DataError, match=REFUSED[yaml]):
        YoloDetector(model)
