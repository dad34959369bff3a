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

Most networks divide their image into square cells, in several grids with cells of different sizes (strides),
and give a box for each cell, or three, with anchors. N is the number of all cells, C the number of classes,
and K the number of boxes that the network has selected itself. Objectness is the probability that a box has
an object of any class. RT-DETR's boxes are shares of the image; those of other networks may be, too. A
segmentation model has further columns, the coefficients of its masks, and a second output with as many maps.
"""

from __future__ import annotations

import math
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

# Cell sizes of networks, pixels; the usual ones last, so that they count if two sets give equally many rows.
STRIDE_SETS = ((16, 32), (8, 16), (4, 8, 16, 32, 64), (8, 16, 32, 64), (4, 8, 16, 32), STRIDES)
ANCHORS = 3  # boxes a cell in networks with anchors: YOLOv5 and v7
MAX_SELECTED = 3000  # a network that selects its boxes gives at most this many
MAX_COLUMNS = 1000  # of a table with a row for each selected box
FOLLOWS_GRID = 0.8  # smallest correlation of decoded centres with the places of their cells
LARGEST_RAW = 7.0  # largest size in YOLOX's raw output, a logarithm: e⁷ strides are wider than any image
ORDERED = 0.9  # of boxes given as corners, smallest share whose first corner is left above the second
SCORE_SLACK = 0.05  # by which scores of quantised models may be below 0 or above 1
MASK_COEFFICIENTS = 32  # of a box in the segmentation models of Ultralytics

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
    class_count : number of classes, None if neither the outputs nor the metadata tell.
    placement : of the image in the network's image: "centred" with borders on both sides, in the upper left
        "corner", or "stretched" over all of it.
    wants_bgr_bytes : the input is BGR from 0 to 255, otherwise RGB from 0 to 1.
    one_to_one : the network has selected its boxes; each object has one.
    """

    name: str
    reader: Reader
    class_count: int | None
    placement: str = "centred"
    wants_bgr_bytes: bool = False
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
    # Indices of the outputs with a row or a single value for each box, or with the count of the boxes; the
    # others are maps.
    tables = [index for index, output in enumerate(outputs) if table_of(output.values).ndim <= 2]
    if len(tables) == 1 and table_of(outputs[tables[0]].values).ndim == 2:
        layout = _from_table(outputs, tables[0], metadata, width, height)
    elif len(tables) >= 2:
        layout = _from_separate(outputs, tables, metadata, width, height)
    else:
        raise _refusal(outputs, "these look like the raw maps of a network, before its boxes")
    names = metadata.names
    if names is not None and layout.class_count is not None and len(names) != layout.class_count:
        raise _refusal(outputs, f"{layout.class_count} classes, but its metadata names {len(names)}")
    return layout


def _from_table(
    outputs: Sequence[Output], index: int, metadata: Metadata, width: int, height: int
) -> OutputLayout:
    """The layout of a network whose boxes are in one output, that with the index `index`."""
    values = outputs[index].values
    table = table_of(values)
    boxes_a_cell_by_rows = _grids_by_rows(width, height)
    masks = _mask_count(outputs)
    if metadata.names is not None and 4 + len(metadata.names) in table.shape:
        masks = 0  # a detection model, whatever its maps are for
    # The number of boxes that a network selects may happen to be that of the cells of a grid.
    selects_boxes = metadata.one_to_one or metadata.transformer
    columns_first = table.shape[1] in boxes_a_cell_by_rows
    if columns_first or (len(table) in boxes_a_cell_by_rows and not selects_boxes):
        rows = np.asarray(table.T if columns_first else table, np.float64)
        grid = _Grid(
            outputs=outputs,
            index=index,
            rows=rows,
            columns_first=columns_first,
            boxes_a_cell=boxes_a_cell_by_rows[len(rows)],
            masks=masks,
            metadata=metadata,
            width=width,
            height=height,
        )
        return _from_grid(grid)
    # Selected boxes are [1, K, columns], or [K, columns] for all images of a batch together.
    has_batch_axis = values.ndim > 2
    has_box_per_column = has_batch_axis and table.shape[1] > MAX_COLUMNS  # [1, columns, N], so not selected
    if len(table) <= MAX_SELECTED and not has_box_per_column:
        rows = np.asarray(table, np.float64)
        return _from_selected(outputs, index, rows, masks, has_batch_axis, metadata)
    cells = yolox_cells(width, height)
    words = f"its rows fit no grid of cells; expected {cells} or {ANCHORS * cells} for {width}×{height} px"
    raise _refusal(outputs, words)


