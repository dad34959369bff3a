"""The layouts of detectors: networks with known boxes, of every kind that people export, give these boxes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from tiny_onnx import FLOAT, FLOAT16, INT64, UINT8, node, write_network

from vo_lib.detection.settings import DetectorConfig
from vo_lib.detection.yolo import YoloDetector
from vo_lib.errors import DataError
from vo_lib.geometry.boxes import Boxes
from vo_lib.settings import declared

Table = NDArray[np.float64]
Outputs = dict[str, NDArray[Any]]

NAMES = ("person", "car", "truck")
# Boxes in shares of the image: left, top, right, bottom; best first, as detectors return them.
TRUTH = np.array([[0.55, 0.40, 0.60, 0.70], [0.08, 0.48, 0.24, 0.80], [0.56, 0.45, 0.63, 0.61]])
CLASSES = np.array([0, 1, 2])
SCORES = np.array([0.95, 0.9, 0.8])
ROWS = (100, 137, 174)  # of the boxes in a grid's table
# height and width: KITTI's, a camera's, a phone held upright, smaller than the network
IMAGES = ((375, 1242), (480, 640), (1280, 720), (100, 150))
NETS = ((640, 640), (384, 640))  # height and width of the network's image
STRIDES = (8, 16, 32)


def cells(net: tuple[int, int], strides: tuple[int, ...] = STRIDES) -> int:
    return sum((net[0] // stride) * (net[1] // stride) for stride in strides)


def in_network(image: tuple[int, int], net: tuple[int, int], placement: str) -> Table:
    """The true boxes (3, 4), corners, in pixels of the network's image."""
    size = np.array([image[1], image[0]])
    pixels = TRUTH * [*size, *size]
    if placement == "image":
        return np.asarray(pixels)
    if placement == "stretched":
        return np.asarray(TRUTH * [net[1], net[0], net[1], net[0]])
    scale = min(net[1] / size[0], net[0] / size[1])
    border = np.array([net[1] - round(size[0] * scale), net[0] - round(size[1] * scale)]) // 2
    shift = border if placement == "centred" else np.zeros(2)
    return np.asarray(pixels * scale + [*shift, *shift])


def centres(corners: Table) -> Table:
    """Centre and size (N, 4) of boxes."""
    return np.hstack([(corners[:, :2] + corners[:, 2:]) / 2, corners[:, 2:] - corners[:, :2]])


def scores_of_classes(count: int = 3) -> Table:
    scores = np.zeros((3, count))
    scores[np.arange(3), CLASSES] = SCORES
    return scores


def table(count: int, rows: Table, background: float | Table = 0.0) -> Table:
    """A table (count, columns) with the rows of the three boxes at ROWS."""
    out = np.zeros((count, rows.shape[1])) + background
    out[list(ROWS)] = rows
    return out


def labelled(corners: Table) -> Table:
    """Rows x0 y0 x1 y1 score class."""
    return np.column_stack([corners, SCORES, CLASSES])


def first(rows: Table, count: int = 300) -> Table:
    """A table (count, columns) with rows in front, otherwise 0."""
    out = np.zeros((count, rows.shape[1]))
    out[: len(rows)] = rows
    return out


# Each builder makes the outputs from the corners in the network's image, and the size of this image.
def yolov8(corners: Table, net: tuple[int, int]) -> Outputs:
    return {"output0": table(cells(net), np.hstack([centres(corners), scores_of_classes()])).T[None]}


def yolov8_rows(corners: Table, net: tuple[int, int]) -> Outputs:
    return {"output0": yolov8(corners, net)["output0"].transpose(0, 2, 1)}


def yolov8_shares(corners: Table, net: tuple[int, int]) -> Outputs:
    return yolov8(corners / [net[1], net[0], net[1], net[0]], net)


def yolov8_p2(corners: Table, net: tuple[int, int]) -> Outputs:
    rows = np.hstack([centres(corners), scores_of_classes()])
    return {"output0": table(cells(net, (4, *STRIDES)), rows).T[None]}


