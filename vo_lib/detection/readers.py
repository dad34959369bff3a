"""From the outputs of a network to corners and class scores of all its boxes.

A reader knows where in the outputs the numbers are and what they mean; `outputs.recognise` chooses it. It
returns corners in pixels of the image whose size it is given. This is the network's image or, for a network
that asks for the size of the original image, the original one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from ..geometry.types import Array, BoolArray
from .metadata import MAX_CLASSES
from .network_image import STRIDES

# What the four numbers of a box are: centre and size; two corners; or, relative to the cell of a grid and in
# logarithms, as in YOLOX before decoding.
BoxForm = Literal["centre", "corners", "cell"]
Outputs = Sequence[NDArray[Any]]

LARGEST_SHARE = 2.0  # boxes up to here are shares of the image: no object is this small in pixels
LARGEST_LOG = 20.0  # of a box's size in strides; avoids an overflow
# A row with a lower score may be an empty one, which some networks fill with any numbers: it does not decide
# what the numbers of a table are, and its class need not exist.
NO_OBJECT = 0.01


class UnusableOutput(ValueError):
    """The outputs of a network cannot be read; the message says why, without the file's name."""


class ScoredBoxes(NamedTuple):
    """All boxes of a network: corners (N, 4) x0, y0, x1, y1 in pixels, and scores (N, C)."""

    corners: Array
    scores: Array


class Reader(Protocol):
    """How to read the outputs of a network."""

    def read(self, outputs: Outputs, width: int, height: int) -> ScoredBoxes:
        """The boxes in a network's outputs, in pixels of an image of this size.

        Raises `UnusableOutput` if the values contradict the layout.
        """
        ...


@dataclass(frozen=True)
class ClassColumns:
    """One table with a row per box: four numbers of the box, perhaps objectness, a score for each class.

    Attributes
    ----------
    index : index of the output. columns_first : the table is (columns, N), otherwise (N, columns).
    form : what the numbers of a box are; see `BoxForm`.
    objectness : column 4 is the probability of an object, by which the class scores are multiplied.
    class_count : number of classes; further columns are mask coefficients.
    """

    index: int
    columns_first: bool
    form: BoxForm
    objectness: bool
    class_count: int

    def read(self, outputs: Outputs, width: int, height: int) -> ScoredBoxes:
        """See `Reader.read`."""
        table = table_of(outputs[self.index])
        rows = (table.T if self.columns_first else table).astype(np.float64)
        corners = corners_of(rows[:, :4], self.form, width, height)
        first = 5 if self.objectness else 4
        scores = rows[:, first : first + self.class_count]
        if not self.objectness:
            return ScoredBoxes(corners, scores)
        # A network may return numbers that are not finite; `best_boxes` ignores them.
        with np.errstate(invalid="ignore"):
            return ScoredBoxes(corners, scores * rows[:, 4:5])


@dataclass(frozen=True)
class LabelColumn:
    """One table with a row per box: four numbers of the box, its score, and the number of its class.

    Attributes
    ----------
    index : index of the output. form : what the numbers of a box are; see `BoxForm`.
    box, score, label : first column of the box, column of the score, column of the class number.
    either : score and class number may also be in each other's column; the values tell.
    class_count : number of classes, None if unknown.
    """

    index: int
    form: BoxForm
    box: int
    score: int
    label: int
    either: bool
    class_count: int | None

    def read(self, outputs: Outputs, width: int, height: int) -> ScoredBoxes:
        """See `Reader.read`."""
        rows = table_of(outputs[self.index]).astype(np.float64)
        score = rows[:, self.score]
        label = rows[:, self.label]
        if self.either and not is_score_and_label(score, label) and is_score_and_label(label, score):
            score = rows[:, self.label]
            label = rows[:, self.score]
        boxes = rows[:, self.box : self.box + 4]
        corners = corners_of(boxes, self.form, width, height, score >= NO_OBJECT)
        return ScoredBoxes(corners, scores_by_class(score, label, self.class_count))


@dataclass(frozen=True)
class SeparateOutputs:
    """Boxes, scores and perhaps class numbers as outputs of their own.

    Attributes
    ----------
    boxes, scores : indices of the outputs with the boxes and with their scores.
    labels : index of the output with the class of each box; None if the scores are a table with a column for
        each class.
    count_output : index of the output that says how many of the first rows are boxes; None: all are.
    boxes_first, scores_first : whether the table is (columns, N), otherwise (N, columns).
    form : what the numbers of a box are; see `BoxForm`.
    class_count : number of classes, None if unknown.
    """

    boxes: int
    scores: int
    labels: int | None
    count_output: int | None
    boxes_first: bool
    scores_first: bool
    form: BoxForm
    class_count: int | None

    def read(self, outputs: Outputs, width: int, height: int) -> ScoredBoxes:
        """See `Reader.read`."""
        table = table_of(outputs[self.boxes])
        rows = (table.T if self.boxes_first else table).astype(np.float64)
        count = len(rows)
        if self.count_output is not None:
            stated = float(outputs[self.count_output].ravel()[0])
            if not stated >= 0:  # NaN is not
                raise UnusableOutput(f"expected the number of boxes in an output, found {stated:g}")
            count = int(min(stated, count))
        corners = corners_of(rows[:count, :4], self.form, width, height)
        if self.labels is None:
            scores = table_of(outputs[self.scores]).astype(np.float64)
            if scores.size == len(rows):  # one class: a list, a row or a column
                scores = scores.reshape(-1, 1)
            elif self.scores_first:
                scores = scores.T
            return ScoredBoxes(corners, scores[:count])
        score = outputs[self.scores].ravel().astype(np.float64)
        label = outputs[self.labels].ravel().astype(np.float64)
        return ScoredBoxes(corners, scores_by_class(score[:count], label[:count], self.class_count))