@dataclass(frozen=True, eq=False)
class _Grid:
    """A table with a row for each cell of a network's grids, and all that decides on its layout.

    Attributes
    ----------
    outputs : all outputs of the network. index : index of the output with the table.
    rows : (N, columns) the table. columns_first : whether the output is (columns, N).
    boxes_a_cell : number of rows for each cell.
    masks : number of mask coefficients, the last columns.
    width, height : size of the network's image, pixels.
    """

    outputs: Sequence[Output]
    index: int
    rows: Array
    columns_first: bool
    boxes_a_cell: int
    masks: int
    metadata: Metadata
    width: int
    height: int

    @property
    def columns(self) -> int:
        """Number of columns without the mask coefficients."""
        return int(self.rows.shape[1]) - self.masks

    @property
    def output_name(self) -> str:
        """The name of the output."""
        return self.outputs[self.index].name

    def is_raw(self) -> bool:
        """Whether the boxes are those of YOLOX before decoding."""
        return _is_raw(self.rows, self.width, self.height)


def _from_grid(grid: _Grid) -> OutputLayout:
    """The layout of a table with one or three rows for each cell of a grid."""
    names = grid.metadata.names
    if grid.columns == 6 and grid.masks == 0 and _is_labelled(grid.rows, names):
        class_count = None if names is None else len(names)
        labelled = LabelColumn(
            grid.index, "corners", box=0, score=4, label=5, either=False, class_count=class_count
        )
        return OutputLayout("deepstream", labelled, class_count)
    too_few = f"{grid.rows.shape[1]} columns are too few for a box and its score"
    if names is None and grid.columns < 5:
        raise _refusal(grid.outputs, too_few)
    objectness = _has_objectness(grid)
    class_count = grid.columns - (5 if objectness else 4)
    if class_count < 1:
        raise _refusal(grid.outputs, too_few)
    scores = grid.rows[:, 4 : grid.columns]
    if not is_share(scores[np.isfinite(scores)], SCORE_SLACK).all():
        raise _refusal(grid.outputs, "columns behind the box are not scores from 0 to 1" + _guess(grid))
    as_centres = ClassColumns(grid.index, grid.columns_first, "centre", objectness, class_count)
    if not objectness:
        return OutputLayout("yolov8", as_centres, class_count)
    if grid.boxes_a_cell == ANCHORS:
        return OutputLayout("yolov5", as_centres, class_count)
    if _is_yolov6(grid.rows, grid.output_name):
        return OutputLayout("yolov6", as_centres, class_count)
    if not grid.is_raw():
        return OutputLayout("yolox-decoded", as_centres, class_count, "corner", wants_bgr_bytes=True)
    if len(grid.rows) != yolox_cells(grid.width, grid.height):
        raise _refusal(grid.outputs, "raw boxes of cells of another size than 8, 16 and 32 px")
    in_cells = ClassColumns(grid.index, grid.columns_first, "cell", objectness, class_count)
    return OutputLayout("yolox", in_cells, class_count, "corner", wants_bgr_bytes=True)


def _has_objectness(grid: _Grid) -> bool:
    """Whether column 4 of a grid's table is the probability of an object, not the score of class 0.

    Raises `UnusableOutput` if this cannot be told.
    """
    columns = grid.columns
    if grid.metadata.names is not None:
        return _has_objectness_by_names(grid, len(grid.metadata.names))
    if grid.boxes_a_cell == ANCHORS:  # YOLOv5 and v7
        return True
    if grid.columns_first or columns == 4 + len(COCO):  # YOLOv8 and its successors
        return False
    if columns == 5 + len(COCO) or grid.is_raw() or np.all(grid.rows[:, 4] == 1.0):  # YOLOX; YOLOv6 writes 1
        return True
    words = (
        f"without class names, this may be YOLOX with {columns - 5} classes or YOLOv8 with {columns - 4}: "
        "export YOLOX without --decode_in_inference, or YOLOv8 with its names"
    )
    raise _refusal(grid.outputs, words, remedy="")