def mask_prototypes(net: tuple[int, int]) -> Table:
    """The second output of a segmentation: 32 masks of a quarter of the image's size."""
    return np.zeros((1, 32, net[0] // 4, net[1] // 4))


def yolov8_segmentation(corners: Table, net: tuple[int, int]) -> Outputs:
    """Mask coefficients are large in every row, as in a real network."""
    masks = np.random.default_rng(3).normal(0, 2, (cells(net), 32))
    plain = yolov8(corners, net)["output0"][0]
    return {"output0": np.vstack([plain, masks.T])[None], "output1": mask_prototypes(net)}


def with_objectness(corners: Table) -> Table:
    return np.hstack([centres(corners), np.full((3, 1), 0.95), scores_of_classes() / 0.95])


def yolov5(corners: Table, net: tuple[int, int]) -> Outputs:
    return {"output0": table(3 * cells(net), with_objectness(corners))[None]}


def yolov5_with_maps(corners: Table, net: tuple[int, int]) -> Outputs:
    maps = {f"map{s}": np.ones((1, 3, net[0] // s, net[1] // s, 8)) for s in STRIDES}
    return {"output": yolov5(corners, net)["output0"], **maps}


def yolov5_segmentation(corners: Table, net: tuple[int, int]) -> Outputs:
    masks = np.random.default_rng(3).normal(0, 2, (3 * cells(net), 32))
    plain = yolov5(corners, net)["output0"][0]
    return {"output0": np.hstack([plain, masks])[None], "output1": mask_prototypes(net)}


def yolov6(corners: Table, net: tuple[int, int]) -> Outputs:
    rows = np.hstack([centres(corners), np.ones((3, 1)), scores_of_classes()])
    background = np.array([50.0, 60, 20, 20, 1, 0, 0, 0])
    return {"outputs": table(cells(net), rows, background)[None]}


def yolox_decoded(corners: Table, net: tuple[int, int]) -> Outputs:
    return {
        "output": table(cells(net), with_objectness(corners), np.array([10.0, 10, 5, 5, 0, 0, 0, 0]))[None]
    }


def yolox_raw(corners: Table, net: tuple[int, int]) -> Outputs:
    rows = with_objectness(corners)
    # ROWS are in the first grid, of 8 px.
    columns = net[1] // 8
    cell = np.array([[row % columns, row // columns] for row in ROWS])
    rows[:, :2] = rows[:, :2] / 8 - cell
    rows[:, 2:4] = np.log(rows[:, 2:4] / 8)
    return {"output": table(cells(net), rows)[None]}


def end2end(corners: Table, net: tuple[int, int]) -> Outputs:
    return {"output0": first(labelled(corners))[None]}


def end2end_shares(corners: Table, net: tuple[int, int]) -> Outputs:
    return end2end(corners / [net[1], net[0], net[1], net[0]], net)


def end2end_segmentation(corners: Table, net: tuple[int, int]) -> Outputs:
    masks = np.random.default_rng(3).normal(0, 2, (300, 32))
    return {"output0": np.hstack([first(labelled(corners)), masks])[None], "output1": mask_prototypes(net)}


def class_before_score(corners: Table, net: tuple[int, int]) -> Outputs:
    return {"output0": end2end(corners, net)["output0"][:, :, [0, 1, 2, 3, 5, 4]]}


def deepstream(corners: Table, net: tuple[int, int]) -> Outputs:
    return {"output": table(cells(net), labelled(corners))[None]}


def deepstream_v5(corners: Table, net: tuple[int, int]) -> Outputs:
    return {"output": table(3 * cells(net), labelled(corners))[None]}


def deepstream_lists(corners: Table, net: tuple[int, int]) -> Outputs:
    count = cells(net)
    return {
        "boxes": table(count, centres(corners))[None],
        "scores": table(count, SCORES[:, None])[None],
        "classes": table(count, CLASSES[:, None])[None],
    }


def rtdetr(corners: Table, net: tuple[int, int]) -> Outputs:
    shares = centres(corners / [net[1], net[0], net[1], net[0]])
    return {"output0": first(np.hstack([shares, scores_of_classes()]))[None]}


def rtdetr_labelled(corners: Table, net: tuple[int, int]) -> Outputs:
    shares = centres(corners / [net[1], net[0], net[1], net[0]])
    return {"output0": first(labelled(shares))[None]}


def rtdetr_original(corners: Table, net: tuple[int, int]) -> Outputs:
    return {
        "labels": first(CLASSES[:, None])[None, :, 0].astype(np.int64),
        "boxes": first(corners)[None],
        "scores": first(SCORES[:, None])[None, :, 0],
    }


def yolov7_end2end(corners: Table, net: tuple[int, int]) -> Outputs:
    return {"output": np.column_stack([np.zeros(3), corners, CLASSES, SCORES])}


def nas_flat(corners: Table, net: tuple[int, int]) -> Outputs:
    return {"graph2_flat_predictions": np.column_stack([np.zeros(3), corners, SCORES, CLASSES])}


def scores_boxes(corners: Table, net: tuple[int, int]) -> Outputs:
    count = cells(net)
    return {"scores": table(count, scores_of_classes())[None], "boxes": table(count, corners)[None]}


def boxes_scores(corners: Table, net: tuple[int, int]) -> Outputs:
    return dict(reversed(scores_boxes(corners, net).items()))


def unnamed_centres_scores(corners: Table, net: tuple[int, int]) -> Outputs:
    count = cells(net)
    return {"913": table(count, centres(corners))[None], "904": table(count, scores_of_classes())[None]}


def paddle(corners: Table, net: tuple[int, int]) -> Outputs:
    """PP-YOLOE: the scores are a table with a row for each class."""
    count = cells(net)
    return {"boxes": table(count, corners)[None], "scores": table(count, scores_of_classes()).T[None]}


def yolov4(corners: Table, net: tuple[int, int]) -> Outputs:
    count = 3 * cells(net)
    shares = corners / [net[1], net[0], net[1], net[0]]
    return {"boxes": table(count, shares)[None, :, None], "confs": table(count, scores_of_classes())[None]}


def four_classes(corners: Table, net: tuple[int, int]) -> Outputs:
    """Scores of four classes have as many columns as the boxes."""
    count = cells(net)
    return {"a": table(count, scores_of_classes(4))[None], "b": table(count, corners)[None]}


def without_batch(corners: Table, net: tuple[int, int]) -> Outputs:
    """YOLOv3 for phones: two tables, boxes as shares of the image."""
    count = 3 * cells(net)
    shares = centres(corners / [net[1], net[0], net[1], net[0]])
    return {"325": table(count, scores_of_classes()), "328": table(count, shares)}


def nas_batch(corners: Table, net: tuple[int, int]) -> Outputs:
    """The rows behind the number of boxes are left over from earlier images."""
    left_over = np.tile([5.0, 6, 70, 80], (100, 1))
    left_over[:3] = corners
    return {
        "num_predictions": np.array([[3]]),
        "pred_boxes": left_over[None],
        "pred_scores": np.concatenate([SCORES, np.full(97, 0.99)])[None],
        "pred_classes": np.concatenate([CLASSES, np.zeros(97, np.int64)])[None],
    }


def ai_hub(corners: Table, net: tuple[int, int]) -> Outputs:
    """Qualcomm's exports for phones: all cells, with the best class of each as a byte."""
    count = cells(net)
    return {
        "boxes": table(count, corners)[None],
        "scores": table(count, SCORES[:, None])[None, :, 0],
        "class_idx": table(count, CLASSES[:, None])[None, :, 0].astype(np.uint8),
    }


def one_class(corners: Table, net: tuple[int, int]) -> Outputs:
    """Boxes and the scores of one class; the other two boxes are of no class."""
    count = cells(net)
    return {"boxes": table(count, corners)[None], "scores": table(count, SCORES[:, None])[None]}


@dataclass(frozen=True)
class Export:
    """A kind of export: its outputs, the layout that the kit shall see, the place of the image, the rest."""

    build: Callable[[Table, tuple[int, int]], Outputs]
    layout: str
    placement: str = "centred"
    metadata: dict[str, str] = field(default_factory=dict)
    names: tuple[str, ...] | None = NAMES
    image_kind: int = FLOAT
    output_type: type = np.float32
    sizes: bool = False
    dynamic: bool = False


EXPORTS = {
    "yolov8": Export(yolov8, "yolov8"),
    "yolov8 in rows": Export(yolov8_rows, "yolov8"),
    "yolov8 as shares": Export(yolov8_shares, "yolov8"),
    "yolov8 p2": Export(yolov8_p2, "yolov8"),
    "yolov8 without names": Export(yolov8, "yolov8", names=None),
    "yolov8 of 16 bits": Export(yolov8, "yolov8", image_kind=FLOAT16, output_type=np.float16),
    "yolov8 of bytes": Export(yolov8, "yolov8", image_kind=UINT8),
    "yolov8 of every size": Export(yolov8, "yolov8", dynamic=True),
    "segmentation": Export(yolov8_segmentation, "yolov8", metadata={"task": "segment"}),
    "segmentation without a word": Export(yolov8_segmentation, "yolov8", names=None),
    "yolov5": Export(yolov5, "yolov5"),
    "yolov5 without names": Export(yolov5, "yolov5", names=None),
    "yolov5 with maps": Export(yolov5_with_maps, "yolov5"),
    "yolov5 segmentation": Export(yolov5_segmentation, "yolov5", names=None),
    "yolov6": Export(yolov6, "yolov6", names=None),
    "yolox": Export(yolox_raw, "yolox", "corner", names=None),
    "yolox with names": Export(yolox_raw, "yolox", "corner"),
    "yolox decoded": Export(yolox_decoded, "yolox-decoded", "corner"),
    "end to end": Export(end2end, "end2end", metadata={"end2end": "True"}),
    "end to end without a word": Export(end2end, "end2end", names=None),
    "end to end as shares": Export(end2end_shares, "end2end"),
    "end to end of 16 bits": Export(end2end, "end2end", image_kind=FLOAT16, output_type=np.float16),
    "with suppression": Export(end2end, "end2end", metadata={"args": "{'nms': True, 'batch': 1}"}),
    "end to end segmentation": Export(
        end2end_segmentation, "end2end", metadata={"task": "segment", "end2end": "True"}
    ),
    "class before score": Export(class_before_score, "end2end", names=None),
    "deepstream": Export(deepstream, "deepstream", names=None),
    "deepstream of v5": Export(deepstream_v5, "deepstream"),
    "deepstream in lists": Export(deepstream_lists, "boxes-scores-classes", names=None),
    "rtdetr": Export(rtdetr, "rtdetr", "stretched"),
    "rtdetr with classes": Export(rtdetr_labelled, "rtdetr", "stretched", {"head": "RTDETRDecoder"}),
    "rtdetr with classes, silent": Export(rtdetr_labelled, "rtdetr", "stretched", names=None),
    "rtdetr, original": Export(rtdetr_original, "boxes-scores-classes", "image", names=None, sizes=True),
    "yolov7 end to end": Export(yolov7_end2end, "yolov7-end2end", names=None),
    "yolo-nas flat": Export(nas_flat, "yolov7-end2end", image_kind=UINT8, names=None),
    "yolo-nas": Export(boxes_scores, "boxes-scores", names=None),
    "scores, then boxes": Export(scores_boxes, "boxes-scores"),
    "unnamed outputs": Export(unnamed_centres_scores, "boxes-scores"),
    "pp-yoloe": Export(paddle, "boxes-scores"),
    "yolov4": Export(yolov4, "boxes-scores", names=None),
    "four classes": Export(four_classes, "boxes-scores", names=None),
    "without batch": Export(without_batch, "boxes-scores", names=None),
    "ai hub": Export(ai_hub, "boxes-scores-classes", names=None),
    "yolo-nas batch": Export(nas_batch, "boxes-scores-classes", image_kind=UINT8, names=None),
}


def written(path: Path, export: Export, image: tuple[int, int], net: tuple[int, int]) -> Path:
    """The ONNX file of an export whose boxes are right for an image of this size."""
    outputs = {
        name: values.astype(export.output_type) if values.dtype == np.float64 else values
        for name, values in export.build(in_network(image, net, export.placement), net).items()
    }
    shape = (1, 3, "height", "width") if export.dynamic else (1, 3, *net)
    inputs: dict[str, Any] = {"images": (shape, export.image_kind)}
    if export.sizes:
        inputs["orig_target_sizes"] = ((1, 2), INT64)
    metadata = dict(export.metadata)
    if export.names is not None:
        metadata["names"] = str(dict(enumerate(export.names)))
    return write_network(path, outputs, inputs, metadata)


def assert_true_boxes(found: Boxes, image: tuple[int, int], tolerance: float = 0.02) -> None:
    assert found.class_id.tolist() == CLASSES.tolist()
    assert found.score == pytest.approx(SCORES, rel=1e-3)
    expected = TRUTH * [image[1], image[0], image[1], image[0]] - 0.5
    np.testing.assert_allclose(found.xyxy, expected, atol=tolerance)


@pytest.mark.parametrize("net", NETS)
@pytest.mark.parametrize("image", IMAGES)
@pytest.mark.parametrize("kind", EXPORTS)
def test_every_kind_of_export_gives_the_boxes(
    kind: str, image: tuple[int, int], net: tuple[int, int], tmp_path: Path
) -> None:
    export = EXPORTS[kind]
    if export.dynamic:
        net = (640, 640)
        image = (512, 512)
    detector = YoloDetector(written(tmp_path / "m.onnx", export, image, net))
    assert detector.layout_name == export.layout
    assert detector.names == export.names
    tolerance = 0.5 * image[1] / 640 + 0.5 if export.output_type == np.float16 else 0.02
    assert_true_boxes(detector.detect(np.zeros(image, np.uint8)), image, tolerance)
    assert_true_boxes(detector.detect(np.zeros((*image, 3), np.uint8)), image, tolerance)


@pytest.mark.parametrize("names", [None, ("car",)])
def test_boxes_and_scores_of_one_class(names: tuple[str, ...] | None, tmp_path: Path) -> None:
    path = written(
        tmp_path / "m.onnx", Export(one_class, "boxes-scores", names=names), (375, 1242), (640, 640)
    )
    found = YoloDetector(path).detect(np.zeros((375, 1242), np.uint8))
    assert found.class_id.tolist() == [0, 0, 0]
    np.testing.assert_allclose(found.xyxy, TRUTH * [1242, 375, 1242, 375] - 0.5, atol=0.02)


def test_only_grids_are_suppressed(tmp_path: Path) -> None:
    # Two cars in a row, as one sees them from behind: IoU 0.67.
    corners = np.array([[100.0, 100, 200, 200], [120, 100, 220, 200]])
    rows = np.column_stack([corners, [0.9, 0.8], [1, 1]])
    for outputs, boxes in (
        ({"output": np.vstack([rows, np.zeros((cells((640, 640)) - 2, 6))])[None]}, 1),
        ({"output": first(rows)[None]}, 2),
    ):
        typed = {name: values.astype(np.float32) for name, values in outputs.items()}
        path = write_network(tmp_path / "m.onnx", typed, {"images": ((1, 3, 640, 640), FLOAT)})
        assert len(YoloDetector(path).detect(np.zeros((640, 640), np.uint8))) == boxes


def test_boxes_of_unwanted_classes_suppress_nothing(tmp_path: Path) -> None:
    """A person in front of a car has almost the same box, and the better score."""
    corners = np.array([[100.0, 100, 200, 200], [100, 100, 201, 200]])
    rows = np.hstack([centres(corners), [[0.9, 0, 0], [0, 0.8, 0]]])
    grid = np.zeros((cells((640, 640)), 7), np.float32)
    grid[:2] = rows
    metadata = {"names": str(list(NAMES))}
    inputs = {"images": ((1, 3, 640, 640), FLOAT)}
    detector = YoloDetector(write_network(tmp_path / "m.onnx", {"output0": grid.T[None]}, inputs, metadata))
    image = np.zeros((640, 640), np.uint8)
    assert detector.detect(image).class_id.tolist() == [0]
    assert detector.detect(image, np.array([False, True, True])).class_id.tolist() == [1]
    # A mask that ends before the last class: the classes behind it are not wanted.
    assert detector.detect(image, np.array([False, True])).class_id.tolist() == [1]
    assert len(detector.detect(image, np.zeros(200, np.bool_))) == 0


@pytest.mark.parametrize("height_first", [False, True])
def test_both_orders_of_the_image_size_are_served(height_first: bool, tmp_path: Path) -> None:
    """A network that scales its boxes by the size of the image, as RT-DETR does; height or width is first."""
    outputs = rtdetr_original(TRUTH, (640, 640))
    typed = {name: v.astype(np.float32) if v.dtype == np.float64 else v for name, v in outputs.items()}
    order = np.array([1, 0, 1, 0] if height_first else [0, 1, 0, 1], np.int64)
    nodes = [
        node("Cast", ["orig_target_sizes"], "sizes", to=FLOAT),
        node("Gather", ["sizes", "order"], "corners", axis=1),
        node("Mul", ["boxes_constant", "corners"], "boxes"),
    ]
    inputs: dict[str, Any] = {
        "images": ((1, 3, 640, 640), FLOAT),
        "orig_target_sizes": ((1, 2), INT64),
    }
    path = write_network(tmp_path / "m.onnx", typed, inputs, nodes=nodes, constants={"order": order})
    assert_true_boxes(YoloDetector(path).detect(np.zeros((375, 1242), np.uint8)), (375, 1242))


GARBAGE = np.array([900.0, 800, -3, 2, 0.001, 0.5])  # no corners, no share, no class


@pytest.mark.parametrize(
    ("kind", "garbage"),
    [
        ("end to end without a word", GARBAGE),
        ("end to end without a word", np.array([50.0, 60, 10, 10, 0.0, 1])),  # a centre and a size
        ("end to end as shares", GARBAGE),
        ("class before score", GARBAGE[[0, 1, 2, 3, 5, 4]]),
        ("class before score", np.array([900.0, 800, -3, 2, -2, 0.0])),
        ("rtdetr with classes, silent", np.array([0.0, 0, 700, 800, 0.0, 0.5])),  # corners
        ("rtdetr with classes", GARBAGE),
    ],
)
def test_rows_without_a_score_decide_nothing(kind: str, garbage: Table, tmp_path: Path) -> None:
    export = EXPORTS[kind]

    def build(boxes: Table, net: tuple[int, int]) -> Outputs:
        (name, table), *_ = export.build(boxes, net).items()
        table[0, 3:] = garbage
        return {name: table}

    detector = YoloDetector(
        written(tmp_path / "m.onnx", replace(export, build=build), (375, 1242), (640, 640))
    )
    assert detector.layout_name == export.layout
    assert_true_boxes(detector.detect(np.zeros((375, 1242), np.uint8)), (375, 1242))


@pytest.mark.parametrize("scores", [(0.95, 0.006, 0.002), (0.009, 0.006, 0.002)])
@pytest.mark.parametrize("kind", EXPORTS)
def test_boxes_with_low_scores_are_found_if_asked_for(
    kind: str, scores: tuple[float, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also if no row of the outputs has a higher score."""
    monkeypatch.setitem(globals(), "SCORES", np.array(scores))
    export = EXPORTS[kind]
    net = (640, 640)
    image = (512, 512)
    lowest = next(item.low for item in declared(DetectorConfig) if item.name == "score")
    assert lowest is not None
    path = written(tmp_path / "m.onnx", export, image, net)
    detector = YoloDetector(path, DetectorConfig(score=lowest))
    assert detector.layout_name == export.layout
    tolerance = 1.0 if export.output_type == np.float16 else 0.02
    assert_true_boxes(detector.detect(np.zeros(image, np.uint8)), image, tolerance)


@pytest.mark.parametrize(
    "kind", ["rtdetr, original", "rtdetr with classes", "end to end", "yolov7 end to end", "ai hub"]
)
def test_a_class_beyond_the_names_is_refused(kind: str, tmp_path: Path) -> None:
    """Also where the network already runs while it is loaded."""
    export = replace(EXPORTS[kind], names=("car",))
    path = written(tmp_path / "m.onnx", export, (375, 1242), (640, 640))
    with pytest.raises(DataError, match="a box has class 2, but the model has 1 classes") as caught:
        YoloDetector(path).detect(np.zeros((375, 1242), np.uint8))
    assert str(caught.value).startswith(f"{path}: ")


@pytest.mark.parametrize("count", [-1.0, np.nan])
def test_an_impossible_number_of_boxes_is_refused(count: float, tmp_path: Path) -> None:
    def build(boxes: Table, net: tuple[int, int]) -> Outputs:
        return nas_batch(boxes, net) | {"num_predictions": np.array([[count]])}

    export = replace(EXPORTS["yolo-nas batch"], build=build)
    path = written(tmp_path / "m.onnx", export, (375, 1242), (640, 640))
    with pytest.raises(DataError, match="expected the number of boxes in an output, found"):
        YoloDetector(path).detect(np.zeros((375, 1242), np.uint8))


def test_a_network_without_boxes_gives_none(tmp_path: Path) -> None:
    inputs = {"images": ((1, 3, 640, 640), FLOAT)}
    for name, shape in (("output", (0, 7)), ("output0", (1, 300, 6)), ("output0", (1, 0, 6)), ("o", (0, 6))):
        detector = YoloDetector(
            write_network(tmp_path / "m.onnx", {name: np.zeros(shape, np.float32)}, inputs)
        )
        assert len(detector.detect(np.zeros((375, 1242), np.uint8))) == 0


GRID = (1, 8400)
REFUSED: dict[str, tuple[dict[str, Any], dict[str, str], str]] = {
    "pose": ({"output0": (1, 56, 8400)}, {"task": "pose", "names": "{0: 'person'}"}, "is a pose model"),
    "obb": ({"output0": (1, 20, 8400)}, {"task": "obb"}, "is a model of oriented boxes (OBB)"),
    "depth": ({"output0": (1, 640, 640)}, {"task": "depth"}, "is a model of depths"),
    "another task": ({"output0": (1, 56, 8400)}, {"task": "track"}, "is a model for the task 'track'"),
    "pose of one class": (
        {"output0": (1, 56, 8400)},
        {"names": "{0: 'person'}"},
        "output0 [1, 56, 8400]: expected 4 + classes columns; the metadata names 1 classes: "
        "keypoints of a pose model?",
    ),
    "obb of two classes": (
        {"output0": (1, 7, 8400)},
        {"names": "['a', 'b']"},
        ": an angle of oriented boxes?",
    ),
    "masks without maps": (
        {"output0": (1, 38, 8400)},
        {"names": "['a', 'b']"},
        ": the coefficients of masks",
    ),
    "pose end to end": ({"output0": (1, 300, 57)}, {"names": "['person']"}, "keypoints of a pose model?"),
    "obb end to end": ({"output0": (1, 300, 7)}, {"names": "['plane']"}, "an angle of oriented boxes?"),
    "more names": ({"output0": (1, 84, 8400)}, {"names": "['car', 'bus']"}, "the metadata names 2 classes"),
    "fewer names": (
        {"scores": (1, 8400, 2), "boxes": (1, 8400, 4)},
        {"names": "['car']"},
        "2 classes, but its",
    ),
    "raw maps": (
        {f"m{k}": (1, 255, k, k) for k in (80, 40, 20)},
        {},
        "these look like the raw maps of a network",
    ),
    "raw maps in rows": ({f"m{k}": (1, 3, k, k, 85) for k in (80, 40, 20)}, {}, "raw maps of a network"),
    "classification": ({"output0": (1, 1000)}, {}, "output0 [1, 1000]: expected 6 columns"),
    "other grid": (
        {"output0": (1, 84, 5000)},
        {},
        "its rows fit no grid of cells; expected 8400 or 25200 for",
    ),
    "two heads": (
        {"output0": (1, 84, 8400), "output1": (1, 84, 8400)},
        {},
        "two heads, as of YOLOv9 with its auxiliary",
    ),
    "two tables": (
        {"output0": (1, 84, 8400), "output1": (1, 84, 2100)},
        {},
        "none, or more than one, of the outputs looks like boxes",
    ),
    "mmdetection": (
        {"dets": (1, 100, 5), "labels": (1, 100)},
        {},
        "as of MMDetection, whose networks expect images with their mean taken out",
    ),
    "ssd": ({"detections": (1, 1, 200, 7)}, {}, "unknown layout of the outputs detections [1, 1, 200, 7]"),
    "indices": (
        {"boxes": (1, 2535, 4), "scores": (1, 80, 2535), "indices": (1, 3)},
        {},
        "expected one output of boxes and one of scores, or boxes, scores and classes",
    ),
}


@pytest.mark.parametrize("kind", REFUSED)
def test_other_models_are_refused_in_one_line(kind: str, tmp_path: Path) -> None:
    shapes, metadata, words = REFUSED[kind]
    outputs = {name: np.zeros(shape, np.float32) for name, shape in shapes.items()}
    inputs = {"images": ((1, 3, 640, 640), FLOAT)}
    path = write_network(tmp_path / "m.onnx", outputs, inputs, metadata)
    with pytest.raises(DataError) as caught:
        YoloDetector(path)
    text = str(caught.value)
    assert text.startswith(f"{path}: ")
    assert words in text
    assert "a model that works: yolo export model=best.pt format=onnx" in text
    assert "\n" not in text


def test_values_that_are_no_scores_are_refused(tmp_path: Path) -> None:
    """Keypoints without a word in the metadata, and networks before their last step."""
    inputs = {"images": ((1, 3, 640, 640), FLOAT)}
    pixels = np.full((1, 56, 8400), 300, np.float32)
    before_sigmoid = np.full((1, 8400, 85), -6, np.float32)
    boxes = np.zeros((1, 300, 4), np.float32)
    for outputs, words in (
        ({"output0": pixels}, "not scores from 0 to 1: keypoints, an angle"),
        ({"output": before_sigmoid}, "not scores from 0 to 1"),
        ({"boxes": np.full((1, 8400, 4), 300, np.float32)}, "4 columns are too few for a box and its score"),
        ({"dets": boxes, "labels": np.full((1, 300, 91), -4, np.float32)}, "before the last step (sigmoid)?"),
        (
            {"output0": np.tile(np.array([9, 9, 50, 60, 0.7, 0.2], np.float32), (1, 300, 1))},
            "x0, y0, x1, y1, score, class",
        ),
    ):
        path = write_network(tmp_path / "m.onnx", outputs, inputs)
        with pytest.raises(DataError, match=r"unknown layout") as caught:
            YoloDetector(path)
        assert words in str(caught.value)


def test_a_table_that_fits_two_layouts_is_refused(tmp_path: Path) -> None:
    answer = np.zeros((1, 8400, 7), np.float32)
    answer[0, 100] = 100, 200, 50, 40, 0.9, 0, 0
    path = write_network(tmp_path / "m.onnx", {"output0": answer}, {"images": ((1, 3, 640, 640), FLOAT)})
    with pytest.raises(DataError, match="may be YOLOX with 2 classes or YOLOv8 with 3: export YOLOX without"):
        YoloDetector(path)


def test_results_that_cannot_be_boxes_are_refused(tmp_path: Path) -> None:
    """The first image tells, where a black one did not."""
    inputs = {"images": ((1, 3, 640, 640), FLOAT)}
    metadata = {"names": str(list(NAMES))}
    image = np.zeros((375, 1242), np.uint8)
    for rows, words in (
        (np.full((300, 6), np.nan), "is not a number for any box: if it calculates with 16 bits"),
        (first(labelled(TRUTH * 64000)), "3 of 3 boxes are outside the image: the output, taken as end2end"),
        (first(np.add(labelled(TRUTH * 640), [0, 0, 0, 0, 0, 5])), "a box has class 7, but the model has 3"),
        (first(np.add(labelled(TRUTH * 640), [0, 0, 0, 0, 0, np.inf])), "class inf, but the model has 3"),
    ):
        outputs = {"output0": rows.astype(np.float32)[None]}
        described = {**metadata, "end2end": "True"}
        detector = YoloDetector(write_network(tmp_path / "m.onnx", outputs, inputs, described))
        with pytest.raises(DataError) as caught:
            detector.detect(image)
        assert words in str(caught.value)


def test_inputs_that_the_kit_cannot_fill_are_refused(tmp_path: Path) -> None:
    outputs = {"output0": np.zeros((1, 84, 8400), np.float32)}
    image = ((1, 3, 640, 640), FLOAT)
    for inputs, words in (
        ({"images": ((1, 640, 640, 3), FLOAT)}, "found [1, 640, 640, 3]: the order of TensorFlow"),
        ({"images": ((8, 3, 640, 640), FLOAT)}, "found [8, 3, 640, 640]: export it with batch=1"),
        (
            {"images": ((1, 1, 640, 640), FLOAT)},
            "expected one input [1, 3, height, width], found [1, 1, 640, 640]",
        ),
        ({"images": ((1, 3, 640, 640), INT64)}, "expected an input of floating-point numbers"),
        (
            {"image": image, "scale_factor": ((1, 2), FLOAT)},
            "found further ones: scale_factor; export the model",
        ),
    ):
        path = write_network(tmp_path / "m.onnx", outputs, inputs)
        with pytest.raises(DataError) as caught:
            YoloDetector(path)
        assert words in str(caught.value)
