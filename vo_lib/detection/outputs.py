"""Which network is this? The layout of a detector's outputs, told by their number, names, shapes and values.

| layout | outputs | a row |
|---|---|---|
| YOLOv8, v9, v11, v12; v10, v26 without selection | [1, 4 + C, N] or [1, N, 4 + C] | centre, size, scores |
| YOLOv5, v7 | [1, 3N, 5 + C] | centre, size, objectness, scores |
| YOLOv6, YOLOX | [1, N, 5 + C] | the same; YOLOX also before decoding |
| end to end: YOLOv10, v26, `nms=True` | [1, K, 6] | corners, score, class |
| DeepStream | [1, N, 6] or [1, 3N, 6] | the same, before suppression |
| YOLOv6, v7, v9 end to end; YOLO-NAS, flat | [K, 7] | image, corners, class, score (or score, class) |
| RT-DETR of Ultralytics | [1, K, 4 + C] or [1, K, 6] | centre, size, then scores or score, class |
| YOLO-NAS, PP-YOLOE, YOLOv4, … | [1, N, 4] and [1, N, C] | one output for the boxes, one for the scores |
| RT-DETR, D-FINE; YOLO-NAS, TensorRT's form | [1, K, 4], [1, K], [1, K] | boxes, scores, classes |

N is the number of cells in the network's grids, C the number of classes, and K the number of boxes that the
network has selected itself. RT-DETR's boxes are shares of the image; those of other networks may be, too. A
segmentation model has further columns, the coefficients of its masks, and a second output with as many maps.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..data.class_names import COCO
from ..geometry.types import Array
from .metadata import Metadata
from .network_image import STRIDES, yolox_cells
from .readers import (
    LARGEST_SHARE,
    NO_OBJECT,
    BoxForm,
    ClassColumns,
    LabelColumn,
    Reader,
    SeparateOutputs,
    UnusableOutput,
    is_score_and_label,
    is_share,
    table_of,
)

# Cell sizes of networks, pixels; the usual ones last.
STRIDE_SETS = ((16, 32), (8, 16), (4, 8, 16, 32, 64), (8, 16, 32, 64), (4, 8, 16, 32), STRIDES)
ANCHORS = 3  # boxes a cell in networks with anchors: YOLOv5 and v7
MAX_SELECTED = 3000  # a network that selects its boxes gives at most this many
MAX_COLUMNS = 1000  # of a table with a row for each box
FOLLOWS_GRID = 0.8  # correlation of the boxes' centres with their cells, from which they are decoded
LARGEST_RAW = 7.0  # of YOLOX before decoding: e⁷ strides are wider than any image
ORDERED = 0.9  # share of the boxes whose first corner is left above the second, if they are corners
SCORE_SLACK = 0.05  # of scores below 0 and above 1, in quantised models

TASKS = {
    "pose": "a pose model",
    "obb": "a model of oriented boxes (OBB)",
    "classify": "a classification model",
    "semantic": "a model of semantic segmentation",
    "depth": "a model of depths",
}
REMEDY = "a model that works: yolo export model=best.pt format=onnx, of a detection or segmentation model"


@dataclass(frozen=True)
class OutputLayout:
    """How to feed a network and how to read its outputs.

    Attributes
    ----------
    name : short name of the layout. reader : see `Reader`.
    classes : number of classes, None if neither the outputs nor the metadata tell.
    placement : of the image in the network's: "centred" with borders on both sides, in the upper left
        "corner", or "stretched" over all of it.
    bytes_in : the input is BGR from 0 to 255, otherwise RGB from 0 to 1.
    one_to_one : the network has selected its boxes; each object has one.
    """

    name: str
    reader: Reader
    classes: int | None
    placement: str = "centred"
    bytes_in: bool = False
    one_to_one: bool = False


class Output(NamedTuple):
    """One output of a network for a test image."""

    name: str
    values: NDArray[Any]


def recognise(outputs: Sequence[Output], metadata: Metadata, width: int, height: int) -> OutputLayout:
    """The layout of a network from its outputs for an image of this size, pixels.

    Raises `UnusableOutput`, with the shapes and a remedy, if it cannot be told for certain.
    """
    if metadata.task not in ("", "detect", "segment"):
        what = TASKS.get(metadata.task, f"a model for the task {metadata.task[:20]!r}")
        raise UnusableOutput(f"is {what}, whose boxes the kit does not read; {REMEDY}")
    tables = [k for k, output in enumerate(outputs) if table_of(output.values).ndim <= 2]
    masks = _mask_count(outputs) if len(tables) == 1 else 0
    if len(tables) == 1 and table_of(outputs[tables[0]].values).ndim == 2:
        found = _from_table(outputs, tables[0], masks, metadata, width, height)
    elif len(tables) >= 2:
        found = _from_separate(outputs, tables, metadata, width, height)
    else:
        raise _refusal(outputs, "these look like the raw maps of a network, before its boxes")
    names = metadata.names
    if names is not None and found.classes is not None and len(names) != found.classes:
        raise _refusal(outputs, f"{found.classes} classes, but its metadata names {len(names)}")
    return found


def _from_table(
    outputs: Sequence[Output], index: int, masks: int, metadata: Metadata, width: int, height: int
) -> OutputLayout:
    """The layout of a network whose boxes are in one output."""
    values = outputs[index].values
    table = table_of(values)
    boxes_a_cell = _boxes_a_cell(width, height)
    names = metadata.names
    if masks and names is not None and 4 + len(names) in table.shape:
        masks = 0  # a detection model; its maps are of no concern here
    if table.shape[1] in boxes_a_cell:
        grid = _Grid(outputs, index, table.T, True, boxes_a_cell[table.shape[1]], masks, metadata)
        return _from_grid(grid, width, height)
    if len(table) in boxes_a_cell and not (metadata.one_to_one or metadata.transformer):
        grid = _Grid(outputs, index, table, False, boxes_a_cell[len(table)], masks, metadata)
        return _from_grid(grid, width, height)
    batched = values.ndim > 2
    if len(table) <= MAX_SELECTED and not (batched and table.shape[1] > MAX_COLUMNS):
        return _from_selected(outputs, index, np.asarray(table, np.float64), masks, batched, metadata)
    cells = yolox_cells(width, height)
    words = f"its rows fit no grid of cells; expected {cells} or {ANCHORS * cells} for {width}×{height} px"
    raise _refusal(outputs, words)


@dataclass(frozen=True, eq=False)
class _Grid:
    """A table with a row for each cell of a network's grids, and all that decides on its layout."""

    outputs: Sequence[Output]
    index: int
    rows: NDArray[Any]
    columns_first: bool
    boxes_a_cell: int
    masks: int
    metadata: Metadata