def _has_objectness_by_names(grid: _Grid, class_count: int) -> bool:
    """Whether a table with this number of classes has a column with the probability of an object, too."""
    without = 4 + class_count
    with_objectness = 5 + class_count
    if grid.boxes_a_cell == ANCHORS:
        expected = [with_objectness]
        form = "5 + classes"
    elif grid.columns_first:
        # Oriented boxes have 5 + classes columns, too, the last of them an angle.
        expected = [without]
        form = "4 + classes"
    else:
        expected = [without, with_objectness]
        form = "4 + classes or 5 + classes"
    if grid.columns in expected:
        return grid.columns == with_objectness
    words = f"expected {form} columns; the metadata names {class_count} classes" + _guess(grid)
    raise _refusal(grid.outputs, words)


def _from_selected(
    outputs: Sequence[Output],
    index: int,
    rows: Array,
    masks: int,
    has_batch_axis: bool,
    metadata: Metadata,
) -> OutputLayout:
    """The layout of a table with a row for each box that the network selected; there may be no row.

    index : index of the output with the table. rows : (K, columns) the table.
    masks : number of mask coefficients, the last columns.
    has_batch_axis : whether the output is [1, K, columns]; otherwise a column may be the number of the image.
    """
    class_count = None if metadata.names is None else len(metadata.names)
    used = rows[np.any(rows != 0, axis=1)]  # some networks fill up the table with rows of zeros
    columns = rows.shape[1]
    if columns == 7 and not has_batch_axis and np.all(rows[:, 0] == 0):  # all of image 0
        label_last = "flat" in outputs[index].name  # YOLO-NAS
        reader = LabelColumn(
            index,
            "corners",
            box=1,
            score=5 if label_last else 6,
            label=6 if label_last else 5,
            either=True,
            class_count=class_count,
        )
        return OutputLayout("yolov7-end2end", reader, class_count, one_to_one=True)
    if columns == 6 + masks:
        return _from_score_and_label(outputs, index, used, masks, metadata)
    scores = columns - 4 - masks
    expected_scores = len(COCO) if class_count is None else class_count
    may_be_shares = metadata.transformer or np.abs(used[:, :4]).max(initial=0.0) <= LARGEST_SHARE
    if scores != expected_scores or not may_be_shares:
        words = "expected 6 columns (corners, score, class)" + _guess_selected(rows, masks, class_count)
        raise _refusal(outputs, words)
    if not is_share(used[:, 4 : 4 + scores], SCORE_SLACK).all():
        raise _refusal(outputs, "the columns behind the box are not scores from 0 to 1")
    return _from_class_columns(index, scores)


def _from_class_columns(index: int, class_count: int) -> OutputLayout:
    """The layout of RT-DETR's boxes, centre and size, with a score for each class."""
    reader = ClassColumns(
        index, columns_first=False, form="centre", objectness=False, class_count=class_count
    )
    return OutputLayout("rtdetr", reader, class_count, "stretched", one_to_one=True)


