"""What the miniature detector of chapter 5 finds after different trainings: experiments, and their table."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from vo_lib.geometry.boxes import Boxes, area, common_area, overlap
from vo_lib.geometry.types import Array, BoolArray

STEPS = 1200  # as in the notebook
SEEDS = 5
LEAST_SCORE = 0.1  # of a box that finds a vehicle, in the shares of found vehicles
RIGHT = 0.5  # IoU of a box that finds a vehicle
LOW = 25.0  # pixels; a vehicle with a lower box is small
HIDDEN = 0.2  # share of a vehicle's box that nearer vehicles cover
EDGE = 2.0  # pixels; a box that ends nearer to the left or right edge of the image is cut
TALL_CLASSES = (5, 7)  # COCO's bus and truck
GROUPS = ("clear", "small", "hidden", "cut", "trucks")
HEAD = ("experiment", "seed", "steps", "code", "weights")


@dataclass(frozen=True)
class Experiment:
    """A training of the miniature, and how it differs from the notebook's.

    Attributes
    ----------
    images : number of training images by street; None for all.
    settings : arguments of the notebook's `train`. network : name of the table of layers.
    """

    name: str
    images: dict[str, int | None]
    settings: dict[str, Any] = field(default_factory=dict)
    network: str = "ONE_LEVEL"
    steps: int = STEPS


EXPERIMENTS = (
    Experiment("one street", {"traffic": None}),
    Experiment("20 frames", {"traffic": 20}),
    Experiment("three streets", {"traffic": 87, "traffic 2": 87, "traffic 3": 87}),
    Experiment("without changes", {"traffic": None}, {"augment": False}),
    Experiment("with the jam", {"traffic": None, "jam": None}),
    Experiment("three levels", {"traffic": None}, network="THREE_LEVELS"),
    Experiment("300 steps", {"traffic": None}, steps=300),
)


def groups_of(boxes: Boxes, width: int) -> dict[str, BoolArray]:
    """Which labels of an image, `width` pixels wide, are in each group; a label may be in several."""
    xyxy = boxes.xyxy
    small = xyxy[:, 3] - xyxy[:, 1] < LOW
    nearer = xyxy[None, :, 3] > xyxy[:, None, 3]  # a lower edge that is lower in the image
    covered = (common_area(xyxy, xyxy) * nearer).max(axis=1, initial=0.0)
    hidden = covered > HIDDEN * area(xyxy)
    cut = (xyxy[:, 0] < EDGE) | (xyxy[:, 2] > width - 1 - EDGE)
    trucks = np.isin(boxes.class_id, TALL_CLASSES) & ~small
    return {
        "clear": ~small & ~hidden & ~cut & ~trucks,
        "small": small,
        "hidden": hidden & ~small,
        "cut": cut & ~small,
        "trucks": trucks,
    }


def found_labels(labels: Array, boxes: Array, scores: Array) -> BoolArray:
    """Which labels (K, 4) have a box (N, 4) with an IoU and a score that suffice."""
    shares = overlap(labels, boxes[scores >= LEAST_SCORE])
    return np.asarray(shares.max(axis=1, initial=0.0) >= RIGHT)


def average_precision(scores: Array, right: BoolArray, wanted: int) -> float:
    """The mean of the precision over all wanted vehicles; a vehicle without a box counts as 0."""
    hits = np.cumsum(right[np.argsort(-scores, kind="stable")])
    precision = hits / np.arange(1, len(hits) + 1)
    return float(np.sum(precision * np.diff(hits, prepend=0)) / wanted)


def row_head(tests: Sequence[str]) -> list[str]:
    """The heading of the table: AP on each street, found shares of the groups, and the groups' sizes."""
    return [*HEAD, *(f"ap {name}" for name in tests), *GROUPS, *(f"{group} n" for group in GROUPS)]


def judged(
    tests: dict[str, list[tuple[Any, Boxes]]],
    find: Callable[[Any], tuple[Array, Array]],
    judge: Callable[..., tuple[Array, BoolArray, int]],
) -> list[float]:
    """AP on each street, the found share of each group over all streets, and the groups' sizes.

    Parameters
    ----------
    tests : images of each street with their labels.
    find : function of an image; returns boxes (N, 4) and scores (N,).
    judge : the notebook's function of images with label boxes and of a detector; returns the scores and
        verdicts of all boxes, and the number of labels.
    """
    precisions = []
    found = dict.fromkeys(GROUPS, 0)
    count = dict.fromkeys(GROUPS, 0)
    for frames in tests.values():
        detections = [find(image) for image, _ in frames]
        precisions.append(average_precision(*_judge_detections(frames, detections, judge)))
        for (image, labels), (boxes, scores) in zip(frames, detections, strict=True):
            is_found = found_labels(labels.xyxy, boxes, scores)
            for name, mask in groups_of(labels, image.shape[1]).items():
                found[name] += int(np.count_nonzero(is_found & mask))
                count[name] += int(np.count_nonzero(mask))
    shares = [found[name] / max(count[name], 1) for name in GROUPS]
    sizes = [float(count[name]) for name in GROUPS]
    return [*precisions, *shares, *sizes]


def _judge_detections(
    frames: list[tuple[Any, Boxes]],
    detections: list[tuple[Array, Array]],
    judge: Callable[..., tuple[Array, BoolArray, int]],
) -> tuple[Array, BoolArray, int]:
    """The result of the notebook's `judge`, which calls a detector for one image after the other.

    Here the boxes have been found already, so the detector only hands out the next ones.
    """
    images = [(image, labels.xyxy) for image, labels in frames]
    remaining = iter(detections)
    return judge(images, lambda image: next(remaining))