def _from_grid(grid: _Grid, width: int, height: int) -> OutputLayout:
    """The layout of a table with one or three rows for each cell of a grid."""
    rows = np.asarray(grid.rows, np.float64)
    names = grid.metadata.names
    if rows.shape[1] == 6 and grid.masks == 0 and _is_labelled(rows, names):
        classes = None if names is None else len(names)
        labelled = LabelColumn(grid.index, "corners", box=0, score=4, label=5, either=False, classes=classes)
        return OutputLayout("deepstream", labelled, classes)
    objectness = _has_objectness(grid, rows, width, height)
    class_columns = rows.shape[1] - grid.masks - (5 if objectness else 4)
    if class_columns < 1:
        raise _refusal(grid.outputs, f"{rows.shape[1]} columns are too few for a box and its score")
    scores = rows[:, 4 : rows.shape[1] - grid.masks]
    if not is_share(scores[np.isfinite(scores)], SCORE_SLACK).all():
        raise _refusal(grid.outputs, "columns behind the box are not scores from 0 to 1" + _guess(grid))
    form: BoxForm = "centre"
    name = "yolov8"
    yolox = False
    if objectness and grid.boxes_a_cell == ANCHORS:
        name = "yolov5"
    elif objectness and _is_yolov6(rows, grid.outputs[grid.index].name):
        name = "yolov6"
    elif objectness:
        yolox = True
        form = "cell" if _is_raw(rows, width, height) else "centre"
        name = "yolox" if form == "cell" else "yolox-decoded"
    if form == "cell" and len(rows) != yolox_cells(width, height):
        raise _refusal(grid.outputs, "raw boxes of cells of another size than 8, 16 and 32 px")
    reader = ClassColumns(grid.index, grid.columns_first, form, objectness, class_columns)
    return OutputLayout(name, reader, class_columns, "corner" if yolox else "centred", bytes_in=yolox)