def _from_score_and_label(
    outputs: Sequence[Output], index: int, used: Array, masks: int, metadata: Metadata
) -> OutputLayout:
    """The layout of selected boxes of six columns: four numbers of the box, its score, its class number.

    RT-DETR with two classes has six columns, too: four numbers of the box, and the score of each class.

    used : (K, 6 + masks) the rows with values. masks : number of mask coefficients, the last columns.
    """
    class_count = None if metadata.names is None else len(metadata.names)
    if metadata.one_to_one or _may_have_score_in(4, used, label=5):
        score = 4
        label = 5
    elif _may_have_score_in(5, used, label=4):
        score = 5
        label = 4
    else:
        objects = _with_score(used, [4, 5])
        may_have_two_classes = masks == 0 and class_count in (None, 2)
        are_scores = bool(is_share(objects[:, 4:6]).all())
        if not may_have_two_classes or not are_scores or not _are_shares(objects):
            raise _refusal(outputs, "expected the columns x0, y0, x1, y1, score, class")
        return _from_class_columns(index, 2)
    objects = _with_score(used, [score])
    # The metadata go first: a network without training may give corners in any order.
    has_corners = not metadata.transformer and (metadata.one_to_one or _are_corners(objects[:, :4]))
    form: BoxForm = "corners" if has_corners else "centre"
    reader = LabelColumn(index, form, box=0, score=score, label=label, either=False, class_count=class_count)
    if form == "centre" and (metadata.transformer or _are_shares(objects)):
        return OutputLayout("rtdetr", reader, class_count, "stretched", one_to_one=True)
    return OutputLayout("end2end", reader, class_count, one_to_one=True)


def _may_have_score_in(score: int, rows: Array, label: int) -> bool:
    """Whether the column `score` may be the scores of boxes, and the column `label` their class numbers."""
    objects = _with_score(rows, [score])
    return is_score_and_label(objects[:, score], objects[:, label])


def _with_score(rows: Array, columns: list[int]) -> Array:
    """The rows that are objects by one of these columns of scores; all rows if there is none.

    Rows below the score of an object may have any numbers, so they count only if there are no others.
    """
    objects = rows[(rows[:, columns] >= NO_OBJECT).any(axis=1)]
    return objects if len(objects) else rows


def _are_shares(rows: Array) -> bool:
    """Whether there are boxes, and their numbers are shares of the image."""
    return len(rows) > 0 and bool(np.abs(rows[:, :4]).max() <= LARGEST_SHARE)


def _from_separate(
    outputs: Sequence[Output], tables: Sequence[int], metadata: Metadata, width: int, height: int
) -> OutputLayout:
    """The layout of a network with one output for the boxes and others for scores and classes.

    tables : indices of the outputs that are tables or lists.
    """
    boxes, boxes_first = _boxes_output(outputs, tables)
    table = table_of(outputs[boxes].values)
    rows = np.asarray(table.T if boxes_first else table, np.float64)
    if rows.shape[1] == 5:
        words = (
            "boxes with scores and a list of classes, as of MMDetection, whose networks expect images with "
            "their mean taken out"
        )
        raise _refusal(outputs, words)
    # What the other outputs are: the count of the boxes, lists with a value for each box, or tables.
    others = [index for index in tables if index != boxes]
    count_output = _count_output(outputs, others)
    others = [index for index in others if index != count_output]
    lists = [index for index in others if outputs[index].values.size == len(rows)]
    score_tables = [index for index in others if index not in lists]
    class_count = None if metadata.names is None else len(metadata.names)
    scores_first = False
    labels: int | None = None
    name = "boxes-scores"
    if len(score_tables) == 1 and not lists and count_output is None:
        scores = score_tables[0]
        scores_first, class_count = _score_table(outputs, scores, len(rows))
    elif not score_tables and len(lists) == 2:
        scores, labels = _scores_and_labels(outputs, lists[0], lists[1])
        name = "boxes-scores-classes"
    elif not score_tables and len(lists) == 1 and class_count in (None, 1):
        scores = lists[0]
        class_count = 1
    else:
        words = "expected one output of boxes and one of scores, or boxes, scores and classes"
        raise _refusal(outputs, words)
    form: BoxForm = "corners" if _are_corners(rows[:, :4]) else "centre"
    reader = SeparateOutputs(
        boxes, scores, labels, count_output, boxes_first, scores_first, form, class_count
    )
    on_grid = len(rows) in _grids_by_rows(width, height)
    return OutputLayout(name, reader, class_count, one_to_one=not on_grid)


def _count_output(outputs: Sequence[Output], others: Sequence[int]) -> int | None:
    """The one of `others`, indices of outputs, that has the count of the boxes; None if there is none."""
    for index in others:
        if outputs[index].values.size == 1 and "num" in outputs[index].name.lower():
            return index
    return None


