"""A detector as it will be used, judged on a data set: the whole way from image to boxes, no PyTorch."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from training.dataset import DetectionSet
from training.mean_ap import average_precision, judge, recall_precision
from vo_lib.config import DetectorConfig
from vo_lib.core.boxes import Boxes
from vo_lib.core.types import Progress
from vo_lib.detection.yolo import YoloDetector

CURVE_SCORE = 0.01  # detections scored lower do not enter the average precision


@dataclass(frozen=True)
class Assessment:
    """How good a detector is on the images of a split, all vehicles taken for one class.

    Attributes
    ----------
    min_height : lower vehicles do not count, pixels of the images.
    images, vehicles : how many. map50 : average precision at IoU 0.5.
    recall, precision : at the score that `DetectorConfig` reports by default.
    """

    min_height: float
    images: int
    vehicles: int
    map50: float
    recall: float
    precision: float


def assess(
    model: Path,
    data: DetectionSet,
    split: str,
    min_heights: tuple[float, ...],
    config: DetectorConfig | None = None,
    progress: Progress | None = None,
) -> list[Assessment]:
    """Judge a model at IoU 0.5, once for each least height of vehicles, pixels of the images."""
    config = config or DetectorConfig(classes=())
    detector = YoloDetector(model, dataclasses.replace(config, score=CURVE_SCORE))
    every = []
    for number, path in enumerate(data.images[split], start=1):
        example = data.read(path)
        every.append((_one_class(detector.detect(example.image)), _one_class(example.boxes), example.ignored))
        if progress:
            progress(number, len(data.images[split]))
    results = []
    for height in min_heights:
        judged = [judge(found, truth, ignored.xyxy, height) for found, truth, ignored in every]
        recall, precision = recall_precision(judged, DetectorConfig().score)
        wanted = sum(len(part.wanted) for part in judged)
        results.append(Assessment(height, len(judged), wanted, average_precision(judged), recall, precision))
    return results


def _one_class(boxes: Boxes) -> Boxes:
    return dataclasses.replace(boxes, class_id=np.zeros(len(boxes), np.int64))