def _has_objectness(grid: _Grid, rows: Array, width: int, height: int) -> bool:
    """Whether column 4 of a grid's table is the probability of an object, not the score of class 0."""
    columns = rows.shape[1] - grid.masks
    names = grid.metadata.names
    if names is not None:
        possible = [False, True]
        if grid.boxes_a_cell == ANCHORS:
            possible = [True]
        elif grid.columns_first:
            # Oriented boxes have 5 + classes columns, too, the last of them an angle.
            possible = [False]
        for objectness in possible:
            if columns == len(names) + (5 if objectness else 4):
                return objectness
        form = " or ".join(f"{5 if objectness else 4} + classes" for objectness in possible)
        words = f"expected {form} columns; the metadata names {len(names)} classes" + _guess(grid)
        raise _refusal(grid.outputs, words)
    if grid.boxes_a_cell == ANCHORS:
        return True
    if grid.columns_first or columns == 4 + len(COCO):
        return False
    if columns == 5 + len(COCO) or _is_raw(rows, width, height) or np.all(rows[:, 4] == 1.0):
        return True
    words = (
        f"without class names, this may be YOLOX with {columns - 5} classes or YOLOv8 with {columns - 4}: "
        "export YOLOX without --decode_in_inference, or YOLOv8 with its names"
    )
    raise _refusal(grid.outputs, words, remedy="")


def _from_selected(
    outputs: Sequence[Output], index: int, rows: Array, masks: int, batched: bool, metadata: Metadata
) -> OutputLayout:
    """The layout of a table with a row for each box that the network selected; there may be no row."""
    names = metadata.names
    classes = None if names is None else len(names)
    used = rows[np.any(rows != 0, axis=1)]
    columns = rows.shape[1]
    if columns == 7 and not batched and np.all(rows[:, 0] == 0):
        swapped = "flat" in outputs[index].name  # YOLO-NAS: score, then class
        score, label = (5, 6) if swapped else (6, 5)
        reader = LabelColumn(index, "corners", box=1, score=score, label=label, either=True, classes=classes)
        return OutputLayout("yolov7-end2end", reader, classes, one_to_one=True)
    if columns == 6 + masks:
        return _from_six(outputs, index, used, masks, metadata)
    scores = columns - 4 - masks
    if scores == (len(COCO) if classes is None else classes) and (
        metadata.transformer or np.abs(used[:, :4]).max(initial=0.0) <= LARGEST_SHARE
    ):
        if not is_share(used[:, 4 : 4 + scores], SCORE_SLACK).all():
            raise _refusal(outputs, "the columns behind the box are not scores from 0 to 1")
        columns_of_scores = ClassColumns(index, False, "centre", False, scores)
        return OutputLayout("rtdetr", columns_of_scores, scores, "stretched", one_to_one=True)
    words = "expected 6 columns (corners, score, class)" + _guess_selected(rows, masks, classes)
    raise _refusal(outputs, words)


def _from_six(
    outputs: Sequence[Output], index: int, used: Array, masks: int, metadata: Metadata
) -> OutputLayout:
    """The layout of selected boxes with a score and a class number each; `used` are the rows with values.

    Rows below the score of an object may have any numbers, so they count only if there are no others.
    """
    classes = None if metadata.names is None else len(metadata.names)
    score = 4
    rows = _with_score(used, [score])
    if not metadata.one_to_one and not is_score_and_label(rows[:, 4], rows[:, 5]):
        score = 5
        rows = _with_score(used, [score])
        if not is_score_and_label(rows[:, 5], rows[:, 4]):
            rows = _with_score(used, [4, 5])
            two_classes = masks == 0 and classes in (None, 2) and is_share(rows[:, 4:6]).all()
            if not (two_classes and _are_shares(rows)):
                raise _refusal(outputs, "expected the columns x0, y0, x1, y1, score, class")
            reader: Reader = ClassColumns(index, False, "centre", False, 2)
            return OutputLayout("rtdetr", reader, 2, "stretched", one_to_one=True)
    # The metadata go first: a network without training may give corners in any order.
    corners = not metadata.transformer and (metadata.one_to_one or _are_corners(rows[:, :4]))
    form: BoxForm = "corners" if corners else "centre"
    reader = LabelColumn(index, form, box=0, score=score, label=9 - score, either=False, classes=classes)
    if form == "centre" and (_are_shares(rows) or metadata.transformer):
        return OutputLayout("rtdetr", reader, classes, "stretched", one_to_one=True)
    return OutputLayout("end2end", reader, classes, one_to_one=True)


def _with_score(rows: Array, columns: list[int]) -> Array:
    """The rows that are objects by one of these columns of scores; all rows if there is none."""
    objects = rows[(rows[:, columns] >= NO_OBJECT).any(axis=1)]
    return objects if len(objects) else rows


def _are_shares(rows: Array) -> bool:
    """Whether there are boxes, and their numbers are shares of the image."""
    return bool(len(rows)) and bool(np.abs(rows[:, :4]).max() <= LARGEST_SHARE)