def _score_table(outputs: Sequence[Output], scores: int, count: int) -> tuple[bool, int]:
    """Whether an output with scores is (classes, N) for `count` boxes, and its number of classes."""
    table = table_of(outputs[scores].values)
    if table.ndim != 2 or count not in table.shape:
        raise _refusal(outputs, "boxes and scores have different numbers of rows")
    scores_first = len(table) != count
    class_count = table.shape[0] if scores_first else table.shape[1]
    if not is_share(np.asarray(table, np.float64), SCORE_SLACK).all():
        raise _refusal(outputs, "the scores are not from 0 to 1: before the last step (sigmoid)?")
    return scores_first, class_count


def _boxes_output(outputs: Sequence[Output], tables: Sequence[int]) -> tuple[int, bool]:
    """Index of the output with the boxes, and whether it is (columns, N)."""
    columns_first: dict[int, bool] = {}  # of the outputs that may be boxes
    for index in tables:
        shape = table_of(outputs[index].values).shape
        if len(shape) != 2:
            continue
        if shape[1] in (4, 5):
            columns_first[index] = False
        elif shape[0] == 4:
            columns_first[index] = True
    if not columns_first and len({outputs[index].values.shape for index in tables}) == 1:
        words = "two heads, as of YOLOv9 with its auxiliary branch: convert the weights to those without it"
        raise _refusal(outputs, words)
    found = _probable_boxes(outputs, list(columns_first))
    if len(found) != 1:
        raise _refusal(outputs, "none, or more than one, of the outputs looks like boxes")
    return found[0], columns_first[found[0]]


def _probable_boxes(outputs: Sequence[Output], indices: list[int]) -> list[int]:
    """The one of these indices of outputs that is boxes by its name or values; all if this does not tell."""
    named = [index for index in indices if re.search("box|det|loc", outputs[index].name.lower())]
    if len(named) == 1:
        return named
    # Scores are from 0 to 1, so a single output with other values is the boxes.
    not_scores = []
    for index in indices:
        values = np.asarray(outputs[index].values, np.float64)
        if not is_share(values).all():
            not_scores.append(index)
    if len(not_scores) == 1:
        return not_scores
    return indices


def _scores_and_labels(outputs: Sequence[Output], first: int, second: int) -> tuple[int, int]:
    """Indices of the outputs with scores and with class numbers: told by type, else by name or values."""
    orders = ((first, second), (second, first))
    for tells in (_tell_types, _tell_names):
        for scores, labels in orders:
            if tells(outputs[scores], outputs[labels]):
                return scores, labels
    possible = [order for order in orders if _may_be_values(outputs[order[0]], outputs[order[1]])]
    if len(possible) != 1:
        raise _refusal(outputs, "scores and class numbers cannot be told apart")
    return possible[0]


def _tell_types(scores: Output, labels: Output) -> bool:
    """Whether only the second of two outputs has whole numbers, as those of classes."""
    whole_scores = np.issubdtype(scores.values.dtype, np.integer)
    whole_labels = np.issubdtype(labels.values.dtype, np.integer)
    return bool(whole_labels and not whole_scores)


def _tell_names(scores: Output, labels: Output) -> bool:
    """Whether two outputs are called scores and class numbers."""
    is_label = re.search("label|cls|class", labels.name.lower()) is not None
    is_score = re.search("score|conf", scores.name.lower()) is not None
    return is_label and is_score


def _may_be_values(scores: Output, labels: Output) -> bool:
    """Whether two outputs may be scores and class numbers by their values."""
    score = np.asarray(scores.values, np.float64).ravel()
    label = np.asarray(labels.values, np.float64).ravel()
    return is_score_and_label(score, label)


def _grids_by_rows(width: int, height: int) -> dict[int, int]:
    """Boxes a cell, by the number of rows that a network has for an image of this size."""
    found: dict[int, int] = {}
    for strides in STRIDE_SETS:
        cells = sum(math.ceil(width / stride) * math.ceil(height / stride) for stride in strides)
        for boxes in (ANCHORS, 1):
            found[boxes * cells] = boxes
    return found