def table_of(output: NDArray[Any]) -> NDArray[Any]:
    """An output without its batch axis and, above two axes, without those of length 1 behind the first.

    [1, N, 1, 4] becomes (N, 4), and [1, K] stays.
    """
    table = output[0] if output.ndim > 2 and output.shape[0] == 1 else output
    while table.ndim > 2 and 1 in table.shape[1:]:
        table = table.squeeze(axis=1 + table.shape[1:].index(1))
    return table


def corners_of(
    boxes: Array, form: BoxForm, width: int, height: int, objects: BoolArray | None = None
) -> Array:
    """Corners (N, 4), pixels, of boxes (N, 4) in pixels or as shares of an image.

    form : see `BoxForm`. width, height : size of this image, pixels, as in `Reader.read`.
    objects : mask (N,) of the boxes that decide whether all are shares; all boxes decide if it is None or
        selects none.
    """
    if form == "cell":
        return _decoded(boxes, width, height)
    deciding = boxes if objects is None or not objects.any() else boxes[objects]
    largest = np.max(np.abs(deciding), initial=0.0, where=np.isfinite(deciding))
    if largest <= LARGEST_SHARE:
        boxes = boxes * (width, height, width, height)
    if form == "centre":
        return _corners_around(boxes[:, :2], boxes[:, 2:])
    return boxes


def scores_by_class(score: Array, label: Array, class_count: int | None) -> Array:
    """Scores (N, C) from the score (N,) and class number (N,) of each row; 0 for the other classes.

    All scores of a row that is no box are 0: its class number is negative or, with a score below `NO_OBJECT`,
    not the number of a class.

    Raises `UnusableOutput` if the class number of a row with a higher score is not a whole number, or is not
    below `class_count`.
    """
    end = MAX_CLASSES if class_count is None else class_count
    is_whole = label == np.rint(label)
    is_object = score >= NO_OBJECT
    broken = label[is_object & ~is_whole]
    if len(broken):
        raise UnusableOutput(f"expected the number of a class for each box, found {broken[0]:g}")
    largest = float(np.max(label[is_object], initial=0.0))
    if largest >= end:
        raise UnusableOutput(
            f"a box has class {largest:g}, but the model has {class_count or 'fewer'} classes"
        )
    is_box = (score > 0) & is_whole & (label >= 0) & (label < end)
    rows = np.flatnonzero(is_box)
    classes = label[rows].astype(np.intp)
    scores = np.zeros((len(score), int(classes.max(initial=0)) + 1 if class_count is None else class_count))
    scores[rows, classes] = score[rows]
    return scores


def is_score_and_label(score: Array, label: Array) -> bool:
    """Whether these columns (N,) may be the scores, from 0 to 1, and the class numbers of boxes.

    The class number -1 stands in rows that are no boxes.
    """
    is_number = (label == np.rint(label)) & (label >= -1)
    return bool(is_share(score).all() and is_number.all())


def is_share(values: Array, slack: float = 1e-3) -> BoolArray:
    """Mask, of the shape of `values`, of those from 0 to 1, as scores are, up to `slack`."""
    return np.asarray((values >= -slack) & (values <= 1 + slack))


@np.errstate(invalid="ignore")
def _decoded(boxes: Array, width: int, height: int) -> Array:
    """Corners (N, 4) from the raw boxes (N, 4) of YOLOX.

    A centre is relative to its cell, in strides, and a size is the logarithm of a number of strides.
    """
    grids = []
    for stride in STRIDES:
        y, x = np.mgrid[: height // stride, : width // stride]
        grids.append(np.stack([x.ravel(), y.ravel(), np.full(x.size, stride)], axis=1))
    cells = np.concatenate(grids)  # a row for each box: column and row of its cell, and the cell's size
    corner = cells[:, :2]
    stride_px = cells[:, 2:]
    centre = (boxes[:, :2] + corner) * stride_px
    size = np.exp(np.minimum(boxes[:, 2:], LARGEST_LOG)) * stride_px
    return _corners_around(centre, size)


@np.errstate(invalid="ignore")
def _corners_around(centre: Array, size: Array) -> Array:
    """Corners (N, 4) of boxes with these centres (N, 2) and sizes (N, 2)."""
    return np.concatenate([centre - size / 2, centre + size / 2], axis=1)