def _from_separate(
    outputs: Sequence[Output], tables: Sequence[int], metadata: Metadata, width: int, height: int
) -> OutputLayout:
    """The layout of a network with one output for the boxes and others for scores and classes."""
    boxes, boxes_first = _boxes_output(outputs, tables)
    table = table_of(outputs[boxes].values)
    rows = np.asarray(table.T if boxes_first else table, np.float64)
    others = [k for k in tables if k != boxes]
    single = [k for k in others if outputs[k].values.size == 1]
    number = next((k for k in single if "num" in outputs[k].name.lower()), None)
    others = [k for k in others if k != number]
    lists = [k for k in others if outputs[k].values.size == len(rows)]
    wide = [k for k in others if k not in lists]
    classes = None if metadata.names is None else len(metadata.names)
    if rows.shape[1] == 5:
        words = (
            "boxes with scores and a list of classes, as of MMDetection, whose networks expect images with "
            "their mean taken out"
        )
        raise _refusal(outputs, words)
    scores_first = False
    labels: int | None = None
    name = "boxes-scores"
    if len(wide) == 1 and not lists and number is None:
        (scores,) = wide
        scores_first, classes = _score_table(outputs, scores, len(rows))
    elif not wide and len(lists) == 2:
        scores, labels = _scores_and_labels(outputs, lists)
        name = "boxes-scores-classes"
    elif not wide and len(lists) == 1 and classes in (None, 1):
        (scores,) = lists
        classes = 1
    else:
        words = "expected one output of boxes and one of scores, or boxes, scores and classes"
        raise _refusal(outputs, words)
    form: BoxForm = "corners" if _are_corners(rows[:, :4]) else "centre"
    reader = SeparateOutputs(boxes, scores, labels, number, boxes_first, scores_first, form, classes)
    on_grid = len(rows) in _boxes_a_cell(width, height)
    return OutputLayout(name, reader, classes, one_to_one=not on_grid)


def _score_table(outputs: Sequence[Output], scores: int, count: int) -> tuple[bool, int]:
    """Whether an output with scores is (classes, N) for `count` boxes, and its number of classes."""
    table = table_of(outputs[scores].values)
    if table.ndim != 2 or count not in table.shape:
        raise _refusal(outputs, "boxes and scores have different numbers of rows")
    scores_first = len(table) != count
    classes = table.shape[0] if scores_first else table.shape[1]
    if not is_share(np.asarray(table, np.float64), SCORE_SLACK).all():
        raise _refusal(outputs, "the scores are not from 0 to 1: before the last step (sigmoid)?")
    return scores_first, classes


def _boxes_output(outputs: Sequence[Output], tables: Sequence[int]) -> tuple[int, bool]:
    """Number of the output with the boxes, and whether it is (columns, N).

    Names decide if several outputs have four columns, then values: scores are from 0 to 1.
    """
    fitting = []
    for k in tables:
        shape = table_of(outputs[k].values).shape
        if len(shape) == 2 and (shape[1] in (4, 5) or shape[0] == 4):
            fitting.append((k, shape[1] not in (4, 5)))
    if len(fitting) > 1:
        named = [each for each in fitting if re.search("box|det|loc", outputs[each[0]].name.lower())]
        scores = [each for each in fitting if is_share(np.asarray(outputs[each[0]].values, np.float64)).all()]
        large = [each for each in fitting if each not in scores]
        fitting = next((few for few in (named, large) if len(few) == 1), fitting)
    if len(fitting) != 1:
        words = "none, or more than one, of the outputs looks like boxes"
        if not fitting and len({outputs[k].values.shape for k in tables}) == 1:
            words = (
                "two heads, as of YOLOv9 with its auxiliary branch: convert the weights to those without it"
            )
        raise _refusal(outputs, words)
    return fitting[0]


def _scores_and_labels(outputs: Sequence[Output], pair: Sequence[int]) -> tuple[int, int]:
    """Numbers of the outputs with scores and with class numbers: told by type, else by name or values."""
    for scores, labels in (tuple(pair), tuple(reversed(pair))):
        whole = [np.issubdtype(outputs[k].values.dtype, np.integer) for k in (scores, labels)]
        if whole == [False, True]:
            return scores, labels
    for scores, labels in (tuple(pair), tuple(reversed(pair))):
        if re.search("label|cls|class", outputs[labels].name.lower()) and re.search(
            "score|conf", outputs[scores].name.lower()
        ):
            return scores, labels
    lists = [np.asarray(outputs[k].values, np.float64).ravel() for k in pair]
    may_be = [is_score_and_label(lists[0], lists[1]), is_score_and_label(lists[1], lists[0])]
    if may_be == [True, False]:
        return pair[0], pair[1]
    if may_be == [False, True]:
        return pair[1], pair[0]
    raise _refusal(outputs, "scores and class numbers cannot be told apart")