def _mask_count(outputs: Sequence[Output]) -> int:
    """Mask coefficients a box: the maps [1, masks, height, width] of a segmentation model; 0 without maps."""
    counts = []
    for output in outputs:
        shape = output.values.shape
        if len(shape) == 4 and shape[0] == 1 and min(shape[1:]) > 1:
            counts.append(shape[1])
    return counts[0] if len(counts) == 1 else 0


def _is_labelled(rows: Array, names: Sequence[str] | None) -> bool:
    """Whether rows of six columns are corners, score and class number, before suppression (DeepStream)."""
    used = rows[np.any(rows[:, :4] != 0, axis=1)]
    if len(used) == 0:
        return False
    if not is_score_and_label(used[:, 4], used[:, 5]) or not _are_corners(used[:, :4]):
        return False
    return names is None or bool(used[:, 5].max() < len(names))


def _are_corners(boxes: Array) -> bool:
    """Whether boxes (N, 4) are two corners; otherwise they are a centre and a size.

    A corner is left above the other. Of a centre and a size, this would only be true for large boxes near the
    left upper corner of the image.
    """
    used = boxes[np.any(boxes != 0, axis=1) & np.isfinite(boxes).all(axis=1)]
    if len(used) == 0:
        return True
    ordered = (used[:, 2:] >= used[:, :2]).all(axis=1)
    return bool(ordered.mean() >= ORDERED)


def _is_raw(rows: Array, width: int, height: int) -> bool:
    """Whether the boxes in rows (N, 5 + C) are those of YOLOX before decoding: cells and logarithms.

    Sizes are then small numbers, and the centres, relative to their cells, do not follow the grid.
    """
    sizes = rows[:, 2:4][np.isfinite(rows[:, 2:4])]
    if np.max(sizes, initial=0.0) > LARGEST_RAW:
        return False
    cell_x = [np.tile(np.arange(width // stride), height // stride) * stride for stride in STRIDES]
    cell_x_px = np.concatenate(cell_x).astype(np.float64)
    centre_x = rows[:, 0]
    if len(cell_x_px) != len(rows) or not np.isfinite(centre_x).all() or np.ptp(centre_x) == 0:
        return True
    return bool(np.corrcoef(cell_x_px, centre_x)[0, 1] < FOLLOWS_GRID)


def _is_yolov6(rows: Array, name: str) -> bool:
    """Whether the objectness in rows (N, 5 + C) is that of YOLOv6, which has none and writes 1.

    name : of the output. Under YOLOv6's own name of it, "outputs", it may also be 0.
    """
    objectness = rows[:, 4]
    if np.all(objectness == 1.0):
        return True
    return name == "outputs" and bool(np.isin(objectness, (0.0, 1.0)).all())


def _guess(grid: _Grid) -> str:
    """What the columns of a grid's table that do not fit may be, as words."""
    if grid.metadata.names is None:
        return ": keypoints, an angle, mask coefficients, or a network before its last step (sigmoid)?"
    return _guess_further(grid.rows.shape[1] - 4 - len(grid.metadata.names), may_be_keypoints=True)


def _guess_selected(rows: Array, masks: int, class_count: int | None) -> str:
    """What the columns of selected boxes that do not fit may be, as words."""
    further = rows.shape[1] - 6 - masks
    return _guess_further(further, may_be_keypoints=class_count in (None, 1))


def _guess_further(columns: int, may_be_keypoints: bool) -> str:
    """What this number of further columns of a box may be, as words."""
    if columns == 1:
        return ": an angle of oriented boxes?"
    if columns == MASK_COEFFICIENTS:
        return ": the coefficients of masks, without their maps?"
    # A keypoint has two or three numbers.
    if may_be_keypoints and columns > 1 and (columns % 3 == 0 or columns % 2 == 0):
        return ": keypoints of a pose model?"
    return ""


def _refusal(outputs: Sequence[Output], words: str, remedy: str = REMEDY) -> UnusableOutput:
    """The exception for outputs that cannot be read."""
    shapes = ", ".join(f"{output.name[:20]} {list(output.values.shape)}" for output in outputs[:6])
    ending = f"; {remedy}" if remedy else ""
    return UnusableOutput(f"unknown layout of the outputs {shapes}: {words}{ending}")