def _boxes_a_cell(width: int, height: int) -> dict[int, int]:
    """Boxes a cell, by the number of rows that a network has for an image of this size."""
    found = {}
    for strides in STRIDE_SETS:
        cells = sum(-(-width // stride) * -(-height // stride) for stride in strides)
        for boxes in (ANCHORS, 1):
            found[boxes * cells] = boxes
    return found


def _mask_count(outputs: Sequence[Output]) -> int:
    """Mask coefficients a box: the maps [1, masks, height, width] of a segmentation model; 0 without maps."""
    maps = [output.values.shape for output in outputs if output.values.ndim == 4]
    several = [shape for shape in maps if shape[0] == 1 and min(shape[1:]) > 1]
    return several[0][1] if len(several) == 1 else 0


def _is_labelled(rows: Array, names: Sequence[str] | None) -> bool:
    """Whether rows of six columns are corners, score and class number, before suppression (DeepStream)."""
    used = rows[np.any(rows[:, :4] != 0, axis=1)]
    if not len(used) or not is_score_and_label(used[:, 4], used[:, 5]) or not _are_corners(used[:, :4]):
        return False
    return names is None or bool(used[:, 5].max() < len(names))


def _are_corners(boxes: Array) -> bool:
    """Whether boxes (N, 4) are two corners; otherwise they are a centre and a size.

    A corner is left above the other. Of a centre and a size, this would only be true for large boxes near the
    left upper corner of the image.
    """
    used = boxes[np.any(boxes != 0, axis=1) & np.isfinite(boxes).all(axis=1)]
    ordered = (used[:, 2:] >= used[:, :2]).all(axis=1)
    return not len(used) or bool(ordered.mean() >= ORDERED)


def _is_raw(rows: Array, width: int, height: int) -> bool:
    """Whether the boxes in rows (N, 5 + C) are those of YOLOX before decoding: cells and logarithms.

    Sizes are then small numbers, and the centres do not follow the grid.
    """
    sizes = rows[:, 2:4][np.isfinite(rows[:, 2:4])]
    if np.max(sizes, initial=0.0) > LARGEST_RAW:
        return False
    columns = [np.tile(np.arange(width // stride), height // stride) * stride for stride in STRIDES]
    column_px = np.concatenate(columns).astype(np.float64)
    centre_x = rows[:, 0]
    if len(column_px) != len(rows) or not np.isfinite(centre_x).all() or np.ptp(centre_x) == 0:
        return True
    return bool(np.corrcoef(column_px, centre_x)[0, 1] < FOLLOWS_GRID)


def _is_yolov6(rows: Array, name: str) -> bool:
    """Whether the objectness in rows (N, 5 + C) is that of YOLOv6, which has none and writes 1."""
    objectness = rows[:, 4]
    return bool(np.all(objectness == 1.0) or (name == "outputs" and np.isin(objectness, (0.0, 1.0)).all()))


def _guess(grid: _Grid) -> str:
    """What the columns of a grid's table that do not fit may be, as words."""
    if grid.metadata.names is None:
        return ": keypoints, an angle, mask coefficients, or a network before its last step (sigmoid)?"
    left = grid.rows.shape[1] - 4 - len(grid.metadata.names)
    if left == 1:
        return ": an angle of oriented boxes?"
    if left == 32:
        return ": the coefficients of masks, without their maps?"
    if left > 1 and (left % 3 == 0 or left % 2 == 0):
        return ": keypoints of a pose model?"
    return ""


def _guess_selected(rows: Array, masks: int, classes: int | None) -> str:
    """What the columns of selected boxes that do not fit may be, as words."""
    left = rows.shape[1] - 6 - masks
    if left == 1:
        return ": an angle of oriented boxes?"
    if left == 32:
        return ": the coefficients of masks, without their maps?"
    if left > 1 and (left % 3 == 0 or left % 2 == 0) and classes in (None, 1):
        return ": keypoints of a pose model?"
    return ""


def _refusal(outputs: Sequence[Output], words: str, remedy: str = REMEDY) -> UnusableOutput:
    """The exception for outputs that cannot be read."""
    shapes = ", ".join(f"{output.name[:20]} {list(output.values.shape)}" for output in outputs[:6])
    ending = f"; {remedy}" if remedy else ""
    return UnusableOutput(f"unknown layout of the outputs {shapes}: {words}{ending}")
